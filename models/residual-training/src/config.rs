//! Configuration of a training: plain data with the paper's values as defaults.
//!
//! Place in the flow: from a file or the command line into [`crate::train()`] and [`crate::compare()`]; kept beside the result. Unknown
//! keys are refused when it is read, values out of range by [`Config::check`].

use abbe_residual_net::ResidualMethod;
use abbe_residual_net::network::{ConfigError, NetworkConfig, PositionConfig, PositionConfigError};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Everything a training depends on beside the data.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Seed of split, initial parameters and order of the examples.
    pub seed: u64,
    /// What is trained.
    pub method: Method,
    /// Sizes and switches of the network on the neighbourhood.
    pub network: NetworkConfig,
    /// Sizes of the network on the position.
    pub perceptron: PositionConfig,
    /// How it is trained.
    pub optimiser: Optimiser,
    /// How data are divided.
    pub split: Split,
}

/// What is trained.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// All of them; the one that held-out data speak for is taken.
    #[default]
    Recommended,
    /// Kriging alone.
    Kriging,
    /// The network alone.
    Network,
    /// Kriging, and the network on what it leaves.
    KrigingNetwork,
    /// A network on the position, and kriging of what it leaves.
    PerceptronKriging,
}

impl Method {
    /// Kinds that have to be trained.
    pub fn kinds(self) -> &'static [ResidualMethod] {
        match self {
            Method::Recommended => &ResidualMethod::ALL,
            Method::Kriging => &[ResidualMethod::Kriging],
            Method::Network => &[ResidualMethod::Network],
            Method::KrigingNetwork => &[ResidualMethod::KrigingNetwork],
            Method::PerceptronKriging => &[ResidualMethod::PerceptronKriging],
        }
    }
}

/// Adam on the mean squared error. Batch, epochs and first rate are the paper's; it says that the rate decays, but not how.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Optimiser {
    /// Passes over the data at most.
    pub epochs: usize,
    /// Examples a step.
    pub batch: usize,
    /// Learning rate of the first epoch.
    pub learning_rate: f64,
    /// Factor on the learning rate from one epoch to the next.
    pub decay: f64,
    /// Epochs without a better validation loss after which training ends.
    pub patience: usize,
}

impl Default for Optimiser {
    fn default() -> Optimiser {
        Optimiser { epochs: 100, batch: 32, learning_rate: 1e-3, decay: 0.97, patience: 20 }
    }
}

/// How points are divided into what is learnt from, what decides when to stop, and what judges.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Split {
    /// By blocks of space, or point by point.
    pub kind: SplitKind,
    /// Parts of about equal size, each held out once. At least 3: one judges, one stops, the others teach.
    pub folds: usize,
    /// Blocks along each axis of the volume.
    pub blocks_per_axis: usize,
}

impl Default for Split {
    fn default() -> Split {
        Split { kind: SplitKind::Blocks, folds: 5, blocks_per_axis: 4 }
    }
}

/// What is dealt into folds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SplitKind {
    /// Whole blocks of space: says how well regions are predicted in which nothing was measured.
    Blocks,
    /// Single points, as in the paper: says how well a point between measured neighbours is predicted. Flatters every method
    /// wherever live points lie farther from measured ones than these do.
    Random,
}

impl Split {
    /// Whether figures from this split look better than use in unmeasured regions will be.
    pub fn is_flattering(&self) -> bool {
        self.kind == SplitKind::Random
    }
}

/// A configuration out of range; the text names the key.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ConfigRange {
    /// Of the network on the neighbourhood.
    #[error("network: {0}")]
    Network(#[from] ConfigError),
    /// Of the network on the position.
    #[error("perceptron: {0}")]
    Perceptron(#[from] PositionConfigError),
    /// Anything else.
    #[error("{key} is {value}; {expected}")]
    Key {
        /// Key.
        key: &'static str,
        /// Its value.
        value: String,
        /// What it may be.
        expected: &'static str,
    },
}

impl Config {
    /// What `split.folds` and `split.blocks_per_axis` may be.
    pub(crate) const FOLDS: std::ops::RangeInclusive<usize> = 3..=20;
    pub(crate) const BLOCKS_PER_AXIS: std::ops::RangeInclusive<usize> = 2..=20;

    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), ConfigRange> {
        self.network.check()?;
        self.perceptron.check()?;
        let Optimiser { epochs, batch, learning_rate, decay, patience } = self.optimiser;
        let rule = |key, value: String, expected, holds: bool| {
            if holds { Ok(()) } else { Err(ConfigRange::Key { key, value, expected }) }
        };
        rule("optimiser.epochs", epochs.to_string(), "give 1 or more", epochs > 0)?;
        rule("optimiser.batch", batch.to_string(), "give 1 or more", batch > 0)?;
        rule("optimiser.patience", patience.to_string(), "give 1 or more", patience > 0)?;
        let is_rate = learning_rate > 0.0 && learning_rate < 1.0;
        rule("optimiser.learning_rate", learning_rate.to_string(), "give a number between 0 and 1", is_rate)?;
        rule("optimiser.decay", decay.to_string(), "give a number above 0, at most 1", decay > 0.0 && decay <= 1.0)?;
        let folds = self.split.folds;
        rule("split.folds", folds.to_string(), "give 3 to 20", Config::FOLDS.contains(&folds))?;
        let blocks = self.split.blocks_per_axis;
        rule("split.blocks_per_axis", blocks.to_string(), "give 2 to 20", Config::BLOCKS_PER_AXIS.contains(&blocks))
    }
}
