//! Closing the loop: finds what a model lacks in measured data, traces it to an effect, adds it and judges the gain.
//!
//! Place in the flow: model and campaign (SI, machine frame) in, a diagnosis out: is the residual consistent with noise,
//! which effects were found and how surely, what cannot be told apart, and the model with the effects added. Pure: the
//! `abbe diagnose` command reads, reports and stores.
//!
//! What a machine lacks, from its campaign: here of a simulated bridge whose X axis has a play that no error function holds.
//!
//! ```
//! use abbe_diagnose::{DiagnoseOptions, diagnose};
//! use abbe_geometry::error_function::FunctionKind;
//! use abbe_geometry::machine::{Joint, Machine, Side, Squareness, USUAL_RAM_TURN_RAD};
//! use abbe_geometry::{Axis, ErrorId, rotation::RotationForm};
//! use abbe_virtual_machine::plan::{LineKind, PlanRecipe, presets};
//! use abbe_virtual_machine::{SimulationConfig, TruthRecipe, effects::from_text, simulate_campaign};
//! use abbe_virtual_machine::{environment::EnvironmentConfig, instrument::InstrumentConfig};
//!
//! // What the maker says of it: X carries Y carries Z, strokes in metres, splines of six intervals.
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
//!     repeatability_m: [0.25e-6; 3],
//!     u_ram_turn_rad: [USUAL_RAM_TURN_RAD; 3],
//!     default_offset_m: None,
//! };
//!
//! // Edges and body diagonals of its volume, there and back, from four stations.
//! let truth = TruthRecipe::default().bridge_xyz()?;
//! let plan = PlanRecipe {
//!     levels: [2; 3],
//!     kinds: vec![LineKind::AlongX, LineKind::AlongY, LineKind::AlongZ, LineKind::BodyDiagonal],
//!     points: [7; 2],
//!     ..presets::plan_b(truth.stroke_m, 7)
//! };
//! let campaign = simulate_campaign(&SimulationConfig {
//!     seed: 7,
//!     plan: plan.build()?,
//!     machine: truth,
//!     instrument: InstrumentConfig::LASER_TRACER,
//!     environment: EnvironmentConfig::constant(),
//!     effects: vec![from_text("backlash axis=x size_um=3 growth_um=0")?],
//! })?
//! .campaign;
//!
//! // Without repeating the search to judge what it finds.
//! let options = DiagnoseOptions { folds: 0, placebos: 0, ..DiagnoseOptions::default() };
//! let range = InstrumentConfig::LASER_TRACER.range;
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
