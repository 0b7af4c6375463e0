//! Planning of a tracer campaign: where to put the tracer, which lines to drive, and what will come of it.
//!
//! Place in the flow: before anything is measured. A [`Request`] says what there is (machine, instrument, stands, reflector
//! holders, speeds) and what is wanted (a volume, an uncertainty or a time, effects to be told); [`plan()`] proposes stations
//! and lines and states what identification will then reach. It knows no Jacobian, prior or covariance of its own: rows come
//! from [`abbe_identify::PlannedRows`], the statement from [`abbe_identify::foresee`], what can be told of effects from
//! [`abbe_diagnose::foresee`]. SI, machine frame; uncertainties k = 1. Pure: `abbe plan` reads and writes.

mod candidates;
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

pub use error::PlanError;
pub use plan::{Line, Plan, Station, plan};
pub use promise::{ErrorPromise, Known, Promise, of_campaign};
pub use request::{
    Goal, Holder, Lines, Measured, Motion, Progress, Request, Sensor, Stage, Stand, Tracer, Wish, check,
};
