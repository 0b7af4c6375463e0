//! `abbe fit-points`: measured positions in, model out.
//!
//! Place in the flow: offline, beside `identify`, for instruments that give 3-D positions instead of ranges (Liang 2025).
//! Reads the columns of `verify` (scale readings, offsets, actual position); writes the same kind of model file. Points of a
//! plate lie in planes, one pose or several: what these support is fitted, the rest is named.

use crate::next::{KNOWN_POINTS, Next};
use crate::output;
use crate::pipeline::software;
use crate::progress::spinner;
use crate::verdict::{self, Accept};
use abbe_files::{DataSource, Doubt, FileError, MachineFile, ModelFile, PointRow, PointsReader, hex, read_machine};
use abbe_geometry::Vector3;
use abbe_geometry::effects::{CovariateSource, CovariateValue};
use abbe_identify::points::{
    FittedPoints, JadeChoices, Loss, MeasuredPoint, Method, Plates, PointOptions, PointProgress, fit_plates,
    fit_plates_of_best_degree, fit_plates_smooth, fit_points, fit_points_of_best_degree, fit_points_smooth,
};
use abbe_identify::verdict::{Cause, Counted, Grade, Verdict, equal_steps, of_noise, of_rejected, stroke_along};
use abbe_report::digits;
use abbe_runtime::Shutdown;
use anyhow::{Context, ensure};
use clap::ValueEnum;
use serde_json::{Value, json};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Column with the standard uncertainty of a measured position, each coordinate, k = 1.
const U_COLUMN: &str = "u_actual_um";
/// Column with the name of a plate's pose.
const POSE_COLUMN: &str = "pose";
/// Extent of the readings of a pose across its plane, over the largest, up to which they are those of a plate.
const FLAT: f64 = 0.01;
/// Rows below which nothing is told of plates and volumes: three points show no more than where a plate lies.
const FEWEST: usize = 4;
/// Degrees that are compared where none is asked for.
const DEGREES: std::ops::RangeInclusive<usize> = 1..=8;

/// Rejected points that are printed one by one.
const MOST_SHOWN: usize = 10;

/// Way to the minimum, as on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum MethodName {
    /// Damped Gauss-Newton with analytic derivatives
    LevenbergMarquardt,
    /// Adaptive differential evolution (Zhang & Sanderson 2009)
    Jade,
}

/// Loss, as on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum LossName {
    /// Squared distances
    Squares,
    /// Huber's loss: a few gross errors
    Huber,
    /// Least trimmed squares, then least squares on what is left: many gross errors
    Trimmed,
}

/// Error functions, as on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FunctionsName {
    /// Cubic splines as smooth as the data ask for, whose bend between the points is in the uncertainty
    Smooth,
    /// Polynomials, whose degree the data choose unless --degree is given
    Polynomial,
    /// As the machine file names them, without any penalty
    Machine,
}

impl FunctionsName {
    fn name(self) -> &'static str {
        match self {
            FunctionsName::Smooth => "smooth",
            FunctionsName::Polynomial => "polynomial",
            FunctionsName::Machine => "machine",
        }
    }
}

/// Arguments of `fit-points`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Machine file (launch-config/machines/*.toml)
    #[arg(long)]
    machine: PathBuf,
    /// CSV: x_mm y_mm z_mm, offset columns, actual_x_mm actual_y_mm actual_z_mm, optional u_actual_um (k = 1); of plates
    /// optional pose, and one actual coordinate may be missing
    #[arg(long)]
    points: PathBuf,
    /// Model file to write
    #[arg(long)]
    out: PathBuf,
    /// Standard uncertainty (k = 1) of each measured coordinate, where the file has no u_actual_um (µm)
    #[arg(long)]
    u_um: Option<f64>,
    /// Way to the minimum
    #[arg(long, value_enum, default_value = "levenberg-marquardt")]
    method: MethodName,
    /// What is summed over the points
    #[arg(long, value_enum, default_value = "huber")]
    loss: LossName,
    /// Error functions [default: smooth; polynomial with --degree or --method jade]
    #[arg(long, value_enum)]
    functions: Option<FunctionsName>,
    /// Degree of the polynomials; chosen by the data (BIC, 1 to 8) if not given
    #[arg(long)]
    degree: Option<usize>,
    /// Seed of JADE
    #[arg(long, default_value_t = JadeChoices::default().seed)]
    seed: u64,
    /// Population of JADE; four members for each unknown if not given
    #[arg(long)]
    population: Option<usize>,
    /// Generations after which JADE is given up
    #[arg(long, default_value_t = JadeChoices::default().max_generations)]
    generations: usize,
    /// Print what was found as JSON on standard output
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    accept: Accept,
}

