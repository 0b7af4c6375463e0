//! `abbe volumetric`: volumetric error map of a model, and positioning along the body diagonals with uncertainty.
//!
//! Place in the flow: after `identify` or `fit-points`; nothing is fitted. Writes `map.csv` (error = actual − indicated, µm),
//! `diagonals.csv` and `report.html`; with `--diagonals` it also compares what an interferometer measured (ISO 230-6).

mod measured;
mod report;

use crate::exit::Ended;
use crate::identity::{IdentityOptions, Said};
use crate::next::{Next, READINGS};
use crate::output;
use crate::verification::rms_and_max_aligned_m;
use abbe_files::{ModelFile, hex, write_atomically};
use abbe_geometry::Vector3;
use abbe_geometry::correct::Status;
use abbe_geometry::model::MachineModel;
use abbe_geometry::volumetric::{Diagonal, LinePoint, MapPoint, along_line, at_distances, error_map};
use abbe_report::{Identity, digits};
use anyhow::{Context, bail, ensure};
use measured::{Comparison, MeasuredDiagonal};
use serde_json::json;
use std::fmt::Write;
use std::path::PathBuf;

/// Targets on a diagonal, where no measurement names them: ISO 230-6 asks for five a metre at least.
const TARGETS: usize = 11;

/// What is written into the folder.
const FILES: [&str; 3] = ["map.csv", "diagonals.csv", "report.html"];

/// Arguments of `volumetric`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Model file
    #[arg(long)]
    model: PathBuf,
    /// Folder for map.csv, diagonals.csv and report.html
    #[arg(long)]
    out: PathBuf,
    /// Grid points along each axis
    #[arg(long, default_value_t = 11)]
    steps: usize,
    /// Offset of tip or reflector in the ram frame: x,y,z (mm); the machine file's default, else 0,0,0
    #[arg(long, value_delimiter = ',', num_args = 1, allow_hyphen_values = true, value_name = "X,Y,Z")]
    offset_mm: Option<Vec<f64>>,
    /// Measured diagonals to compare with: CSV diagonal, distance_mm from the first target, deviation_um, u_um (k = 1); optional
    /// start_mm, how far the first target lies from the end of the stroke (else at it), and runs, whose mean it is (else one)
    #[arg(long)]
    diagonals: Option<PathBuf>,
    /// Print the answer as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    identity: IdentityOptions,
}

/// Why the error of a machine is given without that as well.
const ALIGNED: &str = "which the datum of a part takes out";

/// Everything that is written.
pub(crate) struct Answer {
    who: Identity,
    machine: String,
    /// Name and hash of the model file.
    model_file: String,
    model_sha256: String,
    offset_m: [f64; 3],
    bounds_m: [(f64, f64); 3],
    steps: usize,
    map: Vec<MapPoint>,
    diagonals: Vec<(Diagonal, Vec<LinePoint>)>,
    comparisons: Vec<Comparison>,
    /// What speaks against the model.
    doubts: Vec<String>,
}

impl Answer {
    fn largest(&self) -> Option<&MapPoint> {
        self.map.iter().max_by(|a, b| a.error_m.norm().total_cmp(&b.error_m.norm()))
    }

    fn rms_m(&self) -> f64 {
        (self.map.iter().map(|p| p.error_m.norm_squared()).sum::<f64>() / self.map.len().max(1) as f64).sqrt()
    }

    /// Rms and largest error (m) where the whole map is shifted and turned to fit best; `None` of a map that does not fix how it lies.
    fn aligned_m(&self) -> Option<(f64, f64)> {
        rms_and_max_aligned_m(self.map.iter().map(|point| (Vector3::from(point.reading_m), point.error_m)))
    }

    fn extrapolated(&self) -> usize {
        self.map.iter().filter(|p| p.status != Status::InVolume).count()
    }

