//! Where lines come from: a TCP connection, UDP packets, a serial port, the output of a command. Connects again by itself.
//!
//! Place in the flow: a thread reads and waits, so that the node's loop never does; it hands over whole lines with the instant
//! at which they were complete. A queue that is full makes the thread wait, and TCP the sender.

use super::event::{Ended, Event, Gone, Line, MOST_BYTES};
use super::running::Running;
use super::serial::{SerialConfig, read_serial};
use crate::connecting::{Waits, address_problem, connect, is_timeout};
use abbe_runtime::realtime::carry_samples;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Weak};
use std::thread;
use std::time::{Duration, SystemTime};

/// What is wrong with half a line.
pub(in crate::driver) const HALF: &str = "it has no end: it was cut off, and half a number is a number, too";
/// Lines that wait for the node's loop at most.
const QUEUE: usize = 4096;

/// Where lines come from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum LinesFrom {
    /// A TCP server, as `host:port`.
    Tcp(String),
    /// A TCP client that connects here, at `address:port`; one at a time.
    TcpListen(String),
    /// UDP packets sent here, at `address:port`; each ends a line.
    Udp(String),
    /// A serial port.
    Serial(SerialConfig),
    /// What a command writes to its standard output: program and arguments.
    Command(Vec<String>),
}

impl LinesFrom {
    pub(in crate::driver) fn problem(&self) -> Option<String> {
        match self {
            LinesFrom::Tcp(address) | LinesFrom::TcpListen(address) | LinesFrom::Udp(address) => {
                address_problem(address)
            }
            LinesFrom::Serial(serial) => serial.problem(),
            LinesFrom::Command(words) => {
                words.first().is_none_or(String::is_empty).then(|| "name a program to run".to_owned())
            }
        }
    }
}

impl fmt::Display for LinesFrom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LinesFrom::Tcp(address) => write!(f, "tcp {address}"),
            LinesFrom::TcpListen(address) => write!(f, "tcp_listen {address}"),
            LinesFrom::Udp(address) => write!(f, "udp {address}"),
            LinesFrom::Serial(serial) => serial.fmt(f),
            LinesFrom::Command(words) => write!(f, "command {}", words.join(" ")),
        }
    }
}

/// The loop's end of the thread.
pub(in crate::driver) struct Port {
    events: Receiver<Event>,
    lines: u64,
    /// A thread that waits at a silent port learns from it that nobody listens any more.
    _listener: Arc<()>,
    /// The command that runs, if lines come from one. The thread that reads it may wait for its next line, so it is ended from here.
    running: Running,
}

impl Drop for Port {
    fn drop(&mut self) {
        self.running.end_for_good();
    }
}

impl Port {
    /// Opens what can be opened only once (a listening socket), and starts the thread; whether what comes is `on_the_path` of a
    /// corrected sample.
    pub(in crate::driver) fn open(
        from: &LinesFrom,
        silent_after: Duration,
        on_the_path: bool,
    ) -> std::io::Result<Port> {
        let source: Source = match from {
            LinesFrom::Tcp(address) => Source::Client(address.clone()),
            LinesFrom::TcpListen(address) => Source::Server(TcpListener::bind(address)?),
            LinesFrom::Udp(address) => Source::Packets(UdpSocket::bind(address)?),
            LinesFrom::Serial(serial) => Source::Serial(serial.clone()),
            LinesFrom::Command(words) => Source::Command(words.clone()),
        };
        let (give, events) = sync_channel(QUEUE);
        let listener = Arc::new(());
        let weak = Arc::downgrade(&listener);
        let running = Running::default();
        let runs = running.clone();
        let read = move || {
            // The instant at which a line was complete is its stamp. A program that is started is not to get the priority.
            let starts_a_program = matches!(source, Source::Command(_));
            let _realtime = (on_the_path && !starts_a_program).then(carry_samples);
            source.run(&give, silent_after, &weak, on_the_path, &runs);
        };
        thread::Builder::new().name("lines".into()).spawn(read)?;
        Ok(Port { events, lines: 0, _listener: listener, running })
    }

