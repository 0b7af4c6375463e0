//! What a set of lines tells, kept up to date line by line.
//!
//! Place in the flow: the search asks what a line would add and adds or takes it out. Stations are unknown, too: a line's rows
//! are taken relative to what its station is known by the lines it has, so that C is the covariance of the machine's parameters
//! with all stations eliminated. With J = (J_m J_s) the whitened rows of a line, D and B the station's own information and its
//! coupling: J̃ = K^(−½)(J_m − J_s D⁻¹ B), K = I + J_s D⁻¹ J_sᵀ, and C⁻¹ grows by J̃ᵀJ̃. So a line of r points changes C by
//! rank r: C − C J̃ᵀ(I + J̃ C J̃ᵀ)⁻¹ J̃ C, which costs n² r instead of n³. Mean variance of a point over the volume is
//! tr(C W), W = mean of TᵀT over points with partials T; its change is tr((I + V)⁻¹ J̃ C W C J̃ᵀ), V = J̃ C J̃ᵀ, and that of
//! ln det C is −ln det(I + V) (Fedorov 1972; Atkinson, Donev & Tobias 2007, Optimum Experimental Designs, ch. 11-12).

use abbe_identify::{STATION_PARAMETERS, SplitRows, U_ABSOLUTE_ZERO_M};
use faer::linalg::solvers::{DenseSolveCore, Llt, Solve};
use faer::{Mat, Side};

/// How well a station is known before it is measured from (m): loose enough to tell nothing, tight enough to compute with.
const STATION_M: f64 = 1e-3;

/// Information about the machine from a set of lines, and its inverse.
#[derive(Debug, Clone)]
pub(crate) struct Design {
    /// Of the machine's parameters, prior included, stations eliminated.
    information: Mat<f64>,
    covariance: Mat<f64>,
    /// W: mean of TᵀT.
    weight: Mat<f64>,
    /// C W C.
    spread: Mat<f64>,
    stations: Vec<Known>,
}

/// What is known of one station, relative to the machine.
#[derive(Debug, Clone)]
struct Known {
    normal: Mat<f64>,
    /// Stations' parameters × machine's.
    cross: Mat<f64>,
}

/// What a line would change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Gain {
    /// By how much the mean variance of a point falls (weighted as W says).
    pub(crate) volume: f64,
    /// By how much −ln det C grows.
    pub(crate) determinant: f64,
}

impl Known {
    fn unmeasured(unknowns: usize, absolute: bool) -> Known {
        let mut normal = Mat::zeros(STATION_PARAMETERS, STATION_PARAMETERS);
        for k in 0..STATION_PARAMETERS {
            let u_m = if absolute && k + 1 == STATION_PARAMETERS { U_ABSOLUTE_ZERO_M } else { STATION_M };
            normal[(k, k)] = u_m.powi(-2);
        }
        Known { normal, cross: Mat::zeros(STATION_PARAMETERS, unknowns) }
    }

    fn take(&mut self, rows: &SplitRows, sign: f64) {
        self.normal += faer::Scale(sign) * (rows.station.transpose() * &rows.station);
        self.cross += faer::Scale(sign) * (rows.station.transpose() * &rows.machine);
    }

    /// J̃ of further rows; `None` where rounding leaves no information of the station.
    fn relative(&self, rows: &SplitRows) -> Option<Mat<f64>> {
        let known = Llt::new(self.normal.as_ref(), Side::Lower).ok()?;
        let reached = known.solve(rows.station.transpose());
        let mut spread = &rows.station * &reached;
        (0..spread.nrows()).for_each(|k| spread[(k, k)] += 1.0);
        let whitened = &rows.machine - reached.transpose() * &self.cross;
        let root = Llt::new(spread.as_ref(), Side::Lower).ok()?;
        Some(lower_solved(&root, whitened))
    }
}

/// L⁻¹ A.
fn lower_solved(root: &Llt<f64>, mut matrix: Mat<f64>) -> Mat<f64> {
    faer::linalg::triangular_solve::solve_lower_triangular_in_place(root.L(), matrix.as_mut(), faer::Par::Seq);
    matrix
}

impl Design {
    /// Before any line: what is known beforehand, and what counts.
    pub(crate) fn new(information: Mat<f64>, weight: Mat<f64>, stations: usize, absolute: bool) -> Option<Design> {
        let unknowns = information.nrows();
        let stations = vec![Known::unmeasured(unknowns, absolute); stations];
        let covariance = inverse(&information)?;
        let spread = &covariance * &weight * &covariance;
        Some(Design { information, covariance, weight, spread, stations })
    }

