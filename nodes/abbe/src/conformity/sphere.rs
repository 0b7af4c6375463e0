//! Probing errors after ISO 10360-5 from points on a sphere.
//!
//! Place in the flow: `abbe conformity --sphere`. Names of both editions stand side by side.

use super::{
    Figure, Limits, Product, data_words, departure_callout, departure_json, departure_words, expanded_um, tone, um,
    verdict_in_words, verdict_word, worst,
};
use crate::pipeline::software;
use crate::provenance::made_from;
use abbe_conformity::probing::{FORM_NAMES, ProbingErrors, SIZE_NAMES, evaluate};
use abbe_conformity::{DecisionRule, PermissibleError, Verdict};
use abbe_files::{hex, read_probed_points_file};
use abbe_report::{
    Axis, Callout, Curve, CurveStyle, Identity, KeyFigure, KeyFigures, LinePanel, LinePlot, Quantity, Report, Section,
    Tone, digits,
};
use anyhow::Context;
use serde_json::json;
use std::fmt::Write as _;
use std::path::Path;

const STANDARD: &str = "ISO 10360-5";

/// Figures of probed points.
pub(crate) fn run(
    path: &Path,
    diameter_m: Option<f64>,
    limits: &Limits,
    rule: &DecisionRule,
) -> anyhow::Result<Product> {
    let file = read_probed_points_file(path)?;
    let errors = evaluate(&file.points_m, diameter_m).with_context(|| path.display().to_string())?;
    let (form, size) = errors.verdicts(limits.form, limits.size, rule);
    let rows = [
        Row {
            what: "Form error",
            names: FORM_NAMES,
            value_m: Some(errors.form.metres()),
            limit: limits.form,
            verdict: form,
        },
        Row {
            what: "Size error",
            names: SIZE_NAMES,
            value_m: errors.size.map(|s| s.metres()),
            limit: limits.size,
            verdict: size,
        },
    ];
    // That of the verdicts: at the diameter, not at a length of zero.
    let u_um = expanded_um(rule, errors.length_m());
    let json = json!({
        "standard": STANDARD, "points": file.points_m.len(), "data_sha256": hex(&file.sha256), "software": software(),
        "centre_mm": errors.sphere.centre_m.iter().map(|v| v * 1e3).collect::<Vec<_>>(),
        "diameter_mm": errors.sphere.radius_m * 2e3,
        "calibrated_diameter_mm": diameter_m.map(|d| d * 1e3),
        "form_error_um": um(errors.form.metres()), "form_names": FORM_NAMES,
        "expanded_uncertainty_um": u_um,
        "size_error_um": errors.size.map(|s| um(s.metres())), "size_names": SIZE_NAMES,
        "form_limit_um": limits.form.map(|l| um(l.metres())), "form": form.map(verdict_word),
        "size_limit_um": limits.size.map(|l| um(l.metres())), "size": size.map(verdict_word),
        "decision_rule": rule.words(),
        "departures": departure_json(&errors.departures),
    });
    Ok(Product {
        words: words(path, &errors, &rows, rule),
        json,
        report: report(path, &file.sha256, &errors, &rows, rule),
        verdict: worst([form, size]),
        outside: None,
        figures: rows.iter().filter_map(|row| row.certified(rule, u_um)).collect(),
        method: (STANDARD, errors.departures.iter().map(ToString::to_string).collect()),
    })
}

/// One error with its limit.
struct Row {
    /// What it is, in words.
    what: &'static str,
    names: [&'static str; 2],
    value_m: Option<f64>,
    limit: Option<PermissibleError>,
    verdict: Option<Verdict>,
}

impl Row {
    /// Share of the limit that the error uses.
    fn share(&self) -> Option<f64> {
        Some(self.value_m?.abs() / self.limit?.metres())
    }

    /// The verdict on its limit.
    fn answer(&self) -> Option<Callout> {
        let (limit, verdict, share) = (self.limit?, self.verdict?, self.share()?);
        let limit_um = format!("{:.3}", um(limit.metres()));
        Some(Callout {
            tone: tone(verdict),
            title: format!("{} against {} µm", self.what, limit_um.trim_end_matches('0').trim_end_matches('.')),
            text: format!("{}; it uses {:.0} % of the limit.", verdict_in_words(verdict), 100.0 * share),
        })
    }

