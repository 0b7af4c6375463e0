//! What effects of a model ask of a live sample, and the scale readings that carry it.
//!
//! Place in the flow: under the monitor's step and the residual node. Scale readings go in as they come; the covariates of a corrected sample come
//! out, found by stamp and sequence, which the correction repeats. In the unit of their names.

use super::geometric::SampleCovariates;
use abbe_geometry::model::MachineModel;
use abbe_msgs::{CorrectedCoordinates, Covariates, ScaleReading};
use std::collections::BTreeMap;

/// Scale readings kept for samples that come later: 4 s at 1 kHz, some 7 MB.
const KEPT: usize = 4096;

/// What a model asks for.
pub(super) struct Asked {
    /// Whether an effect reads a covariate, for the tip or for the range.
    pub(super) covariates: bool,
    /// Lines of its campaign that effects name: a live line of that name need not be the same run.
    pub(super) runs: Vec<String>,
}

impl Asked {
    pub(super) fn by(model: &MachineModel) -> Asked {
        let effects = || model.parts().effects.iter().map(|fitted| &fitted.effect);
        Asked {
            covariates: effects().any(|effect| !effect.reads().is_empty()),
            runs: effects().flat_map(|effect| effect.runs()).collect(),
        }
    }
}

/// The newest scale readings.
pub(crate) struct Scales {
    max_age_s: f64,
    /// Sequence and covariates by stamp (ns).
    kept: BTreeMap<i64, (u64, Covariates)>,
}

impl Scales {
    pub(crate) fn new(max_age_s: f64) -> Scales {
        Scales { max_age_s, kept: BTreeMap::new() }
    }

    pub(crate) fn keep(&mut self, reading: &ScaleReading) {
        let stamp = reading.stamp.to_nanos();
        // Of a clock that was set back, what lies ahead is of another time.
        if self.latest().is_some_and(|latest| stamp < latest) {
            self.kept.retain(|kept, _| *kept < stamp);
        }
        self.kept.insert(stamp, (reading.sequence, reading.covariates));
        if self.kept.len() > KEPT {
            self.kept.pop_first();
        }
    }

    /// Stamp (ns) of the latest that came: none that is kept is newer.
    fn latest(&self) -> Option<i64> {
        self.kept.last_key_value().map(|(stamp, _)| *stamp)
    }

    /// Whether the scale reading of a sample has not come and may still do so: they come in the order of their stamps.
    pub(crate) fn may_come(&self, sample: &CorrectedCoordinates) -> bool {
        let stamp = sample.stamp.to_nanos();
        self.of(sample).is_none() && self.latest().is_none_or(|latest| latest < stamp)
    }

    /// Covariates of a sample.
    pub(super) fn of(&self, sample: &CorrectedCoordinates) -> Option<SampleCovariates<'_>> {
        self.table(sample).map(|table| SampleCovariates { table, max_age_s: self.max_age_s })
    }

    /// The same as they came.
    pub(crate) fn table(&self, sample: &CorrectedCoordinates) -> Option<&Covariates> {
        let (sequence, table) = self.kept.get(&sample.stamp.to_nanos())?;
        (*sequence == sample.sequence).then_some(table)
    }
}
