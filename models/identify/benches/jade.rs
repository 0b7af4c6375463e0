//! Fit of measured positions: Levenberg-Marquardt and JADE against `scipy.optimize.least_squares` and
//! `differential_evolution`, on the same points in the same run.
//!
//! Place in the flow: `cargo bench -p abbe-identify --bench jade`. Points come from the virtual machine; the rivals read them
//! from a file and time their computing part alone (`scipy_points.py`, vectorised over the population). Their interpreter is
//! `ABBE_PYTHON`, else `python3`; without NumPy and SciPy the comparison says that it was not run.

#![allow(missing_docs, clippy::unwrap_used, clippy::panic)] // criterion's macros; a bench that cannot be prepared stops

use abbe_geometry::Vector3;
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::Machine;
use abbe_geometry::rotation::RotationForm;
use abbe_identify::jade::{JadeOptions, minimise, uniform_population};
use abbe_identify::points::{FittedPoints, JadeChoices, Loss, MeasuredPoint, Method, PointOptions, fit_points};
use abbe_virtual_machine::{TruthRecipe, VirtualMachine};
use common::{description, of_low_order};
use criterion::{Criterion, criterion_group, criterion_main};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use std::fmt::Write as _;
use std::process::Command;
use std::time::{Duration, Instant};

#[path = "../tests/common/mod.rs"]
mod common;

/// Degrees of the polynomials: 39 and 75 unknowns.
const DEGREES: [usize; 2] = [2, 4];
/// Points.
const POINTS: usize = 210;
/// Noise of each coordinate (m), as `scipy_points.py` has it.
const NOISE_M: f64 = 0.3e-6;

fn case(degree: usize) -> (Machine, Vec<MeasuredPoint>) {
    let truth = TruthRecipe { seed: 1, ..TruthRecipe::default() }.bridge_xyz().unwrap();
    let truth = of_low_order(truth, degree as u32);
    let mut machine = description(&truth, FunctionKind::Polynomial { degree });
    machine.rotation = RotationForm::SmallAngle;
    machine.repeatability_m = [0.0; 3];
    let truth = VirtualMachine::new(truth).unwrap();
    let mut generator = ChaCha8Rng::seed_from_u64(7);
    let offsets = [[0.0, 0.0, -0.06], [0.12, 0.0, -0.06], [0.0, 0.14, -0.09]];
    let mut point = |k: usize| {
        let reading_m = machine.stroke_m.map(|(low, high)| low + (high - low) * generator.random::<f64>());
        let mut noise = || NOISE_M * generator.sample::<f64, _>(StandardNormal);
        let noise = Vector3::new(noise(), noise(), noise());
        let offset_m = offsets[k % 3];
        let actual_m = Vector3::from(truth.actual_point_m(reading_m, offset_m)) + noise;
        MeasuredPoint { reading_m, offset_m, actual_m, u_m: NOISE_M }
    };
    let points = (0..POINTS).map(&mut point).collect();
    (machine, points)
}

fn fit((machine, points): &(Machine, Vec<MeasuredPoint>), method: Method) -> FittedPoints {
    fit_points(machine, points, &PointOptions { method, loss: Loss::Squares }, &mut |_| true).unwrap()
}

fn jade() -> Method {
    Method::Jade(JadeChoices::default())
}

/// Median of a few runs (s).
fn median_s(runs: usize, mut work: impl FnMut()) -> f64 {
    let mut times: Vec<Duration> = (0..runs)
        .map(|_| {
            let begin = Instant::now();
            work();
            begin.elapsed()
        })
        .collect();
    times.sort();
    times[times.len() / 2].as_secs_f64()
}

fn points_text(points: &[MeasuredPoint]) -> String {
    let mut text = String::new();
    for p in points {
        let numbers = p.reading_m.iter().chain(&p.offset_m).chain(p.actual_m.iter());
        numbers.for_each(|v| write!(text, "{v:e} ").unwrap());
        text.push('\n');
    }
    text
}

