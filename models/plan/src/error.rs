//! Why there is no plan, in words that name the key and the remedy.
//!
//! Place in the flow: the only failure type of this crate; command and tests show its text as it is.

use abbe_geometry::effects::EffectError;
use abbe_identify::IdentifyError;
use thiserror::Error;

/// Why there is no plan.
#[derive(Debug, Error)]
pub enum PlanError {
    /// The request makes no sense.
    #[error("{key}: {problem}; {remedy}")]
    Request {
        /// Key of the request file.
        key: String,
        /// What is wrong.
        problem: String,
        /// What to do.
        remedy: String,
    },
    /// The budget ends before the plan tells all errors.
    #[error(
        "goal.budget_h: {:.2} h is too short to tell all errors of the machine; the shortest plan found takes {:.2} h, with {stations} \
         stations and {lines} lines: give at least that, or shorten dwell_s and station_change_s", .budget_s / 3600.0,
        .shortest_s / 3600.0
    )]
    Budget {
        /// What was given (s).
        budget_s: f64,
        /// What is needed (s).
        shortest_s: f64,
        /// Stations of the shortest plan.
        stations: usize,
        /// Its lines.
        lines: usize,
    },
    /// No plan reaches the uncertainty.
    #[error(
        "goal.uncertainty_um: no plan found reaches {:.3} µm{}; the best has {:.3} µm{}, in {:.2} h with {stations} stations and \
         {lines} lines: {}", .wanted_m * 1e6, within(*.budget_s), .best_m * 1e6, of_which(*.common_m), .time_s / 3600.0,
        remedy(*.wanted_m, *.common_m)
    )]
    Unreached {
        /// What was wanted (m).
        wanted_m: f64,
        /// The budget (s), if there was one.
        budget_s: Option<f64>,
        /// What the best plan reaches (m).
        best_m: f64,
        /// What of it the common scale of the instrument makes (m).
        common_m: f64,
        /// Its time (s).
        time_s: f64,
        /// Its stations.
        stations: usize,
        /// Its lines.
        lines: usize,
    },
    /// All candidate lines together do not tell everything.
    #[error("all candidate lines from all stations that fit together do not tell the machine: {0}")]
    Unobservable(IdentifyError),
    /// An effect does not fit the machine.
    #[error("tell: {0}")]
    Effect(#[from] EffectError),
    /// Identification refuses the plan.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// The observer said stop before there was a plan.
    #[error("stopped before there was a plan that tells all errors; nothing was planned")]
    Stopped,
}

fn within(budget_s: Option<f64>) -> String {
    budget_s.map_or_else(String::new, |s| format!(" within {:.2} h", s / 3600.0))
}

fn of_which(common_m: f64) -> String {
    match common_m > 0.0 {
        true => format!(
            " (of which {:.3} µm, in squares, are the scale that all lengths of the instrument have in common, [instrument] \
             u_k2_common_um_per_m, which no plan makes smaller)",
            common_m * 1e6
        ),
        false => String::new(),
    }
}

/// What to do: neither time nor stands help where the instrument's scale alone is more than what is wanted.
fn remedy(wanted_m: f64, common_m: f64) -> &'static str {
    match common_m >= wanted_m {
        true => "ask for more than that scale makes, or measure with an instrument whose scale is known better",
        false => "ask for no less, allow more time, or add stands, holders or levels",
    }
}
