//! The client: a thread that keeps a session with a server, and gives what nodes say.
//!
//! Place in the flow: the driver `opcua` takes what comes out of a queue. A connection that is lost is made again, after waits that
//! the driver names; with it everything is asked anew: namespaces, units, whether the nodes are there. The thread has a scheduler of
//! its own, on which the library's futures run; nothing here waits for whoever takes the values: a queue that is full ends the
//! session, with words.

use crate::log::Seldom;
use crate::node::NodeName;
use crate::session::Stop;
use crate::units::ServerUnit;
use std::fmt::{Debug, Formatter};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use tracing::dispatcher::{Dispatch, get_default, with_default};

/// Messages that wait for the driver at most.
const QUEUE: usize = 4096;
/// Shortest wait between two looks whether to stop.
pub(crate) const LOOK_UP: Duration = Duration::from_millis(20);

/// How messages are protected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Security {
    /// Not at all.
    None,
    /// Policy Basic256Sha256.
    Basic256Sha256,
    /// Policy Aes128_Sha256_RsaOaep.
    Aes128Sha256RsaOaep,
    /// Policy Aes256_Sha256_RsaPss.
    Aes256Sha256RsaPss,
}

/// A user and the password, which no message shows.
#[derive(Clone, PartialEq, Eq)]
pub struct User {
    /// The name.
    pub name: String,
    /// The password.
    pub password: String,
}

impl Debug for User {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        write!(f, "User {{ name: {:?} }}", self.name)
    }
}

/// How values are asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Asks {
    /// The server tells what changes, looking this often.
    Subscribed(Duration),
    /// All nodes are read this often.
    Polled(Duration),
}

/// What is wanted of a server.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The server, as `opc.tcp://host:port/path`.
    pub server: String,
    /// How messages are protected.
    pub security: Security,
    /// Whether they are signed only, and can be read on the way.
    pub signed_only: bool,
    /// Who logs in; anonymous without it.
    pub user: Option<User>,
    /// Folder of certificates; needed with security.
    pub certificates: Option<PathBuf>,
    /// The nodes, which are known by their place from here on.
    pub nodes: Vec<NodeName>,
    /// How values are asked for.
    pub asks: Asks,
    /// Silence from which a session is given up.
    pub silent_after: Duration,
}

/// What a session found of a node.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Found {
    /// The unit that the server names.
    pub unit: Option<ServerUnit>,
    /// Why it has no values: it is not there, or may not be read.
    pub problem: Option<String>,
}

/// A value of a node.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeValue {
    /// Its place among the nodes.
    pub node: usize,
    /// The value in the server's unit, or why there is none.
    pub value: Result<f64, String>,
    /// Time of the source (ns since 1970).
    pub source_ns: Option<i64>,
    /// The server has thrown values away before this one.
    pub is_after_loss: bool,
}

/// What comes together.
#[derive(Debug, Clone, PartialEq)]
pub struct Values {
    /// When it arrived (ns since 1970).
    pub arrived_ns: i64,
    /// The server's time of the message, where it tells it (ns since 1970).
    pub server_ns: Option<i64>,
    /// Whether it answers a question for all nodes.
    pub is_answer: bool,
    /// The values; none where nothing has changed.
    pub values: Vec<NodeValue>,
}

/// What happens.
#[derive(Debug)]
pub enum Event {
    /// A session has begun.
    Connected(Vec<Found>),
    /// Values.
    Values(Values),
    /// Something that somebody should know.
    Told(String),
    /// The session has ended, or none could begin; it is tried again.
    Lost(String),
}

/// Says whether a session may go on with what it found.
pub type Check = Box<dyn Fn(&[Found]) -> Result<(), String> + Send>;
/// The waits before each new try, which begin again after a session.
pub type Wait = Box<dyn FnMut(bool) -> Duration + Send>;