impl Arguments {
    fn options(&self) -> PointOptions {
        let jade = JadeChoices {
            seed: self.seed,
            members: self.population,
            max_generations: self.generations,
            ..JadeChoices::default()
        };
        let method = match self.method {
            MethodName::LevenbergMarquardt => Method::LevenbergMarquardt,
            MethodName::Jade => Method::Jade(jade),
        };
        let loss = match self.loss {
            LossName::Squares => Loss::Squares,
            LossName::Huber => Loss::Huber,
            LossName::Trimmed => Loss::Trimmed,
        };
        PointOptions { method, loss }
    }

    /// JADE and a degree ask for a fixed number of coefficients.
    fn functions(&self) -> FunctionsName {
        let is_fixed = self.degree.is_some() || self.method == MethodName::Jade;
        self.functions.unwrap_or(if is_fixed { FunctionsName::Polynomial } else { FunctionsName::Smooth })
    }

    fn method_name(&self) -> &'static str {
        match self.method {
            MethodName::LevenbergMarquardt => "levenberg-marquardt",
            MethodName::Jade => "jade",
        }
    }
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    output::check([arguments.out.as_path()], [arguments.machine.as_path(), arguments.points.as_path()])?;
    let shutdown = Shutdown::on_signals()?;
    let machine = read_machine(&arguments.machine)?;
    let Read { points, plates, source } = read_points(&arguments.points, &machine, arguments.u_um)?;
    let bar = spinner(&format!("fitting {} to {} points", machine.machine.name, points.len()));
    let mut observe = |progress: PointProgress| {
        bar.set_message(format!(
            "step {}, objective {:.6e}, spread {:.1e}",
            progress.step, progress.objective, progress.spread
        ));
        !shutdown.requested()
    };
    let since = Instant::now();
    let fitted = fit(arguments, &machine, (&points, plates.as_ref()), &mut observe);
    bar.finish_and_clear();
    let fitted = fitted.with_context(|| format!("{} (points count from 1)", arguments.points.display()))?;
    let seconds = since.elapsed().as_secs_f64();
    let evidence = evidence_json(&fitted);
    let verdict = judged(&machine, (&points, plates.as_ref()), &fitted, arguments.loss);
    let name = arguments.points.display().to_string();
    verdict::shown(
        verdict::check(&verdict, arguments.accept, &name, || evidence.clone()).map_err(Into::into),
        arguments.json,
    )?;
    let file = model_file(arguments, &machine, source, (fitted, &verdict), &evidence);
    let sha256 = hex(&file.save(&arguments.out)?);
    if arguments.json {
        let value = json!({
            "machine": file.model.parts().machine.name,
            "model": arguments.out.display().to_string(),
            "model_sha256": sha256,
            "data": file.data,
            "options": file.options,
            "findings": verdict::json(&verdict.findings),
            "evidence": evidence,
            "fit_s": seconds,
            "software": file.software,
        });
        println!("{}", serde_json::to_string_pretty(&value)?);
    } else {
        print_words(arguments, (&file, &verdict), &evidence, &sha256, seconds);
        let next = Next::new("to hold it against points that the fit has not seen", "verify");
        next.file("--model", &arguments.out).text(KNOWN_POINTS).print();
    }
    Ok(())
}