    /// Whether no point has what the model's effects read: a map has no temperatures.
    fn all_lack(&self) -> bool {
        self.map.iter().all(|p| p.status == Status::CovariateMissing)
    }
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let inputs = arguments.diagonals.iter().chain([&arguments.model]).map(PathBuf::as_path);
    output::check_in_folder(&arguments.out, &FILES, inputs)?;
    let (file, sha256) = ModelFile::load(&arguments.model)?;
    let parts = file.model.parts();
    let offset_m = match arguments.offset_mm.as_deref() {
        Some([x, y, z]) if [x, y, z].iter().all(|v| v.is_finite()) => [x * 1e-3, y * 1e-3, z * 1e-3],
        Some(_) => bail!("--offset-mm: write three finite numbers in millimetres, x,y,z"),
        None => parts.machine.default_offset_m.unwrap_or([0.0; 3]),
    };
    let bounds_m = parts.machine.stroke_m;
    let measured = arguments.diagonals.as_deref().map(measured::read).transpose()?.unwrap_or_default();
    let said = Said { machine_name: Some(&parts.machine.name), ..Said::default() };
    let answer = Answer {
        who: arguments.identity.gather(&said)?.shown,
        machine: parts.machine.name.clone(),
        model_file: crate::provenance::file_name(&arguments.model),
        model_sha256: hex(&sha256),
        doubts: file.said_against().collect(),
        offset_m,
        bounds_m,
        steps: arguments.steps,
        map: error_map(&file.model, &bounds_m, [arguments.steps; 3], offset_m)?,
        diagonals: diagonals(&file.model, &bounds_m, offset_m)?,
        comparisons: measured
            .iter()
            .map(|diagonal| compare(&file.model, diagonal, &bounds_m, offset_m))
            .collect::<anyhow::Result<_>>()?,
    };
    let next = next(arguments, &file, &answer);
    std::fs::create_dir_all(&arguments.out).with_context(|| format!("{}: cannot be made", arguments.out.display()))?;
    write_atomically(&arguments.out.join(FILES[0]), map_text(&answer)?.as_bytes())?;
    write_atomically(&arguments.out.join(FILES[1]), diagonals_text(&answer)?.as_bytes())?;
    write_atomically(&arguments.out.join(FILES[2]), report::report(&answer, &next).html()?.as_bytes())?;
    if arguments.json {
        print_json(&answer)?;
    } else {
        print_words(arguments, &answer)?;
        next.print();
    }
    judge(arguments, &answer)
}

/// Where nothing of the map was measured, a map at the middle of the offsets that were; else the controller's tables.
fn next(arguments: &Arguments, file: &ModelFile, answer: &Answer) -> Next {
    if answer.extrapolated() < answer.map.len() {
        let export = Next::new("to take the errors to a controller", "export").file("--model", &arguments.model);
        return export.text("--format csv --out tables.csv");
    }
    if answer.all_lack() {
        let correct = Next::new("to have errors where the temperatures are logged", "correct");
        return correct.file("--model", &arguments.model).text(READINGS);
    }
    let middle_mm = file.model.parts().identified.offset_m.map(|(low, high)| (low + high) * 500.0);
    let offset = middle_mm.map(|mm| format!("{mm:.1}")).join(",");
    let again = Next::new("to map it at the offsets of the campaign", "volumetric").file("--model", &arguments.model);
    again.text(&format!("--offset-mm {offset}")).file("--out", &arguments.out)
}

/// Says on standard error how much of the map is outside what the model was identified from.
fn judge(arguments: &Arguments, answer: &Answer) -> anyhow::Result<()> {
    let (outside, all) = (answer.extrapolated(), answer.map.len());
    let [x, y, z] = answer.offset_m.map(|v| v * 1e3);
    if answer.all_lack() {
        eprintln!(
            "abbe: warning: {}: a map has none of the logged quantities that the model's effects read: each stands in the middle of its range",
            arguments.out.display()
        );
        return Ok(());
    }
    if outside > 0 {
        eprintln!(
            "abbe: warning: {}: {outside} of {all} points are outside what the model was identified from, or lack covariates \
             (offset {x} {y} {z} mm)",
            arguments.out.display()
        );
    }
    ensure!(
        outside < all,
        Ended::nothing_inside(format!("no point of the map is inside at an offset of {x} {y} {z} mm; see --offset-mm"))
    );
    Ok(())
}

