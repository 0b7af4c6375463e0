//! Speed of error fields: 1000 measured points, 10 000 targets, against SciPy.
//!
//! Place in the flow: `cargo bench -p abbe-field`. The rival gets the same points in a file and times its computing part alone
//! (`scipy_fields.py`). Trilinear interpolation and `RegularGridInterpolator`, radial functions here and there solve the same
//! problem and must find the same errors; `griddata` answers the same question by tetrahedra. Kriging has no rival here: it
//! fits length scales, signal and noise, which `RBFInterpolator` is given, and its time stands beside that for orientation
//! only. The rival's interpreter is `ABBE_PYTHON`, else `python3`; without SciPy the comparison says that it was not run. All
//! run on one core, but the three components of kriging.

#![allow(missing_docs, clippy::unwrap_used)] // criterion's macros; a bench that cannot be prepared stops

use abbe_field::idw::{EXPONENT, Idw, Reference};
use abbe_field::kriging::{Kernel, Kriging, KrigingOptions, Noise, Trend};
use abbe_field::rbf::{Radial, Rbf};
use abbe_field::{Interpolator, MeasuredField, Trilinear};
use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::fmt::Write as _;
use std::process::Command;
use std::time::{Duration, Instant};

/// Points on each axis of the lattice, and its step (m).
const COUNT: usize = 10;
const STEP_M: f64 = 0.06;
const TARGETS: usize = 10_000;
/// Largest difference between the same radial functions here and there, relative to the errors.
const AGREEMENT: f64 = 1e-8;

/// A smooth field (m).
fn truth(p: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new((5.0 * p.x).sin() + p.y * p.z, (4.0 * p.y).cos() * p.x, p.x * p.x - (3.0 * p.z).sin()) * 5e-6
}

fn field() -> MeasuredField {
    let at =
        |k: usize| Vector3::new((k % COUNT) as f64, (k / COUNT % COUNT) as f64, (k / COUNT / COUNT) as f64) * STEP_M;
    let points: Vec<_> = (0..COUNT.pow(3)).map(at).collect();
    let errors = points.iter().map(truth).collect();
    MeasuredField::new(points, errors, None).unwrap()
}

fn targets() -> Vec<Vector3<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let extent_m = STEP_M * (COUNT - 1) as f64;
    (0..TARGETS).map(|_| Vector3::from_fn(|_, _| random.random_range(0.0..extent_m))).collect()
}

/// Makes a method and evaluates all targets.
type Method = fn(&MeasuredField, &[Vector3<f64>]) -> Vec<Vector3<f64>>;

fn all(method: &dyn Interpolator, targets: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    targets.iter().map(|target| method.at(target).unwrap().error_m).collect()
}

fn trilinear(field: &MeasuredField, targets: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    all(&Trilinear::new(field), targets)
}

fn idw(field: &MeasuredField, targets: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    all(&Idw::new(field, Reference::Hexahedron, EXPONENT).unwrap(), targets)
}

fn thin_plate(field: &MeasuredField, targets: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    all(&Rbf::new(field, Radial::ThinPlate, 0.0).unwrap(), targets)
}

fn cubic(field: &MeasuredField, targets: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    all(&Rbf::new(field, Radial::Cubic, 0.0).unwrap(), targets)
}

/// Median of a few runs (s), and the values.
fn timed(method: Method, field: &MeasuredField, targets: &[Vector3<f64>]) -> (f64, Vec<Vector3<f64>>) {
    let mut values = Vec::new();
    let mut times: Vec<Duration> = (0..5)
        .map(|_| {
            let begin = Instant::now();
            values = method(field, targets);
            begin.elapsed()
        })
        .collect();
    times.sort();
    (times[times.len() / 2].as_secs_f64(), values)
}

