//! Stands between measuring software and the server of a measuring machine, and corrects the positions that pass.
//!
//! Place in the flow: `abbe proxy` opens it. [`abbe_ippdme::relay`] says what passes; here are its sockets, the correcting
//! function of the live nodes, and the recorder's writer. One software at a time, many one after the other: a second one waits
//! until the first has gone.

mod connection;
mod corrector;

use crate::connecting::{address_problem, connect};
use abbe_ippdme::relay::{Counts, Relay, Settings};
use abbe_msgs::bag::BagError;
use abbe_runtime::Shutdown;
use connection::End;
use std::collections::BTreeMap;
use std::io::{ErrorKind, Write};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;
use thiserror::Error;

pub use corrector::Corrector;

/// How often it looks whether to stop while nobody is connected.
const LOOK_UP: Duration = Duration::from_millis(20);
/// What software hears whose machine cannot be reached.
const NO_SERVER: &str = "E0000 ! Error(9, 0503, \"abbe\", \"Controller communications failure\")\r\n";

/// A proxy.
#[derive(Debug, Clone)]
pub struct ProxyConfig {
    /// The machine's own server, as `host:port`.
    pub to: String,
    /// What passes and how.
    pub settings: Settings,
}

/// What passed until the end.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Summary {
    /// Connections of software.
    pub connections: u64,
    /// What passed on all of them.
    pub counts: Counts,
    /// Corrected positions by what they are worth.
    pub by_status: BTreeMap<String, u64>,
    /// Messages in the bag.
    pub recorded: u64,
    /// Messages that are not in the bag, although one is written.
    pub unrecorded: u64,
}

/// Why a proxy does not work.
#[derive(Debug, Error)]
pub enum ProxyError {
    /// An address is none.
    #[error("{option}: {problem}")]
    Address {
        /// The option.
        option: &'static str,
        /// What is wrong.
        problem: String,
    },
    /// Nobody can connect.
    #[error("--listen {address}: {source}; check the address, and that no other program has it")]
    Listen {
        /// The address.
        address: String,
        /// Why.
        source: std::io::Error,
    },
    /// The bag cannot be written.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// The system refuses a thread.
    #[error("cannot start a thread: {0}")]
    Thread(#[source] std::io::Error),
}

/// Opens the port that software connects to.
pub fn listen(address: &str) -> Result<TcpListener, ProxyError> {
    if let Some(problem) = address_problem(address) {
        return Err(ProxyError::Address { option: "--listen", problem });
    }
    let of_listen = |source| ProxyError::Listen { address: address.to_owned(), source };
    let listener = TcpListener::bind(address).map_err(of_listen)?;
    listener.set_nonblocking(true).map_err(of_listen)?;
    Ok(listener)
}

/// Serves software until told to stop.
pub fn serve(
    listener: &TcpListener,
    config: &ProxyConfig,
    corrector: &mut Corrector,
    shutdown: &Shutdown,
) -> Result<Summary, ProxyError> {
    if let Some(problem) = address_problem(&config.to) {
        return Err(ProxyError::Address { option: "--to", problem });
    }
    let mut summary = Summary::default();
    while !shutdown.requested() {
        match listener.accept() {
            Ok((client, whom)) => {
                summary.connections += 1;
                tracing::info!("{whom}: connected");
                let mut relay = Relay::new(config.settings.clone());
                let end = serve_one(client, config, &mut relay, corrector, shutdown);
                summary.counts = sum(summary.counts, relay.counts());
                match end {
                    Ok(End { why, is_odd: false }) => tracing::info!("{whom}: {why}"),
                    Ok(End { why, .. }) => tracing::warn!("{whom}: {why}"),
                    Err(error) => tracing::warn!("{whom}: {error}"),
                }
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
                shutdown.sleep(LOOK_UP);
            }
            Err(error) => {
                // Such as one that went away before it was taken, or too many open files.
                tracing::warn!("a connection could not be taken: {error}");
                shutdown.sleep(LOOK_UP);
            }
        }
    }
    summary.by_status = corrector.by_status();
    (summary.recorded, summary.unrecorded) = corrector.finish()?;
    Ok(summary)
}

/// Serves one software; gives why it ended.
fn serve_one(
    mut client: TcpStream,
    config: &ProxyConfig,
    relay: &mut Relay,
    corrector: &mut Corrector,
    shutdown: &Shutdown,
) -> std::io::Result<End> {
    match connect(&config.to) {
        Ok(server) => connection::run(client, server, relay, corrector, shutdown),
        Err(error) => {
            // It may be gone already.
            let _ = client.write_all(NO_SERVER.as_bytes());
            let why = format!("{}: {error}; the software is told, start the machine's server", config.to);
            Ok(End { why, is_odd: true })
        }
    }
}

fn sum(a: Counts, b: Counts) -> Counts {
    Counts {
        corrected: a.corrected + b.corrected,
        refused: a.refused + b.refused,
        uncorrected: a.uncorrected + b.uncorrected,
        targets: a.targets + b.targets,
    }
}
