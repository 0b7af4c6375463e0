//! The driver's thread: connects, keeps a session with the server, and answers each class of its errors.
//!
//! Place in the flow: [`super::Ippdme`] takes what comes out of a queue. A connection that is lost is made again, after 0.1 s and
//! then twice as long each time, 5 s at most. Errors that the driver's own commands cause are cleared by it; what somebody at
//! the machine has to mend is told, and the server asked each second whether it is mended; it is not cleared from here.

use super::client::{Arrived, Client, Stop};
use super::mover::Obeying;
use super::{IppdmeConfig, IppdmeReads};
use crate::connecting::{Waits, connect};
use crate::units::Unit;
use abbe_ippdme::csy::Csy;
use abbe_ippdme::item::{Item, What};
use abbe_ippdme::line::text;
use abbe_ippdme::message::{ReplyKind, Response, Tag};
use abbe_ippdme::relay::{Offsets, moves_tip};
use abbe_ippdme::trouble::{Severity, Trouble};
use abbe_runtime::realtime::carry_samples;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant, SystemTime};

/// Positions that wait for the node's loop at most.
const QUEUE: usize = 4096;
/// Tag of the report on moves.
const MOVES: Tag = Tag::Event(1);
/// How often a server with an error is asked whether it is mended.
const ASK_AGAIN: Duration = Duration::from_secs(1);
/// Shortest wait between two looks whether to stop.
const LOOK_UP: Duration = Duration::from_millis(20);

/// A position of the tip.
#[derive(Debug, Clone)]
pub(super) struct Position {
    pub(super) arrived: SystemTime,
    pub(super) line: u64,
    pub(super) tip_m: [f64; 3],
    pub(super) offset_m: [f64; 3],
    /// Name, value, age (s).
    pub(super) covariates: Vec<(String, f64, f64)>,
}

/// What happens.
#[derive(Debug)]
pub(super) enum Event {
    Connected(String),
    Position(Position),
    /// A line that should have been a position: its number and what is wrong.
    Refused(u64, String),
    /// Something that somebody should know.
    Told(String),
    /// No readings come until it is mended; said each time.
    Lost(String),
}

/// The loop's end of the thread.
pub(super) struct Session {
    events: Receiver<Event>,
    is_stopped: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Session {
    pub(super) fn open(config: &IppdmeConfig, offsets: Offsets, obeying: Obeying) -> std::io::Result<Session> {
        let (give, events) = sync_channel(QUEUE);
        let is_stopped = Arc::new(AtomicBool::new(false));
        let mut talk = Talk::new(config.clone(), offsets, obeying, give, Arc::clone(&is_stopped));
        let thread = thread::Builder::new().name("ippdme".into()).spawn(move || {
            let _realtime = carry_samples();
            talk.run();
        })?;
        Ok(Session { events, is_stopped, thread: Some(thread) })
    }

    /// The next event, within this time.
    pub(super) fn next(&mut self, within: Duration) -> Option<Event> {
        match self.events.recv_timeout(within) {
            Ok(event) => Some(event),
            Err(RecvTimeoutError::Timeout) => None,
            // The thread ends with the loop, and not before.
            Err(RecvTimeoutError::Disconnected) => {
                thread::sleep(within);
                None
            }
        }
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.is_stopped.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // It ends the session with the server first.
            let _ = thread.join();
        }
    }
}

/// What is known of the tool: its offset (m), or why not.
pub(super) type Tool = Result<[f64; 3], String>;

/// The thread.
pub(super) struct Talk {
    config: IppdmeConfig,
    offsets: Offsets,
    give: SyncSender<Event>,
    is_stopped: Arc<AtomicBool>,
    last_words: String,
    pub(super) tool: Tool,
    /// The server has changed it.
    pub(super) is_tool_new: bool,
    /// Its name, as the server told it last.
    named: Option<String>,
    /// It was turned since it was put into use.
    is_turned: bool,
    covariates: Vec<(String, f64, Instant)>,
    asked: Instant,
    /// The coordinate system that was selected before.
    before: Option<String>,
    /// Orders to move.
    pub(super) obeying: Obeying,
}

