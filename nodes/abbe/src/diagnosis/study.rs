//! Diagnosis of data that need no model: positioning runs, sphere centres, residual vectors.
//!
//! Place in the flow: the header of the file says which kind it is; the study of that kind gives report and JSON, and where the
//! machine is named the model of what was found.

use super::study_model;
use super::study_record;
use super::vector_pictures;
use super::{MODEL, Product, Request, name_of};
use crate::pipeline::software;
use abbe_diagnose::DiagnoseError;
pub(crate) use abbe_diagnose::study::Progress;
use abbe_diagnose::study::runs::{PositionSummary, positions};
use abbe_diagnose::study::{Observe, StudyDiagnosis, StudyOptions, five_axis, runs, vectors};
use abbe_files::{
    DataSource, FileError, MachineFile, ModelFile, header_names, hex, read_component_vectors_file, read_machine,
    read_runs_file, read_sphere_centres_file,
};
use abbe_geometry::Vector3;
use abbe_measurement::correspondence::check_vectors;
use abbe_measurement::probe_pose::{ProbePose, ProbePoseModel, SphereCentre, poses};
use abbe_report::diagnosis::{DiagnosisReport, File, ModelOut};
use abbe_report::{Axis, Curve, CurveStyle, Identity, LinePanel, LinePlot, Section};
use anyhow::{Context, ensure};
use std::path::Path;

/// Kinds of data without a model, told by their header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum DataKind {
    /// ISO 230-2 runs.
    Runs,
    /// Sphere centres of a five-axis machine.
    SphereCentres,
}

/// The kind that a CSV file's header names; `None` for a campaign, a bag, or what cannot be read.
pub(crate) fn kind_of(path: &Path) -> Option<DataKind> {
    let names = header_names(path)?;
    let has = |wanted: [&str; 2]| wanted.iter().all(|name| names.iter().any(|n| n == name));
    // Targets in another unit are runs as well: their reader says what is wrong.
    let target = names.iter().find(|name| name.starts_with("target")).map_or("target_mm", String::as_str);
    match () {
        () if has(["axis", target]) => Some(DataKind::Runs),
        () if has(["a_deg", "c_deg"]) => Some(DataKind::SphereCentres),
        () => None,
    }
}

/// Diagnoses runs or sphere centres.
pub(crate) fn run(kind: DataKind, path: &Path, request: &Request, observe: &mut Observe) -> anyhow::Result<Product> {
    let machine = request.machine.map(read_machine).transpose()?;
    match kind {
        DataKind::Runs => {
            let file = read_runs_file(path)?;
            let data = Data { path, sha256: file.sha256, machine, without_machine: NAME_THE_MACHINE };
            let figures = |_: &StudyDiagnosis| position_figures(&positions(&file.rows));
            conclude(data, request, figures, |options| runs::diagnose_observed(&file.rows, options, observe))
        }
        DataKind::SphereCentres => {
            ensure!(machine.is_none(), "{}: sphere centres give no model; leave --machine out", path.display());
            let file = read_sphere_centres_file(path)?;
            conclude(
                Data {
                    path,
                    sha256: file.sha256,
                    machine,
                    without_machine: "No model file was made: sphere centres give none.",
                },
                request,
                |_: &StudyDiagnosis| pose_figure(&file.rows).into_iter().collect(),
                |options| five_axis::diagnose_observed(&file.rows, options, observe),
            )
        }
    }
}

/// Diagnoses residual vectors; the machine of a model, where one is given, says which chain stands behind them.
pub(crate) fn run_residuals(
    path: &Path,
    model: Option<&Path>,
    request: &Request,
    observe: &mut Observe,
) -> anyhow::Result<Product> {
    let of_model = model.map(machine_of).transpose()?;
    let machine = of_model.map_or_else(|| request.machine.map(read_machine).transpose(), |own| Ok(Some(own)))?;
    let chain = machine.as_ref().map(|own| own.machine.clone());
    let file = read_component_vectors_file(path)?;
    let vectors_m: Vec<Vector3<f64>> = file.rows.iter().map(|row| row.residual_m.into()).collect();
    check_vectors(&vectors_m, false).with_context(|| path.display().to_string())?;
    let figures = |diagnosis: &StudyDiagnosis| vector_pictures::sections(&file.rows, diagnosis);
    let data = Data { path, sha256: file.sha256, machine, without_machine: NAME_THE_MACHINE };
    conclude(data, request, figures, |options| vectors::diagnose_observed(&file.rows, chain.as_ref(), options, observe))
}

fn machine_of(model: &Path) -> Result<MachineFile, FileError> {
    let (file, _) = ModelFile::load(model)?;
    Ok(MachineFile {
        machine: file.model.parts().machine.clone(),
        instrument: file.instrument,
        absolute_range: file.absolute_range,
        order: file.order,
        identity: None,
    })
}

/// What was measured, and on what.
struct Data<'a> {
    path: &'a Path,
    sha256: [u8; 32],
    machine: Option<MachineFile>,
    /// Why there is no model where no machine is named.
    without_machine: &'static str,
}

/// Of data that give a model.
const NAME_THE_MACHINE: &str = "No model file was made: name the machine with --machine to have one.";

