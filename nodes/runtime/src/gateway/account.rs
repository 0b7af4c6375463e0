//! What became of the samples that a node gave to its gateway, over all the gateways it had.
//!
//! Place in the flow: at the node's end of a publication. A gateway that dies cannot say what of its last samples still
//! went out: those after the last heartbeat that came back through DDS are not known to have left, and count as missed.
//! So the figure is an upper bound, and never too small.

use super::protocol::PublicationBeat;

/// The account of one publication.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Account {
    /// Up to this number everything is settled.
    settled_to: u64,
    /// Of those up to there, not published though there was one.
    settled: u64,
    /// Of those up to there, not published because there was no gateway.
    missed: u64,
    /// What the gateway that runs says.
    beat: Option<PublicationBeat>,
    /// What had been sent when the gateway that runs was ready; none while none runs.
    ready_at: Option<u64>,
}

impl Account {
    /// A gateway is ready, after so many samples.
    pub(super) fn ready(&mut self, sent: u64) {
        self.ready_at = Some(sent);
    }

    /// It says how things stand.
    pub(super) fn beat(&mut self, beat: PublicationBeat) {
        self.beat = Some(beat);
    }

    /// It is gone.
    pub(super) fn gone(&mut self) {
        self.ready_at = None;
        let Some(PublicationBeat { now, proved, .. }) = self.beat.take() else { return };
        // One that took nothing settles nothing.
        let Some(first) = now.first else { return };
        self.missed = self.missed.saturating_add(first.saturating_sub(self.settled_to));
        self.settled_to = proved.first.map_or(first, |_| proved.next);
        self.settled = self.settled.saturating_add(proved.dropped);
    }

    /// Subscribers elsewhere.
    pub(super) fn subscribers(&self) -> usize {
        self.beat.map_or(0, |beat| beat.subscribers)
    }

    /// How often readers of the gateway that runs lagged and lost their oldest samples.
    pub(super) fn given_up(&self) -> u64 {
        self.beat.map_or(0, |beat| beat.given_up)
    }

    /// Of `sent` samples, those that did not go out for want of a gateway.
    pub(super) fn missed(&self, sent: u64) -> u64 {
        let first = self.beat.and_then(|beat| beat.now.first);
        // Without a gateway everything from the last proof on; with one that has taken nothing yet, what came before it.
        let until = first.or(self.ready_at).unwrap_or(sent);
        self.missed.saturating_add(until.saturating_sub(self.settled_to))
    }

    /// Of `sent` samples, those that did not go out.
    pub(super) fn dropped(&self, sent: u64) -> u64 {
        let now = self.beat.map_or(0, |beat| beat.now.dropped);
        self.missed(sent).saturating_add(self.settled).saturating_add(now)
    }
}

#[cfg(test)]
mod tests {
    use super::super::protocol::Progress;
    use super::*;

    fn beat(first: u64, next: u64, dropped: u64, proved: (u64, u64)) -> PublicationBeat {
        let now = Progress { first: Some(first), next, dropped };
        let proved = Progress { first: Some(first), next: proved.0, dropped: proved.1 };
        PublicationBeat { subscribers: 1, others: 0, given_up: 0, now, proved }
    }

    #[test]
    fn one_gateway_that_keeps_up_misses_nothing() {
        let mut account = Account::default();
        account.ready(0);
        assert_eq!(account.dropped(0), 0);
        assert_eq!(account.dropped(5), 0, "what is under way is not missed");
        account.beat(beat(0, 100, 3, (90, 1)));
        assert_eq!((account.missed(110), account.dropped(110)), (0, 3));
    }

    #[test]
    fn what_is_sent_without_a_gateway_is_missed_from_the_last_proof_to_the_next_first_sample() {
        let mut account = Account::default();
        account.ready(0);
        account.beat(beat(0, 100, 3, (90, 1)));
        account.gone();
        assert_eq!(account.missed(150), 60, "from the proof at 90 on");
        assert_eq!(account.dropped(150), 61);
        account.ready(170);
        assert_eq!(account.missed(171), 80, "up to the new gateway");
        account.beat(beat(172, 200, 0, (190, 0)));
        assert_eq!((account.missed(200), account.dropped(200)), (82, 83));
        account.gone();
        assert_eq!(account.missed(200), 92);
        account.ready(210);
        account.beat(beat(210, 211, 0, (0, 0)));
        assert_eq!(account.missed(300), 82 + 20);
    }

    #[test]
    fn gateways_that_die_before_they_take_anything_are_counted_through() {
        let mut account = Account::default();
        account.ready(0);
        account.beat(beat(0, 10, 0, (10, 0)));
        account.gone();
        for sent in [20, 30] {
            account.ready(sent);
            account.gone();
        }
        account.ready(40);
        account.beat(beat(40, 41, 0, (41, 0)));
        assert_eq!(account.missed(50), 30);
    }
}
