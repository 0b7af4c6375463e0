//! Trains the residual network and judges it against its rivals on the same data.
//!
//! Place in the flow: measured residual vectors in ([`train()`]), a model with the evidence for it out. The only crate that
//! knows `burn`; what it makes runs without.
//!
//! A short training on a simulated field, and what folds that no network saw say of it:
//!
//! ```
//! use abbe_residual_training::simulated::{Character, SimulatedField, random_points_m};
//! use abbe_residual_training::{Config, Device, Go, Method, train};
//!
//! let field = SimulatedField::new(Character::Smooth, 1);
//! let measured = field.measured(random_points_m(60, 2), 3)?;
//! // A network of few numbers for few epochs: a real one takes minutes.
//! let mut config = Config { method: Method::KrigingNetwork, seed: 4, ..Config::default() };
//! (config.network.width, config.optimiser.epochs, config.split.folds) = (8, 2, 3);
//! let trained = train(&measured, &config, &Device::cpu(), None, &mut |_progress| Go::On)?;
//! let mse_um2 = |method: &str| {
//!     let own = trained.record.held_out.iter().find(|held| held.method == method);
//!     own.map(|held| held.scores.mse_um2).expect("a method that was judged")
//! };
//! assert!(mse_um2(trained.model.kind().name()) < mse_um2("zero"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod attention;
mod belief;
mod compare;
mod config;
mod device;
mod error;
mod held_out;
mod kriging;
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
pub use error::TrainingError;
pub use held_out::HeldOutPoint;
pub use optimise::{Examples, Network, OptimiseError, Run, Training, View, outputs};
pub use perceptron::Perceptron;
pub use recommend::{Candidate, POSITION_ALONE, Recommendation, ZERO, recommend};
pub use scores::Scores;
pub use split::{blocks, folds};
pub use train::{Curve, Go, HeldOutScores, Progress, State, Trained, TrainingRecord, train, train_beside};
pub use views::ViewError;
