//! Expansions of scales, and turns of one axis against another, that a campaign cannot rule out.
//!
//! Place in the flow: identification and diagnosis state them, [`mod@crate::correct`] widens coordinates by them. Every scale expands.
//! Where its temperature went along with the stations, stations and errors take nearly all of that, and "nothing was seen" hides
//! micrometres a metre and kelvin. A coordinate holds at the temperature at which the machine was measured; elsewhere its standard
//! uncertainty along each axis is
//!
//! > u = s · |T − T₀| · |r − r₀|
//!
//! s is what the data leave open of the expansion (1/K), T₀ the temperature at which that axis was measured (°C), r₀ the middle of the
//! readings (m): where a scale is fixed moves all points alike. Of several temperatures that one counts which says most. One that is
//! missing is as far away as the campaign saw it. What the fit took of such an expansion for its own, since not all lines were measured at
//! T₀, stands in the covariance of its parameters: as directions in which they may all be off together.
//!
//! Machines bend as they warm, and what a small campaign sees least of it turns one axis against another. So a squareness error has the
//! same: s in rad/K, and r the reading of the axis that it tilts.

use crate::axis::Axis;
use crate::effects::{CovariateSource, CovariateValue, NoCovariates, State};
use crate::machine::Squareness;
use crate::model_error::ModelError;
use nalgebra::Vector3;

/// What the data leave open of the expansions of the scales.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct UnseenExpansions {
    /// With each temperature that was logged.
    pub by_sensor: Vec<UnseenExpansion>,
    /// What the fit takes of them: of all parameters (geometry, effects, stations), by how much they may be off together (k = 1).
    pub absorbed: Vec<Vec<f64>>,
}

/// What the data leave open of the expansion of each scale with one temperature, and of each squareness error.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct UnseenExpansion {
    /// Covariate (°C).
    pub sensor: String,
    /// Standard deviation of the expansion of X, Y and Z (1/K); 0 where an effect of the model holds it.
    pub per_kelvin: [f64; 3],
    /// Temperature at which X, Y and Z were measured (°C).
    pub at_c: [f64; 3],
    /// Standard deviation of the change of each squareness error, in the order of [`crate::machine::Machine::squareness`] (rad/K).
    pub squareness_per_kelvin: [f64; 3],
    /// Temperature at which each was measured (°C).
    pub squareness_at_c: [f64; 3],
}

/// An expansion with the range of its sensor in the campaign (°C), where that is known.
pub(crate) type Ranged = (UnseenExpansion, Option<(f64, f64)>);

/// What expansions that the campaign cannot rule out do to a metre of each axis at the coldest or warmest that was logged (m/m, k = 1).
pub(crate) fn at_the_ends(all: &[Ranged]) -> [f64; 3] {
    most(all, &NoCovariates).scales
}

/// What turns that it cannot rule out do to each squareness error there (rad, k = 1).
pub(crate) fn turned_at_the_ends(all: &[Ranged]) -> [f64; 3] {
    most(all, &NoCovariates).squareness
}

/// How far each scale (m/m) and each squareness error (rad) may be off.
struct Off {
    scales: [f64; 3],
    squareness: [f64; 3],
}

/// Of several temperatures that which says most.
fn most(all: &[Ranged], covariates: &dyn CovariateSource) -> Off {
    let mut most = Off { scales: [0.0; 3], squareness: [0.0; 3] };
    for (unseen, range_c) in all {
        // A problem in words would be made for each sample that lacks it.
        let known = match covariates.covariate(&unseen.sensor) {
            CovariateValue::Fresh(value) => Some(value),
            _ => None,
        };
        let away = |at_c: f64| {
            let away = |value: f64| (value - at_c).abs();
            known.map_or_else(|| range_c.map_or(0.0, |(low, high)| away(low).max(away(high))), away)
        };
        for k in 0..3 {
            most.scales[k] = most.scales[k].max(unseen.per_kelvin[k] * away(unseen.at_c[k]));
            let turned = unseen.squareness_per_kelvin[k] * away(unseen.squareness_at_c[k]);
            most.squareness[k] = most.squareness[k].max(turned);
        }
    }
    most
}

impl UnseenExpansion {
    /// Takes what another fit of the same data leaves open, where that is more; what an effect holds stays held.
    pub fn widen(&mut self, other: &UnseenExpansion) {
        let scales = self.per_kelvin.iter_mut().zip(other.per_kelvin);
        for (own, other) in scales.chain(self.squareness_per_kelvin.iter_mut().zip(other.squareness_per_kelvin)) {
            *own = if *own > 0.0 { own.max(other) } else { 0.0 };
        }
    }

    /// Whether nothing is open with this temperature.
    pub fn is_none(&self) -> bool {
        self.per_kelvin.iter().chain(&self.squareness_per_kelvin).all(|open| *open == 0.0)
    }

