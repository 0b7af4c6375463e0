//! Single vectors that contradict all others.
//!
//! Place in the flow: before [`super::judged`] fits. The likelihood of a Gaussian process takes one vector that is 60 µm off for
//! a field that changes from line to line, and then nothing contradicts anything. So suspects are looked for by a process whose
//! shape a few vectors cannot bend: one length scale, in extents of the inputs, and a noise, those of a small set by which
//! the others predict each vector best, judged by medians. Leaving out a vector changes these predictions by a rank-one step:
//! P′ = P − pₖpₖᵀ/Pₖₖ. The worst goes first, and all are looked at again, as one far off pulls at its neighbours. A suspect is only
//! accused here; [`super::judged`] asks the fit without it.
//! Source: Rasmussen & Williams 2006, eq. 5.12 (leaving one out); Cook & Weisberg 1982, 2.2.2 (deleted residuals).

use super::likelihood::{Data, Scaled};
use super::{KrigingError, KrigingOptions, fit};
use crate::samples::Samples;
use faer::Mat;
use nalgebra::Vector3;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Deviations from which a vector is far off, as in the diagnosis and in the robust weights of identification.
pub(super) const FAR: f64 = 6.0;
/// Probability, over all components of all vectors, that one is accused that belongs there.
const BY_CHANCE: f64 = 0.01;
/// Length scales tried, in extents.
const LENGTHS: [f64; 5] = [0.15, 0.3, 0.6, 1.2, 2.4];
/// Noises tried, in deviations of the signal.
const NOISES: [f64; 4] = [0.01, 0.03, 0.1, 0.3];
/// Median of |z| for a standard normal z.
const MEDIAN_OF_NORMAL: f64 = 0.674_489_750_196_081_7;
/// What a scale by the median is worth in degrees of freedom of one by squares.
const EFFICIENCY: f64 = 0.37;
/// Searches, each with the shape that those kept by the one before suggest.
const SEARCHES: usize = 3;
/// Nearest vectors among which others speak for a suspect.
const NEAR: usize = 10;
/// Others that make a feature of it, and the share of its size that they must explain.
const SPEAK: usize = 2;
const EXPLAINED: f64 = 0.5;

/// Indices of vectors that one of their components accuses, ascending.
pub(super) fn suspects(samples: &Samples, options: &KrigingOptions) -> Result<Vec<usize>, KrigingError> {
    let mut accused = vec![false; samples.count()];
    for component in 0..3 {
        let (data, _) = fit::scaled(samples, component, options)?;
        for index in of_component(&data) {
            accused[index] = true;
        }
    }
    Ok((0..accused.len()).filter(|k| accused[*k]).collect())
}

/// Whether a probability by chance among so many components of vectors bears a deviation.
pub(super) fn is_far(deviations: f64, freedom: f64, components: usize) -> bool {
    let limit = BY_CHANCE / components as f64;
    let beyond = || StudentsT::new(0.0, 1.0, freedom).map_or(1.0, |t| 2.0 * t.cdf(-deviations.abs()));
    // What is no number is not looked up.
    deviations.abs() > FAR && beyond() < limit
}

fn of_component(data: &Data) -> Vec<usize> {
    let count = data.values.len();
    let mut out = Vec::new();
    for _ in 0..SEARCHES {
        let kept: Vec<usize> = (0..count).filter(|k| !out.contains(k)).collect();
        let Some(shape) = shape(&fit::part(&data.picked(&kept))) else { break };
        let Some(found) = search(data, &shape) else { break };
        if found == out {
            break;
        }
        out = found;
    }
    out.sort_unstable();
    out
}

/// The shape by which the others predict each vector best: the least logarithm of the predicted deviation, its scale by the
/// median.
fn shape(data: &Data) -> Option<Scaled> {
    let mut best: Option<(f64, Scaled)> = None;
    for length in LENGTHS {
        for noise in NOISES {
            let shape = tried(data.size, length, noise);
            let Some(left) = Left::of(data, &shape) else { continue };
            let value = left.scale()?.ln() + left.mean_logarithm();
            if value.is_finite() && best.as_ref().is_none_or(|(least, _)| value < *least) {
                best = Some((value, shape));
            }
        }
    }
    best.map(|(_, shape)| shape)
}

fn tried(inputs: usize, length: f64, noise: f64) -> Scaled {
    Scaled { signal: 1.0, length: vec![length; inputs], noise: Some(noise) }
}

/// Vectors that go, the worst first.
fn search(data: &Data, shape: &Scaled) -> Option<Vec<usize>> {
    let mut left = Left::of(data, shape)?;
    let mut out = Vec::new();
    let components = 3 * data.values.len();
    while let Some((worst, z)) = left.worst() {
        let freedom = EFFICIENCY * left.freedom;
        let scale = left.scale()?;
        if freedom < 1.0 || scale <= 0.0 || !is_far(z / scale, freedom, components) || 4 * out.len() > data.values.len()
        {
            break;
        }
        left.leave_out(worst);
        out.push(worst);
    }
    Some(out)
}

