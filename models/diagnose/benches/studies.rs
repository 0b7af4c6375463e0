//! A study of many rows and many quantities, against refitting each candidate in SciPy in the same run
//! (`cargo bench -p abbe-diagnose --bench studies`).
//!
//! 3600 residual vectors with 20 quantities: positions, time and sixteen logged ones. The study searches six times (on all rows and
//! without each of five parts) and tells its progress; the rival (`scipy_studies.py`) refits every smooth candidate once, which is one
//! step of one search, by `scipy.linalg.lstsq`. Both must name the same winner with the same probability. The rival's interpreter
//! is `ABBE_PYTHON`, else `python3`; without SciPy the comparison says that it was not run. Both are timed by the processor, over
//! all threads, so that other work on the machine counts against neither. A study that believes nothing has one step a search
//! and shows what the tests take.

#![allow(missing_docs, clippy::unwrap_used, clippy::print_stdout)] // a bench that cannot be prepared stops, and prints

use abbe_diagnose::study::vectors::{ResidualVector, diagnose_observed};
use abbe_diagnose::study::{StudyDiagnosis, StudyOptions};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::fmt::Write as _;
use std::process::Command;

const ROWS: usize = 3600;
const LOGGED: usize = 16;
/// Largest difference of the decimal logarithm of the winner's probability, relative: the study weighs the components by
/// deviations that it estimates, the rival by those of the same estimate rounded in the file.
const AGREEMENT: f64 = 0.01;

fn normal(generator: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| generator.random::<f64>()).sum::<f64>() - 6.0
}

fn vectors() -> Vec<ResidualVector> {
    let mut generator = ChaCha8Rng::seed_from_u64(5);
    (0..ROWS)
        .map(|k| {
            let position_m = [0, 1, 2].map(|_| generator.random_range(0.0..0.8));
            let logged: Vec<f64> = (0..LOGGED).map(|_| generator.random_range(-1.0..1.0)).collect();
            let noise = [0, 1, 2].map(|_| normal(&mut generator));
            let residual_m = [
                2e-6 * noise[0] + 0.5e-6 * logged[3],
                3e-6 * noise[1] + 0.8e-6 * logged[5] * logged[6],
                4e-6 * noise[2] + 1e-6 * logged[1] * logged[1],
            ];
            let covariates = logged.iter().enumerate().map(|(k, value)| (format!("q_{k:02}"), *value)).collect();
            ResidualVector { position_m, residual_m, time_s: Some(2.0 * k as f64), covariates, ..Default::default() }
        })
        .collect()
}

/// What the rival says.
struct Rival {
    /// Name and decimal logarithm of the probability of its winner.
    name: String,
    log_p: f64,
    refits: usize,
    /// Of refits, and of the same tests by normal equations.
    seconds: [f64; 2],
}

fn rival(vectors: &[ResidualVector]) -> Result<Rival, String> {
    let mut text = String::new();
    for vector in vectors {
        let figures = vector.residual_m.iter().chain(&vector.position_m).chain(&vector.time_s);
        figures.chain(vector.covariates.values()).for_each(|value| write!(text, "{value:e} ").unwrap());
        text.push('\n');
    }
    let file = std::env::temp_dir().join(format!("abbe_studies_{}.txt", std::process::id()));
    std::fs::write(&file, text).map_err(|error| error.to_string())?;
    let python = std::env::var("ABBE_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let script = format!("{}/benches/scipy_studies.py", env!("CARGO_MANIFEST_DIR"));
    let output =
        Command::new(&python).env("OPENBLAS_NUM_THREADS", "1").args(["-B", &script, &file.to_string_lossy()]).output();
    let _ = std::fs::remove_file(&file); // a leftover in the temporary folder does no harm
    let output = output.map_err(|error| format!("{python}: {error}"))?;
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let mut cells = said.trim().split('\t');
    let mut next = || cells.next().ok_or_else(|| String::from_utf8_lossy(&output.stderr).into_owned());
    let number = |text: &str| text.parse::<f64>().map_err(|error| error.to_string());
    let (name, log_p, refits) = (next()?.to_owned(), number(next()?)?, number(next()?)? as usize);
    Ok(Rival { name, log_p, refits, seconds: [number(next()?)?, number(next()?)?] })
}

/// Time (s) that the processor has spent on this program, as Linux tells it, in hundredths.
fn processor_s() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap();
    let fields: Vec<&str> = text.rsplit(')').next().unwrap().split_whitespace().collect();
    (fields[11].parse::<f64>().unwrap() + fields[12].parse::<f64>().unwrap()) / 100.0
}

fn study(vectors: &[ResidualVector], options: &StudyOptions) -> (StudyDiagnosis, f64, usize) {
    let (since, mut told) = (processor_s(), 0);
    let mut observe = |_| {
        told += 1;
        true
    };
    let diagnosis = diagnose_observed(vectors, None, options, &mut observe).unwrap();
    (diagnosis, processor_s() - since, told)
}

fn main() {
    // `cargo test --benches` only asks whether it starts.
    if std::env::args().any(|argument| argument == "--test") {
        return;
    }
    let vectors = vectors();
    let (diagnosis, seconds, told) = study(&vectors, &StudyOptions::default());
    let names: Vec<&str> = diagnosis.effects.iter().map(|effect| effect.name.as_str()).collect();
    println!(
        "study: {seconds:.1} s of the processor for {ROWS} vectors, {} quantities, {} candidates",
        LOGGED + 4,
        diagnosis.considered.len()
    );
    println!("  found {}; {told} steps of searches, with all that they try and judge", names.join(" + "));
    let (_, seconds, told) = study(&vectors, &StudyOptions { significance: 0.0, ..StudyOptions::default() });
    let step_s = seconds / told as f64;
    println!("  nothing believed: {seconds:.1} s, {told} steps of {step_s:.2} s, noise and gross rows included");
    match rival(&vectors) {
        Err(why) => println!("scipy_studies.py was not run: {why}; set ABBE_PYTHON to a Python with SciPy"),
        Ok(Rival { name, log_p, refits, seconds: [refit_s, by_hand_s] }) => {
            println!(
                "  SciPy, the tests of one step: {refit_s:.1} s for {refits} refits, {:.1} times",
                refit_s / step_s
            );
            println!("  NumPy, the same by normal equations: {by_hand_s:.2} s, {:.1} times", by_hand_s / step_s);
            let least = diagnosis.considered.iter().min_by(|a, b| a.p_value.total_cmp(&b.p_value)).unwrap();
            println!(
                "  least probable: {} at 1e{:.2}; SciPy: {name} at 1e{log_p:.2}",
                least.name,
                least.p_value.log10()
            );
            assert_eq!(least.name, name, "the rival does not solve the same problem");
            assert!((least.p_value.log10() / log_p - 1.0).abs() < AGREEMENT, "nor with the same probability");
        }
    }
}
