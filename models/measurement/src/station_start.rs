//! Position and dead path of a station from nothing but nominal points and lengths.
//!
//! Place in the flow: the start of identification, so that no start values are asked of the user. Squaring
//! |p − S| = d + l gives an equation linear in S, d and |S|² − d² (m, machine frame); a few robust Gauss-Newton
//! steps on the ranges themselves follow. Source: Chen 2020 eq. 1 (same unknowns, there by Levenberg-Marquardt
//! from a given start).

use crate::robust;
use nalgebra::{DMatrix, DVector, Matrix3, Matrix4, Vector3, Vector4};

/// Relative size of the smallest singular value below which the points do not fix the station.
const RANK_TOLERANCE: f64 = 1e-7;
/// Steps towards the least sum of absolute residuals, at most.
const ABSOLUTE_VALUE_STEPS: usize = 40;
/// Step (m) from which the least sum of absolute residuals is near enough.
const CLOSE_M: f64 = 1e-6;
/// Refinements with redescending weights, at most.
const REFINEMENTS: usize = 12;
/// Step (m) that ends the refinements.
const SETTLED_M: f64 = 1e-10;
/// Smallest residual scale (m): less than a machine worth measuring leaves before correction.
const SMALLEST_SCALE_M: f64 = 1e-6;
/// Extent across a plane, as a share of that along it, below which points are flat.
const FLAT: f64 = 1e-3;

/// A nominal point and the length read there (m).
pub type PointAndLength = (Vector3<f64>, f64);

/// A station from nominal points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StationStart {
    /// Centre (m, machine frame).
    pub position_m: Vector3<f64>,
    /// Distance at length zero (m).
    pub dead_path_m: f64,
}

/// Why a station could not be placed; the text says what to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StartError {
    /// Five numbers need five readings.
    #[error("{0} readings cannot place a station (at least 5 are needed); measure more points from it")]
    TooFew(usize),
    /// The points lie in a plane or on a line.
    #[error(
        "its points lie in a plane or on a line, so that its position cannot be found; measure points that fill a volume"
    )]
    Degenerate,
    /// The equations have no real solution.
    #[error(
        "no position is consistent with its lengths; check that x, y, z, the offsets and the lengths belong together"
    )]
    Inconsistent,
}

/// Position and dead path from nominal points; with `absolute` the dead path is zero: a constant of the instrument moves the place, and an
/// adjustment that begins there finds it.
///
/// The linear solution is dragged by gross errors. Least absolute values, whose minimum is one and which up to half
/// of the readings cannot move far, lead back; Hampel's weights then bring full efficiency.
pub fn start(points: &[PointAndLength], absolute: bool) -> Result<StationStart, StartError> {
    if points.len() < 5 {
        return Err(StartError::TooFew(points.len()));
    }
    let mut station = linear(points)?;
    if absolute {
        station.dead_path_m = 0.0;
    }
    for _ in 0..ABSOLUTE_VALUE_STEPS {
        let weights: Vec<f64> =
            points.iter().map(|point| 1.0 / residual_m(&station, point).abs().max(SMALLEST_SCALE_M)).collect();
        if refine(&mut station, points, &weights, absolute)? < CLOSE_M {
            break;
        }
    }
    for _ in 0..REFINEMENTS {
        let residuals: Vec<f64> = points.iter().map(|point| residual_m(&station, point)).collect();
        let scale = robust::scale(&residuals).max(SMALLEST_SCALE_M);
        if refine(&mut station, points, &robust::weights(&residuals, scale), absolute)? < SETTLED_M {
            break;
        }
    }
    Ok(station)
}

/// Measured minus predicted length (m).
pub fn residual_m(station: &StationStart, (point_m, length_m): &PointAndLength) -> f64 {
    length_m - ((point_m - station.position_m).norm() - station.dead_path_m)
}

/// Linear solution of |p|² − l² = 2 p·S + 2 l d − (|S|² − d²), about the centroid for conditioning.
fn linear(points: &[PointAndLength]) -> Result<StationStart, StartError> {
    let centre: Vector3<f64> = points.iter().map(|(p, _)| p).sum::<Vector3<f64>>() / points.len() as f64;
    let mut matrix = DMatrix::zeros(points.len(), 5);
    let mut right = DVector::zeros(points.len());
    for (row, (point, length)) in points.iter().enumerate() {
        let p = point - centre;
        let entries = [2.0 * p.x, 2.0 * p.y, 2.0 * p.z, 2.0 * length, -1.0];
        entries.iter().enumerate().for_each(|(column, entry)| matrix[(row, column)] = *entry);
        right[row] = p.norm_squared() - length * length;
    }
    let svd = matrix.svd(true, true);
    let (smallest, largest) = (svd.singular_values.min(), svd.singular_values.max());
    if smallest.is_nan() || smallest <= RANK_TOLERANCE * largest {
        return Err(StartError::Degenerate);
    }
    let solution = svd.solve(&right, 0.0).map_err(|_| StartError::Inconsistent)?;
    let position_m = centre + Vector3::new(solution[0], solution[1], solution[2]);
    let station = StationStart { position_m, dead_path_m: solution[3] };
    if solution.iter().all(|v| v.is_finite()) { Ok(station) } else { Err(StartError::Inconsistent) }
}

