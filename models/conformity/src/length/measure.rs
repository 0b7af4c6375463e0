//! The length test on a machine of which only its error of indication is known: simulated, or corrected by a model.
//!
//! Place in the flow: an error function "measured − true at a point" (m, machine frame) in, length measurements for
//! [`super::evaluate()`] out. Calibrated ends p₁, p₂ are indicated at p + e(p), so that
//! E = |p₂ + e(p₂) − p₁ − e(p₁)| − |p₂ − p₁|, evaluated so that it does not cancel.

use super::{LEAST_SHARE, LENGTHS, LengthMeasurement, MeasuringLine, REPEATS};
use crate::error::ConformityError;
use crate::quantity::ObservedError;
use nalgebra::Vector3;

/// Which lengths are put on each line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LengthPlan {
    /// Longest length as a share of the travel along its line: 0.66 to 1. All begin at the same place, as on a step
    /// gauge, and the longest lies in the middle of the line.
    pub longest_share: f64,
    /// Lengths a line, equally graded up to the longest; 5 in the standard.
    pub lengths: usize,
    /// Measurements of each length; 3 in the standard.
    pub repeats: u32,
}

impl Default for LengthPlan {
    /// Five lengths up to 90 % of the travel, three times each.
    fn default() -> LengthPlan {
        LengthPlan { longest_share: 0.9, lengths: LENGTHS, repeats: REPEATS as u32 }
    }
}

/// End of a length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// Common to all lengths of a line.
    First,
    /// The far end.
    Second,
}

/// One probing of one end of one length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch<'a> {
    /// The line, with its tool offset.
    pub line: &'a MeasuringLine,
    /// Where the tip really is (m, machine frame).
    pub true_point_m: Vector3<f64>,
    /// Unit vector of the tip's approach.
    pub approach: Vector3<f64>,
    /// Calibrated length (m).
    pub calibrated_m: f64,
    /// Number of the repeat, from 1.
    pub repeat: u32,
    /// Which end.
    pub end: End,
}

/// Measures the lengths of a plan on these lines with a machine whose error of indication (measured − true, m) at a
/// touch is `measured_minus_true_m`. Touches come in the order line, length, repeat, first end, second end; the same
/// function gives the same measurements. Probing is bidirectional: both ends are approached from outside.
///
/// # Errors
/// A plan below what the standard asks for, or an error that is not finite.
pub fn measure(
    lines: &[MeasuringLine],
    plan: &LengthPlan,
    mut measured_minus_true_m: impl FnMut(&Touch) -> Vector3<f64>,
) -> Result<Vec<LengthMeasurement>, ConformityError> {
    check(plan)?;
    let mut measurements = Vec::with_capacity(lines.len() * plan.lengths * plan.repeats as usize);
    for line in lines {
        let longest_m = plan.longest_share * line.travel_m();
        let direction = line.direction();
        let first_m = (line.from_m + line.to_m) / 2.0 - direction * (longest_m / 2.0);
        for step in 1..=plan.lengths {
            let calibrated_m = longest_m * step as f64 / plan.lengths as f64;
            for repeat in 1..=plan.repeats {
                let mut touch = |end, true_point_m, approach| {
                    measured_minus_true_m(&Touch { line, true_point_m, approach, calibrated_m, repeat, end })
                };
                let at_first_m = touch(End::First, first_m, direction);
                let at_second_m = touch(End::Second, first_m + direction * calibrated_m, -direction);
                let error = length_error(calibrated_m, &direction, &(at_second_m - at_first_m));
                if !error.metres().is_finite() {
                    let problem = format!("the machine's error at {:.3} mm is not finite", calibrated_m * 1e3);
                    return Err(ConformityError::new(
                        format!("line {}", line.name),
                        problem,
                        "correct the error function",
                    ));
                }
                measurements.push(LengthMeasurement { line: line.name.clone(), calibrated_m, repeat, error });
            }
        }
    }
    Ok(measurements)
}

/// |L·u + d| − L = (2 L u·d + d·d) / (|L·u + d| + L), without the difference of two large numbers.
fn length_error(length_m: f64, direction: &Vector3<f64>, change_m: &Vector3<f64>) -> ObservedError {
    let along_m = direction.dot(change_m);
    let measured_m = (direction * length_m + change_m).norm();
    ObservedError::from_metres((2.0 * length_m * along_m + change_m.norm_squared()) / (measured_m + length_m))
}

