//! The six errors of an axis from targets on its table: words, JSON, CSV and report.
//!
//! Place in the flow: file of readings or points → `abbe_measurement::guideway` → [`Product`]. Error = actual − indicated;
//! µm and µrad, uncertainties k = 2.

use super::arrangement::BySpread;
use super::{COVERAGE, Product, claim_json, claim_words, of_claim};
use crate::provenance::made_from;
use crate::verdict::{self, Accept};
use abbe_files::{GuidewayRow, SeenTarget, StudyFile, hex, read_guideway_file};
use abbe_identify::verdict::{Counted, Verdict};
use abbe_measurement::guideway::{
    Guideway, GuidewayFrame, GuidewayOptions, GuidewayRotation, PositionErrors, StrayTarget, TargetPoint,
};
use abbe_measurement::tracker::TrackerUncertainty;
use abbe_report::{
    Axis, Callout, Cell, Column, Curve, CurveStyle, Identity, KeyFigure, KeyFigures, LinePanel, LinePlot, Quantity,
    Report, Section, TableSection, Tone, digits,
};
use anyhow::{Context, bail};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::Path;

/// Names of the files beside the report.
const ERRORS: &str = "errors.csv";
const FIGURES: &str = "guideway.json";
/// Decimals of a position in millimetres.
const POSITION_DECIMALS: u8 = 1;
/// Extent of the targets across their longest direction, relative to that along it, below which the report warns.
const NARROW: f64 = 0.2;

/// Solves and describes.
pub(crate) fn product(
    path: &Path,
    options: GuidewayOptions,
    tracker: Option<TrackerUncertainty>,
    accept: Accept,
) -> anyhow::Result<Product> {
    let file = read_guideway_file(path)?;
    let readings = file.rows.iter().filter(|row| matches!(row.seen, SeenTarget::Reading(_))).count();
    if tracker.is_some() && readings == 0 {
        bail!("{}: the file holds points; give their uncertainty in a column u_um, not by options", path.display());
    }
    let points: Vec<TargetPoint> = file.rows.iter().map(|row| target(row, tracker)).collect();
    let (solved, strays) = Guideway::without_strays(&points, options).with_context(|| path.display().to_string())?;
    let by_spread = BySpread::of(&solved, &points);
    let rejected: Vec<Rejected> = strays.iter().map(|stray| Rejected::new(stray, &file)).collect();
    let mut json = json(&solved, &file.sha256);
    json["rejected"] = rejected.iter().map(Rejected::json).collect();
    let counted = Counted { what: "readings", rejected: rejected.len(), all: points.len() };
    let verdict = verdict::of_fit(solved.chi2_per_dof.map(|chi2| (chi2, solved.claim.degrees)), Some(counted));
    verdict::check(&verdict, accept, &path.display().to_string(), || json.clone())?;
    json["findings"] = verdict::json(&verdict.findings);
    json["uncertainty_by_spread_of_targets"] = by_spread.as_ref().map_or(Value::Null, BySpread::json);
    let mut text = serde_json::to_string_pretty(&json)?;
    text.push('\n');
    Ok(Product {
        words: words(&solved) + &verdict::words(&verdict.findings) + &told(&solved, &rejected),
        files: vec![(ERRORS, csv(&solved)), (FIGURES, text)],
        withheld: Vec::new(),
        report: Some(report((&solved, &verdict, &rejected), by_spread.as_ref(), path, &file.sha256)),
        json,
    })
}

fn target(row: &GuidewayRow, tracker: Option<TrackerUncertainty>) -> TargetPoint {
    let (point_m, covariance_m2) = match row.seen {
        SeenTarget::Reading(reading) => (reading.point_m(), tracker.map(|tracker| tracker.covariance_m2(&reading))),
        SeenTarget::Point { point_m, u_m } => (point_m.into(), u_m.map(|u| abbe_geometry::Matrix3::identity() * u * u)),
    };
    TargetPoint { position_m: row.position_m, target: row.target.clone(), point_m, covariance_m2 }
}

/// A reading that was left out.
struct Rejected {
    line: u64,
    target: String,
    position_mm: f64,
    off_um: f64,
    /// It is the reference of its target, which is therefore not used at all.
    everywhere: bool,
}

