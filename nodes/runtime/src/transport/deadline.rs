//! The end of a wait, which may lie beyond what the clock can express.
//!
//! Place in the flow: used by the subscribers that wait in rounds.

use std::time::{Duration, Instant};

/// Longest single round: the systems below do not all take longer ones.
const LONGEST_ROUND: Duration = Duration::from_secs(3600);

/// When a wait ends; never, if the clock does not reach so far.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Deadline(Option<Instant>);

impl Deadline {
    /// The instant `timeout` from now.
    pub(crate) fn after(timeout: Duration) -> Self {
        Self(Instant::now().checked_add(timeout))
    }

    /// How long the next round of waiting may last; zero when the wait is over.
    pub(crate) fn round(self) -> Duration {
        let left = self.0.map_or(LONGEST_ROUND, |end| end.saturating_duration_since(Instant::now()));
        left.min(LONGEST_ROUND)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wait_without_end_has_rounds_and_an_expired_one_has_none() {
        assert_eq!(Deadline::after(Duration::MAX).round(), LONGEST_ROUND);
        assert_eq!(Deadline::after(Duration::ZERO).round(), Duration::ZERO);
    }
}
