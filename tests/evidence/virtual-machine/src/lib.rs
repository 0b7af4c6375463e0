//! Seeded simulator of machine, instrument and environment: the truth that everything else is tested against.
//!
//! Place in the flow: makes campaigns and verification points in the form that files and bags give, together
//! with the truth behind them. It shares no kinematics, no error function and no effect with the models of the
//! project, so that a mistake cannot cancel out. Pure numerics: no file, no clock, no ROS; seeds are explicit.

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExample;

pub mod drive;
pub mod effects;
pub mod environment;
pub mod error;
pub mod guideway;
pub mod instrument;
pub mod length_test;
mod logged;
pub mod machine;
pub mod plan;
mod random;
pub mod shipped;
pub mod simulate;
pub mod sphere_scan;
pub mod verification;

pub use drive::{Drive, Obedient, Pace, Seen};
pub use error::SimulationError;
pub use machine::{Axis, MachineTruth, TruthRecipe, VirtualMachine};
pub use shipped::{Declared, VOLUMETRIC_RMS_M, shipped_bridge};
pub use simulate::{ReadingStream, Simulated, SimulatedReading, SimulationConfig, simulate_campaign};
pub use verification::{actual_points_m, verification_points, verification_points_with};