fn conclude(
    Data { path, sha256, machine, without_machine }: Data,
    request: &Request,
    figures: impl FnOnce(&StudyDiagnosis) -> Vec<Section>,
    diagnose: impl FnOnce(&StudyOptions) -> Result<StudyDiagnosis, DiagnoseError>,
) -> anyhow::Result<Product> {
    let options = StudyOptions { instrument_checked: request.instrument_checked, ..StudyOptions::default() };
    let diagnosis = diagnose(&options).with_context(|| path.display().to_string())?;
    let figures = figures(&diagnosis);
    let data = File { file: name_of(path), sha256: hex(&sha256) };
    let mut record = study_record::record(&diagnosis, data, &options, request.seed, software());
    let Some(machine) = machine else {
        record.notes.push(without_machine.to_owned());
        return Ok(Product {
            report: DiagnosisReport { record, residuals: None, figures, identity: Identity::default(), next: None },
            model: None,
            without_model: Vec::new(),
            is_partial: diagnosis.is_stopped,
        });
    };
    record.machine = Some(machine.machine.name.clone());
    let source = DataSource { file: name_of(path), sha256: hex(&sha256) };
    let made = study_model::model(&diagnosis, &machine, source, record.options.clone())?;
    let model = made.map(|model| {
        record.notes.extend(model.doubts.iter().map(|doubt| format!("The model file: {}.", doubt.text)));
        model.to_bytes(MODEL)
    });
    let model = model.transpose()?.map(|(bytes, sha256)| {
        let file = File { file: MODEL.to_owned(), sha256: hex(&sha256) };
        record.model_out = Some(ModelOut { file, is_the_one_given: false });
        bytes
    });
    let mut without_model = Vec::new();
    if model.is_none() {
        let left_out = diagnosis.terms.left_out.iter();
        let why = match left_out.len() {
            0 => "nothing was found that a model could correct",
            _ => "what was found has no place in one, for these reasons",
        };
        without_model.push(format!("No model file was made: {why}."));
        without_model.extend(left_out.map(|(name, reason)| format!("Not for a model: {name}; {reason}.")));
        record.notes.extend(without_model.clone());
    }
    Ok(Product {
        report: DiagnosisReport { record, residuals: None, figures, identity: Identity::default(), next: None },
        model,
        without_model,
        is_partial: diagnosis.is_stopped,
    })
}

/// What the pose of the probe alone leaves of each centre, side by side at its pose; nothing where it cannot be fitted.
fn pose_figure(centres: &[SphereCentre]) -> Option<Section> {
    let fitted = ProbePose::fit(centres, ProbePoseModel::NINE).ok()?;
    let poses = poses(centres);
    let of_pose = |(k, own): (usize, &Vec<usize>)| own.iter().map(|i| (k as f64 + 1.0, *i)).collect::<Vec<_>>();
    let rows: Vec<(f64, usize)> = poses.iter().enumerate().flat_map(of_pose).collect();
    let curve = |(component, name): (usize, &str)| Curve {
        name: name.to_owned(),
        style: CurveStyle::PointsBeside(component as u8 + 1, [-8, 0, 8][component]),
        x: rows.iter().map(|(pose, _)| *pose).collect(),
        y: rows.iter().map(|(_, i)| Some(fitted.residuals_m[*i][component] * 1e6)).collect(),
        half_width: None,
    };
    Some(Section::LinePlot(LinePlot {
        title: "What was measured".to_owned(),
        note: Some(
            "What the sphere's centre, the probe's direction and its zero leave of each centre. Poses of A and C in the order of the \
             file; the components stand side by side."
                .to_owned(),
        ),
        columns: 1,
        band_name: None,
        panels: vec![LinePanel {
            title: String::new(),
            x: Axis::new("pose", "1"),
            y: Axis::new("residual", "µm"),
            curves: ["x", "y", "z"].into_iter().enumerate().map(curve).collect(),
        }],
    }))
}

/// The position table as a picture: mean error and two standard deviations by target and direction, an axis a panel.
fn position_figures(positions: &[PositionSummary]) -> Vec<Section> {
    let mut axes: Vec<&str> = positions.iter().map(|p| p.axis.as_str()).collect();
    axes.dedup();
    let panel = |axis: &str| {
        let own: Vec<&PositionSummary> = positions.iter().filter(|p| p.axis == axis).collect();
        let curve = |name: &str, style: CurveStyle, of: fn(&PositionSummary) -> (Option<f64>, Option<f64>)| Curve {
            name: name.to_owned(),
            style,
            x: own.iter().map(|p| p.target_m * 1e3).collect(),
            y: own.iter().map(|p| of(p).0.map(|m| m * 1e6)).collect(),
            half_width: Some(own.iter().map(|p| of(p).1.map(|m| 2.0 * m * 1e6)).collect()),
        };
        LinePanel {
            title: format!("Axis {axis}"),
            x: Axis::new("target", "mm"),
            y: Axis::new("error (actual − target)", "µm"),
            curves: vec![
                curve("approach +", CurveStyle::APPROACH_POSITIVE, |p| (p.mean_positive_m, p.deviation_positive_m)),
                curve("approach −", CurveStyle::APPROACH_NEGATIVE, |p| (p.mean_negative_m, p.deviation_negative_m)),
            ],
        }
    };
    let panels: Vec<LinePanel> = axes.iter().map(|axis| panel(axis)).collect();
    if panels.is_empty() {
        return Vec::new();
    }
    vec![Section::LinePlot(LinePlot {
        title: "What was measured".to_owned(),
        note: Some("Mean over the cycles; the band is ± 2 standard deviations of one approach (ISO 230-2).".to_owned()),
        columns: panels.len().min(2),
        band_name: Some("± 2 standard deviations".to_owned()),
        panels,
    })]
}
