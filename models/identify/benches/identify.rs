//! Speed of identification: the size of the recorded campaigns against NumPy and SciPy, and a million readings.
//!
//! Place in the flow: `cargo bench -p abbe-identify`. Campaigns come from the virtual machine; the rivals get the same
//! readings in a file and time their computing part alone: `scipy_identify.py` solves the same problem and must find the
//! same errors, `scipy_lean.py` an easier one by hand, `scipy_least_squares.py` with the library's own solver. Their
//! interpreter is `ABBE_PYTHON`, else `python3`; without NumPy and SciPy the comparison says that it was not run. All run
//! on one core.

#![allow(missing_docs, clippy::unwrap_used, clippy::panic)] // criterion's macros; a bench that cannot be prepared stops

use abbe_geometry::ErrorId;
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::Machine;
use abbe_identify::{Identified, IdentifyOptions, identify};
use abbe_measurement::campaign::Campaign;
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::plan::presets;
use abbe_virtual_machine::{ReadingStream, SimulationConfig, TruthRecipe};
use common::{INSTRUMENT, description};
use criterion::{Criterion, criterion_group, criterion_main};
use std::fmt::Write as _;
use std::process::Command;
use std::time::{Duration, Instant};

#[path = "../tests/common/mod.rs"]
mod common;

/// Intervals of the splines: some 215 unknowns.
const INTERVALS: usize = 9;

/// A campaign like the recorded ones, repeated until it has that many readings, made reading by reading.
fn campaign(readings: u64) -> (Machine, Campaign) {
    let truth = TruthRecipe { seed: 1, ..TruthRecipe::default() }.bridge_xyz().unwrap();
    let machine = description(&truth, FunctionKind::BSpline { intervals: INTERVALS });
    let plan = presets::case_like(truth.stroke_m, 7).build().unwrap().repeated_to(readings).unwrap();
    let (environment, effects) = (EnvironmentConfig::constant(), Vec::new());
    let config = SimulationConfig { seed: 7, machine: truth, plan, instrument: INSTRUMENT, environment, effects };
    let mut campaign = Campaign::default();
    for station in &config.plan.stations {
        campaign.stations.push(station.name.clone());
        campaign.lines.extend(station.lines.iter().map(|line| line.name.clone()));
    }
    campaign.readings = ReadingStream::new(&config).unwrap().map(|simulated| simulated.unwrap().reading).collect();
    (machine, campaign)
}

fn run(machine: &Machine, campaign: &Campaign) -> Identified {
    identify(machine, INSTRUMENT.range, campaign, &IdentifyOptions::default(), &mut |_| true).unwrap()
}

/// Median of a few runs (s).
fn median_s(mut work: impl FnMut()) -> f64 {
    let mut times: Vec<Duration> = (0..9)
        .map(|_| {
            let begin = Instant::now();
            work();
            begin.elapsed()
        })
        .collect();
    times.sort();
    times[times.len() / 2].as_secs_f64()
}

/// What a rival printed.
struct Rival {
    seconds: f64,
    unknowns_and_chi2: String,
    /// Values and standard uncertainties of the errors, where it tells them (m, rad).
    curves: Vec<(f64, f64)>,
}

impl Rival {
    fn parse(shown: &str) -> Option<Rival> {
        let pair = |line: &str| line.split_once(' ').and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
        let (first, rest) = shown.trim().split_once('\n').unwrap_or((shown.trim(), ""));
        let (seconds, unknowns_and_chi2) = first.split_once(' ')?;
        let curves = rest.lines().map(pair).collect::<Option<Vec<(f64, f64)>>>()?;
        Some(Rival { seconds: seconds.parse().ok()?, unknowns_and_chi2: unknowns_and_chi2.to_owned(), curves })
    }

    /// Runs a script on the readings, on one core; or why it was not run.
    fn run(script: &str, campaign: &Campaign) -> Result<Rival, String> {
        let file = std::env::temp_dir().join(format!("identify-bench-{}.txt", std::process::id()));
        std::fs::write(&file, readings_text(campaign)).map_err(|error| error.to_string())?;
        let python = std::env::var("ABBE_PYTHON").unwrap_or_else(|_| "python3".to_owned());
        let script = format!("{}/benches/{script}", env!("CARGO_MANIFEST_DIR"));
        let output = Command::new(&python)
            .args(["-B", &script, &file.to_string_lossy(), &INTERVALS.to_string()])
            .envs([("OMP_NUM_THREADS", "1"), ("OPENBLAS_NUM_THREADS", "1"), ("MKL_NUM_THREADS", "1")])
            .output();
        let _ = std::fs::remove_file(&file); // a leftover in the temporary folder does no harm
        let output = output.map_err(|error| format!("{python}: {error}"))?;
        let failure = || String::from_utf8_lossy(&output.stderr).lines().last().unwrap_or("no output").to_owned();
        if !output.status.success() {
            return Err(failure());
        }
        Rival::parse(&String::from_utf8_lossy(&output.stdout)).ok_or_else(failure)
    }
}