impl Rejected {
    fn new(stray: &StrayTarget, file: &StudyFile<GuidewayRow>) -> Rejected {
        let row = &file.rows[stray.point];
        Rejected {
            line: file.lines[stray.point],
            target: row.target.clone(),
            position_mm: row.position_m * 1e3,
            off_um: stray.off_m * 1e6,
            everywhere: stray.everywhere,
        }
    }

    fn words(&self) -> String {
        let Rejected { line, target, position_mm, off_um, everywhere } = self;
        let everywhere = if *everywhere { "; all positions refer to it, so that its target is not used" } else { "" };
        format!(
            "line {line}: target {target} at {position_mm} mm is {} µm off where the others put it{everywhere}",
            digits::result(*off_um)
        )
    }

    fn json(&self) -> Value {
        json!({
            "line": self.line, "target": self.target, "position_mm": self.position_mm, "off_um": self.off_um,
            "target_not_used": self.everywhere,
        })
    }
}

/// What was left out and what widened the uncertainties, for a terminal.
fn told(solved: &Guideway, rejected: &[Rejected]) -> String {
    let rejected = rejected.iter().map(|one| format!("  {:<17} {}\n", "rejected", one.words()));
    let wider = solved.positions.iter().filter_map(|position| wider(solved, position));
    let wider = wider.map(|text| format!("  {:<17} {text}\n", "WARNING"));
    rejected.chain([claim_words(Some(&solved.claim))]).chain(wider).collect()
}

/// A position whose targets contradict each other more than those of the others.
fn wider(solved: &Guideway, position: &PositionErrors) -> Option<String> {
    /// Rounding.
    const MORE: f64 = 1.001;
    let widening = position.widening.filter(|widening| *widening > MORE * solved.claim.widening)?;
    Some(format!(
        "at {} mm the targets contradict each other (residual {} µm), and nothing tells which is wrong: uncertainties there are \
         {widening:.2} times as large; measure that position again, with more targets",
        position.position_m * 1e3,
        digits::result(position.residual_rms_m * 1e6)
    ))
}

/// Errors in µm and µrad.
fn shown(position: &PositionErrors) -> [f64; 6] {
    std::array::from_fn(|k| position.errors[k] * 1e6)
}

/// Their expanded uncertainties; none at the lowest position.
fn expanded(position: &PositionErrors) -> Option<[f64; 6]> {
    Guideway::u(position).map(|u| u.map(|u| COVERAGE * u * 1e6))
}

/// The unit in the name of a column and of a key.
fn unit(k: usize) -> &'static str {
    if k < 3 { "um" } else { "urad" }
}

fn csv(solved: &Guideway) -> String {
    let names = solved.options.axis.error_names();
    let columns =
        |prefix: &str| (0..6).map(|k| format!("{prefix}{}_{}", names[k], unit(k))).collect::<Vec<_>>().join(",");
    let mut text = format!("position_mm,{},{},targets,residual_rms_um\n", columns(""), columns("u_"));
    for position in &solved.positions {
        let errors = shown(position).map(|e| format!("{e:.4}")).join(",");
        let u = expanded(position).map_or_else(|| ",".repeat(5), |u| u.map(|u| format!("{u:.4}")).join(","));
        let (mm, rms) = (position.position_m * 1e3, position.residual_rms_m * 1e6);
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{mm},{errors},{u},{},{rms:.4}", position.targets);
    }
    text
}

fn words(solved: &Guideway) -> String {
    let names = solved.options.axis.error_names();
    let mut text =
        format!("{} positions, largest errors and their largest uncertainty (k = 2)\n", solved.positions.len());
    for (k, name) in names.iter().enumerate() {
        let error =
            solved.positions.iter().map(|p| shown(p)[k]).fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
        let u = solved.positions.iter().filter_map(expanded).map(|u| u[k]).fold(0.0, f64::max);
        let [error, u] = digits::with_uncertainty(error, u);
        let unit = if k < 3 { "µm" } else { "µrad" };
        let _ = writeln!(text, "  {name}  {error:>10} ± {u} {unit}");
    }
    let _ = writeln!(
        text,
        "  residual of a rigid table {} µm, spread of the targets {:.2} (across over along their longest direction)",
        digits::result(solved.scatter_m * 1e6),
        solved.spread_ratio
    );
    if let Some(chi2) = solved.chi2_per_dof {
        let _ = writeln!(text, "  χ² per degree of freedom {chi2:.2} with the declared uncertainties");
    }
    text
}

