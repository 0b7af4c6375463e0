//! Diagnosis of data that need no model: positioning runs, sphere centres, residual vectors.
//!
//! Place in the flow: the header of the file says which kind it is; the study of that kind gives report and JSON, and where the
//! machine is named the model of what was found.

use super::run_pictures;
use super::study_added;
use super::study_model;
use super::study_record;
use super::vector_pictures;
use super::{MODEL, Product, Request, name_of};
use crate::pipeline::software;
use abbe_diagnose::DiagnoseError;
pub(crate) use abbe_diagnose::study::Progress;
use abbe_diagnose::study::{Observe, StudyDiagnosis, StudyOptions, five_axis, runs, vectors};
use abbe_files::{
    DataSource, FileError, MachineFile, ModelFile, Place, header_names, hex, read_component_vectors_file, read_machine,
    read_residual_origin, read_runs_file, read_sphere_centres_file,
};
use abbe_geometry::Vector3;
use abbe_geometry::machine::Machine;
use abbe_measurement::correspondence::check_vectors;
use abbe_measurement::probe_pose::{ProbePose, ProbePoseModel, SphereCentre, poses};
use abbe_report::diagnosis::{DiagnosisReport, File, ModelOut};
use abbe_report::{Axis, Curve, CurveStyle, Identity, LinePanel, LinePlot, Section};
use anyhow::{Context, bail, ensure};
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
            let base = machine.map_or_else(|| Base::none(NAME_THE_MACHINE), |own| Base::Machine(Box::new(own)));
            let data = Data { path, sha256: file.sha256, lines: &file.lines, base };
            let figures = |diagnosis: &StudyDiagnosis| run_pictures::sections(&file.rows, diagnosis);
            conclude(data, request, figures, |options| runs::diagnose_observed(&file.rows, options, observe))
        }
        DataKind::SphereCentres => {
            ensure!(machine.is_none(), "{}: sphere centres give no model; leave --machine out", path.display());
            let file = read_sphere_centres_file(path)?;
            conclude(
                Data {
                    path,
                    sha256: file.sha256,
                    lines: &file.lines,
                    base: Base::none("No model file was made: sphere centres give none."),
                },
                request,
                |_: &StudyDiagnosis| pose_figure(&file.rows).into_iter().collect(),
                |options| five_axis::diagnose_observed(&file.rows, options, observe),
            )
        }
    }
}

/// Diagnoses residual vectors. Where a model leaves them and is given, what is found is added to it; otherwise the machine says which chain
/// stands behind them.
pub(crate) fn run_residuals(
    path: &Path,
    model: Option<&Path>,
    request: &Request,
    observe: &mut Observe,
) -> anyhow::Result<Product> {
    let base = base_of(path, model, request)?;
    let chain = base.machine().cloned();
    let file = read_component_vectors_file(path)?;
    let vectors_m: Vec<Vector3<f64>> = file.rows.iter().map(|row| row.residual_m.into()).collect();
    check_vectors(&vectors_m, false).with_context(|| path.display().to_string())?;
    let figures = |diagnosis: &StudyDiagnosis| vector_pictures::sections(&file.rows, diagnosis);
    let data = Data { path, sha256: file.sha256, lines: &file.lines, base };
    conclude(data, request, figures, |options| vectors::diagnose_observed(&file.rows, chain.as_ref(), options, observe))
}

/// What residual vectors belong to, by what their head says of the model that leaves them.
fn base_of(path: &Path, model: Option<&Path>, request: &Request) -> anyhow::Result<Base> {
    let leaves = read_residual_origin(path)?.map(|origin| origin.owner.model_sha256);
    let Some(model) = model else {
        return Ok(match (request.machine.map(read_machine).transpose()?, leaves) {
            (None, None) => Base::none(NAME_THE_MACHINE),
            (None, Some(_)) => Base::none(NAME_THE_MODEL),
            (Some(machine), None) => Base::Machine(Box::new(machine)),
            (Some(machine), Some(_)) => {
                Base::None { why: NAME_THE_MODEL.to_owned(), chain: Some(Box::new(machine.machine)) }
            }
        });
    };
    let (file, sha256) = ModelFile::load(model)?;
    match leaves {
        Some(leaves) if leaves != sha256 => bail!(
            "{}: another model leaves these residuals (sha256 {}; that of {} is {}); name that one with --model, or compute the residuals of \
             this one with abbe residuals",
            path.display(),
            hex(&leaves),
            model.display(),
            hex(&sha256)
        ),
        Some(_) => Ok(Base::Model { file: Box::new(file), given: File { file: name_of(model), sha256: hex(&sha256) } }),
        None => {
            let why = format!(
                "No model file was made: {} does not say which model leaves these residuals, as those of abbe residuals do, so that what was \
                 found may be there in {} already. Name the machine with --machine in place of --model for a model of these vectors alone.",
                name_of(path),
                name_of(model)
            );
            Ok(Base::None { why, chain: Some(Box::new(file.model.parts().machine.clone())) })
        }
    }
}

/// What was measured, and on what.
struct Data<'a> {
    path: &'a Path,
    sha256: [u8; 32],
    /// Of the rows in the file.
    lines: &'a [u64],
    base: Base,
}

