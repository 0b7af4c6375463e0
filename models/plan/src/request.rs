//! What there is and what is wanted: everything that a plan is made from.
//!
//! Place in the flow: filled by the command line from a request file, or by a test. SI, machine frame; nothing here has a
//! hidden default elsewhere. [`crate::check()`] refuses what makes no sense, by the key of the request file.

use abbe_geometry::effects::Wish;
use abbe_geometry::machine::Machine;
use abbe_identify::station_start::StationStart;
use abbe_identify::{Belief, Identified, IdentifyOptions, OrderChoice};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use abbe_measurement::planned::{Goal, Holder, Lines, Motion, Sensor, Stand, Tracer};

/// A campaign already measured, and its fit.
#[derive(Debug, Clone)]
pub struct Measured {
    /// The campaign.
    pub campaign: Campaign,
    /// What was identified from it.
    pub fit: Identified,
}

/// Everything that a plan is made from.
#[derive(Debug, Clone)]
pub struct Request {
    /// The machine.
    pub machine: Machine,
    /// Uncertainty of the tracer's range.
    pub instrument: RangeUncertainty,
    /// How it will be identified: order, absolute ranges.
    pub options: IdentifyOptions,
    /// Scale readings of the volume that matters (m).
    pub volume_m: [(f64, f64); 3],
    /// Offsets of the tips whose points matter (m, ram frame).
    pub tips_m: Vec<[f64; 3]>,
    /// What the tracer can follow.
    pub tracer: Tracer,
    /// Where it may stand.
    pub stands: Vec<Stand>,
    /// Most stations.
    pub most_stations: usize,
    /// Where the reflector may sit.
    pub holders: Vec<Holder>,
    /// Speeds and times.
    pub motion: Motion,
    /// Candidate lines.
    pub lines: Lines,
    /// What is wanted.
    pub goal: Goal,
    /// Effects to be told.
    pub tell: Vec<Wish>,
    /// What will be logged beside the motion.
    pub sensors: Vec<Sensor>,
    /// How much the error functions are believed to bend.
    pub belief: Belief,
    /// Seed of what is drawn: points of the lines, directions.
    pub seed: u64,
    /// What was measured before; the plan then adds to it.
    pub measured: Option<Measured>,
}

/// What is being done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Looking what each stand sees and would tell.
    Stands,
    /// Choosing stations.
    Stations,
    /// Adding lines.
    Lines,
    /// Exchanging lines.
    Exchange,
}

/// One step of progress; the observer returns false to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// What is being done.
    pub stage: Stage,
    /// Steps of it done.
    pub done: usize,
    /// Rms uncertainty over the volume of the best plan so far (m), where there is one.
    pub best_m: Option<f64>,
}

impl Measured {
    /// Its stations where its fit found them.
    pub(crate) fn stations(&self) -> Vec<StationStart> {
        let stations = &self.fit.model.parts().stations;
        stations.iter().map(|s| StationStart { position_m: s.position_m, dead_path_m: s.dead_path_m }).collect()
    }
}

impl Request {
    /// Whether the data will choose how smooth the errors are.
    pub(crate) fn is_penalised(&self) -> bool {
        self.options.order == OrderChoice::Evidence
    }

    /// Variance of repeatability of a point, as a length in space (m²).
    pub(crate) fn repeatability_m2(&self) -> f64 {
        self.machine.repeatability_m.iter().map(|u| u * u).sum()
    }

    /// Mean of the holders' offsets (m, ram frame).
    pub(crate) fn offset_centre_m(&self) -> [f64; 3] {
        abbe_geometry::layout::centre_of(self.holders.iter().map(|holder| holder.offset_m))
    }
}
