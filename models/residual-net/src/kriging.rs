//! Kriging as it runs live: the mean exactly, the variance from the nearest calibrated points.
//!
//! Place in the flow: fitted length scales (each in the unit of its input, m along axes) from `abbe_field::kriging` and calibrated residuals (m) in, mean and standard
//! uncertainty of the field (m) at any point out; on its own, below the network, and as the measure of how far a point lies
//! from what was measured. Each component: constant trend β, signal s² ρ(Δ/ℓ), noise σ² + u².
//! Mean β + s² Σ ρ(x, x_i) α_i with α = K⁻¹(y − β) over all points. Variance s² − kᵀA k + (1 − 1ᵀA k)²/(1ᵀA1) over the
//! [`NEAREST`] points around the nearest one, A = K⁻¹ of these: never below the variance from all points, and it costs the same
//! however many there are. (On smooth fields of 150 points the deviation is up to 2.2 times that from all points among them, and
//! up to 3.4 times beyond the edge; calibration takes the mean of it back.) Source: Rasmussen & Williams 2006, eq. 2.25, 2.41-2.42.

use crate::exponential::halved;
use crate::registers::{Loops, wide};
use abbe_field::kriging::{FittedComponent, Kernel};
use abbe_field::{MOST_INPUTS, Samples};
use faer::linalg::solvers::{DenseSolveCore, Llt, Solve};
use faer::{Mat, Side};
use nalgebra::Vector3;
use std::f64::consts::{LN_2, LOG2_E};

/// Points that the variance is computed from.
const NEAREST: usize = 24;
/// Cyclic diagonals of a symmetric matrix of that size that are not the same numbers again.
const DIAGONALS: usize = NEAREST / 2 + 1;
/// Lengths of arrays are multiples of this, so that loops run in vector registers.
const LANES: usize = 8;

/// Fitted parameters of one component.
#[derive(Debug, Clone, PartialEq)]
pub struct Component {
    /// Length scale along each input, in its unit: m along axes.
    pub length: Vec<f64>,
    /// Standard deviation of the signal (m).
    pub signal_m: f64,
    /// Standard deviation of what neighbouring points do not share (m), beyond what is declared: repeatability, and field finer than
    /// the points.
    pub noise_m: f64,
    /// How much of the declared uncertainties the residuals scatter by, 0 to 1. The rest is common to neighbours.
    pub seen: f64,
    /// Constant trend β (m).
    pub trend_m: f64,
    /// α = K⁻¹(y − β), one a calibrated point (1/m).
    pub weights_per_m: Vec<f64>,
}

/// Kriging of three components.
#[derive(Debug, Clone, PartialEq)]
pub struct Kriging {
    /// Covariance of the signal.
    pub kernel: Kernel,
    /// x, y, z.
    pub components: [Component; 3],
}

impl Kriging {
    /// The parameters of a fit, solved for a field: the one it was fitted to, or a part of it; `seen` of its declared uncertainties
    /// shows as scatter. The trend is constant. `None` if the covariance of the points is not positive definite.
    pub fn from_fit(
        fit: &[FittedComponent; 3],
        kernel: Kernel,
        field: &Samples,
        seen: &Vector3<f64>,
    ) -> Option<Kriging> {
        let solved = |axis: usize| {
            let fitted = &fit[axis].hyperparameters;
            let component = Component {
                length: fitted.length.clone(),
                signal_m: fitted.signal_m,
                noise_m: fitted.noise_m.unwrap_or(0.0),
                seen: seen[axis],
                trend_m: 0.0,
                weights_per_m: Vec::new(),
            };
            component.solved(kernel, field, axis)
        };
        Some(Kriging { kernel, components: [solved(0)?, solved(1)?, solved(2)?] })
    }

    /// The same parameters solved for another field.
    pub fn on(&self, field: &Samples) -> Option<Kriging> {
        let solved = |axis: usize| self.components[axis].clone().solved(self.kernel, field, axis);
        Some(Kriging { kernel: self.kernel, components: [solved(0)?, solved(1)?, solved(2)?] })
    }

