//! What becomes of a graph when one of its nodes ends: by the node's role, and by how often it has ended.
//!
//! Place in the flow: asked by the supervisor at every end of a node that it did not order. Pure: instants come in.
//!
//! | role | nodes | an end that nobody asked for |
//! |---|---|---|
//! | source | scale, tracer | of a recording: ends the launch, as a recording that starts again would say the same again; live: started again where it was killed, ends the launch where it gave up |
//! | correcting | geometric, residual | started again; when that does not help, the launch ends |
//! | beside | monitor, recorder | started again; when that does not help, the others go on without it |
//!
//! A node that fails with an error of its own before it was ever ready cannot start: that ends the launch, whatever its
//! role.

use crate::launch::{Launch, NodeName, Source};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Wait before the first new start; it doubles with each further one.
pub const FIRST_WAIT: Duration = Duration::from_millis(100);
/// Longest wait before a new start.
pub const LONGEST_WAIT: Duration = Duration::from_secs(5);
/// Ends within [`WITHIN`] after which a node is given up.
pub const GIVEN_UP_AFTER: usize = 5;
/// Time over which ends are counted.
pub const WITHIN: Duration = Duration::from_secs(60);

/// What a node is to the graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Plays a recording.
    Recording,
    /// Where samples come from a machine or an instrument.
    Live,
    /// On the way of every sample.
    Correcting,
    /// Takes what others give, and nobody waits for it.
    Beside,
}

impl Role {
    /// The role of a node in this launch.
    pub fn of(node: NodeName, launch: &Launch) -> Role {
        let source = |own: &Option<Source>| match own {
            Some(source) if source.driver.is_live() => Role::Live,
            _ => Role::Recording,
        };
        match node {
            NodeName::Scale => source(&launch.scale),
            NodeName::Tracer => source(&launch.tracer),
            NodeName::Geometric | NodeName::Residual => Role::Correcting,
            NodeName::Monitor | NodeName::Recorder => Role::Beside,
        }
    }

    /// Whether samples come from it.
    pub fn is_source(self) -> bool {
        matches!(self, Role::Recording | Role::Live)
    }
}

/// How a node ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ending {
    /// Its recording was played to the end, and it said so.
    pub recording_ended: bool,
    /// It gave up with an error of its own (an exit code, not a signal).
    pub gave_up: bool,
    /// It had been ready, in this or an earlier life.
    pub was_ready: bool,
}

/// What to do about it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Nothing: it was due to end.
    Done,
    /// Start it again after this time.
    StartAgain(Duration),
    /// Go on without it.
    GoOnWithout,
    /// End the launch.
    EndLaunch,
}

/// The ends of one node that nobody asked for.
#[derive(Debug, Clone, Default)]
pub struct Ends {
    recent: VecDeque<Instant>,
}

impl Ends {
    /// Judges an end at `now` and remembers it.
    pub fn judge(&mut self, role: Role, ending: Ending, now: Instant) -> Verdict {
        if ending.recording_ended {
            return Verdict::Done;
        }
        let is_for_good = match role {
            Role::Recording => true,
            // A driver goes on by itself with whatever goes on again.
            Role::Live => ending.gave_up,
            Role::Correcting | Role::Beside => ending.gave_up && !ending.was_ready,
        };
        if is_for_good {
            return Verdict::EndLaunch;
        }
        self.recent.retain(|at| now.saturating_duration_since(*at) < WITHIN);
        self.recent.push_back(now);
        match (self.recent.len(), role) {
            (ends, Role::Beside) if ends >= GIVEN_UP_AFTER => Verdict::GoOnWithout,
            (ends, _) if ends >= GIVEN_UP_AFTER => Verdict::EndLaunch,
            (ends, _) => Verdict::StartAgain(wait(ends)),
        }
    }
}

/// The wait after so many ends in a row.
fn wait(ends: usize) -> Duration {
    let doublings = u32::try_from(ends.saturating_sub(1)).unwrap_or(u32::MAX).min(16);
    FIRST_WAIT.saturating_mul(1 << doublings).min(LONGEST_WAIT)
}

#[cfg(test)]
mod tests {
    use super::*;

    const KILLED: Ending = Ending { recording_ended: false, gave_up: false, was_ready: true };

    fn after(start: Instant, seconds: f64) -> Instant {
        start + Duration::from_secs_f64(seconds)
    }

    #[test]
    fn a_source_that_is_done_is_no_fault_and_any_other_end_of_a_recording_ends_the_launch() {
        let judge = |role, ending| Ends::default().judge(role, ending, Instant::now());
        let (done, gave_up) = (Ending { recording_ended: true, ..KILLED }, Ending { gave_up: true, ..KILLED });
        for role in [Role::Recording, Role::Live] {
            assert_eq!(judge(role, done), Verdict::Done);
            assert_eq!(judge(role, gave_up), Verdict::EndLaunch);
        }
        assert_eq!(judge(Role::Recording, KILLED), Verdict::EndLaunch);
        assert_eq!(judge(Role::Live, KILLED), Verdict::StartAgain(FIRST_WAIT));
    }

    #[test]
    fn a_node_that_cannot_start_ends_the_launch_at_once() {
        let cannot = Ending { gave_up: true, was_ready: false, ..KILLED };
        for role in [Role::Recording, Role::Live, Role::Correcting, Role::Beside] {
            assert_eq!(Ends::default().judge(role, cannot, Instant::now()), Verdict::EndLaunch);
        }
    }

    #[test]
    fn waits_double_and_the_fifth_end_within_a_minute_is_the_last() {
        let start = Instant::now();
        let lasts = [Verdict::EndLaunch, Verdict::EndLaunch, Verdict::GoOnWithout];
        for (role, last) in [Role::Live, Role::Correcting, Role::Beside].into_iter().zip(lasts) {
            let mut ends = Ends::default();
            for (number, milliseconds) in [100, 200, 400, 800].into_iter().enumerate() {
                let verdict = ends.judge(role, KILLED, after(start, number as f64));
                assert_eq!(verdict, Verdict::StartAgain(Duration::from_millis(milliseconds)));
            }
            assert_eq!(ends.judge(role, KILLED, after(start, 59.0)), last);
        }
    }

    #[test]
    fn an_end_once_in_a_while_is_never_the_last() {
        let (start, mut ends) = (Instant::now(), Ends::default());
        for number in 0..1000 {
            let verdict = ends.judge(Role::Correcting, KILLED, after(start, 61.0 * f64::from(number)));
            assert_eq!(verdict, Verdict::StartAgain(FIRST_WAIT));
        }
    }

    #[test]
    fn no_wait_is_longer_than_the_longest() {
        assert_eq!(wait(usize::MAX), LONGEST_WAIT);
    }
}
