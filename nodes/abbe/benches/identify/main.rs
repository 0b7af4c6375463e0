//! Identification beside Ceres: whole process against whole process, from the file of readings to errors on disk, on one core.
//!
//! Place in the flow: `cargo bench -p abbe --bench identify`. The campaign is the demo's. `ceres.cpp` is compiled where a C++ compiler and
//! Ceres are installed (Debian: g++, libceres-dev); where not, that is said, and Abbe is timed alone. Abbe also seeks the smoothness of
//! 18 functions, weighs readings robustly and gives the covariance of everything, which the rival does not. Prints medians in ms, the
//! ratio, and how far apart the errors found are.

#![allow(clippy::expect_used)] // a benchmark that cannot run should say so and end

use abbe_files::{ModelFile, read_campaign_file, read_machine, write_campaign};
use abbe_geometry::ErrorId;
use abbe_geometry::machine::Machine;
use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Output};
use std::time::Instant;

const PROGRAM: &str = env!("CARGO_BIN_EXE_abbe");
const REPEATED: usize = 21;
/// As in the machine file.
const INTERVALS: &str = "9";
/// Places at which the rival tells each error.
const PLACES: usize = 21;

fn main() {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch-config");
    let machine_file = shipped.join("machines/bridge_xyz.toml");
    let machine = read_machine(&machine_file).expect("machine file").machine;
    let campaign = read_campaign_file(&shipped.join("demo/campaign.csv.zst"), None).expect("campaign").campaign;
    let folder = tempfile::tempdir().expect("temporary folder");
    let [csv, text, model] = ["campaign.csv", "campaign.txt", "model.json"].map(|name| folder.path().join(name));
    write_campaign(&csv, &campaign).expect("campaign as CSV");
    let mut readings = String::new();
    for r in &campaign.readings {
        let ([x, y, z], [a, b, c]) = (r.reading_m, r.offset_m);
        writeln!(readings, "{} {x:e} {y:e} {z:e} {a:e} {b:e} {c:e} {:e}", r.station, r.length_m).expect("text");
    }
    std::fs::write(&text, readings).expect("campaign as text");
    let own = || {
        let mut command = on_one_core(PROGRAM);
        command
            .arg("identify")
            .arg("--machine")
            .arg(&machine_file)
            .arg("--campaign")
            .arg(&csv)
            .arg("--out")
            .arg(&model);
        command
    };
    let rival = match built(folder.path()) {
        Ok(program) => program,
        Err(why) => {
            let (own_ms, _) = timed(&own);
            println!("abbe identify, {} readings: {own_ms:.1} ms. Ceres was not run: {why}", campaign.readings.len());
            return;
        }
    };
    let theirs = || {
        let mut command = on_one_core(&rival);
        let ends = machine.stroke_m.iter().flat_map(|(low, high)| [low, high]);
        command.arg(&text).args(ends.map(f64::to_string)).arg(INTERVALS);
        command
    };
    // In turns: what else the machine does falls on both.
    let (mut own_ms, mut their_ms, mut printed) = (Vec::new(), Vec::new(), String::new());
    for _ in 0..REPEATED {
        own_ms.push(timed(&own).0);
        let (ms, output) = timed(&theirs);
        their_ms.push(ms);
        printed = String::from_utf8_lossy(&output.stdout).into_owned();
    }
    let (own_ms, their_ms) = (median(own_ms), median(their_ms));
    println!("abbe identify, {} readings: {own_ms:.1} ms", campaign.readings.len());
    let (first, errors) = printed.split_once('\n').expect("first line of the rival");
    println!(
        "Ceres: {their_ms:.1} ms, {:.2} times as long; s of its solver, unknowns, chi2/dof: {first}",
        their_ms / own_ms
    );
    told_apart(&machine, &model, errors);
}

fn on_one_core(program: &str) -> Command {
    let mut command = Command::new("taskset");
    command.args(["--cpu-list", "0", program]).envs([("OMP_NUM_THREADS", "1"), ("OPENBLAS_NUM_THREADS", "1")]);
    command
}

/// Compiles the rival, or why there is none.
fn built(folder: &Path) -> Result<String, String> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/identify/ceres.cpp");
    let program = folder.join("ceres").display().to_string();
    let output = Command::new("g++")
        .args(["-O3", "-std=c++17", "-I/usr/include/eigen3", "-o", &program])
        .arg(source)
        .args(["-lceres", "-lglog"])
        .output()
        .map_err(|error| format!("g++: {error}"))?;
    let first = || String::from_utf8_lossy(&output.stderr).lines().next().unwrap_or_default().to_owned();
    if output.status.success() { Ok(program) } else { Err(format!("{}; install g++ and libceres-dev", first())) }
}

/// Time of a process (ms), and what it printed.
fn timed(command: &impl Fn() -> Command) -> (f64, Output) {
    let begin = Instant::now();
    let output = command().output().expect("taskset and the program start");
    let ms = begin.elapsed().as_secs_f64() * 1e3;
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    (ms, output)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Rms of the differences between both, of shifts and of turns.
fn told_apart(machine: &Machine, model: &Path, errors: &str) {
    let model = ModelFile::load(model).expect("model").0.model;
    let theirs: Vec<f64> = errors.lines().map(|line| line.parse().expect("number of the rival")).collect();
    assert_eq!(theirs.len(), ErrorId::COUNT * PLACES, "the rival tells every error at every place");
    let (mut squares, mut counts) = ([0.0_f64; 2], [0.0_f64; 2]);
    for (id, values) in ErrorId::all().zip(theirs.chunks(PLACES)) {
        let (low, high) = machine.stroke_m[id.axis().index()];
        let kind = usize::from(id.is_angular());
        for (k, value) in values.iter().enumerate() {
            let (own, _) = model.error(id, low + (high - low) * k as f64 / (PLACES - 1) as f64);
            squares[kind] += (own - value).powi(2) * 1e12;
            counts[kind] += 1.0;
        }
    }
    let [shift, turn]: [f64; 2] = std::array::from_fn(|k| (squares[k] / counts[k]).sqrt());
    println!("errors found differ by {shift:.2} µm and {turn:.2} µrad (rms)");
}
