//! Does the machine wander: do its scales, angles and bows follow a course that no model of it has?
//!
//! Place in the flow: near the end of [`crate::diagnose()`], on the rows that are left. A column that leans with the room, a screw that
//! warms up, a floor that gives way: what is slow is nearly all taken for the positions of stations and for errors of position, so that
//! each form of it by itself is too small to be named. Together they are no noise. All motions of the tip that are linear or quadratic
//! in the readings (m), each times a course, are one random effect:
//!
//! ```text
//! r = C a + e,   a ~ N(0, σ² W²),   courses: cos(πkτ) with weight 1/k, or one logged quantity of standard deviation 1
//! Q = |W Cᵀ P r|² is Σ λ z² by chance, λ the eigenvalues of W Cᵀ P C W (Lin 1997, score test of a variance component)
//! ```
//!
//! σ² is estimated by REML. What is then known of a (mean and covariance) gives how far the tip wanders at the readings (m, rms along X,
//! Y, Z): it stands in the uncertainty of the model. Whether it was the machine or the stations, and by which cause, is not told.

use crate::candidates::Round;
use crate::context::{Context, range};
use crate::error::DiagnoseError;
use crate::options::Options;
use crate::quadratic_form::p_of_form;
use crate::score::golden_section;
use abbe_geometry::Vector3;
use abbe_geometry::effects::is_derived;
use abbe_geometry::model::{FitQuality, MachineModel, ModelError, ModelParts};
use abbe_identify::{TIME, symmetric_eigen};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::subset::spread;
use faer::Mat;

/// Half cycles of a course in time.
const HALF_CYCLES: usize = 8;
/// Readings at which the tip's motion is looked at.
const POINTS: usize = 300;
/// Probability below which they are all alike: a difference to one half that a number still holds.
const LEAST_P: f64 = 1e-15;
/// Eigenvalue, as a share of the largest, from which a direction is seen.
const SEEN: f64 = 1e-9;
/// Degrees of freedom that must be left beside all directions.
const FEWEST_DEGREES: f64 = 50.0;
/// ln σ²λ over the noise between which the estimate lies, λ the largest.
const LN_RATIO: (f64, f64) = (-7.0, 14.0);

/// A machine that does not stay as it is.
#[derive(Debug, Clone, PartialEq)]
pub struct Wander {
    /// What it follows: `time_s`, or a logged quantity.
    pub follows: String,
    /// Probability of as much by chance in any of the looks.
    pub p_value: f64,
    /// How far the tip wanders along X, Y and Z at the readings (m, rms).
    pub size_m: [f64; 3],
}

impl Wander {
    /// What it is and what to do, for readers.
    pub fn words(&self) -> String {
        let [x, y, z] = self.size_m.map(|m| format!("{:.2}", m * 1e6));
        format!(
            "Scales, angles or bows of the machine, or its stations, change in the course of the campaign (p = {:.1e}; most like \
             {}), in a form that these data attribute to no effect: the tip wanders by {x}, {y} and {z} µm along X, Y and Z (rms over \
             the readings). That is not corrected, and stands in U. Return to the same few points throughout the campaign, and log \
             the temperatures of what carries them.",
            self.p_value, self.follows
        )
    }

    /// The model with it in the uncertainty of all that it corrects.
    pub(crate) fn told(&self, model: MachineModel) -> Result<MachineModel, ModelError> {
        let quality = model.parts().quality.clone();
        let unexplained_m = std::array::from_fn(|d| quality.unexplained_m[d].hypot(self.size_m[d]));
        MachineModel::new(ModelParts { quality: FitQuality { unexplained_m, ..quality }, ..model.parts().clone() })
    }
}

/// What these rows show of a machine that wanders; `None` where chance explains it.
pub(crate) fn find(
    round: &Round,
    campaign: &Campaign,
    context: &Context,
    options: &Options,
    go_on: &mut dyn FnMut() -> bool,
) -> Result<Option<Wander>, DiagnoseError> {
    let used: Vec<usize> = (0..round.rows.len()).filter(|k| round.rows.whitening[*k] > 0.0).collect();
    let mut looks = Vec::new();
    for (follows, courses) in courses(campaign, context, &used) {
        for motions in [Motions::linear(campaign, &used), Motions::quadratic(campaign, &used)] {
            if !go_on() {
                return Err(DiagnoseError::Stopped);
            }
            looks.push((follows.clone(), Look { round, motions, courses: courses.clone(), used: &used }.tested()));
        }
    }
    let looks: Vec<(String, Tested)> =
        looks.into_iter().filter_map(|(follows, tested)| Some((follows, tested?))).collect();
    let p_value = together(looks.iter().map(|(_, tested)| tested.p_value));
    let Some((follows, tested)) = looks.into_iter().min_by(|a, b| a.1.p_value.total_cmp(&b.1.p_value)) else {
        return Ok(None);
    };
    Ok((p_value < options.significance).then(|| Wander { follows, p_value, size_m: tested.size_m() }))
}

