//! Closing the loop: finds what a model lacks in measured data, traces it to an effect, adds it and judges the gain.
//!
//! Place in the flow: model and campaign (SI, machine frame) in, a diagnosis out: is the residual consistent with noise,
//! which effects were found and how surely, what cannot be told apart, and the model with the effects added. Pure: the
//! `abbe diagnose` command reads, reports and stores.
//!
//! What a machine lacks, from its campaign: here of a bridge whose X axis has a play that no error function holds.
//!
//! ```
//! use abbe_diagnose::{DiagnoseOptions, diagnose};
//! use abbe_geometry::error_function::FunctionKind;
//! use abbe_geometry::machine::{Joint, Machine, Side, Squareness, USUAL_RAM_TURN_RAD};
//! use abbe_geometry::{Axis, ErrorId, Vector3, rotation::RotationForm};
//! use abbe_measurement::campaign::{Campaign, Covariate, RangeReading};
//! use abbe_measurement::instrument::RangeUncertainty;
//!
//! // What the maker says of it: X carries Y carries Z, strokes in metres, splines of four intervals.
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
//!     kinds: [Some(FunctionKind::BSpline { intervals: 4 }); ErrorId::COUNT],
//!     repeatability_m: [0.1e-6; 3],
//!     u_ram_turn_rad: [USUAL_RAM_TURN_RAD; 3],
//!     default_offset_m: None,
//! };
//!
//! // What a tracer saw from four places, along the edges and through the middle of the volume, there and back. Coming from below, the
//! // machine is 1.5 µm ahead of its X scale, coming from above as far behind it.
//! let stations = [[-0.3, -0.2, -0.1], [1.1, -0.2, -0.2], [-0.2, 0.9, -0.1], [0.9, 0.8, 0.9]];
//! let offsets = [[0.0, 0.0, -0.06], [0.15, 0.0, -0.06], [0.0, 0.15, -0.09]];
//! let mut campaign = Campaign { stations: ["A", "B", "C", "D"].map(str::to_owned).to_vec(), ..Campaign::default() };
//! let (mut dir_x, mut direction) = (Vec::new(), 1.0);
//! for (station, place) in stations.into_iter().enumerate() {
//!     let mut first = None;
//!     for (offset_m, axis, k) in offsets.iter().flat_map(|offset| (0..54).map(move |k| (*offset, k / 18, k % 18))) {
//!         let (line, is_back) = (campaign.lines.len() as u32, k % 2 == 1);
//!         campaign.lines.push(format!("line {line}"));
//!         for i in 0..7 {
//!             let along = if is_back { 6 - i } else { i } as f64 / 6.0;
//!             let share = |d: usize| [along, (k / 2 % 3) as f64 / 2.0, (k / 6) as f64 / 2.0][(3 + d - axis) % 3];
//!             let reading_m = [0, 1, 2].map(|d| machine.stroke_m[d].1 * share(d));
//!             // Where X stands still, the side from which it came stays.
//!             if axis == 0 {
//!                 direction = if is_back { -1.0 } else { 1.0 };
//!             }
//!             let actual_m = Vector3::from(reading_m) + Vector3::new(1.5e-6 * direction, 0.0, 0.0);
//!             let range_m = (actual_m + Vector3::from(offset_m) - Vector3::from(place)).norm();
//!             let number = campaign.readings.len() as f64;
//!             let noise_m = 0.2e-6 * (number * number).sin();
//!             dir_x.push(Some(direction));
//!             campaign.readings.push(RangeReading {
//!                 station: station as u32,
//!                 line,
//!                 time_s: 4.0 * number,
//!                 reading_m,
//!                 offset_m,
//!                 length_m: range_m + noise_m - *first.get_or_insert(range_m),
//!             });
//!         }
//!     }
//! }
//! campaign.covariates.push(Covariate { name: "dir_x".to_owned(), values: dir_x });
//!
//! // Without repeating the search to judge what it finds.
//! let options = DiagnoseOptions { folds: 0, placebos: 0, ..DiagnoseOptions::default() };
//! let range = RangeUncertainty { constant_m: 0.2e-6, per_metre: 0.0, common_per_metre: 0.0 };
//! let diagnosis = diagnose(&machine, &[], range, &campaign, &options, &mut |_progress| true)?;
//! assert!(!diagnosis.found.is_empty() && diagnosis.found[0].name == "reversal", "{:?}", diagnosis.found);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod alias;
mod aliased_period;
mod aside;
mod blocks;
mod candidates;
mod clock;
mod columns;
mod competing;
mod context;
mod cut_off;
mod diagnose;
mod diagnosis;
mod ended;
mod error;
mod exchange;
mod explanation;
mod floor;
mod foresight;
mod gate;
pub mod held_out;
mod implausible;
mod instant;
mod judge;
mod jumps;
mod kind;
mod lagged_columns;
mod lags;
mod late;
pub mod linear;
mod logs;
mod look;
mod machine_step;
mod named;
mod noise;
mod options;
mod order;
mod outdone;
mod paired;
mod pass;
mod peak;
mod periodic;
mod quadratic_form;
mod runs;
mod same_claim;
mod scale_steps;
pub mod score;
mod search;
mod serial;
mod side_by_side;
mod sizes;
mod step;
mod still;
pub mod study;
mod taken;
mod taken_out;
mod together;
mod tomorrow;
mod wald;
mod wander;
mod wandering;
mod within_stations;
mod worth;
mod zero_of_scale;

pub use clock::ClockShift;
pub use competing::Competing;
pub use diagnose::diagnose;
pub use diagnosis::{
    Blocked, Diagnosis, Found, FoundParameter, HeldOutError, NotIdentifiable, Placebo, Rival, Unseen, Untestable,
};
pub use error::DiagnoseError;
pub use explanation::Explanation;
pub use floor::{Alone, stated, with_left_out};
pub use foresight::{Foresight, Told, ToldParameter, foresee};
pub use gate::{Judged, Verdict};
pub use late::Late;
pub use logs::mended;
pub use machine_step::{Change, MachineStep};
pub use noise::{Detection, Group, Structure};
pub use options::{DiagnoseOptions, Progress};
pub use pass::{Scored, score_pass};
pub use step::SetAside;
pub use still::Departure;
pub use wander::{Slow, Wander};

#[cfg(test)]
mod tests;