    /// The next event, within this time.
    pub(in crate::driver) fn next(&mut self, within: Duration) -> Option<Event> {
        match self.events.recv_timeout(within) {
            Ok(event) => {
                self.lines +=
                    u64::from(matches!(event, Event::Line(_) | Event::TooLong | Event::NotWhole | Event::Half));
                Some(event)
            }
            Err(RecvTimeoutError::Timeout) => None,
            // The thread ends with the loop, and not before.
            Err(RecvTimeoutError::Disconnected) => {
                thread::sleep(within);
                None
            }
        }
    }

    /// Lines so far.
    pub(in crate::driver) fn lines(&self) -> u64 {
        self.lines
    }
}

enum Source {
    Client(String),
    Server(TcpListener),
    Packets(UdpSocket),
    Serial(SerialConfig),
    Command(Vec<String>),
}

impl Source {
    fn run(
        &self,
        give: &SyncSender<Event>,
        silent_after: Duration,
        listener: &Weak<()>,
        on_the_path: bool,
        running: &Running,
    ) {
        let mut waits = Waits::new();
        loop {
            let outcome = match self {
                Source::Client(address) => connect(address).and_then(|stream| read_stream(stream, give, silent_after)),
                Source::Server(listener) => {
                    listener.accept().and_then(|(stream, _)| read_stream(stream, give, silent_after))
                }
                Source::Packets(socket) => read_packets(socket, give),
                Source::Serial(serial) => read_serial(serial, give, listener),
                Source::Command(words) => read_command(words, give, on_the_path, running),
            };
            let why = match outcome {
                Ok(Err(Gone)) => return,
                Ok(Ok(())) => {
                    waits.begin_again();
                    "the other side ended it".to_owned()
                }
                Err(error) if error.kind() == ErrorKind::UnexpectedEof => {
                    waits.begin_again();
                    error.to_string()
                }
                Err(error) if is_timeout(&error) => format!("silent for {silent_after:?}"),
                Err(error) => error.to_string(),
            };
            if give.send(Event::Lost(why)).is_err() {
                return;
            }
            thread::sleep(waits.next());
        }
    }
}

fn read_stream(stream: TcpStream, give: &SyncSender<Event>, silent_after: Duration) -> Ended {
    stream.set_read_timeout(Some(silent_after))?;
    let whom = stream.peer_addr()?.to_string();
    if give.send(Event::Connected(whom)).is_err() {
        return Ok(Err(Gone));
    }
    read_lines(BufReader::new(stream), give, Tail::Half)
}

/// A packet ends a line, unless those before it showed that lines end with a sign: then one without it is half a line, and the
/// beginning of the next packet the other half.
#[derive(Debug, Default)]
struct Packets {
    have_ends: bool,
    is_half: bool,
}

impl Packets {
    /// The part of a packet that may be lines, and what its end means.
    fn take<'a>(&mut self, packet: &'a [u8]) -> (&'a [u8], Tail) {
        let has_end = packet.last() == Some(&b'\n');
        let rest = match packet.iter().position(|byte| *byte == b'\n') {
            _ if !self.is_half => packet,
            Some(at) => &packet[at + 1..],
            None => &[],
        };
        self.have_ends |= has_end;
        self.is_half = self.have_ends && !has_end && (self.is_half || !packet.is_empty());
        (rest, if self.have_ends { Tail::Half } else { Tail::Whole })
    }
}

fn read_packets(socket: &UdpSocket, give: &SyncSender<Event>) -> Ended {
    let mut packet = [0; 1 << 16];
    let mut packets = Packets::default();
    loop {
        let count = match socket.recv(&mut packet) {
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            other => other?,
        };
        let (rest, tail) = packets.take(&packet[..count]);
        if let Err(Gone) = read_lines(rest, give, tail)? {
            return Ok(Err(Gone));
        }
    }
}

