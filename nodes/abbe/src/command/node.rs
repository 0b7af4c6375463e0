//! `abbe node`: one node of a graph, as a process.
//!
//! Place in the flow: started by the launcher or by hand; its last line on standard output is its summary as JSON.

use super::launch::InsteadArguments;
use abbe_graph::launch::NodeName;
use abbe_graph::node::{AsTold, NodeCall, run as run_node};
use abbe_runtime::ros::RosArgs;
use abbe_runtime::{RunId, end_with_reader};
use std::path::PathBuf;

/// Arguments of `node`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// scale, tracer, geometric, residual, monitor or recorder
    name: String,
    /// Launch file that describes the graph
    #[arg(long)]
    launch: PathBuf,
    /// Run whose shared memory the node joins
    #[arg(long)]
    run: Option<String>,
    /// Process that started the node: when it ends, the node ends
    #[arg(long)]
    launcher_pid: Option<u32>,
    /// How often the launcher has started the node before
    #[arg(long, default_value_t = 0, hide = true)]
    life: u32,
    /// State that a manager took the node to before its process ended
    #[arg(long, hide = true)]
    stays: Option<String>,
    /// Parameters that were set before its process ended, as JSON
    #[arg(long, hide = true)]
    changed: Option<String>,
    #[command(flatten)]
    instead: InsteadArguments,
}

pub(crate) fn run(arguments: Arguments, ros_args: RosArgs) -> anyhow::Result<()> {
    let name: NodeName = arguments.name.parse()?;
    let run = arguments.run.map(|run| run.parse::<RunId>()).transpose()?;
    let instead = arguments.instead.files()?;
    let as_told =
        AsTold::parse(arguments.stays.as_deref(), arguments.changed.as_deref()).map_err(anyhow::Error::msg)?;
    let Arguments { launch: launch_file, launcher_pid, life, .. } = arguments;
    let call = NodeCall { name, launch_file, instead, run, ros_args, launcher_pid, life, as_told };
    let summary = run_node(call)?;
    end_with_reader()?;
    println!("{}", serde_json::to_string(&summary)?);
    Ok(())
}