fn fit(
    arguments: &Arguments,
    machine: &MachineFile,
    (points, plates): (&[MeasuredPoint], Option<&Plates>),
    observe: &mut dyn FnMut(PointProgress) -> bool,
) -> anyhow::Result<FittedPoints> {
    let options = arguments.options();
    let machine = &machine.machine;
    let degrees = match (arguments.functions(), arguments.degree) {
        (FunctionsName::Smooth, None) => {
            return Ok(match plates {
                None => fit_points_smooth(machine, points, &options, observe)?,
                Some(plates) => fit_plates_smooth(machine, points, plates, &options, observe)?,
            });
        }
        (FunctionsName::Machine, None) => {
            return Ok(match plates {
                None => fit_points(machine, points, &options, observe)?,
                Some(plates) => fit_plates(machine, points, plates, &options, observe)?,
            });
        }
        (FunctionsName::Machine | FunctionsName::Smooth, Some(_)) => {
            anyhow::bail!("--degree belongs to --functions polynomial; leave one of the two out")
        }
        (FunctionsName::Polynomial, Some(degree)) => degree..=degree,
        (FunctionsName::Polynomial, None) => DEGREES,
    };
    Ok(match plates {
        None => fit_points_of_best_degree(machine, points, degrees, &options, observe)?,
        Some(plates) => fit_plates_of_best_degree(machine, points, plates, degrees, &options, observe)?,
    })
}

/// What a file of positions holds.
struct Read {
    points: Vec<MeasuredPoint>,
    /// Poses, where the points are those of plates.
    plates: Option<Plates>,
    source: DataSource,
}

/// Points of a file with the columns of verification.
fn read_points(path: &Path, machine: &MachineFile, u_um: Option<f64>) -> anyhow::Result<Read> {
    let name = path.display().to_string();
    let input = File::open(path).with_context(|| format!("{name}: cannot be opened"))?;
    let mut reader = PointsReader::of_plates(input, &name, machine.machine.default_offset_m)?;
    let has_column = reader.columns().iter().any(|column| column == U_COLUMN);
    ensure!(
        has_column != u_um.is_some(),
        "{name}: state the standard uncertainty (k = 1) of a measured coordinate either in a column {U_COLUMN} or with \
         --u-um, and not in both"
    );
    let lacks = reader.lacks();
    let (mut points, mut poses) = (Vec::new(), Vec::new());
    let mut row = PointRow::default();
    while reader.read(&mut row)? {
        let Some(actual_m) = row.actual_m else { continue };
        let u_um = match (u_um, reader.covariates(&row).covariate(U_COLUMN)) {
            (Some(u_um), _) | (None, CovariateValue::Fresh(u_um)) => u_um,
            (None, _) => {
                let place = abbe_files::Place::file(&name).line(row.line()).column(U_COLUMN);
                return Err(FileError::content(place, "no number", "write the standard uncertainty, k = 1").into());
            }
        };
        let actual_m = Vector3::from(actual_m);
        let (reading_m, offset_m) = (row.reading_m, row.offset_m);
        poses.extend(reader.text(&row, POSE_COLUMN)?);
        points.push(MeasuredPoint { reading_m, offset_m, actual_m, u_m: u_um * 1e-6 });
    }
    check_count(points.len(), &name)?;
    let file = path.file_name().map_or_else(|| name.clone(), |n| n.to_string_lossy().into_owned());
    let is_plate = lacks.is_some() || !poses.is_empty() || moved(&points).contains(&false);
    poses.resize(points.len(), String::new());
    let plates = is_plate.then(|| Plates::new(&poses, lacks)).transpose().with_context(|| name.clone())?;
    Ok(Read { points, plates, source: DataSource { file, sha256: hex(&reader.sha256()) } })
}

/// Refuses a file of so few rows that plate and volume look alike.
fn check_count(rows: usize, name: &str) -> anyhow::Result<()> {
    ensure!(rows > 0, "{name}: the file holds a header but no row; give one row for each point");
    ensure!(
        rows >= FEWEST,
        "{name}: the file holds {rows} row{}; no machine is told from fewer than {FEWEST}: measure the points of a plate, or points that fill \
         the volume",
        if rows == 1 { "" } else { "s" }
    );
    Ok(())
}