fn json(solved: &Guideway, sha256: &[u8; 32]) -> Value {
    let names = solved.options.axis.error_names();
    let position = |position: &PositionErrors| {
        let errors = shown(position);
        let u = expanded(position);
        let named = |values: [f64; 6]| -> Value {
            (0..6)
                .map(|k| (format!("{}_{}", names[k], unit(k)), json!(values[k])))
                .collect::<serde_json::Map<_, _>>()
                .into()
        };
        json!({
            "position_mm": position.position_m * 1e3,
            "errors": named(errors),
            "expanded_uncertainty": u.map(named),
            "covariance_si": position.covariance.map(|c| (0..6).map(|i| (0..6).map(|j| c[(i, j)]).collect()).collect::<Vec<Vec<f64>>>()),
            "widened_by": position.widening,
            "targets": position.targets,
            "residual_rms_um": position.residual_rms_m * 1e6,
        })
    };
    json!({
        "sign_convention": "error = actual - indicated; angles right-handed; relative to the lowest position",
        "coverage_factor": COVERAGE,
        "frame": match solved.options.frame { GuidewayFrame::Given => "given", GuidewayFrame::AlongMotion => "along_motion" },
        "rotation": match solved.options.rotation { GuidewayRotation::SmallAngle => "small_angle", GuidewayRotation::Exact => "exact" },
        "reference_mm": (solved.reference_m * 1e3).as_slice(),
        "machine_from_points": (0..3).map(|i| (0..3).map(|j| solved.machine_from_points[(i, j)]).collect()).collect::<Vec<Vec<f64>>>(),
        "spread_ratio": solved.spread_ratio,
        "scatter_um": solved.scatter_m * 1e6,
        "chi2_per_dof": solved.chi2_per_dof,
        "uncertainty_from": claim_json(Some(&solved.claim)),
        "positions": solved.positions.iter().map(position).collect::<Vec<_>>(),
        "data_sha256": hex(sha256),
        "software": crate::pipeline::software(),
    })
}

fn report(
    (solved, verdict, rejected): (&Guideway, &Verdict, &[Rejected]),
    by_spread: Option<&BySpread>,
    path: &Path,
    sha256: &[u8; 32],
) -> Report {
    let names = solved.options.axis.error_names();
    let x: Vec<f64> = solved.positions.iter().map(|p| p.position_m * 1e3).collect();
    let panel = |k: usize| LinePanel {
        title: names[k].clone(),
        x: Axis::new("position", "mm"),
        y: Axis::new(names[k].clone(), if k < 3 { "µm" } else { "µrad" }),
        curves: vec![Curve {
            name: "error".to_owned(),
            style: CurveStyle::Line(1),
            x: x.clone(),
            y: solved.positions.iter().map(|p| Some(shown(p)[k])).collect(),
            also: None,
            half_width: Some(solved.positions.iter().map(|p| expanded(p).map(|u| u[k])).collect()),
        }],
    };
    let figure = |label: &str, value: Quantity, unit: &str| KeyFigure {
        label: label.to_owned(),
        value: Some(value),
        unit: unit.to_owned(),
        ..KeyFigure::default()
    };
    let largest = |k: usize| {
        let by_size = |a: &&PositionErrors, b: &&PositionErrors| shown(a)[k].abs().total_cmp(&shown(b)[k].abs());
        let worst = solved.positions.iter().max_by(by_size);
        let u = worst.and_then(expanded).map(|u| u[k]);
        KeyFigure {
            label: format!("{}, largest", names[k]),
            value: worst.map(|position| Quantity::with(shown(position)[k], u)),
            unit: if k < 3 { "µm" } else { "µrad" }.to_owned(),
            detail: worst.map(|position| {
                let u = u.map(|u| format!("± {} (k = 2), ", digits::uncertainty(u)));
                format!("{}at {:.0} mm", u.unwrap_or_default(), position.position_m * 1e3)
            }),
            ..KeyFigure::default()
        }
    };
    let of_data = [
        figure("residual of a rigid table", Quantity::result(solved.scatter_m * 1e6), "µm"),
        figure(
            "spread of the targets, across over along their longest direction",
            Quantity::result(solved.spread_ratio),
            "",
        ),
        figure("positions", Quantity::new(solved.positions.len() as f64, 0), ""),
    ];
    let mut sections = vec![Section::KeyFigures(KeyFigures {
        title: "At a glance".to_owned(),
        figures: (0..6).map(largest).chain(of_data).collect(),
    })];
    sections.extend(warnings(solved, verdict, rejected));
    let main_plot = sections.len();
    sections.extend([
        Section::LinePlot(LinePlot {
            title: "Errors by position".to_owned(),
            note: Some(
                "Actual less indicated, against the lowest position, where every error is zero by definition. Displacements are \
                 those of the reference point."
                    .to_owned(),
            ),
            columns: 3,
            band_name: Some("uncertainty, k = 2".to_owned()),
            panels: (0..6).map(panel).collect(),
        }),
    ]);
    sections.push(table(solved));
    sections.extend(by_spread.map(|by_spread| Section::LinePlot(by_spread.plot())));
    Report {
        title: format!("Errors of the {:?} axis", solved.options.axis),
        lead: Some("Six errors of a linear axis from targets on its table (ISO 230-1 names).".to_owned()),
        identity: Identity::default(),
        next: None,
        meta: made_from(path, sha256),
        main_plot: Some(main_plot),
        footer: Some(crate::pipeline::software()),
        sections,
    }
}