/// Lines that the rivals print, or why they were not run.
fn rivals(points: &[MeasuredPoint], degree: usize, evaluations: usize, members: usize) -> Result<String, String> {
    let file = std::env::temp_dir().join(format!("jade-bench-{}.txt", std::process::id()));
    std::fs::write(&file, points_text(points)).map_err(|error| error.to_string())?;
    let python = std::env::var("ABBE_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let script = format!("{}/benches/scipy_points.py", env!("CARGO_MANIFEST_DIR"));
    let arguments = [degree, evaluations, members].map(|v| v.to_string());
    let output = Command::new(&python).args(["-B", &script, &file.to_string_lossy()]).args(arguments).output();
    let _ = std::fs::remove_file(&file); // a leftover in the temporary folder does no harm
    let output = output.map_err(|error| format!("{python}: {error}"))?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    Err(String::from_utf8_lossy(&output.stderr).lines().last().unwrap_or("no output").to_owned())
}

fn against_scipy(criterion: &mut Criterion) {
    let small = case(DEGREES[0]);
    criterion.bench_function("points/levenberg_marquardt", |bencher| {
        bencher.iter(|| fit(&small, Method::LevenbergMarquardt));
    });
    for degree in DEGREES {
        let case = case(degree);
        let direct = fit(&case, Method::LevenbergMarquardt);
        let direct_s = median_s(9, || drop(fit(&case, Method::LevenbergMarquardt)));
        let evolved = fit(&case, jade());
        let evolved_s = median_s(3, || drop(fit(&case, jade())));
        let evaluations = evolved.evidence.evaluations.unwrap();
        // SciPy's evolution takes minutes already at the lower degree.
        let members = if degree == DEGREES[0] { 4 * direct.evidence.unknowns } else { 0 };
        println!("degree {degree}, {} unknowns, {POINTS} points", direct.evidence.unknowns);
        println!("  Levenberg-Marquardt    {:.3e} s, objective {:.9e}", direct_s, direct.evidence.objective);
        println!(
            "  JADE                   {:.3e} s, objective {:.9e}, {evaluations} evaluations, {:.4} u from the minimum: {:.0} times as long",
            evolved_s,
            evolved.evidence.objective,
            evolved.evidence.largest_step,
            evolved_s / direct_s
        );
        match rivals(&case.1, degree, evaluations, members) {
            Ok(lines) => lines.lines().for_each(|line| compare(line, [direct_s, evolved_s, evaluations as f64])),
            Err(why) => {
                println!("scipy_points.py was not run: {why}; set ABBE_PYTHON to a Python with NumPy and SciPy")
            }
        }
    }
}

/// A rival's line beside ours: the whole fit for least squares, the time of one evaluation for evolution.
fn compare(line: &str, [direct_s, evolved_s, evaluations]: [f64; 3]) {
    let mut words = line.split_whitespace();
    let name = words.next().unwrap_or_default();
    let numbers: Vec<f64> = words.filter_map(|word| word.parse().ok()).collect();
    let [seconds, objective, calls] = numbers[..] else { panic!("{line}") };
    println!("  SciPy {name}: {seconds:.3e} s, objective {objective:.9e}, {calls:.0} evaluations");
    if name == "least_squares" {
        println!("    {:.1} times as long as Levenberg-Marquardt here", seconds / direct_s);
    } else {
        let ratio = (seconds / calls) / (evolved_s / evaluations);
        println!("    an evaluation takes {ratio:.1} times as long as one of JADE here");
    }
}

fn standard_function(criterion: &mut Criterion) {
    let rastrigin = |x: &[f64]| x.iter().map(|v| v * v - 10.0 * (std::f64::consts::TAU * v).cos() + 10.0).sum::<f64>();
    let bounds = [(-5.12, 5.12); 10];
    let options = JadeOptions { parallel: false, ..JadeOptions::default() };
    criterion.bench_function("jade/rastrigin_10", |bencher| {
        bencher.iter(|| {
            let first = uniform_population(&bounds, 60, 1).unwrap();
            minimise(&rastrigin, first, Some(&bounds), &options, &mut |_| true).unwrap()
        });
    });
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).measurement_time(Duration::from_secs(3));
    targets = against_scipy, standard_function
}
criterion_main!(benches);