    /// How much of the declared uncertainties each component scatters by.
    pub fn seen(&self) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| self.components[axis].seen)
    }

    /// Variance (m²) by which a measurement scatters about what the machine does, at a point of a field: the part of its declared
    /// uncertainty that is seen.
    pub fn scatter_m2(&self, field: &Samples, index: usize) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| self.components[axis].scatter(field, axis, index))
    }

    /// Variance (m²) that the points around one of a field have in common with it and that none of them shows: the part of its
    /// declared uncertainty that is not seen.
    pub fn common_m2(&self, field: &Samples, index: usize) -> Vector3<f64> {
        let declared = field.u_m().map_or(Vector3::zeros(), |u| u[index]);
        Vector3::from_fn(|axis, _| (1.0 - self.components[axis].seen.powi(2)) * declared[axis].powi(2))
    }

    /// Variance (m²) of what neighbouring points do not share, beyond what is declared.
    pub fn unshared_m2(&self) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| self.components[axis].noise_m.powi(2))
    }
}

impl Component {
    /// Trend and weights for these parameters; `None` if the covariance of the points is not positive definite.
    pub(crate) fn solved(mut self, kernel: Kernel, field: &Samples, axis: usize) -> Option<Component> {
        let (count, scales) = (field.count(), per_length(kernel, &self.length));
        let covariance = Mat::from_fn(count, count, |i, j| {
            self.covariance(kernel, &scales, field.point(i), field.point(j))
                + if i == j { self.noise(field, axis, i) } else { 0.0 }
        });
        let factor = Llt::new(covariance.as_ref(), Side::Lower).ok()?;
        let right = Mat::from_fn(count, 2, |i, k| if k == 0 { field.errors_m()[i][axis] } else { 1.0 });
        let solved = factor.solve(&right);
        let sum = |k: usize| (0..count).map(|i| solved[(i, k)]).sum::<f64>();
        self.trend_m = sum(0) / sum(1);
        self.weights_per_m = (0..count).map(|i| solved[(i, 0)] - self.trend_m * solved[(i, 1)]).collect();
        let is_finite = self.trend_m.is_finite() && self.weights_per_m.iter().all(|w| w.is_finite());
        is_finite.then_some(self)
    }

    /// Covariance of the signal at two points; `scales` is what [`per_length`] gives for its lengths.
    fn covariance(&self, kernel: Kernel, scales: &[f64; MOST_INPUTS], a: &[f64], b: &[f64]) -> f64 {
        let square = scales.iter().zip(a.iter().zip(b)).map(|(scale, (a, b))| ((a - b) * scale).powi(2)).sum();
        self.signal_m * self.signal_m * correlation(kernel, square)
    }

    /// Noise variance of a calibrated point (m²).
    fn noise(&self, field: &Samples, axis: usize, index: usize) -> f64 {
        self.noise_m * self.noise_m + field.u_m().map_or(0.0, |u| u[index][axis].powi(2))
    }

    /// The part of the declared variance of a calibrated point that shows as scatter (m²).
    fn scatter(&self, field: &Samples, axis: usize, index: usize) -> f64 {
        field.u_m().map_or(0.0, |u| (self.seen * u[index][axis]).powi(2))
    }
}

/// A kernel that is known when loops are compiled, so that they have no branches.
trait Correlation {
    /// Factor on distances over length scales with which the kernel is a polynomial times 2^−t: no factors are left in the loops.
    const SCALE: f64;
    /// Correlation at a scaled square distance Σ (SCALE Δ_d/ℓ_d)².
    fn at(square: f64) -> f64;
}

struct Matern52;
struct SquaredExponential;

/// (1 + a + a²/3) e^−a with a = √5 Δ/ℓ = t ln 2.
impl Correlation for Matern52 {
    const SCALE: f64 = 2.236_067_977_499_79 * LOG2_E;

    #[inline(always)]
    fn at(square: f64) -> f64 {
        let t = square.sqrt();
        (1.0 + LN_2 * t + LN_2 * LN_2 / 3.0 * square) * halved(t)
    }
}

