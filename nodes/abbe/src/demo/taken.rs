//! What the demo has taken of its graph so far.
//!
//! Place in the flow: [`super::live`] fills it sample by sample; [`super::closing`] sees by it how far the loop is.

use super::recording::Bag;
use abbe_graph::launch::NodeName;
use abbe_graph::node::{NodeSummary, STARTED, monotonic_s};
use abbe_msgs::{CorrectedCoordinates, Sha256};
use std::collections::BTreeSet;

/// What came over the corrected topic, and how many range residuals.
pub(super) struct Taken {
    /// Samples of the recording; the verification points come last.
    recorded: u64,
    first_point: u64,
    /// Readings of the tracer.
    tracer: u64,
    pub(super) residuals: u64,
    /// Samples that came.
    pub(super) count: u64,
    /// Sequence that is due next.
    pub(super) next: u64,
    /// Verification points of the first pass, of the pass under way, and of the latest that is over.
    pub(super) first_points: Vec<CorrectedCoordinates>,
    coming_points: Vec<CorrectedCoordinates>,
    latest_points: Vec<CorrectedCoordinates>,
    /// Model of the first sample; first sample of another.
    first_model: Option<Sha256>,
    new_model_from: Option<u64>,
    statuses: BTreeSet<&'static str>,
    /// Sequence, and when it came in seconds of the host's monotonic clock.
    times: Vec<(u64, f64)>,
}

impl Taken {
    pub(super) fn of(bag: &Bag) -> Taken {
        Taken {
            recorded: bag.scale_readings as u64,
            first_point: bag.first_point,
            tracer: bag.tracer_readings,
            residuals: 0,
            count: 0,
            next: 0,
            first_points: Vec::new(),
            coming_points: Vec::new(),
            latest_points: Vec::new(),
            first_model: None,
            new_model_from: None,
            statuses: BTreeSet::new(),
            times: Vec::with_capacity(bag.scale_readings),
        }
    }

    pub(super) fn take(&mut self, sample: CorrectedCoordinates) {
        self.times.push((sample.sequence, monotonic_s()));
        self.count += 1;
        self.next = sample.sequence + 1;
        self.statuses.insert(sample.status.name());
        if *self.first_model.get_or_insert(sample.model_sha256) != sample.model_sha256 {
            self.new_model_from.get_or_insert(sample.sequence);
        }
        let Some(place) = sample.sequence.checked_sub(self.first_point) else { return };
        if place % self.points() == 0 {
            self.coming_points.clear();
        }
        self.coming_points.push(sample);
        if place < self.points() {
            self.first_points.push(sample);
        }
        if self.coming_points.len() as u64 == self.points() {
            self.latest_points = std::mem::take(&mut self.coming_points);
        }
    }

    fn points(&self) -> u64 {
        (self.recorded - self.first_point).max(1)
    }

    /// Whether all of the recording have come.
    pub(super) fn is_played(&self) -> bool {
        self.next >= self.recorded
    }

    /// Whether the monitor has judged every reading of the tracer.
    pub(super) fn is_judged(&self) -> bool {
        self.residuals >= self.tracer
    }

    /// Words for what the samples say of themselves.
    pub(super) fn by_what(&self) -> String {
        let names: Vec<String> = self.statuses.iter().map(|name| name.to_lowercase().replace('_', " ")).collect();
        names.join(" or ")
    }

    /// First sample that another model than the first corrected.
    pub(super) fn first_of_new_model(&self) -> Option<u64> {
        self.new_model_from
    }

    /// The verification points of the latest pass of which all have come.
    pub(super) fn last_points(&self) -> Option<&[CorrectedCoordinates]> {
        (!self.latest_points.is_empty()).then_some(self.latest_points.as_slice())
    }

    /// Latencies of all samples, sorted; empty where the scale node did not say when it began.
    pub(super) fn latencies_us(&self, summaries: &[NodeSummary], rate_hz: f64) -> Vec<f64> {
        let scale = summaries.iter().find(|summary| summary.node == NodeName::Scale.name());
        let Some(started_s) = scale.and_then(|summary| summary.figures.get(STARTED)) else { return Vec::new() };
        let latency = |(sequence, at_s): &(u64, f64)| (at_s - started_s - *sequence as f64 / rate_hz) * 1e6;
        let mut latencies: Vec<f64> = self.times.iter().map(latency).collect();
        latencies.sort_by(f64::total_cmp);
        latencies
    }
}