/// The driver's end of the thread.
pub struct Client {
    events: Receiver<Event>,
    is_stopped: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Client {
    /// Starts the thread.
    ///
    /// # Errors
    /// The system gives no thread, or nothing to schedule with.
    pub fn open(settings: Settings, check: Check, mut wait: Wait) -> std::io::Result<Client> {
        let (give, events) = sync_channel(QUEUE);
        let is_stopped = Arc::new(AtomicBool::new(false));
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let shared = Arc::new(Shared::new(give, Arc::clone(&is_stopped)));
        let log = Dispatch::new(Seldom::new(get_default(Dispatch::clone)));
        let talk = move || {
            while !shared.is_stopped() {
                let Stop::Lost(why) = runtime.block_on(crate::session::run(&settings, &check, &shared)) else { break };
                if shared.lose(why).is_err() {
                    break;
                }
                shared.sleep(wait(shared.has_begun()));
            }
            // A name that is looked up for ever holds up nobody.
            runtime.shutdown_timeout(LOOK_UP);
        };
        let thread = thread::Builder::new().name("opcua".into()).spawn(move || with_default(&log, talk))?;
        Ok(Client { events, is_stopped, thread: Some(thread) })
    }

    /// The next event, within this time.
    pub fn next(&mut self, within: Duration) -> Option<Event> {
        match self.events.recv_timeout(within) {
            Ok(event) => Some(event),
            Err(RecvTimeoutError::Timeout) => None,
            // The thread ends with the driver, and not before.
            Err(RecvTimeoutError::Disconnected) => {
                thread::sleep(within);
                None
            }
        }
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        self.is_stopped.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // It ends the session with the server first.
            let _ = thread.join();
        }
    }
}

/// What the thread and the library's callbacks share.
pub(crate) struct Shared {
    give: SyncSender<Event>,
    is_stopped: Arc<AtomicBool>,
    /// A session has begun since the last loss.
    has_begun: AtomicBool,
    state: Mutex<State>,
}

/// How a session goes.
struct State {
    heard: Instant,
    /// Why it cannot go on.
    broken: Option<String>,
}

impl Shared {
    fn new(give: SyncSender<Event>, is_stopped: Arc<AtomicBool>) -> Shared {
        let state = Mutex::new(State { heard: Instant::now(), broken: None });
        Shared { give, is_stopped, has_begun: AtomicBool::new(false), state }
    }

    pub(crate) fn is_stopped(&self) -> bool {
        self.is_stopped.load(Ordering::Relaxed)
    }

    fn has_begun(&self) -> bool {
        self.has_begun.swap(false, Ordering::Relaxed)
    }

    /// A session tries to begin.
    pub(crate) fn begin(&self) {
        *self.state.lock().unwrap_or_else(PoisonError::into_inner) = State { heard: Instant::now(), broken: None };
    }

    /// It has begun.
    pub(crate) fn connected(&self, found: Vec<Found>) {
        self.has_begun.store(true, Ordering::Relaxed);
        self.give(Event::Connected(found));
    }

    /// Something has come from the server.
    pub(crate) fn hear(&self) {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).heard = Instant::now();
    }

    /// Gives an event, and never waits for it to be taken.
    pub(crate) fn give(&self, event: Event) {
        if let Err(TrySendError::Full(_)) = self.give.try_send(event) {
            self.break_off(format!("{QUEUE} messages wait to be taken, and more come; ask for values less often"));
        }
    }

    /// The session cannot go on.
    pub(crate) fn break_off(&self, why: String) {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).broken.get_or_insert(why);
    }

    /// Why the session ends, where it does.
    pub(crate) fn trouble(&self, silent_after: Duration) -> Option<String> {
        let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let silence = || format!("silent for more than {} s", silent_after.as_secs_f64());
        state.broken.clone().or_else(|| (state.heard.elapsed() > silent_after).then(silence))
    }

    /// The one event that must arrive: waits until it is taken, or the driver is gone.
    fn lose(&self, why: String) -> Result<(), ()> {
        let mut event = Event::Lost(why);
        loop {
            match self.give.try_send(event) {
                Ok(()) => return Ok(()),
                Err(TrySendError::Disconnected(_)) => return Err(()),
                Err(TrySendError::Full(_)) if self.is_stopped() => return Err(()),
                Err(TrySendError::Full(back)) => event = back,
            }
            thread::sleep(LOOK_UP);
        }
    }

    fn sleep(&self, wait: Duration) {
        let until = Instant::now() + wait;
        while Instant::now() < until && !self.is_stopped() {
            thread::sleep(LOOK_UP.min(until.saturating_duration_since(Instant::now())));
        }
    }
}
