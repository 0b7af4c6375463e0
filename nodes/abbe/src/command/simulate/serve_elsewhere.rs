//! `abbe simulate --serve` in a program for another system than Linux: refused with words.
//!
//! Place in the flow: in place of the simulated machine on sockets.

use abbe_virtual_machine::SimulationConfig;
use anyhow::bail;

/// How the machine is served on Linux.
#[derive(Debug, clap::Args)]
pub(super) struct Serving {
    /// Serve the machine to clients; on Linux alone
    #[arg(long, conflicts_with = "trials")]
    serve: Option<String>,
}

impl Serving {
    pub(super) fn is_wanted(&self) -> bool {
        self.serve.is_some()
    }
}

pub(super) fn run(_: &SimulationConfig, _: [(f64, f64); 3], _: &Serving) -> anyhow::Result<()> {
    bail!(
        "--serve: the simulated machine is served on Linux, where its clients run; leave it out, and name a folder with --out"
    )
}
