//! How often the study of runs finds what is there, and finds something where nothing is, by cycles, targets, correlation
//! and gross rows: `cargo run --release -p abbe-diagnose --example study_bench -- SEEDS`.
#![allow(clippy::print_stdout)] // it is a table

#[path = "../tests/common/logger.rs"]
#[allow(dead_code)] // each user takes its part
mod logger;

use abbe_diagnose::study::StudyOptions;
use abbe_diagnose::study::runs::diagnose;
use logger::{Flaw, Plan, logged};

const FLAWS: [(&str, Flaw, &[&str]); 8] = [
    ("nothing", Flaw::Nothing, &[]),
    ("position table 10", Flaw::Graduation(10.0), &["position"]),
    ("reversal 8", Flaw::Play(8.0), &["reversal"]),
    ("reversal by target 10", Flaw::WornNut(10.0), &["reversal value, target", "reversal value, degree"]),
    ("drift 10 a cycle", Flaw::CreepingMount(10.0), &["drift", "warm-up"]),
    ("drift 30 in time", Flaw::Runaway(30.0), &["drift", "warm-up"]),
    ("growing screw 40", Flaw::GrowingScrew(40.0), &["drift"]),
    ("wave 8", Flaw::Wobble(8.0), &["periodic", "position"]),
];

fn main() {
    let seeds = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(20);
    println!("| noise 1 µm, µm given | targets | cycles | rho | gross | found of {seeds} |");
    println!("|---|---|---|---|---|---|");
    for (name, flaw, words) in FLAWS {
        for (targets, cycles) in [(3, 3), (3, 5), (9, 3), (9, 4), (9, 5), (9, 10), (21, 3), (21, 5)] {
            for rho in [0.0, 0.5, 0.9] {
                for gross in [0.0, 0.01] {
                    let plan = Plan { rho, gross, ..Plan::new(targets, cycles) };
                    let is_found = |seed: &u64| {
                        let runs = logged(&plan, &[flaw], 10_000 + seed);
                        let Ok(diagnosis) = diagnose(&runs, &StudyOptions::default()) else { return false };
                        match words {
                            [] => !diagnosis.effects.is_empty(),
                            words => diagnosis.effects.iter().any(|e| words.iter().any(|word| e.name.contains(word))),
                        }
                    };
                    let found = (0..seeds).filter(is_found).count();
                    println!("| {name} | {targets} | {cycles} | {rho} | {gross} | {found} |");
                }
            }
        }
    }
}