fn diagonals(
    model: &MachineModel,
    bounds_m: &[(f64, f64); 3],
    offset_m: [f64; 3],
) -> anyhow::Result<Vec<(Diagonal, Vec<LinePoint>)>> {
    let of = |diagonal: Diagonal| Ok((diagonal, along_line(model, diagonal.ends_m(bounds_m), TARGETS, offset_m)?));
    Diagonal::ALL.into_iter().map(of).collect()
}

fn compare(
    model: &MachineModel,
    measured: &MeasuredDiagonal,
    bounds_m: &[(f64, f64); 3],
    offset_m: [f64; 3],
) -> anyhow::Result<Comparison> {
    let distances_m: Vec<f64> = measured.targets.iter().map(|t| t.distance_m).collect();
    let ends_m = measured.ends_m(bounds_m)?;
    let predicted = at_distances(model, ends_m, &distances_m, offset_m)
        .with_context(|| format!("diagonal {}", measured.diagonal.name()))?;
    Ok(Comparison::new(measured.clone(), predicted, ends_m, model.parts().machine.repeatability_m))
}

fn map_text(answer: &Answer) -> anyhow::Result<String> {
    let mut text = "x_mm,y_mm,z_mm,error_x_um,error_y_um,error_z_um,error_um,u_x_um,u_y_um,u_z_um,status\n".to_owned();
    for point in &answer.map {
        let [x, y, z] = point.reading_m.map(|v| v * 1e3);
        let error_um = point.error_m * 1e6;
        let u_um: Vector3<f64> = point.covariance_m2.diagonal().map(|v| 2e6 * v.max(0.0).sqrt());
        let status = abbe_files::status_word(point.status);
        writeln!(
            text,
            "{x:.4},{y:.4},{z:.4},{:.4},{:.4},{:.4},{:.4},{:.4},{:.4},{:.4},{status}",
            error_um.x,
            error_um.y,
            error_um.z,
            error_um.norm(),
            u_um.x,
            u_um.y,
            u_um.z
        )?;
    }
    Ok(text)
}

fn diagonals_text(answer: &Answer) -> anyhow::Result<String> {
    let mut text = "diagonal,distance_mm,x_mm,y_mm,z_mm,deviation_um,u_um_k2,status\n".to_owned();
    for (diagonal, points) in &answer.diagonals {
        for point in points {
            let [x, y, z] = point.reading_m.map(|v| v * 1e3);
            let (name, distance_mm) = (diagonal.name(), point.distance_m * 1e3);
            let (deviation_um, u_um) = (point.deviation_m * 1e6, 2e6 * point.u_m);
            let status = abbe_files::status_word(point.status);
            writeln!(text, "{name},{distance_mm:.4},{x:.4},{y:.4},{z:.4},{deviation_um:.4},{u_um:.4},{status}")?;
        }
    }
    Ok(text)
}

/// Uncertainty of an error vector in space (m, k = 2).
fn expanded_m(point: &MapPoint) -> f64 {
    2.0 * point.covariance_m2.trace().max(0.0).sqrt()
}

/// Targets whose uncertainty is a lower bound, since they or the first target are not inside of what was identified.
fn outside(points: &[LinePoint]) -> usize {
    points.iter().filter(|point| point.status == Status::Extrapolated).count()
}

/// What is said beside U where it may be too small; empty where it holds.
fn lower_bound(points: &[LinePoint]) -> String {
    let lacking = points.iter().filter(|point| point.status == Status::CovariateMissing).count();
    let said = [(outside(points), "extrapolated"), (lacking, "without a covariate that the model reads")];
    let said = said.iter().filter(|(count, _)| *count > 0);
    said.map(|(count, what)| format!("; {count} of {} targets {what}, U may be too small there", points.len()))
        .collect()
}

/// Largest magnitude of the deviations on a diagonal (m) and the uncertainty there (k = 2).
fn extreme(points: &[LinePoint]) -> Option<(f64, f64)> {
    let largest = points.iter().max_by(|a, b| a.deviation_m.abs().total_cmp(&b.deviation_m.abs()))?;
    Some((largest.deviation_m, 2.0 * largest.u_m))
}

