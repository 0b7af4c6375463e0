//! Real time for the threads that carry samples: SCHED_FIFO, memory that stays in place, cores of their own.
//!
//! Place in the flow: a node on the path of a sample calls [`Realtime::begin`] while it starts, and each of its threads that
//! carries samples [`step_in`] when all that it needs is open. Only such threads run at that priority: what they start is
//! started before, because a thread hands its priority down. What the system does not allow is refused with what is missing
//! and how to grant it; the launcher asks with [`Realtime::try_out`] before it starts anything.
//!
//! A thread at such a priority keeps all others off its core for as long as it computes. So it has a share of the cores, and
//! [`InRealtime::breathe`] makes it rest when it takes more: all threads of a launch together take nine tenths at most.

mod allowed;

use std::fmt;
use std::io;
use std::marker::PhantomData;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use rustix::io::Errno;
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::getpriority_process;
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use rustix::time::{ClockId, clock_gettime};
use thiserror::Error;
use thread_priority::{
    NormalThreadSchedulePolicy, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

pub use allowed::online_cores;

/// Time over which a thread's share is taken: a burst of samples that were held up is shorter.
const ROUND: Duration = Duration::from_millis(50);
/// Longest rest: who takes samples has room for some hundred ms of them.
const LONGEST_REST: Duration = Duration::from_millis(100);
/// What all threads at real-time priority may take of the cores together.
const MOST: f64 = 0.9;
const FIFO: ThreadSchedulePolicy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
const OTHER: ThreadSchedulePolicy = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other);

/// Real time as a launch file asks for it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Realtime {
    /// Priority under SCHED_FIFO, of [`Realtime::PRIORITIES`].
    pub priority: u8,
    /// Cores to run on; all where it is empty.
    pub cores: Vec<usize>,
    /// Threads that run so on these cores, in all processes of the launch.
    pub threads: usize,
}

/// Why there is no real time.
#[derive(Debug, Error)]
pub enum RealtimeError {
    /// The priority is not allowed.
    #[error(
        "realtime: SCHED_FIFO with priority {priority} is refused: {why}. {}",
        allowed::how_to_grant(*priority)
    )]
    Priority {
        /// The priority.
        priority: u8,
        /// What the system allows.
        why: String,
    },
    /// Locked memory is not allowed.
    #[error("realtime: locked memory is refused: {why}. {}", allowed::how_to_grant(*priority))]
    Memory {
        /// The priority, for the words that say how to grant both.
        priority: u8,
        /// What the system allows.
        why: String,
    },
    /// Cores that this process must not use.
    #[error(
        "realtime.cores: {wanted:?}: this process may run on the cores {allowed:?}; name some of these, or let it have the \
         others (AllowedCPUs= of its service, --cpuset-cpus of its container)"
    )]
    Cores {
        /// The cores of the launch file.
        wanted: Vec<usize>,
        /// Those that it may use.
        allowed: Vec<usize>,
    },
    /// The system fails otherwise.
    #[error("realtime: {what}: {source}; leave out realtime, or look after the system")]
    System {
        /// What was tried.
        what: &'static str,
        /// Why it failed.
        source: io::Error,
    },
}

/// What the process has begun.
struct OfProcess {
    realtime: Realtime,
    /// How often one of its threads had to rest.
    rests: AtomicU64,
}

static OF_PROCESS: OnceLock<OfProcess> = OnceLock::new();

impl Realtime {
    /// Priorities that may be asked for. 99 is that of threads of the kernel which nobody may keep off a core.
    pub const PRIORITIES: std::ops::RangeInclusive<u8> = 1..=98;

    /// Whether the system allows it to this process and what it starts; tried on a thread that ends with the try.
    ///
    /// # Errors
    /// What is missing, and how to grant it.
    pub fn try_out(&self) -> Result<(), RealtimeError> {
        allowed::may_lock_memory().map_err(|why| RealtimeError::Memory { priority: self.priority, why })?;
        let what = "a thread cannot be started";
        let tried = thread::scope(|scope| {
            let trying = thread::Builder::new().name("realtime".into());
            Ok(trying.spawn_scoped(scope, || self.enter().map(drop))?.join())
        });
        match tried.map_err(|source| RealtimeError::System { what, source })? {
            Ok(outcome) => outcome,
            Err(_) => Err(RealtimeError::System { what, source: io::Error::other("it panicked") }),
        }
    }

