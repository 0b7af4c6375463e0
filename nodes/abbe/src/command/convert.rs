//! `abbe convert`: a campaign as a rosbag2-readable bag.
//!
//! Place in the flow: the same messages that the scale and tracer node would publish, without running them.

use super::bag_in_place;
use crate::next::Next;
use crate::output;
use abbe_files::read_machine;
use abbe_graph::driver::DriverConfig;
use abbe_graph::record::write_bag;
use anyhow::Context;
use std::path::PathBuf;

/// Arguments of `convert`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Machine file
    #[arg(long)]
    machine: PathBuf,
    /// Campaign CSV
    #[arg(long)]
    campaign: PathBuf,
    /// Bag to write: a folder, or a file ending in .mcap
    #[arg(long)]
    out: PathBuf,
    /// Namespace of the topics; the machine's name by default
    #[arg(long)]
    namespace: Option<String>,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    output::check([arguments.out.as_path()], [arguments.machine.as_path(), arguments.campaign.as_path()])?;
    let machine = read_machine(&arguments.machine)?;
    let file = std::path::absolute(&arguments.campaign).context("the campaign's path cannot be made absolute")?;
    let namespace = arguments.namespace.clone().unwrap_or_else(|| machine.machine.name.clone());
    let base = PathBuf::new();
    let driver = DriverConfig::Campaign { file };
    let summary =
        bag_in_place(&arguments.out, |unfinished| Ok(write_bag(&driver, &base, &machine, &namespace, unfinished)?))?;
    for (topic, messages) in &summary.messages_by_topic {
        println!("{}: {messages} messages on {topic}", arguments.out.display());
    }
    let next = Next::new("to identify the machine from it", "identify").file("--machine", &arguments.machine);
    next.file("--campaign", &arguments.out).text("--out model.json").print();
    Ok(())
}
