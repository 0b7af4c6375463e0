//! What an instrument or a plate does by itself while vectors are taken: its frame moves, its scale changes.
//!
//! Place in the flow: candidates of the study of vectors that are no property of a machine, and the columns that any effect of the time
//! is held against. A tracker on a stand that settles, a beam in air that warms, a plate that warms: to first order a shift, a turn and
//! a scale that go with the time. A shift alone is a smooth course of each component, which is a candidate already. SI.

use super::shape::{Quantity, Shape};
use crate::explanation::Explanation;
use crate::study::candidate::{Candidate, Goes};
use abbe_geometry::effects::ParameterSpec;
use abbe_geometry::{Axis, Vector3};
use faer::Mat;

/// Largest turn (rad) and scale believed.
const PLAUSIBLE: f64 = 1e-3;
/// Degrees of the courses that are tried.
const DEGREES: [usize; 3] = [1, 2, 4];
/// Time constants tried: the duration over the longest, their ratio, and how many.
const SETTLING: (f64, f64, i32) = (1.0, 2.1, 5);

/// How a whole frame moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Motion {
    Shift(Axis),
    Turn(Axis),
    Scale,
}

impl Motion {
    pub(super) fn all() -> impl Iterator<Item = Motion> {
        let of_axes = Axis::ALL.into_iter().map(Motion::Shift).chain(Axis::ALL.into_iter().map(Motion::Turn));
        of_axes.chain([Motion::Scale])
    }

    /// Of a point with this arm about the middle (m), per unit.
    pub(super) fn of(self, arm_m: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Motion::Shift(axis) => axis.direction(),
            Motion::Turn(axis) => axis.direction().cross(arm_m),
            Motion::Scale => *arm_m,
        }
    }
}

/// How it goes with the time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Course {
    /// Legendre polynomials 1 … degree over the time of all vectors.
    Smooth(usize),
    /// 1 − e^(−t/τ), τ in s, t since the first vector, less its mean over all vectors.
    Settling(f64),
}

impl Course {
    /// Those that are tried, over a range of times (s).
    fn all((first_s, last_s): (f64, f64)) -> Vec<Course> {
        let (over, ratio, count) = SETTLING;
        let tau_s = |k: i32| (last_s - first_s) / (over * ratio.powi(k));
        DEGREES.into_iter().map(Course::Smooth).chain((0..count).map(|k| Course::Settling(tau_s(k)))).collect()
    }

    /// Its functions at all vectors; none of them has a mean, so that what stands still keeps its meaning.
    pub(super) fn functions(self, time_s: &Quantity) -> Vec<Vec<f64>> {
        let functions: Vec<Vec<f64>> = match self {
            Course::Smooth(degree) => (1..=degree).map(|k| time_s.powers[k].clone()).collect(),
            Course::Settling(tau_s) => {
                vec![time_s.values.iter().map(|t| -(-(t - time_s.range.0) / tau_s).exp_m1()).collect()]
            }
        };
        let centred = |values: Vec<f64>| {
            let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
            values.into_iter().map(|value| value - mean).collect()
        };
        functions.into_iter().map(centred).collect()
    }

    fn words(self) -> String {
        match self {
            Course::Smooth(degree) => format!("degree {degree}"),
            Course::Settling(tau_s) => format!("coming to rest, time constant {tau_s:.0} s"),
        }
    }
}

/// A candidate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Drift {
    pub(super) motion: Motion,
    pub(super) course: Course,
}

impl Drift {
    /// Turns and scale with every course.
    pub(super) fn all(time_s: &Quantity) -> Vec<Drift> {
        let motions = Motion::all().filter(|motion| !matches!(motion, Motion::Shift(_)));
        // A polynomial needs more times than it has coefficients.
        let courses = Course::all(time_s.range).into_iter();
        let courses: Vec<Course> =
            courses.filter(|course| !matches!(course, Course::Smooth(degree) if *degree >= time_s.levels)).collect();
        motions.flat_map(|motion| courses.iter().map(move |course| Drift { motion, course: *course })).collect()
    }

