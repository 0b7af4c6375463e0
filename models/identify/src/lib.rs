//! Identification of the machine model from a tracer campaign.
//!
//! Place in the flow: campaign (SI, machine frame) and machine description in, [`Identified`] out: a model with the
//! covariance of everything, the readings it rejected, and what the data could not tell. The range model is
//! l = |q(reading, offset; errors) − station| − dead path; all unknowns are found together, from no start values,
//! by weighted, penalised Gauss-Newton least squares (FYXZ paper eq. 4-9 with Liang 2025's chain).

mod belief;
mod bound;
mod chords;
mod comparison;
mod contradiction;
pub mod correlation;
mod design;
mod error;
mod evidence;
mod foresee;
pub mod jade;
mod lagged;
mod linear;
mod mistake;
mod model_rows;
mod normal;
mod observability;
mod options;
mod order;
mod outcome;
mod parallel;
mod planned_rows;
mod plausibility;
pub mod points;
mod proposal;
mod range_noise;
mod roughness;
mod rows;
mod smoothing;
mod solve;
mod term;
mod unexplained;
pub mod verdict;

pub use abbe_measurement::{robust, station_start};
pub use belief::Belief;
pub use bound::at_cramer_rao_bound;
pub use comparison::minus_two_log_likelihood_on;
pub use error::{IdentifyError, Unobservable};
pub use evidence::{CorrelatedNoise, CorrelatedPair, ErrorEvidence, Evidence, RejectedReading, StationEvidence};
pub use foresee::foresee;
pub use lagged::with_lagged;
pub use linear::symmetric_eigen;
pub use model_rows::ModelRows;
pub use options::{Noise, Options, OrderChoice, Progress};
pub use parallel::in_parallel;
pub use planned_rows::{PlannedRows, STATION_PARAMETERS, SplitRows};
pub use range_noise::{Along, By, RangeCorrelation, correlation_left};
pub use rows::{Rows, residuals_of};
pub use solve::{Identified, identify, identify_with};
pub use term::{CampaignRow, EffectTerm, TIME};
pub use unexplained::{Excess, by_axis};
