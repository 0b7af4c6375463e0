//! The `abbe` command, and what the program that trains shares with it.
//!
//! Place in the flow: the one program a user runs; offline commands (identify, correct, verify, simulate, convert,
//! replay), the live graph (launch, node), and the demo that does all of it on a recorded campaign. Errors are
//! printed once, here, and give their exit code ([`exit`]). The commands that train are another program's work
//! ([`command::training`]), so that who builds this one compiles no framework of networks; that program takes from
//! here what is public. Live commands are for Linux; elsewhere they are there by name alone.

#![cfg_attr(not(target_os = "linux"), allow(dead_code, unused_imports))] // what only live commands use

mod calibration;
#[cfg(target_os = "linux")]
mod capturing;
pub mod command;
mod conformity;
#[cfg(target_os = "linux")]
mod demo;
mod diagnosis;
pub mod exit;
mod fitted;
pub mod help;
pub mod identity;
mod log;
pub mod next;
mod offset_sign;
pub mod output;
mod pairs;
mod pipeline;
pub mod plane_field;
mod planning;
pub mod progress;
mod provenance;
mod residual;
pub mod residual_bag;
mod rosout;
mod rows;
#[cfg(target_os = "linux")]
mod service_manager;
pub mod stop;
mod tally;
mod verdict;
mod verification;

pub use pipeline::{is_bag, software};

use abbe_runtime::follow_launcher;
#[cfg(target_os = "linux")]
use abbe_runtime::gateway;
use abbe_runtime::ros::RosArgs;
use anyhow::Context;
use clap::Parser;
#[cfg(not(target_os = "linux"))]
use command::for_linux as demo;
use std::io::{IsTerminal, Write};
use std::process::ExitCode;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

/// How lines of the DDS libraries are known in the log.
#[cfg(target_os = "linux")]
const LIBRARIES: [&str; 2] = ["rustdds::", "ros2_client::"];

/// Where the OPC UA library is sent for certificates that nobody gave: it calls it an error not to find them, and needs none.
#[cfg(target_os = "linux")]
const NO_CERTIFICATES: &str = "/dev/null/none";

/// Size of a block that is kept when it is freed (bytes): a matrix of 1,000 unknowns.
const LARGEST_KEPT: usize = 8 << 20;

#[derive(Debug, Parser)]
#[command(
    name = "abbe",
    version = help::VERSION,
    about = "Corrects the coordinates of a coordinate measuring machine",
    max_term_width = 110
)]
struct Arguments {
    #[command(subcommand)]
    command: command::Command,
}

/// The program `abbe`.
pub fn main() -> ExitCode {
    keep_freed_memory();
    end(run())
}

/// What matrices free stays with the program, to be taken again: glibc would give each of more than 128 kB back to the kernel, and
/// the next would be new pages, zeroed one by one (an identification has 3,000 faults of pages so, and 10,000 without). glibc
/// raises that limit to the largest block freed so far, up to 32 MB; this one is never touched, and costs nothing.
fn keep_freed_memory() {
    drop(std::hint::black_box(Vec::<u8>::with_capacity(LARGEST_KEPT)));
}

/// Prints an error, once, and gives the exit code of a program that ends so.
pub fn end(outcome: anyhow::Result<()>) -> ExitCode {
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Not `eprintln!`: where nobody reads it, the exit code still tells.
            let _ = writeln!(std::io::stderr(), "abbe: {}", told(&error));
            ExitCode::from(exit::code(&error))
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

/// Whether the user wants no colours, as `NO_COLOR` says: set, and not empty (no-color.org).
fn wants_no_colour() -> bool {
    std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty())
}

fn run() -> anyhow::Result<()> {
    // A node that starts a command for work beside its own takes it along when it ends.
    follow_launcher()?;
    // ROS arguments may follow any command; they are taken off before the rest is parsed.
    let (ros_args, own) = RosArgs::split(std::env::args())?;
    let arguments = help::parse(own);
    let is_gateway = matches!(arguments.command, command::Command::Gateway(_));
    start_log(&ros_args, if is_gateway { "gateway: " } else { "" }, arguments.command.is_live())?;
    command::run(arguments.command, ros_args)
}

/// What is written to the log where nobody says otherwise.
const USUAL_LEVEL: &str = "warn,abbe_files=info";

/// Writes the log to standard error from now on, with `before` at the beginning of each line; lines that repeat are left out
/// where it is `throttled`.
///
/// # Errors
/// When `--log-level` is none.
pub fn start_log(ros_args: &RosArgs, before: &'static str, throttled: bool) -> anyhow::Result<()> {
    // How a table is written that is not plain CSV is always said.
    let level = match ros_args.log_level.as_deref() {
        // Those of libraries say nothing of the others.
        Some(level) if level.split(',').all(|one| one.contains('=')) => format!("{USUAL_LEVEL},{level}"),
        Some(level) => level.to_owned(),
        None => USUAL_LEVEL.to_owned(),
    };
    // DDS speaks in gateways only; what its library has to say there is heard, but for its complaints about every clean
    // exit and about questions that come before it has found its own publishers. RUST_LOG shows more, and less.
    // The OPC UA server of a rehearsal calls each client that leaves a fatal error.
    let quiet =
        "rustdds=error,ros2_client=error,ros2_client::node=off,opcua_server::transport=off,opcua_server::session=off";
    let fallback = EnvFilter::try_new(format!("{level},{quiet}"))
        .with_context(|| format!("--log-level {level}: give debug, info, warn or error"))?;
    let filter = EnvFilter::try_from_default_env().unwrap_or(fallback);
    #[cfg(target_os = "linux")]
    let is_wanted = |line: &str| {
        let is_of_leaving = || gateway::is_leaving() && LIBRARIES.iter().any(|library| line.contains(library));
        !line.contains(NO_CERTIFICATES) && !is_of_leaving()
    };
    #[cfg(not(target_os = "linux"))]
    let is_wanted = |_: &str| true;
    let writer = log::Log::new(before, throttled, std::io::stderr, is_wanted);
    let colours = std::io::stderr().is_terminal() && !wants_no_colour();
    let console = tracing_subscriber::fmt::layer().with_writer(writer).with_ansi(colours).log_internal_errors(false);
    let console = (!ros_args.no_console).then_some(console);
    tracing_subscriber::registry().with(filter).with(console).with(rosout::Rosout).init();
    for argument in &ros_args.without_effect {
        tracing::warn!("{argument} has no effect: no other library writes the log; see --log-level and RUST_LOG");
    }
    Ok(())
}
