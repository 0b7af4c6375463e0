//! `abbe gateway`: the process between a node and DDS.
//!
//! Place in the flow: started by a node with an edge over DDS, never by hand; everything it needs to know comes over the
//! socket that it gets as standard input. Its arguments only tell who looks at the list of processes whose it is.

use abbe_runtime::end_on_signals;
use abbe_runtime::gateway::serve;

/// Arguments of `gateway`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// The node that started it
    #[arg(long)]
    of: Option<String>,
    /// Run whose shared memory it joins
    #[arg(long)]
    run: Option<String>,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    tracing::debug!(of = arguments.of, run = arguments.run, "started");
    end_on_signals()?;
    Ok(serve()?)
}
