//! Pose of a laser probe and its compensation table: words, JSON, CSV and report.
//!
//! Place in the flow: centres file → `abbe_measurement::probe_pose` → [`Product`]. Every calibration is judged on poses and
//! centres left out of it; a table that helps none of them is withheld. mm and µm, uncertainties k = 2.

use super::{COVERAGE, Product, claim_json, claim_words, of_claim};
use crate::provenance::made_from;
use crate::verdict::{self, Accept, Objection};
use abbe_files::{hex, read_sphere_centres_file};
use abbe_geometry::Vector3;
use abbe_identify::verdict::{Grade, Verdict};
use abbe_measurement::probe_pose::{
    Compensation, CompensationTable, LeftOutCentre, LeftOutPose, ProbePose, ProbePoseModel, SphereCentre, ToldOffset,
    leave_one_centre_out, leave_one_pose_out, near_poses,
};
use abbe_report::{
    Axis, Callout, Cell, Column, Curve, CurveStyle, Identity, KeyFigure, KeyFigures, LinePanel, LinePlot, Quantity,
    Report, Section, State, TableSection, Tone, digits,
};
use anyhow::Context;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::Path;

/// Names of the files beside the report.
const TABLE: &str = "compensation.csv";
const FIGURES: &str = "probe_pose.json";
/// Names of the unknowns in the order of the covariance, and what makes a unit of SI one of the file.
const UNKNOWNS: [(&str, &str, f64); 10] = [
    ("S0 x", "mm", 1e3),
    ("S0 y", "mm", 1e3),
    ("S0 z", "mm", 1e3),
    ("R_p x", "1", 1.0),
    ("R_p y", "1", 1.0),
    ("R_p z", "1", 1.0),
    ("T_p x", "mm", 1e3),
    ("T_p y", "mm", 1e3),
    ("T_p z", "mm", 1e3),
    ("axis offset y", "mm", 1e3),
];

/// The same in words.
const WORDS: [&str; 10] = [
    "centre of the sphere, x",
    "centre of the sphere, y",
    "centre of the sphere, z",
    "direction of the beam, x",
    "direction of the beam, y",
    "direction of the beam, z",
    "zero of the beam, x",
    "zero of the beam, y",
    "zero of the beam, z",
    "offset between the axes, y",
];
/// What a table is good for.
const WORTH: &str = "It holds for its own poses. Between them it is interpolated by inverse squared angle of turn, which the \
                     poses left out judge; outside them there is none.";
/// Decimals of an angle in degrees at most.
const ANGLE_DECIMALS: u8 = 3;
/// Angles this close are one (degrees).
const SAME_DEG: f64 = 5e-4;

/// A calibration with everything that judges it.
struct Judged {
    centres: Vec<SphereCentre>,
    pose: ProbePose,
    table: CompensationTable,
    /// `None` where no pose can be spared.
    poses: Option<Vec<LeftOutPose>>,
    again: Vec<Option<LeftOutCentre>>,
}

/// Calibrates, judges and describes.
pub(crate) fn product(path: &Path, model: ProbePoseModel, accept: Accept) -> anyhow::Result<Product> {
    let file = read_sphere_centres_file(path)?;
    let name = || path.display().to_string();
    let pose = ProbePose::fit(&file.rows, model).with_context(name)?;
    let table = CompensationTable::new(&pose, &file.rows);
    let again = leave_one_centre_out(&file.rows, model).with_context(name)?;
    let poses = leave_one_pose_out(&file.rows, model).ok();
    tell_near(&name(), &file.rows);
    let told = pose.untold_offset(&file.rows);
    let objection = told.as_ref().map(|told| objection(told, &pose));
    let pose = match &told {
        Some(told) => pose.widened_to(&told.with),
        None => pose,
    };
    let judged = Judged { centres: file.rows, pose, table, poses, again };
    let harm = judged.harm();
    let mut json = judged.json(&file.sha256);
    if let Some(objection) = &objection {
        objection.check(accept, &name(), || json.clone())?;
    }
    let verdict = verdict::of_fit(judged.within(), None);
    verdict::check(&verdict, accept, &name(), || json.clone())?;
    json["findings"] = verdict::with_objection(objection.as_ref(), &verdict.findings);
    if let Some(harm) = &harm {
        eprintln!("abbe: warning: {}: {harm}; no {TABLE} is written", name());
    }
    let mut text = serde_json::to_string_pretty(&json)?;
    text.push('\n');
    Ok(Product {
        words: judged.words()
            + &objection.as_ref().map_or_else(String::new, Objection::words)
            + &verdict::words(&verdict.findings)
            + &claim_words(judged.pose.claim.as_ref()),
        report: Some(judged.report(path, &file.sha256, (objection.as_ref(), &verdict))),
        files: harm.is_none().then(|| (TABLE, judged.csv())).into_iter().chain([(FIGURES, text)]).collect(),
        withheld: harm.map(|_| TABLE).into_iter().collect(),
        json,
    })
}

