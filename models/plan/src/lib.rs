//! Planning of a tracer campaign: where to put the tracer, which lines to drive, and what will come of it.
//!
//! Place in the flow: before anything is measured. A [`Request`] says what there is (machine, instrument, stands, reflector
//! holders, speeds) and what is wanted (a volume, an uncertainty or a time, effects to be told); [`plan()`] proposes stations
//! and lines and states what identification will then reach. It knows no Jacobian, prior or covariance of its own: rows come
//! from [`abbe_identify::PlannedRows`], the statement from [`abbe_identify::foresee`], what can be told of effects from
//! [`abbe_diagnose::foresee`]. SI, machine frame; uncertainties k = 1. Pure: `abbe plan` reads and writes.
//!
//! A machine and four stands in, stations and lines for two hours of measuring out, with the uncertainty that they will reach:
//!
//! ```
//! use abbe_geometry::error_function::FunctionKind;
//! use abbe_geometry::machine::{Joint, Machine, Side, Squareness, USUAL_RAM_TURN_RAD};
//! use abbe_geometry::{Axis, ErrorId, rotation::RotationForm};
//! use abbe_identify::{Belief, IdentifyOptions};
//! use abbe_measurement::instrument::RangeUncertainty;
//! use abbe_measurement::planned::{Goal, Holder, Lines, Motion, Stand, Tracer};
//! use abbe_plan::{Request, plan};
//!
//! // A moving bridge: X carries Y carries Z, strokes in metres, splines of six intervals.
//! let tool = |axis| Joint { axis, side: Side::Tool };
//! let square = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
//! let machine = Machine {
//!     name: "bridge".to_owned(),
//!     frame_id: "bridge".to_owned(),
//!     joints: [tool(Axis::X), tool(Axis::Y), tool(Axis::Z)],
//!     stroke_m: [(0.0, 0.8), (0.0, 0.6), (0.0, 0.5)],
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
//! let stand = |name: &str, position_m| Stand { name: name.to_owned(), position_m, of_region: false };
//! let holder = |offset_m| Holder { offset_m, acceptance: None };
//! let request = Request {
//!     instrument: RangeUncertainty { constant_m: 0.2e-6, per_metre: 0.3e-6, common_per_metre: 0.0 },
//!     options: IdentifyOptions::default(),
//!     volume_m: machine.stroke_m,
//!     tips_m: vec![[0.0, 0.0, -0.06]],
//!     tracer: Tracer { nearest_m: 0.1, farthest_m: 10.0, elevation_rad: (-1.5, 1.5) },
//!     stands: vec![
//!         stand("A", [-0.25, -0.25, -0.1]),
//!         stand("B", [1.05, -0.2, -0.1]),
//!         stand("C", [-0.2, 0.85, -0.1]),
//!         stand("D", [1.0, 0.8, 0.6]),
//!     ],
//!     most_stations: 4,
//!     holders: vec![holder([0.0, 0.0, -0.06]), holder([0.12, 0.0, -0.06]), holder([0.0, 0.14, -0.09])],
//!     motion: Motion {
//!         feeds_m_s: vec![0.05],
//!         acceleration_m_s2: 0.3,
//!         dwell_s: 3.0,
//!         station_change_s: 300.0,
//!         holder_change_s: 60.0,
//!     },
//!     lines: Lines { points: (8, 12), levels: 2, diagonals: true },
//!     goal: Goal { uncertainty_m: None, budget_s: Some(2.0 * 3600.0) },
//!     tell: Vec::new(),
//!     sensors: Vec::new(),
//!     // How much error functions bend between their ends: 1 um, 1 urad.
//!     belief: Belief::of_bends(&machine, |_| 1e-6)?,
//!     seed: 1,
//!     measured: None,
//!     machine,
//! };
//! let planned = plan(&request, &mut |_progress| true)?;
//! assert!(planned.stations.len() >= 3 && planned.lines.len() > 20);
//! assert!(planned.time_s <= 2.0 * 3600.0 && planned.promise.u_m < 3e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod candidates;
mod check;
mod covariates;
mod design;
mod error;
mod plan;
mod prior;
mod promise;
mod request;
mod route;
mod search;
mod sight;
mod stations;
mod timing;

pub use check::check;
pub use error::PlanError;
pub use plan::{Plan, plan};
pub use promise::{ErrorPromise, Known, Promise, of_campaign, u_over};
pub use request::{Measured, Progress, Request, Stage};
