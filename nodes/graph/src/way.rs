//! The way of the machine from reading to reading: whether it was seen.
//!
//! Place in the flow: beside the scale driver, live and in a capture. What is derived from the motion, a side of approach above all, holds
//! while each reading follows the one before; where one does not, the machine may have gone anywhere meanwhile.

use crate::link::Link;
use abbe_msgs::{ScaleReading, Stamp};

/// Readings lost for so long hide nothing (ns): an axis that turns meanwhile goes on the new way, which the next readings show.
const TURNS_NS: i64 = 10_000_000;

/// The way of the machine from reading to reading, as far as it was read.
pub(crate) struct Way {
    link: Option<Link>,
    /// Losses of the link, and of messages.
    losses: (u64, u64),
    /// Readings that were refused.
    refused: u64,
    /// Sequence and stamp of the last reading.
    last: Option<(u64, Stamp)>,
}

impl Way {
    /// The way that begins with the next reading of the driver that this link is of.
    pub(crate) fn new(link: Option<Link>) -> Way {
        Way { link, losses: (0, 0), refused: 0, last: None }
    }

    /// Whether the machine may have gone anywhere between the last reading and this one, `refused` being how many were refused so far: the
    /// link was lost, readings were or were none, or their source or its clock began anew.
    pub(crate) fn is_broken_before(&mut self, reading: &ScaleReading, refused: u64) -> bool {
        let losses = self.link.as_ref().map_or((0, 0), Link::losses);
        let before = std::mem::replace(&mut self.losses, losses);
        let was_refused = std::mem::replace(&mut self.refused, refused) != refused;
        let (was_lost, has_missed) = (before.0 != losses.0, before.1 != losses.1 || was_refused);
        let last = self.last.replace((reading.sequence, reading.stamp));
        let goes_on = |(sequence, stamp): (u64, Stamp)| {
            // A source that does not count says nothing of losses.
            let is_next = sequence == reading.sequence || sequence.checked_add(1) == Some(reading.sequence);
            let since_ns = reading.stamp.to_nanos() - stamp.to_nanos();
            since_ns >= 0 && (is_next && !has_missed || sequence <= reading.sequence && since_ns <= TURNS_NS)
        };
        was_lost || !last.is_none_or(goes_on)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::LinkState;

    #[test]
    fn a_way_is_broken_by_a_lost_link_lost_readings_and_a_beginning_and_by_nothing_else() {
        let link = Link::default();
        let mut way = Way::new(Some(link.clone()));
        let mut is_broken_after = |refused: u64, sequence: u64, ms: i64| {
            let stamp = Stamp::from_nanos(1_700_000_000_000_000_000 + ms * 1_000_000).unwrap();
            way.is_broken_before(&ScaleReading { sequence, stamp, ..ScaleReading::default() }, refused)
        };
        let mut is_broken = |sequence: u64, ms: i64| is_broken_after(0, sequence, ms);
        // One after the other, after a rest of the machine, three readings lost at 1 kHz, some seconds of them.
        let told = [(5, 0), (6, 1), (7, 60_000), (11, 60_004), (4000, 64_000)].map(|(n, ms)| is_broken(n, ms));
        assert_eq!(told, [false, false, false, false, true]);
        assert!(!is_broken(4001, 64_001));
        assert!(is_broken(0, 64_002), "the source began anew");
        assert!(is_broken(1, 64_001), "the clock was set back");
        link.stands(LinkState::Lost("gone".to_owned()));
        link.stands(LinkState::Connected("again".to_owned()));
        assert!(is_broken(2, 64_003) && !is_broken(3, 64_004));
        // Lost before the driver, which numbers what it gets.
        link.missed(4);
        assert!(!is_broken(4, 64_009));
        link.missed(400);
        assert!(is_broken(5, 64_500) && !is_broken(6, 64_501));
        // The driver numbers what it gives: while the holder was empty it gave nothing.
        assert!(!is_broken_after(3, 7, 64_505) && is_broken_after(9, 8, 70_000) && !is_broken_after(9, 9, 71_000));
    }
}