    /// Locks the memory of this process, what it has and what it will get, and lets its threads [`step_in`] from now on.
    ///
    /// # Errors
    /// As [`Realtime::try_out`].
    pub fn begin(self) -> Result<(), RealtimeError> {
        self.try_out()?;
        mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).map_err(|error| match error {
            Errno::PERM | Errno::NOMEM | Errno::AGAIN => {
                RealtimeError::Memory { priority: self.priority, why: format!("mlockall: {}", io::Error::from(error)) }
            }
            other => RealtimeError::System { what: "memory cannot be locked", source: other.into() },
        })?;
        let _ = OF_PROCESS.set(OfProcess { realtime: self, rests: AtomicU64::new(0) });
        Ok(())
    }

    /// Puts the calling thread on its cores and under SCHED_FIFO until the guard goes.
    ///
    /// # Errors
    /// When the system does not allow it; then nothing is changed.
    pub fn enter(&self) -> Result<InRealtime, RealtimeError> {
        let system = |what| move |error: Errno| RealtimeError::System { what, source: error.into() };
        let before = sched_getaffinity(None).map_err(system("the cores of a thread cannot be read"))?;
        let nice = getpriority_process(None).map_err(system("the niceness of a thread cannot be read"))?;
        let priority = ThreadPriority::try_from(self.priority).map_err(|why| self.refused(why.to_owned()))?;
        // From here on the guard undoes what was done, also where the rest is refused.
        let mut inside = InRealtime {
            before: (!self.cores.is_empty()).then_some(before),
            nice,
            share: self.share(),
            since: Instant::now(),
            computed: thread_time(),
            is_fifo: false,
            _stays_on_its_thread: PhantomData,
        };
        self.pin()?;
        match set_thread_priority_and_policy(thread_native_id(), priority, FIFO) {
            Ok(()) => {
                inside.is_fifo = true;
                Ok(inside)
            }
            Err(thread_priority::Error::OS(code)) if code == Errno::PERM.raw_os_error() => {
                Err(self.refused(allowed::why_no_priority(self.priority)))
            }
            Err(error) => Err(self.refused(error.to_string())),
        }
    }

    fn refused(&self, why: String) -> RealtimeError {
        RealtimeError::Priority { priority: self.priority, why }
    }

    /// Puts the calling thread on the named cores.
    fn pin(&self) -> Result<(), RealtimeError> {
        if self.cores.is_empty() {
            return Ok(());
        }
        let not_allowed = || RealtimeError::Cores { wanted: self.cores.clone(), allowed: allowed::allowed_cores() };
        let mut wanted = CpuSet::new();
        for core in &self.cores {
            // A set has no room for more.
            if *core >= CpuSet::MAX_CPU {
                return Err(not_allowed());
            }
            wanted.set(*core);
        }
        sched_setaffinity(None, &wanted).map_err(|_| not_allowed())?;
        // Of cores that are not all allowed the kernel takes the others without a word.
        if sched_getaffinity(None).is_ok_and(|got| got == wanted) { Ok(()) } else { Err(not_allowed()) }
    }

    /// Part of a core that each thread may take.
    fn share(&self) -> f64 {
        let cores = if self.cores.is_empty() { allowed::allowed_cores().len() } else { self.cores.len() };
        (MOST * cores.max(1) as f64 / self.threads.max(1) as f64).min(MOST)
    }
}

impl fmt::Display for Realtime {
    /// `fifo 50, locked, cores [2, 3]`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "fifo {}, locked, ", self.priority)?;
        if self.cores.is_empty() { f.write_str("all cores") } else { write!(f, "cores {:?}", self.cores) }
    }
}

/// What this process has begun; nothing where it runs as every other.
pub fn begun() -> Option<&'static Realtime> {
    OF_PROCESS.get().map(|of_process| &of_process.realtime)
}

/// How often threads of this process took more than their share of the cores, and rested.
pub fn rests() -> u64 {
    OF_PROCESS.get().map_or(0, |of_process| of_process.rests.load(Ordering::Relaxed))
}

/// Puts the calling thread at real-time priority until the guard goes, where the process has begun so; nothing elsewhere. Call
/// it when all threads and processes that this one needs are started.
///
/// # Errors
/// When the system has taken back what it allowed.
pub fn step_in() -> Result<Option<InRealtime>, RealtimeError> {
    begun().map(Realtime::enter).transpose()
}

/// [`step_in`] for a thread that has nobody to refuse it to: what is refused stands in the log.
#[must_use]
pub fn carry_samples() -> Option<InRealtime> {
    step_in().unwrap_or_else(|error| {
        tracing::error!("a thread that carries samples runs as every other: {error}");
        None
    })
}