/// One weighted Gauss-Newton step; returns its size (m).
fn refine(
    station: &mut StationStart,
    points: &[PointAndLength],
    weights: &[f64],
    absolute: bool,
) -> Result<f64, StartError> {
    let mut normal = Matrix4::zeros();
    let mut gradient = Vector4::zeros();
    for (point, weight) in points.iter().zip(weights) {
        let sight = point.0 - station.position_m;
        let direction = sight / sight.norm();
        let row = Vector4::new(-direction.x, -direction.y, -direction.z, if absolute { 0.0 } else { -1.0 });
        normal += row * row.transpose() * *weight;
        gradient += row * (residual_m(station, point) * *weight);
    }
    if absolute {
        normal[(3, 3)] = 1.0;
    }
    // Lengths that belong to no one place lead away from any: that is no fault of the points.
    let lost = || if are_flat(points) { StartError::Degenerate } else { StartError::Inconsistent };
    let step = normal.cholesky().ok_or_else(lost)?.solve(&gradient);
    station.position_m += step.xyz();
    station.dead_path_m += step.w;
    if step.iter().all(|v| v.is_finite()) { Ok(step.norm()) } else { Err(StartError::Inconsistent) }
}

/// Whether points lie in a plane or on a line.
fn are_flat(points: &[PointAndLength]) -> bool {
    let centre: Vector3<f64> = points.iter().map(|(p, _)| p).sum::<Vector3<f64>>() / points.len() as f64;
    let spread: Matrix3<f64> = points.iter().map(|(p, _)| (p - centre) * (p - centre).transpose()).sum();
    let extents = spread.symmetric_eigenvalues();
    extents.min().max(0.0).sqrt() <= FLAT * extents.max().max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lattice() -> Vec<Vector3<f64>> {
        (0..60)
            .map(|k| Vector3::new(f64::from(k % 5) * 0.2, f64::from(k / 5 % 4) * 0.15, f64::from(k / 20) * 0.3))
            .collect()
    }

    fn readings(station: &StationStart) -> Vec<PointAndLength> {
        lattice().into_iter().map(|p| (p, (p - station.position_m).norm() - station.dead_path_m)).collect()
    }

    const TRUTH: StationStart = StationStart { position_m: Vector3::new(-0.05, 1.3, -0.62), dead_path_m: 0.713 };

    #[test]
    fn exact_lengths_give_the_exact_station() {
        let found = start(&readings(&TRUTH), false).unwrap();
        assert!((found.position_m - TRUTH.position_m).norm() < 1e-11);
        assert!((found.dead_path_m - TRUTH.dead_path_m).abs() < 1e-11);
    }

    #[test]
    fn gross_errors_in_a_fifth_of_the_readings_do_not_move_it() {
        let mut points = readings(&TRUTH);
        // Scattered over the lattice: a fifth that fills one whole plane could not be told from a bent machine.
        let scattered = points.iter_mut().enumerate().filter(|(k, _)| (k + k / 5) % 5 == 0);
        scattered.for_each(|(_, (_, length))| *length += 0.003);
        let found = start(&points, false).unwrap();
        assert!((found.position_m - TRUTH.position_m).norm() < 1e-5, "{found:?}");
    }

    #[test]
    fn an_absolute_instrument_has_no_dead_path() {
        let absolute = StationStart { dead_path_m: 0.0, ..TRUTH };
        let found = start(&readings(&absolute), true).unwrap();
        assert_eq!(found.dead_path_m, 0.0);
        assert!((found.position_m - TRUTH.position_m).norm() < 1e-11);
    }

    /// 1 mm is what is said of the zero. Lines that disagree by 2 mm contradict their station where campaigns are identified.
    #[test]
    fn a_constant_of_an_absolute_instrument_moves_the_place_by_little_more_and_leaves_less() {
        let constant = StationStart { dead_path_m: 1e-3, ..TRUTH };
        let points = readings(&constant);
        let found = start(&points, true).unwrap();
        assert!((found.position_m - TRUTH.position_m).norm() < 2e-3, "{found:?}");
        assert!(points.iter().all(|point| residual_m(&found, point).abs() < 1e-3));
    }

    #[test]
    fn flat_and_few_points_are_refused() {
        let mut points = readings(&TRUTH);
        points.truncate(20);
        assert_eq!(start(&points, false), Err(StartError::Degenerate));
        assert_eq!(start(&points[..4], false), Err(StartError::TooFew(4)));
    }
}
