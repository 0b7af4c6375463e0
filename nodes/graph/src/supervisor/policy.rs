//! What becomes of a graph when one of its nodes ends: by the node's role, and by how often it has ended.
//!
//! Place in the flow: asked by the supervisor at every end of a node that it did not order. Pure: instants come in.
//!
//! | role | nodes | an end that nobody asked for |
//! |---|---|---|
//! | source | scale, tracer | ends the launch: a recording that starts again would say the same again |
//! | correcting | geometric, residual | started again; when that does not help, the launch ends |
//! | beside | monitor, recorder | started again; when that does not help, the others go on without it |
//!
//! A node that fails with an error of its own before it was ever ready cannot start: that ends the launch, whatever its
//! role.

use crate::launch::NodeName;
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
    /// Where samples come from.
    Source,
    /// On the way of every sample.
    Correcting,
    /// Takes what others give, and nobody waits for it.
    Beside,
}

impl Role {
    /// The role of a node.
    pub fn of(node: NodeName) -> Role {
        match node {
            NodeName::Scale | NodeName::Tracer => Role::Source,
            NodeName::Geometric | NodeName::Residual => Role::Correcting,
            NodeName::Monitor | NodeName::Recorder => Role::Beside,
        }
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
        if role == Role::Source || (ending.gave_up && !ending.was_ready) {
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
    fn a_source_that_is_done_is_no_fault_and_any_other_end_of_it_ends_the_launch() {
        let now = Instant::now();
        let done = Ending { recording_ended: true, ..KILLED };
        assert_eq!(Ends::default().judge(Role::Source, done, now), Verdict::Done);
        assert_eq!(Ends::default().judge(Role::Source, KILLED, now), Verdict::EndLaunch);
    }

    #[test]
    fn a_node_that_cannot_start_ends_the_launch_at_once() {
        let cannot = Ending { gave_up: true, was_ready: false, ..KILLED };
        for role in [Role::Source, Role::Correcting, Role::Beside] {
            assert_eq!(Ends::default().judge(role, cannot, Instant::now()), Verdict::EndLaunch);
        }
    }

    #[test]
    fn waits_double_and_the_fifth_end_within_a_minute_is_the_last() {
        let start = Instant::now();
        for (role, last) in [(Role::Correcting, Verdict::EndLaunch), (Role::Beside, Verdict::GoOnWithout)] {
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
