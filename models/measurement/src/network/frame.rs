//! The frame of a network, and covariances in it.
//!
//! Place in the flow: last. The whole is moved rigidly to where its points fit their starts best. A covariance in any frame becomes that in this one by an
//! S-transformation: with δp of the points, the frame moves by ξ = M Σ Eᵢᵀ δpᵢ, M = (Σ EᵢᵀEᵢ)⁻¹, and
//! δp′ = δp − E ξ. A scale that all lengths have in common makes everything larger about the middle of the points. Since Cov(pᵢ, pⱼ) = Aᵢ [i = j] + Gᵢ C Gⱼᵀ with C of the stations, sums over points are all it takes, and
//! cost is linear in them. Source: Baarda 1973.

use super::blocks::{Blocks, EACH, Reduced, motion};
use super::{Network, NetworkError, Placed, Point, Search, Start, Station};
use crate::alignment::RigidAlignment;
use crate::claim::Claim;
use nalgebra::{DMatrix, Matrix3, Matrix3xX, Matrix4, Matrix6, Matrix6xX, SMatrix, Vector3};

/// Moves a settled search to its frame and propagates.
pub(super) fn finish(mut search: Search, start: &Start) -> Result<Network, NetworkError> {
    let chi2 = search.chi2();
    let points: Vec<usize> = search.solvable().collect();
    let used = search.used.iter().filter(|used| **used).count();
    align(&mut search, start, &points)?;
    let blocks = Blocks::new(&search);
    let reduced = blocks.reduced(0.0)?;
    let transformed = Transformation::new(&search, &blocks, &reduced)?;
    let unknowns = 3 * points.len() + search.unknowns_of_stations() + transformed.dead_paths_told(&search);
    let degrees = used.saturating_sub(unknowns);
    // What was declared holds parts that residuals do not show: they may prove it too small, never too large.
    let noise = Claim::declared(chi2 / degrees.max(1) as f64, degrees).variance();
    let mut solved = vec![None; search.points_m.len()];
    for place in 0..points.len() {
        solved[points[place]] = Some(transformed.point(&search, &blocks, &reduced, place, noise));
    }
    let solved = solved.into_iter().zip(&search.problems);
    // A point without problem is solvable, and was solved.
    let points = solved.map(|(point, why)| match (point, why) {
        (Some(point), _) => Ok(point),
        (None, Some(why)) => Err(*why),
        (None, None) => Err(super::PointProblem::Unseen),
    });
    let points = points.collect();
    let residual = |k: usize| search.problems[search.sightings[k].point].is_none().then(|| search.row(k).0);
    let mut rejected = search.rejected.clone();
    rejected.sort_unstable();
    Ok(Network {
        stations: (0..search.stations.len()).map(|k| transformed.station(&search, k, noise)).collect(),
        points,
        residuals_m: (0..search.sightings.len()).map(residual).collect(),
        rejected,
        chi2,
        degrees,
        noise,
    })
}

fn align(search: &mut Search, start: &Start, points: &[usize]) -> Result<(), NetworkError> {
    let of = |list: &[Vector3<f64>]| points.iter().map(|k| list[*k]).collect::<Vec<_>>();
    let alignment =
        RigidAlignment::between(&of(&search.points_m), &of(&start.points_m)).map_err(|_| NetworkError::Singular)?;
    search.points_m.iter_mut().for_each(|p| *p = alignment.apply(p));
    search.stations.iter_mut().for_each(|s| s.position_m = alignment.apply(&s.position_m));
    Ok(())
}

/// From the frame of the stations to that of the points.
struct Transformation {
    centre_m: Vector3<f64>,
    /// Covariance of the stations in their own frame.
    stations: DMatrix<f64>,
    /// M Σ EᵢᵀGᵢ: how stations move the frame.
    by_stations: Matrix6xX<f64>,
    /// M.
    inverse: Matrix6<f64>,
    /// Covariance of the frame that comes from the ranges of its points, and in all.
    of_ranges: Matrix6<f64>,
    of_all: Matrix6<f64>,
}

