//! `abbe completions SHELL`: what makes a shell complete commands and options.
//!
//! Place in the flow: made of the same description as the help, so that neither can fall behind.

use clap_complete::Shell;
use std::io::Write;

/// Arguments of `completions`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// The shell; its words go to standard output
    shell: Shell,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let mut words = Vec::new();
    clap_complete::generate(arguments.shell, &mut crate::help::command(), "abbe", &mut words);
    std::io::stdout().write_all(&words)?;
    Ok(())
}
