//! `abbe recover`: every whole message of a cut-off or damaged bag, as a new bag, and what is missing.
//!
//! Place in the flow: the remedy that the bag reader's errors name. The damaged bag stays as it is. Exit code 1
//! when messages are missing, or when nobody knows whether they are.

use crate::next::Next;
use crate::output;
use abbe_msgs::bag::{FileRecovery, recover};
use anyhow::bail;
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
    recovery.files.iter().for_each(tell);
    Next::new("to see that it comes out the same", "replay")
        .file("--bag", &arguments.out)
        .text("--model MODEL.json")
        .print();
    if recovery.is_complete() {
        return Ok(());
    }
    let bag = arguments.bag.display();
    match recovery.messages_missing() {
        Some(missing) => bail!("{bag}: {missing} messages are lost; the rest is in {}", arguments.out.display()),
        None => bail!(
            "{bag}: messages may be lost, and nothing is left that says how many; what is whole is in {}",
            arguments.out.display()
        ),
    }
}

/// What is wrong with a file, and what it cost.
fn tell(file: &FileRecovery) {
    if file.faults.is_empty() && file.is_complete() {
        return;
    }
    let of = |named: Option<u64>| named.map_or_else(String::new, |named| format!(" of {named}"));
    println!(
        "  {}: {}{} messages and {}{} chunks are whole",
        file.path.display(),
        file.messages_saved,
        of(file.messages_named),
        file.chunks_saved,
        of(file.chunks_named)
    );
    for fault in &file.faults {
        println!("    damaged: {fault}");
    }
}