/// e^−(Δ/ℓ)²/2 = 2^−t².
impl Correlation for SquaredExponential {
    const SCALE: f64 = 0.849_321_800_288_019_1; // √(log₂ e / 2)

    #[inline(always)]
    fn at(square: f64) -> f64 {
        halved(square)
    }
}

fn correlation(kernel: Kernel, square: f64) -> f64 {
    match kernel {
        Kernel::Matern52 => Matern52::at(square),
        Kernel::SquaredExponential => SquaredExponential::at(square),
    }
}

/// Scaled distance of points that are one apart in each input; 0 where there is no such input.
fn per_length(kernel: Kernel, length: &[f64]) -> [f64; MOST_INPUTS] {
    let scale = match kernel {
        Kernel::Matern52 => Matern52::SCALE,
        Kernel::SquaredExponential => SquaredExponential::SCALE,
    };
    std::array::from_fn(|d| length.get(d).map_or(0.0, |length| scale / length))
}

/// Evaluates the mean of a [`Kriging`].
#[derive(Debug, Clone)]
pub struct KrigingMean {
    kernel: Kernel,
    /// Inputs of a point.
    size: usize,
    /// Calibrated points, as many at a time as run in registers, of these one input after the other; padded with weights of zero.
    place: Vec<[f64; LANES]>,
    components: [Signal; 3],
}

/// What the mean of one component adds up.
#[derive(Debug, Clone)]
struct Signal {
    trend_m: f64,
    /// Square of the scaled distance of points one apart in each input.
    scale: [f64; MOST_INPUTS],
    weight_m: Vec<[f64; LANES]>,
}

impl KrigingMean {
    /// Prepares the evaluation; the field is the one that the kriging was solved for.
    pub fn new(kriging: &Kriging, field: &Samples) -> KrigingMean {
        let signal = |component: &Component| Signal {
            trend_m: component.trend_m,
            scale: per_length(kriging.kernel, &component.length).map(|s| s * s),
            weight_m: in_lanes(component.weights_per_m.iter().map(|w| w * component.signal_m * component.signal_m)),
        };
        let size = field.size();
        let inputs: Vec<_> = (0..size).map(|d| in_lanes(field.points().map(move |point| point[d]))).collect();
        KrigingMean {
            kernel: kriging.kernel,
            size,
            place: (0..inputs[0].len()).flat_map(|group| inputs.iter().map(move |input| input[group])).collect(),
            components: kriging.components.each_ref().map(signal),
        }
    }

    /// Expected residual (m) at a point of as many inputs as the calibrated ones.
    pub fn at(&self, point: &[f64]) -> Vector3<f64> {
        wide((self, point))
    }

    /// `size` is that of the model: known when this is compiled for positions, which are most models.
    #[inline(always)]
    fn sums<C: Correlation>(&self, size: usize, point: &[f64]) -> Vector3<f64> {
        let mut sums = [[0.0; LANES]; 3];
        let weights = self.components.each_ref().map(|component| component.weight_m.as_slice());
        for (k, place) in self.place.chunks_exact(size).enumerate() {
            let mut scaled = [[0.0; LANES]; 3];
            for d in 0..size {
                for lane in 0..LANES {
                    let delta = place[d][lane] - point[d];
                    for (scaled, component) in scaled.iter_mut().zip(&self.components) {
                        scaled[lane] += delta * delta * component.scale[d];
                    }
                }
            }
            for axis in 0..3 {
                for lane in 0..LANES {
                    sums[axis][lane] += C::at(scaled[axis][lane]) * weights[axis][k][lane];
                }
            }
        }
        Vector3::from_fn(|axis, _| self.components[axis].trend_m + sums[axis].iter().sum::<f64>())
    }

    #[inline(always)]
    fn of_size<C: Correlation>(&self, point: &[f64]) -> Vector3<f64> {
        match self.size {
            3 => self.sums::<C>(3, &point[..3]),
            size => self.sums::<C>(size, &point[..size]),
        }
    }
}

