//! Identification of the machine model from a tracer campaign.
//!
//! Place in the flow: campaign (SI, machine frame) and machine description in, [`Identified`] out: a model with the
//! covariance of everything, the readings it rejected, and what the data could not tell. The range model is
//! l = |q(reading, offset; errors) − station| − dead path; all unknowns are found together, from no start values,
//! by weighted, penalised Gauss-Newton least squares (FYXZ paper eq. 4-9 with Liang 2025's chain).
//!
//! A simulated campaign in, the errors of the machine with their uncertainty out:
//!
//! ```
//! use abbe_geometry::error_function::FunctionKind;
//! use abbe_geometry::machine::{Joint, Machine, Side, Squareness, USUAL_RAM_TURN_RAD};
//! use abbe_geometry::{Axis, ErrorId, rotation::RotationForm};
//! use abbe_identify::{IdentifyOptions, identify};
//! use abbe_virtual_machine::{SimulationConfig, TruthRecipe, plan::presets, simulate_campaign};
//! use abbe_virtual_machine::{environment::EnvironmentConfig, instrument::InstrumentConfig};
//!
//! // What the maker says of a moving bridge: X carries Y carries Z, strokes in metres, splines of nine intervals.
//! let tool = |axis| Joint { axis, side: Side::Tool };
//! let square = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
//! let machine = Machine {
//!     name: "bridge".to_owned(),
//!     frame_id: "bridge".to_owned(),
//!     joints: [tool(Axis::X), tool(Axis::Y), tool(Axis::Z)],
//!     stroke_m: [(0.0, 0.8), (0.0, 0.6), (0.0, 0.6)],
//!     squareness: [
//!         square("C0Y", Axis::Y, Axis::Z),
//!         square("B0Z", Axis::Z, Axis::Y),
//!         square("A0Z", Axis::Z, Axis::X),
//!     ],
//!     rotation: RotationForm::Exact,
//!     kinds: [Some(FunctionKind::BSpline { intervals: 9 }); ErrorId::COUNT],
//!     repeatability_m: [0.25e-6; 3],
//!     u_ram_turn_rad: [USUAL_RAM_TURN_RAD; 3],
//!     default_offset_m: None,
//! };
//!
//! // What a tracer measured on it: here the simulator's tracer, on a machine that only the simulator knows.
//! let truth = TruthRecipe::default().bridge_xyz()?;
//! let campaign = simulate_campaign(&SimulationConfig {
//!     seed: 7,
//!     plan: presets::case_like(truth.stroke_m, 7).build()?,
//!     machine: truth,
//!     instrument: InstrumentConfig::LASER_TRACER,
//!     environment: EnvironmentConfig::constant(),
//!     effects: Vec::new(),
//! })?
//! .campaign;
//!
//! let range = InstrumentConfig::LASER_TRACER.range;
//! let found = identify(&machine, range, &campaign, &IdentifyOptions::default(), &mut |_progress| true)?;
//! let exx = ErrorId::all().find(|id| id.name() == "EXX").expect("one of the 18 error functions");
//! let (error_m, u_m) = found.model.error(exx, 0.4);
//! assert!(error_m.abs() < 50e-6 && u_m < 1e-6, "{error_m} ± {u_m} m");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod anderson;
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
mod identified;
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
mod range_correlation;
mod range_noise;
mod roughness;
mod rows;
mod smoothing;
mod solve;
mod spectrum;
mod term;
mod unexplained;
mod unseen_expansion;
pub mod verdict;
mod zeros;

pub use abbe_geometry::effects::TIME;
pub use abbe_measurement::{robust, station_start};
pub use belief::Belief;
pub use bound::at_cramer_rao_bound;
pub use comparison::minus_two_log_likelihood_on;
pub use design::STATION_PARAMETERS;
pub use error::{IdentifyError, Unobservable};
pub use evidence::{CorrelatedNoise, CorrelatedPair, ErrorEvidence, Evidence, RejectedReading, StationEvidence};
pub use foresee::foresee;
pub use identified::Identified;
pub use lagged::with_lagged;
pub use linear::{dot, log_determinant, symmetric_eigen, trace_of_product};
pub use model_rows::ModelRows;
pub use options::{IdentifyOptions, Noise, OrderChoice, Progress, U_ABSOLUTE_ZERO_M};
pub use parallel::in_parallel;
pub use planned_rows::{PlannedRows, SplitRows};
pub use range_correlation::{Along, By, RangeCorrelation};
pub use range_noise::correlation_left;
pub use rows::{Rows, residuals_of};
pub use solve::{identify, identify_with};
pub use term::{CampaignRow, EffectTerm};
pub use unexplained::{Excess, by_axis};
pub use unseen_expansion::{is_expansion, unseen_expansions};
