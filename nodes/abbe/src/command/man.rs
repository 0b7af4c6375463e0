//! `abbe man --out DIR`: manual pages, one for the program and one for each command.
//!
//! Place in the flow: made of the same description as the help, so that neither can fall behind.

use abbe_files::write_atomically;
use anyhow::Context;
use clap::Command;
use clap_mangen::Man;
use std::path::{Path, PathBuf};

/// Arguments of `man`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Folder for abbe.1, abbe-identify.1 and so on
    #[arg(long)]
    out: PathBuf,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let out = &arguments.out;
    std::fs::create_dir_all(out).with_context(|| format!("{}: the folder cannot be made", out.display()))?;
    let mut program = crate::help::command();
    program.build();
    write(out, "abbe", &program)?;
    let mut shown = program.get_subcommands().filter(|command| !command.is_hide_set() && command.get_name() != "help");
    shown.try_for_each(|command| write(out, &format!("abbe-{}", command.get_name()), command))
}

fn write(out: &Path, name: &str, command: &Command) -> anyhow::Result<()> {
    let mut page = Vec::new();
    Man::new(command.clone()).title(name.to_uppercase()).render(&mut page)?;
    Ok(write_atomically(&out.join(format!("{name}.1")), &page)?)
}
