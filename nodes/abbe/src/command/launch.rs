//! `abbe launch`: all nodes of a launch file, until their sources end or Ctrl-C.
//!
//! Place in the flow: live use. Prints what each node did.

use crate::service_manager::ServiceManager;
use abbe_graph::launch::{Instead, Launch};
use abbe_graph::supervisor::{Given, Supervisor};
use abbe_runtime::ros::RosArgs;
use abbe_runtime::{RunId, Shutdown, end_with_reader, heeds_interrupt};
use anyhow::{Context, bail, ensure};
use std::collections::BTreeMap;
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
    let instead = arguments.instead.files()?;
    if let Some((option, file)) = instead.missing() {
        bail!("{option} {}: there is no such file", file.display());
    }
    check_names(&Launch::read_with(&arguments.file, &instead)?, &ros_args)?;
    let shutdown = Shutdown::on_signals()?;
    let program = std::env::current_exe().context("the path of this program is unknown")?;
    let run = arguments.run.as_deref().map(str::parse::<RunId>).transpose()?.unwrap_or_else(RunId::unique);
    // Not `eprintln!`: the nodes run whether or not somebody reads this.
    let stops = match heeds_interrupt() {
        true => "Ctrl-C stops all nodes".to_owned(),
        false => format!(
            "SIGINT is ignored, as the shell had it that started this in the background; `kill {}` stops all nodes",
            std::process::id()
        ),
    };
    let _ = writeln!(std::io::stderr(), "run {run}: {stops}", run = run.as_str());
    let mut supervisor = Supervisor::start_with(
        &program,
        &arguments.file,
        run,
        Given { instead, ros_words: ros_args.words, log: None },
    )?;
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

/// Refuses to call two nodes the same: they would answer for each other, and write the same files.
fn check_names(launch: &Launch, ros_args: &RosArgs) -> anyhow::Result<()> {
    let mut called = BTreeMap::new();
    for name in launch.nodes.iter().map(|node| node.name()) {
        let qualified = ros_args.identity(&launch.namespace, name)?.qualified();
        if let Some(other) = called.insert(qualified.clone(), name) {
            bail!(
                "{other} and {name} would both be called {qualified}; give each node of the launch a name of its own, as \
                 -r {name}:__node:=NAME (without a node in front, or as name= of a launch file of ROS 2, it names all of them)"
            );
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn two_nodes_of_one_name_are_refused_and_those_in_namespaces_of_their_own_are_not() {
        let text = include_str!("../../../../launch-config/bridge_xyz_virtual.toml");
        let launch = Launch::parse(text, Path::new("bridge_xyz_virtual.toml")).unwrap();
        let check = |words: &str| {
            let words = ["--ros-args"].into_iter().chain(words.split(' ')).map(str::to_owned);
            check_names(&launch, &RosArgs::split(words).unwrap().0).map_err(|error| error.to_string())
        };
        for (words, called) in [
            ("-r monitor:__node:=watch -r scale:__node:=watch", "/bridge_xyz/watch"),
            ("-r monitor:__node:=scale", "/bridge_xyz/scale"),
            ("-r __node:=axes", "/bridge_xyz/axes"),
        ] {
            let told = check(words).unwrap_err();
            assert!(told.contains(&format!("would both be called {called}")), "{words}: {told}");
        }
        for words in [
            "-r scale:__node:=axes",
            "-r monitor:__node:=scale -r scale:__node:=axes",
            "-r monitor:__node:=scale -r scale:__ns:=/hall -r scale:__node:=axes -r axes:__ns:=/hall",
            "-r __ns:=/hall",
        ] {
            check(words).unwrap();
        }
    }
}
