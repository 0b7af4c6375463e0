//! Drivers on threads of their own, and the loop that captures what they give.
//!
//! Place in the flow: `abbe capture` calls [`capture`]. Each driver waits on its own thread, so that none delays another; all
//! that comes goes through one queue in its order. What is told goes into the journal first, and is shown then. A driver that
//! loses its connection makes it again by itself; the loop says so, and goes on.

use super::campaign::campaign_of;
use super::config::CaptureConfig;
use super::drive::{Driving, Step};
use super::fit::{Fitter, SoFar, Volume};
use super::planned::Planned;
use super::step::{Capturer, Told};
use crate::connecting::stamp_of;
use crate::driver::{DriverError, Mover, open_scale, open_sensor, open_tracer};
use crate::launch::Launch;
use crate::link::{Link, LinkState};
use crate::node::{NodeError, gateway_command, user_identity};
use crate::step::SensorMemory;
use crate::way::Way;
use abbe_files::{CaptureJournal, FileError, MachineFile};
use abbe_msgs::{ScaleReading, TracerReading};
use abbe_runtime::Shutdown;
use abbe_runtime::gateway::{GatewayNode, GatewayOptions};
use abbe_runtime::ros::{Domain, Enclave, NodeOptions, ParameterTable, RosError, StaticPeers};
use std::num::NonZeroUsize;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::Builder;
use std::time::{Duration, Instant, SystemTime};
use thiserror::Error;

/// Readings that wait for the loop at most; a driver that gives more waits itself.
const QUEUE: usize = 8192;
/// How often the loop looks at links, fits and requests while nothing comes.
const LOOK_UP: Duration = Duration::from_millis(50);
/// Refused lines of a driver that are told one by one.
const TOLD_ONE_BY_ONE: u64 = 5;

/// Name in the ROS 2 graph.
const NODE: &str = "abbe_capture";
/// Messages of a topic that wait at most.
const DEPTH: NonZeroUsize = NonZeroUsize::MIN.saturating_add(4095);