fn check(plan: &LengthPlan) -> Result<(), ConformityError> {
    let wrong = |place: &str, problem: String, remedy: &str| Err(ConformityError::new(place, problem, remedy));
    if !(LEAST_SHARE..=1.0).contains(&plan.longest_share) {
        let problem = format!("the longest length would be {:.1} % of the travel", plan.longest_share * 100.0);
        return wrong("longest_share", problem, "ask for 66 % to 100 %");
    }
    if plan.lengths < LENGTHS {
        return wrong("lengths", format!("{} lengths a line are too few", plan.lengths), "ask for 5 at least");
    }
    if (plan.repeats as usize) < REPEATS {
        return wrong(
            "repeats",
            format!("{} measurements of a length are too few", plan.repeats),
            "ask for 3 at least",
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::{MeasuringVolume, e0_lines};
    use super::*;

    fn lines() -> Vec<MeasuringLine> {
        e0_lines(&MeasuringVolume::new([(0.0, 0.8), (0.0, 0.6), (0.0, 0.6)]).unwrap())
    }

    #[test]
    fn a_perfect_machine_measures_without_error_and_all_105_times() {
        let measured = measure(&lines(), &LengthPlan::default(), |_| Vector3::zeros()).unwrap();
        assert_eq!(measured.len(), 105);
        assert!(measured.iter().all(|m| m.error.metres() == 0.0));
    }

    /// A scale that is 10 µm/m too long indicates every length by 1e-5 of it too long, in any direction.
    #[test]
    fn a_scale_that_is_too_long_measures_long_in_proportion() {
        let measured = measure(&lines(), &LengthPlan::default(), |touch| touch.true_point_m * 1e-5).unwrap();
        for m in measured {
            assert!((m.error.metres() - 1e-5 * m.calibrated_m).abs() < 1e-20, "{m:?}");
        }
    }

    /// Squareness c between X and Y moves x by −c·y: on a diagonal of direction (u, v, w) the length changes by
    /// −c·u·v·L to first order, with opposite signs on PPP and NPP, and not at all along X and Z.
    #[test]
    fn squareness_shows_on_the_diagonals_with_both_signs() {
        const C: f64 = 20e-6;
        let shear = |touch: &Touch| Vector3::new(-C * touch.true_point_m.y, 0.0, 0.0);
        let measured = measure(&lines(), &LengthPlan::default(), shear).unwrap();
        for m in &measured {
            let line = lines().into_iter().find(|l| l.name == m.line).unwrap();
            let u = line.direction();
            // Second order: c²·L/2, 0.2 nm.
            assert!((m.error.metres() + C * u.x * u.y * m.calibrated_m).abs() < 1e-9, "{m:?}");
        }
        let error = |name: &str| measured.iter().filter(|m| m.line == name).map(|m| m.error.metres()).sum::<f64>();
        assert!(error("PPP") < 0.0 && error("NPP") > 0.0 && error("Z") == 0.0);
    }

    #[test]
    fn a_probe_that_is_too_large_shows_alike_at_every_length() {
        // The tip touches 1 µm early at both ends, so that outer lengths are indicated 2 µm too long.
        let early = |touch: &Touch| touch.approach * -1e-6;
        for m in measure(&lines(), &LengthPlan::default(), early).unwrap() {
            assert!((m.error.metres() - 2e-6).abs() < 1e-15, "{m:?}");
        }
    }

    #[test]
    fn all_touches_stay_on_their_line_and_in_the_volume() {
        let plan = LengthPlan { longest_share: 1.0, ..LengthPlan::default() };
        let mut touches = 0;
        measure(&lines(), &plan, |touch| {
            touches += 1;
            let from = touch.true_point_m - touch.line.from_m;
            assert!(from.cross(&touch.line.direction()).norm() < 1e-15);
            assert!(touch.true_point_m.iter().zip([0.8, 0.6, 0.6]).all(|(v, end)| (-1e-12..=end + 1e-12).contains(v)));
            Vector3::zeros()
        })
        .unwrap();
        assert_eq!(touches, 210);
    }

    #[test]
    fn plans_below_the_standard_and_errors_that_are_no_numbers_are_refused() {
        let plan = LengthPlan::default();
        for bad in [
            LengthPlan { longest_share: 0.65, ..plan },
            LengthPlan { longest_share: f64::NAN, ..plan },
            LengthPlan { lengths: 4, ..plan },
            LengthPlan { repeats: 2, ..plan },
        ] {
            assert!(measure(&lines(), &bad, |_| Vector3::zeros()).is_err(), "{bad:?}");
        }
        let told = measure(&lines(), &plan, |_| Vector3::repeat(f64::NAN)).unwrap_err().to_string();
        assert!(told.contains("line PPP") && told.contains("not finite"), "{told}");
    }
}