/// Numbers in groups, the last one filled up with zeros.
fn in_lanes(values: impl Iterator<Item = f64>) -> Vec<[f64; LANES]> {
    let values: Vec<f64> = values.collect();
    let group = |group: &[f64]| std::array::from_fn(|lane| group.get(lane).copied().unwrap_or(0.0));
    values.chunks(LANES).map(group).collect()
}

impl Loops for (&KrigingMean, &[f64]) {
    type Output = Vector3<f64>;

    #[inline(always)]
    fn run(self) -> Vector3<f64> {
        let (mean, point) = self;
        match mean.kernel {
            Kernel::Matern52 => mean.of_size::<Matern52>(point),
            Kernel::SquaredExponential => mean.of_size::<SquaredExponential>(point),
        }
    }
}

/// Evaluates the variance of a [`Kriging`].
#[derive(Debug, Clone)]
pub(crate) struct KrigingVariance {
    kernel: Kernel,
    /// Inputs of a point.
    size: usize,
    components: [Surroundings; 3],
}

/// What the variance of one component needs.
#[derive(Debug, Clone)]
struct Surroundings {
    per_length: [f64; MOST_INPUTS],
    variance_m2: f64,
    /// For each calibrated point the nearest ones in scaled distances, one input after the other; what stands in places left over has
    /// no effect.
    place: Vec<[f64; NEAREST]>,
    local: Vec<Local>,
}

/// What it needs of the points around one calibrated point.
#[derive(Debug, Clone)]
struct Local {
    /// A by its cyclic diagonals, `[d][i]` = A_i,i+d: the matrix is symmetric, so half of them say all, with the factor of those
    /// that stand for two.
    inverse: [[f64; NEAREST]; DIAGONALS],
    /// A 1 and 1ᵀA1.
    row_sums: [f64; NEAREST],
    total: f64,
}

impl KrigingVariance {
    /// Prepares the evaluation; `None` if the covariance of neighbouring points is not positive definite.
    pub(crate) fn new(kriging: &Kriging, field: &Samples) -> Option<KrigingVariance> {
        let of = |axis: usize| Surroundings::new(kriging.kernel, &kriging.components[axis], field, axis);
        Some(KrigingVariance { kernel: kriging.kernel, size: field.size(), components: [of(0)?, of(1)?, of(2)?] })
    }

    /// Variance of the field (m²) at a point whose nearest calibrated point is `nearest`.
    pub(crate) fn at(&self, point: &[f64], nearest: usize) -> Vector3<f64> {
        wide((self, point, nearest))
    }

    #[inline(always)]
    fn of_size<C: Correlation>(&self, point: &[f64], nearest: usize) -> Vector3<f64> {
        match self.size {
            3 => self.variances::<C>(3, &point[..3], nearest),
            size => self.variances::<C>(size, &point[..size], nearest),
        }
    }

    #[inline(always)]
    fn variances<C: Correlation>(&self, size: usize, point: &[f64], nearest: usize) -> Vector3<f64> {
        let [x, y, z] = &self.components;
        let of = |component: &Surroundings| component.variance_m2::<C>(size, point, nearest);
        Vector3::new(of(x), of(y), of(z))
    }
}

impl Loops for (&KrigingVariance, &[f64], usize) {
    type Output = Vector3<f64>;

    #[inline(always)]
    fn run(self) -> Vector3<f64> {
        let (variance, point, nearest) = self;
        match variance.kernel {
            Kernel::Matern52 => variance.of_size::<Matern52>(point, nearest),
            Kernel::SquaredExponential => variance.of_size::<SquaredExponential>(point, nearest),
        }
    }
}