    /// Mean variance of a point (m², weighted as W says).
    pub(crate) fn volume(&self) -> f64 {
        trace_of_product(&self.covariance, &self.weight)
    }

    /// Mean of what a quadratic form of the parameters has for variance: tr(C M).
    pub(crate) fn mean(&self, form: &Mat<f64>) -> f64 {
        trace_of_product(&self.covariance, form)
    }

    /// Number of the machine's parameters.
    pub(crate) fn unknowns(&self) -> usize {
        self.covariance.nrows()
    }

    /// What a line from a station would change.
    pub(crate) fn gain(&self, station: usize, rows: &SplitRows) -> Option<Gain> {
        let relative = self.stations[station].relative(rows)?;
        let reached = &relative * &self.covariance;
        let mut seen = &reached * relative.transpose();
        (0..seen.nrows()).for_each(|k| seen[(k, k)] += 1.0);
        let root = Llt::new(seen.as_ref(), Side::Lower).ok()?;
        let spread = &relative * &self.spread * relative.transpose();
        let volume = trace_of_product(&root.inverse(), &spread);
        let determinant = (0..seen.nrows()).map(|k| 2.0 * root.L()[(k, k)].ln()).sum();
        Some(Gain { volume, determinant })
    }

    /// What taking a line out again would lose.
    pub(crate) fn loss(&self, station: usize, rows: &SplitRows) -> Option<Gain> {
        let mut without = self.stations[station].clone();
        without.take(rows, -1.0);
        let relative = without.relative(rows)?;
        let reached = &relative * &self.covariance;
        let seen = &reached * relative.transpose();
        let left = Mat::from_fn(seen.nrows(), seen.ncols(), |i, j| f64::from(i == j) - seen[(i, j)]);
        let root = Llt::new(left.as_ref(), Side::Lower).ok()?;
        let spread = &relative * &self.spread * relative.transpose();
        let volume = trace_of_product(&root.inverse(), &spread);
        let determinant = (0..left.nrows()).map(|k| -2.0 * root.L()[(k, k)].ln()).sum();
        Some(Gain { volume, determinant })
    }

    /// Adds a line; `None`, and nothing changed, where rounding leaves no covariance.
    pub(crate) fn add(&mut self, station: usize, rows: &SplitRows) -> Option<()> {
        let relative = self.stations[station].relative(rows)?;
        let reached = &relative * &self.covariance;
        let mut seen = &reached * relative.transpose();
        (0..seen.nrows()).for_each(|k| seen[(k, k)] += 1.0);
        let root = Llt::new(seen.as_ref(), Side::Lower).ok()?;
        let root_reached = lower_solved(&root, reached);
        self.covariance -= root_reached.transpose() * &root_reached;
        self.information += relative.transpose() * &relative;
        self.stations[station].take(rows, 1.0);
        self.spread = &self.covariance * &self.weight * &self.covariance;
        Some(())
    }

    /// Takes a line out. The covariance is made anew: what is taken from it by turns would pile up rounding.
    pub(crate) fn remove(&mut self, station: usize, rows: &SplitRows) -> Option<()> {
        let mut without = self.stations[station].clone();
        without.take(rows, -1.0);
        let relative = without.relative(rows)?;
        let information = &self.information - relative.transpose() * &relative;
        let covariance = inverse(&information)?;
        self.spread = &covariance * &self.weight * &covariance;
        (self.information, self.covariance) = (information, covariance);
        self.stations[station] = without;
        Some(())
    }
}

/// Inverse of a positive definite matrix whose unknowns have units of their own: equilibrated first.
pub(crate) fn inverse(matrix: &Mat<f64>) -> Option<Mat<f64>> {
    let n = matrix.nrows();
    let scale: Vec<f64> = (0..n).map(|k| matrix[(k, k)].max(f64::MIN_POSITIVE).powf(-0.5)).collect();
    let equal = Mat::from_fn(n, n, |i, j| matrix[(i, j)] * scale[i] * scale[j]);
    let inverse = Llt::new(equal.as_ref(), Side::Lower).ok()?.inverse();
    Some(Mat::from_fn(n, n, |i, j| inverse[(i, j)] * scale[i] * scale[j]))
}