/// What a driver's thread gives.
enum Given {
    /// A reading, and whether nobody saw how the machine came there.
    Scale(Box<ScaleReading>, bool),
    Tracer(Box<TracerReading>),
    /// Something that is no reading, by the driver's name.
    Refused(&'static str, String),
    /// A driver cannot go on.
    Ended(&'static str, String),
}

/// What the loop shows.
#[derive(Debug)]
pub enum Shown<'a> {
    /// Of a reading.
    Told(&'a Told),
    /// Of a connection or a driver.
    Link(String),
    /// The campaign so far, or why it cannot be identified yet.
    SoFar(&'a Result<SoFar, String>),
}

/// Why a capture cannot go on. What is captured is in the journal.
#[derive(Debug, Error)]
pub enum CaptureError {
    /// A driver cannot be opened.
    #[error("{driver}: {source}")]
    Driver {
        /// Which.
        driver: &'static str,
        /// Why.
        source: Box<DriverError>,
    },
    /// A driver gave up.
    #[error("the driver of the {driver} gave up: {why}; what is captured is kept: mend it and start the capture again")]
    Ended {
        /// Which.
        driver: &'static str,
        /// Why.
        why: String,
    },
    /// A machine that was to be moved.
    #[error("the machine was stopped: {0}; what is captured is kept: look at the machine, and start the capture again")]
    Moved(String),
    /// Somebody has to say that the machine may move.
    #[error("standard input has ended, so that nobody can say that the machine may move; start it from a terminal")]
    NobodySays,
    /// Drivers read topics of ROS 2, and its graph cannot be joined.
    #[error("ROS 2: {0}")]
    Ros(Box<NodeError>),
    /// The journal cannot be written.
    #[error("{0}; what was captured before is kept: make room, and start the capture again")]
    Journal(#[from] FileError),
    /// A thread cannot be started.
    #[error("a thread cannot be started: {0}; let this user start more")]
    Thread(std::io::Error),
}

/// How a capture ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// All points are captured.
    Complete,
    /// Somebody asked for it.
    Stopped,
}

/// Captures until all points are there, or it is told to stop.
///
/// `confirmed` gives a value each time somebody says that the next set-up stands, and where the machine is driven, that it may
/// move: the instant at which that was said, since what was said before it was asked is no answer.
///
/// # Errors
/// A driver that cannot be opened or gives up, a journal that cannot be written.
pub fn capture(
    (config, base, machine): (&CaptureConfig, &Path, &MachineFile),
    capturer: &mut Capturer,
    journal: &mut CaptureJournal,
    (shutdown, confirmed): (&Shutdown, &Receiver<Instant>),
    show: &mut dyn FnMut(&Capturer, Shown),
) -> Result<Ending, CaptureError> {
    let own = Shutdown::manual();
    let (give, given) = sync_channel(QUEUE);
    let (links, mover) = open((config, base, machine), &own, &give)?;
    let wheel =
        config.drive.zip(mover).map(|(drive, mover)| Wheel::new(Driving::new(config, &drive, &machine.machine), mover));
    let fitter = Fitter::start(machine.clone(), volume_of(capturer.planned())).map_err(CaptureError::Thread)?;
    let mut running = Running {
        config,
        machine,
        capturer,
        journal,
        shutdown,
        show,
        links,
        wheel,
        fitter,
        given,
        confirmed,
        refused: [0; 3],
        has_news: false,
    };
    let outcome = running.run();
    own.request();
    outcome
}

/// A capture on its way.
struct Running<'a> {
    config: &'a CaptureConfig,
    machine: &'a MachineFile,
    capturer: &'a mut Capturer,
    journal: &'a mut CaptureJournal,
    shutdown: &'a Shutdown,
    show: &'a mut dyn FnMut(&Capturer, Shown),
    links: Vec<Watched>,
    /// Where the machine is driven.
    wheel: Option<Wheel>,
    fitter: Fitter,
    given: Receiver<Given>,
    confirmed: &'a Receiver<Instant>,
    /// Lines of scale, tracer and sensors that were no readings.
    refused: [u64; 3],
    /// A line is done that no fit knows yet.
    has_news: bool,
}

impl Running<'_> {
    fn run(&mut self) -> Result<Ending, CaptureError> {
        self.fit();
        loop {
            if self.shutdown.requested() && self.may_end() {
                return Ok(Ending::Stopped);
            }
            if let Some(wheel) = &mut self.wheel {
                wheel.turn(self.shutdown, self.capturer, self.show)?;
            }
            for words in self.links.iter_mut().filter_map(Watched::news) {
                (self.show)(self.capturer, Shown::Link(words));
            }
            self.hear_of_fits();
            // What was captured is written before anything else can end the capture.
            let told = self.hear_of_drivers()?;
            if self.keep(&told)? {
                return Ok(Ending::Complete);
            }
            if self.has_confirmation()? {
                let told = self.confirm();
                if self.keep(&told)? {
                    return Ok(Ending::Complete);
                }
                self.drive_on()?;
            }
        }
    }

    fn may_end(&mut self) -> bool {
        self.wheel.as_mut().is_none_or(|wheel| wheel.may_end(self.shutdown, self.capturer, self.show))
    }

    /// Asks for a fit of all that is there.
    fn fit(&mut self) {
        let (planned, taken) = (self.capturer.planned(), self.capturer.taken());
        self.fitter.fit(campaign_of(planned, taken, self.machine.absolute_range).campaign);
    }

    fn hear_of_fits(&mut self) {
        if let Some(found) = self.fitter.found() {
            (self.show)(self.capturer, Shown::SoFar(&found));
            if let Ok(SoFar { model, .. }) = found {
                self.capturer.learn(model);
            }
        }
        if self.has_news && self.fitter.is_idle() {
            self.fit();
            self.has_news = false;
        }
    }

    /// Waits a moment for what a driver gives.
    fn hear_of_drivers(&mut self) -> Result<Vec<Told>, CaptureError> {
        Ok(match self.given.recv_timeout(LOOK_UP) {
            Ok(Given::Scale(reading, is_way_broken)) => {
                if is_way_broken {
                    self.capturer.forget_motion();
                }
                self.capturer.scale(*reading)
            }
            Ok(Given::Tracer(reading)) => self.capturer.tracer(&reading),
            Ok(Given::Refused(driver, why)) => {
                let show = |words| (self.show)(self.capturer, Shown::Link(words));
                note_refused(driver, why, &mut self.refused, show);
                Vec::new()
            }
            Ok(Given::Ended(driver, why)) => return Err(CaptureError::Ended { driver, why }),
            Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => Vec::new(),
        })
    }

    /// Whether somebody says that the next set-up stands, or that the machine may move.
    fn has_confirmation(&mut self) -> Result<bool, CaptureError> {
        let said = self.confirmed.try_recv();
        match &self.wheel {
            Some(wheel) => wheel.is_confirmed(&said),
            None => Ok(said.is_ok()),
        }
    }

    /// What follows for the readings.
    fn confirm(&mut self) -> Vec<Told> {
        // A driven set-up that the drivers do not tell begins with its first move.
        let is_told = self.config.tells_station() && self.config.tells_offset();
        let begins = |wheel: &Wheel| !is_told && wheel.driving.set_up() > self.capturer.set_up();
        let is_next = self.wheel.as_ref().is_none_or(begins);
        match stamp_of(SystemTime::now()) {
            Ok(stamp) if is_next => self.capturer.confirm(stamp),
            _ => Vec::new(),
        }
    }

    /// The moves that were waited for.
    fn drive_on(&mut self) -> Result<(), CaptureError> {
        let Some(wheel) = &mut self.wheel else { return Ok(()) };
        let steps = wheel.driving.confirm();
        wheel.take(steps, self.capturer, self.show)
    }

    /// Writes what is told into the journal, and shows it then; whether all is captured.
    fn keep(&mut self, told: &[Told]) -> Result<bool, CaptureError> {
        for one in told {
            if let Told::Entry(entry) = one {
                self.journal.append(entry)?;
            }
        }
        for one in told {
            (self.show)(self.capturer, Shown::Told(one));
            self.has_news |= matches!(one, Told::LineDone(_));
            if *one == Told::AllDone {
                return Ok(true);
            }
        }
        Ok(false)
    }
}

/// The hands on the machine.
struct Wheel {
    driving: Driving,
    mover: Mover,
    since: Instant,
    has_begun: bool,
    /// When somebody was asked last.
    asked: Instant,
    /// The end of a move is waited for, and that was said.
    is_ending: bool,
    is_aborting: bool,
}

impl Wheel {
    fn new(driving: Driving, mover: Mover) -> Wheel {
        let now = Instant::now();
        Wheel { driving, mover, since: now, has_begun: false, asked: now, is_ending: false, is_aborting: false }
    }

