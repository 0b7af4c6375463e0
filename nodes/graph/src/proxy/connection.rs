//! One software and the server: bytes in, lines through the relay, bytes out.
//!
//! Place in the flow: below [`super::serve`]. One thread waits for both sides, relays and writes: a thread between would make each
//! line wait for one more wake-up. What one side sends faster than the other takes waits in the network. Half a line at the end
//! of a connection is no line: it does not pass, and is told.

use super::corrector::Corrector;
use abbe_ippdme::line::{Lines, Piece};
use abbe_ippdme::relay::{Out, Relay};
use abbe_runtime::Shutdown;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::io::{ErrorKind, Read, Result, Write};
use std::net::{Shutdown as Ways, TcpStream};
use std::time::{Duration, Instant};

/// Bytes that are taken at once at most.
const AT_ONCE: usize = 1 << 16;
/// How often it looks whether to stop while nothing passes.
const LOOK_UP: Timespec = Timespec { tv_sec: 0, tv_nsec: 20_000_000 };
/// How long a side may take nothing before it is given up.
const TAKES_WITHIN: Duration = Duration::from_secs(10);

/// How long the server may leave a question of the relay's own without a word. It is asked while the machine stands.
const ANSWERS_WITHIN: Duration = Duration::from_secs(10);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Software,
    Server,
}

impl Side {
    fn name(self) -> &'static str {
        match self {
            Side::Software => "the software",
            Side::Server => "the machine's server",
        }
    }
}

/// Why a connection ended, and whether somebody should know.
pub(super) struct End {
    pub(super) why: String,
    pub(super) is_odd: bool,
}

impl End {
    fn usual(why: String) -> End {
        End { why, is_odd: false }
    }

    fn odd(why: String) -> End {
        End { why, is_odd: true }
    }
}

/// Relays until one side ends, or until told to stop; gives why.
pub(super) fn run(
    client: TcpStream,
    server: TcpStream,
    relay: &mut Relay,
    corrector: &mut Corrector,
    shutdown: &Shutdown,
) -> Result<End> {
    client.set_nonblocking(false)?;
    let mut both = Both { client, server, said: String::new() };
    for stream in [&both.client, &both.server] {
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(TAKES_WITHIN))?;
    }
    let why = both.relay(relay, corrector, shutdown);
    // An end in the middle of a piece has left some.
    corrector.sent();
    let last: Vec<u8> = relay.abandon().into_iter().flat_map(line_of).collect();
    // It may be gone already.
    let _ = both.server.write_all(&last);
    for stream in [&both.client, &both.server] {
        let _ = stream.shutdown(Ways::Both);
    }
    Ok(why)
}

fn line_of(out: Out) -> Vec<u8> {
    match out {
        Out::ToServer(line) | Out::ToClient(line) => line,
        Out::Say(_) | Out::Close(_) => Vec::new(),
    }
}

/// Bytes of a side that has some, or why no more come; `None` where a signal came first.
fn read<'a>(mut stream: &TcpStream, bytes: &'a mut [u8]) -> Option<std::result::Result<&'a [u8], String>> {
    match stream.read(bytes) {
        Ok(0) => Some(Err("ended the connection".to_owned())),
        Ok(count) => Some(Ok(&bytes[..count])),
        Err(error) if error.kind() == ErrorKind::Interrupted => None,
        Err(error) => Some(Err(error.to_string())),
    }
}

/// Both connections.
struct Both {
    client: TcpStream,
    server: TcpStream,
    /// What was said last.
    said: String,
}

impl Both {
    fn relay(&mut self, relay: &mut Relay, corrector: &mut Corrector, shutdown: &Shutdown) -> End {
        let (mut of_software, mut of_server) = (Lines::default(), Lines::default());
        let mut server_spoke = Instant::now();
        let mut bytes = vec![0; AT_ONCE];
        loop {
            if shutdown.requested() {
                return End::usual("stopped on request".to_owned());
            }
            if relay.is_asking() && server_spoke.elapsed() > ANSWERS_WITHIN {
                let why = format!(
                    "the machine's server left a question of the proxy without an answer for {ANSWERS_WITHIN:?}"
                );
                return End::odd(why);
            }
            let ready = match self.ready() {
                Ok(ready) => ready,
                Err(why) => return End::odd(why),
            };
            for side in ready.into_iter().flatten() {
                let (stream, lines) = match side {
                    Side::Software => (&self.client, &mut of_software),
                    Side::Server => (&self.server, &mut of_server),
                };
                let bytes = match read(stream, &mut bytes) {
                    None => continue,
                    Some(Ok(bytes)) => bytes,
                    Some(Err(why)) if lines.begun() == 0 => return End::usual(format!("{} {why}", side.name())),
                    Some(Err(why)) => {
                        return End::odd(format!("{} {why}, in the middle of a line, which did not pass", side.name()));
                    }
                };
                corrector.arrived();
                let was_asking = relay.is_asking();
                let mut outs = Vec::new();
                for piece in lines.take(bytes) {
                    match (side, piece) {
                        (Side::Software, Piece::Line(line)) => outs.extend(relay.from_client(&line, corrector)),
                        (Side::Server, Piece::Line(line)) => outs.extend(relay.from_server(&line, corrector)),
                        (side, Piece::TooLong) => {
                            let why = "sent a line that is longer than the protocol allows";
                            return End::odd(format!("{} {why}", side.name()));
                        }
                    }
                }
                if side == Side::Server || !was_asking {
                    server_spoke = Instant::now();
                }
                if let Err(why) = self.send(outs) {
                    return End::odd(why);
                }
                corrector.sent();
            }
        }
    }

    /// Which sides have sent something or ended; none after a while in which nothing passed.
    fn ready(&self) -> std::result::Result<[Option<Side>; 2], String> {
        let mut waits = [&self.client, &self.server].map(|stream| PollFd::new(stream, PollFlags::IN));
        match poll(&mut waits, Some(&LOOK_UP)) {
            Ok(0) | Err(rustix::io::Errno::INTR) => Ok([None; 2]),
            Ok(_) => {
                let has = |wait: &PollFd, side: Side| (!wait.revents().is_empty()).then_some(side);
                Ok([has(&waits[0], Side::Software), has(&waits[1], Side::Server)])
            }
            Err(error) => Err(format!("the connections cannot be waited for: {error}")),
        }
    }

    /// Sends what came out, each side's lines at once; words come last, because they wait for whoever reads them.
    fn send(&mut self, outs: Vec<Out>) -> std::result::Result<(), String> {
        let (mut to_client, mut to_server, mut words, mut ends) = (Vec::new(), Vec::new(), Vec::new(), None);
        for out in outs {
            match out {
                Out::ToClient(line) => to_client.extend(line),
                Out::ToServer(line) => to_server.extend(line),
                Out::Say(said) => words.push(said),
                Out::Close(why) => ends = Some(why),
            }
        }
        let of = |side: Side| move |error: std::io::Error| format!("{} takes nothing more: {error}", side.name());
        let to_server = self.server.write_all(&to_server).map_err(of(Side::Server));
        let to_client = to_server.and_then(|()| self.client.write_all(&to_client).map_err(of(Side::Software)));
        for words in words {
            // The same words for each point of a scan would fill the log.
            if words != self.said {
                tracing::warn!("{words}");
                self.said = words;
            }
        }
        to_client?;
        ends.map_or(Ok(()), Err)
    }
}
