//! Identification of the machine model from a tracer campaign.
//!
//! Place in the flow: campaign (SI, machine frame) and machine description in, [`Identified`] out: a model with the
//! covariance of everything, the readings it rejected, and what the data could not tell. The range model is
//! l = |q(reading, offset; errors) − station| − dead path; all unknowns are found together, from no start values,
//! by weighted, penalised Gauss-Newton least squares (FYXZ paper eq. 4-9 with Liang 2025's chain).
//!
//! Ranges in, the errors of the machine with their uncertainty out:
//!
//! ```
//! use abbe_geometry::error_function::FunctionKind;
//! use abbe_geometry::machine::{Joint, Machine, Side, Squareness, USUAL_RAM_TURN_RAD};
//! use abbe_geometry::{Axis, ErrorId, Vector3, rotation::RotationForm};
//! use abbe_identify::{IdentifyOptions, identify};
//! use abbe_measurement::campaign::{Campaign, RangeReading};
//! use abbe_measurement::instrument::RangeUncertainty;
//!
//! // What the maker says of a moving bridge: X carries Y carries Z, strokes in metres, splines of six intervals.
//! let square = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
//! let machine = Machine {
//!     name: "bridge".to_owned(),
//!     frame_id: "bridge".to_owned(),
//!     joints: Axis::ALL.map(|axis| Joint { axis, side: Side::Tool }),
//!     stroke_m: [(0.0, 0.8), (0.0, 0.6), (0.0, 0.6)],
//!     squareness: [
//!         square("C0Y", Axis::Y, Axis::Z),
//!         square("B0Z", Axis::Z, Axis::Y),
//!         square("A0Z", Axis::Z, Axis::X),
//!     ],
//!     rotation: RotationForm::Exact,
//!     kinds: [Some(FunctionKind::BSpline { intervals: 6 }); ErrorId::COUNT],
//!     repeatability_m: [0.1e-6; 3],
//!     u_ram_turn_rad: [USUAL_RAM_TURN_RAD; 3],
//!     default_offset_m: None,
//! };
//!
//! // What a tracer saw from four places, by three reflector offsets, along the edges and through the middle of the volume. Here the
//! // machine is one whose X scale is short by 12 µm/m, and nothing else is wrong with it.
//! let stations = [[-0.3, -0.2, -0.1], [1.1, -0.2, -0.2], [-0.2, 0.9, -0.1], [0.9, 0.8, 0.9]];
//! let offsets = [[0.0, 0.0, -0.06], [0.15, 0.0, -0.06], [0.0, 0.15, -0.09]];
//! let mut campaign = Campaign { stations: ["A", "B", "C", "D"].map(str::to_owned).to_vec(), ..Campaign::default() };
//! for (station, place) in stations.into_iter().enumerate() {
//!     let mut first = None;
//!     for (offset_m, axis, k) in offsets.iter().flat_map(|offset| (0..27).map(move |k| (*offset, k / 9, k % 9))) {
//!         let line = campaign.lines.len() as u32;
//!         campaign.lines.push(format!("line {line}"));
//!         for i in 0..11 {
//!             let share = |d: usize| [i as f64 / 10.0, (k % 3) as f64 / 2.0, (k / 3) as f64 / 2.0][(3 + d - axis) % 3];
//!             let reading_m = [0, 1, 2].map(|d| machine.stroke_m[d].1 * share(d));
//!             let actual_m = Vector3::from(reading_m) + Vector3::new(12e-6 * reading_m[0], 0.0, 0.0);
//!             let range_m = (actual_m + Vector3::from(offset_m) - Vector3::from(place)).norm();
//!             let number = campaign.readings.len() as f64;
//!             let noise_m = 0.2e-6 * (number * number).sin();
//!             campaign.readings.push(RangeReading {
//!                 station: station as u32,
//!                 line,
//!                 time_s: 4.0 * number,
//!                 reading_m,
//!                 offset_m,
//!                 // An interferometer counts from where it was set to zero.
//!                 length_m: range_m + noise_m - *first.get_or_insert(range_m),
//!             });
//!         }
//!     }
//! }
//!
//! let range = RangeUncertainty { constant_m: 0.2e-6, per_metre: 0.0, common_per_metre: 0.0 };
//! let found = identify(&machine, range, &campaign, &IdentifyOptions::default(), &mut |_progress| true)?;
//! let exx = ErrorId::all().find(|id| id.name() == "EXX").expect("one of the 18 error functions");
//! let (error_m, u_m) = found.model.error(exx, 0.8);
//! assert!((error_m - 9.6e-6).abs() < 3.0 * u_m && u_m < 0.5e-6, "{error_m} ± {u_m} m");
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
