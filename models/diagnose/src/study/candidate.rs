//! What a kind of data must say of itself to be studied, and what a candidate effect is.
//!
//! Place in the flow: implemented by each kind of data (`five_axis`, `runs`, `vectors`), used by the common search. Rows
//! are divided by their standard uncertainty, so that columns have the inverse unit of their parameter; what they have
//! in common with the rows before them is taken out later ([`super::view`]).

use super::outcome::{Ambiguity, Untestable};
use super::told::{Changed, REACHES};
use crate::error::DiagnoseError;
use crate::explanation::Explanation;
use crate::score::Score;
use abbe_geometry::Axis;
use abbe_geometry::effects::{ParameterSpec, Shape};
use abbe_geometry::unseen_expansion::UnseenExpansion;
use faer::Mat;
use std::collections::{BTreeMap, BTreeSet};

/// An effect that might be missing from the model.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    /// Unique in the study.
    pub(crate) name: String,
    /// Formula or shape.
    pub(crate) formula: String,
    pub(crate) kind: Explanation,
    /// Candidates of one family are forms of the same thing: finer and coarser, not rivals.
    pub(crate) family: String,
    pub(crate) covariates: Vec<String>,
    pub(crate) parameters: Vec<ParameterSpec>,
    /// Of these, the ones without which it is something else; none where all make it what it is.
    pub(crate) essential: Vec<usize>,
    /// Measurement that tells it from what looks alike.
    pub(crate) decided_by: String,
    /// Claimed only where it stands apart from all that is simpler: a wave, which few targets turn into something else.
    pub(crate) stands_apart: bool,
    /// What it goes before where both pass.
    pub(crate) goes: Goes,
}

/// Which of several candidates that pass is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Goes {
    /// Before any other: what is straight, before what is bent.
    First,
    /// Before descriptions: an error of one axis, which has its name by definition, whatever causes it.
    BeforeDescriptions,
    /// By its evidence.
    ByEvidence,
}

/// Rows of one axis or component in the order of measurement.
#[derive(Debug, Clone)]
pub(crate) struct Chain {
    /// In words, such as `axis X`.
    pub(crate) of: String,
    pub(crate) rows: Vec<usize>,
    /// Steps since the row before.
    pub(crate) gaps: Vec<f64>,
    /// Columns, a row each, that leave little but scatter whatever is missing: what single rows are held against.
    pub(crate) rich: Mat<f64>,
    /// Standard uncertainty of a row that its figures are divided by, on average (m).
    pub(crate) unit_m: f64,
    /// Axis along which it was measured.
    pub(crate) along: Option<Axis>,
}

/// What a reader wants to have been looked at before nothing is said to be missing.
#[derive(Debug, Clone)]
pub(crate) struct Question {
    /// In words, such as `drift`.
    pub(crate) what: String,
    /// Candidates that answer it; none where the data cannot.
    pub(crate) candidates: Vec<usize>,
}

/// An effect of a machine model that is a candidate, or part of one.
#[derive(Debug, Clone)]
pub(crate) struct ModelTerm {
    /// Name in the registry of effects.
    pub(crate) effect: &'static str,
    pub(crate) shape: Shape,
    /// Its parameters (rows) as combinations of the candidate's (columns).
    pub(crate) map: Mat<f64>,
    /// The table that it is, between whose places further parameters stand for what is not known there.
    pub(crate) table: Option<Table>,
}

/// What data leave open of a model: zero in value.
#[derive(Debug, Clone)]
pub(crate) struct Untold {
    /// In words.
    pub(crate) what: String,
    /// Whether nothing that was measured shows it, so that it is what is usual.
    pub(crate) is_usual: bool,
    /// Parameters made of no candidate's.
    pub(crate) term: ModelTerm,
    /// Their standard deviations (SI).
    pub(crate) u: Vec<f64>,
    /// Quantity that it reads.
    pub(crate) reads: Option<String>,
}

/// What tells how much the data leave open.
pub(crate) struct Open<'a> {
    /// Candidates found.
    pub(crate) found: &'a [usize],
    /// Whether a row of the study is no gross error.
    pub(crate) is_kept: &'a dyn Fn(usize) -> bool,
    /// Standard uncertainty of the first parameter of a candidate that was not found, beside all that was (SI); `None` where the data say
    /// nothing of it.
    pub(crate) known: &'a dyn Fn(usize) -> Option<f64>,
    /// First parameter of a candidate in the place of those found that the data do not tell from it (SI); `None` where there are none.
    pub(crate) instead: &'a dyn Fn(usize) -> Option<f64>,
    /// Values of a candidate found (SI).
    pub(crate) values: &'a dyn Fn(usize) -> Vec<f64>,
}

