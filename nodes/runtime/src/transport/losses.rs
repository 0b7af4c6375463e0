//! Which samples of a publisher were missed, told by the numbers the transport gives them.
//!
//! Place in the flow: shared memory and DDS number the samples of each publisher; a subscriber
//! shows every number to [`Losses`], which counts gaps and finds repetitions.

use std::collections::VecDeque;

/// Publishers remembered; of more, the one that was silent longest is forgotten.
const REMEMBERED: usize = 32;

/// The numbers seen so far, by publisher.
#[derive(Debug, Clone, Default)]
pub(crate) struct Losses {
    /// Publisher and the number it will use next; most recently active last.
    expected: VecDeque<([u8; 16], u64)>,
    lost: u64,
    /// Samples of a publisher that came after those of another that had come after its own.
    interleaved: u64,
}

/// What a number says about its sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Arrival {
    /// The sample is new.
    New,
    /// The sample, or one after it, has arrived before: a repetition, to be passed over.
    Repeated,
}

impl Losses {
    /// Samples missed so far.
    pub(crate) fn count(&self) -> u64 {
        self.lost
    }

    /// Goes on where another process stopped: the sample of `publisher` that comes next was to be `next`.
    pub(crate) fn resume(&mut self, publisher: [u8; 16], next: u64) {
        self.expected.push_back((publisher, next));
    }

    /// The publisher heard last, and the number it will use next.
    pub(crate) fn latest(&self) -> Option<([u8; 16], u64)> {
        self.expected.back().copied()
    }

    /// How often the stream came back to a publisher after another one's samples.
    pub(crate) fn interleaved(&self) -> u64 {
        self.interleaved
    }

    /// Judges the sample `number` of `publisher`. The first of a publisher loses nothing: who joins
    /// late has no claim to what was sent before.
    pub(crate) fn judge(&mut self, publisher: [u8; 16], number: u64) -> Arrival {
        let place = self.expected.iter().position(|(other, _)| *other == publisher);
        self.interleaved += u64::from(place.is_some_and(|place| place + 1 < self.expected.len()));
        let known = place.and_then(|place| self.expected.remove(place));
        let next = known.map_or(number, |(_, next)| next);
        if self.expected.len() >= REMEMBERED {
            self.expected.pop_front();
        }
        self.expected.push_back((publisher, next.max(number.saturating_add(1))));
        if number < next {
            return Arrival::Repeated;
        }
        // A number far ahead, as only a faulty or hostile peer sends it, must not overflow the count.
        self.lost = self.lost.saturating_add(number - next);
        Arrival::New
    }
}

/// How many samples of each publisher arrived and were refused. Whoever is handed the others alone would take each of these
/// for one that was lost on the way; numbers without them have no gap there.
#[derive(Debug, Clone, Default)]
pub(crate) struct Refusals(VecDeque<([u8; 16], u64)>);

impl Refusals {
    /// A sample of `publisher` was refused. The first ones of a publisher count as well: they move its numbers as a whole.
    pub(crate) fn note(&mut self, publisher: [u8; 16]) {
        let place = self.0.iter().position(|(other, _)| *other == publisher);
        let refused = place.and_then(|place| self.0.remove(place)).map_or(0, |(_, refused)| refused);
        if self.0.len() >= REMEMBERED {
            self.0.pop_front();
        }
        self.0.push_back((publisher, refused + 1));
    }

    /// The number of a sample among those that were not refused.
    pub(crate) fn number(&self, publisher: [u8; 16], number: u64) -> u64 {
        let refused = self.0.iter().find(|(other, _)| *other == publisher).map_or(0, |(_, refused)| *refused);
        number.saturating_sub(refused)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_what_was_refused_is_not_lost_on_the_way_as_well() {
        let (mut refusals, mut losses) = (Refusals::default(), Losses::default());
        // Of A every third is refused, 17 and 18 are lost; of B nothing is refused.
        for number in (1..40).filter(|number| !(17..19).contains(number)) {
            if number % 3 == 0 {
                refusals.note(A);
            } else {
                assert_eq!(losses.judge(A, refusals.number(A, number)), Arrival::New, "{number}");
            }
            assert_eq!(losses.judge(B, refusals.number(B, number + 50)), Arrival::New, "{number}");
        }
        assert_eq!(losses.count(), 2 * 2, "those that did not arrive");
    }

    #[test]
    fn refusals_of_many_publishers_stay_bounded() {
        let mut refusals = Refusals::default();
        (0..100).for_each(|publisher| refusals.note([publisher; 16]));
        assert_eq!((refusals.0.len(), refusals.number([99; 16], 7), refusals.number([0; 16], 7)), (REMEMBERED, 6, 7));
    }

    const A: [u8; 16] = [1; 16];
    const B: [u8; 16] = [2; 16];

    #[test]
    fn a_gap_is_lost_and_a_late_start_is_not() {
        let mut losses = Losses::default();
        assert_eq!(losses.judge(A, 100), Arrival::New);
        assert_eq!(losses.judge(A, 101), Arrival::New);
        assert_eq!(losses.count(), 0);
        assert_eq!(losses.judge(A, 110), Arrival::New);
        assert_eq!(losses.count(), 8);
    }

    #[test]
    fn who_goes_on_for_another_loses_what_came_in_between() {
        let mut killed = Losses::default();
        killed.judge(A, 41);
        let (publisher, next) = killed.latest().unwrap();
        let mut losses = Losses::default();
        losses.resume(publisher, next);
        assert_eq!(losses.judge(A, 50), Arrival::New);
        assert_eq!(losses.count(), 8);
        assert_eq!(losses.judge(B, 50), Arrival::New, "a new publisher loses nothing");
        assert_eq!(losses.count(), 8);
    }

    #[test]
    fn a_repetition_is_told_apart_from_another_publisher() {
        let mut losses = Losses::default();
        losses.judge(A, 5);
        assert_eq!(losses.judge(B, 5), Arrival::New);
        assert_eq!(losses.judge(A, 5), Arrival::Repeated);
        assert_eq!(losses.judge(A, 6), Arrival::New);
        assert_eq!(losses.count(), 0);
    }

    #[test]
    fn regress_two_publishers_at_once_are_told_from_one_that_takes_the_place_of_another() {
        let mut losses = Losses::default();
        (0..10).for_each(|number| assert_eq!(losses.judge(A, number), Arrival::New));
        (0..10).for_each(|number| assert_eq!(losses.judge(B, number), Arrival::New));
        assert_eq!(losses.interleaved(), 0, "the second came in the place of the first");
        losses.judge(A, 10);
        losses.judge(B, 10);
        losses.judge(B, 11);
        assert_eq!(losses.interleaved(), 2);
    }

    #[test]
    fn numbers_at_the_end_of_the_range_do_not_overflow() {
        let mut losses = Losses::default();
        for publisher in [A, B] {
            losses.judge(publisher, 0);
            losses.judge(publisher, u64::MAX);
        }
        assert_eq!(losses.count(), u64::MAX);
        assert_eq!(losses.judge(A, 7), Arrival::Repeated);
    }

    #[test]
    fn memory_stays_bounded_and_keeps_the_active_publisher() {
        let mut losses = Losses::default();
        for number in 0..1000_u16 {
            let mut passing = [0; 16];
            passing[..2].copy_from_slice(&number.to_le_bytes());
            losses.judge(passing, 0);
            losses.judge([9; 16], u64::from(number));
        }
        assert_eq!(losses.expected.len(), REMEMBERED);
        assert_eq!(losses.judge([9; 16], 1001), Arrival::New);
        assert_eq!(losses.count(), 1);
    }
}
