//! Networks: neighbourhood attention (NCNN, Liang 2025, chapter 3, eq. 15-19), and residual blocks on the inputs ([`position`]).
//!
//! Place in the flow: eight measured residuals around a target become tokens ([`tokens()`]); embedding, multi-head
//! self-attention and output layer make a residual vector of them. [`forward`] computes it as printed, [`folded`] the same
//! function with all matrices multiplied out beforehand, which is what runs live.

pub mod config;
pub mod folded;
pub mod forward;
pub mod parameters;
pub mod position;
pub mod tokens;

pub use config::{ConfigError, NetworkConfig};
pub use folded::Folded;
pub use parameters::{Layout, Parameters, ParametersError};
pub use position::{PositionConfig, PositionConfigError, PositionNetwork};
pub use tokens::{MOST_NEIGHBOURED, Normaliser, Token, token_size, tokens};