/// Standard deviation of a coefficient of expansion that nobody measured (1/K): that of steel.
const EXPANSION_PER_K: f64 = 12e-6;
/// Standard uncertainties of a coefficient that a search may overlook.
const UNDETECTED: f64 = 2.0;

impl Open<'_> {
    /// What the search may have overlooked of an expansion (1/K): that of this candidate, if it is one, and no more than scales expand.
    pub(crate) fn overlooked_per_k(&self, expansion: Option<usize>) -> f64 {
        let known = expansion.and_then(|candidate| (self.known)(candidate));
        known.map_or(EXPANSION_PER_K, |u| (UNDETECTED * u).min(EXPANSION_PER_K))
    }

    /// What an expansion would be in the place of what was found and is not told from it (1/K), such that an interval for none holds it.
    pub(crate) fn instead_per_k(&self, expansion: Option<usize>) -> f64 {
        let instead = expansion.and_then(|candidate| (self.instead)(candidate));
        instead.map_or(0.0, |per_k| (REACHES * per_k.abs()).min(EXPANSION_PER_K))
    }
}

/// Name and rows of the study of a pose.
pub(crate) type PoseRows = (String, BTreeSet<usize>);

/// Places of a table (m), and what tells how large an error between them may be.
#[derive(Debug, Clone)]
pub(crate) struct Table {
    pub(crate) places_m: Vec<f64>,
    pub(crate) between: Between,
}

/// What may lie between the places of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Between {
    /// What its own values depart by from their neighbours.
    Departures,
    /// A wave as large as the candidate, which is the same at all places.
    Alias,
}

/// Frequencies among which a wave is sought, and where it was measured.
#[derive(Debug, Clone)]
pub(crate) struct Band {
    /// Slowest and fastest (1/m), and the step of a scan.
    pub(crate) low: f64,
    pub(crate) high: f64,
    pub(crate) step: f64,
    /// Fastest that neighbouring positions resolve on average (1/m).
    pub(crate) resolved: f64,
    /// Distance within which two frequencies are one (1/m).
    pub(crate) resolution: f64,
    /// Positions (m), each once, and that of each row asked for.
    pub(crate) places_m: Vec<f64>,
    pub(crate) place_of: Vec<usize>,
}

impl Band {
    /// Number of waves tried for each that the positions resolve, where this one is faster; 1 where they resolve it.
    pub(crate) fn choices(&self, frequency: f64) -> f64 {
        if frequency > self.resolved + self.step { (self.high - self.low) / (self.resolved - self.low) } else { 1.0 }
    }
}

/// The problem around one point of linearisation.
#[derive(Debug, Clone)]
pub(crate) struct Local {
    /// Observed less predicted, over the standard uncertainty of the rows.
    pub(crate) residual: Vec<f64>,
    /// Columns of the base model, over the standard uncertainty of the rows.
    pub(crate) base: Mat<f64>,
    /// Where columns are taken: whatever the kind of data needs to remember.
    pub(crate) point: Vec<f64>,
}

/// Candidates that a study offers to a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Forms {
    All,
    /// What describes goes straight with one quantity.
    Straight,
}

/// One kind of data.
pub(crate) trait Study: Sync {
    /// Kind of data, in words.
    fn of(&self) -> &'static str;

    /// All candidates.
    fn candidates(&self) -> &[Candidate];

    /// Sets of candidates that are tried as one where none passes alone: with any one missing, what it does looks like slow noise.
    fn together(&self) -> Vec<Vec<usize>> {
        Vec::new()
    }

    /// The problem with these candidates at these parameters; all others absent. The base model is at its best there.
    fn local(&self, added: &[(usize, Vec<f64>)]) -> Result<Local, DiagnoseError>;

    /// Columns of one candidate at a point, over the standard uncertainty of the rows.
    fn columns(&self, point: &[f64], candidate: usize) -> Mat<f64>;

    /// Whether columns and residuals are the same everywhere, up to the linear prediction.
    fn is_linear(&self) -> bool {
        true
    }

    /// The one chain that a candidate acts on, and its columns there, at the chain's rows named; `None` where it acts on
    /// several, or where columns depend on the point.
    fn chain_columns(&self, _candidate: usize, _rows: &[usize]) -> Option<(usize, Mat<f64>)> {
        None
    }

    /// Frequencies among which the shape of a candidate may be adjusted: its own and how far on either side.
    fn frequency(&self, _candidate: usize) -> Option<(f64, f64)> {
        None
    }

