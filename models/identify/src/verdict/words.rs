//! Findings in words: what, how much, what may be behind it, and what to do.
//!
//! Place in the flow: the one place that says them, for terminal, reports, model files and logs alike.

use super::{Cause, Finding, Grade, Subject, Verdict};
use std::fmt;

/// Lines named in a message.
const NAMED: usize = 4;

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.subject)?;
        for (k, cause) in self.causes.iter().enumerate() {
            write!(f, "{}{cause}", if k == 0 { ". Likely: " } else { ". Or: " })?;
        }
        Ok(())
    }
}

impl fmt::Display for Subject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Subject::Rejected { what, rejected, all, share, explained } => {
                let seen = 100.0 * *rejected as f64 / (*all).max(1) as f64;
                let more = if rejected > explained { "more than" } else { "no more than" };
                write!(
                    f,
                    "{rejected} of {all} {what} ({seen:.1} %) contradict the others, {more} the {explained} of noise and {:.0} % of gross \
                     errors",
                    100.0 * share
                )
            }
            Subject::Noise { ratio, chi2_per_dof } if *ratio > 1.0 => {
                let chi2_per_dof = three_digits(*chi2_per_dof);
                write!(
                    f,
                    "the residual is {ratio:.1} times the declared noise (χ² per degree of freedom {chi2_per_dof})"
                )
            }
            Subject::Noise { ratio, chi2_per_dof } => {
                let times = ratio.max(f64::MIN_POSITIVE).recip();
                write!(
                    f,
                    "the residual is {} times smaller than the declared noise (χ² per degree of freedom {chi2_per_dof:.2e})",
                    rounded(times)
                )
            }
            Subject::Stroke { shares } => {
                let shares: Vec<String> =
                    shares.iter().map(|(letter, share)| format!("{:.1} % of {letter}", share * 100.0)).collect();
                write!(f, "the data cover {} only", shares.join(", "))
            }
            Subject::ByStation { names } => write!(
                f,
                "{} had one value at each station: what it does to the machine cannot be told from where the stations stand, and is not in U; where it \
                 matters, change it for some lines while a station stands",
                names.join(", ")
            ),
            Subject::Copies { copies, all } => write!(
                f,
                "{copies} of {all} readings repeat another one to the last digit, length included: what was logged twice was measured once, and \
                 U is widened for it; remove the copies"
            ),
            Subject::OneSided { axes } => {
                let axes: Vec<String> = axes.iter().map(char::to_string).collect();
                write!(
                    f,
                    "every point was approached from the same side along {}: backlash does not show and is not in U, and points from the other \
                     side are extrapolated; where it matters, drive some lines the other way",
                    axes.join(", ")
                )
            }
            Subject::NoTemperature => f.write_str(
                "no temperature was logged: how the machine grows on a warmer day does not show and is not in U; where it matters, log the \
                 temperatures of the scales",
            ),
            Subject::Wanders { p_value, size_m } => {
                let [x, y, z] = size_m.map(|m| format!("{:.2}", m * 1e6));
                write!(
                    f,
                    "scales, angles or bows of the machine, or its stations, change in the course of the campaign, or the noise of neighbouring \
                     readings hangs together (p = {p_value:.1e}): the tip wanders by {x}, {y} and {z} µm along X, Y and Z (rms over the readings), which \
                     is not corrected and stands in U"
                )
            }
            Subject::Sampled { steps } => {
                let steps: Vec<String> =
                    steps.iter().map(|(letter, m)| format!("{:.2} mm along {letter}", m * 1e3)).collect();
                write!(
                    f,
                    "readings lie at whole multiples of {}: an error that repeats within that step, such as a wave of a screw, does not show in the residual and is not in U",
                    steps.join(", ")
                )
            }
        }
    }
}

/// A figure without an uncertainty: three digits that count, as the reports show it.
pub fn three_digits(value: f64) -> String {
    let decimals = match value.abs() {
        size if size >= 100.0 => 0,
        size if size >= 10.0 => 1,
        size if size >= 1.0 => 2,
        _ => 3,
    };
    format!("{value:.decimals$}")
}

/// A factor without figures that mean nothing.
fn rounded(times: f64) -> String {
    if times < 10.0 {
        format!("{times:.1}")
    } else if times < 1e6 {
        format!("{times:.0}")
    } else {
        "millions of".to_owned()
    }
}

