//! The subcommands, one file each.
//!
//! Place in the flow: parsed in `main`, dispatched here; each file holds its arguments and its work.

#[cfg(target_os = "linux")]
mod capture;
mod completions;
mod conformity;
#[cfg(target_os = "linux")]
mod convert;
pub(crate) mod correct;
mod diagnose;
mod export;
mod fit_points;
#[cfg(not(target_os = "linux"))]
pub(crate) mod for_linux;
#[cfg(target_os = "linux")]
mod gateway;
mod guideway;
mod identify;
mod interpolate;
#[cfg(target_os = "linux")]
mod launch;
mod man;
#[cfg(target_os = "linux")]
mod node;
mod papers;
mod plan;
mod points;
mod predict;
mod probe_pose;
#[cfg(target_os = "linux")]
mod proxy;
mod recover;
mod replay;
mod residuals;
pub(crate) mod simulate;
mod sphere;
pub mod training;
mod verify;
mod volumetric;

pub(crate) use identify::progress_text;

use crate::stop;
use abbe_files::{Unfinished, put_in_place};
use abbe_runtime::end_with_reader;
use abbe_runtime::ros::RosArgs;
use anyhow::{Context, ensure};
use clap::Subcommand;
#[cfg(not(target_os = "linux"))]
use for_linux::{self as capture, self as convert, self as gateway, self as launch, self as node, self as proxy};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// What to do.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Plan a tracer campaign: stations, lines, and the uncertainty that they will reach
    Plan(plan::Arguments),
    /// Identify a machine from a tracer campaign
    Identify(identify::Arguments),
    /// Identify a machine from measured 3-D positions
    FitPoints(fit_points::Arguments),
    /// Correct recorded coordinates with a model
    Correct(correct::Arguments),
    /// Find what a model lacks, add it, and judge the gain
    Diagnose(diagnose::Arguments),
    /// Compute what a model leaves unexplained at measured points, to train on
    Residuals(residuals::Arguments),
    /// Train a residual model on residual vectors
    Train(training::TrainArguments),
    /// Judge the residual network and its rivals on the same held-out data
    Compare(training::CompareArguments),
    /// Predict the residual at any points with a residual model
    Predict(predict::Arguments),
    /// Fit a sphere to measured points
    Sphere(sphere::Arguments),
    /// Calibrate the pose of a laser probe on a five-axis machine
    ProbePose(probe_pose::Arguments),
    /// Six errors of a linear axis from targets on its table
    Guideway(guideway::Arguments),
    /// Figures of ISO 10360-2, -5 and ISO 230-2, -6, and what limits they support
    Conformity(conformity::Arguments),
    /// A model as error tables for controllers and other software
    Export(export::Arguments),
    /// Hold a model against points whose actual position is known
    Verify(verify::Arguments),
    /// Map of a model's volumetric error, and its body diagonals with uncertainty
    Volumetric(volumetric::Arguments),
    /// Solve points measured from several stations, without a model of the machine
    Points(points::Arguments),
    /// Interpolate measured error vectors, or score the methods that do
    Interpolate(interpolate::Arguments),
    /// The whole chain on a recorded campaign: identify, correct live, close the loop, report
    Demo(crate::demo::Arguments),
    /// Run a graph of nodes from a launch file
    Launch(launch::Arguments),
    /// Run one node (started by `launch`, or by hand)
    Node(node::Arguments),
    /// Stand between measuring software and a machine's I++ DME server, and correct what passes
    Proxy(proxy::Arguments),
    /// Stand between a node and DDS (started by the node)
    #[command(hide = true)]
    Gateway(gateway::Arguments),
    /// Replay a recorded run and compare it byte for byte
    Replay(replay::Arguments),
    /// Save what can be read of a cut-off or damaged bag
    Recover(recover::Arguments),
    /// Capture a planned campaign from the drivers of a machine and a tracer
    Capture(capture::Arguments),
    /// Make a campaign with the virtual machine
    Simulate(simulate::Arguments),
    /// Turn a campaign into a bag
    Convert(convert::Arguments),
    /// Compute the published figures of the source papers again
    Papers(papers::Arguments),
    /// What makes a shell complete commands and options
    Completions(completions::Arguments),
    /// Manual pages of all commands
    Man(man::Arguments),
}

impl Command {
    /// Whether it goes on until it is told to stop: a part of a graph, or what runs one, the proxy, a capture, or
    /// a machine that is served.
    pub(crate) fn is_live(&self) -> bool {
        let is_of_graph =
            matches!(self, Command::Demo(_) | Command::Launch(_) | Command::Node(_) | Command::Gateway(_));
        let is_served = matches!(self, Command::Simulate(arguments) if arguments.is_served());
        is_of_graph || is_served || matches!(self, Command::Proxy(_) | Command::Capture(_))
    }
}