    /// Whether nothing is under way; between moves it ends at once, in the middle of one when asked a second time.
    fn may_end(&mut self, shutdown: &Shutdown, capturer: &Capturer, show: &mut dyn FnMut(&Capturer, Shown)) -> bool {
        if !self.driving.is_under_way() {
            return true;
        }
        if shutdown.is_urgent() && !std::mem::replace(&mut self.is_aborting, true) {
            show(capturer, Shown::Link("the move is aborted".to_owned()));
            self.mover.abort();
        } else if !std::mem::replace(&mut self.is_ending, true) {
            let words = "stopping when this move has ended; Ctrl-C again aborts it";
            show(capturer, Shown::Link(words.to_owned()));
        }
        false
    }

    /// Takes what became of orders, and looks at the clock.
    fn turn(
        &mut self,
        shutdown: &Shutdown,
        capturer: &Capturer,
        show: &mut dyn FnMut(&Capturer, Shown),
    ) -> Result<(), CaptureError> {
        let now_s = self.since.elapsed().as_secs_f64();
        let mut steps = match std::mem::replace(&mut self.has_begun, true) {
            false => self.driving.begin(capturer),
            true => Vec::new(),
        };
        if self.driving.is_under_way()
            && let Some(outcome) = self.mover.outcome()
        {
            steps.extend(self.driving.outcome(outcome, capturer, now_s));
        }
        steps.extend(self.driving.look(capturer, now_s));
        if shutdown.requested() {
            // No further move is begun.
            let is_order = |step: &Step| matches!(step, Step::Order(_));
            if steps.iter().any(is_order) {
                self.driving.halt();
            }
            steps.retain(|step| !is_order(step));
        }
        self.take(steps, capturer, show)
    }