fn read_command(words: &[String], give: &SyncSender<Event>, on_the_path: bool, running: &Running) -> Ended {
    let (program, arguments) = words.split_first().ok_or(ErrorKind::InvalidInput)?;
    let mut command = Command::new(program);
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::piped());
    let Some(output) = running.start(&mut command)? else { return Ok(Err(Gone)) };
    let _realtime = on_the_path.then(carry_samples);
    let said = match give.send(Event::Connected(program.clone())) {
        Ok(()) => read_lines(BufReader::new(output), give, Tail::Half),
        Err(_) => Ok(Err(Gone)),
    };
    let status = running.end();
    if let Err(Gone) = said? {
        return Ok(Err(Gone));
    }
    Err(std::io::Error::other(status.map_or("it was ended".to_owned(), |status| format!("it ended with {status}"))))
}

/// What a last line without an end of its own is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Tail {
    Whole,
    Half,
}

/// Reads to the end.
fn read_lines(mut input: impl BufRead, give: &SyncSender<Event>, tail: Tail) -> Ended {
    loop {
        let mut text = Vec::new();
        let most = MOST_BYTES as u64 + 1;
        let count = match input.by_ref().take(most).read_until(b'\n', &mut text) {
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            other => other?,
        };
        if count == 0 {
            return Ok(Ok(()));
        }
        let event = match text.last() {
            Some(b'\n') => Event::Line(Line { text, arrived: SystemTime::now() }),
            _ if count > MOST_BYTES => {
                pass_over(&mut input)?;
                Event::TooLong
            }
            _ if tail == Tail::Half => Event::Half,
            _ => Event::Line(Line { text, arrived: SystemTime::now() }),
        };
        if give.send(event).is_err() {
            return Ok(Err(Gone));
        }
    }
}

/// The rest of a line.
fn pass_over(input: &mut impl BufRead) -> std::io::Result<()> {
    loop {
        let buffer = input.fill_buf()?;
        match buffer.iter().position(|byte| *byte == b'\n') {
            Some(at) => {
                input.consume(at + 1);
                return Ok(());
            }
            None if buffer.is_empty() => return Ok(()),
            None => {
                let all = buffer.len();
                input.consume(all);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines_of(bytes: &[u8], tail: Tail) -> Vec<Event> {
        let (give, events) = sync_channel(QUEUE);
        assert!(matches!(read_lines(bytes, &give, tail), Ok(Ok(()))));
        drop(give);
        events.into_iter().collect()
    }

    #[test]
    fn a_line_that_is_too_long_is_passed_over_and_the_next_is_whole() {
        let text = format!("1,2\r\n{}\n3,4", "7".repeat(3 * MOST_BYTES));
        let events = lines_of(text.as_bytes(), Tail::Whole);
        let [Event::Line(first), Event::TooLong, Event::Line(last)] = events.as_slice() else { panic!("{events:?}") };
        assert_eq!((first.text.as_slice(), last.text.as_slice()), (b"1,2\r\n".as_slice(), b"3,4".as_slice()));
    }

    #[test]
    fn the_last_line_of_a_connection_without_an_end_is_half_a_line() {
        let events = lines_of(b"1,2,300.5\n1,2,30", Tail::Half);
        assert!(matches!(events.as_slice(), [Event::Line(_), Event::Half]), "{events:?}");
        assert!(matches!(lines_of(b"1,2,300.5\n", Tail::Half).as_slice(), [Event::Line(_)]));
    }

    #[test]
    fn packets_end_lines_until_one_shows_that_lines_have_ends() {
        let mut packets = Packets::default();
        let mut lines = |packet: &str| -> Vec<String> {
            let (rest, tail) = packets.take(packet.as_bytes());
            let of = |event: &Event| match event {
                Event::Line(line) => String::from_utf8_lossy(&line.text).trim_end().to_owned(),
                other => format!("{other:?}"),
            };
            lines_of(rest, tail).iter().map(of).collect()
        };
        assert_eq!(lines("20.5"), ["20.5"], "a packet a line, without an end");
        assert_eq!(lines("20.5\r\n20.6\r\n"), ["20.5", "20.6"]);
        assert_eq!(lines("20"), ["Half"], "cut in the middle of a number");
        assert_eq!(lines(".75\n20.8\n"), ["20.8"], "its other half is no line either");
        assert_eq!(lines("1"), ["Half"]);
        assert_eq!(lines("2"), [""; 0]);
        assert_eq!(lines("3\n"), [""; 0]);
        assert_eq!(lines("20.9\n"), ["20.9"]);
    }
}
