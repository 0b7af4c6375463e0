//! Commands that a program for another system has by name alone.
//!
//! Place in the flow: in place of those that run live nodes, or write what they read.

use anyhow::bail;
use std::ffi::OsString;

/// Whatever it takes on Linux.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    #[arg(hide = true, trailing_var_arg = true, allow_hyphen_values = true)]
    _words: Vec<OsString>,
}

pub(crate) fn run(_: &Arguments) -> anyhow::Result<()> {
    bail!("live nodes, and the commands around them, run on Linux; what computes with files runs here as well")
}