    pub(super) fn candidate(&self, is_plate: bool, time: &str) -> Candidate {
        let (what, letter, unit) = match self.motion {
            Motion::Shift(axis) => (format!("shift of the frame along {}", axis.letter()), "d", "m"),
            Motion::Turn(axis) => (format!("turn of the frame about {}", axis.letter()), "r", "rad"),
            Motion::Scale if is_plate => ("growth of the plate, or of the instrument's scale,".to_owned(), "s", "m/m"),
            Motion::Scale => ("growth of the instrument's scale".to_owned(), "s", "m/m"),
        };
        let parameters = match self.course {
            Course::Smooth(degree) => (1..=degree).map(|k| format!("{letter}_{k}")).collect(),
            Course::Settling(_) => vec![letter.to_owned()],
        };
        let formula = match (self.motion, self.course) {
            (Motion::Scale, _) => "e = s(t) (p - middle)",
            (Motion::Turn(_), _) => "e = r(t) x (p - middle)",
            (Motion::Shift(_), _) => "e = d(t)",
        };
        Candidate {
            name: format!("{what} with time, {}", self.course.words()),
            formula: formula.to_owned(),
            // No cause by name: beside something logged that explains as much it would go first.
            kind: Explanation::Empirical,
            family: format!("{what} with time"),
            covariates: vec![time.to_owned()],
            parameters: parameters.into_iter().map(|name| ParameterSpec::new(name, unit, PLAUSIBLE)).collect(),
            decided_by: STANDS_STILL.to_owned(),
            essential: Vec::new(),
            stands_apart: false,
            goes: Goes::ByEvidence,
        }
    }
}

/// Columns of motions of the whole with these functions of the time, three rows a vector, over the standard uncertainty of the rows;
/// `arms_m` are the vectors' positions about the middle.
pub(super) fn columns(
    motions: &[Motion],
    functions: &[Vec<f64>],
    arms_m: impl Iterator<Item = Vector3<f64>>,
    sigma_m: &[[f64; 3]],
) -> Mat<f64> {
    let mut columns = Mat::zeros(3 * sigma_m.len(), motions.len() * functions.len());
    for (k, (arm_m, sigma_m)) in arms_m.zip(sigma_m).enumerate() {
        for (i, motion) in motions.iter().enumerate() {
            let moved = motion.of(&arm_m);
            for (j, function) in functions.iter().enumerate() {
                let column = i * functions.len() + j;
                (0..3).for_each(|d| columns[(3 * k + d, column)] = moved[d] * function[k] / sigma_m[d]);
            }
        }
    }
    columns
}

/// What tells the machine from its instrument.
pub(super) const STANDS_STILL: &str =
    "measure a mark that stands still again and again: before, between and after, what it moves by is the instrument's";
/// Why a drift of the frame is not in a model.
pub(super) const OF_THE_INSTRUMENT: &str =
    "it is what the frame or scale of an instrument, or a plate that warms, does by itself";

/// Courses of a smooth shape in the time, by its index among the quantities; none where the shape does not read it.
pub(super) fn of_shape(shape: Shape, time: usize) -> Vec<Course> {
    match shape {
        Shape::One { quantity, degree } if quantity == time => vec![Course::Smooth(degree)],
        Shape::Two { first, second, degree } if first == time || second == time => vec![Course::Smooth(degree)],
        Shape::Product { first, second } if first == time || second == time => vec![Course::Smooth(1)],
        _ => Vec::new(),
    }
}

/// Courses of an effect of the registry, by the figures of its shape.
pub(super) fn of_registered(shape: &abbe_geometry::effects::Shape) -> Vec<Course> {
    use abbe_geometry::effects::ShapeValue::Number;
    match (shape.0.get("tau_s"), shape.0.get("stages")) {
        // The second stage follows with four times the time constant.
        (Some(Number(tau_s)), Some(Number(stages))) if *stages > 1.0 => {
            vec![Course::Settling(*tau_s), Course::Settling(4.0 * tau_s)]
        }
        (Some(Number(tau_s)), _) => vec![Course::Settling(*tau_s)],
        _ => vec![Course::Smooth(2)],
    }
}