/// Axes along which the readings differ by more than a plate does across its plane.
fn moved(points: &[MeasuredPoint]) -> [bool; 3] {
    let extent = |d: usize| {
        let along = || points.iter().map(|point| point.reading_m[d]);
        along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
    };
    let extents = [0, 1, 2].map(extent);
    let largest = extents.iter().copied().fold(0.0, f64::max);
    extents.map(|extent| extent > FLAT * largest)
}

/// What a model of plates does not know of the machine.
fn not_seen(fitted: &FittedPoints) -> Option<Doubt> {
    let names: Vec<&str> = fitted.not_seen.iter().map(|own| own.name.as_str()).collect();
    let text = format!(
        "it was measured on plates, taken as they were calibrated, whose place on the machine is unknown; {} could not be told, are \
         held at zero and are not in the uncertainty, nor is a shift or turn of the whole",
        names.join(", ")
    );
    (!names.is_empty()).then(|| Doubt { grade: Grade::Warning.name().to_owned(), text })
}

/// What speaks against the fit.
fn judged(
    machine: &MachineFile,
    (points, plates): (&[MeasuredPoint], Option<&Plates>),
    fitted: &FittedPoints,
    loss: LossName,
) -> Verdict {
    let evidence = &fitted.evidence;
    let counted = Counted { what: "points", rejected: evidence.rejected.len(), all: points.len() };
    let rejected = of_rejected(counted, vec![Cause::Scattered, Cause::Lacks]).map(|mut finding| {
        // Who asks for trimmed squares expects gross errors in a large share of the points.
        if loss == LossName::Trimmed {
            finding.grade = finding.grade.min(Grade::Warning);
        }
        finding
    });
    let is_plate = plates.is_some();
    let dimensions = if plates.is_some_and(Plates::is_in_plane) { 2.0 } else { 3.0 };
    let degrees = dimensions * fitted.weights.iter().sum::<f64>() - evidence.effective;
    let causes = match evidence.chi2_per_dof > 1.0 {
        true => vec![Cause::Lacks, Cause::Understated, Cause::Scattered],
        false => vec![Cause::Overstated, Cause::Computed],
    };
    let noise = of_noise(evidence.chi2_per_dof, degrees, causes);
    // What a plate cannot tell of an axis across it is named as such, and is no share of a stroke.
    let axes = if is_plate { moved(points) } else { [true; 3] };
    let driven = stroke_along(&machine.machine, axes, points.iter().map(|point| point.reading_m));
    let sampled = equal_steps(axes, points.iter().map(|point| point.reading_m));
    Verdict::new([rejected, noise, driven, sampled].into_iter().flatten().collect(), 1.0)
}

fn model_file(
    arguments: &Arguments,
    machine: &MachineFile,
    source: DataSource,
    (fitted, verdict): (FittedPoints, &Verdict),
    evidence: &Value,
) -> ModelFile {
    let unseen = not_seen(&fitted);
    ModelFile {
        model: fitted.model,
        order: match arguments.functions() {
            FunctionsName::Smooth => abbe_files::OrderChoice::Evidence,
            FunctionsName::Polynomial | FunctionsName::Machine => abbe_files::OrderChoice::Fixed,
        },
        instrument: machine.instrument,
        absolute_range: machine.absolute_range,
        residual_network: None,
        data: vec![source],
        seed: (arguments.method == MethodName::Jade).then_some(arguments.seed),
        options: json!({
            "from": "points", "method": arguments.method_name(), "loss": arguments.options().loss.name(),
            "functions": arguments.functions().name(), "degree": arguments.degree, "population": arguments.population, "generations": arguments.generations,
            "u_um": arguments.u_um,
        }),
        evidence: evidence.clone(),
        doubts: verdict::doubts(verdict).into_iter().chain(unseen).collect(),
        software: software(),
    }
}

