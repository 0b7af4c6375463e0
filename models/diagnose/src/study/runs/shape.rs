//! Shapes of what an axis can do in positioning runs, as columns of one axis.
//!
//! Place in the flow: the study of runs makes one candidate of each shape and axis. A column is the error (m) of one
//! approach per unit of its parameter.

use super::Run;
use super::positions::key;
use super::step::Jump;
use crate::study::smooth::legendre;
use std::f64::consts::TAU;

/// ISO 1 reference temperature (°C).
const REFERENCE_C: f64 = 20.0;

/// What an axis can do.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Shape {
    /// Error follows the target: Legendre polynomials 1 … degree.
    Position(usize),
    /// Error target by target.
    PositionTable,
    /// Half the reversal value times the sign of approach: Legendre polynomials 0 … degree of the target.
    Lost(usize),
    /// Reversal value target by target.
    LostTable,
    /// Error follows the number of the cycle: Legendre polynomials 1 … degree.
    Cycle(usize),
    /// Error follows the time, or the order of measurement: Legendre polynomials 1 … degree.
    Time(usize),
    /// Offset and scale follow the time.
    TimeAndTarget,
    /// Each target drifts with the cycle at a rate of its own.
    DriftTable,
    /// The reversal value grows with the cycle.
    LostWithCycle,
    /// The reversal value follows a logged quantity.
    LostBy(String),
    /// The offset jumps once.
    Step(Jump),
    /// a·(1 − e^(−t/τ)), τ in s, t since the first run.
    Creep(f64),
    /// The same of offset and scale, less its mean over the time of all runs, which is an error of position: a screw that warms up
    /// grows as far as it is long.
    Growth(f64),
    /// α·(T − 20 °C)·target + shift·(T − 20 °C).
    Expansion(String),
    /// Sine and cosine of 2π·target/period (m).
    Periodic(f64),
    /// Error follows a logged quantity: Legendre polynomials 1 … degree.
    Smooth(String, usize),
    /// Offset and scale follow a logged quantity.
    ScaleBy(String),
}

/// Ranges of one axis, to scale by.
#[derive(Debug, Clone)]
pub(super) struct Ranges {
    pub(super) target_m: (f64, f64),
    pub(super) time_s: Option<(f64, f64)>,
    /// Whether no times were written and the order of measurement stands for them.
    pub(super) is_order: bool,
    pub(super) cycle: Option<(f64, f64)>,
    /// Range of the quantity that the shape names.
    pub(super) quantity: Option<(f64, f64)>,
    /// Keys of all targets, ascending.
    pub(super) targets: Vec<i64>,
}

impl Ranges {
    /// All targets (m), ascending.
    pub(super) fn places_m(&self) -> Vec<f64> {
        self.targets.iter().map(|key| *key as f64 * 1e-9).collect()
    }
}

impl Shape {
    /// Whether it is a drift or a step in time.
    pub(super) fn is_of_time(&self) -> bool {
        use Shape::{Creep, Cycle, DriftTable, Growth, Step, Time, TimeAndTarget};
        matches!(self, Cycle(_) | Time(_) | TimeAndTarget | DriftTable | Creep(_) | Growth(_) | Step(_))
    }

    /// Whether it is a reversal value.
    pub(super) fn is_reversal(&self) -> bool {
        matches!(self, Shape::Lost(_) | Shape::LostTable | Shape::LostWithCycle | Shape::LostBy(_))
    }

    /// Names and units of the parameters.
    pub(super) fn parameters(&self, ranges: &Ranges) -> Vec<(String, &'static str)> {
        let numbered = |letter: &str, from: usize, to: usize| -> Vec<(String, &'static str)> {
            (from..=to).map(|k| (format!("{letter}_{k}"), "m")).collect()
        };
        let table = |letter: &str| -> Vec<(String, &'static str)> {
            ranges.targets.iter().map(|key| (format!("{letter} at {:.3} mm", *key as f64 / 1e6), "m")).collect()
        };
        match self {
            Shape::Position(degree) | Shape::Smooth(_, degree) => numbered("p", 1, *degree),
            Shape::Cycle(degree) | Shape::Time(degree) => numbered("d", 1, *degree),
            Shape::PositionTable => table("error"),
            Shape::Lost(degree) => numbered("B", 0, *degree),
            Shape::LostTable => table("B"),
            Shape::TimeAndTarget => vec![("d_1".to_owned(), "m"), ("d_1 x_1".to_owned(), "m")],
            Shape::DriftTable => table("d_1"),
            Shape::LostWithCycle | Shape::LostBy(_) => vec![("B_1".to_owned(), "m")],
            Shape::Step(jump) => jump.step.parameters().into_iter().map(|name| (name, "m")).collect(),
            Shape::Creep(_) => vec![("growth".to_owned(), "m")],
            Shape::Growth(_) => vec![("growth".to_owned(), "m"), ("growth x_1".to_owned(), "m")],
            Shape::ScaleBy(_) => vec![("p_1".to_owned(), "m"), ("p_1 x_1".to_owned(), "m")],
            Shape::Expansion(_) => vec![("alpha".to_owned(), "1/K"), ("shift".to_owned(), "m/K")],
            Shape::Periodic(_) => vec![("sine".to_owned(), "m"), ("cosine".to_owned(), "m")],
        }
    }

