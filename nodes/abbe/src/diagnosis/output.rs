//! The files of a diagnosis, put in their places together, and its words on the terminal.
//!
//! Place in the flow: last. Until everything is made, the output folder is not touched.

use super::{Product, targets};
use abbe_files::AtomicFile;
use abbe_report::diagnosis::{Averaged, Effect, HELD_ALREADY, Record, is_held_already, readable};
use abbe_report::digits;
use anyhow::{Context, ensure};
use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

/// Refuses a folder that cannot take the files, before any work is done.
pub(crate) fn check(folder: &Path, inputs: &[&Path]) -> anyhow::Result<()> {
    ensure!(!folder.exists() || folder.is_dir(), "--out {}: this is a file; name a folder", folder.display());
    for target in targets(folder) {
        let same = |input: &&&Path| matches!((target.canonicalize(), input.canonicalize()), (Ok(a), Ok(b)) if a == b);
        if let Some(input) = inputs.iter().find(same) {
            anyhow::bail!(
                "--out {}: the diagnosis would overwrite {}, which it starts from; name another folder",
                folder.display(),
                input.display()
            );
        }
    }
    Ok(())
}

/// Candidates set aside that a terminal names: the report has all.
const SET_ASIDE: usize = 3;

/// Writes all files. Each appears whole; the model comes last.
pub(crate) fn write(folder: &Path, product: &Product, json: &str) -> anyhow::Result<()> {
    let html = product.report.html()?;
    std::fs::create_dir_all(folder).with_context(|| format!("{}: the folder cannot be made", folder.display()))?;
    let [report, diagnosis, model] = targets(folder);
    let contents =
        [(report, Some(html.as_bytes())), (diagnosis, Some(json.as_bytes())), (model, product.model.as_deref())];
    let mut files = Vec::new();
    for (path, content) in contents {
        let Some(content) = content else { continue };
        let mut file = AtomicFile::create(&path)?;
        file.write_all(content).with_context(|| format!("{}: cannot be written", path.display()))?;
        files.push(file);
    }
    Ok(files.into_iter().try_for_each(AtomicFile::commit)?)
}

/// The summary for a terminal.
pub(crate) fn words(record: &Record, folder: &Path) -> String {
    let mut text = format!("{}\n\n", digits::taken(&record.verdict));
    let number = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), digits::result);
    let mut line = |name: &str, before: Option<f64>, after: Option<f64>, unit: &str| {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "  {name:<44} {:>9} → {:>9} {unit}", number(before), number(after));
    };
    let (b, a) = (&record.before, &record.after);
    line("error on data left out, rms", b.held_out_rms_um, a.held_out_rms_um, "µm");
    if record.verification.is_some() {
        line("verification error, rms", b.verify_rms_um, a.verify_rms_um, "µm");
        line("verification error, largest", b.verify_max_um, a.verify_max_um, "µm");
    }
    line("residual of the fit, rms", b.residual_rms_um, a.residual_rms_um, "µm");
    // Without declared uncertainties there is none.
    if b.chi2_per_dof.is_some() || a.chi2_per_dof.is_some() {
        line("χ² per degree of freedom", b.chi2_per_dof, a.chi2_per_dof, "");
    }
    if let Some(v) = record.verification.as_ref().filter(|v| v.covariate_missing > 0) {
        let _ = writeln!(text, "  {} of {} verification points lack a covariate", v.covariate_missing, v.points);
    }
    for effect in &record.effects {
        text.push('\n');
        describe(&mut text, effect);
    }
    for candidate in record.set_aside.iter().take(SET_ASIDE) {
        let _ = writeln!(text, "\n  set aside {}: {}", candidate.label(), candidate.because);
    }
    if let Some(more) = record.set_aside.len().checked_sub(SET_ASIDE).filter(|more| *more > 0) {
        let _ = writeln!(text, "\n  {more} more set aside (see the report)");
    }
    for words in &record.held_out.not_judged {
        let _ = writeln!(text, "  not judged         {words}");
    }
    if !record.not_identifiable.is_empty() || !record.untestable.is_empty() {
        let (hidden, untestable) = (record.not_identifiable.len(), record.untestable.len());
        let _ = writeln!(text, "\n  not identifiable   {hidden}; untestable {untestable} (see the report)");
    }
    for next in record.next_measurements.iter().take(3) {
        let _ = writeln!(text, "  next               {next}");
    }
    let _ = write!(text, "\n{}", folder.join(super::REPORT).display());
    text
}

fn describe(text: &mut String, effect: &Effect) {
    let share = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.2}"));
    let p = match effect.p_value {
        None => "-".to_owned(),
        Some(p) if p < f64::MIN_POSITIVE => "below 1e-300".to_owned(),
        Some(p) => format!("{p:.1e}"),
    };
    let alias = share(effect.alias_share);
    let _ = writeln!(text, "  {} [{}]: p {p}, share absorbed by the model {alias}", effect.label(), effect.kind);
    for parameter in effect.parameters.iter().chain(effect.amplitude().as_ref()) {
        if is_held_already(parameter) {
            let _ = writeln!(text, "    {:<18} {HELD_ALREADY}", parameter.name);
            continue;
        }
        let (value, u, plausible, unit, decimals) = readable(parameter);
        let shown = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.*}", usize::from(decimals)));
        let limit = match plausible {
            Some(limit) if !parameter.is_plausible => format!("  NOT plausible: beyond {limit:.0} {unit}"),
            _ => String::new(),
        };
        let _ = writeln!(text, "    {:<18} {} ± {} {unit}{limit}", parameter.name, shown(value), shown(u));
    }
    for words in &effect.predicts.not_judged {
        let _ = writeln!(text, "    {words}");
    }
    if let Some(rivals) = effect.rivals() {
        let _ = writeln!(text, "    cannot be told from {rivals}");
    }
    if !effect.averaged_with.is_empty() {
        let others: Vec<String> = effect.averaged_with.iter().map(Averaged::label).collect();
        let _ = writeln!(text, "    corrected coordinates are the mean with {}", others.join(", "));
    }
}
