//! The campaign that ships with the program.
//!
//! Place in the flow: the demo's input where the user gives none. Compressed in the program itself, so that the
//! demo runs from anywhere; unpacked into the output folder, so that the user can look at it.

use abbe_files::write_atomically;
use anyhow::Context;
use std::path::{Path, PathBuf};

const MACHINE: &[u8] = include_bytes!("../../../../launch-config/machines/bridge_xyz.toml");
const CAMPAIGN: &[u8] = include_bytes!("../../../../launch-config/demo/campaign.csv.zst");
const VERIFY: &[u8] = include_bytes!("../../../../launch-config/demo/verify.csv.zst");

/// Files the demo works on.
pub(super) struct Inputs {
    pub(super) machine: PathBuf,
    pub(super) campaign: PathBuf,
    pub(super) verify: PathBuf,
}

/// The user's files, or the shipped ones unpacked into `out`.
pub(super) fn inputs(
    machine: Option<&Path>,
    campaign: Option<&Path>,
    verify: Option<&Path>,
    out: &Path,
) -> anyhow::Result<Inputs> {
    if let (Some(machine), Some(campaign), Some(verify)) = (machine, campaign, verify) {
        let absolute =
            |path: &Path| std::path::absolute(path).with_context(|| format!("{}: no such path", path.display()));
        return Ok(Inputs { machine: absolute(machine)?, campaign: absolute(campaign)?, verify: absolute(verify)? });
    }
    let inputs = Inputs {
        machine: out.join("bridge_xyz.toml"),
        campaign: out.join("campaign.csv"),
        verify: out.join("verify.csv"),
    };
    write_atomically(&inputs.machine, MACHINE)?;
    write_atomically(&inputs.campaign, &unpack(CAMPAIGN)?)?;
    write_atomically(&inputs.verify, &unpack(VERIFY)?)?;
    Ok(inputs)
}

fn unpack(packed: &[u8]) -> anyhow::Result<Vec<u8>> {
    zstd::decode_all(packed).context("the shipped campaign cannot be unpacked")
}
