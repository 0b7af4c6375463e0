//! What a fit says against itself: findings with a grade, in words that name the likely causes.
//!
//! Place in the flow: after [`crate::identify`] and the fits of other commands, before anything is stored. Commands print
//! findings, refuse what is graded [`Grade::Refusal`] unless the user accepts it, and keep what remains in the model file,
//! so that everyone who uses the model reads the same words. Pure: figures in, findings out (SI, but for texts).
//!
//! Where the grades lie, and why:
//!
//! - **Rejected readings.** The weights reject from six robust deviations on. Of normal noise one reading in 10⁹ lies there,
//!   so a rejected reading is a gross error or a sign that the model is wrong. Gross errors are counts: where each reading is
//!   one with probability p, more than the 99.9 % point of the binomial distribution is not explained by p. Up to p = 1 % is a
//!   message, up to 2 % a warning (a careful campaign has fewer, a hasty one as many), beyond that a refusal.
//! - **Noise against what was declared**, s = √(χ²/ν). Chance moves s² by √(2/ν). Declared uncertainties are rarely better
//!   than a factor of 1.5, a mix-up of k = 1 with k = 2 or 3 is a factor of 2 or 3: beyond chance a message, beyond a factor of
//!   3 a warning. Nobody who measured is wrong by 10: beyond that a refusal, either way.
//! - **Stroke.** A model says nothing of the stroke that was not driven. 80 % is what plans leave at the ends: below it a
//!   message, below half a warning, up to a tenth a refusal (inches taken for millimetres are 3.9 %, metres 0.1 %, centimetres
//!   10 % of a full stroke).

mod by_station;
mod causes;
mod copies;
mod coverage;
mod held;
mod misfit;
mod of_campaign;
mod one_sided;
mod resolution;
mod sampled;
mod step;
mod words;

pub use causes::Cause;
pub use coverage::{stroke, stroke_along};
pub use held::ask_held_functions;
pub use misfit::{Counted, of_noise, of_rejected};
pub use of_campaign::{of_campaign, widened};
pub use resolution::coarsest_step;
pub use sampled::equal_steps;
pub(crate) use step::{Seen, find as find_step};
pub use words::three_digits;

/// How much a finding weighs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    /// To be known.
    Message,
    /// To be looked at before the result is used.
    Warning,
    /// No result, unless the user accepts it.
    Refusal,
}

impl Grade {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Grade::Message => "message",
            Grade::Warning => "warning",
            Grade::Refusal => "refusal",
        }
    }
}

/// What was found.
#[derive(Debug, Clone, PartialEq)]
pub enum Subject {
    /// More readings, points or pairs were rejected than gross errors explain.
    Rejected {
        /// What they are called, in the plural.
        what: &'static str,
        /// Rejected.
        rejected: usize,
        /// All.
        all: usize,
        /// Share of gross errors that decides on the grade.
        share: f64,
        /// As many as these and chance give at the most.
        explained: usize,
    },
    /// The residual differs from the declared noise.
    Noise {
        /// Residual over declared noise.
        ratio: f64,
        /// χ² per degree of freedom.
        chi2_per_dof: f64,
    },
    /// Little of the stroke was driven.
    Stroke {
        /// Axis letters and the share of the stroke that their readings span.
        shares: Vec<(char, f64)>,
    },
    /// Logged quantities had one value at each station.
    ByStation {
        /// The quantities.
        names: Vec<String>,
    },
    /// Readings repeat others to the last digit.
    Copies {
        /// Readings that repeat one before.
        copies: usize,
        /// All.
        all: usize,
    },
    /// All points were approached from one side.
    OneSided {
        /// Axis letters.
        axes: Vec<char>,
    },
    /// No temperature was logged.
    NoTemperature,
    /// The machine, or what carries the stations, does not stay as it is.
    Wanders {
        /// Probability of as much by chance.
        p_value: f64,
        /// How far the tip wanders along X, Y and Z (m, rms over the readings).
        size_m: [f64; 3],
    },
    /// Readings lie at whole multiples of a step.
    Sampled {
        /// Axis letters and steps (m).
        steps: Vec<(char, f64)>,
    },
}

/// Something that speaks against a result.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// How much it weighs.
    pub grade: Grade,
    /// What it is.
    pub subject: Subject,
    /// What would explain it, likeliest first.
    pub causes: Vec<Cause>,
}

/// All that speaks against a result, gravest first.
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    /// The findings.
    pub findings: Vec<Finding>,
    /// Factor by which covariances grow where the result is used all the same: see [`widened`]. One where they are right.
    pub widening: f64,
}

impl Verdict {
    /// Sorts findings by weight.
    pub fn new(mut findings: Vec<Finding>, widening: f64) -> Verdict {
        findings.sort_by_key(|finding| std::cmp::Reverse(finding.grade));
        Verdict { findings, widening }
    }

    /// With another finding.
    pub fn with(self, finding: Finding) -> Verdict {
        let Verdict { mut findings, widening } = self;
        findings.push(finding);
        Verdict::new(findings, widening)
    }

    /// The gravest grade.
    pub fn grade(&self) -> Option<Grade> {
        self.findings.iter().map(|finding| finding.grade).max()
    }

    /// Findings of this grade.
    pub fn of(&self, grade: Grade) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(move |finding| finding.grade == grade)
    }

    /// Whether a result should not be given.
    pub fn is_refused(&self) -> bool {
        self.grade() == Some(Grade::Refusal)
    }
}
