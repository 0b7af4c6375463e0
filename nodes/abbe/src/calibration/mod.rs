//! Calibrations that need no model: sphere, pose of a laser probe, errors of one axis.
//!
//! Place in the flow: `abbe sphere`, `abbe probe-pose` and `abbe guideway` make a [`Product`]: words for the terminal, JSON,
//! and files for a folder.

mod arrangement;
pub(crate) mod guideway;
pub(crate) mod probe_pose;
pub(crate) mod sphere;

use crate::identity::{IdentityOptions, Said};
use crate::next::Next;
use crate::output;
use abbe_files::{AtomicFile, hex};
use abbe_report::{MetaItem, Report};
use anyhow::{Context, ensure};
use serde_json::Value;
use std::io::Write;
use std::path::Path;

/// Name of the page in the output folder.
const REPORT: &str = "report.html";
/// Coverage factor of uncertainties in files and reports.
pub(crate) const COVERAGE: f64 = 2.0;

/// What a calibration gives.
pub(crate) struct Product {
    /// Summary for a terminal.
    pub(crate) words: String,
    /// All figures.
    pub(crate) json: Value,
    /// The page, where there is one.
    pub(crate) report: Option<Report>,
    /// Further files by name.
    pub(crate) files: Vec<(&'static str, String)>,
}

/// What follows from a calibration, in report and words.
pub(crate) fn lead_on(product: &mut Product, next: &Next) {
    product.words.push_str(&next.words());
    if let Some(report) = &mut product.report {
        report.next = Some(next.step());
    }
}

impl Product {
    /// Puts who measured, when and with what into the report.
    pub(crate) fn identify(&mut self, options: &IdentityOptions, data: &Path) -> anyhow::Result<()> {
        if let Some(report) = &mut self.report {
            report.identity = options.gather(&Said { tables: &[data], ..Said::default() })?.shown;
        }
        Ok(())
    }
}

/// Refuses a folder that cannot take the files.
pub(crate) fn check_folder(folder: &Path) -> anyhow::Result<()> {
    ensure!(!folder.exists() || folder.is_dir(), "--out {}: this is a file; name a folder", folder.display());
    Ok(())
}

/// Prints, and writes the folder where one is named. `input` is what the product was made of.
pub(crate) fn finish(product: &Product, folder: Option<&Path>, input: &Path, as_json: bool) -> anyhow::Result<()> {
    if let Some(folder) = folder {
        write(folder, product, input)?;
    }
    match as_json {
        true => println!("{}", serde_json::to_string_pretty(&product.json)?),
        false => print!("{}", product.words),
    }
    Ok(())
}

/// Each file appears whole.
fn write(folder: &Path, product: &Product, input: &Path) -> anyhow::Result<()> {
    check_folder(folder)?;
    let mut contents = product.files.clone();
    if let Some(report) = &product.report {
        contents.push((REPORT, report.html()?));
    }
    let names: Vec<&str> = contents.iter().map(|(name, _)| *name).collect();
    output::check_in_folder(folder, &names, [input])?;
    std::fs::create_dir_all(folder).with_context(|| format!("{}: the folder cannot be made", folder.display()))?;
    let mut files = Vec::new();
    for (name, content) in contents {
        let path = folder.join(name);
        let mut file = AtomicFile::create(&path)?;
        file.write_all(content.as_bytes()).with_context(|| format!("{}: cannot be written", path.display()))?;
        files.push(file);
    }
    Ok(files.into_iter().try_for_each(AtomicFile::commit)?)
}

/// Lines of a report's head for its data.
fn meta(path: &Path, sha256: &[u8; 32]) -> Vec<MetaItem> {
    let item = |label: &str, value: String| MetaItem { label: label.to_owned(), value: Some(value) };
    let name = path.file_name().map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned());
    vec![item("data", name), item("data sha256", hex(sha256)), item("software", crate::pipeline::software())]
}