    /// The whole band among which the frequency of a candidate is chosen, at some rows of its chain; `None` where it stays near its
    /// own.
    fn band(&self, _candidate: usize, _rows: &[usize]) -> Option<Band> {
        None
    }

    /// Frequencies of which the best is taken before it is adjusted; none where a candidate stays near its own, or has a band.
    fn scan(&self, _candidate: usize) -> Vec<f64> {
        Vec::new()
    }

    /// Takes note of other frequencies at which a candidate goes nearly as well.
    fn set_aliases(&mut self, _candidate: usize, _frequencies: Vec<f64>) {}

    /// Columns at another frequency.
    fn columns_at(&self, _candidate: usize, _frequency: f64, _rows: &[usize]) -> Mat<f64> {
        Mat::zeros(0, 0)
    }

    /// Takes another frequency for a candidate.
    fn set_frequency(&mut self, _candidate: usize, _frequency: f64) {}

    /// Forgets all frequencies that were taken.
    fn reset(&mut self) {}

    /// Rows of its chain before each step in time that a candidate is made of; none for other candidates.
    fn steps_after(&self, _candidate: usize) -> Vec<usize> {
        Vec::new()
    }

    /// Places in the order of measurement that the data choose among for its steps; none where there is no choice.
    fn places(&self, _candidate: usize) -> &[usize] {
        &[]
    }

    /// Number of choices of which these places, or the frequency that was taken, are one.
    fn choices(&self, _candidate: usize, _places: &[usize]) -> f64 {
        1.0
    }

    /// Columns with its steps at other places.
    fn columns_from(&self, _candidate: usize, _places: &[usize], _rows: &[usize]) -> Mat<f64> {
        Mat::zeros(0, 0)
    }

    /// Takes other places for its steps.
    fn set_places(&mut self, _candidate: usize, _places: &[usize]) {}

    /// Columns simpler than a candidate that must stand apart, which may be what it really is.
    fn simpler(&self, _candidate: usize) -> Mat<f64> {
        Mat::zeros(0, 0)
    }

    /// Smooth errors beside which a wave may go, simplest first; with a table of errors place by place they are one family. None for other
    /// candidates.
    fn smooth_beside(&self, _candidate: usize) -> Vec<usize> {
        Vec::new()
    }

    /// Columns of what position alone may do, beside which a candidate must be seen that reads what passes by itself, such as time: where
    /// a plan goes through positions in one order, either looks like the other. None for other candidates.
    fn position_beside(&self, _candidate: usize) -> Mat<f64> {
        Mat::zeros(0, 0)
    }

    /// Whether a candidate reads what passes by itself while rows are taken.
    fn passes(&self, _candidate: usize) -> bool {
        false
    }

    /// Columns of what the instrument, or what is measured on, may do by itself with the course in time of a candidate of the machine; none
    /// where a candidate has no such course, or where nobody takes it for the machine's.
    fn instrument_beside(&self, _candidate: usize) -> Mat<f64> {
        Mat::zeros(0, 0)
    }

    /// Whether one that goes with the time makes another grow, which stands still.
    fn grows(&self, _candidate: usize, _with: usize) -> bool {
        false
    }

    /// Offers candidates of these forms from now on; whether any other is left out by that.
    fn offer(&mut self, _forms: Forms) -> bool {
        false
    }

    /// Whether a candidate is offered.
    fn is_offered(&self, _candidate: usize) -> bool {
        true
    }

    /// Whether a candidate describes one chain by a straight line, with one parameter: such are tried in pairs as well.
    fn is_line(&self, _candidate: usize) -> bool {
        false
    }

    /// Whether a candidate is what an instrument alone can do.
    fn is_of_instrument(&self, _candidate: usize) -> bool {
        false
    }

    /// That instrument in words, and what would tell it from the machine.
    fn instrument_words(&self) -> (&'static str, &'static str) {
        ("the instrument", "")
    }

    /// Whether what the instrument may have done stays in a model, known to no better than its own size.
    fn keeps_doubted(&self) -> bool {
        false
    }

    /// How far a candidate that stands still was moved by an instrument that drifts, where that is among the effects found (their values).
    fn changed_by_instrument(&self, _candidate: usize, _found: &[(usize, Vec<f64>)]) -> Option<Changed> {
        None
    }

    /// Rows in the order of measurement; none where order means nothing.
    fn chains(&self) -> &[Chain] {
        &[]
    }

    /// Standard uncertainty that a row is divided by (m).
    fn row_unit_m(&self, _row: usize) -> f64 {
        self.unit_m()
    }

