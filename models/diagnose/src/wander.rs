//! Does the machine wander: do its scales, angles and bows follow a course that no model of it has?
//!
//! Place in the flow: near the end of [`crate::diagnose()`], on the rows that are left. A column that leans with the room, a screw that
//! warms up, a floor that gives way: what is slow is nearly all taken for the positions of stations and for errors of position, so that
//! each form of it by itself is too small to be named. Together they are no noise. All motions of the tip that are linear or quadratic
//! in the readings (m), each times a course, are one random effect:
//!
//! ```text
//! r = C a + e,   a ~ N(0, σ² W²),   courses: cos(πkτ) with weight 1/k, one logged quantity of standard deviation 1, or a cycle
//! Q = |W Cᵀ P r|² is Σ λ z² by chance, λ the eigenvalues of W Cᵀ P C W (Lin 1997, score test of a variance component)
//! ```
//!
//! σ² is estimated by REML. What is then known of a (mean and covariance) gives how far the tip wanders at the readings (m, rms along X,
//! Y, Z): it stands in the uncertainty of the model. Whether it was the machine or the stations, and by which cause, is not told.

use crate::candidates::Round;
use crate::context::Context;
use crate::error::DiagnoseError;
use crate::linear::Projected;
use crate::options::DiagnoseOptions;
use crate::peak::peak;
use crate::quadratic_form::p_of_form;
use crate::taken::Taken;
use abbe_geometry::by_place::{FORMS, VarianceByPlace};
use abbe_geometry::model::{MachineModel, ModelError, packed};
use abbe_identify::verdict::{Cause, Finding, Grade, Subject};
use abbe_identify::{Identified, symmetric_eigen};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use abbe_measurement::subset::spread;
use faer::Mat;

mod courses;
mod cycles;
mod instead;
mod motions;

use courses::{Course, courses, in_course_of_time};
use motions::{Motions, Places, Span};

pub use instead::Slow;

/// Probability below which they are all alike: a difference to one half that a number still holds.
const LEAST_P: f64 = 1e-15;
/// Eigenvalue, as a share of the largest, from which a direction is seen.
const SEEN: f64 = 1e-9;
/// Likelihood beside that of the likeliest course below which another is left out.
const LEAST_WEIGHT: f64 = 0.01;
/// Degrees of freedom that must be left beside all directions.
const FEWEST_DEGREES: f64 = 50.0;
/// Readings from which a part of them, spread over the campaign, tells whether the machine wanders: what is slow shows in them.
const MANY: usize = 6000;
/// χ² per degree of freedom from which a residual tells by itself that the model lacks something.
const TOLD_BY_RESIDUAL: f64 = 1.5;
/// Size that readers are told (m).
const SMALLEST_M: f64 = 5e-9;
/// ln σ²λ over the noise between which the estimate lies, λ the largest.
const LN_RATIO: (f64, f64) = (-7.0, 14.0);

/// A machine that does not stay as it is.
#[derive(Debug, Clone, PartialEq)]
pub struct Wander {
    /// What it follows: `time_s`, a logged quantity, or cycles of a period.
    pub follows: String,
    /// The one motion that explains it best, where it is one.
    pub moves: Option<String>,
    /// Probability of as much by chance in any of the looks.
    pub p_value: f64,
    /// How far the tip wanders along X, Y and Z at the readings (m, rms).
    pub size_m: [f64; 3],
    /// The same at every place.
    by_place: VarianceByPlace,
    taken: Taken,
    /// Whether it is the likeliest size of a course in time that was set aside, whatever chance says.
    is_set_aside: bool,
}

