//! Table of all methods on simulated fields of every character: 1000 random points in the volume of Liang 2025, 7:2:1.
//!
//! Place in the flow: evidence for the documents; `cargo run --release -p abbe-residual-training --example compare -- \
//! [--seeds N] [--points N] [--lattice N] [--random] [CHARACTER…]`. Each seed is another field, split and training.

#![allow(clippy::unwrap_used)]

use abbe_residual_training::simulated::{Character, SimulatedField, VOLUME_M, random_points_m};
use abbe_residual_training::{CompareConfig, Comparison, Config, Go, Rival, SplitKind, Subject, compare};
use nalgebra::Vector3;
use std::time::Instant;

fn lattice_m(per_axis: usize) -> Vec<Vector3<f64>> {
    let step = |k: usize, axis: usize| k as f64 / (per_axis - 1) as f64 * VOLUME_M[axis];
    let place = |k: usize| {
        Vector3::new(step(k / per_axis / per_axis, 0), step(k / per_axis % per_axis, 1), step(k % per_axis, 2))
    };
    (0..per_axis.pow(3)).map(place).collect()
}

fn print(name: &str, tables: &[Comparison]) {
    println!(
        "\n{name}\nmethod                mse_um2   mae_um    p95_um  worst_um   train_s  predict_us   of kriging's mse"
    );
    let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
    let kriging =
        tables.iter().filter_map(|t| t.rows.iter().find(|r| r.rival == Rival::Kriging)?.mse_um2.map(|m| m.mean));
    let kriging: Vec<f64> = kriging.collect();
    for rival in &tables[0].config.rivals {
        let rows: Vec<_> =
            tables.iter().filter_map(|t| t.rows.iter().find(|r| r.rival == *rival)?.seeds.first()).collect();
        if rows.len() < tables.len() {
            println!("{:20}  no answer at some points", rival.name());
            continue;
        }
        let ratios: Vec<f64> = rows.iter().zip(&kriging).map(|(r, k)| (r.scores.mse_um2 / k).ln()).collect();
        println!(
            "{:20} {:8.4} {:8.4}  {:8.3}  {:8.3}  {:8.2}  {:10.1}   {:8.2}",
            rival.name(),
            mean(rows.iter().map(|r| r.scores.mse_um2).collect()),
            mean(rows.iter().map(|r| r.scores.mae_um).collect()),
            mean(rows.iter().map(|r| r.scores.error_95_um).collect()),
            mean(rows.iter().map(|r| r.scores.worst_um).collect()),
            mean(rows.iter().map(|r| r.training_s).collect()),
            mean(rows.iter().map(|r| r.prediction_s * 1e6).collect()),
            mean(ratios).exp(),
        );
    }
    for table in tables {
        println!("recommended: {}", table.recommendation.as_ref().map_or("none", |r| &r.why));
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |name: &str| {
        let place = arguments.iter().position(|a| a == name)?;
        arguments.get(place + 1)?.parse::<usize>().ok()
    };
    let (seeds, points) = (number("--seeds").unwrap_or(3), number("--points").unwrap_or(1000));
    let characters = Character::ALL.into_iter().filter(|c| {
        let named = |a: &String| Character::ALL.iter().any(|c| c.name() == a);
        !arguments.iter().any(named) || arguments.iter().any(|a| a == c.name())
    });
    let begin = Instant::now();
    for character in characters {
        let mut tables = Vec::new();
        for seed in 0..seeds as u64 {
            let points_m = number("--lattice").map_or_else(|| random_points_m(points, 1000 + seed), lattice_m);
            let field = SimulatedField::new(character, seed).measured(points_m, 2000 + seed).unwrap();
            let mut training = Config { seed, ..Config::default() };
            if arguments.iter().any(|a| a == "--random") {
                training.split.kind = SplitKind::Random;
            }
            let rivals = Rival::ALL.to_vec();
            let config = CompareConfig { training, seeds: 1, rivals };
            tables.push(
                compare(&Subject::position(&field), &config, &|| begin.elapsed().as_secs_f64(), &mut |_, _| Go::On)
                    .unwrap(),
            );
            eprintln!("{} seed {seed}: {:.0} s", character.name(), begin.elapsed().as_secs_f64());
        }
        print(character.name(), &tables);
    }
}
