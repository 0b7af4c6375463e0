//! `abbe launch`: all nodes of a launch file, until their sources end or Ctrl-C.
//!
//! Place in the flow: live use. Prints what each node did.

use crate::service_manager::ServiceManager;
use abbe_graph::launch::Instead;
use abbe_graph::supervisor::{Given, Supervisor};
use abbe_runtime::ros::RosArgs;
use abbe_runtime::{RunId, Shutdown, end_with_reader};
use anyhow::{Context, bail, ensure};
use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;

/// Time for the last samples to pass through the graph once the sources have ended.
const SETTLE: Duration = Duration::from_millis(500);

/// Arguments of `launch`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Launch file (launch-config/*.toml)
    file: PathBuf,
    /// Name of the run, so that other programs of this host can join its shared memory
    #[arg(long)]
    run: Option<String>,
    #[command(flatten)]
    instead: InsteadArguments,
}

/// Files in place of those of a launch file.
#[derive(Debug, Clone, clap::Args)]
pub(super) struct InsteadArguments {
    /// Machine file, instead of that of the launch file
    #[arg(long)]
    machine: Option<PathBuf>,
    /// Model file, instead of that of the launch file
    #[arg(long)]
    model: Option<PathBuf>,
    /// Residual model file, instead of that of the launch file
    #[arg(long)]
    residual: Option<PathBuf>,
}

impl InsteadArguments {
    /// The files; relative paths are relative to the working directory, as on every command line.
    pub(super) fn files(&self) -> anyhow::Result<Instead> {
        let absolute = |file: &Option<PathBuf>| file.as_deref().map(std::path::absolute).transpose();
        let (machine, model) = (absolute(&self.machine)?, absolute(&self.model)?);
        Ok(Instead { machine, model, residual_model: absolute(&self.residual)? })
    }
}

pub(crate) fn run(arguments: &Arguments, ros_args: RosArgs) -> anyhow::Result<()> {
    if let Some(renamed) = ros_args.node_names.iter().find(|renamed| renamed.node.is_none()) {
        let to = &renamed.to;
        bail!(
            "-r __node:={to} would give every node of the launch the same name (a launch file of ROS 2 says it as name=); leave it out, \
             or rename one node, as -r scale:__node:={to}"
        );
    }
    let instead = arguments.instead.files()?;
    if let Some((option, file)) = instead.missing() {
        bail!("{option} {}: there is no such file", file.display());
    }
    let shutdown = Shutdown::on_signals()?;
    let program = std::env::current_exe().context("the path of this program is unknown")?;
    let run = arguments.run.as_deref().map(str::parse::<RunId>).transpose()?.unwrap_or_else(RunId::unique);
    // Not `eprintln!`: the nodes run whether or not somebody reads this.
    let _ = writeln!(std::io::stderr(), "run {run}: Ctrl-C stops all nodes", run = run.as_str());
    let mut supervisor =
        Supervisor::start_with(&program, &arguments.file, run, Given { instead, ros_words: ros_args.words })?;
    let mut manager = ServiceManager::from_environment();
    let ran = supervisor.wait_for_sources(&shutdown, |graph| manager.tell(graph.is_healthy()));
    if ran.is_ok() && !shutdown.requested() {
        shutdown.sleep(SETTLE);
    }
    manager.stopping();
    let stopped = supervisor.stop(&shutdown)?;
    end_with_reader()?;
    for summary in &stopped.summaries {
        println!("{}", serde_json::to_string(summary)?);
    }
    ran?;
    ensure!(stopped.problems.is_empty(), "the graph did not run well: {}", stopped.problems.join("; "));
    Ok(())
}