/// What SciPy printed: method, seconds, values at the first targets; or why it was not run.
fn rivals(field: &MeasuredField, targets: &[Vector3<f64>]) -> Result<Vec<(String, f64, Vec<f64>)>, String> {
    let file = std::env::temp_dir().join(format!("field-bench-{}.txt", std::process::id()));
    let mut text = format!("{}\n", field.points_m().len());
    for (p, e) in field.points_m().iter().zip(field.errors_m()) {
        writeln!(text, "{:e} {:e} {:e} {:e} {:e} {:e}", p.x, p.y, p.z, e.x, e.y, e.z).unwrap();
    }
    for p in targets {
        writeln!(text, "{:e} {:e} {:e}", p.x, p.y, p.z).unwrap();
    }
    std::fs::write(&file, text).map_err(|error| error.to_string())?;
    let python = std::env::var("ABBE_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let script = format!("{}/benches/scipy_fields.py", env!("CARGO_MANIFEST_DIR"));
    let output = Command::new(&python)
        .args(["-B", &script, &file.to_string_lossy()])
        .envs([("OMP_NUM_THREADS", "1"), ("OPENBLAS_NUM_THREADS", "1"), ("MKL_NUM_THREADS", "1")])
        .output();
    let _ = std::fs::remove_file(&file); // a leftover in the temporary folder does no harm
    let output = output.map_err(|error| format!("{python}: {error}"))?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).lines().last().unwrap_or("no output").to_owned());
    }
    let parse = |line: &str| {
        let mut cells = line.split_whitespace();
        let (name, seconds) = (cells.next()?.to_owned(), cells.next()?.parse().ok()?);
        Some((name, seconds, cells.map(|cell| cell.parse().ok()).collect::<Option<Vec<f64>>>()?))
    };
    String::from_utf8_lossy(&output.stdout)
        .lines()
        .map(parse)
        .collect::<Option<_>>()
        .ok_or("unreadable output".to_owned())
}

fn against_scipy(criterion: &mut Criterion) {
    let (field, targets) = (field(), targets());
    let own: [(&str, &str, Method); 5] = [
        ("trilinear", "trilinear", trilinear),
        ("trilinear", "griddata", trilinear),
        ("idw_hexahedron", "griddata", idw),
        ("thin_plate", "thin_plate", thin_plate),
        ("cubic", "cubic", cubic),
    ];
    let rivals = rivals(&field, &targets);
    if let Err(why) = &rivals {
        println!("scipy_fields.py was not run: {why}; set ABBE_PYTHON to a Python with SciPy");
    }
    for (name, rival_name, method) in own {
        if name == rival_name || name.starts_with("idw") {
            criterion.bench_function(&format!("field/{name}"), |bencher| bencher.iter(|| method(&field, &targets)));
        }
        let (own_s, values) = timed(method, &field, &targets);
        println!("{name}: {:.1} ms for {} points and {TARGETS} targets", own_s * 1e3, field.points_m().len());
        let rival = rivals.iter().flatten().find(|(other, ..)| other == rival_name);
        let Some((_, rival_s, theirs)) = rival else { continue };
        println!("  SciPy {rival_name}: {:.1} ms, ratio {:.1}", rival_s * 1e3, rival_s / own_s);
        if name == rival_name {
            let largest = field.errors_m().iter().map(|e| e.amax()).fold(0.0, f64::max);
            let ours = values.iter().flat_map(|v| v.iter().copied());
            let difference = ours.zip(theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / largest;
            println!("  values agree within {difference:.1e} of the largest error");
            assert!(difference < AGREEMENT, "the rival does not solve the same problem");
        }
    }
}

fn kriging(_: &mut Criterion) {
    let (field, targets) = (field(), targets());
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let noisy =
        field.errors_m().iter().map(|e| e + Vector3::from_fn(|_, _| random.random_range(-0.2e-6..0.2e-6))).collect();
    let field = MeasuredField::new(field.points_m().to_vec(), noisy, None).unwrap();
    let options = KrigingOptions { kernel: Kernel::Matern52, trend: Trend::Constant, noise: Noise::Fitted };
    let begin = Instant::now();
    let kriging = Kriging::fit(&field, &options).unwrap();
    let fit_s = begin.elapsed().as_secs_f64();
    let begin = Instant::now();
    let errors: Vec<_> = targets.iter().map(|target| kriging.error_m(target)).collect();
    let mean_us = begin.elapsed().as_secs_f64() / errors.len() as f64 * 1e6;
    let begin = Instant::now();
    let predicted: Vec<_> = targets.iter().take(200).map(|target| kriging.predict(target)).collect();
    let predict_us = begin.elapsed().as_secs_f64() / predicted.len() as f64 * 1e6;
    println!(
        "kriging, another problem: fit of {} points {fit_s:.2} s; error {mean_us:.1} us, with uncertainty {predict_us:.0} us a target",
        COUNT.pow(3)
    );
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).measurement_time(Duration::from_secs(4));
    targets = against_scipy, kriging
}
criterion_main!(benches);
