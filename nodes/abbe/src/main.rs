//! The `abbe` command.
//!
//! Place in the flow: the one program a user runs; offline commands (identify, correct, verify, simulate, convert,
//! replay), the live graph (launch, node), and the demo that does all of it on a recorded campaign. Errors are
//! printed once, here, and give exit code 1.

mod calibration;
mod command;
mod conformity;
mod demo;
mod diagnosis;
mod output;
mod pairs;
mod pipeline;
mod residual;
mod residual_bag;
mod training;
mod verification;

use abbe_runtime::follow_launcher;
use abbe_runtime::ros::RosArgs;
use clap::Parser;
use std::io::{IsTerminal, Write};
use std::process::ExitCode;
use tracing_subscriber::EnvFilter;

#[derive(Debug, Parser)]
#[command(
    name = "abbe",
    version,
    about = "Corrects the coordinates of a coordinate measuring machine",
    max_term_width = 110
)]
struct Arguments {
    #[command(subcommand)]
    command: command::Command,
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Not `eprintln!`: where nobody reads it, the exit code still tells.
            let _ = writeln!(std::io::stderr(), "abbe: {}", told(&error));
            ExitCode::FAILURE
        }
    }
}

/// An error with its causes; a cause that an error already quotes is not said twice.
fn told(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |said, cause| match said.as_str() {
        "" => cause,
        before if before.contains(&cause) => said,
        before => format!("{before}: {cause}"),
    })
}

fn run() -> anyhow::Result<()> {
    // A node that starts a command for work beside its own takes it along when it ends.
    follow_launcher()?;
    // ROS arguments may follow any command; they are taken off before the rest is parsed.
    let (ros_args, own) = RosArgs::split(std::env::args())?;
    let arguments = Arguments::parse_from(own);
    let level = ros_args.log_level.clone().unwrap_or_else(|| "warn".to_owned());
    // The DDS libraries call every clean exit an error; what really fails there comes back as a result. RUST_LOG
    // shows them.
    let fallback = EnvFilter::try_new(format!("{level},rustdds=off,ros2_client=off")).unwrap_or_default();
    let filter = EnvFilter::try_from_default_env().unwrap_or(fallback);
    // A log that nobody reads any more (the launcher was killed) must not end the thread that writes to it.
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    let log = log.with_ansi(std::io::stderr().is_terminal());
    log.log_internal_errors(false).init();
    command::run(arguments.command, ros_args)
}