impl Transformation {
    fn new(search: &Search, blocks: &Blocks, reduced: &Reduced) -> Result<Transformation, NetworkError> {
        let stations = blocks.station_covariance(reduced)?;
        let count = blocks.points.len();
        let place = |k: usize| search.points_m[blocks.points[k].point];
        let centre_m = (0..count).map(place).sum::<Vector3<f64>>() / count as f64;
        let (mut square, mut ranges) = (Matrix6::zeros(), Matrix6::zeros());
        let mut by_stations = Matrix6xX::zeros(EACH * search.stations.len());
        for k in 0..count {
            let motion = motion(&place(k), &centre_m);
            square += motion.transpose() * motion;
            ranges += motion.transpose() * reduced.inverses[k] * motion;
            for (station, gain) in blocks.points[k].gains(&reduced.inverses[k]) {
                let mut own = by_stations.fixed_view_mut::<6, EACH>(0, EACH * station);
                own += motion.transpose() * gain.transpose();
            }
        }
        let inverse = square.cholesky().ok_or(NetworkError::Singular)?.inverse();
        let by_stations = inverse * by_stations;
        let of_ranges = inverse * ranges * inverse;
        let shared = &by_stations * &stations * by_stations.transpose();
        let of_all = of_ranges + shared.fixed_view::<6, 6>(0, 0);
        Ok(Transformation { centre_m, stations, by_stations, inverse, of_ranges, of_all })
    }

    /// How many dead paths the ranges told, of those known beforehand: each costs a degree of freedom as far as they narrow it.
    fn dead_paths_told(&self, search: &Search) -> usize {
        let Some(u_m) = search.u_dead_path_m else { return 0 };
        let left = |k: usize| self.stations[(EACH * k + 3, EACH * k + 3)] / (u_m * u_m);
        let told: f64 = (0..search.stations.len()).map(|k| (1.0 - left(k)).clamp(0.0, 1.0)).sum();
        told.round() as usize
    }

    fn point(&self, search: &Search, blocks: &Blocks, reduced: &Reduced, place: usize, noise: f64) -> Point {
        let (block, own) = (&blocks.points[place], &reduced.inverses[place]);
        let position_m = search.points_m[block.point];
        let motion = motion(&position_m, &self.centre_m);
        let mut gain = Matrix3xX::zeros(EACH * search.stations.len());
        for (station, of) in block.gains(own) {
            gain.fixed_view_mut::<3, EACH>(0, EACH * station).copy_from(&of.transpose());
        }
        let through = &gain * &self.stations;
        // Covariance of the point with the frame.
        let with_frame: SMatrix<f64, 3, 6> = &through * self.by_stations.transpose() + own * motion * self.inverse;
        let crossed = motion * with_frame.transpose();
        let free: Matrix3<f64> = own + through * gain.transpose();
        let larger_m = (position_m - self.centre_m) * search.u_common_scale;
        Point {
            position_m,
            covariance_m2: (free - crossed - crossed.transpose() + motion * self.of_all * motion.transpose()) * noise
                + larger_m * larger_m.transpose(),
            of_ranges_m2: own * noise,
            of_frame_m2: motion * self.of_ranges * motion.transpose() * noise,
            checks: search.checks(block.point),
            lost: search.lost(block.point),
        }
    }

    fn station(&self, search: &Search, station: usize, noise: f64) -> Station {
        let Placed { position_m, dead_path_m } = search.stations[station];
        let mut motion4 = SMatrix::<f64, EACH, 6>::zeros();
        motion4.fixed_view_mut::<3, 6>(0, 0).copy_from(&motion(&position_m, &self.centre_m));
        let rows = self.stations.rows(EACH * station, EACH);
        let with_frame = rows * self.by_stations.transpose();
        let crossed: Matrix4<f64> = motion4 * with_frame.fixed_view::<EACH, 6>(0, 0).transpose();
        let own = self.stations.fixed_view::<EACH, EACH>(EACH * station, EACH * station);
        let larger_m = (position_m - self.centre_m).push(dead_path_m) * search.u_common_scale;
        Station {
            placed: Placed { position_m, dead_path_m },
            covariance_m2: (own - crossed - crossed.transpose() + motion4 * self.of_all * motion4.transpose()) * noise
                + larger_m * larger_m.transpose(),
        }
    }
}