/// The offset that was not fitted, and what it explains.
fn objection(told: &ToldOffset, pose: &ProbePose) -> Objection {
    let [offset, u] = digits::with_uncertainty(told.offset_m * 1e3, COVERAGE * told.u_m * 1e3);
    let um = |m: f64| digits::result(m * 1e6);
    let explained = match (pose.scatter.between_m, told.with.scatter.between_m) {
        (Some(before), Some(after)) => {
            format!("what a pose adds in common falls from {} to {} µm with it", um(before), um(after))
        }
        _ => format!("the residual falls from {} to {} µm rms with it", um(pose.rms_m()), um(told.with.rms_m())),
    };
    let moved_um = (told.with.zero_m - pose.zero_m).norm() * 1e6;
    Objection {
        grade: if told.is_certain { Grade::Refusal } else { Grade::Warning },
        finding: format!(
            "the A axis lies {offset} ± {u} mm (k = 2) off the C axis along y, which was not fitted: {explained}, and T_p moves by {} µm",
            digits::result(moved_um)
        ),
        causes: vec!["fit it by --axis-offset; uncertainties without it are widened by what it moves".to_owned()],
    }
}

/// Says on standard error which poses nearly coincide: taken as one or as two, their scatter says different things.
fn tell_near(name: &str, centres: &[SphereCentre]) {
    let near = near_poses(centres);
    let Some([first, second]) = near.first() else { return };
    let place = |k: usize| {
        let [a, c] = [centres[k].a_rad, centres[k].c_rad].map(|angle| digits::plain(angle.to_degrees(), 4));
        format!("centre {} (A {a}, C {c})", k + 1)
    };
    eprintln!(
        "abbe: warning: {name}: {} pairs of poses are less than 0.1 degrees apart and count as different ones, first {} and {}; where one pose \
         was meant, its angles were not met to 0.01 degrees, and U of repeated centres is too small",
        near.len(),
        place(*first),
        place(*second)
    );
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0);
    values.for_each(|value| {
        sum += value;
        count += 1;
    });
    (count > 0).then(|| sum / f64::from(count))
}

fn um(vector_m: &Vector3<f64>) -> f64 {
    vector_m.norm() * 1e6
}

impl Judged {
    fn values(&self) -> Vec<f64> {
        let pose = &self.pose;
        let three = [&pose.centre_m, &pose.direction, &pose.zero_m];
        let nine = three.iter().flat_map(|v| v.iter().copied());
        nine.chain(pose.axis_offset_m).zip(UNKNOWNS).map(|(value, (_, _, scale))| value * scale).collect()
    }

    fn expanded(&self) -> Option<Vec<f64>> {
        let u = self.pose.u()?;
        Some(u.iter().zip(UNKNOWNS).map(|(u, (_, _, scale))| COVERAGE * u * scale).collect())
    }

    /// χ² per degree of freedom within poses, and its degrees. What a pose adds in common is the head's, not the noise: the table is
    /// for it.
    fn within(&self) -> Option<(f64, usize)> {
        self.pose.scatter.chi2_per_dof_within
    }

    /// Means over what was left out (µm): in a pose that the table has, before and after; in a pose that it has not.
    fn again_um(&self) -> Option<(f64, f64)> {
        let known = || self.again.iter().flatten();
        Some((mean(known().map(|c| um(&c.error_m)))?, mean(known().map(|c| um(&c.compensated_m)))?))
    }

