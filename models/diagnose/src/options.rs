//! What the caller may choose, and how a diagnosis tells how far it is.
//!
//! Place in the flow: filled by the command line or a test.

/// Choices of one diagnosis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DiagnoseOptions {
    /// How campaigns are identified.
    pub identify: abbe_identify::IdentifyOptions,
    /// Probability of a false alarm of one family of tests (named effects; dependence without candidates), after
    /// correction for their number.
    pub significance: f64,
    /// Evidence (twice the log likelihood, after the price of parameters and trials) that anything added must bring:
    /// 10 is "very strong" (Kass & Raftery 1995).
    pub least_evidence: f64,
    /// Evidence (twice the log likelihood) within which another effect counts as explaining the same.
    pub rival_margin: f64,
    /// Parts in which lines are left out of the whole search to judge what it finds.
    pub folds: usize,
    /// Placebos drawn for each effect found.
    pub placebos: usize,
    /// Seed of folds and placebos.
    pub seed: u64,
}

impl Default for DiagnoseOptions {
    fn default() -> DiagnoseOptions {
        DiagnoseOptions {
            // Effects that errors nearly absorb settle slowly.
            identify: abbe_identify::IdentifyOptions { max_passes: 60, ..abbe_identify::IdentifyOptions::default() },
            significance: 0.01,
            least_evidence: 10.0,
            rival_margin: 10.0,
            folds: 4,
            placebos: 10,
            seed: 1,
        }
    }
}

/// One step of progress; the observer returns false to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// A fit of the model with so many effects.
    Fitting {
        /// Pass over the readings.
        pass: usize,
        /// Effects in it.
        effects: usize,
    },
    /// Candidates are scored.
    Scoring {
        /// Round, from 1.
        round: usize,
        /// Effects found so far.
        effects: usize,
    },
    /// The search is repeated without some lines.
    Judging {
        /// Part left out, from 1.
        fold: usize,
        /// Parts.
        folds: usize,
    },
}