/// The evidence in the units people read.
fn evidence_json(fitted: &FittedPoints) -> Value {
    let evidence = &fitted.evidence;
    let pose = &fitted.pose;
    let rejected: Vec<Value> =
        evidence.rejected.iter().map(|r| json!({ "point": r.point, "distance_um": r.distance_m * 1e6 })).collect();
    let degree = fitted.model.parts().machine.kinds.iter().flatten().find_map(|kind| match kind {
        abbe_geometry::error_function::FunctionKind::Polynomial { degree } => Some(*degree),
        _ => None,
    });
    let not_seen: Vec<Value> =
        fitted.not_seen.iter().map(|own| json!({ "name": own.name, "because": own.because })).collect();
    let mut value = json!({
        "converged": true,
        "unknowns": evidence.unknowns,
        "effective_unknowns": evidence.effective,
        "rank": evidence.rank,
        "condition": evidence.condition,
        "polynomial_degree": degree,
        "steps": evidence.steps,
        "evaluations": evidence.evaluations,
        "objective": evidence.objective,
        "largest_step_in_u": evidence.largest_step,
        "chi2_per_dof": evidence.chi2_per_dof,
        "sigma_over_declared": evidence.robust_scale,
        "bic": evidence.bic,
        "largest_residual_um": evidence.largest_residual_m * 1e6,
        "rejected": rejected,
        "machine_from_measured": {
            "rotation_by_rows": (0..3).map(|i| (0..3).map(|j| pose.machine_from_measured[(i, j)]).collect()).collect::<Vec<Vec<f64>>>(),
            "origin_mm": pose.origin_m.iter().map(|v| v * 1e3).collect::<Vec<f64>>(),
        },
    });
    if !not_seen.is_empty() {
        value["not_identifiable"] = not_seen.into();
    }
    value
}

fn functions_in_words(arguments: &Arguments, evidence: &Value) -> String {
    match arguments.functions() {
        FunctionsName::Smooth => {
            format!(
                "smooth functions: {:.1} determined by the data",
                evidence["effective_unknowns"].as_f64().unwrap_or(f64::NAN)
            )
        }
        FunctionsName::Polynomial => format!("polynomial degree {}", evidence["polynomial_degree"]),
        FunctionsName::Machine => "functions of the machine file".to_owned(),
    }
}

fn print_words(
    arguments: &Arguments,
    (file, verdict): (&ModelFile, &Verdict),
    evidence: &Value,
    sha256: &str,
    seconds: f64,
) {
    let quality = &file.model.parts().quality;
    println!(
        "residual {} µm rms, {} µm at most, χ² per degree of freedom {} with the declared uncertainties",
        digits::result(quality.residual_rms_m * 1e6),
        digits::result(evidence["largest_residual_um"].as_f64().unwrap_or(f64::NAN)),
        digits::result(quality.chi2_per_dof)
    );
    println!("  points            {} used, {} rejected", quality.readings, quality.rejected);
    println!(
        "  unknowns          {} (rank {}), condition {:.0}, {}",
        evidence["unknowns"],
        evidence["rank"],
        evidence["condition"].as_f64().unwrap_or(f64::NAN),
        functions_in_words(arguments, evidence)
    );
    for own in evidence["not_identifiable"].as_array().into_iter().flatten() {
        println!(
            "  not identifiable  {}: {}; held at zero",
            own["name"].as_str().unwrap_or_default(),
            own["because"].as_str().unwrap_or_default()
        );
    }
    super::identify::print_ram_turn(file);
    println!("  {:<17} {:.0} ms, {} steps", arguments.method_name(), seconds * 1e3, evidence["steps"]);
    let rejected = evidence["rejected"].as_array().map_or(&[] as &[Value], Vec::as_slice);
    for point in rejected.iter().take(MOST_SHOWN) {
        println!(
            "  rejected          point {}: {} µm off",
            point["point"],
            digits::result(point["distance_um"].as_f64().unwrap_or(f64::NAN))
        );
    }
    if rejected.len() > MOST_SHOWN {
        println!(
            "  rejected          and {} more: see --json, or evidence in the model file",
            rejected.len() - MOST_SHOWN
        );
    }
    if arguments.functions() == FunctionsName::Polynomial
        && arguments.degree.is_none()
        && evidence["polynomial_degree"] == json!(*DEGREES.end())
    {
        println!(
            "  note              the highest degree on offer was chosen: the errors may be rougher than polynomials; compare with --functions machine"
        );
    }
    print!("{}", verdict::words(&verdict.findings));
    super::identify::print_written(&arguments.out, sha256);
}
