//! What a set of lines tells, kept up to date line by line.
//!
//! Place in the flow: the search asks what a line would add and adds or takes it out. C is the covariance of the machine's parameters and
//! of all stations, which are as good as unknown at first. With the whitened rows J of a line, C⁻¹ grows by JᵀJ, so a line of r points
//! changes C by rank r: C − RᵀR, R = L⁻¹ J C, LLᵀ = I + V, V = J C Jᵀ, which costs n² r instead of n³. Mean variance of a point over the
//! volume is tr(C W), W = mean of TᵀT over points with partials T by the machine's parameters; its change is tr((I + V)⁻¹ J S Jᵀ),
//! S = C W C. That of ln det C is −ln det(I + V), of which the station's own part, ln det(I + J_s D⁻¹ J_sᵀ) with its information D, tells
//! nothing of the machine (Fedorov 1972; Atkinson, Donev & Tobias 2007, Optimum Experimental Designs, ch. 11-12).
//!
//! What a line would tell, V and J S Jᵀ, is brought up to date by what has been added since it was looked at, r products with R in place of
//! r products with C and S.

use abbe_identify::{
    STATION_PARAMETERS, SplitRows, U_ABSOLUTE_ZERO_M, log_determinant, symmetric_eigen, trace_of_product,
};
use faer::linalg::solvers::{DenseSolveCore, Llt};
use faer::{Mat, MatRef, Side};

/// How well a station is known before it is measured from (m): loose enough to tell nothing, tight enough to compute with.
const STATION_M: f64 = 1e-3;

/// Information from a set of lines, and its inverse.
#[derive(Debug, Clone)]
pub(crate) struct Design {
    /// Of the machine's parameters, prior included, and of the stations behind them.
    information: Mat<f64>,
    covariance: Mat<f64>,
    /// W, of the machine's parameters alone.
    weight: Mat<f64>,
    /// S.
    spread: Mat<f64>,
    /// D of each station: its own information, relative to the machine.
    stations: Vec<Mat<f64>>,
    /// What has been added since [`Design::forget`].
    added: Vec<Added>,
}

/// What a line has changed: C by −RᵀR, S by −RᵀT − TᵀR.
#[derive(Debug, Clone)]
struct Added {
    /// R, and T below it.
    rows: Mat<f64>,
}

/// What a line would tell, when so many had been added.
#[derive(Debug, Clone)]
pub(crate) struct Told {
    /// V.
    seen: Mat<f64>,
    /// J S Jᵀ.
    spread: Mat<f64>,
    added: usize,
}

/// What a line would change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Gain {
    /// By how much the mean variance of a point falls (weighted as W says).
    pub(crate) volume: f64,
    /// By how much −ln det C grows.
    pub(crate) determinant: f64,
}

impl Gain {
    pub(crate) const NONE: Gain = Gain { volume: 0.0, determinant: 0.0 };
    pub(crate) const UNBOUNDED: Gain = Gain { volume: f64::INFINITY, determinant: f64::INFINITY };
}

/// A square root Q of the covariance, C = QQᵀ, in whose directions W is diagonal, QᵀWQ = Λ: V and J S Jᵀ then take one product, J Q, in
/// place of one with C and one with S. Made once where many lines are looked at.
pub(crate) struct Look {
    root: Mat<f64>,
    /// Λ.
    weight: Vec<f64>,
    added: usize,
}

/// J M of a line from a station.
fn times(rows: &SplitRows, station: usize, matrix: MatRef<f64>) -> Mat<f64> {
    let machine = rows.machine.ncols();
    let own = machine + STATION_PARAMETERS * station;
    &rows.machine * matrix.subrows(0, machine) + &rows.station * matrix.subrows(own, STATION_PARAMETERS)
}

/// L⁻¹ A.
fn lower_solved(root: &Llt<f64>, mut matrix: Mat<f64>) -> Mat<f64> {
    faer::linalg::triangular_solve::solve_lower_triangular_in_place(root.L(), matrix.as_mut(), faer::Par::Seq);
    matrix
}

/// LLᵀ = I + V, or I − V.
fn root_of(seen: &Mat<f64>, sign: f64) -> Option<Llt<f64>> {
    let whole = Mat::from_fn(seen.nrows(), seen.ncols(), |i, j| f64::from(i == j) + sign * seen[(i, j)]);
    Llt::new(whole.as_ref(), Side::Lower).ok()
}

