//! How well a field predicts points that it was not made of.
//!
//! Place in the flow: a seeded split of the measured points, a method made of one part, scored on the other. RMSE and
//! agreement R² by direction, with Δ = predicted − measured: RMSE² = Σ Δ²/N, R² = 1 − Σ Δ² / Σ (measured − mean)².
//! Source: Chen 2020 eq. 14-19, read as above, and its 65 % of the points that interpolate.

use crate::interpolator::Interpolator;
use nalgebra::Vector3;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use thiserror::Error;

/// Share of the points that interpolate in Chen 2020.
pub const INTERPOLATING_SHARE: f64 = 0.65;

/// A split of points.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Split {
    /// Indices of the points that the method is made of, ascending.
    pub interpolating: Vec<usize>,
    /// Indices of the points that score it, ascending.
    pub scoring: Vec<usize>,
}

/// A split that leaves one side without points.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("a share of {share} of {points} points leaves one side empty; give a share between 0 and 1")]
pub struct SplitError {
    /// Asked for.
    pub share: f64,
    /// Points there are.
    pub points: usize,
}

/// Deals points at random into a share that interpolates and the rest that scores.
pub fn split(points: usize, share: f64, seed: u64) -> Result<Split, SplitError> {
    let count = (share * points as f64).round();
    if !(share.is_finite() && count >= 1.0 && count < points as f64) {
        return Err(SplitError { share, points });
    }
    let mut order: Vec<usize> = (0..points).collect();
    order.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    let mut scoring = order.split_off(count as usize);
    order.sort_unstable();
    scoring.sort_unstable();
    Ok(Split { interpolating: order, scoring })
}

/// Score of a set of points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score {
    /// Points in it.
    pub points: usize,
    /// Root mean square of predicted − measured, by direction (m).
    pub rmse_m: Vector3<f64>,
    /// Largest absolute difference, by direction (m).
    pub largest_m: Vector3<f64>,
    /// Agreement R² by direction; `None` where the measured errors do not differ.
    pub r2: [Option<f64>; 3],
}

/// A method's score.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scores {
    /// All points that were answered; `None` if there were none.
    pub all: Option<Score>,
    /// Those of them among the measured points.
    pub inside: Option<Score>,
    /// Points for which the method has no answer.
    pub unanswered: usize,
}

/// Scores a method on points with measured errors (m) that it was not made of.
pub fn score(method: &dyn Interpolator, measured: &[(Vector3<f64>, Vector3<f64>)]) -> Scores {
    let (mut all, mut inside, mut unanswered) = (Vec::new(), Vec::new(), 0);
    for (point, measured) in measured {
        match method.at(point) {
            Ok(found) => {
                all.push((found.error_m, *measured));
                if found.region.is_inside() {
                    inside.push((found.error_m, *measured));
                }
            }
            Err(_) => unanswered += 1,
        }
    }
    Scores { all: score_of(&all), inside: score_of(&inside), unanswered }
}

/// Score of pairs of predicted and measured errors (m); `None` without pairs.
pub fn score_of(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> Option<Score> {
    if pairs.is_empty() {
        return None;
    }
    let count = pairs.len() as f64;
    let mean = pairs.iter().map(|(_, measured)| measured).sum::<Vector3<f64>>() / count;
    let (mut square, mut spread, mut largest_m) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
    for (predicted, measured) in pairs {
        let (missed, from_mean): (Vector3<f64>, Vector3<f64>) = (predicted - measured, measured - mean);
        square += missed.component_mul(&missed);
        spread += from_mean.component_mul(&from_mean);
        largest_m = largest_m.zip_map(&missed, |largest: f64, m: f64| largest.max(m.abs()));
    }
    let r2 = [0, 1, 2].map(|d| (spread[d] > 0.0).then(|| 1.0 - square[d] / spread[d]));
    Some(Score { points: pairs.len(), rmse_m: (square / count).map(f64::sqrt), largest_m, r2 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::idw::{EXPONENT, Idw, Reference};
    use crate::measured::MeasuredField;
    use crate::measured::tests::lattice;
    use crate::trilinear::Trilinear;

    #[test]
    fn a_split_deals_every_point_once_and_depends_on_the_seed_alone() {
        let dealt = split(92, INTERPOLATING_SHARE, 5).unwrap();
        assert_eq!((dealt.interpolating.len(), dealt.scoring.len()), (60, 32));
        let mut all = [dealt.interpolating.clone(), dealt.scoring.clone()].concat();
        all.sort_unstable();
        assert_eq!(all, (0..92).collect::<Vec<_>>());
        assert_eq!(split(92, INTERPOLATING_SHARE, 5).unwrap(), dealt);
        assert_ne!(split(92, INTERPOLATING_SHARE, 6).unwrap(), dealt);
        for share in [0.0, 1.0, -1.0, f64::NAN, 7.0] {
            assert!(split(92, share, 5).is_err(), "{share}");
        }
    }

    #[test]
    fn scores_are_those_worked_out_by_hand() {
        // Misses 1 and −3 in x: rmse √5; measured 0 and 4 spread 8 about their mean: R² = 1 − 10/8.
        let v = |x: f64| Vector3::new(x, 1.0, 0.0) * 1e-6;
        let score = score_of(&[(v(1.0), v(0.0)), (v(1.0), v(4.0))]).unwrap();
        assert!((score.rmse_m.x - 5.0_f64.sqrt() * 1e-6).abs() < 1e-18);
        assert!((score.r2[0].unwrap() + 0.25).abs() < 1e-12);
        assert_eq!((score.r2[1], score.largest_m), (None, Vector3::new(3e-6, 0.0, 0.0)));
        assert_eq!(score_of(&[]), None);
    }

    #[test]
    fn points_beyond_the_measured_ones_and_without_answer_are_told_apart() {
        let errors = |points: &[Vector3<f64>]| points.iter().map(|p| p * 1e-6).collect::<Vec<_>>();
        let points = lattice([3, 3, 3], 0.1);
        let made = MeasuredField::new(points.clone(), errors(&points), None).unwrap();
        let mut targets = lattice([3, 3, 3], 0.05).iter().map(|p| p + Vector3::repeat(0.01)).collect::<Vec<_>>();
        targets[4].z = 0.9;
        let measured: Vec<_> = targets.iter().copied().zip(errors(&targets)).collect();
        let scored = score(&Trilinear::new(&made), &measured);
        assert_eq!((scored.all.unwrap().points, scored.inside.unwrap().points, scored.unanswered), (27, 26, 0));
        assert!(scored.all.unwrap().rmse_m.norm() < 1e-18);
        let near = Idw::new(&made, Reference::Within { radius_m: 0.1 }, EXPONENT).unwrap();
        assert_eq!(score(&near, &measured).unanswered, 1);
    }
}
