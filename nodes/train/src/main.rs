//! The program `abbe-train`: the commands `train` and `compare` of `abbe`.
//!
//! Place in the flow: `abbe` becomes this program where it is asked for one of the two; the arguments are described there. It is
//! apart because it alone is built on a framework of networks.

mod compare;
mod data;
mod held;
mod inputs;
mod off_text;
mod report;
mod train;

use abbe::command::training::{CompareArguments, PROGRAM, TrainArguments};
use abbe::{help, stop};
use abbe_runtime::ros::RosArgs;
use abbe_runtime::{end_with_reader, follow_launcher};
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

#[derive(Debug, Parser)]
#[command(
    name = PROGRAM,
    version = help::VERSION,
    about = "Trains residual models; started by abbe train and abbe compare",
    max_term_width = 110
)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
enum Command {
    /// Train a residual model on residual vectors
    Train(TrainArguments),
    /// Judge the residual network and its rivals on the same held-out data
    Compare(CompareArguments),
}

fn main() -> ExitCode {
    abbe::end(run())
}

fn run() -> anyhow::Result<()> {
    follow_launcher()?;
    let (ros_args, own) = RosArgs::split(std::env::args())?;
    let mut program = help::with_examples(Arguments::command());
    let mut matches = program.try_get_matches_from_mut(own).unwrap_or_else(|error| error.exit());
    let arguments =
        Arguments::from_arg_matches_mut(&mut matches).unwrap_or_else(|error| error.format(&mut program).exit());
    abbe::start_log(&ros_args, "", false)?;
    end_with_reader()?;
    match arguments.command {
        // Has something to keep from its first network on.
        Command::Train(arguments) => train::run(&arguments),
        Command::Compare(arguments) => {
            let shutdown = stop::keep_what_there_is(&Arc::new(AtomicBool::new(true)))?;
            compare::run(&arguments).map_err(|error| stop::told_as_stopped(error, &shutdown))
        }
    }
}
