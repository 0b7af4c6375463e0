//! Normal equations of a network in blocks, with the points eliminated.
//!
//! Place in the flow: under [`super::Search`]. A sighting has the derivative u by its point (unit vector) and −(u, 1) by
//! position and dead path of its station. Points touch only their own stations, so the reduced matrix
//! R = N_ss − Σ N_sp N_pp⁻¹ N_ps is all that is ever held of size stations × stations. R does not see a motion of the whole:
//! its null space E is known exactly and is filled with α E Eᵀ, which gives the pseudo-inverse.

use super::{NetworkError, Placed, Search};
use nalgebra::{DMatrix, DVector, Matrix3, Matrix4x3, SVector, Vector3, Vector4};

/// Unknowns of a station: position and dead path.
pub(super) const EACH: usize = 4;

/// What a point's sightings say.
pub(super) struct PointBlock {
    pub(super) point: usize,
    normal: Matrix3<f64>,
    right: Vector3<f64>,
    /// N_sp by station.
    coupling: Vec<(usize, Matrix4x3<f64>)>,
}

/// Stations with the points eliminated.
pub(super) struct Reduced {
    /// R.
    pub(super) matrix: DMatrix<f64>,
    pub(super) right: DVector<f64>,
    /// N_pp⁻¹ of each point.
    pub(super) inverses: Vec<Matrix3<f64>>,
}

/// Where a step leads.
pub(super) struct Step {
    pub(super) stations: Vec<Placed>,
    pub(super) points_m: Vec<Vector3<f64>>,
    /// Gain in χ² that it promises.
    pub(super) gain: f64,
}

/// Normal equations.
pub(super) struct Blocks {
    stations: DMatrix<f64>,
    right: DVector<f64>,
    pub(super) points: Vec<PointBlock>,
    /// Orthonormal motions of the whole, as the stations see them.
    pub(super) motions: DMatrix<f64>,
}

/// Where the dead path of a station is among the unknowns.
fn row_of_dead_path(station: usize) -> usize {
    EACH * station + 3
}

/// Derivative of a predicted length by the station.
pub(super) fn by_station(ray: &Vector3<f64>) -> Vector4<f64> {
    (-ray).push(-1.0)
}

impl Reduced {
    /// As if all dead paths were known.
    pub(super) fn hold_dead_paths(&mut self) {
        let paths = (0..self.matrix.nrows() / EACH).map(row_of_dead_path);
        for path in paths.clone() {
            self.matrix.row_mut(path).fill(0.0);
            self.matrix.column_mut(path).fill(0.0);
        }
        let typical = (self.matrix.trace() / self.matrix.nrows() as f64).max(f64::MIN_POSITIVE);
        paths.for_each(|path| self.matrix[(path, path)] = typical);
    }
}

impl Blocks {
    pub(super) fn new(search: &Search) -> Blocks {
        let size = EACH * search.stations.len();
        let (mut stations, mut right) = (DMatrix::zeros(size, size), DVector::zeros(size));
        let mut points = Vec::new();
        for point in search.solvable() {
            let mut block =
                PointBlock { point, normal: Matrix3::zeros(), right: Vector3::zeros(), coupling: Vec::new() };
            for k in search.sights(point) {
                let (residual_m, ray) = search.row(k);
                let s = &search.sightings[k];
                let information = 1.0 / (s.u_m * s.u_m);
                let column = by_station(&ray);
                block.normal += ray * ray.transpose() * information;
                block.right += ray * (residual_m * information);
                block.coupling.push((s.station, column * ray.transpose() * information));
                let first = EACH * s.station;
                let mut own = stations.fixed_view_mut::<EACH, EACH>(first, first);
                own += column * column.transpose() * information;
                let mut own = right.fixed_rows_mut::<EACH>(first);
                own += column * (residual_m * information);
            }
            points.push(block);
        }
        if let Some(u_m) = search.u_dead_path_m {
            let information = 1.0 / (u_m * u_m);
            for (k, station) in search.stations.iter().enumerate() {
                let path = row_of_dead_path(k);
                stations[(path, path)] += information;
                right[path] -= station.dead_path_m * information;
            }
        }
        Blocks { stations, right, points, motions: motions(&search.stations) }
    }