    /// The error as it was observed; nothing where it was not.
    fn figure(&self, u_um: Option<f64>) -> Option<KeyFigure> {
        let stated = u_um.map_or_else(String::new, |u| format!("± {} µm (k = 2); ", digits::uncertainty(u)));
        let used = self.share().map_or_else(String::new, |share| format!("{:.0} % of the limit; ", 100.0 * share));
        Some(KeyFigure {
            label: format!("{}, observed", self.what),
            value: Some(Quantity::with(um(self.value_m?), u_um)),
            unit: "µm".to_owned(),
            detail: Some(format!("{stated}{used}{}, {} in the edition of 2010", self.names[0], self.names[1])),
            tone: self.verdict.map_or_else(Tone::default, tone),
            ..KeyFigure::default()
        })
    }

    fn certified(&self, rule: &DecisionRule, u_um: Option<f64>) -> Option<Figure> {
        Some(Figure {
            name: self.names[0].to_owned(),
            value_m: self.value_m?,
            expanded_m: u_um.map(|u_um| u_um * 1e-6),
            limit_m: self.limit.map(|limit| limit.metres()),
            verdict: self.verdict.map(|verdict| (verdict, *rule)),
        })
    }
}

fn words(path: &Path, errors: &ProbingErrors, rows: &[Row], rule: &DecisionRule) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    for row in rows {
        let value = row.value_m.map_or_else(|| "-".to_owned(), |v| format!("{} µm", digits::result(um(v))));
        let _ = write!(text, "  {} ({})  {value}", row.names[0], row.names[1]);
        if let (Some(limit), Some(verdict)) = (row.limit, row.verdict) {
            let _ = write!(text, ", limit {:.3} µm: {}", um(limit.metres()), verdict_in_words(verdict));
        }
        text.push('\n');
    }
    let _ = writeln!(text, "  diameter of the least-squares sphere {:.6} mm", errors.sphere.radius_m * 2e3);
    if rows.iter().any(|row| row.verdict.is_some()) {
        let _ = writeln!(text, "  {}", rule.words());
    }
    text.push_str(&departure_words(STANDARD, &errors.departures));
    text.push_str(&data_words(path));
    text
}

fn report(path: &Path, sha256: &[u8; 32], errors: &ProbingErrors, rows: &[Row], rule: &DecisionRule) -> Report {
    let u_um = expanded_um(rule, errors.length_m());
    let mut answers: Vec<Callout> = rows.iter().filter_map(Row::answer).collect();
    // Once for all limits: it is the same.
    if let Some(last) = answers.last_mut() {
        last.text.push_str(&format!(" Decision rule: {}.", rule.words()));
    }
    let mut sections: Vec<Section> = answers.into_iter().map(Section::Callout).collect();
    let figures = rows.iter().filter_map(|row| row.figure(u_um)).collect();
    sections.push(Section::KeyFigures(KeyFigures { title: "Observed".to_owned(), figures }));
    sections.push(departure_callout(STANDARD, &errors.departures));
    let residuals = &errors.sphere.residuals_m;
    let curve = Curve {
        name: "points".to_owned(),
        style: CurveStyle::Points(1),
        x: (1..=residuals.len()).map(|k| k as f64).collect(),
        y: residuals.iter().map(|r| Some(um(*r))).collect(),
        also: None,
        half_width: None,
    };
    sections.push(Section::LinePlot(LinePlot {
        title: "Distance of each point from the least-squares sphere".to_owned(),
        note: Some("Outside is positive; the form error is the range.".to_owned()),
        columns: 1,
        band_name: None,
        panels: vec![LinePanel {
            title: String::new(),
            x: Axis::new("point", "1"),
            y: Axis::new("distance from the sphere", "µm"),
            curves: vec![curve],
        }],
    }));
    Report {
        title: "Probing error".to_owned(),
        lead: Some(format!(
            "{} points on a sphere; diameter of the least-squares sphere {:.6} mm.",
            residuals.len(),
            errors.sphere.radius_m * 2e3
        )),
        identity: Identity::default(),
        next: None,
        meta: made_from(path, sha256),
        main_plot: None,
        footer: Some(software()),
        sections,
    }
}