/// Makes a bag with `write`, which gets a path beside the target; it is moved into place when it is whole and on the
/// disk, so that no half bag is left.
fn bag_in_place<T>(target: &Path, write: impl FnOnce(&Path) -> anyhow::Result<T>) -> anyhow::Result<T> {
    ensure!(!target.exists(), "{}: exists already; name a new bag", target.display());
    let folder = target.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let name = target.file_name().with_context(|| format!("{}: name a file or folder", target.display()))?;
    let workshop = tempfile::Builder::new()
        .prefix(".abbe-")
        .tempdir_in(folder)
        .with_context(|| format!("{}: cannot be written to", folder.display()))?;
    let _unfinished = Unfinished::new(workshop.path());
    let unfinished = workshop.path().join(name);
    let outcome = write(&unfinished)?;
    put_in_place(&unfinished, target)?;
    Ok(outcome)
}

/// Runs a subcommand.
pub(crate) fn run(command: Command, ros_args: RosArgs) -> anyhow::Result<()> {
    // `abbe … | head` ends in silence. A graph goes on without a reader; its commands ask for this when it has ended.
    if !command.is_live() {
        end_with_reader()?;
    }
    let shutdown = match &command {
        command if command.is_live() => None,
        Command::Train(_) | Command::Compare(_) => None, // another program keeps what it has
        Command::Plan(_) => None,                        // keeps the best plan so far
        Command::Diagnose(_) => None,                    // keeps what a study has found so far
        Command::Papers(_) => Some(stop::keep_what_there_is(&Arc::new(AtomicBool::new(true)))?),
        Command::Interpolate(arguments) if arguments.is_scored() => {
            Some(stop::keep_what_there_is(&Arc::new(AtomicBool::new(true)))?)
        }
        _ => Some(stop::end_soon()?),
    };
    dispatch(command, ros_args).map_err(|error| match &shutdown {
        Some(shutdown) => stop::told_as_stopped(error, shutdown),
        None => error,
    })
}

fn dispatch(command: Command, ros_args: RosArgs) -> anyhow::Result<()> {
    // The level of the log holds for every command.
    let is_of_nodes = RosArgs { log_level: None, words: Vec::new(), ..ros_args.clone() } != RosArgs::default();
    let takes_them = matches!(command, Command::Launch(_) | Command::Node(_));
    ensure!(takes_them || !is_of_nodes, "only `abbe launch` and `abbe node` take --ros-args other than --log-level");
    match command {
        Command::Plan(arguments) => plan::run(&arguments),
        Command::Identify(arguments) => identify::run(&arguments),
        Command::FitPoints(arguments) => fit_points::run(&arguments),
        Command::Correct(arguments) => correct::run(&arguments),
        Command::Diagnose(arguments) => diagnose::run(&arguments),
        Command::Residuals(arguments) => residuals::run(&arguments),
        Command::Train(_) | Command::Compare(_) => training::hand_over(),
        Command::Predict(arguments) => predict::run(&arguments),
        Command::Sphere(arguments) => sphere::run(&arguments),
        Command::ProbePose(arguments) => probe_pose::run(&arguments),
        Command::Guideway(arguments) => guideway::run(&arguments),
        Command::Conformity(arguments) => conformity::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Verify(arguments) => verify::run(&arguments),
        Command::Volumetric(arguments) => volumetric::run(&arguments),
        Command::Points(arguments) => points::run(&arguments),
        Command::Interpolate(arguments) => interpolate::run(&arguments),
        Command::Demo(arguments) => crate::demo::run(&arguments),
        #[cfg(target_os = "linux")]
        Command::Launch(arguments) => launch::run(&arguments, ros_args),
        #[cfg(target_os = "linux")]
        Command::Node(arguments) => node::run(arguments, ros_args),
        #[cfg(not(target_os = "linux"))]
        Command::Launch(arguments) | Command::Node(arguments) => for_linux::run(&arguments),
        Command::Proxy(arguments) => proxy::run(&arguments),
        Command::Gateway(arguments) => gateway::run(&arguments),
        Command::Replay(arguments) => replay::run(&arguments),
        Command::Recover(arguments) => recover::run(&arguments),
        Command::Capture(arguments) => capture::run(&arguments),
        Command::Simulate(arguments) => simulate::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments),
        Command::Papers(arguments) => papers::run(&arguments),
        Command::Completions(arguments) => completions::run(&arguments),
        Command::Man(arguments) => man::run(&arguments),
    }
}
