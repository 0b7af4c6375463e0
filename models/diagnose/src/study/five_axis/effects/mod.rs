//! Effects of a five-axis machine with a fork head: one file an effect, one line each in [`REGISTRY`].
//!
//! Place in the flow: the five-axis study makes candidates of them. An effect is linear in its parameters on what it
//! moves ([`Acts`]); the exact chain does the rest. Metres, radians.

use super::chain::{Acts, Pose};
use crate::explanation::Explanation;

mod a_gain;
mod a_harmonic;
mod a_tilt;
mod a_zero;
mod axis_offset;
mod c_gain;
mod c_harmonic;
mod c_tilt;
mod c_zero;
mod distance_scale;
mod head_sag;
mod linear_scale;
mod linear_squareness;

/// Takes parameter, what it moves, and by how much a unit of the parameter moves it (SI).
pub(super) type Motion<'a> = dyn FnMut(usize, Acts, f64) + 'a;

/// A parameter of an effect.
#[derive(Debug, Clone, Copy)]
pub(super) struct Unknown {
    pub(super) name: &'static str,
    /// SI unit.
    pub(super) unit: &'static str,
    /// Magnitude beyond which it is not believed, SI.
    pub(super) plausible: f64,
}

/// One registered effect.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known {
    /// In words; where it makes several candidates, the names of the parameters follow.
    pub(super) name: &'static str,
    pub(super) formula: &'static str,
    /// Typical size in the literature.
    pub(super) typical: &'static str,
    pub(super) source: &'static str,
    pub(super) kind: Explanation,
    pub(super) decided_by: &'static str,
    pub(super) unknowns: &'static [Unknown],
    /// Parameters that make one candidate; each list is a candidate of its own.
    pub(super) groups: &'static [&'static [usize]],
    /// What a unit of each parameter does in this pose.
    pub(super) motion: fn(&Pose, &mut Motion),
}

/// Every effect: the one place where a new one is entered.
pub(super) const REGISTRY: &[Known] = &[
    a_gain::KNOWN,
    a_harmonic::KNOWN,
    a_tilt::KNOWN,
    a_zero::KNOWN,
    axis_offset::KNOWN,
    c_gain::KNOWN,
    c_harmonic::KNOWN,
    c_tilt::KNOWN,
    c_zero::KNOWN,
    distance_scale::KNOWN,
    head_sag::KNOWN,
    linear_scale::KNOWN,
    linear_squareness::KNOWN,
];

/// Largest angle of a flaw believed (rad): 1 mrad is 0.5 mm at the end of half a metre.
pub(super) const ANGLE: f64 = 1e-3;
/// Largest offset believed (m).
pub(super) const LENGTH: f64 = 1e-3;

#[cfg(test)]
pub(super) mod tests {
    use super::super::chain::{Flaws, point};
    use super::*;
    use abbe_geometry::Vector3;

    /// Where the effect moves the probed point (m), exactly, for a probe of 0.5 m straight down.
    pub(super) fn moved_m(known: &Known, a_deg: f64, c_deg: f64, values: &[f64]) -> Vector3<f64> {
        let reading_m = Vector3::new(0.4, 0.2, 0.6);
        let pose = Pose { a_rad: a_deg.to_radians(), c_rad: c_deg.to_radians(), distance_m: 0.1, reading_m };
        let at = |flaws: &Flaws| {
            let (direction, zero_m) = (Vector3::new(0.0, 0.0, -1.0), Vector3::new(0.0, 0.0, -0.4));
            let point = point(&pose, flaws, &direction, &zero_m);
            point.constant_m + point.turn * (direction * point.distance_m + zero_m)
        };
        let mut flaws = [0.0; Acts::COUNT];
        (known.motion)(&pose, &mut |k, acts, amount| flaws[acts.index()] += amount * values[k]);
        at(&flaws) - at(&[0.0; Acts::COUNT])
    }

    #[track_caller]
    pub(super) fn assert_moves(known: &Known, [a_deg, c_deg]: [f64; 2], values: &[f64], expected_m: [f64; 3]) {
        let moved = moved_m(known, a_deg, c_deg, values);
        assert!((moved - Vector3::from(expected_m)).norm() < 2e-9, "{moved:?}, not {expected_m:?}");
    }

    #[test]
    fn every_effect_is_documented_and_does_nothing_at_zero() {
        for known in REGISTRY {
            assert!([known.formula, known.typical, known.source, known.decided_by].iter().all(|text| text.len() > 8));
            let grouped: usize = known.groups.iter().map(|group| group.len()).sum();
            assert_eq!(grouped, known.unknowns.len(), "{}: each parameter is tested once", known.name);
            assert!(moved_m(known, 40.0, 20.0, &vec![0.0; known.unknowns.len()]).norm() < 1e-16, "{}", known.name);
            for k in 0..known.unknowns.len() {
                let unit: Vec<f64> = (0..known.unknowns.len()).map(|j| if j == k { 1e-4 } else { 0.0 }).collect();
                assert!(moved_m(known, 40.0, 20.0, &unit).norm() > 1e-6, "{} parameter {k} moves nothing", known.name);
            }
        }
    }
}
