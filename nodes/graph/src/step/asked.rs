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
    /// Whether an effect reads a covariate, for the tip or for the range, or the covariance depends on one.
    pub(super) covariates: bool,
    /// Lines of its campaign that effects name: a live line of that name need not be the same run.
    pub(super) runs: Vec<String>,
}

impl Asked {
    pub(super) fn by(model: &MachineModel) -> Asked {
        let effects = || model.parts().effects.iter().map(|fitted| &fitted.effect);
        Asked {
            covariates: model.is_widened_by_covariates() || effects().any(|effect| !effect.reads().is_empty()),
            runs: effects().flat_map(|effect| effect.runs()).collect(),
        }
    }
}

/// The newest scale readings.
pub(crate) struct Scales {
    max_age_s: f64,
    /// By stamp (ns) and sequence: a box may stamp to the second.
    kept: BTreeMap<(i64, u64), Covariates>,
}

impl Scales {
    pub(crate) fn new(max_age_s: f64) -> Scales {
        Scales { max_age_s, kept: BTreeMap::new() }
    }

    /// From now on, a covariate of more than this age (s) is stale.
    pub(super) fn set_max_age_s(&mut self, max_age_s: f64) {
        self.max_age_s = max_age_s;
    }

    pub(crate) fn keep(&mut self, reading: &ScaleReading) {
        let stamp = reading.stamp.to_nanos();
        // Of a clock that was set back, what lies ahead is of another time.
        if self.latest().is_some_and(|(latest, _)| stamp < latest) {
            self.kept.retain(|(kept, _), _| *kept < stamp);
        }
        self.kept.insert((stamp, reading.sequence), reading.covariates);
        if self.kept.len() > KEPT {
            self.kept.pop_first();
        }
    }

    /// Stamp (ns) and sequence of the latest that came: none that is kept is newer.
    fn latest(&self) -> Option<(i64, u64)> {
        self.kept.last_key_value().map(|(at, _)| *at)
    }

    /// Whether the scale reading of a sample has not come and may still do so: they come in the order of their stamps.
    pub(crate) fn may_come(&self, sample: &CorrectedCoordinates) -> bool {
        let at = (sample.stamp.to_nanos(), sample.sequence);
        self.of(sample).is_none() && self.latest().is_none_or(|latest| latest < at)
    }

    /// Covariates of a sample.
    pub(super) fn of(&self, sample: &CorrectedCoordinates) -> Option<SampleCovariates<'_>> {
        self.table(sample).map(|table| SampleCovariates { table, max_age_s: self.max_age_s })
    }

    /// The same as they came.
    pub(crate) fn table(&self, sample: &CorrectedCoordinates) -> Option<&Covariates> {
        self.kept.get(&(sample.stamp.to_nanos(), sample.sequence))
    }
}

#[cfg(test)]
mod tests {
    use super::super::geometric::GeometricStep;
    use super::*;
    use abbe_msgs::Stamp;

    /// Of readings of one stamp only the last was kept, so that a sample had its covariates or not as the threads went.
    #[test]
    fn regress_readings_of_one_stamp_keep_their_covariates_each() {
        let mut scales = Scales::new(10.0);
        let at = |seconds: i64, sequence: u64| {
            let stamp = Stamp::from_nanos(seconds * 1_000_000_000).unwrap();
            let mut reading = ScaleReading { stamp, sequence, ..ScaleReading::default() };
            reading.covariates.push("temp_air_c", sequence as f64, 0.0).unwrap();
            (reading, GeometricStep::new(None, 10.0).correct(&reading))
        };
        scales.keep(&at(5, 1).0);
        assert!(scales.may_come(&at(5, 2).1) && !scales.may_come(&at(5, 0).1));
        scales.keep(&at(5, 2).0);
        let value =
            |sample: &CorrectedCoordinates| scales.table(sample).and_then(|table| Some(table.get("temp_air_c")?.value));
        assert_eq!([1, 2, 3].map(|sequence| value(&at(5, sequence).1)), [Some(1.0), Some(2.0), None]);
        assert!(scales.may_come(&at(5, 3).1) && !scales.may_come(&at(4, 9).1));
    }
}
