//! Laws of the comparison, on a small lattice.

use super::*;
use crate::config::Optimiser;
use crate::simulated::{Character, SimulatedField};

fn lattice() -> MeasuredField {
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
    let run = || compare(&field, &config, &|| 0.0, &mut |_, _| Go::On).unwrap();
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
    let table = compare(&lattice(), &config, &|| 0.0, &mut |_, _| Go::Stop).unwrap();
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
