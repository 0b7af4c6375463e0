//! `abbe recover`: what can be read of a cut-off or damaged bag, as a new bag.
//!
//! Place in the flow: the remedy that the bag reader's errors name. The damaged bag stays as it is.

use crate::output;
use abbe_msgs::bag::recover;
use std::path::PathBuf;

/// Arguments of `recover`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Damaged bag
    #[arg(long)]
    bag: PathBuf,
    /// Bag to write
    #[arg(long)]
    out: PathBuf,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    output::check([arguments.out.as_path()], [arguments.bag.as_path()])?;
    let recovery = recover(&arguments.bag, &arguments.out)?;
    println!("{}: {} messages saved", arguments.out.display(), recovery.messages_saved);
    for fault in &recovery.faults {
        println!("  lost: {fault}");
    }
    Ok(())
}