fn readings_text(campaign: &Campaign) -> String {
    let mut text = String::new();
    for r in &campaign.readings {
        let ([x, y, z], [a, b, c]) = (r.reading_m, r.offset_m);
        writeln!(text, "{} {x:e} {y:e} {z:e} {a:e} {b:e} {c:e} {:e}", r.station, r.length_m).unwrap();
    }
    text
}

/// Largest difference between our errors and a rival's, and of their uncertainties, in units of our uncertainty.
fn disagreement(found: &Identified, curves: &[(f64, f64)]) -> (f64, f64) {
    let stroke_m = found.model.parts().machine.stroke_m;
    let places = curves.len() / ErrorId::COUNT;
    let mut largest = (0.0_f64, 0.0_f64);
    for (id, curve) in ErrorId::all().zip(curves.chunks(places)) {
        let (lower_m, upper_m) = stroke_m[id.axis().index()];
        for (k, (theirs, their_u)) in curve.iter().enumerate() {
            let (ours, u) = found.model.error(id, lower_m + (upper_m - lower_m) * k as f64 / (places - 1) as f64);
            // Where the gauge makes an error zero there is no uncertainty to compare with.
            if u > 1e-12 {
                largest = (largest.0.max((ours - theirs).abs() / u), largest.1.max((their_u / u - 1.0).abs()));
            }
        }
    }
    largest
}

fn against_scipy(criterion: &mut Criterion) {
    let (machine, campaign) = campaign(1);
    criterion.bench_function("identify/recorded_size", |bencher| bencher.iter(|| run(&machine, &campaign)));
    let found = run(&machine, &campaign);
    let own_s = median_s(|| drop(run(&machine, &campaign)));
    println!(
        "{} readings, {} unknowns, {} passes: {:.1} ms (chi2/dof {:.3})",
        campaign.readings.len(),
        found.evidence.unknowns,
        found.evidence.passes,
        own_s * 1e3,
        found.evidence.chi2_per_dof
    );
    let rivals = [
        ("the same problem, written like the crate", "scipy_identify.py"),
        ("an easier problem, hand-made normal equations", "scipy_lean.py"),
        ("an easier problem, scipy.optimize.least_squares", "scipy_least_squares.py"),
    ];
    for (label, script) in rivals {
        match Rival::run(script, &campaign) {
            Ok(rival) => compare(label, &rival, &found, own_s),
            Err(why) => {
                println!("{script} was not run: {why}; set ABBE_PYTHON to a Python with NumPy and SciPy");
            }
        }
    }
}

fn compare(label: &str, rival: &Rival, found: &Identified, own_s: f64) {
    let (seconds, ratio) = (rival.seconds, rival.seconds / own_s);
    println!(
        "NumPy/SciPy, {label}: {:.1} ms (unknowns, chi2/dof: {}), ratio {ratio:.1}",
        seconds * 1e3,
        rival.unknowns_and_chi2
    );
    if !rival.curves.is_empty() {
        let (errors, uncertainties) = disagreement(found, &rival.curves);
        println!(
            "  errors agree within {errors:.4} of their uncertainty, uncertainties within {:.2} %",
            uncertainties * 1e2
        );
        assert!(errors < 0.1 && uncertainties < 0.1, "the rival does not solve the same problem");
    }
}

/// Largest resident memory of this process so far (MiB), where the system tells.
fn peak_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse::<f64>().ok().map(|kib| kib / 1024.0)
}

fn a_million_readings(_: &mut Criterion) {
    let (machine, campaign) = campaign(1_000_000);
    let begin = Instant::now();
    let found = run(&machine, &campaign);
    println!(
        "{} readings, {} unknowns, {} passes: {:.2} s, peak memory {:.0} MiB",
        campaign.readings.len(),
        found.evidence.unknowns,
        found.evidence.passes,
        begin.elapsed().as_secs_f64(),
        peak_mib().unwrap_or(f64::NAN)
    );
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20).measurement_time(Duration::from_secs(4));
    targets = against_scipy, a_million_readings
}
criterion_main!(benches);
