//! What residual vectors leave open of the expansion of each scale with each temperature that was logged.
//!
//! Place in the flow: beside the study's problem, for the model that is made of it. SI, 1/K.

use super::super::quantities::POSITION;
use super::super::registered::Registered;
use super::{Part, Vectors};
use crate::columns::range;
use crate::linear::joined;
use crate::study::candidate::{Open, Study};
use abbe_geometry::Axis;
use abbe_geometry::effects::ShapeValue;
use abbe_geometry::seen::TEMPERATURE;
use abbe_geometry::unseen_expansion::UnseenExpansion;
use faer::Mat;

/// Unit of what an expansion has first.
const PER_KELVIN: &str = "1/K";

impl Vectors<'_> {
    pub(super) fn unseen(&self, open: &Open) -> Vec<UnseenExpansion> {
        let names = self.logged().into_iter().filter(|name| name.ends_with(TEMPERATURE));
        let one = |sensor: String| {
            let values = self.vectors.iter().filter_map(|vector| vector.covariates.get(&sensor));
            let (count, sum) = values.fold((0.0, 0.0), |(count, sum), value| (count + 1.0, sum + value));
            let per_kelvin = Axis::ALL.map(|axis| {
                let is_held = open.found.iter().any(|k| self.stretches(*k, axis));
                if is_held || !self.measured[axis.index()] {
                    return 0.0;
                }
                let expansion = self.expansion(axis, &sensor);
                open.overlooked_per_k(expansion).max(open.instead_per_k(expansion))
            });
            UnseenExpansion { per_kelvin, at_c: [sum / f64::max(count, 1.0); 3], sensor, ..UnseenExpansion::default() }
        };
        names.map(one).collect()
    }

    /// Each scale as far from what it was at its mean temperature as the data leave open, about the middle of its readings; none where
    /// no machine is known, and so no scale.
    pub(super) fn columns_of_unseen(&self, unseen: &[UnseenExpansion]) -> Mat<f64> {
        if self.machine.is_none() {
            return Mat::zeros(0, 0);
        }
        let columns: Vec<Mat<f64>> = Axis::ALL.into_iter().filter_map(|axis| self.most_of(axis, unseen)).collect();
        joined(&columns)
    }

    fn most_of(&self, axis: Axis, unseen: &[UnseenExpansion]) -> Option<Mat<f64>> {
        let d = axis.index();
        let readings_m = || self.vectors.iter().map(|vector| vector.position_m[d]);
        let (low_m, high_m) = range(readings_m());
        let column = |own: &UnseenExpansion| {
            let mut column = Mat::zeros(3 * self.vectors.len(), 1);
            for (k, (vector, reading_m)) in self.vectors.iter().zip(readings_m()).enumerate() {
                let above_k = vector.covariates.get(&own.sensor).map_or(0.0, |value| value - own.at_c[d]);
                let moved_m = own.per_kelvin[d] * above_k * (reading_m - 0.5 * (low_m + high_m));
                column[(3 * k + d, 0)] = moved_m / self.sigma_m[k][d];
            }
            column
        };
        let open = unseen.iter().filter(|own| own.per_kelvin[d] > 0.0).map(column);
        open.max_by(|a, b| a.squared_norm_l2().total_cmp(&b.squared_norm_l2()))
    }

    /// Whether a candidate says what a temperature does to a scale: it stretches it.
    fn stretches(&self, candidate: usize, axis: Axis) -> bool {
        let reads = self.model_covariates(candidate);
        let position = POSITION[axis.index()];
        match &self.parts[candidate] {
            Part::Registered(own) => is_expansion(own, axis),
            Part::Smooth(own, _) => {
                let along = self.candidates[candidate].covariates.iter().any(|name| name == position);
                *own == axis && along && reads.iter().any(|name| name.ends_with(TEMPERATURE))
            }
            Part::Step(..) | Part::Wave(_) | Part::Angle(_) | Part::Named(_) | Part::Drift(_) => false,
        }
    }

    /// The expansion of an axis with a temperature, where it is a candidate.
    fn expansion(&self, axis: Axis, sensor: &str) -> Option<usize> {
        let is_it = |part: &Part| match part {
            Part::Registered(own) => is_expansion(own, axis) && own.effect.reads() == [sensor],
            _ => false,
        };
        self.parts.iter().position(is_it)
    }
}

/// Whether an effect is an expansion of this axis, by what it has first.
fn is_expansion(own: &Registered, axis: Axis) -> bool {
    let of_axis = Some(&ShapeValue::Text(axis.lower().to_owned()));
    let is_per_kelvin = own.effect.parameters().first().is_some_and(|first| first.unit == PER_KELVIN);
    is_per_kelvin && own.shape.0.get("axis") == of_axis
}
