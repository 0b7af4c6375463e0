//! Latency of the residual node's step on one sample, by kind of residual model, in one run.
//!
//! `cargo bench -p abbe-graph --bench residual_step [-- ARTIFACT…]` prints p50, p99 and p99.9 of single calls, as the
//! node makes them, beside a step without a residual model in the same run. Residual models are those that
//! `abbe train` wrote.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A benchmark fails by panicking.

use abbe_files::{LoadedResidual, ResidualFile};
use abbe_graph::step::{GeometricStep, OwnedField, ResidualStep};
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, ScaleReading, Sha256};
use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

const MODEL: Sha256 = Sha256::from_bytes([3; 32]);
const WARM_UP: usize = 2_000;
const CALLS: usize = 100_000;
const PARTS: [f64; 4] = [0.5, 0.99, 0.999, 1.0];

/// Points of a corrected stream all over the volume of the bridge machine.
fn samples() -> Vec<CorrectedCoordinates> {
    let blank = GeometricStep::new(None, 1.0).correct(&ScaleReading::default());
    let at = |k: usize| {
        // Additive recurrence of the plastic number's powers: evenly spread, never on a lattice.
        let share = |factor: f64| (k as f64 * factor).fract();
        [0.8 * share(0.819_172_5), 0.6 * share(0.671_043_6), 0.6 * share(0.549_700_5)]
    };
    let mut samples = vec![blank; 4096];
    for (k, sample) in samples.iter_mut().enumerate() {
        sample.corrected_valid = true;
        sample.corrected_m = at(k);
        sample.status = CorrectionStatus::InVolume;
        sample.model_sha256 = MODEL;
    }
    samples
}

/// Quantiles of single calls (µs).
fn quantiles_us(step: &ResidualStep, samples: &[CorrectedCoordinates]) -> [f64; 4] {
    let mut times_us = Vec::with_capacity(CALLS);
    for (k, sample) in samples.iter().cycle().take(WARM_UP + CALLS).enumerate() {
        let since = Instant::now();
        black_box(step.correct(black_box(sample), None));
        if k >= WARM_UP {
            times_us.push(since.elapsed().as_secs_f64() * 1e6);
        }
    }
    times_us.sort_by(f64::total_cmp);
    PARTS.map(|part| times_us[(part * (times_us.len() - 1) as f64).round() as usize])
}

fn step_of(path: &str) -> ResidualStep {
    let (file, sha256) = ResidualFile::load(Path::new(path)).unwrap();
    let field = Arc::new(LoadedResidual::new(file.model, sha256));
    ResidualStep::new(Some(OwnedField { field, model_sha256: MODEL }), 1.0)
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if !arguments.iter().any(|argument| argument == "--bench") {
        println!("a benchmark; run it with cargo bench -p abbe-graph --bench residual_step -- ARTIFACT…");
        return;
    }
    let files: Vec<&String> = arguments.iter().filter(|argument| !argument.starts_with('-')).collect();
    let samples = samples();
    let mut steps = vec![("none".to_owned(), ResidualStep::default())];
    steps.extend(files.iter().map(|path| (path.to_string(), step_of(path))));
    println!("residual step, µs      p50      p99    p99.9      max");
    for (name, step) in &steps {
        let columns = quantiles_us(step, &samples).map(|us| format!("{us:8.2}")).join(" ");
        println!("{name:18} {columns}");
    }
}
