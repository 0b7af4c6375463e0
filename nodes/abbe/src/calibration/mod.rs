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
use abbe_files::AtomicFile;
use abbe_measurement::claim::Claim;
use abbe_report::Report;
use anyhow::{Context, ensure};
use serde_json::{Value, json};
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
    /// Files that these data do not bear: one that is there from before would pass for theirs.
    pub(crate) withheld: Vec<&'static str>,
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
    for name in &product.withheld {
        let path = folder.join(name);
        ensure!(
            !path.exists(),
            "{}: is of other data, and these give none; remove it, or name another folder with --out",
            path.display()
        );
    }
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

/// Factor on an uncertainty from which it is told.
const TOLD: f64 = 1.05;

/// What widened the uncertainties, or that nothing checks a declared one; `None` where there is nothing to tell.
fn of_claim(claim: &Claim) -> Option<String> {
    let Claim { is_declared, degrees, widening } = *claim;
    let freedom = if degrees == 1 { "1 degree of freedom".to_owned() } else { format!("{degrees} degrees of freedom") };
    match (is_declared, degrees) {
        (true, 0) => {
            Some("nothing checks the declared uncertainty: there are no more figures than unknowns".to_owned())
        }
        _ if widening < TOLD => None,
        (true, _) => Some(format!(
            "uncertainties are {widening:.2} times what the declared noise alone would give: as much as the residuals, of {freedom}, \
             cannot exclude"
        )),
        (false, _) => Some(format!(
            "uncertainties are {widening:.2} times what the scatter alone would give: it is known from {freedom} only (Student)"
        )),
    }
}

/// The same as lines for a terminal.
fn claim_words(claim: Option<&Claim>) -> String {
    claim.and_then(of_claim).map_or_else(String::new, |text| format!("  {:<17} {text}\n", "note"))
}

/// The same for files.
fn claim_json(claim: Option<&Claim>) -> Value {
    claim.map_or(Value::Null, |claim| {
        json!({
            "noise": if claim.is_declared { "declared" } else { "scatter" },
            "degrees_of_freedom": claim.degrees,
            "widened_by": claim.widening,
            "says": of_claim(claim),
        })
    })
}