impl Talk {
    fn new(
        config: IppdmeConfig,
        offsets: Offsets,
        obeying: Obeying,
        give: SyncSender<Event>,
        is_stopped: Arc<AtomicBool>,
    ) -> Talk {
        let (tool, asked) = (unknown_tool(), Instant::now());
        let (last_words, covariates) = (String::new(), Vec::new());
        Talk {
            config,
            offsets,
            give,
            is_stopped,
            last_words,
            tool,
            is_tool_new: false,
            named: None,
            is_turned: false,
            covariates,
            asked,
            before: None,
            obeying,
        }
    }

    fn run(&mut self) {
        let mut waits = Waits::new();
        let is_stopped = Arc::clone(&self.is_stopped);
        let is_stopped = || is_stopped.load(Ordering::Relaxed);
        while !is_stopped() {
            let outcome = connect(&self.config.server).map_err(Stop::from).and_then(|stream| {
                let silent_after = Duration::from_secs_f64(self.config.silent_after_s);
                let mut client = Client::new(stream, silent_after, &is_stopped)?;
                self.keep_session(&mut client, &mut waits)
            });
            match outcome {
                Err(Stop::Lost(why)) => self.lose(format!("{why}; it is tried again")),
                Err(Stop::Trouble(trouble, _)) => self.lose(format!("{trouble}; it is tried again")),
                Ok(()) | Err(Stop::Gone) => return,
            }
            self.sleep(waits.next());
        }
    }

    /// Sessions on one connection, one after the other, until it is lost.
    fn keep_session(&mut self, client: &mut Client, waits: &mut Waits) -> Result<(), Stop> {
        loop {
            let outcome = self.begin(client).and_then(|()| {
                waits.begin_again();
                self.last_words.clear();
                self.read(client)
            });
            self.tool = unknown_tool();
            match outcome {
                Err(Stop::Trouble(trouble, is_own)) if trouble.severity < Severity::Fatal => {
                    self.lose(trouble.to_string());
                    match self.mend(client, &trouble, is_own) {
                        Err(Stop::Gone) => {
                            self.end(client);
                            return Ok(());
                        }
                        mended => mended?,
                    }
                    self.sleep(waits.next());
                }
                Err(Stop::Gone) => {
                    self.end(client);
                    return Ok(());
                }
                other => return other,
            }
        }
    }

    /// Opens a session and learns what readings need.
    fn begin(&mut self, client: &mut Client) -> Result<(), Stop> {
        // A session that was left open is ended first; where there is none, nothing happens.
        client.ask("EndSession()")?;
        client.ask("StartSession()")?;
        // What came before is of the session before, errors and positions alike.
        client.unasked.clear();
        self.obeying.session += 1;
        let before = first_word(&client.ask("GetCoordSystem()")?);
        client.ask(&format!("SetCoordSystem({})", Csy::Machine.name()))?;
        check_system(client)?;
        if before.as_deref() != Some(Csy::Machine.name()) {
            self.before = before.or(self.before.take());
        }
        self.ask_tool_and_covariates(client)?;
        match self.config.reads {
            IppdmeReads::Moves => {
                let IppdmeConfig { every_s, every_mm, .. } = self.config;
                let command = format!("OnMoveReportE(Time({every_s}), Dis({every_mm}), X(), Y(), Z())");
                // Reports may come before the command is complete.
                let reports = client.exchange(MOVES, &command)?;
                self.take_answers(client, &reports)?;
            }
            IppdmeReads::Points => {
                client.ask("OnPtMeasReport(X(), Y(), Z())")?;
                let enabled = client.ask("IsUserEnabled()")?;
                if !items_of(&enabled)
                    .iter()
                    .any(|item| item.number_of("IsUserEnabled").is_some_and(|(is, _)| is == 1.0))
                {
                    self.tell(
                        "the operator may not move the machine, so that no points come; enable the user at the server"
                            .to_owned(),
                    );
                }
            }
            IppdmeReads::Polled => {}
        }
        let words = format!("session begun, {} selected", Csy::Machine.name());
        self.give(Event::Connected(words))
    }

