//! How rough an error function may be, and where along the stroke: the matrix of its penalty.
//!
//! Place in the flow: [`crate::smoothing`] multiplies it by λ. Roughness is ∫ w(t) f″(t)² dt over the unit stroke with
//! w = (4t(1 − t))^e: with e = 0 all places are alike, with e > 0 the ends may bend more than the middle, as guideways
//! do where the carriage overhangs. One exponent holds for the whole machine and is chosen by the data: it decides how
//! certain a function is between the first measured point and the end where the gauge makes it zero, and a wrong one
//! makes the machine frame too certain (with e = 0 the 95 % intervals held 89 % where the truth bent at the ends).

use crate::linear::symmetric_eigen;
use abbe_geometry::error_function::{Basis, Closure, FunctionKind, LocalBasis};
use faer::Mat;
use std::sync::Arc;

/// Abscissae and weights of Gauss' rule with four points on 0 … 1, exact to degree 7.
const GAUSS: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
    (0.330_009_478_207_571_87, 0.326_072_577_431_273_07),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
];
/// How far inside an interval its ends are evaluated, as a share of it, so that its own pieces answer.
const INSIDE: f64 = 1e-9;

/// f″ of a spline's functions at the points of the quadrature.
#[derive(Debug, Clone)]
pub(crate) struct Curvature {
    size: usize,
    /// Functions that a straight line needs, squared and summed; 1 where the closure leaves no line.
    line_square: f64,
    rank: usize,
    /// Shared: a search that tries a step copies what it may have to go back to.
    points: Arc<[Point]>,
}

#[derive(Debug, Clone)]
struct Point {
    /// ln 4t(1 − t), which is not above zero.
    log_profile: f64,
    share: f64,
    second: Vec<(usize, f64)>,
}

/// Roughness matrix at one exponent, and what its choice needs.
#[derive(Debug, Clone)]
pub(crate) struct Roughness {
    /// Row-major square.
    pub(crate) matrix: Vec<f64>,
    /// Derivative of the matrix by the exponent.
    pub(crate) slope: Vec<f64>,
    /// Sum of the logarithms of the matrix' non-zero eigenvalues, less that of the line's squared coefficients: makes
    /// likelihoods of splines with different intervals comparable.
    pub(crate) log_determinant: f64,
    /// tr(S⁺S′), the derivative of the log determinant by the exponent.
    pub(crate) log_determinant_slope: f64,
    /// tr((S⁺S′)²), what a curve known exactly would tell of the exponent.
    pub(crate) information: f64,
}

impl Curvature {
    /// Curvature of one spline; `None` for other kinds and where there is no curvature to penalise.
    pub(crate) fn new(basis: &Basis) -> Option<Curvature> {
        let FunctionKind::BSpline { intervals } = basis.kind() else { return None };
        let open = basis.closure() == Closure::Origin;
        let line_square = if open { basis.coefficients_of_power(1).iter().map(|c| c * c).sum() } else { 1.0 };
        let rank = basis.len() - usize::from(open);
        let points = (0..intervals).flat_map(|k| GAUSS.map(|(at, share)| Point::new(basis, intervals, k, at, share)));
        let curvature = Curvature { size: basis.len(), line_square, rank, points: points.collect() };
        (rank > 0).then_some(curvature)
    }

    /// Dimension of the curved shapes.
    pub(crate) fn rank(&self) -> usize {
        self.rank
    }

    /// The penalty's matrix with this exponent of the profile; `None` if it cannot be decomposed.
    pub(crate) fn at(&self, exponent: f64) -> Option<Roughness> {
        let n = self.size;
        let (mut matrix, mut slope) = (vec![0.0; n * n], vec![0.0; n * n]);
        for point in self.points.iter() {
            let weight = point.share * (exponent * point.log_profile).exp();
            for (i, a) in &point.second {
                for (j, b) in &point.second {
                    matrix[i * n + j] += weight * a * b;
                    slope[i * n + j] += weight * point.log_profile * a * b;
                }
            }
        }
        let (values, vectors) = symmetric_eigen(&Mat::from_fn(n, n, |i, j| matrix[i * n + j]))?;
        // The straight line is the one shape without curvature; its eigenvalue comes first.
        let line = n - self.rank;
        let rotated = vectors.transpose() * Mat::from_fn(n, n, |i, j| slope[i * n + j]) * &vectors;
        let curved = || line..n;
        let information = curved()
            .flat_map(|i| curved().map(move |j| (i, j)))
            .map(|(i, j)| rotated[(i, j)] * rotated[(j, i)] / (values[i] * values[j]))
            .sum();
        Some(Roughness {
            log_determinant: curved().map(|k| values[k].ln()).sum::<f64>() - self.line_square.ln(),
            log_determinant_slope: curved().map(|k| rotated[(k, k)] / values[k]).sum(),
            information,
            matrix,
            slope,
        })
    }
}

impl Point {
    /// Second derivatives at a share of interval `k`: in an interval f is a cubic, so that its second differences are
    /// exact at a third and two thirds and f″ is the straight line through them.
    fn new(basis: &Basis, intervals: usize, k: usize, at: f64, share: f64) -> Point {
        let width = 1.0 / intervals as f64;
        let (first, second) = (2.0 - 3.0 * at, 3.0 * at - 1.0);
        let mut sums = vec![0.0; basis.len()];
        for (m, factor) in [first, second - 2.0 * first, first - 2.0 * second, second].into_iter().enumerate() {
            let local = local(basis, (k as f64 + (m as f64 / 3.0).clamp(INSIDE, 1.0 - INSIDE)) * width);
            let scaled = factor / (width / 3.0).powi(2);
            local.values().iter().enumerate().for_each(|(i, value)| sums[local.first + i] += scaled * value);
        }
        let t = (k as f64 + at) * width;
        let second = sums.into_iter().enumerate().filter(|(_, value)| *value != 0.0).collect();
        Point { log_profile: (4.0 * t * (1.0 - t)).ln(), share: share * width, second }
    }
}

/// Basis functions at a share of the stroke.
fn local(basis: &Basis, t: f64) -> LocalBasis {
    let (lower_m, upper_m) = basis.stroke_m();
    basis.at(lower_m + t * (upper_m - lower_m))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bases() -> Vec<Basis> {
        let kind = FunctionKind::BSpline { intervals: 7 };
        [Closure::Origin, Closure::BothEnds].map(|closure| Basis::new(kind, closure, -0.2, 0.5).unwrap()).to_vec()
    }

    #[test]
    fn without_a_profile_it_is_the_integral_of_the_squared_curvature() {
        for basis in bases() {
            let (own, exact) = (Curvature::new(&basis).unwrap().at(0.0).unwrap(), basis.roughness());
            let largest = exact.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
            assert!(own.matrix.iter().zip(&exact).all(|(a, b)| (a - b).abs() < 1e-6 * largest));
        }
    }

    #[test]
    fn derivatives_by_the_exponent_agree_with_differences() {
        for basis in bases() {
            let curvature = Curvature::new(&basis).unwrap();
            let (below, at, above) =
                (curvature.at(0.69).unwrap(), curvature.at(0.7).unwrap(), curvature.at(0.71).unwrap());
            let difference = (above.log_determinant - below.log_determinant) / 0.02;
            assert!((difference / at.log_determinant_slope - 1.0).abs() < 1e-3, "{difference}");
            for k in 0..at.slope.len() {
                let difference = (above.matrix[k] - below.matrix[k]) / 0.02;
                assert!((difference - at.slope[k]).abs() < 1e-3 * at.slope[k].abs() + 1e-6);
            }
        }
    }
}