    /// The stations' equations, each diagonal entry grown by the damping.
    pub(super) fn reduced(&self, damping: f64) -> Result<Reduced, NetworkError> {
        let (mut matrix, mut right) = (self.stations.clone(), self.right.clone());
        (0..matrix.nrows()).for_each(|k| matrix[(k, k)] *= 1.0 + damping);
        let mut inverses = Vec::with_capacity(self.points.len());
        for block in &self.points {
            let mut damped = block.normal;
            (0..3).for_each(|k| damped[(k, k)] *= 1.0 + damping);
            let inverse = damped.cholesky().ok_or(NetworkError::Singular)?.inverse();
            for (a, of_a) in &block.coupling {
                let weighted = of_a * inverse;
                let mut own = right.fixed_rows_mut::<EACH>(EACH * a);
                own -= weighted * block.right;
                for (b, of_b) in &block.coupling {
                    let mut shared = matrix.fixed_view_mut::<EACH, EACH>(EACH * a, EACH * b);
                    shared -= weighted * of_b.transpose();
                }
            }
            inverses.push(inverse);
        }
        Ok(Reduced { matrix, right, inverses })
    }

    /// R with the motions of the whole filled in, as large as the mean of its diagonal.
    pub(super) fn filled(&self, reduced: &Reduced) -> DMatrix<f64> {
        let typical = reduced.matrix.trace() / reduced.matrix.nrows() as f64;
        &reduced.matrix + &self.motions * self.motions.transpose() * typical
    }

    /// Pseudo-inverse of R: covariance of the stations in the frame in which they do not move as a whole.
    pub(super) fn station_covariance(&self, reduced: &Reduced) -> Result<DMatrix<f64>, NetworkError> {
        let typical = reduced.matrix.trace() / reduced.matrix.nrows() as f64;
        let mut inverse = self.filled(reduced).cholesky().ok_or(NetworkError::Singular)?.inverse();
        inverse -= &self.motions * self.motions.transpose() / typical;
        Ok(inverse)
    }

    /// Stations and points after a damped step.
    pub(super) fn step(&self, search: &Search, damping: f64) -> Result<Step, NetworkError> {
        let reduced = self.reduced(damping)?;
        let change = self.filled(&reduced).cholesky().ok_or(NetworkError::Singular)?.solve(&reduced.right);
        let mut gain = change.dot(&self.right);
        let mut stations = search.stations.clone();
        for (k, station) in stations.iter_mut().enumerate() {
            station.position_m += change.fixed_rows::<3>(EACH * k);
            station.dead_path_m += change[EACH * k + 3];
        }
        let mut points_m = search.points_m.clone();
        for (block, inverse) in self.points.iter().zip(&reduced.inverses) {
            let coupled: Vector3<f64> =
                block.coupling.iter().map(|(k, of)| of.transpose() * change.fixed_rows::<EACH>(EACH * k)).sum();
            let moved = inverse * (block.right - coupled);
            gain += moved.dot(&block.right);
            points_m[block.point] += moved;
        }
        let finite = change.iter().all(|v| v.is_finite()) && gain.is_finite();
        if finite { Ok(Step { stations, points_m, gain }) } else { Err(NetworkError::Singular) }
    }
}

impl PointBlock {
    /// How stations move this point, by station: G = −N_pp⁻¹ N_ps (transposed).
    pub(super) fn gains(&self, inverse: &Matrix3<f64>) -> impl Iterator<Item = (usize, Matrix4x3<f64>)> + '_ {
        let inverse = *inverse;
        self.coupling.iter().map(move |(station, of)| (*station, -(of * inverse)))
    }
}

/// Translation and turn about a centre as a point or station there sees it: δ = t + ω × (p − centre).
pub(super) fn motion(place_m: &Vector3<f64>, centre_m: &Vector3<f64>) -> nalgebra::SMatrix<f64, 3, 6> {
    let arm = place_m - centre_m;
    let mut motion = nalgebra::SMatrix::<f64, 3, 6>::zeros();
    motion.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::identity());
    motion.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-arm.cross_matrix()));
    motion
}

/// Orthonormal basis of what the whole's motions do to stations.
fn motions(stations: &[Placed]) -> DMatrix<f64> {
    let centre = stations.iter().map(|s| s.position_m).sum::<Vector3<f64>>() / stations.len() as f64;
    let mut all = DMatrix::zeros(EACH * stations.len(), 6);
    for (k, station) in stations.iter().enumerate() {
        all.fixed_view_mut::<3, 6>(EACH * k, 0).copy_from(&motion(&station.position_m, &centre));
    }
    all.qr().q()
}

/// Entries of a vector of all stations that belong to one.
pub(super) fn of_station(vector: &DVector<f64>, station: usize) -> SVector<f64, EACH> {
    vector.fixed_rows::<EACH>(EACH * station).into_owned()
}
