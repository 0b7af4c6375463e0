//! `abbe simulate --serve`: the simulated machine behind the sockets that a real one has.
//!
//! Place in the flow: a capture is rehearsed against it, through the drivers of a real machine.

use abbe_graph::serving::{NO_OPCUA, Served, Way, opcua_axes, serve, serve_opcua};
use abbe_runtime::Shutdown;
use abbe_virtual_machine::{Drive, Obedient, Pace, SimulationConfig};
use anyhow::{Context, ensure};
use std::io::Write;
use std::net::TcpListener;
use std::sync::Arc;

/// Protocols that the machine can be served over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Protocol {
    /// I++ DME for the scales, lines of text for the tracer
    Ippdme,
    /// OPC UA for the scales, lines of text for the tracer
    Opcua,
}

/// How the machine is served.
#[derive(Debug, clap::Args)]
pub(super) struct Serving {
    /// Serve the machine to clients while it drives the plan, until Ctrl-C, to rehearse a capture
    #[arg(long, conflicts_with = "trials")]
    serve: Option<Protocol>,
    /// Address of the server; 127.0.0.1:1294 for I++ DME and 127.0.0.1:4840 for OPC UA without it
    #[arg(long, requires = "serve")]
    listen: Option<String>,
    /// Address at which the tracer writes a line a length
    #[arg(long, default_value = "127.0.0.1:5294", requires = "serve")]
    tracer_listen: String,
    /// Lengths a second
    #[arg(long, default_value_t = 100.0, requires = "serve")]
    tracer_hz: f64,
    /// Time at each point (s)
    #[arg(long, default_value_t = 1.5, requires = "serve")]
    dwell_s: f64,
    /// Time to move tracer or reflector (s)
    #[arg(long, default_value_t = 5.0, requires = "serve")]
    change_s: f64,
    /// So many times faster than the plan's feeds and accelerations
    #[arg(long, default_value_t = 1.0, requires = "serve")]
    faster: f64,
    /// Begin again at the end of the plan
    #[arg(long, requires = "serve")]
    again: bool,
    /// Move where the client orders (GoTo of I++ DME), not along the plan
    #[arg(long, requires = "serve", conflicts_with = "again")]
    obey: bool,
}

impl Serving {
    pub(super) fn is_wanted(&self) -> bool {
        self.serve.is_some()
    }
}

pub(super) fn run(config: &SimulationConfig, stroke_m: [(f64, f64); 3], serving: &Serving) -> anyhow::Result<()> {
    let numbers = [
        ("--tracer-hz", serving.tracer_hz, 1e4),
        ("--dwell-s", serving.dwell_s, 1e4),
        ("--change-s", serving.change_s, 1e5),
        ("--faster", serving.faster, 1e4),
    ];
    for (option, value, most) in numbers {
        ensure!(value > 0.0 && value <= most, "{option} {value}: give a number above 0, at most {most}");
    }
    let protocol = serving.serve.unwrap_or(Protocol::Ippdme);
    ensure!(
        !serving.obey || protocol == Protocol::Ippdme,
        "--obey: OPC UA has no order to move; leave it out, or serve ippdme"
    );
    // Before anything is listened on, or said to be.
    let axes = match protocol {
        Protocol::Ippdme => None,
        Protocol::Opcua => Some(opcua_axes().context(NO_OPCUA)?),
    };
    let Serving { dwell_s, change_s, faster, .. } = *serving;
    let pace = Pace { dwell_s, change_s, faster };
    let drive = Drive::new(config, pace)?;
    let mut offsets_m: Vec<[f64; 3]> = Vec::new();
    for line in config.plan.stations.iter().flat_map(|station| &station.lines) {
        if !offsets_m.contains(&line.offset_m) {
            offsets_m.push(line.offset_m);
        }
    }
    let lasts_s = drive.ends_s();
    let way = match serving.obey {
        true => {
            let machine = Obedient::new(drive, pace).context("the plan has no point; plan one with abbe plan")?;
            Way::Ordered(Box::new(machine), stroke_m)
        }
        false => Way::Planned(Box::new(drive), serving.again),
    };
    let served = Arc::new(Served::new(way, &offsets_m, serving.tracer_hz));
    let bind = |option: &str, address: &str| {
        TcpListener::bind(address).with_context(|| {
            format!("{option} {address}: cannot be listened on; name another address, such as 127.0.0.1:0")
        })
    };
    let listen = serving.listen.as_deref().unwrap_or(match protocol {
        Protocol::Ippdme => "127.0.0.1:1294",
        Protocol::Opcua => "127.0.0.1:4840",
    });
    let (server, tracer) = (bind("--listen", listen)?, bind("--tracer-listen", &serving.tracer_listen)?);
    let shutdown = Shutdown::on_signals()?;
    // Not `eprintln!`: it goes on whether or not somebody reads this.
    let say = |words: String| drop(writeln!(std::io::stderr(), "abbe: {words}"));
    let moves = match (serving.obey, protocol) {
        (true, _) => "it moves where the client orders".to_owned(),
        (false, Protocol::Ippdme) => format!("the way takes {:.1} min and begins when both are read", lasts_s / 60.0),
        (false, Protocol::Opcua) => {
            format!("the way takes {:.1} min and begins when the tracer is read", lasts_s / 60.0)
        }
    };
    let (own, tracers) = (server.local_addr()?, tracer.local_addr()?);
    let name = match protocol {
        Protocol::Ippdme => "I++ DME",
        Protocol::Opcua => "OPC UA",
    };
    say(format!("{name} on {own}, the tracer on {tracers}; {moves}; Ctrl-C ends it"));
    match protocol {
        Protocol::Ippdme => {
            for (name, offset_m) in served.holders() {
                let [x, y, z] = offset_m.map(|m| m * 1e3);
                say(format!("tools_mm = {{ {name} = [{x:?}, {y:?}, {z:?}] }}"));
            }
            Ok(serve(&served, (&server, &tracer), &shutdown)?)
        }
        Protocol::Opcua => {
            axes.into_iter().for_each(say);
            Ok(serve_opcua(&served, (server, &tracer), &shutdown)?)
        }
    }
}