/// One probability of several that depend on each other (Cauchy combination; Liu and Xie 2020): courses that are alike are no worse
/// than one of them. 1 without any.
fn together(p_values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for p_value in p_values {
        sum += ((0.5 - p_value.clamp(LEAST_P, 1.0 - LEAST_P)) * std::f64::consts::PI).tan();
        count += 1.0;
    }
    if count == 0.0 { 1.0 } else { 0.5 - (sum / count).atan() / std::f64::consts::PI }
}

/// Courses by what they follow; each about its mean over the readings used, with its weight. Without times the order has to do.
fn courses(campaign: &Campaign, context: &Context, used: &[usize]) -> Vec<(String, Vec<Vec<f64>>)> {
    let readings = &campaign.readings;
    let (first_s, last_s) = range(used.iter().map(|k| readings[*k].time_s));
    let along = |k: usize| match last_s > first_s {
        true => (readings[k].time_s - first_s) / (last_s - first_s),
        false => k as f64 / readings.len() as f64,
    };
    let about_mean = |values: Vec<f64>| {
        let mean = used.iter().map(|k| values[*k]).sum::<f64>() / used.len().max(1) as f64;
        values.into_iter().map(|value| value - mean).collect::<Vec<f64>>()
    };
    let wave = |halves: usize| {
        let phase = |k: usize| std::f64::consts::PI * halves as f64 * along(k);
        about_mean((0..readings.len()).map(|k| phase(k).cos() / halves as f64).collect())
    };
    let mut all = vec![(TIME.to_owned(), (1..=HALF_CYCLES).map(wave).collect())];
    // What is slow, as it was logged: neither the side of approach nor what lags behind another one.
    let slow = context.varying.iter().filter(|name| *name != TIME && !is_derived(name) && !name.starts_with("dir_"));
    for name in slow {
        let Some(column) = campaign.covariates.iter().find(|column| column.name == *name) else { continue };
        let Some(values) = column.values.iter().copied().collect::<Option<Vec<f64>>>() else { continue };
        let values = about_mean(values);
        let square = used.iter().map(|k| values[*k].powi(2)).sum::<f64>() / used.len().max(1) as f64;
        if square > 0.0 {
            all.push((name.clone(), vec![values.into_iter().map(|value| value / square.sqrt()).collect()]));
        }
    }
    all
}

/// Motions of the tip at every reading (m per unit).
#[derive(Clone)]
struct Motions(Vec<Vec<Vector3<f64>>>);

impl Motions {
    /// Shifts, scales along the axes and angles between them.
    fn linear(campaign: &Campaign, used: &[usize]) -> Motions {
        let (places, _) = places(campaign, used);
        let shift = |d: usize| places.iter().map(|_| Vector3::ith(d, 1.0)).collect::<Vec<_>>();
        let along = |d: usize, by: usize| places.iter().map(|place| Vector3::ith(d, place[by])).collect::<Vec<_>>();
        let scales = (0..3).flat_map(|d| (d..3).map(move |by| (d, by)));
        Motions((0..3).map(shift).chain(scales.map(|(d, by)| along(d, by))).collect())
    }

    /// These, and bows: what is quadratic in the readings, at the ends of the strokes as large as what is linear.
    fn quadratic(campaign: &Campaign, used: &[usize]) -> Motions {
        let (places, spans) = places(campaign, used);
        let pairs = (0..3).flat_map(|a| (a..3).map(move |b| (a, b)));
        let bows = pairs.flat_map(|(a, b)| (0..3).map(move |d| (d, a, b)));
        let bow = |(d, a, b): (usize, usize, usize)| {
            let longer = spans[a].max(spans[b]).max(f64::MIN_POSITIVE);
            places.iter().map(|place| Vector3::ith(d, 2.0 * place[a] * place[b] / longer)).collect::<Vec<_>>()
        };
        let mut motions = Motions::linear(campaign, used);
        motions.0.extend(bows.map(bow));
        motions
    }
}

/// Readings from the middle of those used (m), and their spans.
fn places(campaign: &Campaign, used: &[usize]) -> (Vec<[f64; 3]>, [f64; 3]) {
    let ends: [(f64, f64); 3] = std::array::from_fn(|d| range(used.iter().map(|k| campaign.readings[*k].reading_m[d])));
    let middle = ends.map(|(low, high)| f64::midpoint(low, high));
    let places = campaign.readings.iter().map(|r| std::array::from_fn(|d| r.reading_m[d] - middle[d])).collect();
    (places, ends.map(|(low, high)| high - low))
}

/// Motions times courses, against the rows.
struct Look<'l> {
    round: &'l Round<'l>,
    motions: Motions,
    courses: Vec<Vec<f64>>,
    used: &'l [usize],
}

