//! Speed of diagnosis: the score pass against refitting every candidate in SciPy, and a whole diagnosis.
//!
//! Place in the flow: `cargo bench -p abbe-diagnose`. A campaign like the recorded ones, with backlash in it, comes from
//! the virtual machine. The rival `scipy_refit.py` gets the same whitened Jacobian, residuals and candidate columns in a
//! file and refits the linear model with each candidate added (`scipy.linalg.lstsq`, and `cho_solve` on the normal
//! equations as the faster way), which is what "try every effect" costs without a score test; its reductions of χ² must
//! be ours. The interpreter is `ABBE_PYTHON`, else `python3`; without SciPy the comparison says that it was not run.

#![allow(missing_docs, clippy::unwrap_used, clippy::panic)] // criterion's macros; a bench that cannot be prepared stops

#[path = "../tests/common/mod.rs"]
mod common;

use abbe_diagnose::{DiagnoseOptions, score_pass};
use abbe_geometry::effects::construct;
use abbe_identify::{Identified, Rows, identify};
use common::{Case, INSTRUMENT};
use criterion::{Criterion, criterion_group, criterion_main};
use std::io::Write;
use std::process::Command;
use std::time::Instant;

fn fitted(case: &Case) -> Identified {
    let options = DiagnoseOptions::default().identify;
    identify(&case.machine, INSTRUMENT.range, &case.simulated.campaign, &options, &mut |_| true).unwrap()
}

/// Median of some runs (s).
fn median_s(runs: usize, mut work: impl FnMut()) -> f64 {
    let mut times: Vec<f64> = (0..runs)
        .map(|_| {
            let begin = Instant::now();
            work();
            begin.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[runs / 2]
}

/// Sizes, Jacobian, residuals, then for each candidate its width, our reduction and its columns: doubles in a row.
fn write_problem(path: &std::path::Path, case: &Case, fit: &Identified) -> usize {
    let rows = Rows::new(fit, INSTRUMENT.range, &case.simulated.campaign);
    let scored = score_pass(fit, INSTRUMENT.range, &case.simulated.campaign, &DiagnoseOptions::default()).unwrap();
    let mut file = std::io::BufWriter::new(std::fs::File::create(path).unwrap());
    let mut put = |value: f64| file.write_all(&value.to_le_bytes()).unwrap();
    let (count, parameters) = (rows.len(), rows.parameters.len());
    [count, parameters, scored.len()].into_iter().for_each(|size| put(size as f64));
    (0..parameters).for_each(|j| (0..count).for_each(|k| put(rows.jacobian[(k, j)])));
    rows.residuals.iter().for_each(|r| put(*r));
    for candidate in &scored {
        let effect = construct(candidate.name, &candidate.shape, &case.machine).unwrap();
        let columns = rows.columns(effect.as_ref()).unwrap();
        put(columns.ncols() as f64);
        put(if candidate.score.degrees == columns.ncols() { candidate.score.reduction } else { -1.0 });
        (0..columns.ncols()).for_each(|j| (0..count).for_each(|k| put(columns[(k, j)])));
    }
    scored.len()
}

fn against_scipy(case: &Case, fit: &Identified) {
    let folder = std::env::temp_dir().join(format!("abbe-diagnose-bench-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("problem.f64");
    let candidates = write_problem(&path, case, fit);
    let campaign = &case.simulated.campaign;
    let pass = || drop(score_pass(fit, INSTRUMENT.range, campaign, &DiagnoseOptions::default()).unwrap());
    let own_s = median_s(7, pass);
    println!("score pass: {candidates} candidates, {} readings: {:.0} ms", campaign.readings.len(), own_s * 1e3);
    let python = std::env::var("ABBE_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/scipy_refit.py");
    let rival = Command::new(python).arg(script).arg(&path).output();
    match rival {
        Ok(output) if output.status.success() => {
            for line in String::from_utf8_lossy(&output.stdout).lines() {
                let (name, seconds) = line.rsplit_once(' ').unwrap();
                let seconds: f64 = seconds.parse().unwrap();
                println!("{name}: {seconds:.2} s, {:.1} times the score pass", seconds / own_s);
            }
        }
        Ok(output) => println!("SciPy was not compared: {}", String::from_utf8_lossy(&output.stderr)),
        Err(error) => println!("SciPy was not compared: {error}"),
    }
    std::fs::remove_dir_all(&folder).unwrap();
    println!("whole diagnosis: {:.1} s", median_s(1, || drop(case.diagnose_with(&DiagnoseOptions::default()))));
}

fn bench(criterion: &mut Criterion) {
    let case = Case::new(1, &["backlash axis=y size_um=1.5"]);
    let fit = fitted(&case);
    against_scipy(&case, &fit);
    let campaign = &case.simulated.campaign;
    let mut group = criterion.benchmark_group("diagnose");
    group.sample_size(10);
    group.bench_function("score pass", |b| {
        b.iter(|| score_pass(&fit, INSTRUMENT.range, campaign, &DiagnoseOptions::default()).unwrap());
    });
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