impl Wander {
    /// What it is and what to do, for readers.
    pub fn words(&self) -> String {
        let [x, y, z] = self.sizes_um();
        let moves = self.moves.as_ref().map_or_else(String::new, |moves| format!(", {moves}"));
        format!(
            "Scales, angles or bows of the machine, or its stations, change in the course of the campaign (p = {:.1e}; most like \
             {}{moves}), in a form that these data attribute to no effect: the tip wanders by {x}, {y} and {z} µm along X, Y and Z (rms over \
             the readings). That is not corrected, and stands in U. Return to the same few points throughout the campaign, and log \
             the temperatures of what carries them.",
            self.p_value, self.follows
        )
    }

    /// How far the tip wanders (µm, rms), for readers.
    fn sizes_um(&self) -> [String; 3] {
        self.size_m.map(|m| format!("{:.2}", m * 1e6))
    }

    /// The same where noise that hangs together explains it as well, or where it was asked for alone.
    pub fn words_of_doubt(&self) -> String {
        let [x, y, z] = self.sizes_um();
        if self.is_set_aside {
            return format!(
                "A course in time was set aside, since whatever is slow looks the same. Taken as a motion of the tip, it is {x}, {y} and {z} µm along \
                 X, Y and Z (rms over the readings). That stands in U."
            );
        }
        format!(
            "If all noise is of single readings, scales, angles or bows of the machine change in the course of the campaign (p = {:.1e}): the tip \
             wanders by {x}, {y} and {z} µm along X, Y and Z (rms over the readings). Noise that neighbouring readings share explains it as well. It \
             stands in U.",
            self.p_value
        )
    }

    /// The same of a course in time that was set aside; `None` where nothing of it shows.
    pub(crate) fn of_what_was_set_aside(self) -> Option<Wander> {
        self.size_m.iter().any(|size_m| *size_m > SMALLEST_M).then_some(Wander { is_set_aside: true, ..self })
    }

    /// The same for an identification, which looks for no cause.
    pub fn finding(&self) -> Finding {
        let subject = Subject::Wanders { p_value: self.p_value, size_m: self.size_m };
        Finding { grade: Grade::Warning, subject, causes: vec![Cause::Lacks] }
    }

    /// The model with it in the uncertainty of all that it corrects, whichever effects it has.
    pub(crate) fn told(&self, model: MachineModel) -> Result<MachineModel, ModelError> {
        told(model, self.by_place.clone(), &self.taken)
    }
}

/// What these rows show of a machine that wanders; `None` where chance explains it.
pub(crate) fn find(
    (model, round): (&MachineModel, &Round),
    campaign: &Campaign,
    context: &Context,
    options: &DiagnoseOptions,
    go_on: &mut dyn FnMut() -> bool,
) -> Result<Option<Wander>, DiagnoseError> {
    let seen = Seen::of(round, campaign, Span::of(campaign));
    let mut looks: Vec<Tested> = Vec::new();
    let cycle = cycles::strongest(round, &seen.places, campaign, &seen.used);
    let slow = courses(campaign, context, &seen.used).into_iter().map(|course| (course, Motions::each(&seen.places)));
    let returning = cycle.map(|course| (course, Motions::sets(&seen.places)));
    for (course, sets) in slow.chain(returning).collect::<Vec<(Course, Vec<Motions>)>>() {
        if !go_on() {
            return Err(DiagnoseError::Stopped);
        }
        looks.extend(seen.of_sets(sets, &course));
    }
    Ok(seen.wander(model, campaign, &looks, options.significance))
}

/// The same of a fit that seems to explain its readings, and of what goes slowly with time alone, with all noise taken to be of single readings.
/// `None` also where the residual says already that the model lacks something: what that does slowly is as uncertain as all else of it. Up
/// to `significance` it is no chance; 1 asks for its likeliest size, where it is known to be there.
pub(crate) fn in_time(
    fit: &Identified,
    instrument: RangeUncertainty,
    campaign: &Campaign,
    significance: f64,
) -> Result<Option<Wander>, DiagnoseError> {
    if fit.evidence.chi2_per_dof > TOLD_BY_RESIDUAL {
        return Ok(None);
    }
    let span = Span::of(campaign);
    let part = spread(campaign.readings.len(), MANY);
    let (fit, campaign) = (&fit.of_readings(&part), &campaign.part(&part));
    let round = Round::new(fit, instrument, campaign)?;
    let seen = Seen::of(&round, campaign, span);
    let looks = seen.of_sets(Motions::each(&seen.places), &in_course_of_time(campaign, &seen.used));
    Ok(seen.wander(&fit.model, campaign, &looks, significance))
}