/// What they tell.
struct Tested<'l> {
    look: Look<'l>,
    p_value: f64,
    /// Eigenvalues and vectors of what is left of the columns, and the gradient along each.
    values: Vec<f64>,
    vectors: Mat<f64>,
    along: Vec<f64>,
    /// Noise per degree of freedom beside all these directions.
    noise: f64,
}

impl<'l> Look<'l> {
    fn pairs(&self) -> impl Iterator<Item = (&Vec<Vector3<f64>>, &Vec<f64>)> {
        self.motions.0.iter().flat_map(|motion| self.courses.iter().map(move |course| (motion, course)))
    }

    /// `None` where the rows are too few, or show nothing of it.
    fn tested(self) -> Option<Tested<'l>> {
        let rows = &self.round.rows;
        let columns: Vec<Vec<f64>> = self
            .pairs()
            .map(|(motion, course)| {
                let at = |k: usize| match rows.whitening[k] > 0.0 {
                    true => rows.rays[k].direction.dot(&motion[k]) * course[k],
                    false => 0.0,
                };
                let mut column: Vec<f64> = (0..rows.len()).map(at).collect();
                rows.whiten(&mut column);
                column
            })
            .collect();
        let projected = self.round.free.project(Mat::from_fn(rows.len(), columns.len(), |k, j| columns[j][k]).as_ref());
        let count = columns.len();
        let left = Mat::from_fn(count, count, |i, j| 0.5 * (projected.left[(i, j)] + projected.left[(j, i)]));
        let (values, vectors) = symmetric_eigen(&left)?;
        let largest = values.last().copied().filter(|value| *value > 0.0)?;
        let along: Vec<f64> =
            (0..count).map(|k| (0..count).map(|i| vectors[(i, k)] * projected.gradient[i]).sum()).collect();
        let seen: Vec<usize> = (0..count).filter(|k| values[*k] > SEEN * largest).collect();
        let explained: f64 = seen.iter().map(|k| along[*k] * along[*k] / values[*k]).sum();
        let degrees = self.round.free.degrees() - seen.len() as f64;
        let noise = (self.round.free.chi2() - explained) / degrees;
        if degrees < FEWEST_DEGREES || !noise.is_finite() || noise <= 0.0 {
            return None;
        }
        let form: f64 = seen.iter().map(|k| along[*k] * along[*k]).sum::<f64>() / noise;
        let seen_values: Vec<f64> = seen.iter().map(|k| values[*k]).collect();
        let p_value = p_of_form(&seen_values, form, degrees);
        Some(Tested { p_value, values, vectors, along, noise, look: self })
    }
}

impl Tested<'_> {
    /// σ² of the courses (unit of the columns, squared) by REML; 0 where the noise explains the rows best.
    fn variance(&self) -> f64 {
        let largest = self.values.last().copied().unwrap_or(0.0);
        let seen = || self.values.iter().zip(&self.along).filter(|(value, _)| **value > SEEN * largest);
        let likelihood = |variance: f64| -> f64 {
            let of = |(value, along): (&f64, &f64)| {
                let total = self.noise + variance * value;
                -0.5 * (total.ln() + along * along / value / total)
            };
            seen().map(of).sum()
        };
        let of = |ln_ratio: f64| self.noise / largest * ln_ratio.exp();
        let best = of(golden_section(LN_RATIO, |ln_ratio| likelihood(of(ln_ratio))));
        if likelihood(best) > likelihood(0.0) { best } else { 0.0 }
    }

    /// Rms over the readings of what is known of the motion along X, Y and Z, and of what is not (m).
    fn size_m(&self) -> [f64; 3] {
        let (variance, count) = (self.variance(), self.along.len());
        let shrunk = |k: usize| variance / (self.noise + variance * self.values[k].max(0.0));
        // Second moment of the coefficients: mean · meanᵀ + covariance, both in the directions of the eigenvectors.
        let mean: Vec<f64> = (0..count).map(|k| shrunk(k) * self.along[k]).collect();
        let spread_of: Vec<f64> = (0..count).map(|k| shrunk(k) * self.noise).collect();
        let readings = spread(self.look.used.len(), POINTS);
        let mut square_m2 = [0.0; 3];
        for reading in &readings {
            let k = self.look.used[*reading];
            for (d, square_m2) in square_m2.iter_mut().enumerate() {
                let column: Vec<f64> = self.look.pairs().map(|(motion, course)| motion[k][d] * course[k]).collect();
                let turned = (0..count).map(|j| (0..count).map(|i| self.vectors[(i, j)] * column[i]).sum::<f64>());
                let (mut known, mut unknown) = (0.0, 0.0);
                for (j, part) in turned.enumerate() {
                    known += part * mean[j];
                    unknown += part * part * spread_of[j];
                }
                *square_m2 += known * known + unknown;
            }
        }
        square_m2.map(|sum| (sum / readings.len().max(1) as f64).sqrt())
    }
}