/// What a model of what is found is made of.
enum Base {
    /// Nothing, and why; the machine where it is known all the same.
    None { why: String, chain: Option<Box<Machine>> },
    /// A machine of which nothing else is known.
    Machine(Box<MachineFile>),
    /// The model that leaves what was measured.
    Model { file: Box<ModelFile>, given: File },
}

impl Base {
    fn none(why: &str) -> Base {
        Base::None { why: why.to_owned(), chain: None }
    }

    fn machine(&self) -> Option<&Machine> {
        match self {
            Base::None { chain, .. } => chain.as_deref(),
            Base::Machine(own) => Some(&own.machine),
            Base::Model { file, .. } => Some(&file.model.parts().machine),
        }
    }
}

/// Of residuals that a model leaves.
const NAME_THE_MODEL: &str = "No model file was made: these vectors are what a model leaves, and alone they are no model of the machine. Name that \
                              model with --model, and what was found is added to it.";

/// Of data that give a model.
const NAME_THE_MACHINE: &str = "No model file was made: name the machine with --machine to have one.";

fn conclude(
    Data { path, sha256, lines, base }: Data,
    request: &Request,
    figures: impl FnOnce(&StudyDiagnosis) -> Vec<Section>,
    diagnose: impl FnOnce(&StudyOptions) -> Result<StudyDiagnosis, DiagnoseError>,
) -> anyhow::Result<Product> {
    let options = StudyOptions { instrument_checked: request.instrument_checked, ..StudyOptions::default() };
    let diagnosis = diagnose(&options).map_err(|error| in_file(error, path, lines))?;
    let figures = figures(&diagnosis);
    let data = File { file: name_of(path), sha256: hex(&sha256) };
    let mut record = study_record::record(&diagnosis, data, &options, request.seed, software());
    record.machine = base.machine().map(|machine| machine.name.clone());
    let source = DataSource { file: name_of(path), sha256: hex(&sha256) };
    let made = match &base {
        Base::None { why, .. } => Err(why.clone()),
        Base::Machine(machine) => Ok(study_model::model(&diagnosis, machine, source, record.options.clone())?),
        Base::Model { file, given } => {
            record.model = Some(given.clone());
            let doubts = study_model::doubts(&diagnosis, &file.model.parts().machine);
            study_added::model(file, &diagnosis, source, record.options.clone(), doubts)?
                .map_err(|why| format!("No model file was made: {why}."))
        }
    };
    let mut without_model = Vec::new();
    let made = match made {
        Ok(made) => {
            if made.is_none() {
                without_model = nothing_for_a_model(&diagnosis);
            }
            made
        }
        Err(why) => {
            without_model.push(why);
            None
        }
    };
    record.notes.extend(without_model.clone());
    if matches!(&base, Base::None { chain: None, .. }) {
        // Nobody asked for one: the report says it.
        without_model.clear();
    }
    let model = made.map(|model| {
        record.notes.extend(model.doubts.iter().map(|doubt| format!("The model file: {}.", doubt.text)));
        model.to_bytes(MODEL)
    });
    let model = model.transpose()?.map(|(bytes, sha256)| {
        let file = File { file: MODEL.to_owned(), sha256: hex(&sha256) };
        record.model_out = Some(ModelOut { file, is_the_one_given: false });
        bytes
    });
    Ok(Product {
        report: DiagnosisReport { record, residuals: None, figures, identity: Identity::default(), next: None },
        model,
        without_model,
        is_partial: diagnosis.is_stopped,
    })
}

/// Why what was found gives no model.
fn nothing_for_a_model(diagnosis: &StudyDiagnosis) -> Vec<String> {
    let left_out = diagnosis.terms.left_out.iter();
    let why = match left_out.len() {
        0 => "nothing was found that a model could correct",
        _ => "what was found has no place in one, for these reasons",
    };
    let reasons = left_out.map(|(name, reason)| format!("Not for a model: {name}; {reason}."));
    std::iter::once(format!("No model file was made: {why}.")).chain(reasons).collect()
}

/// What is wrong with data, with the file and, of a row, its line.
fn in_file(error: DiagnoseError, path: &Path, lines: &[u64]) -> anyhow::Error {
    let file = path.display().to_string();
    match error {
        DiagnoseError::Row { row, problem, remedy } if row < lines.len() => {
            FileError::content(Place::file(&file).line(lines[row]), problem, remedy).into()
        }
        other => anyhow::Error::new(other).context(file),
    }
}

/// What the pose of the probe alone leaves of each centre, side by side at its pose; nothing where it cannot be fitted.
fn pose_figure(centres: &[SphereCentre]) -> Option<Section> {
    let fitted = ProbePose::fit(centres, ProbePoseModel::NINE).ok()?;
    let poses = poses(centres);
    let of_pose = |(k, own): (usize, &Vec<usize>)| own.iter().map(|i| (k as f64 + 1.0, *i)).collect::<Vec<_>>();
    let rows: Vec<(f64, usize)> = poses.iter().enumerate().flat_map(of_pose).collect();
    let curve = |(component, name): (usize, &str)| Curve {
        name: name.to_owned(),
        style: CurveStyle::PointsBeside(vector_pictures::SERIES[component], [-8, 0, 8][component]),
        x: rows.iter().map(|(pose, _)| *pose).collect(),
        y: rows.iter().map(|(_, i)| Some(fitted.residuals_m[*i][component] * 1e6)).collect(),
        also: None,
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