    /// Why the table is not to be added to anything: a mean of noise makes points worse by as much as it scatters.
    fn harm(&self) -> Option<String> {
        let remedy = "work without a table, or measure more centres in each pose";
        let (before, after) = self.again_um()?;
        if after >= before {
            let [before, after] = [before, after].map(digits::result);
            return Some(format!(
                "the table corrects nothing: centres left out are {before} µm off in the mean without it, and {after} µm with it; {remedy}"
            ));
        }
        let within_m = self.pose.scatter.within_m.filter(|_| self.pose.scatter.between_m == Some(0.0))?;
        let within = digits::result(within_m * 1e6);
        Some(format!(
            "the table corrects nothing: poses differ by no more than the scatter within them ({within} µm) makes them; {remedy}"
        ))
    }

    fn elsewhere_um(&self) -> Option<f64> {
        mean(self.poses.iter().flatten().filter_map(|pose| Some(um(&pose.error_m?))))
    }

    fn interpolated_um(&self) -> Option<(f64, f64)> {
        let known =
            || self.poses.iter().flatten().filter_map(|pose| Some((um(&pose.error_m?), um(&pose.compensated_m?))));
        Some((mean(known().map(|k| k.0))?, mean(known().map(|k| k.1))?))
    }

    fn csv(&self) -> String {
        let mut text = "a_deg,c_deg,delta_x_mm,delta_y_mm,delta_z_mm,centres,spread_um\n".to_owned();
        for entry in &self.table.entries {
            let delta = entry.delta_m * 1e3;
            let spread = entry.spread_m.map_or_else(String::new, |s| format!("{:.3}", s * 1e6));
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "{:.7},{:.7},{:.6},{:.6},{:.6},{},{spread}",
                entry.a_rad.to_degrees(),
                entry.c_rad.to_degrees(),
                delta.x,
                delta.y,
                delta.z,
                entry.centres
            );
        }
        text
    }

    fn words(&self) -> String {
        let mut text = format!("{} centres in {} poses\n", self.centres.len(), self.table.entries.len());
        let expanded = self.expanded();
        for (k, value) in self.values().iter().enumerate() {
            let (name, unit, _) = UNKNOWNS[k];
            let digits = decimals(expanded.as_ref().map(|u| u[k]));
            let u = expanded.as_ref().map_or_else(|| "unknown".to_owned(), |u| format!("{:.digits$}", u[k]));
            let _ = writeln!(text, "  {name:<14} {value:14.digits$} ± {u} {unit}");
        }
        let (length, condition) = (self.scale_words(), self.pose.condition);
        let _ =
            writeln!(text, "  length of R_p  {length:>14} (scale of the distance reading), condition {condition:.0}");
        let line = |text: &mut String, what: &str, value: Option<String>| {
            let value = value.unwrap_or_else(|| "cannot be told from these centres".to_owned());
            let _ = writeln!(text, "  {what:<52} {value}");
        };
        let scatter = &self.pose.scatter;
        let micrometres = |m: Option<f64>| m.map(|m| format!("{} µm", digits::result(m * 1e6)));
        line(&mut text, "scatter of a coordinate within a pose", micrometres(scatter.within_m));
        line(&mut text, "what a pose adds in common (the model lacks it)", micrometres(scatter.between_m));
        let arrow =
            |pair: Option<(f64, f64)>| pair.map(|(b, a)| format!("{} → {} µm", digits::result(b), digits::result(a)));
        line(&mut text, "mean error, centre left out, table for its pose", arrow(self.again_um()));
        line(
            &mut text,
            "mean error, pose left out, no table",
            self.elsewhere_um().map(|e| format!("{} µm", digits::result(e))),
        );
        line(&mut text, "mean error, pose left out, interpolated table", arrow(self.interpolated_um()));
        text
    }

    /// Length of the beam's vector, which is the scale of the distance reading, with its uncertainty (k = 2) where that is known.
    fn scale_words(&self) -> String {
        let length = self.pose.direction.norm();
        match self.pose.u_beam_length().filter(|u| *u > 0.0) {
            Some(u) => {
                let [length, u] = digits::with_uncertainty(length, COVERAGE * u);
                format!("{length} ± {u}")
            }
            None => format!("{length:.6}"),
        }
    }

    fn json(&self, sha256: &[u8; 32]) -> Value {
        let expanded = self.expanded();
        let unknown = |(k, value): (usize, &f64)| {
            let (name, unit, _) = UNKNOWNS[k];
            json!({ "name": name, "value": value, "unit": unit, "expanded_uncertainty": expanded.as_ref().map(|u| u[k]) })
        };
        let vector = |v: &Vector3<f64>| json!((v * 1e6).as_slice());
        let pose = |pose: &LeftOutPose| {
            let word = match pose.compensation {
                Some(Compensation::Tabulated { .. }) => "tabulated",
                Some(Compensation::Interpolated { .. }) => "interpolated",
                Some(Compensation::Outside) => "outside",
                None => "undetermined",
            };
            json!({
                "a_deg": pose.a_rad.to_degrees(), "c_deg": pose.c_rad.to_degrees(),
                "error_um": pose.error_m.as_ref().map(vector),
                "compensated_um": pose.compensated_m.as_ref().map(vector),
                "table": word,
            })
        };
        let entry = |entry: &abbe_measurement::probe_pose::TableEntry| {
            json!({
                "a_deg": entry.a_rad.to_degrees(), "c_deg": entry.c_rad.to_degrees(),
                "delta_um": vector(&entry.delta_m), "centres": entry.centres, "spread_um": entry.spread_m.map(|s| s * 1e6),
            })
        };
        let covariance = self.pose.covariance.as_ref();
        let harm = self.harm();
        let given = self.table.entries.iter().filter(|_| harm.is_none());
        json!({
            "equation": "S0 = S1 + R_C (o + R_A (d R_p + T_p)); o = (0, axis offset, 0); compensation is added to a probed point",
            "unknowns": self.values().iter().enumerate().map(unknown).collect::<Vec<_>>(),
            "coverage_factor": COVERAGE,
            "covariance_si": covariance.map(|c| c.row_iter().map(|r| r.iter().copied().collect()).collect::<Vec<Vec<f64>>>()),
            "beam_length": self.pose.direction.norm(),
            "condition": self.pose.condition,
            "degrees_of_freedom": self.pose.degrees_of_freedom,
            "poses_that_nearly_coincide": near_poses(&self.centres).len(),
            "scatter_within_um": self.pose.scatter.within_m.map(|s| s * 1e6),
            "scatter_between_um": self.pose.scatter.between_m.map(|s| s * 1e6),
            "chi2_per_dof": self.pose.scatter.chi2_per_dof,
            "chi2_per_dof_within_poses": self.within().map(|(chi2, _)| chi2),
            "degrees_of_freedom_within_poses": self.within().map(|(_, degrees)| degrees),
            "uncertainty_from": claim_json(self.pose.claim.as_ref()),
            "residuals_um": self.pose.residuals_m.iter().map(vector).collect::<Vec<_>>(),
            "table": given.map(entry).collect::<Vec<_>>(),
            "table_withheld": harm,
            "poses_left_out": self.poses.as_ref().map(|poses| poses.iter().map(pose).collect::<Vec<_>>()),
            "centres_left_out": self.again.iter().map(|c| c.as_ref().map(|c| json!({
                "error_um": vector(&c.error_m), "compensated_um": vector(&c.compensated_m),
            }))).collect::<Vec<_>>(),
            "data_sha256": hex(sha256),
            "software": crate::pipeline::software(),
        })
    }

    fn report(&self, path: &Path, sha256: &[u8; 32], (objection, verdict): (Option<&Objection>, &Verdict)) -> Report {
        let mut sections = vec![self.key_figures()];
        sections.extend(objection.map(Objection::callout));
        sections.extend(verdict::callouts(&verdict.findings));
        sections.push(self.worth());
        let claim = self.pose.claim.as_ref().and_then(of_claim);
        sections.extend(claim.map(|text| note("What the uncertainty rests on", text)));
        // The pose is what was asked for.
        sections.extend([self.unknown_table(), self.picture(), self.compensation_section(), self.left_out_section()]);
        Report {
            title: "Pose of the laser probe".to_owned(),
            lead: Some(format!(
                "{} sphere centres in {} poses of a fork head.",
                self.centres.len(),
                self.table.entries.len()
            )),
            identity: Identity::default(),
            next: None,
            meta: made_from(path, sha256),
            main_plot: None,
            footer: Some(crate::pipeline::software()),
            sections,
        }
    }

    /// What the table is good for, or why there is none.
    fn worth(&self) -> Section {
        self.harm().map_or_else(
            || note("What the table is worth", WORTH.to_owned()),
            |harm| {
                let text = format!("{harm}.");
                Section::Callout(Callout { tone: Tone::Warning, title: "No table is given".to_owned(), text })
            },
        )
    }

    fn key_figures(&self) -> Section {
        let figure = |label: &str, before: Option<f64>, value: Option<f64>, detail: &str| KeyFigure {
            label: label.to_owned(),
            before: before.map(Quantity::result),
            value: value.map(Quantity::result),
            unit: "µm".to_owned(),
            detail: Some(detail.to_owned()),
            ..KeyFigure::default()
        };
        let again = self.again_um();
        Section::KeyFigures(KeyFigures {
            title: "At a glance".to_owned(),
            figures: vec![
                figure("residual of the fit, rms", None, Some(self.pose.rms_m() * 1e6), "length of the vectors"),
                figure(
                    "error in a pose of the table, mean",
                    again.map(|a| a.0),
                    again.map(|a| a.1),
                    "without and with the table: centres left out, their pose's other centres kept",
                ),
                figure(
                    "error in any other pose, mean",
                    None,
                    self.elsewhere_um(),
                    "of poses left out, without a table",
                ),
            ],
        })
    }

    /// The error of each pose that the others predict, without the table and with it.
    fn picture(&self) -> Section {
        let poses: Vec<&LeftOutPose> = self.poses.iter().flatten().collect();
        let curve = |name: &str, state: State, of: fn(&LeftOutPose) -> Option<f64>| Curve {
            name: name.to_owned(),
            style: CurveStyle::PointsOf(state),
            x: (1..=poses.len()).map(|k| k as f64).collect(),
            y: poses.iter().map(|pose| of(pose)).collect(),
            also: None,
            half_width: None,
        };
        let curves = [
            curve("without a table", State::Before, |pose| pose.error_m.as_ref().map(um)),
            curve("with the others' table", State::After, |pose| pose.compensated_m.as_ref().map(um)),
        ];
        let outside = poses.iter().filter(|pose| pose.compensated_m.is_none()).count();
        let outside = match outside {
            0 => String::new(),
            _ => format!(" {outside} of {} poses lie outside of the others, where there is no table.", poses.len()),
        };
        Section::LinePlot(LinePlot {
            title: "Error of each pose left out".to_owned(),
            note: Some(format!("Length of the error; without and with a table side by side at each pose.{outside}")),
            columns: 1,
            band_name: None,
            panels: vec![LinePanel {
                title: String::new(),
                x: Axis::new("pose, by its number in the table below", "1"),
                y: Axis::new("error", "µm"),
                curves: curves.into_iter().filter(|curve| curve.y.iter().any(Option::is_some)).collect(),
            }],
        })
    }

    fn unknown_table(&self) -> Section {
        let expanded = self.expanded();
        let row = |(k, value): (usize, &f64)| {
            let (name, unit, _) = UNKNOWNS[k];
            let u = expanded.as_ref().map(|u| u[k]);
            let shown = |value: f64| digits::plain(value, decimals(u) as u8);
            let unit = if unit == "1" { "" } else { unit };
            let u = u.map_or_else(|| "not known".to_owned(), |u| format!("± {} {unit}", shown(u)));
            vec![Cell::text(WORDS[k]), Cell::text(format!("{} {unit}", shown(*value))), Cell::text(u), Cell::text(name)]
        };
        let columns = ["unknown", "value", "U (k = 2)", "symbol"].map(Column::text).to_vec();
        Section::Table(TableSection {
            title: "Unknowns".to_owned(),
            note: Some("Uncertainty from the scatter within and between the poses.".to_owned()),
            columns,
            rows: self.values().iter().enumerate().map(row).chain([self.scale_row()]).collect(),
            total_rows: None,
        })
    }

    /// What a millimetre of the distance reading is.
    fn scale_row(&self) -> Vec<Option<Cell>> {
        let words = self.scale_words();
        let (length, u) = words.split_once(" ± ").map_or((words.as_str(), None), |(length, u)| (length, Some(u)));
        let u = u.map_or_else(|| "held, or not known".to_owned(), |u| format!("± {u}"));
        vec![Cell::text("scale of the distance"), Cell::text(length), Cell::text(u), Cell::text("length of R_p")]
    }

    fn compensation_section(&self) -> Section {
        let angle = self.angle_decimals();
        let row = |entry: &abbe_measurement::probe_pose::TableEntry| {
            let (delta, spread_um) = (entry.delta_m * 1e6, entry.spread_m.map(|s| s * 1e6));
            vec![
                Cell::number(entry.a_rad.to_degrees(), angle),
                Cell::number(entry.c_rad.to_degrees(), angle),
                Cell::with(Some(delta.x), spread_um),
                Cell::with(Some(delta.y), spread_um),
                Cell::with(Some(delta.z), spread_um),
                Cell::uncertainty(spread_um),
            ]
        };
        let columns = vec![
            Column::number("A", "°"),
            Column::number("C", "°"),
            Column::number("x", "µm"),
            Column::number("y", "µm"),
            Column::number("z", "µm"),
            Column::number("spread", "µm"),
        ];
        let (title, what) = match self.harm() {
            None => ("Compensation by pose", "To be added to a point probed in that pose"),
            Some(_) => ("What was found by pose", "Scatter, and NOT to be added to anything"),
        };
        Section::Table(TableSection {
            title: title.to_owned(),
            note: Some(format!(
                "{what} (S0 less where the pose puts the sphere); as many digits as the spread of its centres allows."
            )),
            columns,
            rows: self.table.entries.iter().map(row).collect(),
            total_rows: None,
        })
    }

    /// Decimals of angles in degrees: none where all of them are whole.
    fn angle_decimals(&self) -> u8 {
        let angles = || self.table.entries.iter().flat_map(|entry| [entry.a_rad, entry.c_rad]).map(f64::to_degrees);
        let tells = |decimals: u8| {
            let unit = 10f64.powi(i32::from(decimals));
            angles().all(|angle| ((angle * unit).round() / unit - angle).abs() < SAME_DEG)
        };
        (0..ANGLE_DECIMALS).find(|decimals| tells(*decimals)).unwrap_or(ANGLE_DECIMALS)
    }

    fn left_out_section(&self) -> Section {
        let angle = self.angle_decimals();
        let row = |(k, pose): (usize, &LeftOutPose)| {
            let word = match pose.compensation {
                Some(Compensation::Interpolated { .. }) => "interpolated",
                Some(Compensation::Outside) => "none: outside the other poses",
                Some(Compensation::Tabulated { .. }) => "in the table",
                None => "none: the others do not determine the pose",
            };
            let with_table = match &pose.compensated_m {
                Some(error_m) => format!("{} µm, {word}", digits::result(um(error_m))),
                None => word.to_owned(),
            };
            vec![
                Cell::count(k + 1),
                Cell::number(pose.a_rad.to_degrees(), angle),
                Cell::number(pose.c_rad.to_degrees(), angle),
                Cell::result(pose.error_m.as_ref().map(um)),
                Cell::text(with_table),
            ]
        };
        let columns = vec![
            Column::number("pose", "1"),
            Column::number("A", "°"),
            Column::number("C", "°"),
            Column::number("error without a table", "µm"),
            Column::text("with the others' table"),
        ];
        Section::Table(TableSection {
            title: "Each pose predicted by the others".to_owned(),
            note: None,
            columns,
            rows: self.poses.iter().flatten().enumerate().map(row).collect(),
            total_rows: None,
        })
    }
}

/// Decimals of an unknown; six where its uncertainty is not known.
fn decimals(uncertainty: Option<f64>) -> usize {
    usize::from(uncertainty.map_or(6, digits::of_uncertainty))
}

fn note(title: &str, text: String) -> Section {
    Section::Callout(Callout { tone: Tone::Neutral, title: title.to_owned(), text })
}
