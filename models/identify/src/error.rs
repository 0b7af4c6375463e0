//! Why a campaign could not be identified, in words that name the place and the remedy.
//!
//! Place in the flow: the only failure type of this crate; command and tests show its text as it is.

use abbe_geometry::machine::MachineError;
use abbe_geometry::model::ModelError;
use thiserror::Error;

/// A combination of errors that the plan cannot tell from a perfect machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Unobservable {
    /// The errors and stations that take part, strongest first.
    pub errors: Vec<String>,
}

/// Why identification was refused or failed.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum IdentifyError {
    /// An effect needs a covariate that a reading lacks.
    #[error(
        "effect {effect} needs covariate {covariate}, which reading {reading} lacks; log it for every reading or leave \
         the effect out"
    )]
    NoCovariate {
        /// The effect.
        effect: &'static str,
        /// The covariate.
        covariate: String,
        /// Number of the reading, from 1.
        reading: usize,
    },
    /// The machine description is wrong.
    #[error(transparent)]
    Machine(#[from] MachineError),
    /// The parts found do not make a model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// No or one station.
    #[error(
        "the campaign has {found} station{plural}; ranges from one place cannot be told from a rigid motion of the \
         machine: measure from at least 3 stations, better 4 or more, not all in one plane",
        plural = if *found == 1 { "" } else { "s" }
    )]
    TooFewStations {
        /// Stations in the campaign.
        found: usize,
    },
    /// Fewer readings than unknowns.
    #[error(
        "{readings} readings cannot determine {unknowns} unknowns; measure more lines, or give the error functions \
         fewer coefficients in the machine file"
    )]
    TooFewReadings {
        /// Readings in the campaign.
        readings: usize,
        /// Unknown coefficients, angles, stations and dead paths.
        unknowns: usize,
    },
    /// A number in the campaign is not finite.
    #[error("reading {reading}: {what} is not a finite number; correct or remove that row")]
    NotFinite {
        /// Number of the reading, from 1.
        reading: usize,
        /// Which quantity.
        what: &'static str,
    },
    /// A reading names a station or line that the campaign does not list.
    #[error(
        "reading {reading}: {what} number {index} is not in the campaign's list; the campaign was put together wrongly"
    )]
    Dangling {
        /// Number of the reading, from 1.
        reading: usize,
        /// Station or line.
        what: &'static str,
        /// The index that leads nowhere, from 0.
        index: u32,
    },
    /// A reading is outside the machine.
    #[error(
        "reading {reading}: {axis} = {position_mm:.4} mm lies outside the stroke {lower_mm} … {upper_mm} mm of machine \
         {machine}; this campaign is of another machine, its columns are exchanged, or the unit is wrong"
    )]
    OutsideStroke {
        /// Number of the reading, from 1.
        reading: usize,
        /// Axis letter.
        axis: char,
        /// Where it is (mm).
        position_mm: f64,
        /// Lower end of the stroke (mm).
        lower_mm: f64,
        /// Upper end of the stroke (mm).
        upper_mm: f64,
        /// Name of the machine.
        machine: String,
    },
    /// A station's position cannot be found from its readings.
    #[error("station {station}: {problem}")]
    Station {
        /// Name of the station.
        station: String,
        /// What is wrong and what to do.
        problem: String,
    },
    /// Readings of a line contradict the rest of the station by far more than any machine error.
    #[error(
        "line {line} of station {station} (readings {first}-{last}) disagrees with the station's other readings by \
         {residual_mm:.3} mm; {explanation}"
    )]
    Contradiction {
        /// Name of the line.
        line: String,
        /// Name of the station.
        station: String,
        /// First reading of the line, from 1.
        first: usize,
        /// Last reading of the line, from 1.
        last: usize,
        /// Median disagreement (mm).
        residual_mm: f64,
        /// What explains it, and what to do.
        explanation: String,
    },
    /// The plan cannot determine all unknowns.
    #[error("{}", unobservable_text(.groups, .lines, .enough, [*.rank, *.unknowns]))]
    RankDeficient {
        /// Combinations that cannot be seen.
        groups: Vec<Unobservable>,
        /// Errors that, held at zero, leave nothing unseen; empty where no errors do that.
        enough: Vec<String>,
        /// Lines that would make them visible.
        lines: Vec<String>,
        /// Rank of the plan for the low-order errors and stations.
        rank: usize,
        /// Number of low-order unknowns.
        unknowns: usize,
    },
    /// The normal equations could not be factored.
    #[error(
        "the unknowns cannot be told apart numerically; use fewer coefficients in the machine file, order = \
         \"evidence\", or a plan with more lines"
    )]
    Singular,
    /// The iteration did not settle.
    #[error(
        "not converged after {passes} passes: parameters still move by {largest_step:.2} of their uncertainty; check the \
         campaign for mixed-up stations or offsets"
    )]
    NotConverged {
        /// Passes made.
        passes: usize,
        /// Largest step in units of the uncertainty.
        largest_step: f64,
    },
    /// The observer asked to stop.
    #[error("stopped on request; nothing was identified")]
    Stopped,
}

fn unobservable_text(
    groups: &[Unobservable],
    lines: &[String],
    enough: &[String],
    [rank, unknowns]: [usize; 2],
) -> String {
    let words: Vec<String> = groups.iter().map(group_text).collect();
    let remedy = if lines.is_empty() {
        "no few lines along an axis would help: measure from more stations around the machine".to_owned()
    } else {
        let numbered: Vec<String> = lines.iter().enumerate().map(|(k, line)| format!("({}) {line}", k + 1)).collect();
        format!("add {}: {}", if lines.len() == 1 { "this line" } else { "these lines" }, numbered.join("; "))
    };
    format!(
        "the plan determines only {rank} of {unknowns} low-order unknowns; it cannot see {}; {remedy}; or hold {} at zero in the machine file \
         (kind = \"zero\")",
        words.join("; "),
        enough_to_hold(enough)
    )
}

/// What to hold, so that the rest is seen.
fn enough_to_hold(enough: &[String]) -> String {
    match enough {
        [] => "what cannot be seen".to_owned(),
        names => format!("what is known to be small ({} would be enough)", names.join(", ")),
    }
}

/// `ECY`, or `EAZ apart from EYZ, A0Z`.
pub(crate) fn group_text(group: &Unobservable) -> String {
    match group.errors.split_first() {
        Some((first, [])) => first.clone(),
        Some((first, others)) => format!("{first} apart from {}", others.join(", ")),
        None => "a combination of many small parts".to_owned(),
    }
}
