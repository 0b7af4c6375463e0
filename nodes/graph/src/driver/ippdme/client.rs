//! One connection with a server: commands and their answers, and what the server says unasked.
//!
//! Place in the flow: below [`super::session`]. A command is sent when the one before it is complete. Answers to other tags than
//! the one that is asked for are not taken for its answer: a position that comes late is no new one.

use crate::connecting::is_timeout;
use abbe_ippdme::line::{Lines, Piece, text};
use abbe_ippdme::message::{ReplyKind, Response, Tag};
use abbe_ippdme::trouble::Trouble;
use std::collections::VecDeque;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant, SystemTime};

/// How long a read waits before the thread looks whether to stop.
const SLICE: Duration = Duration::from_millis(20);
/// Lines from the server that wait at most; a server that says more unasked is not listened to.
const MOST_WAITING: usize = 100_000;

/// Tags of the events that stop a move, and that ask whether the server lives.
const ABORT: Tag = Tag::Event(9001);
const ALIVE: Tag = Tag::Event(9002);
/// How long an aborted move is waited for.
const ABORT_WITHIN: Duration = Duration::from_secs(10);
/// How long a server is waited for at the end.
const LAST_WAIT: Duration = Duration::from_millis(500);

/// How a move ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Moved {
    /// As ordered.
    Whole,
    /// On request.
    Aborted,
}

/// Why a connection does not go on.
#[derive(Debug)]
pub(super) enum Stop {
    /// The driver was closed.
    Gone,
    /// The connection is of no use any more.
    Lost(String),
    /// The server has an error that stops it; whether it came of a command of this driver.
    Trouble(Trouble, bool),
}

impl From<std::io::Error> for Stop {
    fn from(error: std::io::Error) -> Stop {
        Stop::Lost(error.to_string())
    }
}

/// A line and when it was complete.
#[derive(Debug, Clone)]
pub(super) struct Arrived {
    pub(super) line: Vec<u8>,
    pub(super) at: SystemTime,
    pub(super) number: u64,
}

/// The connection.
pub(super) struct Client<'a> {
    stream: TcpStream,
    lines: Lines,
    waiting: VecDeque<Arrived>,
    /// What the server said unasked.
    pub(super) unasked: VecDeque<Arrived>,
    next_tag: u32,
    count: u64,
    heard: Instant,
    silent_after: Duration,
    is_stopped: &'a dyn Fn() -> bool,
}