/// Rows of a fit, those used, and where the machine stood.
struct Seen<'s> {
    round: &'s Round<'s>,
    used: Vec<usize>,
    places: Places,
}

impl<'s> Seen<'s> {
    fn of(round: &'s Round<'s>, campaign: &Campaign, span: Span) -> Seen<'s> {
        let used: Vec<usize> = (0..round.rows.len()).filter(|k| round.rows.whitening[*k] > 0.0).collect();
        Seen { round, used, places: Places::of(campaign, span) }
    }

    /// Each set of motions in this course, and each family. They share motions, and the columns of all go through the products with the
    /// fit once.
    fn of_sets(&self, mut sets: Vec<Motions>, course: &Course) -> Vec<Tested<'_>> {
        sets.extend(Motions::families(&self.places));
        let (all, places) = Motions::all_of(&sets);
        let projected = self.round.free.project(self.look(all, course).columns().as_ref());
        let parts = course.parts.len();
        let of_set = |(motions, places): (Motions, Vec<usize>)| {
            let columns: Vec<usize> = places.iter().flat_map(|place| place * parts..(place + 1) * parts).collect();
            self.look(motions, course).tested(&projected.pick(&columns))
        };
        sets.into_iter().zip(places).filter_map(of_set).collect()
    }

    fn look(&self, motions: Motions, course: &Course) -> Look<'_> {
        Look { round: self.round, places: &self.places, motions, course: course.clone(), used: &self.used }
    }

    /// What these looks come to; `None` where chance explains it.
    fn wander(&self, model: &MachineModel, campaign: &Campaign, looks: &[Tested], significance: f64) -> Option<Wander> {
        let p_value =
            together(looks.iter().filter(|tested| tested.look.motions.is_family()).map(|tested| tested.p_value));
        let said = looks.iter().filter(|tested| !tested.look.is_slow_and_alone());
        let likeliest = said.max_by(|a, b| a.gain.total_cmp(&b.gain)).filter(|_| p_value <= significance)?;
        let rows = &self.round.rows;
        let (by_place, taken) = by_place_and_taken(&weighed(looks), &self.places, rows.parameters.len());
        Some(Wander {
            follows: likeliest.look.course.follows.clone(),
            moves: likeliest.look.motions.alone(),
            p_value,
            size_m: rms_m(&by_place, campaign, &self.used),
            by_place,
            taken: Taken::new(model, rows, taken),
            is_set_aside: false,
        })
    }
}

/// Weights of looks by their likelihood: courses that these data do not tell apart wander by different amounts, of which the mean is
/// taken. Those without weight are left out. The mean of slow courses of one motion comes beside that of all others: what is slow may be
/// another motion at another time, which families hold, and one motion alone is more than its share of a family.
fn weighed<'t>(looks: &'t [Tested<'t>]) -> Vec<(&'t Tested<'t>, f64)> {
    let (alone, mean): (Vec<&Tested>, Vec<&Tested>) = looks.iter().partition(|tested| tested.look.is_slow_and_alone());
    let weighed = |of: Vec<&'t Tested<'t>>| {
        let gains: Vec<f64> = of.iter().map(|tested| tested.gain).collect();
        by_likelihood(of, &gains)
    };
    [weighed(mean), weighed(alone)].concat()
}