/// A thread at real-time priority; it is as before when this goes.
#[derive(Debug)]
pub struct InRealtime {
    /// Cores that it had; none where it was not pinned.
    before: Option<CpuSet>,
    nice: i32,
    share: f64,
    /// Beginning of a round, and what the thread had computed then.
    since: Instant,
    computed: Duration,
    is_fifo: bool,
    _stays_on_its_thread: PhantomData<*const ()>,
}

impl InRealtime {
    /// To be called with every sample: rests where the thread has taken more than its share, so that others get the core.
    pub fn breathe(&mut self) {
        let passed = self.since.elapsed();
        if passed < ROUND {
            return;
        }
        let rest = rest_after(thread_time().saturating_sub(self.computed), passed, self.share);
        if !rest.is_zero() {
            thread::sleep(rest);
            if let Some(of_process) = OF_PROCESS.get() {
                of_process.rests.fetch_add(1, Ordering::Relaxed);
            }
        }
        (self.since, self.computed) = (Instant::now(), thread_time());
    }
}

impl Drop for InRealtime {
    fn drop(&mut self) {
        let back = match self.is_fifo {
            true => set_thread_priority_and_policy(thread_native_id(), at_niceness(self.nice), OTHER),
            false => Ok(()),
        };
        if let Err(error) = back {
            tracing::warn!(%error, "a thread keeps its real-time priority");
        }
        if let Some(Err(error)) = self.before.map(|cores| sched_setaffinity(None, &cores)) {
            tracing::warn!(%error, "a thread keeps the cores that it was put on");
        }
    }
}

/// How long a thread rests that computed so long in the time that passed, so that it has taken its share and no more.
fn rest_after(computed: Duration, passed: Duration, share: f64) -> Duration {
    computed.div_f64(share).saturating_sub(passed).min(LONGEST_REST)
}

/// What the calling thread has computed so far.
fn thread_time() -> Duration {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(time.tv_sec.unsigned_abs(), time.tv_nsec.unsigned_abs() as u32)
}

/// What the library takes for a niceness: it names them from 99 (−20) down to 0 (19).
fn at_niceness(nice: i32) -> ThreadPriority {
    let highest = 99.0 * (1.0 - (f64::from(nice) + 20.5) / 39.0);
    ThreadPriority::try_from(highest.clamp(0.0, 99.0).round() as u8).unwrap_or(ThreadPriority::Min)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn realtime(cores: &[usize], threads: usize) -> Realtime {
        Realtime { priority: 50, cores: cores.to_vec(), threads }
    }

    #[test]
    fn a_thread_rests_until_it_has_had_its_share_and_not_at_all_below() {
        let ms = Duration::from_millis;
        assert_eq!(rest_after(ms(20), ms(50), 0.5), Duration::ZERO);
        assert_eq!(rest_after(ms(50), ms(50), 0.5), ms(50), "50 of 100 ms");
        assert_eq!(rest_after(ms(45), ms(50), 0.9), Duration::ZERO);
        assert_eq!(rest_after(Duration::from_secs(9), Duration::from_secs(9), 0.9), LONGEST_REST);
    }

    #[test]
    fn all_threads_together_leave_a_tenth_of_their_cores() {
        for (cores, threads) in [(vec![0], 1), (vec![0], 4), (vec![0, 1], 3), (vec![0, 1, 2, 3], 3)] {
            let share = realtime(&cores, threads).share();
            assert!(share > 0.0 && share <= 0.9);
            assert!(share * threads as f64 <= 0.9 * cores.len() as f64 + 1e-9, "{cores:?}, {threads} threads: {share}");
        }
    }

    #[test]
    fn what_is_begun_is_said_in_a_line() {
        assert_eq!(realtime(&[2, 3], 3).to_string(), "fifo 50, locked, cores [2, 3]");
        assert_eq!(realtime(&[], 3).to_string(), "fifo 50, locked, all cores");
    }

    /// The library's own map from a priority of 0 to 99 to a niceness.
    #[test]
    fn every_niceness_is_named_as_the_library_names_it() {
        for nice in -20..=19 {
            let named = at_niceness(nice).to_posix(OTHER).unwrap();
            assert_eq!(named, nice);
        }
    }

    #[test]
    fn a_core_that_does_not_exist_is_refused_with_those_that_do() {
        for core in [9999, CpuSet::MAX_CPU - 1] {
            let error = realtime(&[core], 1).pin().unwrap_err().to_string();
            assert!(error.contains("realtime.cores") && error.contains(&core.to_string()), "{error}");
        }
    }

    #[test]
    fn a_process_that_has_not_begun_has_threads_as_every_other() {
        assert!(begun().is_none() && rests() == 0);
        assert!(step_in().unwrap().is_none());
    }
}