    fn take(
        &mut self,
        steps: Vec<Step>,
        capturer: &Capturer,
        show: &mut dyn FnMut(&Capturer, Shown),
    ) -> Result<(), CaptureError> {
        for step in steps {
            match step {
                Step::Order(order) => {
                    if !self.mover.order(order) {
                        return Err(CaptureError::Moved("the driver takes no order".to_owned()));
                    }
                }
                Step::Say(words) => {
                    self.asked = Instant::now();
                    show(capturer, Shown::Link(words));
                }
                Step::Stop(why) if self.is_aborting => {
                    self.driving.halt();
                    show(capturer, Shown::Link(why));
                }
                Step::Stop(why) => return Err(CaptureError::Moved(why)),
            }
        }
        Ok(())
    }

    /// Whether somebody has answered what is asked; what was said before is no answer.
    fn is_confirmed(&self, said: &Result<Instant, TryRecvError>) -> Result<bool, CaptureError> {
        match said {
            Ok(at) => Ok(self.driving.is_asking() && *at > self.asked),
            Err(TryRecvError::Disconnected) if self.driving.is_asking() => Err(CaptureError::NobodySays),
            Err(_) => Ok(false),
        }
    }
}

/// The volume and the offsets of a plan.
pub fn volume_of(planned: &Planned) -> Volume {
    let mut volume = Volume { reading_m: [(f64::INFINITY, f64::NEG_INFINITY); 3], offsets_m: Vec::new() };
    for point in 0..planned.len() {
        for (d, at_m) in planned.reading_m(point).into_iter().enumerate() {
            let (low_m, high_m) = volume.reading_m[d];
            volume.reading_m[d] = (low_m.min(at_m), high_m.max(at_m));
        }
    }
    for line in &planned.lines {
        if !volume.offsets_m.contains(&line.offset_m) {
            volume.offsets_m.push(line.offset_m);
        }
    }
    volume
}

fn note_refused(driver: &'static str, why: String, refused: &mut [u64; 3], show: impl FnOnce(String)) {
    let place = match driver {
        SCALE => 0,
        TRACER => 1,
        _ => 2,
    };
    refused[place] += 1;
    match refused[place] {
        count if count <= TOLD_ONE_BY_ONE => show(format!("{driver}: {why}")),
        count if count.is_power_of_two() => {
            show(format!("{driver}: {count} lines so far were no readings; the last: {why}"))
        }
        _ => {}
    }
}

const SCALE: &str = "scale";
const TRACER: &str = "tracer";
const SENSOR: &str = "covariates";

/// Opens all drivers, each on a thread; how they stand, and what moves the machine.
fn open(
    (config, base, machine): (&CaptureConfig, &Path, &MachineFile),
    shutdown: &Shutdown,
    give: &SyncSender<Given>,
) -> Result<(Vec<Watched>, Option<Mover>), CaptureError> {
    let (scale, tracer) = config.drivers();
    // Drivers hold it as long as they read.
    let ros = config.is_in_ros_graph().then(|| join_ros(machine)).transpose()?;
    let failed = |driver| move |source| CaptureError::Driver { driver, source: Box::new(source) };
    let mut scale = open_scale(&scale, base, machine, shutdown, ros.as_ref()).map_err(failed(SCALE))?;
    let mover = scale.mover();
    let mut tracer = open_tracer(&tracer, base, machine, shutdown, ros.as_ref()).map_err(failed(TRACER))?;
    let mut links: Vec<Watched> = [(SCALE, scale.link()), (TRACER, tracer.link())]
        .into_iter()
        .filter_map(|(name, link)| Some(Watched::new(name, link?)))
        .collect();
    let memory = Arc::new(Mutex::new(SensorMemory::default()));
    for (place, config) in config.covariates.iter().enumerate() {
        let mut sensor = open_sensor(config, base, machine, shutdown, ros.as_ref()).map_err(failed(SENSOR))?;
        links.extend(sensor.link().map(|link| Watched::new(SENSOR, link)));
        let note = {
            let memory = Arc::clone(&memory);
            move |said: crate::driver::SensorValues| {
                let mut memory = memory.lock().unwrap_or_else(PoisonError::into_inner);
                said.missing.iter().for_each(|name| memory.forget(name));
                memory.note(place, said.stamp, &said.values);
                None
            }
        };
        listen(SENSOR, move || sensor.next_values(), note, give.clone())?;
    }
    let mut way = Way::new(scale.link());
    let refused = Arc::new(AtomicU64::new(0));
    let refused_so_far = Arc::clone(&refused);
    let next_scale = move || {
        let next = scale.next_reading();
        if next.as_ref().is_err_and(DriverError::is_of_one_reading) {
            refused.fetch_add(1, Ordering::Relaxed);
        }
        next
    };
    let join = move |mut reading: ScaleReading| {
        let is_way_broken = way.is_broken_before(&reading, refused_so_far.load(Ordering::Relaxed));
        // What has no room is told by the nodes that run live; a capture keeps the first ones.
        drop(memory.lock().unwrap_or_else(PoisonError::into_inner).join(&mut reading));
        Some(Given::Scale(Box::new(reading), is_way_broken))
    };
    listen(SCALE, next_scale, join, give.clone())?;
    listen(TRACER, move || tracer.next_reading(), |reading| Some(Given::Tracer(Box::new(reading))), give.clone())?;
    Ok((links, mover))
}

/// A place in the ROS 2 graph for drivers that read topics.
fn join_ros(machine: &MachineFile) -> Result<GatewayNode, CaptureError> {
    let start = || -> Result<GatewayNode, NodeError> {
        let identity = user_identity("", NODE)?;
        let command = gateway_command(&identity, None, false)?;
        let domain = Domain::from_environment().map_err(RosError::from)?;
        let enclave = Enclave::from_environment(None).map_err(RosError::from)?;
        let peers = StaticPeers::from_environment(domain.range).map_err(RosError::from)?;
        let (remaps, parameters) = (Vec::new(), ParameterTable::default());
        let node = NodeOptions { identity, domain, remaps, parameters, enclave, peers };
        Ok(GatewayNode::start(GatewayOptions {
            on_change: None,
            rosout: true,
            node,
            run: None,
            depth: DEPTH,
            memory_limit_bytes: Launch::GATEWAY_MEMORY_MIB << 20,
            hardware_id: machine.machine.name.clone(),
            command,
        })?)
    };
    start().map_err(|source| CaptureError::Ros(Box::new(source)))
}

/// Waits for a driver on a thread of its own.
fn listen<T: 'static>(
    name: &'static str,
    mut next: impl FnMut() -> Result<Option<T>, DriverError> + Send + 'static,
    mut as_given: impl FnMut(T) -> Option<Given> + Send + 'static,
    give: SyncSender<Given>,
) -> Result<(), CaptureError> {
    let work = move || {
        loop {
            let given = match next() {
                Ok(Some(reading)) => as_given(reading),
                Ok(None) => return,
                Err(error) if error.is_of_one_reading() => Some(Given::Refused(name, error.to_string())),
                Err(error) => {
                    // Who does not listen any more has ended already.
                    let _ = give.send(Given::Ended(name, error.to_string()));
                    return;
                }
            };
            if given.is_some_and(|given| give.send(given).is_err()) {
                return;
            }
        }
    };
    Builder::new().name(name.into()).spawn(work).map(drop).map_err(CaptureError::Thread)
}

/// A link, and what was told of it last.
struct Watched {
    name: &'static str,
    link: Link,
    told: LinkState,
}

impl Watched {
    fn new(name: &'static str, link: Link) -> Watched {
        Watched { name, link, told: LinkState::Waiting }
    }

    /// What has changed, in words.
    fn news(&mut self) -> Option<String> {
        let now = self.link.status().state;
        if now == self.told {
            return None;
        }
        let words = match &now {
            LinkState::Waiting => None,
            LinkState::Connected(whom) => Some(format!("{}: connected with {whom}", self.name)),
            LinkState::Silent(words) | LinkState::Lost(words) => Some(format!("{}: {words}", self.name)),
        };
        self.told = now;
        words
    }
}