impl Told {
    /// What taking it in would change, beside a station of this information (without the line, J_sᵀJ_s of which is given).
    fn gain(&self, station: &Mat<f64>, own: &Mat<f64>) -> Option<Gain> {
        let root = root_of(&self.seen, 1.0)?;
        let of_station = log_determinant(&Llt::new((station + own).as_ref(), Side::Lower).ok()?)
            - log_determinant(&Llt::new(station.as_ref(), Side::Lower).ok()?);
        let volume = trace_of_product(root.inverse().as_ref(), self.spread.as_ref());
        Some(Gain { volume, determinant: log_determinant(&root) - of_station })
    }
}

impl Design {
    /// Before any line: what is known beforehand of the machine, and what counts.
    pub(crate) fn new(machine: &Mat<f64>, weight: Mat<f64>, stations: usize, absolute: bool) -> Option<Design> {
        let unknowns = machine.nrows();
        let unmeasured = Mat::from_fn(STATION_PARAMETERS, STATION_PARAMETERS, |i, j| match i == j {
            true if absolute && i + 1 == STATION_PARAMETERS => U_ABSOLUTE_ZERO_M.powi(-2),
            true => STATION_M.powi(-2),
            false => 0.0,
        });
        let size = unknowns + stations * STATION_PARAMETERS;
        let mut information = Mat::zeros(size, size);
        information.submatrix_mut(0, 0, unknowns, unknowns).copy_from(machine);
        for first in (unknowns..size).step_by(STATION_PARAMETERS) {
            information.submatrix_mut(first, first, STATION_PARAMETERS, STATION_PARAMETERS).copy_from(&unmeasured);
        }
        let covariance = inverse(&information)?;
        let spread = spread(&covariance, &weight);
        let stations = vec![unmeasured; stations];
        Some(Design { information, covariance, weight, spread, stations, added: Vec::new() })
    }

    /// Mean variance of a point (m², weighted as W says).
    pub(crate) fn volume(&self) -> f64 {
        self.mean(&self.weight)
    }

    /// Mean of what a quadratic form of the machine's parameters has for variance: tr(C M).
    pub(crate) fn mean(&self, form: &Mat<f64>) -> f64 {
        let of_machine = self.covariance.submatrix(0, 0, form.nrows(), form.ncols());
        trace_of_product(of_machine, form.as_ref())
    }

    /// Number of the machine's parameters.
    pub(crate) fn unknowns(&self) -> usize {
        self.weight.nrows()
    }

    /// What a line from a station would change, and what it would tell now. `told` is what it would have told before.
    pub(crate) fn gain(&self, station: usize, rows: &SplitRows, told: &mut Option<Told>) -> Option<Gain> {
        let told = match told.take() {
            Some(before) if self.is_near(&before) => told.insert(self.brought_up(before, station, rows)),
            _ => told.insert(self.told(station, rows)),
        };
        told.gain(&self.stations[station], &(rows.station.transpose() * &rows.station))
    }

    /// Whether less is to be done for what was added since than for all of it.
    fn is_near(&self, told: &Told) -> bool {
        let since: usize = self.added.iter().skip(told.added).map(|added| added.rows.nrows()).sum();
        since < self.covariance.nrows()
    }

    fn told(&self, station: usize, rows: &SplitRows) -> Told {
        let product = |matrix: &Mat<f64>| times(rows, station, times(rows, station, matrix.as_ref()).transpose());
        Told { seen: product(&self.covariance), spread: product(&self.spread), added: self.added.len() }
    }

    fn brought_up(&self, mut told: Told, station: usize, rows: &SplitRows) -> Told {
        for added in self.added.iter().skip(told.added) {
            let along = times(rows, station, added.rows.transpose());
            let (by_root, by_spread) = along.as_ref().split_at_col(along.ncols() / 2);
            told.seen -= by_root * by_root.transpose();
            let half = by_root * by_spread.transpose();
            told.spread -= &half + half.transpose();
        }
        told.added = self.added.len();
        told
    }

    /// For many lines; `None` where rounding leaves no root.
    pub(crate) fn look(&self) -> Option<Look> {
        let root = Llt::new(self.covariance.as_ref(), Side::Lower).ok()?.L().to_owned();
        let of_machine = root.subrows(0, self.unknowns());
        let (weight, turn) = symmetric_eigen(&(of_machine.transpose() * &self.weight * of_machine))?;
        Some(Look { root: root * turn, weight, added: self.added.len() })
    }

    /// What taking a line out again would lose.
    pub(crate) fn loss(&self, station: usize, rows: &SplitRows) -> Option<Gain> {
        let Told { seen, spread, .. } = self.told(station, rows);
        let root = root_of(&seen, -1.0)?;
        let of_station = self.station_without(station, rows);
        let lost = log_determinant(&Llt::new(self.stations[station].as_ref(), Side::Lower).ok()?)
            - log_determinant(&Llt::new(of_station.as_ref(), Side::Lower).ok()?);
        let volume = trace_of_product(root.inverse().as_ref(), spread.as_ref());
        Some(Gain { volume, determinant: -log_determinant(&root) - lost })
    }