impl Surroundings {
    fn new(kernel: Kernel, component: &Component, field: &Samples, axis: usize) -> Option<Surroundings> {
        let per_length = per_length(kernel, &component.length);
        let (mut place, mut local) = (Vec::with_capacity(field.count() * field.size()), Vec::new());
        for centre in 0..field.count() {
            let near = nearest(component, field, centre);
            for d in 0..field.size() {
                let at = |i: usize| near.get(i).map_or(0.0, |index| field.point(*index)[d] * per_length[d]);
                place.push(std::array::from_fn(at));
            }
            let covariance = Mat::from_fn(near.len(), near.len(), |i, j| {
                let noise = if i == j { component.noise(field, axis, near[i]) } else { 0.0 };
                component.covariance(kernel, &per_length, field.point(near[i]), field.point(near[j])) + noise
            });
            local.push(Local::new(&Llt::new(covariance.as_ref(), Side::Lower).ok()?.inverse())?);
        }
        Some(Surroundings { per_length, variance_m2: component.signal_m * component.signal_m, place, local })
    }

    #[inline(always)]
    fn variance_m2<C: Correlation>(&self, size: usize, point: &[f64], nearest: usize) -> f64 {
        let local = &self.local[nearest];
        let mut scaled = [0.0; NEAREST];
        for (d, place) in self.place[nearest * size..(nearest + 1) * size].iter().enumerate() {
            let at = point[d] * self.per_length[d];
            for lane in 0..NEAREST {
                let delta = place[lane] - at;
                scaled[lane] += delta * delta;
            }
        }
        // Twice in a row, so that the diagonals run on where the rows end.
        let mut twice = [0.0; 2 * NEAREST];
        for lane in 0..NEAREST {
            twice[lane] = self.variance_m2 * C::at(scaled[lane]);
        }
        let (k, again) = twice.split_at_mut(NEAREST);
        again.copy_from_slice(k);
        let mut solved = [0.0; NEAREST];
        for (d, diagonal) in local.inverse.iter().enumerate() {
            for lane in 0..NEAREST {
                solved[lane] += diagonal[lane] * twice[lane + d];
            }
        }
        let k = &twice[..NEAREST];
        let open = 1.0 - dot(&local.row_sums, k);
        // Rounding may leave less than nothing where the field is known exactly.
        (self.variance_m2 - dot(&solved, k)).max(0.0) + open * open / local.total
    }
}

/// The calibrated points nearest to one of them in scaled distances, that one first.
fn nearest(component: &Component, field: &Samples, centre: usize) -> Vec<usize> {
    let from = field.point(centre);
    let square = |k: usize| -> f64 {
        let parts = field.point(k).iter().zip(from).zip(&component.length);
        parts.map(|((at, from), length)| ((at - from) / length).powi(2)).sum()
    };
    let mut near: Vec<(f64, usize)> = (0..field.count()).map(|k| (square(k), k)).collect();
    let by_distance = |a: &(f64, usize), b: &(f64, usize)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    if near.len() > NEAREST {
        near.select_nth_unstable_by(NEAREST - 1, by_distance);
        near.truncate(NEAREST);
    }
    near.sort_by(by_distance);
    near.into_iter().map(|(_, index)| index).collect()
}

impl Local {
    /// From A; `None` if it sums up to nothing.
    fn new(inverse: &Mat<f64>) -> Option<Local> {
        let count = inverse.nrows();
        let mut local = Local { inverse: [[0.0; NEAREST]; DIAGONALS], row_sums: [0.0; NEAREST], total: 0.0 };
        for i in 0..count {
            for d in 0..DIAGONALS {
                let j = (i + d) % NEAREST;
                let times = if d == 0 || d == NEAREST - d { 1.0 } else { 2.0 };
                local.inverse[d][i] = if j < count { times * inverse[(i, j)] } else { 0.0 };
            }
            local.row_sums[i] = (0..count).map(|j| inverse[(i, j)]).sum();
        }
        local.total = local.row_sums.iter().sum();
        (local.total > 0.0 && local.total.is_finite()).then_some(local)
    }
}

#[inline(always)]
fn dot(a: &[f64; NEAREST], b: &[f64]) -> f64 {
    let mut sums = [0.0; LANES];
    for (a, b) in a.chunks_exact(LANES).zip(b.chunks_exact(LANES)) {
        for lane in 0..LANES {
            sums[lane] += a[lane] * b[lane];
        }
    }
    sums.iter().sum()
}

#[cfg(test)]
mod tests;
