//! The page of `abbe identify`: how well the model fits, what speaks against it, errors, stations and what was rejected.
//!
//! Place in the flow: last step; the figures are those of `abbe demo`, without what belongs to verification and live nodes.

use super::Arguments;
use crate::fitted::Fitted;
use crate::identity::{self, Said};
use crate::pipeline::{Identification, LoadedCampaign};
use crate::provenance::{self, file_name};
use crate::verdict;
use abbe_files::{MachineFile, ModelFile, hex};
use abbe_report::{DemoReport, FileEntry, RunHeader};

/// The page's data; the hash of the model comes with [`with_hash`], once the file is there.
pub(super) fn report(
    arguments: &Arguments,
    machine: &MachineFile,
    loaded: &LoadedCampaign,
    (file, found): (&ModelFile, &Identification),
) -> anyhow::Result<DemoReport> {
    let said = Said {
        machine: Some(machine),
        days: loaded.days,
        temperature_c: identity::temperature_c(&loaded.campaign),
        ..Said::default()
    };
    let entry = |role: &str, name: String| FileEntry { role: role.to_owned(), name };
    let about = provenance::of_campaign(&loaded.campaign, machine.instrument);
    Ok(DemoReport {
        header: RunHeader {
            title: format!("Identified model of {}", machine.machine.name),
            what: "Errors, stations and dead paths, all from the ranges of one campaign. How well the model corrects is told by \
                   points that this fit has not seen."
                .to_owned(),
            identity: arguments.identity.gather(&said)?.shown,
            next: Some(super::next(arguments, found).step()),
            about: about.iter().map(|(what, words)| entry(what, words.to_string())).collect(),
            files: vec![entry("campaign", file_name(&arguments.campaign)), entry("model", file_name(&arguments.out))],
            data_hash: Some(loaded.source.sha256.clone()),
            model_hash: None,
            software_version: file.software.clone(),
        },
        is_fit_alone: true,
        remarks: found.verdict.findings.iter().map(verdict::remark).collect(),
        ..Fitted { loaded, model: file, found }.report()
    })
}

/// The page of a model that was written.
pub(super) fn with_hash(mut page: DemoReport, sha256: &[u8; 32]) -> DemoReport {
    page.header.model_hash = Some(hex(sha256));
    page
}