    /// Gives positions until something stops it.
    fn read(&mut self, client: &mut Client) -> Result<(), Stop> {
        let every = Duration::from_secs_f64(self.config.every_s);
        let silent_after = Duration::from_secs_f64(self.config.silent_after_s);
        let mut due = Instant::now();
        loop {
            if self.config.reads == IppdmeReads::Polled && Instant::now() >= due {
                // What was missed is not made up for.
                due = (due + every).max(Instant::now());
                let answer = client.ask("Get(X(), Y(), Z())")?;
                if answer.is_empty() {
                    let problem = "the server answered Get without a position".to_owned();
                    self.give(Event::Refused(client.lines(), problem))?;
                }
                self.take_answers(client, &answer)?;
            }
            if self.config.reads != IppdmeReads::Polled || Instant::now() < due {
                client.hear()?;
            }
            self.take_before(client, u64::MAX)?;
            let is_due = self.asked.elapsed().as_secs_f64() >= self.config.covariates_every_s;
            if is_due || self.is_tool_new || self.tool.is_err() && self.asked.elapsed() >= ASK_AGAIN {
                self.ask_tool_and_covariates(client)?;
                check_system(client)?;
            }
            self.obey(client)?;
            if client.silence() > silent_after {
                client.ask("GetErrStatusE()")?;
            }
        }
    }

    /// Takes positions that were asked for, each after what the server said before it: a tool that was changed meanwhile.
    fn take_answers(&mut self, client: &mut Client, answers: &[Arrived]) -> Result<(), Stop> {
        for arrived in answers {
            self.take_before(client, arrived.number)?;
            self.take_position(arrived, false)?;
        }
        Ok(())
    }

    /// Takes what the server said unasked before the line of this number.
    pub(super) fn take_before(&mut self, client: &mut Client, number: u64) -> Result<(), Stop> {
        while let Some(arrived) = client.unasked.pop_front_if(|arrived| arrived.number < number) {
            self.take_unasked(&arrived)?;
        }
        Ok(())
    }

    fn take_unasked(&mut self, arrived: &Arrived) -> Result<(), Stop> {
        let Ok(response) = Response::parse(text(&arrived.line)) else {
            return self.give(Event::Refused(arrived.number, "it is no line of the protocol".to_owned()));
        };
        match response.kind {
            ReplyKind::Error => {
                let trouble = Trouble::parse(response.data());
                if trouble.severity.stops() {
                    return Err(Stop::Trouble(trouble, false));
                }
                self.tell(trouble.to_string());
                Ok(())
            }
            ReplyKind::Data if response.tag == MOVES && self.config.reads == IppdmeReads::Moves => {
                self.take_position(arrived, false)
            }
            ReplyKind::Data if response.tag.is_unsolicited() => {
                let items = response.items().unwrap_or_default();
                match items.first().and_then(Item::call) {
                    // Properties are set unasked where somebody turns the head at the panel.
                    Some((name @ ("ChangeTool" | "SetProp"), values)) => {
                        (self.tool, self.is_tool_new) = (unknown_tool(), true);
                        self.is_turned = name == "SetProp" && (self.is_turned || moves_tip(values));
                        Ok(())
                    }
                    Some(("PtMeas", _)) if self.config.reads == IppdmeReads::Points => {
                        self.take_position(arrived, true)
                    }
                    _ => Ok(()),
                }
            }
            // Answers to what was given up on are no positions of now.
            _ => Ok(()),
        }
    }