/// Looks with their weight by the logarithm of their likelihood, together 1, without those that are unlikely beside the likeliest.
fn by_likelihood<T>(looks: impl IntoIterator<Item = T>, ln_likelihood: &[f64]) -> Vec<(T, f64)> {
    let most = ln_likelihood.iter().copied().fold(0.0, f64::max);
    let weights = looks.into_iter().zip(ln_likelihood.iter().map(|own| (own - most).exp()));
    let kept: Vec<(T, f64)> = weights.filter(|(_, weight)| *weight > LEAST_WEIGHT).collect();
    let total: f64 = kept.iter().map(|(_, weight)| weight).sum();
    kept.into_iter().map(|(look, weight)| (look, weight / total)).collect()
}

/// A model with a motion in its uncertainty, beside what it holds of others: what it may be at a place, and what parameters took of it.
fn told(model: MachineModel, by_place: VarianceByPlace, taken: &Taken) -> Result<MachineModel, ModelError> {
    let mut parts = model.parts().clone();
    parts.quality.wanders = match &parts.quality.wanders {
        Some(other) => Some(other.with(&by_place).ok_or(ModelError::ByPlace { what: "two are of other places" })?),
        None => Some(by_place),
    };
    taken.add(&model, &mut parts.covariance);
    MachineModel::new(parts)
}

/// Mean square over the campaign of what is known of the motion, and of what is not, at every place; and the covariance of what the
/// parameters of the fit took of it for their own.
fn by_place_and_taken(looks: &[(&Tested, f64)], places: &Places, parameters: usize) -> (VarianceByPlace, Mat<f64>) {
    let mut packed_m2 = [(); 3].map(|()| vec![0.0; FORMS * (FORMS + 1) / 2]);
    let mut taken = Mat::zeros(parameters, parameters);
    for (tested, weight) in looks.iter().copied() {
        let root = tested.moment_root();
        tested.visit_forms(&root, &mut |d, place, m2| packed_m2[d][place] += weight * m2);
        let reach = tested.look.round.linear.reach(tested.look.columns().as_ref()) * &root;
        taken += faer::Scale(weight) * (&reach * reach.transpose());
    }
    (VarianceByPlace { middle_m: places.middle_m, half_span_m: places.half_span_m, packed_m2 }, taken)
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

/// Motions times courses, against the rows.
struct Look<'l> {
    round: &'l Round<'l>,
    places: &'l Places,
    motions: Motions,
    course: Course,
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
    /// Variance of the courses, and what the logarithm of the likelihood gains by it, less the price of the choice.
    variance: f64,
    gain: f64,
}

impl<'l> Look<'l> {
    fn pairs(&self) -> impl Iterator<Item = ((usize, usize, f64), &Vec<f64>)> {
        self.motions.0.iter().flat_map(|motion| self.course.parts.iter().map(move |course| (*motion, course)))
    }

    fn is_slow_and_alone(&self) -> bool {
        !self.course.returns && self.motions.0.len() == 1
    }

    /// By what the fit leaves of its columns; `None` where the rows are too few, or show nothing of it.
    fn tested(self, projected: &Projected) -> Option<Tested<'l>> {
        let count = projected.gradient.len();
        let both = Mat::from_fn(count, count, |i, j| 0.5 * (projected.left[(i, j)] + projected.left[(j, i)]));
        let (values, vectors) = symmetric_eigen(&both)?;
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
        let p_value = (p_of_form(&seen_values, form, degrees) * self.course.tried).min(1.0);
        let (variance, gain) = variance(&values, &along, noise);
        let gain = gain - self.course.tried.ln();
        Some(Tested { p_value, values, vectors, along, noise, variance, gain, look: self })
    }

    /// What each motion times each course does to the rows.
    fn columns(&self) -> Mat<f64> {
        let rows = &self.round.rows;
        let columns: Vec<Vec<f64>> = self
            .pairs()
            .map(|((d, form, size_m), course)| {
                let at = |k: usize| match rows.whitening[k] > 0.0 {
                    true => rows.rays[k].direction[d] * size_m * self.places.forms[k][form] * course[k],
                    false => 0.0,
                };
                let mut column: Vec<f64> = (0..rows.len()).map(at).collect();
                rows.whiten(&mut column);
                column
            })
            .collect();
        Mat::from_fn(rows.len(), columns.len(), |k, j| columns[j][k])
    }
}

