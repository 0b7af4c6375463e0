//! Foreign machines before and after their diagnosis, as a table: `foreign FOLDS FIRST_SEED SEEDS machine:form+form ...`.
//!
//! Place in the flow: how often a diagnosis makes a coordinate worse, or its uncertainty a lie, when the cause is in no list.

#![allow(clippy::unwrap_used, clippy::print_stdout, missing_docs)]

#[path = "../tests/foreign/mod.rs"]
mod foreign;

use abbe_diagnose::DiagnoseOptions;
use foreign::bench::judged;
use foreign::score::Worth;

fn main() {
    let given: Vec<String> = std::env::args().skip(1).collect();
    let number = |k: usize| given[k].parse::<u64>().unwrap();
    let options = DiagnoseOptions { folds: number(0) as usize, placebos: 0, ..DiagnoseOptions::default() };
    println!(
        "case\tseed\trms before>after µm\tcovered\tbeyond rms\tcovered\tchi2 before>after\tfound\tset aside\tseconds"
    );
    for case in &given[3..] {
        let (machine, forms) = case.split_once(':').unwrap();
        let forms: Vec<&str> = forms.split('+').collect();
        for seed in number(1)..number(1) + number(2) {
            let started = std::time::Instant::now();
            let judged = judged(machine, &forms, seed, &options);
            let outcome = judged.outcome();
            let rms = |(a, b): (Worth, Worth)| format!("{:.2}>{:.2}", a.rms_m * 1e6, b.rms_m * 1e6);
            let covered = |(a, b): (Worth, Worth)| {
                format!(
                    "{:.0}({:.0})>{:.0}({:.0})",
                    a.covered * 100.0,
                    a.worst_axis * 100.0,
                    b.covered * 100.0,
                    b.worst_axis * 100.0
                )
            };
            let d = &judged.diagnosis;
            println!(
                "{case}\t{seed}\t{}\t{}\t{}\t{}\t{:.2}>{:.2}\t{}\t{}{}\t{:.0}",
                rms(outcome.inside),
                covered(outcome.inside),
                rms(outcome.beyond),
                covered(outcome.beyond),
                d.before.evidence.chi2_per_dof,
                d.after.evidence.chi2_per_dof,
                judged.names().join(","),
                d.set_aside.len(),
                d.not_adopted.as_ref().map_or(String::new(), |b| format!(" NOT ADOPTED {b}")),
                started.elapsed().as_secs_f64(),
            );
            println!(
                "    unexplained µm {:.2?} {:.2?} noise {:?}",
                d.before.model.parts().quality.unexplained_m.map(|u_m| u_m * 1e6),
                d.model.parts().quality.unexplained_m.map(|u_m| u_m * 1e6),
                d.after.correlation
            );
            if let Some(step) = &d.machine_step {
                println!("    step: evidence {:.0}, {}", step.evidence, step.words());
            }
            if let Some(unseen) = &d.unseen {
                let [before, after] = [&unseen.before, &unseen.after].map(|error| error.rms_m * 1e6);
                println!(
                    "    lines left out µm {before:.2} {after:.2} unexplained {:.2?}",
                    unseen.unexplained_m.map(|u_m| u_m * 1e6)
                );
            }
            if std::env::var("STEPS").is_ok() {
                d.steps.iter().for_each(|step| println!("    {step}"));
            }
        }
    }
}