    /// Columns of one approach; `None` where the run lacks what the shape needs.
    pub(super) fn columns(&self, run: &Run, ranges: &Ranges) -> Option<Vec<f64>> {
        let target = |degree: usize| legendre(run.target_m, ranges.target_m, degree);
        let at_target = |value: f64| -> Vec<f64> {
            let own = key(run.target_m);
            ranges.targets.iter().map(|key| if *key == own { value } else { 0.0 }).collect()
        };
        let half = 0.5 * run.approach.sign();
        Some(match self {
            Shape::Position(degree) => target(*degree).split_off(1),
            Shape::PositionTable => at_target(1.0),
            Shape::Lost(degree) => target(*degree).into_iter().map(|value| half * value).collect(),
            Shape::LostTable => at_target(half),
            Shape::Cycle(degree) => legendre(run.cycle as f64, ranges.cycle?, *degree).split_off(1),
            Shape::Time(degree) => legendre(run.time_s?, ranges.time_s?, *degree).split_off(1),
            Shape::TimeAndTarget => {
                let time = legendre(run.time_s?, ranges.time_s?, 1)[1];
                vec![time, time * target(1)[1]]
            }
            Shape::DriftTable => at_target(legendre(run.cycle as f64, ranges.cycle?, 1)[1]),
            Shape::LostWithCycle => vec![half * legendre(run.cycle as f64, ranges.cycle?, 1)[1]],
            Shape::Step(jump) => jump.step.values(run.time_s?),
            Shape::LostBy(name) => vec![half * legendre(*run.covariates.get(name)?, ranges.quantity?, 1)[1]],
            Shape::Creep(tau_s) => vec![grown(run.time_s? - ranges.time_s?.0, *tau_s)],
            Shape::Growth(tau_s) => {
                let (first_s, last_s) = ranges.time_s?;
                let beyond = grown(run.time_s? - first_s, *tau_s) - mean_grown(last_s - first_s, *tau_s);
                vec![beyond, beyond * target(1)[1]]
            }
            Shape::Expansion(sensor) => {
                let above_k = run.covariates.get(sensor)? - REFERENCE_C;
                vec![above_k * run.target_m, above_k]
            }
            Shape::Periodic(period_m) => {
                let (sine, cosine) = (TAU * run.target_m / period_m).sin_cos();
                vec![sine, cosine]
            }
            Shape::Smooth(name, degree) => legendre(*run.covariates.get(name)?, ranges.quantity?, *degree).split_off(1),
            Shape::ScaleBy(name) => {
                let value = legendre(*run.covariates.get(name)?, ranges.quantity?, 1)[1];
                vec![value, value * target(1)[1]]
            }
        })
    }

    /// Whether it follows a logged quantity.
    pub(super) fn reads(&self, quantity: &str) -> bool {
        match self {
            Shape::Expansion(name) | Shape::Smooth(name, _) | Shape::LostBy(name) | Shape::ScaleBy(name) => {
                name == quantity
            }
            _ => false,
        }
    }

    /// The quantity whose range it is scaled by.
    pub(super) fn scaled_by(&self) -> Option<&str> {
        match self {
            Shape::Smooth(name, _) | Shape::LostBy(name) | Shape::ScaleBy(name) => Some(name),
            _ => None,
        }
    }

    /// What a search may adjust in its form (1/m, 1/s): a wave's period, a time constant, as a rate.
    pub(super) fn rate(&self) -> Option<f64> {
        match self {
            Shape::Periodic(span) | Shape::Creep(span) | Shape::Growth(span) => Some(span.recip()),
            _ => None,
        }
    }

    /// The same shape at another rate; itself where it has none.
    pub(super) fn at_rate(&self, rate: f64) -> Shape {
        match self {
            Shape::Periodic(_) => Shape::Periodic(rate.recip()),
            Shape::Creep(_) => Shape::Creep(rate.recip()),
            Shape::Growth(_) => Shape::Growth(rate.recip()),
            other => other.clone(),
        }
    }
}

/// Whether a logged quantity is a temperature.
pub(super) fn is_temperature(name: &str) -> bool {
    name.starts_with("temp_") && name.ends_with("_c")
}

