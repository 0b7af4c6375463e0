//! The residual network as it runs, live and offline: what geometry leaves, predicted from measured residuals nearby.
//!
//! Place in the flow: trained parameters and calibrated points in ([`ResidualModel`]), residual of any point (m, machine
//! frame, actual − corrected so far) with its covariance out. A point is a list of inputs: the position, or whatever was named. No framework: plain loops, the same bits everywhere.
//!
//! The calibrated points are the lattice. A target is any other point: in training, a measured point that is taken out
//! of the lattice together with what lies around it, so that no target ever sees itself.

mod calibrated_points;
mod calibration;
mod exponential;
mod kriging;
mod model;
mod neighbourhood;
pub mod network;
pub mod record;
mod registers;
mod supporting_planes;
mod trend;

pub use calibrated_points::CalibratedPoints;
pub use calibration::{Calibration, NORMAL_95};
pub use kriging::{Component, Kriging, KrigingMean};
pub use model::{Apart, At, Ensemble, Kind, ModelError, Parts, ResidualModel, check_units};
pub use neighbourhood::{Neighbourhood, VERTICES, Vertices, spacing};
pub use trend::{Place, PositionEnsemble, Trend, TrendError, place, place_box};
