//! What stands between measuring software and a server, and corrects the positions that pass.
//!
//! Place in the flow: `abbe proxy` hands over lines of either side, and sends on what comes out. No clock and no socket: the same
//! lines give the same lines. Every reported position goes through [`Correct`]; what is none passes byte for byte. A position
//! that cannot be corrected becomes an error to the software. Nothing is taken for known that the server did not say.

mod commands;
mod from_server;
mod place;
mod refusal;
mod report;
mod survey;
mod targets;
mod to_server;

use crate::message::Tag;
use place::Place;
use refusal::Refusal;
use report::Report;
use std::collections::{BTreeMap, VecDeque};
use survey::{Memory, Next, Survey, Why};

pub use place::{Offsets, moves_tip};

/// What a point is corrected for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// A position that the machine took.
    Report,
    /// A search for the target from which the tip comes to a point.
    Target,
}

/// The correcting function.
pub trait Correct {
    /// The actual position of the tip (m, machine frame) for the indicated one and the tip's offset (m, ram frame); or why there
    /// is none.
    fn corrected_m(&mut self, indicated_m: [f64; 3], offset_m: [f64; 3], purpose: Purpose) -> Result<[f64; 3], String>;
}

/// How a relay works.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Settings {
    /// Where tips stand.
    pub offsets: Offsets,
    /// Whether targets are turned back, so that the tip goes where it is told.
    pub inverts_targets: bool,
    /// Whether scans come in the order that was asked for. The specification says so in one place (11.1.2) and in another that the
    /// order means nothing (6.1.3), and servers differ: where it is not known, scans are refused.
    pub scans_as_asked: bool,
    /// Whether positions that cannot be corrected pass as they came.
    pub passes_uncorrected: bool,
    /// Names of commands that are not of the protocol, and report no position.
    pub harmless: Vec<String>,
}

/// What comes out of a relay.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Out {
    /// A line for the software.
    ToClient(Vec<u8>),
    /// A line for the server.
    ToServer(Vec<u8>),
    /// Words for whoever watches.
    Say(String),
    /// Both connections have to end, for this reason.
    Close(String),
}

/// What passed so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Lines with positions that were corrected.
    pub corrected: u64,
    /// Lines with positions that were held back.
    pub refused: u64,
    /// Lines with positions that passed as they came.
    pub uncorrected: u64,
    /// Commands whose targets were turned back.
    pub targets: u64,
}

/// What is known of the machine.
#[derive(Debug, Clone, PartialEq)]
enum Known {
    /// Nothing any more.
    Stale,
    Here(Place),
    Not(Why),
}

/// What answers to a command are.
#[derive(Debug, Clone, PartialEq)]
enum Role {
    /// They pass.
    Plain,
    /// They pass; errors stand among them.
    Errors,
    /// There are none by the protocol; what may hold a position does not pass.
    Silent,
    /// Values with names.
    Named(Report),
    /// As measured points report.
    Measured,
    /// As scans report.
    Scanned,
    /// Any position among them cannot be corrected, for this reason.
    Never(String),
    SetsMeasured(Report),
    SetsScanned(Report),
    Daemon,
    StopsOne(Option<Tag>),
    StopsAll,
    Start,
    End,
    /// The tool is another one, or was turned.
    Tool {
        is_turned: bool,
    },
    Csy,
    /// Lines of the relay's own, told when it is their turn.
    Own(Vec<Vec<u8>>),
}

/// A command under way.
#[derive(Debug, Clone, PartialEq)]
struct Transaction {
    tag: Tag,
    name: String,
    role: Role,
    is_accepted: bool,
    has_failed: bool,
    /// A position of it could not be corrected; the rest is held back.
    is_refused: bool,
}

/// A report that goes on, and what was last said of it.
#[derive(Debug, Clone, PartialEq)]
struct Daemon {
    report: Report,
    last_words: String,
}

/// A relay for one connection of the software.
#[derive(Debug)]
pub struct Relay {
    settings: Settings,
    counts: Counts,
    has_session: bool,
    /// The relay told an error that the software has to clear.
    has_error: bool,
    user_enabled: bool,
    known: Known,
    memory: Memory,
    measured: Report,
    scanned: Report,
    daemons: BTreeMap<Tag, Daemon>,
    /// In the order in which they were passed on.
    pending: VecDeque<Transaction>,
    /// Commands that wait.
    held: VecDeque<Vec<u8>>,
    survey: Option<Survey>,
    /// The survey that the command waits for has ended.
    has_just_asked: bool,
    /// The server's position (mm, active system), asked for by the command that waits first.
    position: Option<Result<[f64; 3], Why>>,
    own_tag: u32,
    out: Vec<Out>,
}

/// Tags of the relay's own commands.
const OWN_TAGS: std::ops::RangeInclusive<u32> = 90_000..=99_999;

/// Commands of the software that wait at most.
const MOST_HELD: usize = 100_000;

impl Relay {
    /// A relay for a new connection.
    pub fn new(settings: Settings) -> Relay {
        Relay {
            settings,
            counts: Counts::default(),
            has_session: false,
            has_error: false,
            user_enabled: false,
            known: Known::Stale,
            memory: Memory::default(),
            measured: measured_by_default(),
            scanned: scanned_by_default(),
            daemons: BTreeMap::new(),
            pending: VecDeque::new(),
            held: VecDeque::new(),
            survey: None,
            has_just_asked: false,
            position: None,
            own_tag: *OWN_TAGS.start(),
            out: Vec::new(),
        }
    }

