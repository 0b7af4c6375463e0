//! Laws of the comparison, on a small lattice.

use super::*;
use crate::config::Optimiser;
use crate::simulated::{Character, SimulatedField, random_points_m};
use abbe_field::MeasuredField;

fn lattice() -> Samples {
    let place = |k: usize| Vector3::new((k / 36) as f64 * 0.15, (k / 6 % 6) as f64 * 0.1, (k % 6) as f64 * 0.1);
    SimulatedField::new(Character::Smooth, 1).measured((0..216).map(place).collect(), 2).unwrap()
}

fn quick(rivals: &[Rival]) -> CompareConfig {
    let mut training = Config { seed: 3, ..Config::default() };
    training.network.width = 8;
    training.network.heads = 2;
    training.optimiser = Optimiser { epochs: 3, ..Optimiser::default() };
    CompareConfig { training, seeds: 2, rivals: rivals.to_vec() }
}

#[test]
fn every_method_is_judged_on_the_same_points_and_the_table_repeats() {
    let (field, config) = (lattice(), quick(&Rival::ALL));
    let run = || compare(&Subject::position(&field), &config, &|| 0.0, &mut |_, _| Go::On).unwrap();
    let table = run();
    assert_eq!(table, run());
    let mse = |rival: Rival| table.rows.iter().find(|row| row.rival == rival).and_then(|row| row.mse_um2);
    let zero = mse(Rival::Zero).unwrap();
    assert!(mse(Rival::Kriging).unwrap().mean < zero.mean / 3.0, "{table:?}");
    for row in &table.rows {
        // Where a whole block is missing, the trilinear field has no cell.
        assert!(row.missing.is_some() == (row.seeds.len() < 2), "{row:?}");
        let interval = row.mse_um2.filter(|_| row.missing.is_none());
        assert!(interval.is_none_or(|m| m.mean.is_finite() && m.low.is_some_and(|low| low < m.mean)), "{row:?}");
    }
    let recommended = table.recommendation.unwrap();
    assert!(["kriging", "kriging-network"].contains(&recommended.method.as_str()), "{recommended:?}");
}

#[test]
fn a_comparison_that_is_stopped_keeps_the_seeds_it_has() {
    let config = quick(&[Rival::Zero, Rival::Idw]);
    let table = compare(&Subject::position(&lattice()), &config, &|| 0.0, &mut |_, _| Go::Stop).unwrap();
    assert!(!table.complete && table.rows.iter().all(|row| row.seeds.len() == 1));
}

#[test]
fn intervals_of_a_mean_are_those_of_student() {
    // Three values 1, 2, 3: mean 2, t(0.975, 2) = 4.3027, half width 4.3027 / sqrt(3).
    let found = Interval::of(&[1.0, 2.0, 3.0]).unwrap();
    assert!((found.high.unwrap() - 2.0 - 4.302_65 / 3.0_f64.sqrt()).abs() < 1e-4 && found.mean == 2.0);
    let single = Interval::of(&[1.0]).unwrap();
    assert!(single.low.is_none() && single.high.is_none());
    assert_eq!(Interval::of(&[]), None);
}

#[test]
fn val_liang_2025_table_1_stands_beside_the_methods_it_names() {
    assert_eq!(Rival::Network.published(), Some((0.3249, 0.4104)));
    assert_eq!(Rival::ALL.iter().filter(|rival| rival.published().is_some()).count(), 4);
}

/// Points with a temperature, by all inputs and by their position alone; the residual is multiplied by `factor` of the temperature.
fn warm(seed: u64, factor: fn(f64) -> f64) -> (Samples, Samples) {
    let points = random_points_m(160, seed);
    let temp_c: Vec<f64> = (0..160).map(|k| 18.0 + (k * 37 % 41) as f64 * 0.1).collect();
    let field = SimulatedField::new(Character::Smooth, seed);
    let all = field.measured_with(&points, ("temp_air_c", &temp_c), factor, seed + 50).unwrap();
    let alone = MeasuredField::new(points, all.errors_m().to_vec(), None).unwrap();
    (all, Samples::from(&alone))
}

#[test]
fn an_input_is_recommended_where_it_helps_on_unseen_data_and_not_where_it_is_noise() {
    let config = CompareConfig { seeds: 3, ..quick(&[Rival::Zero, Rival::Kriging]) };
    let of = |seed, factor| {
        let (all, alone) = warm(seed, factor);
        let subject = Subject { inputs: Some(&all), ..Subject::position(&alone) };
        compare(&subject, &config, &|| 0.0, &mut |_, _| Go::On).unwrap()
    };
    for seed in [11, 12, 13] {
        let table = of(seed, |temp_c| temp_c - 20.0);
        assert_eq!(
            table.rows.iter().map(RivalRow::name).collect::<Vec<_>>(),
            ["zero", "kriging (position alone)", "kriging"]
        );
        assert_eq!(table.inputs[3], "temp_air_c");
        let mse = |row: usize| table.rows[row].mse_um2.unwrap().mean;
        println!("seed {seed}, it helps: zero {:.3}, position {:.3}, with {:.3} um2", mse(0), mse(1), mse(2));
        assert!(mse(2) < mse(1) / 3.0 && table.recommendation.unwrap().method == "kriging");
        let table = of(seed, |_| 1.0);
        let mse = |row: usize| table.rows[row].mse_um2.unwrap().mean;
        println!("seed {seed}, it is noise: zero {:.3}, position {:.4}, with {:.4} um2", mse(0), mse(1), mse(2));
        assert!(mse(2) < 1.15 * mse(1));
        assert_eq!(table.recommendation.unwrap().method, "kriging (position alone)");
    }
}

#[test]
fn points_without_a_position_compete_by_their_inputs_and_zero() {
    let (all, _) = warm(14, |temp_c| temp_c - 20.0);
    let names = ["q1_deg", "q2_deg", "q3_deg", "q4_deg"].map(str::to_owned).to_vec();
    let joints = Samples::new(names, all.points().flatten().copied().collect(), all.errors_m().to_vec(), None).unwrap();
    let subject = Subject { alone: None, inputs: Some(&joints), measured: [true; 3] };
    let table =
        compare(&subject, &quick(&[Rival::Zero, Rival::Idw, Rival::Kriging]), &|| 0.0, &mut |_, _| Go::On).unwrap();
    assert_eq!(table.rows.iter().map(RivalRow::name).collect::<Vec<_>>(), ["zero", "kriging"]);
    assert_eq!(table.recommendation.unwrap().method, "kriging");
}