    /// Gives the position in a line, or says why there is none.
    fn take_position(&mut self, arrived: &Arrived, is_inside: bool) -> Result<(), Stop> {
        let event = match self.position(arrived, is_inside) {
            Ok(position) => Event::Position(position),
            Err(problem) => Event::Refused(arrived.number, problem),
        };
        self.give(event)
    }

    fn position(&self, arrived: &Arrived, is_inside: bool) -> Result<Position, String> {
        let response = Response::parse(text(&arrived.line)).map_err(|problem| problem.to_string())?;
        let items = response.items().map_err(|problem| problem.to_string())?;
        let values = match (items.as_slice(), is_inside) {
            ([Item { what: What::Call(_, inner), .. }], true) => inner.as_slice(),
            (all, _) => all,
        };
        let axis = |name: &str| {
            let mut found = values.iter().filter_map(|item| Some(item.number_of(name)?.0));
            match (found.next(), found.next()) {
                (Some(mm), None) => Ok(mm / 1e3),
                _ => Err(format!("it does not give {name} once, as a number")),
            }
        };
        let (tip_m, offset_m) = ([axis("X")?, axis("Y")?, axis("Z")?], self.tool.clone()?);
        let age_s = |asked: &Instant| asked.elapsed().as_secs_f64();
        let covariates =
            self.covariates.iter().map(|(name, value, asked)| (name.clone(), *value, age_s(asked))).collect();
        Ok(Position { arrived: arrived.at, line: arrived.number, tip_m, offset_m, covariates })
    }

    pub(super) fn ask_tool_and_covariates(&mut self, client: &mut Client) -> Result<(), Stop> {
        (self.asked, self.is_tool_new) = (Instant::now(), false);
        let name = self.optional(client, "GetProp(Tool.Name())")?.and_then(|data| first_word(&data));
        if name.is_some() && name != self.named {
            // Another tool that nobody told of.
            self.tool = unknown_tool();
            self.is_turned &= self.named.is_none();
            self.named.clone_from(&name);
        }
        let refused = self.offsets.refused(name.as_deref(), self.is_turned);
        let known = self.offsets.of(name.as_deref());
        let told = match (&refused, known) {
            (None, None) if self.offsets.from_server => self.optional(client, "GetProp(Tool.AvrOffsets())")?,
            _ => None,
        };
        let told = told.and_then(|data| numbers(&data)).and_then(|mm| <[f64; 3]>::try_from(mm).ok());
        let tool = name.as_deref().unwrap_or("without a name");
        let offset_m = known.or(told.map(|mm| mm.map(|mm| mm / 1e3))).ok_or_else(|| {
            format!("the offset of tool {tool} is not known; give it in tools_mm or offset_mm of the launch file")
        });
        // One that was changed between two answers is asked for again.
        if !self.is_tool_new {
            self.tool = refused.map_or(offset_m, Err);
        }
        let mut covariates = Vec::new();
        for (covariate, property) in self.config.covariates.clone() {
            let asked = Instant::now();
            let data = self.optional(client, &format!("GetProp({property}())"))?;
            match data.and_then(|data| numbers(&data)).as_deref() {
                Some([value]) => {
                    let value = Unit::of(&covariate).map(|unit| (unit.convert(*value), unit.name));
                    covariates.extend(value.ok().map(|(value, name)| (name, value, asked)));
                }
                // Left out: the reading has no such covariate.
                _ => self.tell(format!("{property} is no number at this server; covariate {covariate} is missing")),
            }
        }
        self.covariates = covariates;
        Ok(())
    }

    /// The answer to a question that a server may refuse.
    fn optional(&mut self, client: &mut Client, command: &str) -> Result<Option<Vec<Arrived>>, Stop> {
        match client.ask(command) {
            Ok(data) => {
                self.take_before(client, data.first().map_or(u64::MAX, |first| first.number))?;
                Ok(Some(data))
            }
            Err(Stop::Trouble(trouble, true)) if trouble.severity < Severity::Fatal => {
                client.ask("ClearAllErrors()")?;
                Ok(None)
            }
            Err(stop) => Err(stop),
        }
    }

