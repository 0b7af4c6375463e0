//! Kriging as it runs live: the mean exactly, the variance from the nearest calibrated points.
//!
//! Place in the flow: fitted length scales (m) from `abbe_field::kriging` and calibrated residuals (m) in, mean and standard
//! uncertainty of the field (m) at any point out; on its own, below the network, and as the measure of how far a point lies
//! from what was measured. Each component: constant trend β, signal s² ρ(Δ/ℓ), noise σ² + u².
//! Mean β + s² Σ ρ(x, x_i) α_i with α = K⁻¹(y − β) over all points. Variance s² − kᵀA k + (1 − 1ᵀA k)²/(1ᵀA1) over the
//! [`NEAREST`] points around the nearest one, A = K⁻¹ of these: never below the variance from all points, and it costs the same
//! however many there are. (On smooth fields of 150 points the deviation is up to 2.2 times that from all points among them, and
//! up to 3.4 times beyond the edge; calibration takes the mean of it back.) Source: Rasmussen & Williams 2006, eq. 2.25, 2.41-2.42.

use crate::exponential::halved;
use crate::registers::{Loops, wide};
use abbe_field::MeasuredField;
use abbe_field::kriging::Kernel;
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
    /// Length scales along x, y, z (m).
    pub length_m: Vector3<f64>,
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
        fit: &abbe_field::Kriging,
        kernel: Kernel,
        field: &MeasuredField,
        seen: &Vector3<f64>,
    ) -> Option<Kriging> {
        let solved = |axis: usize| {
            let fitted = fit.fitted()[axis].hyperparameters;
            let component = Component {
                length_m: Vector3::from(fitted.length_m),
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
    pub fn on(&self, field: &MeasuredField) -> Option<Kriging> {
        let solved = |axis: usize| self.components[axis].clone().solved(self.kernel, field, axis);
        Some(Kriging { kernel: self.kernel, components: [solved(0)?, solved(1)?, solved(2)?] })
    }

    /// How much of the declared uncertainties each component scatters by.
    pub fn seen(&self) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| self.components[axis].seen)
    }

    /// Variance (m²) by which a measurement scatters about what the machine does, at a point of a field: the part of its declared
    /// uncertainty that is seen.
    pub fn scatter_m2(&self, field: &MeasuredField, index: usize) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| self.components[axis].scatter(field, axis, index))
    }

    /// Variance (m²) that the points around one of a field have in common with it and that none of them shows: the part of its
    /// declared uncertainty that is not seen.
    pub fn common_m2(&self, field: &MeasuredField, index: usize) -> Vector3<f64> {
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
    pub(crate) fn solved(mut self, kernel: Kernel, field: &MeasuredField, axis: usize) -> Option<Component> {
        let points = field.points_m();
        let covariance = Mat::from_fn(points.len(), points.len(), |i, j| {
            self.covariance(kernel, &points[i], &points[j]) + if i == j { self.noise(field, axis, i) } else { 0.0 }
        });
        let factor = Llt::new(covariance.as_ref(), Side::Lower).ok()?;
        let right = Mat::from_fn(points.len(), 2, |i, k| if k == 0 { field.errors_m()[i][axis] } else { 1.0 });
        let solved = factor.solve(&right);
        let sum = |k: usize| (0..points.len()).map(|i| solved[(i, k)]).sum::<f64>();
        self.trend_m = sum(0) / sum(1);
        self.weights_per_m = (0..points.len()).map(|i| solved[(i, 0)] - self.trend_m * solved[(i, 1)]).collect();
        let is_finite = self.trend_m.is_finite() && self.weights_per_m.iter().all(|w| w.is_finite());
        is_finite.then_some(self)
    }

    fn covariance(&self, kernel: Kernel, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
        let square = (a - b).component_mul(&per_length(kernel, &self.length_m)).norm_squared();
        self.signal_m * self.signal_m * correlation(kernel, square)
    }

    /// Noise variance of a calibrated point (m²).
    fn noise(&self, field: &MeasuredField, axis: usize, index: usize) -> f64 {
        self.noise_m * self.noise_m + field.u_m().map_or(0.0, |u| u[index][axis].powi(2))
    }

    /// The part of the declared variance of a calibrated point that shows as scatter (m²).
    fn scatter(&self, field: &MeasuredField, axis: usize, index: usize) -> f64 {
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

/// Scaled distance of points that are a metre apart along each axis.
fn per_length(kernel: Kernel, length_m: &Vector3<f64>) -> Vector3<f64> {
    let scale = match kernel {
        Kernel::Matern52 => Matern52::SCALE,
        Kernel::SquaredExponential => SquaredExponential::SCALE,
    };
    length_m.map(|length| scale / length)
}

/// Evaluates the mean of a [`Kriging`].
#[derive(Debug, Clone)]
pub struct KrigingMean {
    kernel: Kernel,
    /// Calibrated points (m) by coordinate, as many at a time as run in registers; padded with weights of zero.
    place_m: [Vec<[f64; LANES]>; 3],
    components: [Signal; 3],
}

/// What the mean of one component adds up.
#[derive(Debug, Clone)]
struct Signal {
    trend_m: f64,
    /// Square of the scaled distance of points a metre apart along each axis.
    scale_per_m2: Vector3<f64>,
    weight_m: Vec<[f64; LANES]>,
}

impl KrigingMean {
    /// Prepares the evaluation; the field is the one that the kriging was solved for.
    pub fn new(kriging: &Kriging, field: &MeasuredField) -> KrigingMean {
        let points = field.points_m();
        let signal = |component: &Component| Signal {
            trend_m: component.trend_m,
            scale_per_m2: per_length(kriging.kernel, &component.length_m).map(|s| s * s),
            weight_m: in_lanes(component.weights_per_m.iter().map(|w| w * component.signal_m * component.signal_m)),
        };
        KrigingMean {
            kernel: kriging.kernel,
            place_m: std::array::from_fn(|axis| in_lanes(points.iter().map(|point| point[axis]))),
            components: kriging.components.each_ref().map(signal),
        }
    }

    /// Expected residual (m) at a point (m, machine frame).
    pub fn at(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        wide((self, point_m))
    }

    #[inline(always)]
    fn sums<C: Correlation>(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        let mut sums = [[0.0; LANES]; 3];
        let [x, y, z] = &self.place_m;
        let weights = self.components.each_ref().map(|component| component.weight_m.as_slice());
        for k in 0..x.len() {
            let mut squares = [[0.0; LANES]; 3];
            for lane in 0..LANES {
                let [dx, dy, dz] = [x[k][lane] - point_m.x, y[k][lane] - point_m.y, z[k][lane] - point_m.z];
                [squares[0][lane], squares[1][lane], squares[2][lane]] = [dx * dx, dy * dy, dz * dz];
            }
            for (axis, component) in self.components.iter().enumerate() {
                let scale = &component.scale_per_m2;
                for lane in 0..LANES {
                    let [xx, yy, zz] = [squares[0][lane], squares[1][lane], squares[2][lane]];
                    sums[axis][lane] += C::at(xx * scale.x + yy * scale.y + zz * scale.z) * weights[axis][k][lane];
                }
            }
        }
        Vector3::from_fn(|axis, _| self.components[axis].trend_m + sums[axis].iter().sum::<f64>())
    }
}

/// Numbers in groups, the last one filled up with zeros.
fn in_lanes(values: impl Iterator<Item = f64>) -> Vec<[f64; LANES]> {
    let values: Vec<f64> = values.collect();
    let group = |group: &[f64]| std::array::from_fn(|lane| group.get(lane).copied().unwrap_or(0.0));
    values.chunks(LANES).map(group).collect()
}

impl Loops for (&KrigingMean, &Vector3<f64>) {
    type Output = Vector3<f64>;

    #[inline(always)]
    fn run(self) -> Vector3<f64> {
        let (mean, point_m) = self;
        match mean.kernel {
            Kernel::Matern52 => mean.sums::<Matern52>(point_m),
            Kernel::SquaredExponential => mean.sums::<SquaredExponential>(point_m),
        }
    }
}

/// Evaluates the variance of a [`Kriging`].
#[derive(Debug, Clone)]
pub(crate) struct KrigingVariance {
    kernel: Kernel,
    components: [Vec<Local>; 3],
}

/// What the variance of a component near one calibrated point needs.
#[derive(Debug, Clone)]
struct Local {
    per_length: Vector3<f64>,
    variance_m2: f64,
    /// Nearest calibrated points in scaled distances; what stands in places left over has no effect.
    place: [[f64; NEAREST]; 3],
    /// A by its cyclic diagonals, `[d][i]` = A_i,i+d: the matrix is symmetric, so half of them say all, with the factor of those
    /// that stand for two.
    inverse: [[f64; NEAREST]; DIAGONALS],
    /// A 1 and 1ᵀA1.
    row_sums: [f64; NEAREST],
    total: f64,
}

impl KrigingVariance {
    /// Prepares the evaluation; `None` if the covariance of neighbouring points is not positive definite.
    pub(crate) fn new(kriging: &Kriging, field: &MeasuredField) -> Option<KrigingVariance> {
        let near = |axis: usize| -> Option<Vec<Local>> {
            let component = &kriging.components[axis];
            (0..field.points_m().len()).map(|k| Local::new(kriging.kernel, component, field, axis, k)).collect()
        };
        Some(KrigingVariance { kernel: kriging.kernel, components: [near(0)?, near(1)?, near(2)?] })
    }

    /// Variance of the field (m²) at a point (m) whose nearest calibrated point is `nearest`.
    pub(crate) fn at(&self, point_m: &Vector3<f64>, nearest: usize) -> Vector3<f64> {
        wide((self, point_m, nearest))
    }

    #[inline(always)]
    fn variances<C: Correlation>(&self, point_m: &Vector3<f64>, nearest: usize) -> Vector3<f64> {
        let [x, y, z] = &self.components;
        let (x, y, z) = (&x[nearest], &y[nearest], &z[nearest]);
        Vector3::new(x.variance_m2::<C>(point_m), y.variance_m2::<C>(point_m), z.variance_m2::<C>(point_m))
    }
}

impl Loops for (&KrigingVariance, &Vector3<f64>, usize) {
    type Output = Vector3<f64>;

    #[inline(always)]
    fn run(self) -> Vector3<f64> {
        let (variance, point_m, nearest) = self;
        match variance.kernel {
            Kernel::Matern52 => variance.variances::<Matern52>(point_m, nearest),
            Kernel::SquaredExponential => variance.variances::<SquaredExponential>(point_m, nearest),
        }
    }
}

impl Local {
    fn new(kernel: Kernel, component: &Component, field: &MeasuredField, axis: usize, centre: usize) -> Option<Local> {
        let points = field.points_m();
        let square = |k: usize| (points[k] - points[centre]).component_div(&component.length_m).norm_squared();
        let mut near: Vec<(f64, usize)> = (0..points.len()).map(|k| (square(k), k)).collect();
        let by_distance = |a: &(f64, usize), b: &(f64, usize)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
        if near.len() > NEAREST {
            near.select_nth_unstable_by(NEAREST - 1, by_distance);
            near.truncate(NEAREST);
        }
        near.sort_by(by_distance);
        let covariance = Mat::from_fn(near.len(), near.len(), |i, j| {
            let noise = if i == j { component.noise(field, axis, near[i].1) } else { 0.0 };
            component.covariance(kernel, &points[near[i].1], &points[near[j].1]) + noise
        });
        let inverse = Llt::new(covariance.as_ref(), Side::Lower).ok()?.inverse();
        let mut local = Local {
            per_length: per_length(kernel, &component.length_m),
            variance_m2: component.signal_m * component.signal_m,
            place: [[0.0; NEAREST]; 3],
            inverse: [[0.0; NEAREST]; DIAGONALS],
            row_sums: [0.0; NEAREST],
            total: 0.0,
        };
        for (i, (_, index)) in near.iter().enumerate() {
            for a in 0..3 {
                local.place[a][i] = points[*index][a] * local.per_length[a];
            }
            for d in 0..DIAGONALS {
                let j = (i + d) % NEAREST;
                let times = if d == 0 || d == NEAREST - d { 1.0 } else { 2.0 };
                local.inverse[d][i] = if j < near.len() { times * inverse[(i, j)] } else { 0.0 };
            }
            local.row_sums[i] = (0..near.len()).map(|j| inverse[(i, j)]).sum();
        }
        local.total = local.row_sums.iter().sum();
        (local.total > 0.0 && local.total.is_finite()).then_some(local)
    }

    #[inline(always)]
    fn variance_m2<C: Correlation>(&self, point_m: &Vector3<f64>) -> f64 {
        let at = point_m.component_mul(&self.per_length);
        // Twice in a row, so that the diagonals run on where the rows end.
        let mut twice = [0.0; 2 * NEAREST];
        for lane in 0..NEAREST {
            let [dx, dy, dz] = [self.place[0][lane] - at.x, self.place[1][lane] - at.y, self.place[2][lane] - at.z];
            twice[lane] = self.variance_m2 * C::at(dx * dx + dy * dy + dz * dz);
        }
        let (k, again) = twice.split_at_mut(NEAREST);
        again.copy_from_slice(k);
        let mut solved = [0.0; NEAREST];
        for (d, diagonal) in self.inverse.iter().enumerate() {
            for lane in 0..NEAREST {
                solved[lane] += diagonal[lane] * twice[lane + d];
            }
        }
        let k = &twice[..NEAREST];
        let open = 1.0 - dot(&self.row_sums, k);
        // Rounding may leave less than nothing where the field is known exactly.
        (self.variance_m2 - dot(&solved, k)).max(0.0) + open * open / self.total
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
mod tests {
    use super::*;
    use crate::model::tests::{bent_field, fitted};
    use crate::neighbourhood::Neighbourhood;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Relative to the field; both solve the same equations, in other units.
    const MEAN_TOLERANCE: f64 = 1e-7;
    /// Rounding of the variances.
    const ROUNDING: f64 = 1e-6;

    #[test]
    fn val_abbe_field_mean_is_the_same_and_the_deviation_never_smaller() {
        for (noise_m, kernel) in [(2e-8, Kernel::Matern52), (4e-7, Kernel::SquaredExponential)] {
            let field = bent_field(150, noise_m, 3);
            let (reference, kriging) = fitted(&field, kernel);
            let (mean, variance) =
                (KrigingMean::new(&kriging, &field), KrigingVariance::new(&kriging, &field).unwrap());
            let search = Neighbourhood::new(field.points_m());
            let mut random = ChaCha8Rng::seed_from_u64(1);
            for _ in 0..200 {
                let at = Vector3::from_fn(|_, _| random.random::<f64>() * 0.7 - 0.1);
                let nearest = search.vertices(&at).unwrap().nearest;
                let expected = reference.predict(&at);
                let error = (mean.at(&at) - expected.error_m).norm();
                assert!(error < MEAN_TOLERANCE * 1e-6, "{at}: {error}");
                let deviation = variance.at(&at, nearest).map(f64::sqrt);
                for axis in 0..3 {
                    let ratio = deviation[axis] / expected.u_m[axis];
                    assert!(ratio > 1.0 - ROUNDING, "{at}: {ratio}");
                }
            }
        }
    }

    #[test]
    fn wide_registers_give_the_bits_of_the_plain_loops() {
        for kernel in [Kernel::Matern52, Kernel::SquaredExponential] {
            let field = bent_field(90, 1e-7, 5);
            let (_, kriging) = fitted(&field, kernel);
            let (mean, variance) =
                (KrigingMean::new(&kriging, &field), KrigingVariance::new(&kriging, &field).unwrap());
            for k in 0..50 {
                let at = Vector3::new(0.01, 0.004, 0.007) * f64::from(k);
                assert_eq!(mean.at(&at), (&mean, &at).run());
                assert_eq!(variance.at(&at, k as usize), (&variance, &at, k as usize).run());
            }
        }
    }

    #[test]
    fn far_from_all_points_the_variance_is_that_of_the_signal_and_its_trend() {
        let field = bent_field(100, 1e-7, 4);
        let (_, kriging) = fitted(&field, Kernel::Matern52);
        let variance = KrigingVariance::new(&kriging, &field).unwrap().at(&Vector3::repeat(1e4), 0);
        for axis in 0..3 {
            assert!(variance[axis] > kriging.components[axis].signal_m.powi(2));
        }
    }
}