    /// Whether a question of its own waits for the server's answer.
    pub fn is_asking(&self) -> bool {
        self.survey.is_some()
    }

    /// What passed so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// A line of the software, with what ends it.
    pub fn from_client(&mut self, line: &[u8], correct: &mut dyn Correct) -> Vec<Out> {
        self.take_command(line, correct);
        self.go_on(correct);
        if self.held.len() > MOST_HELD {
            self.out.push(Out::Close(format!("more than {MOST_HELD} commands wait for the server")));
        }
        std::mem::take(&mut self.out)
    }

    /// A line of the server, with what ends it.
    pub fn from_server(&mut self, line: &[u8], correct: &mut dyn Correct) -> Vec<Out> {
        self.take_response(line, correct);
        self.go_on(correct);
        std::mem::take(&mut self.out)
    }

    /// The software is gone: what the server has to be told before its connection ends.
    pub fn abandon(&mut self) -> Vec<Out> {
        let away_from = self.survey.take().and_then(|survey| survey.away_from);
        let back = away_from.map(|csy| format!("{} SetCoordSystem({})\r\n", self.free_tag(), csy.name()));
        back.map(|line| Out::ToServer(line.into_bytes())).into_iter().collect()
    }

    /// Tells and asks what is due: own answers, surveys, commands that wait.
    fn go_on(&mut self, correct: &mut dyn Correct) {
        loop {
            self.tell_own();
            if self.survey.is_some() || self.pending.iter().any(|transaction| !transaction.is_accepted) {
                return;
            }
            match self.held.pop_front() {
                Some(line) => {
                    if let Some(line) = self.pass_on(line, correct) {
                        self.held.push_front(line);
                        return;
                    }
                }
                None => {
                    let is_watched = !self.daemons.is_empty() || self.user_enabled;
                    if self.known == Known::Stale && self.has_session && is_watched && self.pending.is_empty() {
                        self.begin_survey();
                    }
                    return;
                }
            }
        }
    }

    /// Tells own answers whose turn it is.
    fn tell_own(&mut self) {
        while let Some(Transaction { role: Role::Own(lines), .. }) = self.pending.front_mut() {
            let lines = std::mem::take(lines);
            self.out.extend(lines.into_iter().map(Out::ToClient));
            self.pending.pop_front();
        }
    }

    fn begin_survey(&mut self) {
        let survey = Survey::new(self.free_tag(), &self.memory);
        self.run_survey(survey);
    }

    fn ask_position(&mut self) {
        let survey = Survey::of_position(self.free_tag());
        self.run_survey(survey);
    }

    fn run_survey(&mut self, mut survey: Survey) {
        let next = survey.next(&mut self.memory, &self.settings.offsets);
        self.survey = Some(survey);
        self.follow(next);
    }

    /// Does what a survey wants next.
    fn follow(&mut self, next: Next) {
        match next {
            Next::Wait => {}
            Next::Ask(command) => {
                let tag = self.free_tag();
                if let Some(survey) = &mut self.survey {
                    survey.tag = tag;
                    self.out.push(Out::ToServer(format!("{tag} {command}\r\n").into_bytes()));
                }
            }
            Next::Found(found) => {
                let is_outdated = self.survey.take().is_some_and(|survey| survey.is_outdated);
                self.known = match found {
                    _ if is_outdated => Known::Stale,
                    Ok(place) => Known::Here(place),
                    Err(why) => {
                        self.out.push(Out::Say(format!("positions cannot be corrected: {}", why.words)));
                        Known::Not(why)
                    }
                };
            }
            Next::Position(found) => {
                self.survey = None;
                self.position = Some(found);
            }
            Next::Lost(why) => self.out.push(Out::Close(why)),
        }
    }

    /// What was known of the machine may have changed.
    fn distrust(&mut self) {
        self.known = Known::Stale;
        if let Some(survey) = &mut self.survey {
            survey.is_outdated = true;
        }
    }

    /// A tag that no command under way has.
    fn free_tag(&mut self) -> Tag {
        loop {
            self.own_tag = if OWN_TAGS.contains(&(self.own_tag + 1)) { self.own_tag + 1 } else { *OWN_TAGS.start() };
            let tag = Tag::Command(self.own_tag);
            // Far fewer are under way than there are tags: the software sends one after the other.
            let is_free = self.pending.iter().all(|transaction| transaction.tag != tag);
            if is_free || self.pending.len() >= OWN_TAGS.count() {
                return tag;
            }
        }
    }

    /// Why points cannot be corrected now; `None` where they can.
    fn why_not(&self) -> Option<String> {
        match &self.known {
            Known::Here(_) => None,
            Known::Stale => {
                Some("coordinate system and tool of the machine were changed and are not known yet".to_owned())
            }
            Known::Not(why) => Some(why.words.clone()),
        }
    }

    /// Tells an error to the software.
    fn refuse(&mut self, refusal: Refusal, tag: Tag, method: &str, words: &str) {
        self.has_error |= refusal.stops();
        self.out.push(Out::ToClient(refusal.line(tag, method, words)));
        self.out.push(Out::Say(format!("{tag} {method}: not corrected, and refused: {words}")));
    }
}

fn measured_by_default() -> Report {
    Report::of_names(&["X", "Y", "Z"])
}

fn scanned_by_default() -> Report {
    Report::of_names(&["X", "Y", "Z", "Q"])
}
