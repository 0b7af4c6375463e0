//! The ROS arguments of a command line, where there is no node that takes them.
//!
//! Place in the flow: [`RosArgs::split`] takes them off, as it does before a node; the level of the log holds for every command.

mod args;
mod meant;
mod names;
mod yaml;

pub use args::{ArgsError, RosArgs};
pub use meant::Meant;
pub use names::{NameError, NodeIdentity, RemapRule, resolve};
pub use yaml::{ParameterAssignment, YamlError, YamlValue};
