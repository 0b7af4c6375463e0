//! One software and the server: bytes in, lines through the relay, bytes out.
//!
//! Place in the flow: below [`super::serve`]. Two threads read, one relays and writes. What one side sends faster than the other
//! takes waits in a queue of fixed length, and then in the network. Half a line at the end of a connection is no line: it does
//! not pass, and is told.

use super::corrector::Corrector;
use abbe_ippdme::line::{Lines, Piece};
use abbe_ippdme::relay::{Out, Relay};
use abbe_runtime::Shutdown;
use std::io::{ErrorKind, Read, Result, Write};
use std::net::{Shutdown as Ways, TcpStream};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

/// Pieces that wait at most, of each side.
const QUEUE: usize = 64;
/// How often it looks whether to stop while nothing passes.
const LOOK_UP: Duration = Duration::from_millis(20);
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

/// What a side sent: bytes, or why no more come.
type Sent = (Side, std::result::Result<Vec<u8>, String>);

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
    let (give, sent) = sync_channel(QUEUE);
    let mut both = Both { client, server, said: String::new() };
    for stream in [&both.client, &both.server] {
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(TAKES_WITHIN))?;
    }
    let readers = [(Side::Software, both.client.try_clone()?), (Side::Server, both.server.try_clone()?)];
    let readers = readers.map(|(side, stream)| {
        let give = give.clone();
        thread::Builder::new().name("proxy".into()).spawn(move || read(side, stream, &give))
    });
    drop(give);
    let why = both.relay(&sent, relay, corrector, shutdown);
    // An end in the middle of a piece has left some.
    corrector.sent();
    let last: Vec<u8> = relay.abandon().into_iter().flat_map(line_of).collect();
    // It may be gone already.
    let _ = both.server.write_all(&last);
    for stream in [&both.client, &both.server] {
        let _ = stream.shutdown(Ways::Both);
    }
    // Takes what still waits, so that no reader waits for room.
    while sent.recv().is_ok() {}
    for reader in readers {
        // It ends with its stream.
        let _ = reader?.join();
    }
    Ok(why)
}

fn line_of(out: Out) -> Vec<u8> {
    match out {
        Out::ToServer(line) | Out::ToClient(line) => line,
        Out::Say(_) | Out::Close(_) => Vec::new(),
    }
}

fn read(side: Side, mut stream: TcpStream, give: &SyncSender<Sent>) {
    let mut bytes = [0; 1 << 16];
    loop {
        let sent = match stream.read(&mut bytes) {
            Ok(0) => Err("ended the connection".to_owned()),
            Ok(count) => Ok(bytes[..count].to_vec()),
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            Err(error) => Err(error.to_string()),
        };
        let is_end = sent.is_err();
        if give.send((side, sent)).is_err() || is_end {
            return;
        }
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
    fn relay(
        &mut self,
        sent: &Receiver<Sent>,
        relay: &mut Relay,
        corrector: &mut Corrector,
        shutdown: &Shutdown,
    ) -> End {
        let (mut of_software, mut of_server) = (Lines::default(), Lines::default());
        let mut server_spoke = Instant::now();
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
            let (side, bytes) = match sent.recv_timeout(LOOK_UP) {
                Ok(sent) => sent,
                Err(RecvTimeoutError::Timeout) => continue,
                Err(RecvTimeoutError::Disconnected) => return End::usual("both sides ended".to_owned()),
            };
            let lines = if side == Side::Software { &mut of_software } else { &mut of_server };
            let bytes = match bytes {
                Ok(bytes) => bytes,
                Err(why) if lines.begun() == 0 => return End::usual(format!("{} {why}", side.name())),
                Err(why) => {
                    return End::odd(format!("{} {why}, in the middle of a line, which did not pass", side.name()));
                }
            };
            corrector.arrived();
            let was_asking = relay.is_asking();
            let mut outs = Vec::new();
            for piece in lines.take(&bytes) {
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
