//! Speed of identification: the size of the recorded campaigns against NumPy and SciPy, and a million readings.
//!
//! Place in the flow: `cargo bench -p abbe-identify`. Campaigns come from the virtual machine; the rival
//! (`scipy_identify.py`) gets the same readings in a file and times its computing part alone. Its interpreter is
//! `ABBE_PYTHON`, else `python3`; without NumPy and SciPy the comparison says that it was not run.

#![allow(missing_docs, clippy::unwrap_used, clippy::panic)] // criterion's macros; a bench that cannot be prepared stops

use abbe_geometry::error_function::Kind;
use abbe_geometry::machine::Machine;
use abbe_identify::{Identified, Options, identify};
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
    let machine = description(&truth, Kind::BSpline { intervals: INTERVALS });
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
    identify(machine, INSTRUMENT.range, campaign, &Options::default(), &mut |_| true).unwrap()
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

/// Seconds, unknowns and χ² per degree of freedom of the rival, or why it was not run.
fn rival(campaign: &Campaign) -> Result<(f64, String), String> {
    let file = std::env::temp_dir().join(format!("identify-bench-{}.txt", std::process::id()));
    let mut text = String::new();
    for r in &campaign.readings {
        let ([x, y, z], [a, b, c]) = (r.reading_m, r.offset_m);
        writeln!(text, "{} {x:e} {y:e} {z:e} {a:e} {b:e} {c:e} {:e}", r.station, r.length_m).unwrap();
    }
    std::fs::write(&file, text).map_err(|error| error.to_string())?;
    let python = std::env::var("ABBE_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/scipy_identify.py");
    // One core for both.
    let output = Command::new(&python)
        .args([script, &file.to_string_lossy(), &INTERVALS.to_string()])
        .envs([("OMP_NUM_THREADS", "1"), ("OPENBLAS_NUM_THREADS", "1"), ("MKL_NUM_THREADS", "1")])
        .output();
    let _ = std::fs::remove_file(&file); // a leftover in the temporary folder does no harm
    let output = output.map_err(|error| format!("{python}: {error}"))?;
    let shown = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    match shown.split_once(' ').and_then(|(seconds, rest)| Some((seconds.parse().ok()?, rest.to_owned()))) {
        Some(found) if output.status.success() => Ok(found),
        _ => Err(String::from_utf8_lossy(&output.stderr).lines().last().unwrap_or("no output").to_owned()),
    }
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
    match rival(&campaign) {
        Ok((seconds, rest)) => {
            println!("NumPy/SciPy on the same readings: {seconds:.3} s (unknowns, chi2/dof: {rest})");
            println!("ratio: {:.1} times faster", seconds / own_s);
        }
        Err(why) => println!("the rival was not run: {why}; set ABBE_PYTHON to a Python with NumPy and SciPy"),
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