    fn station_without(&self, station: usize, rows: &SplitRows) -> Mat<f64> {
        &self.stations[station] - rows.station.transpose() * &rows.station
    }

    /// Adds a line; `None`, and nothing changed, where rounding leaves no covariance.
    pub(crate) fn add(&mut self, station: usize, rows: &SplitRows) -> Option<()> {
        let reached = times(rows, station, self.covariance.as_ref());
        let seen = times(rows, station, reached.transpose());
        let root = lower_solved(&root_of(&seen, 1.0)?, reached);
        // R W C, and of R W Rᵀ R the half that goes to either side.
        let of_machine = root.subcols(0, self.unknowns()) * &self.weight;
        let mut spread = &of_machine * self.covariance.subrows(0, self.unknowns());
        spread -= faer::Scale(0.5) * (of_machine * root.subcols(0, self.unknowns()).transpose() * &root);
        self.covariance -= root.transpose() * &root;
        // Anew, since rounding of what is taken away by turns would pile up.
        self.spread = self::spread(&self.covariance, &self.weight);
        self.inform(station, rows, 1.0);
        self.added.push(Added { rows: faer::concat![[root], [spread]] });
        Some(())
    }

    /// Takes a line out. The covariance is made anew: what is taken from it by turns would pile up rounding.
    pub(crate) fn remove(&mut self, station: usize, rows: &SplitRows) -> Option<()> {
        self.inform(station, rows, -1.0);
        let Some(covariance) = inverse(&self.information) else {
            self.inform(station, rows, 1.0);
            return None;
        };
        self.covariance = covariance;
        self.forget();
        Some(())
    }

    /// Forgets what was added: what lines would have told before is of no use any more.
    pub(crate) fn forget(&mut self) {
        self.added.clear();
        self.spread = spread(&self.covariance, &self.weight);
    }

    fn inform(&mut self, station: usize, rows: &SplitRows, sign: f64) {
        let blocks = [(0, &rows.machine), (self.unknowns() + STATION_PARAMETERS * station, &rows.station)];
        for (i, a) in blocks {
            for (j, b) in blocks {
                let mut block = self.information.submatrix_mut(i, j, a.ncols(), b.ncols());
                block += faer::Scale(sign) * (a.transpose() * b);
            }
        }
        self.stations[station] += faer::Scale(sign) * (rows.station.transpose() * &rows.station);
    }
}

/// S = C W C.
fn spread(covariance: &Mat<f64>, weight: &Mat<f64>) -> Mat<f64> {
    let of_machine = covariance.subcols(0, weight.nrows());
    of_machine * weight * of_machine.transpose()
}

impl Look {
    /// What a line from a station would tell.
    pub(crate) fn told(&self, station: usize, rows: &SplitRows) -> Told {
        let reached = times(rows, station, self.root.as_ref());
        let mut weighted = reached.clone();
        for (k, weight) in self.weight.iter().enumerate() {
            weighted.col_as_slice_mut(k).iter_mut().for_each(|value| *value *= weight);
        }
        let (seen, spread) = (&reached * reached.transpose(), weighted * reached.transpose());
        Told { seen, spread, added: self.added }
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
        Design::new(&prior, weight, 2, false).unwrap()
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
        let determinant = log_determinant(&root);
        (trace_of_product(machine.as_ref(), start().weight.as_ref()), determinant)
    }

    #[test]
    fn lines_added_and_taken_out_one_by_one_give_what_all_at_once_give() {
        let lines = lines();
        let mut design = start();
        let look = design.look().unwrap();
        let first: Vec<Told> = lines.iter().map(|(station, rows)| look.told(*station, rows)).collect();
        for (k, (station, rows)) in lines.iter().enumerate() {
            let (before, gain) = (design.volume(), design.gain(*station, rows, &mut None).unwrap());
            // From a look before any was added, each of which costs rounding of a station not yet known, and from one now.
            for told in [first[k].clone(), design.look().unwrap().told(*station, rows)] {
                let gained = design.gain(*station, rows, &mut Some(told)).unwrap();
                assert!((gained.volume / gain.volume - 1.0).abs() < 1e-5, "{k}: {gained:?} {gain:?}");
                assert!((gained.determinant - gain.determinant).abs() < 1e-6, "{k}: {gained:?} {gain:?}");
            }
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