/// The errors with their uncertainties, by position: what a compensation is made of.
fn table(solved: &Guideway) -> Section {
    let names = solved.options.axis.error_names();
    let row = |position: &PositionErrors| {
        let (errors, u) = (shown(position), expanded(position));
        let first = Cell::number(position.position_m * 1e3, POSITION_DECIMALS);
        let cells = (0..6).flat_map(|k| {
            let u = u.map(|u| u[k]);
            // Zero by definition where there is no uncertainty.
            let error = if u.is_some() { Cell::with(Some(errors[k]), u) } else { Cell::text("0") };
            [error, u.map_or_else(|| Cell::text(""), |u| Cell::uncertainty(Some(u)))]
        });
        std::iter::once(first).chain(cells).collect()
    };
    let mut columns = vec![Column::number("position", "mm")];
    for (k, name) in names.iter().enumerate() {
        let unit = if k < 3 { "µm" } else { "µrad" };
        columns.extend([Column::number(name.clone(), unit), Column::number("± U", unit)]);
    }
    Section::Table(TableSection {
        title: "Errors and their uncertainty by position".to_owned(),
        note: Some("U with k = 2; at the lowest position all errors are zero by definition.".to_owned()),
        columns,
        rows: solved.positions.iter().map(row).collect(),
        total_rows: None,
    })
}

/// How grave a sentence is.
fn weight(section: &Section) -> u8 {
    match section {
        Section::Callout(callout) => match callout.tone {
            Tone::Bad => 2,
            Tone::Warning => 1,
            Tone::Neutral | Tone::Good => 0,
        },
        _ => 0,
    }
}

fn warnings(solved: &Guideway, verdict: &Verdict, rejected: &[Rejected]) -> Vec<Section> {
    let graded = |tone, title: &str, text: &str| {
        Section::Callout(Callout { tone, title: title.to_owned(), text: text.to_owned() })
    };
    let callout = |title: &str, text: &str| graded(Tone::Warning, title, text);
    let note = |title: &str, text: &str| graded(Tone::Neutral, title, text);
    let mut list = Vec::new();
    if solved.spread_ratio < NARROW {
        list.push(callout(
            "Targets nearly on a line",
            "The rotation about that line is far less certain than the others; put a target further aside.",
        ));
    }
    if solved.options.frame == GuidewayFrame::AlongMotion {
        list.push(note(
            "Frame along the motion",
            "Slopes of straightness are zero by construction, and about the axis the frame of the points is taken as it stands.",
        ));
    }
    list.extend(rejected.iter().map(|one| note("Left out", &one.words())));
    list.extend(of_claim(&solved.claim).map(|text| note("What the uncertainty rests on", &text)));
    list.extend(
        solved.positions.iter().filter_map(|position| wider(solved, position)).map(|text| callout("A position", &text)),
    );
    list.extend(verdict::callouts(&verdict.findings));
    // What is graded highest stands first, so that it is on the first screen.
    list.sort_by_key(|section| std::cmp::Reverse(weight(section)));
    list
}