    /// Does what an error asks for.
    fn mend(&mut self, client: &mut Client, trouble: &Trouble, is_own: bool) -> Result<(), Stop> {
        if is_own || trouble.severity == Severity::Error {
            return client.ask("ClearAllErrors()").map(drop);
        }
        loop {
            let status = client.ask("GetErrStatusE()")?;
            if items_of(&status).iter().any(|item| item.number_of("ErrStatus").is_some_and(|(is, _)| is == 0.0)) {
                return Ok(());
            }
            client.unasked.clear();
            self.sleep(ASK_AGAIN);
        }
    }

    /// Leaves the server as it was found, as far as it still listens.
    fn end(&mut self, client: &mut Client) {
        client.close(self.before.take().map(|csy| format!("SetCoordSystem({csy})")), "EndSession()".to_owned());
    }

    fn give(&self, event: Event) -> Result<(), Stop> {
        let mut event = event;
        loop {
            match self.give.try_send(event) {
                Ok(()) => return Ok(()),
                Err(TrySendError::Disconnected(_)) => return Err(Stop::Gone),
                Err(TrySendError::Full(back)) => {
                    if self.is_stopped.load(Ordering::Relaxed) {
                        return Err(Stop::Gone);
                    }
                    event = back;
                    thread::sleep(LOOK_UP);
                }
            }
        }
    }

    fn lose(&mut self, words: String) {
        let _ = self.give(Event::Lost(words.clone()));
        self.tell(words);
    }

    /// Says something once: the same words again and again would fill the log.
    fn tell(&mut self, words: String) {
        if words != self.last_words {
            // Who does not listen any more is found out with the next position.
            let _ = self.give(Event::Told(words.clone()));
            self.last_words = words;
        }
    }

    fn sleep(&self, wait: Duration) {
        let until = Instant::now() + wait;
        while Instant::now() < until && !self.is_stopped.load(Ordering::Relaxed) {
            thread::sleep(LOOK_UP.min(until.saturating_duration_since(Instant::now())));
        }
    }
}

/// Makes sure that positions are those of the machine: a server that takes the command need not follow it, and a panel may select
/// another system meanwhile.
fn check_system(client: &mut Client) -> Result<(), Stop> {
    let wanted = Csy::Machine.name();
    match first_word(&client.ask("GetCoordSystem()")?) {
        Some(active) if active == wanted => Ok(()),
        Some(active) => Err(Stop::Lost(format!(
            "its coordinate system is {active}, and {wanted} was selected; select it at the server"
        ))),
        None => Err(Stop::Lost(format!(
            "it does not tell its coordinate system, so that nobody knows whether its positions are those of {wanted}"
        ))),
    }
}

fn unknown_tool() -> Tool {
    Err("which tool is in the machine is not known yet".to_owned())
}

/// All parts of the answers.
pub(super) fn items_of(data: &[Arrived]) -> Vec<Item> {
    let responses = data.iter().filter_map(|arrived| Response::parse(text(&arrived.line)).ok());
    responses.filter_map(|response| response.items().ok()).flatten().collect()
}

/// The arguments of the calls in the answers.
fn arguments(data: &[Arrived]) -> Vec<Item> {
    let inner = |item: Item| match item.what {
        What::Call(_, arguments) => arguments,
        _ => vec![item],
    };
    items_of(data).into_iter().flat_map(inner).collect()
}

fn first_word(data: &[Arrived]) -> Option<String> {
    arguments(data).iter().find_map(Item::text).map(str::to_owned)
}

pub(super) fn numbers(data: &[Arrived]) -> Option<Vec<f64>> {
    arguments(data).iter().map(Item::number).collect()
}