    /// Refuses what is none.
    pub(crate) fn check(&self) -> Result<(), ModelError> {
        let refused = |what| Err(ModelError::UnseenExpansion { sensor: self.sensor.clone(), what });
        let open = || self.per_kelvin.iter().chain(&self.squareness_per_kelvin);
        if !open().chain(&self.at_c).chain(&self.squareness_at_c).all(|value| value.is_finite()) {
            return refused("a number is not finite");
        }
        if open().any(|u| *u < 0.0) {
            return refused("a standard deviation is below zero");
        }
        Ok(())
    }
}

/// Variance along X, Y and Z (m²) by what the campaign cannot rule out; each with the range of its sensor. `middle_m` are the readings in the
/// middle of those identified.
pub(crate) fn variance_m2(
    all: &[Ranged],
    squareness: &[Squareness; 3],
    middle_m: [f64; 3],
    state: &State,
) -> Vector3<f64> {
    let lever_m = |axis: Axis| state.reading_m[axis.index()] - middle_m[axis.index()];
    let most = most(all, state.covariates);
    let mut total_m2 = Vector3::from_fn(|d, _| (most.scales[d] * lever_m(Axis::ALL[d])).powi(2));
    for (turned, own) in most.squareness.iter().zip(squareness) {
        total_m2[own.moves().index()] += (turned * lever_m(own.tilts)).powi(2);
    }
    total_m2
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Logged(f64, f64);

    impl CovariateSource for Logged {
        fn covariate(&self, name: &str) -> CovariateValue {
            CovariateValue::Fresh(if name == "temp_scale_x_c" { self.0 } else { self.1 })
        }
    }

    /// Y turned about Z moves X, Z about Y moves X, and Z about X moves Y.
    fn squareness() -> [Squareness; 3] {
        [("C0Y", Axis::Y, Axis::Z), ("B0Z", Axis::Z, Axis::Y), ("A0Z", Axis::Z, Axis::X)]
            .map(|(name, tilts, about)| Squareness { name: name.to_owned(), tilts, about })
    }

    fn all() -> Vec<Ranged> {
        let of = |name: &str, per_kelvin, range| {
            let at_c = [20.0, 21.0, 20.0];
            let unseen = UnseenExpansion { sensor: name.to_owned(), per_kelvin, at_c, ..UnseenExpansion::default() };
            (unseen, Some(range))
        };
        vec![of("temp_scale_x_c", [2e-6, 1e-6, 0.0], (19.0, 22.0)), of("temp_air_c", [1e-6, 0.0, 0.0], (15.0, 22.0))]
    }

    fn u_m(all: &[Ranged], source: &dyn CovariateSource) -> [f64; 3] {
        let state = State { reading_m: [0.9, 0.1, 0.3], offset_m: [0.0; 3], covariates: source };
        variance_m2(all, &squareness(), [0.4, 0.3, 0.3], &state).map(f64::sqrt).into()
    }

    fn near(found: [f64; 3], expected: [f64; 3]) {
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?} {expected:?}");
    }

    #[test]
    fn a_coordinate_is_uncertain_by_what_was_not_seen_times_the_distance_in_kelvin_and_metres() {
        near(u_m(&all(), &Logged(20.0, 20.0)), [0.0, 0.2e-6, 0.0]);
        // Half a metre from the middle, three kelvin warm: 2 µm/(m·K) by the one sensor, 1 by the other.
        near(u_m(&all(), &Logged(23.0, 20.0)), [3e-6, 0.4e-6, 0.0]);
        near(u_m(&all(), &Logged(20.5, 26.0)), [3e-6, 0.1e-6, 0.0]);
    }

    #[test]
    fn what_is_missing_is_as_far_away_as_it_was() {
        near(u_m(&all(), &NoCovariates), [2.5e-6, 0.4e-6, 0.0]);
        near(at_the_ends(&all()), [5e-6, 2e-6, 0.0]);
    }

    #[test]
    fn a_turn_moves_the_third_axis_by_the_distance_of_the_axis_that_it_tilts() {
        let mut all = all();
        all[0].0.squareness_per_kelvin = [3e-6, 4e-6, 0.0];
        all[0].0.squareness_at_c = [21.0, 20.0, 20.0];
        // Nothing of Z, which stands in its middle; of C0Y 3 µrad/K, two kelvin and 0.2 m.
        let expansion_m: f64 = 3e-6;
        near(u_m(&all, &Logged(23.0, 20.0)), [expansion_m.hypot(1.2e-6), 0.4e-6, 0.0]);
        assert_eq!(turned_at_the_ends(&all), [3e-6 * 2.0, 4e-6 * 2.0, 0.0]);
    }
}
