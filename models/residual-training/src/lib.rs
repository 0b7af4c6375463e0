//! Trains the residual network and judges it against its rivals on the same data.
//!
//! Place in the flow: measured residual vectors in ([`train()`]), a model with the evidence for it out. The only crate that
//! knows `burn`; what it makes runs without.

mod attention;
mod belief;
mod compare;
mod config;
mod device;
mod held_out;
mod networks;
mod optimise;
mod perceptron;
mod recommend;
mod scores;
pub mod simulated;
mod split;
mod swarm;
mod train;
mod views;

pub use attention::Attention;
pub use compare::{CompareConfig, Comparison, Interval, Rival, RivalRow, SeedRow, Subject, compare};
pub use config::{Config, ConfigRange, Method, Optimiser, Split, SplitKind};
pub use device::{Device, DeviceError};
pub use optimise::{Examples, Network, OptimiseError, Run, Training, View, outputs};
pub use perceptron::Perceptron;
pub use recommend::{Candidate, POSITION_ALONE, Recommendation, recommend};
pub use scores::Scores;
pub use split::{blocks, folds};
pub use train::{
    Curve, Go, HeldOutPoint, HeldOutScores, Progress, State, Trained, TrainingError, TrainingRecord, ZERO, train,
    train_beside,
};
pub use views::ViewError;