/// Variance of the courses (unit of the columns, squared) by REML, and what the logarithm of the likelihood gains by it; 0 and 0 where the
/// noise explains the rows best.
fn variance(values: &[f64], along: &[f64], noise: f64) -> (f64, f64) {
    let largest = values.last().copied().unwrap_or(0.0);
    let seen = || values.iter().zip(along).filter(|(value, _)| **value > SEEN * largest);
    let likelihood = |variance: f64| -> f64 {
        let of = |(value, along): (&f64, &f64)| {
            let total = noise + variance * value;
            -0.5 * (total.ln() + along * along / value / total)
        };
        seen().map(of).sum()
    };
    let of = |ln_ratio: f64| noise / largest * ln_ratio.exp();
    let best = of(peak(LN_RATIO, |ln_ratio| likelihood(of(ln_ratio))));
    let gain = likelihood(best) - likelihood(0.0);
    if gain > 0.0 { (best, gain) } else { (0.0, 0.0) }
}

impl Tested<'_> {
    /// R with R Rᵀ the second moment of the coefficients: mean · meanᵀ + covariance.
    fn moment_root(&self) -> Mat<f64> {
        let count = self.along.len();
        let shrunk = |k: usize| self.variance / (self.noise + self.variance * self.values[k].max(0.0));
        Mat::from_fn(count, count + 1, |i, k| match k < count {
            true => self.vectors[(i, k)] * (shrunk(k) * self.noise).sqrt(),
            false => (0..count).map(|j| self.vectors[(i, j)] * shrunk(j) * self.along[j]).sum(),
        })
    }

    /// Calls with axis, place in the packed covariance of forms, and what is to be added there (m²); `root` is [`Tested::moment_root`].
    fn visit_forms(&self, root: &Mat<f64>, add: &mut dyn FnMut(usize, usize, f64)) {
        let moment = root * root.transpose();
        let (motions, courses) = (&self.look.motions.0, self.look.course.parts.len());
        let together = self.courses_together();
        for (m, (d, row, of_row_m)) in motions.iter().enumerate() {
            for (n, (other, column, of_column_m)) in motions.iter().enumerate() {
                if d != other || column > row {
                    continue;
                }
                let of_pair = |(a, b): (usize, usize)| together[(a, b)] * moment[(m * courses + a, n * courses + b)];
                let pairs = (0..courses).flat_map(|a| (0..courses).map(move |b| (a, b)));
                let mean: f64 = pairs.map(of_pair).sum();
                add(*d, packed(*row, *column), of_row_m * of_column_m * mean);
            }
        }
    }

    /// Mean product of each two courses over the readings used.
    fn courses_together(&self) -> Mat<f64> {
        let Look { course: Course { parts: courses, .. }, used, .. } = &self.look;
        let product = |a: usize, b: usize| used.iter().map(|k| courses[a][*k] * courses[b][*k]).sum::<f64>();
        Mat::from_fn(courses.len(), courses.len(), |a, b| product(a, b) / used.len().max(1) as f64)
    }
}

/// Rms over the readings used (m).
fn rms_m(by_place: &VarianceByPlace, campaign: &Campaign, used: &[usize]) -> [f64; 3] {
    let at = used.iter().map(|k| by_place.at_m2(campaign.readings[*k].reading_m));
    let sum = at.fold([0.0; 3], |sum: [f64; 3], m2| std::array::from_fn(|d| sum[d] + m2[d]));
    sum.map(|sum_m2| (sum_m2 / used.len().max(1) as f64).sqrt())
}