/// What the others predict of each vector, while vectors are left out.
struct Left {
    projector: Mat<f64>,
    /// Py.
    weights: Vec<f64>,
    is_in: Vec<bool>,
    freedom: f64,
}

impl Left {
    fn of(data: &Data, shape: &Scaled) -> Option<Left> {
        let factored = data.factored(shape).ok()?;
        let count = data.values.len();
        let freedom = count as f64 - factored.coefficients.len() as f64;
        let projector = factored.projector();
        // A vector that alone decides on a coefficient of the trend is predicted by nobody.
        let is_in = (0..count).map(|k| projector[(k, k)] > f64::EPSILON).collect();
        Some(Left { projector, weights: factored.weights, is_in, freedom })
    }

    fn indices(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.is_in.len()).filter(|k| self.is_in[*k])
    }

    /// Difference to what the others predict over its deviation, but for the scale.
    fn z(&self, index: usize) -> f64 {
        self.weights[index] / self.projector[(index, index)].max(f64::MIN_POSITIVE).sqrt()
    }

    fn scale(&self) -> Option<f64> {
        let mut sizes: Vec<f64> = self.indices().map(|k| self.z(k).abs()).collect();
        let middle = sizes.len() / 2;
        (!sizes.is_empty()).then(|| *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 / MEDIAN_OF_NORMAL)
    }

    /// Mean logarithm of the predicted deviations.
    fn mean_logarithm(&self) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for index in self.indices() {
            sum -= 0.5 * self.projector[(index, index)].ln();
            count += 1.0;
        }
        sum / count
    }

    fn worst(&self) -> Option<(usize, f64)> {
        self.indices().map(|k| (k, self.z(k))).max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
    }

    fn leave_out(&mut self, index: usize) {
        let count = self.is_in.len();
        let own = self.projector[(index, index)];
        let column: Vec<f64> = (0..count).map(|k| self.projector[(k, index)]).collect();
        let weight = self.weights[index];
        for j in 0..count {
            let share = column[j] / own;
            self.weights[j] -= share * weight;
            for (i, of_row) in column.iter().enumerate() {
                self.projector[(i, j)] -= of_row * share;
            }
        }
        self.is_in[index] = false;
        self.freedom -= 1.0;
    }
}

/// What others say of a suspect in the search for suspects: whether those about it, suspects too, are off to the same side
/// and predict it.
pub(super) struct Neighbourhood {
    /// By component what all others predict wrongly of each vector, in deviations of the errors.
    left: Vec<Vec<f64>>,
    deviation_m: Vec<f64>,
    places: Vec<Vec<f64>>,
}

impl Neighbourhood {
    /// Predictions of all vectors by all others.
    pub(super) fn of(samples: &Samples, options: &KrigingOptions) -> Result<Neighbourhood, KrigingError> {
        let (mut all, mut deviation_m) = (Vec::new(), Vec::new());
        let places = scaled_places(samples);
        for component in 0..3 {
            let (data, scaling) = fit::scaled(samples, component, options)?;
            let left = tightest(&data).ok_or(fit::not_positive(component))?;
            let of = |k: usize| left.weights[k] / left.projector[(k, k)].max(f64::MIN_POSITIVE);
            all.push((0..data.values.len()).map(of).collect());
            deviation_m.push(scaling.deviation_m);
        }
        Ok(Neighbourhood { left: all, deviation_m, places })
    }

    /// Whether a suspect, off by so much (m) in a component, is one of a feature of the field: at least two others of the ten
    /// nearest vectors are suspects and off to the same side, and with them it is predicted to within half of that.
    pub(super) fn is_feature(&self, index: usize, component: usize, off_m: &[(usize, Vector3<f64>)]) -> bool {
        let Some((_, own_m)) = off_m.iter().find(|(k, _)| *k == index) else { return false };
        let own_m = own_m[component];
        let apart = |(a, b): (&f64, &f64)| (a - b).powi(2);
        let distance = |k: usize| self.places[k].iter().zip(&self.places[index]).map(apart).sum::<f64>();
        let mut near: Vec<usize> = (0..self.places.len()).filter(|k| *k != index).collect();
        near.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)));
        near.truncate(NEAR);
        let agrees =
            |(k, off): &&(usize, Vector3<f64>)| near.contains(k) && off[component] * own_m > 0.25 * own_m * own_m;
        let with_others_m = self.left[component][index] * self.deviation_m[component];
        off_m.iter().filter(agrees).count() >= SPEAK && with_others_m.abs() < EXPLAINED * own_m.abs()
    }
}

/// Points in extents, as a process takes them.
fn scaled_places(samples: &Samples) -> Vec<Vec<f64>> {
    let (lower, upper) = samples.range();
    // Across a plane nothing differs.
    let of = |d: usize, at: f64| if upper[d] > lower[d] { (at - lower[d]) / (upper[d] - lower[d]) } else { 0.0 };
    samples.points().map(|at| at.iter().enumerate().map(|(d, at)| of(d, *at)).collect()).collect()
}

/// Predictions with the shortest length scale of those tried that the neighbours reach over.
fn tightest(data: &Data) -> Option<Left> {
    Left::of(data, &tried(data.size, LENGTHS[1], NOISES[2]))
}