    /// Whether a row was measured: what was not is no row of the study.
    fn is_measured(&self, _row: usize) -> bool {
        true
    }

    /// Standard uncertainty of each parameter of a candidate that no scatter of the rows shows (SI).
    fn u_beside(&self, candidate: usize) -> Vec<f64> {
        vec![0.0; self.candidates()[candidate].parameters.len()]
    }

    /// A row in words, for messages.
    fn row_name(&self, row: usize) -> String {
        format!("row {}", row + 1)
    }

    /// Which row of what was given this is, and which of its components; `None` where it is made of several.
    fn given(&self, _row: usize) -> Option<(usize, usize)> {
        None
    }

    /// What must have been looked at before nothing is said to be missing.
    fn questions(&self) -> Vec<Question> {
        Vec::new()
    }

    /// Rows that were measured together.
    fn blocks(&self) -> &[Vec<usize>];

    /// What a block is, in words.
    fn block_word(&self) -> &str;

    /// Rows that belong to one point: 3 for vectors, else 1.
    fn rows_per_point(&self) -> usize;

    /// Length (m) of one unit of a whitened rms: 1/√mean(1/σ²).
    fn unit_m(&self) -> f64;

    /// Whether the uncertainties are declared, rather than assumed equal.
    fn is_declared(&self) -> bool;

    /// Rows that are replicates of each other, in words, and columns that tell the groups apart; `None` without replicates.
    fn replicates(&self) -> Option<(String, Mat<f64>)> {
        None
    }

    /// The same test where replicates are not rows of the study, with these candidates at these parameters.
    fn lack_of_fit(&self, _added: &[(usize, Vec<f64>)]) -> Option<(String, Score)> {
        None
    }

    /// What the base model is, in words.
    fn base_word(&self) -> &'static str;

    /// What a candidate is in a model of a machine, or why it has no place there.
    fn model_terms(&self, _candidate: usize) -> Result<Vec<ModelTerm>, String> {
        Err("data of this kind give no model of three axes".to_owned())
    }

    /// What is to stand in the uncertainty of a model, since these data do not tell it.
    fn untold(&self, _open: &Open) -> Vec<Untold> {
        Vec::new()
    }

    /// Logged quantities of which parts of the machine were measured in different ranges, in words.
    fn apart(&self) -> Vec<String> {
        Vec::new()
    }

    /// Logged quantities that these terms read.
    fn model_covariates(&self, _candidate: usize) -> Vec<String> {
        Vec::new()
    }

    /// What was logged with each row.
    fn logged_rows(&self) -> Vec<&BTreeMap<String, f64>> {
        Vec::new()
    }

    /// The same of the rows on which a candidate acts.
    fn logged_at(&self, _candidate: usize) -> Vec<&BTreeMap<String, f64>> {
        self.logged_rows()
    }

    /// Names of the quantities that were logged with the rows, each once.
    fn logged(&self) -> BTreeSet<String> {
        self.logged_rows().into_iter().flat_map(|row| row.keys().cloned()).collect()
    }

    /// What the rows leave open of the expansion of each scale with each temperature that was logged.
    fn unseen_expansions(&self, _open: &Open) -> Vec<UnseenExpansion> {
        Vec::new()
    }

    /// What these expansions do to the rows at the size that is left open, one column for each scale: of several temperatures that one
    /// counts which says most.
    fn unseen_columns(&self, _unseen: &[UnseenExpansion]) -> Mat<f64> {
        Mat::zeros(0, 0)
    }

    /// Range of a logged quantity as a model reads it: times since the first row.
    fn model_range(&self, _name: &str) -> Option<(f64, f64)> {
        None
    }

    /// Smallest and largest reading of X, Y, Z (m) where they were measured.
    fn readings_m(&self) -> [Option<(f64, f64)>; 3] {
        [None; 3]
    }

    /// What would be the same at all rows, in words: neither seen nor in any uncertainty.
    fn hidden(&self) -> Vec<String> {
        Vec::new()
    }

    /// Name and rows of each placing in which all that was found must be the same; none where there is one.
    fn poses(&self) -> Vec<PoseRows> {
        Vec::new()
    }

    /// What these data cannot test at all.
    fn untestable(&self) -> Vec<Untestable>;

    /// What the plan of measurement itself cannot tell of candidates found.
    fn ambiguities(&self, _found: &[usize]) -> Vec<Ambiguity> {
        Vec::new()
    }

    /// What a reader must know.
    fn notes(&self) -> Vec<String>;
}