fn print_json(answer: &Answer) -> anyhow::Result<()> {
    let diagonals: Vec<_> = answer
        .diagonals
        .iter()
        .filter_map(|(diagonal, points)| {
            let (deviation_m, u_m) = extreme(points)?;
            let target = |point: &LinePoint| {
                json!({
                    "distance_mm": point.distance_m * 1e3, "deviation_um": point.deviation_m * 1e6, "u_um_k2": 2e6 * point.u_m,
                    "status": abbe_files::status_word(point.status),
                })
            };
            Some(json!({
                "diagonal": diagonal.name(), "largest_um": deviation_m * 1e6, "u_um_k2": u_m * 1e6,
                "extrapolated": outside(points), "targets": points.iter().map(target).collect::<Vec<_>>(),
            }))
        })
        .collect();
    let compared: Vec<_> = answer
        .comparisons
        .iter()
        .map(|c| {
            json!({
                "diagonal": c.measured.diagonal.name(), "largest_difference_um": c.largest_difference_m() * 1e6,
                "targets": c.measured.targets.len(), "outside_95_percent": c.outside(), "extrapolated": outside(&c.predicted),
            })
        })
        .collect();
    let aligned_um = answer.aligned_m().map(|(rms_m, largest_m)| (largest_m * 1e6, rms_m * 1e6));
    let value = json!({
        "machine": answer.machine,
        "model_doubts": answer.doubts,
        "model_sha256": answer.model_sha256,
        "points": answer.map.len(),
        "extrapolated": answer.extrapolated(),
        "largest_um": answer.largest().map(|p| p.error_m.norm() * 1e6),
        "largest_at_mm": answer.largest().map(|p| p.reading_m.map(|v| v * 1e3)),
        "rms_um": answer.rms_m() * 1e6,
        "aligned_largest_um": aligned_um.map(|(largest, _)| largest),
        "aligned_rms_um": aligned_um.map(|(_, rms)| rms),
        "diagonals": diagonals,
        "compared": compared,
    });
    println!("{}", serde_json::to_string_pretty(&value)?);
    Ok(())
}

fn print_words(arguments: &Arguments, answer: &Answer) -> anyhow::Result<()> {
    if let Some(largest) = answer.largest() {
        let [x, y, z] = largest.reading_m.map(|v| v * 1e3);
        let [error, u] = digits::with_uncertainty(largest.error_m.norm() * 1e6, expanded_m(largest) * 1e6);
        let (rms, points, outside) = (digits::result(answer.rms_m() * 1e6), answer.map.len(), answer.extrapolated());
        println!(
            "volumetric error {error} ± {u} µm (k = 2) at most, at X {x:.0} Y {y:.0} Z {z:.0} mm; {rms} µm rms over {points} \
             points, {outside} extrapolated"
        );
    }
    if let Some((rms_m, largest_m)) = answer.aligned_m() {
        let [largest, rms] = [largest_m, rms_m].map(|value_m| digits::result(value_m * 1e6));
        println!(
            "  aligned           {largest} µm at most, {rms} µm rms: without the shift and turn of the whole, {ALIGNED}"
        );
    }
    for (diagonal, points) in &answer.diagonals {
        if let Some((deviation_m, u_m)) = extreme(points) {
            let [deviation, u] = digits::with_uncertainty(deviation_m * 1e6, u_m * 1e6);
            let (name, bound) = (diagonal.name(), lower_bound(points));
            println!("  diagonal {name}      {deviation} ± {u} µm (k = 2) at most{bound}");
        }
    }
    for comparison in &answer.comparisons {
        println!(
            "  measured {}      differs by {} µm at most; {} of {} targets outside the 95 % interval{}",
            comparison.measured.diagonal.name(),
            digits::result(comparison.largest_difference_m() * 1e6),
            comparison.outside(),
            comparison.measured.targets.len(),
            lower_bound(&comparison.predicted)
        );
    }
    println!("  written           {}", arguments.out.display());
    Ok(())
}
