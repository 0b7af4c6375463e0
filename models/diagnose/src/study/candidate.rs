//! What a kind of data must say of itself to be studied, and what a candidate effect is.
//!
//! Place in the flow: implemented by each kind of data (`five_axis`, `runs`, `vectors`), used by the common search. Rows
//! are whitened (divided by their standard uncertainty), so that columns have the inverse unit of their parameter.

use super::diagnosis::{Ambiguity, Kind, Untestable};
use super::fit::Fit;
use crate::error::DiagnoseError;
use crate::linear::Linear;
use crate::score::Score;
use abbe_geometry::effects::ParameterSpec;
use faer::Mat;

/// An effect that might be missing from the model.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    /// Unique in the study.
    pub(crate) name: String,
    /// Formula or shape.
    pub(crate) formula: String,
    pub(crate) kind: Kind,
    /// Candidates of one family are forms of the same thing: finer and coarser, not rivals.
    pub(crate) family: String,
    pub(crate) covariates: Vec<String>,
    pub(crate) parameters: Vec<ParameterSpec>,
    /// Measurement that tells it from what looks alike.
    pub(crate) decided_by: String,
}

/// The problem around one point of linearisation.
#[derive(Debug, Clone)]
pub(crate) struct Local {
    /// Observed less predicted, whitened.
    pub(crate) residual: Vec<f64>,
    /// Columns of the base model, whitened.
    pub(crate) base: Mat<f64>,
    /// Where columns are taken: whatever the kind of data needs to remember.
    pub(crate) point: Vec<f64>,
}

/// One kind of data.
pub(crate) trait Study {
    /// Kind of data, in words.
    fn of(&self) -> &'static str;

    /// All candidates.
    fn candidates(&self) -> &[Candidate];

    /// The problem with these candidates at these parameters; all others absent. The base model is at its best there.
    fn local(&self, added: &[(usize, Vec<f64>)]) -> Result<Local, DiagnoseError>;

    /// Columns of one candidate at a point, whitened.
    fn columns(&self, point: &[f64], candidate: usize) -> Mat<f64>;

    /// Whether columns and residuals are the same everywhere, up to the linear prediction.
    fn is_linear(&self) -> bool {
        true
    }

    /// Adjusts the shape of a candidate (a period) to a fit without it.
    fn refine(&mut self, _without: &Linear, _candidate: usize) {}

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

    /// Whether replicates scatter less than what a fit leaves between them: replicates of what, and the test.
    fn lack_of_fit(&self, fit: &Fit) -> Option<(String, Score)>;

    /// What the base model is, in words.
    fn base_word(&self) -> &'static str;

    /// What these data cannot test at all.
    fn untestable(&self) -> Vec<Untestable>;

    /// What the plan of measurement itself cannot tell of candidates found.
    fn ambiguities(&self, _found: &[usize]) -> Vec<Ambiguity> {
        Vec::new()
    }

    /// What a reader must know.
    fn notes(&self) -> Vec<String>;
}