/// Share of a growth that comes to rest, after this time.
pub(super) fn grown(since_s: f64, tau_s: f64) -> f64 {
    // −expm1 keeps the digits of the first seconds.
    -(-since_s / tau_s).exp_m1()
}

/// Its mean from the beginning to that time.
pub(super) fn mean_grown(until_s: f64, tau_s: f64) -> f64 {
    1.0 - tau_s / until_s * grown(until_s, tau_s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::runs::Approach;

    fn run(approach: Approach) -> Run {
        let covariates = [("temp_scale_x_c".to_owned(), 22.0)].into();
        Run { axis: "X".into(), target_m: 0.25, approach, cycle: 2, measured_m: 0.25, time_s: Some(100.0), covariates }
    }

    fn ranges() -> Ranges {
        Ranges {
            target_m: (0.0, 1.0),
            time_s: Some((0.0, 400.0)),
            is_order: false,
            cycle: Some((1.0, 5.0)),
            quantity: None,
            targets: vec![0, 250_000_000, 1_000_000_000],
        }
    }

    fn error_m(shape: &Shape, run: &Run, parameters: &[f64]) -> f64 {
        let columns = shape.columns(run, &ranges()).unwrap();
        assert_eq!(columns.len(), shape.parameters(&ranges()).len());
        columns.iter().zip(parameters).map(|(c, p)| c * p).sum()
    }

    #[test]
    fn each_shape_follows_its_formula() {
        let (up, down) = (run(Approach::Positive), run(Approach::Negative));
        let difference = |shape: &Shape, p: &[f64]| error_m(shape, &up, p) - error_m(shape, &down, p);
        assert_eq!(difference(&Shape::Lost(0), &[2e-6]), 2e-6);
        assert!((difference(&Shape::Lost(1), &[2e-6, 1e-6]) - 1.5e-6).abs() < 1e-18, "B falls to the lower end");
        assert_eq!(difference(&Shape::LostTable, &[9.0, 3e-6, 9.0]), 3e-6);
        assert_eq!(error_m(&Shape::PositionTable, &up, &[9.0, 4e-6, 9.0]), 4e-6);
        assert!((error_m(&Shape::Position(2), &up, &[1e-6, 2e-6]) - (-0.5e-6 - 0.25e-6)).abs() < 1e-18);
        let steel = Shape::Expansion("temp_scale_x_c".into());
        assert!((error_m(&steel, &up, &[11.5e-6, 0.0]) - 5.75e-6).abs() < 1e-18, "two kelvin on a quarter metre");
        assert!((error_m(&Shape::Creep(100.0), &up, &[1e-6]) - 0.632_120_558_8e-6).abs() < 1e-15);
        assert!((error_m(&Shape::Periodic(1.0), &up, &[1e-6, 1e-6]) - 1e-6).abs() < 1e-15);
        assert_eq!(error_m(&Shape::Time(1), &up, &[1e-6]), -0.5e-6);
        assert_eq!(error_m(&Shape::TimeAndTarget, &up, &[0.0, 1e-6]), 0.25e-6);
        assert_eq!(error_m(&Shape::Cycle(1), &up, &[1e-6]), -0.5e-6);
        assert_eq!(error_m(&Shape::DriftTable, &up, &[9.0, 1e-6, 9.0]), -0.5e-6);
        assert_eq!(difference(&Shape::LostWithCycle, &[1e-6]), -0.5e-6);
        assert_eq!(Shape::Smooth("load_kg".into(), 1).columns(&up, &ranges()), None, "not logged");
        // 1 − e^(−1) less its mean over four time constants, 1 − (1 − e^(−4))/4.
        let beyond = 0.245_421_6 - 0.367_879_4;
        assert!((error_m(&Shape::Growth(100.0), &up, &[2e-6, 1e-6]) - 1.5e-6 * beyond).abs() < 1e-12);
        let warm = Ranges { quantity: Some((20.0, 24.0)), ..ranges() };
        let at = |shape: &Shape| shape.columns(&Run { approach: Approach::Negative, ..up.clone() }, &warm).unwrap();
        assert_eq!(at(&Shape::LostBy("temp_scale_x_c".into())), [0.0], "in the middle of its range");
        assert_eq!(at(&Shape::ScaleBy("temp_scale_x_c".into())), [0.0, 0.0]);
        let warmer = Ranges { quantity: Some((20.0, 22.0)), ..ranges() };
        let columns = |shape: &Shape| shape.columns(&up, &warmer).unwrap();
        assert_eq!(columns(&Shape::LostBy("temp_scale_x_c".into())), [0.5]);
        assert_eq!(columns(&Shape::ScaleBy("temp_scale_x_c".into())), [1.0, -0.5]);
    }
}