/// tr(A B) of symmetric matrices.
pub(crate) fn trace_of_product(a: &Mat<f64>, b: &Mat<f64>) -> f64 {
    a.col_iter().zip(b.col_iter()).map(|(a, b)| a.iter().zip(b.iter()).map(|(a, b)| a * b).sum::<f64>()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const UNKNOWNS: usize = 7;

    fn matrix(generator: &mut ChaCha8Rng, rows: usize, columns: usize, size: f64) -> Mat<f64> {
        Mat::from_fn(rows, columns, |_, _| size * (generator.random::<f64>() - 0.5))
    }

    /// Lines of three points from two stations; sizes as in a campaign: 1/0.3 µm, levers of a metre.
    fn lines() -> Vec<(usize, SplitRows)> {
        let mut generator = ChaCha8Rng::seed_from_u64(3);
        let mut line = |k: usize| {
            let machine = matrix(&mut generator, 3, UNKNOWNS, 3e6);
            (k % 2, SplitRows { machine, station: matrix(&mut generator, 3, STATION_PARAMETERS, 3e6) })
        };
        (0..12).map(&mut line).collect()
    }

    fn start() -> Design {
        let prior = Mat::from_fn(UNKNOWNS, UNKNOWNS, |i, j| if i == j { 1e8 } else { 0.0 });
        let weight = Mat::from_fn(UNKNOWNS, UNKNOWNS, |i, j| if i == j { 1.0 + i as f64 } else { 0.2 });
        Design::new(prior, weight, 2, false).unwrap()
    }

    /// The whole normal matrix with the stations in it, inverted at once.
    fn at_once(lines: &[(usize, SplitRows)]) -> (f64, f64) {
        let size = UNKNOWNS + 2 * STATION_PARAMETERS;
        let mut normal = Mat::zeros(size, size);
        (0..size).for_each(|k| normal[(k, k)] = if k < UNKNOWNS { 1e8 } else { STATION_M.powi(-2) });
        for (station, rows) in lines {
            let mut whole = Mat::zeros(3, size);
            for i in 0..3 {
                (0..UNKNOWNS).for_each(|j| whole[(i, j)] = rows.machine[(i, j)]);
                let first = UNKNOWNS + station * STATION_PARAMETERS;
                (0..STATION_PARAMETERS).for_each(|j| whole[(i, first + j)] = rows.station[(i, j)]);
            }
            normal += whole.transpose() * &whole;
        }
        let covariance = inverse(&normal).unwrap();
        let machine = Mat::from_fn(UNKNOWNS, UNKNOWNS, |i, j| covariance[(i, j)]);
        let root = Llt::new(inverse(&machine).unwrap().as_ref(), Side::Lower).unwrap();
        let determinant = (0..UNKNOWNS).map(|k| 2.0 * root.L()[(k, k)].ln()).sum();
        (trace_of_product(&machine, &start().weight), determinant)
    }

    #[test]
    fn lines_added_and_taken_out_one_by_one_give_what_all_at_once_give() {
        let lines = lines();
        let mut design = start();
        for (k, (station, rows)) in lines.iter().enumerate() {
            let (before, gain) = (design.volume(), design.gain(*station, rows).unwrap());
            design.add(*station, rows).unwrap();
            let (volume, determinant) = at_once(&lines[..=k]);
            let before_at_once = at_once(&lines[..k]);
            // Rounding of a millimetre known station against a third of a micrometre: 1e-16 · (1e-3/3e-7)².
            assert!((design.volume() / volume - 1.0).abs() < 1e-6, "{k}: {} {volume}", design.volume());
            assert!((gain.volume / (before - volume) - 1.0).abs() < 1e-6, "{k}");
            assert!((gain.determinant - (determinant - before_at_once.1)).abs() < 1e-6, "{k}");
        }
        for k in (8..lines.len()).rev() {
            let (station, rows) = &lines[k];
            let (before, loss) = (design.volume(), design.loss(*station, rows).unwrap());
            design.remove(*station, rows).unwrap();
            let (volume, determinant) = at_once(&lines[..k]);
            assert!((design.volume() / volume - 1.0).abs() < 1e-6, "{k}: {} {volume}", design.volume());
            assert!((loss.volume / (volume - before) - 1.0).abs() < 1e-6, "{k}");
            assert!((loss.determinant - (at_once(&lines[..=k]).1 - determinant)).abs() < 1e-6, "{k}");
        }
    }
}