/// A length in the unit that fits it.
fn length(m: f64) -> String {
    if m.abs() < 1e-3 { format!("{:.1} µm", m * 1e6) } else { format!("{:.3} mm", m * 1e3) }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Cause::Step { station, lines, readings, times_s, moved_m, dead_path_m, explains } => {
                match moved_m {
                    Some(moved_m) => write!(f, "station {station} moved by about {}", length(moved_m.norm()))?,
                    None => write!(
                        f,
                        "the beam of station {station} was interrupted (its lengths shift by about {})",
                        length(-dead_path_m)
                    )?,
                }
                write!(
                    f,
                    " between readings {} and {} (line {} at {:.2} s, line {} at {:.2} s), which explains {explains} of them: give its \
                     readings from reading {} on a station name of their own",
                    readings.0, readings.1, lines.0, times_s.0, lines.1, times_s.1, readings.1
                )
            }
            Cause::OneSide { station, lines, readings, times_s, suspects: (own, all), is_after } => write!(
                f,
                "station {station} moved, or its zero changed, at about {:.0} s, between lines {} and {} (readings {} and {}): of the {all} \
                 lines with most contradictions {own} are its own, and all lie {} that; give its readings from reading {} on a station \
                 name of their own",
                0.5 * (times_s.0 + times_s.1),
                lines.0,
                lines.1,
                readings.0,
                readings.1,
                if *is_after { "after" } else { "before" },
                readings.1
            ),
            Cause::Lines { lines } => {
                let named: Vec<String> = lines
                    .iter()
                    .take(NAMED)
                    .map(|(line, station, rejected, all)| format!("{line} of station {station} ({rejected} of {all})"))
                    .collect();
                let more = lines.len().saturating_sub(NAMED);
                let more = if more > 0 { format!(" and {more} more") } else { String::new() };
                write!(
                    f,
                    "single lines: {}{more}; look for a collision, an interrupted beam or a wrong offset there, and remove or correct them",
                    named.join(", ")
                )
            }
            Cause::Offset { offset_m, rejected, all } => {
                let [x, y, z] = offset_m.map(|m| m * 1e3);
                write!(
                    f,
                    "the offset ({x} {y} {z}) mm is wrong, or its reflector was loose ({rejected} of its {all} readings); measure the offset again"
                )
            }
            Cause::Station { station, rejected, all } => write!(
                f,
                "station {station} ({rejected} of its {all} readings): it was not stable, or its lengths are disturbed; measure it again or remove it"
            ),
            Cause::Rounded { columns, step_m } => write!(
                f,
                "{} {} rounded to {} mm, or {} commanded positions instead of scale readings: export them with all digits",
                columns.join(", "),
                if columns.len() == 1 { "is" } else { "are" },
                // Steps are powers of ten; a binary fraction would show digits that are none.
                (step_m * 1e9).round() / 1e6,
                if columns.len() == 1 { "holds" } else { "hold" },
            ),
            Cause::Unit { unit } => {
                write!(f, "all values are in {unit}: convert them to the unit in the column's name")
            }
            Cause::OtherMachine { machine } => {
                write!(f, "this is not machine {machine}: check the machine file and its strokes")
            }
            Cause::PartOfStroke => f.write_str(
                "only a part was driven: beyond it coordinates are extrapolated; measure the whole stroke that is used",
            ),
            Cause::EqualSteps => f.write_str(
                "the plan goes to a grid of places: where scales or screws may have errors of a short period, take points at unequal \
                 distances (abbe plan draws them)",
            ),
            Cause::Pairs { says } => f.write_str(says),
            Cause::Scattered => f.write_str(
                "gross errors all over the data (interrupted beam, axes not at rest, rows mixed up): measure again",
            ),
            Cause::Held { errors, squares: (held, free) } => write!(
                f,
                "the machine file holds {} at zero: free, {} the mean square of normalised residuals from {} to {}; take the line out \
                 of [error_functions], with three offsets or more that are not in a line where it is a rotation",
                errors.join(", "),
                if errors.len() == 1 { "it takes" } else { "they take" },
                three_digits(*held),
                three_digits(*free),
            ),
            Cause::Lacks => f.write_str("the model lacks an effect that abbe diagnose may name"),
            Cause::Offsets { count } => write!(
                f,
                "one of the {count} offsets is not what the campaign says: measure them again (a wrong one is named by abbe identify \
                 --accept-misfit, and abbe diagnose after it)"
            ),
            Cause::Understated => f.write_str(
                "the declared uncertainties are too small: check their unit, and whether they are k = 1 or k = 2",
            ),
            Cause::Overstated => f.write_str(
                "the declared uncertainties are too large: check their unit, and whether they are k = 1 or k = 2",
            ),
            Cause::Computed => {
                f.write_str("the values are no readings of an instrument, but computed, smoothed or averaged")
            }
        }
    }
}

impl Verdict {
    /// Why there is no result, in one paragraph; `None` where nothing is refused.
    pub fn refusal(&self) -> Option<String> {
        let refusals: Vec<String> = self.of(Grade::Refusal).map(ToString::to_string).collect();
        (!refusals.is_empty()).then(|| refusals.join("; and "))
    }
}
