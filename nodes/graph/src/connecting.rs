//! What drivers and the proxy over a network have in common: connecting, waiting longer after each failure, stamps of what arrives.
//!
//! Place in the flow: used by the threads of the drivers `lines` and `ippdme`, and by [`crate::proxy`].

use abbe_msgs::Stamp;
use std::io::{Error, ErrorKind, Result};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Wait before the first new try to connect; it doubles with each further one, up to [`LONGEST_WAIT`].
const FIRST_WAIT: Duration = Duration::from_millis(100);
const LONGEST_WAIT: Duration = Duration::from_secs(5);
/// How long a connection may take to be made.
const CONNECT_WITHIN: Duration = Duration::from_secs(3);

/// How long to wait before the next try.
#[derive(Debug, Clone)]
pub(crate) struct Waits {
    next: Duration,
}

impl Waits {
    pub(crate) fn new() -> Waits {
        Waits { next: FIRST_WAIT }
    }

    /// It worked: the next wait is the first again.
    pub(crate) fn begin_again(&mut self) {
        self.next = FIRST_WAIT;
    }

    /// The wait before this try.
    pub(crate) fn next(&mut self) -> Duration {
        let wait = self.next;
        self.next = (self.next * 2).min(LONGEST_WAIT);
        wait
    }
}

/// Connects with the first address of `host:port` that takes it.
pub(crate) fn connect(address: &str) -> Result<TcpStream> {
    let mut outcome = Err(Error::new(ErrorKind::NotFound, "the host has no address"));
    for address in address.to_socket_addrs()? {
        outcome = TcpStream::connect_timeout(&address, CONNECT_WITHIN);
        if outcome.is_ok() {
            break;
        }
    }
    outcome
}

/// What is wrong with an address; `None` where it is `host:port`.
pub(crate) fn address_problem(address: &str) -> Option<String> {
    let port = address.rsplit_once(':').map(|(_, port)| port.parse::<u16>());
    (!matches!(port, Some(Ok(_)))).then(|| format!("{address:?} is no host:port; write it like \"10.0.0.5:5000\""))
}

/// Whether reading gave up its wait.
pub(crate) fn is_timeout(error: &Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut)
}

/// The stamp of what arrived at this instant.
pub(crate) fn stamp_of(instant: SystemTime) -> std::result::Result<Stamp, String> {
    let since = instant.duration_since(UNIX_EPOCH).map_err(|_| "the clock of this host is before 1970".to_owned())?;
    let nanos = i64::try_from(since.as_nanos()).map_err(|error| error.to_string())?;
    Stamp::from_nanos(nanos).map_err(|error| format!("the clock of this host: {error}"))
}