impl<'a> Client<'a> {
    pub(super) fn new(
        stream: TcpStream,
        silent_after: Duration,
        is_stopped: &'a dyn Fn() -> bool,
    ) -> Result<Client<'a>, Stop> {
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(SLICE))?;
        stream.set_write_timeout(Some(silent_after))?;
        Ok(Client {
            stream,
            lines: Lines::default(),
            waiting: VecDeque::new(),
            unasked: VecDeque::new(),
            next_tag: 0,
            count: 0,
            heard: Instant::now(),
            silent_after,
            is_stopped,
        })
    }

    /// How long nothing came.
    pub(super) fn silence(&self) -> Duration {
        self.heard.elapsed()
    }

    /// Lines so far.
    pub(super) fn lines(&self) -> u64 {
        self.count
    }

    /// Sends a command and gives the data of its answer when it is complete.
    pub(super) fn ask(&mut self, command: &str) -> Result<Vec<Arrived>, Stop> {
        self.next_tag = self.next_tag % 99_999 + 1;
        self.exchange(Tag::Command(self.next_tag), command)
    }

    /// The same with a tag of its own.
    pub(super) fn exchange(&mut self, tag: Tag, command: &str) -> Result<Vec<Arrived>, Stop> {
        self.stream.write_all(format!("{tag} {command}\r\n").as_bytes())?;
        let (begun, mut data, mut trouble) = (Instant::now(), Vec::new(), None);
        loop {
            let Some(arrived) = self.waiting.pop_front() else {
                if begun.elapsed() > self.silent_after {
                    return Err(Stop::Lost(format!("no answer to {command} within {:?}", self.silent_after)));
                }
                self.listen()?;
                continue;
            };
            match Response::parse(text(&arrived.line)) {
                Ok(response) if response.tag == tag => match response.kind {
                    ReplyKind::Ack => {}
                    ReplyKind::Data if data.len() >= MOST_WAITING => {
                        return Err(Stop::Lost(format!("its answer to {command} does not end")));
                    }
                    ReplyKind::Data => data.push(arrived),
                    ReplyKind::Error => {
                        let told = Trouble::parse(response.data());
                        match told.severity.stops() {
                            true => trouble = trouble.or(Some(told)),
                            false => tracing::info!("{command}: {told}"),
                        }
                    }
                    ReplyKind::Done => return trouble.map_or(Ok(data), |trouble| Err(Stop::Trouble(trouble, true))),
                },
                _ => self.keep(arrived)?,
            }
        }
    }

    /// Sends a command that moves the machine, and waits for its end as long as it takes. Told to abort, or that nobody waits any
    /// more, it stops the machine before it gives up; a server that says nothing meanwhile is asked whether it lives.
    pub(super) fn move_by(&mut self, command: &str, is_aborted: &dyn Fn() -> bool) -> Result<Moved, Stop> {
        self.next_tag = self.next_tag % 99_999 + 1;
        let tag = Tag::Command(self.next_tag);
        self.stream.write_all(format!("{tag} {command}\r\n").as_bytes())?;
        let (mut trouble, mut abort, mut asked): (Option<Trouble>, Option<Instant>, Option<Instant>) =
            (None, None, None);
        let is_stopped = self.is_stopped;
        loop {
            if abort.is_none() && (is_aborted() || is_stopped()) {
                // The event queue is read while a move is under way; what is_stopped says is kept for after.
                self.is_stopped = &|| false;
                self.stream.write_all(format!("{ABORT} AbortE()\r\n").as_bytes())?;
                abort = Some(Instant::now());
            }
            if abort.is_some_and(|since| since.elapsed() > ABORT_WITHIN) {
                self.is_stopped = is_stopped;
                return Err(Stop::Lost(
                    "the server does not say that it has stopped the machine; look at it".to_owned(),
                ));
            }
            let Some(arrived) = self.waiting.pop_front() else {
                // What was heard since answers it.
                asked = asked.filter(|asked| *asked > self.heard);
                if asked.is_some_and(|asked| asked.elapsed() > self.silent_after) {
                    let why = format!("no sign of life while it moves within {:?}", self.silent_after);
                    return Err(Stop::Lost(why));
                }
                if asked.is_none() && self.silence() > self.silent_after {
                    self.stream.write_all(format!("{ALIVE} GetErrStatusE()\r\n").as_bytes())?;
                    asked = Some(Instant::now());
                }
                match self.listen() {
                    // Told to stop between two looks: the machine is stopped first.
                    Err(Stop::Gone) => {}
                    heard => heard?,
                }
                continue;
            };
            match Response::parse(text(&arrived.line)) {
                Ok(response) if response.tag == tag => match response.kind {
                    ReplyKind::Error => {
                        let told = Trouble::parse(response.data());
                        trouble = trouble.or(told.severity.stops().then_some(told));
                    }
                    ReplyKind::Done => {
                        self.is_stopped = is_stopped;
                        return match (trouble, abort) {
                            (_, Some(_)) => Ok(Moved::Aborted),
                            (Some(trouble), None) => Err(Stop::Trouble(trouble, true)),
                            (None, None) => Ok(Moved::Whole),
                        };
                    }
                    ReplyKind::Ack | ReplyKind::Data => {}
                },
                Ok(response) if response.tag == ABORT || response.tag == ALIVE => {}
                // A collision, say: nobody asked, and the move is over.
                Ok(response) if response.tag.is_unsolicited() && response.kind == ReplyKind::Error => {
                    let told = Trouble::parse(response.data());
                    if told.severity.stops() && abort.is_none() {
                        return Err(Stop::Trouble(told, false));
                    }
                }
                _ => self.keep(arrived)?,
            }
        }
    }

    fn keep(&mut self, arrived: Arrived) -> Result<(), Stop> {
        if self.unasked.len() >= MOST_WAITING {
            return Err(Stop::Lost("it says more unasked than anybody can take".to_owned()));
        }
        self.unasked.push_back(arrived);
        Ok(())
    }

    /// Sends last commands, one after the other, without looking whether to stop; a server that does not answer is left.
    pub(super) fn close(&mut self, back: Option<String>, end: String) {
        self.is_stopped = &|| false;
        self.silent_after = self.silent_after.min(LAST_WAIT);
        for command in back.into_iter().chain([end]) {
            if self.ask(&command).is_err() {
                return;
            }
        }
    }

    /// Waits for what the server says unasked, for a moment.
    pub(super) fn hear(&mut self) -> Result<(), Stop> {
        self.listen()?;
        while let Some(arrived) = self.waiting.pop_front() {
            self.keep(arrived)?;
        }
        Ok(())
    }

    /// Waits for bytes, for a moment.
    fn listen(&mut self) -> Result<(), Stop> {
        if (self.is_stopped)() {
            return Err(Stop::Gone);
        }
        let mut bytes = [0; 1 << 16];
        let count = match self.stream.read(&mut bytes) {
            Ok(0) => return Err(Stop::Lost("the server ended the connection".to_owned())),
            Ok(count) => count,
            Err(error) if is_timeout(&error) || error.kind() == std::io::ErrorKind::Interrupted => return Ok(()),
            Err(error) => return Err(error.into()),
        };
        let at = SystemTime::now();
        self.heard = Instant::now();
        for piece in self.lines.take(&bytes[..count]) {
            self.count += 1;
            match piece {
                Piece::Line(line) => self.waiting.push_back(Arrived { line, at, number: self.count }),
                Piece::TooLong => return Err(Stop::Lost("a line is longer than the protocol allows".to_owned())),
            }
        }
        Ok(())
    }
}
