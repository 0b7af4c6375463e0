//! Evidence for JADE: standard functions, its laws, and what it refuses.

use abbe_identify::jade::{
    Bounds, Ended, JadeError, JadeOptions, Minimum, minimise, perturbed_population, uniform_population,
};
use std::f64::consts::{E, TAU};

fn sphere(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum()
}

fn rosenbrock(x: &[f64]) -> f64 {
    x.windows(2).map(|w| 100.0 * (w[1] - w[0] * w[0]).powi(2) + (1.0 - w[0]).powi(2)).sum()
}

fn rastrigin(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v - 10.0 * (TAU * v).cos() + 10.0).sum()
}

fn ackley(x: &[f64]) -> f64 {
    let n = x.len() as f64;
    let waves = x.iter().map(|v| (TAU * v).cos()).sum::<f64>() / n;
    20.0 + E - 20.0 * (-0.2 * (sphere(x) / n).sqrt()).exp() - waves.exp()
}

/// f₄ of the source: the largest magnitude, which has no derivative at its minimum.
fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |most, v| most.max(v.abs()))
}

fn search(function: fn(&[f64]) -> f64, bounds: &Bounds, members: usize, options: &JadeOptions) -> Minimum {
    let first = uniform_population(bounds, members, options.seed).unwrap();
    minimise(&function, first, Some(bounds), options, &mut |_| true).unwrap()
}

#[test]
fn standard_functions_of_the_source_are_solved_from_anywhere() {
    // Functions f1, f4, f5, f9 and f10 of the source with its bounds, in a third of its dimensions.
    type Case = (&'static str, fn(&[f64]) -> f64, f64, usize, f64);
    let cases: [Case; 5] = [
        ("sphere", sphere, 100.0, 10, 1e-8),
        ("largest", largest, 100.0, 10, 1e-6),
        ("rosenbrock", rosenbrock, 30.0, 10, 1e-6),
        ("rastrigin", rastrigin, 5.12, 10, 1e-6),
        ("ackley", ackley, 32.0, 10, 1e-6),
    ];
    for (name, function, half_width, dimension, tolerance) in cases {
        for (seed, archive) in [(1, true), (2, false), (3, true)] {
            let options = JadeOptions { seed, archive, agreement: 1e-10, parallel: false, ..JadeOptions::default() };
            let found = search(function, &vec![(-half_width, half_width); dimension], 60, &options);
            assert_eq!(found.ended, Ended::Agreed, "{name} {seed}");
            assert!(found.value < tolerance, "{name} {seed}: {}", found.value);
        }
    }
}

#[test]
fn regress_sphere_of_30_under_the_conditions_of_the_source() {
    // f1 of the source with its D = 30, NP = 100 and 1500 generations; ours with archive ends near 1e-55. A wrong
    // adaptation of F or CR costs tens of orders.
    let options = JadeOptions { agreement: 0.0, max_generations: 1500, parallel: false, ..JadeOptions::default() };
    let found = search(sphere, &[(-100.0, 100.0); 30], 100, &options);
    assert!(found.value < 1e-45, "{:e}", found.value);
}

#[test]
fn the_outcome_depends_on_the_seed_and_on_nothing_else() {
    let run = |seed, parallel| {
        let options = JadeOptions { seed, parallel, max_generations: 60, ..JadeOptions::default() };
        search(rastrigin, &[(-5.0, 5.0); 6], 30, &options)
    };
    assert_eq!(run(4, false), run(4, false));
    assert_eq!(run(4, true), run(4, false));
    assert_ne!(run(5, false).point, run(4, false).point);
}

#[test]
fn the_best_value_never_rises_and_a_stop_keeps_it() {
    let bounds = [(-5.0, 5.0); 6];
    let first = uniform_population(&bounds, 30, 1).unwrap();
    let (mut seen, mut last) = (Vec::new(), Vec::new());
    let found = minimise(&rastrigin, first, Some(&bounds), &JadeOptions::default(), &mut |generation| {
        assert_eq!(generation.number, seen.len() + 1);
        assert_eq!(generation.evaluations, 30 * (generation.number + 1));
        assert!((0.0..=1.0).contains(&generation.mean_f) && (0.0..=1.0).contains(&generation.mean_cr));
        seen.push(generation.best_value);
        last = generation.best.to_vec();
        generation.number < 25
    });
    let found = found.unwrap();
    assert_eq!((found.ended, found.generations), (Ended::Stopped, 25));
    assert!(seen.windows(2).all(|w| w[1] <= w[0]));
    assert_eq!(found.point, last);
    assert_eq!(found.value, rastrigin(&last));
}

#[test]
fn too_few_generations_are_not_called_a_minimum() {
    let options = JadeOptions { max_generations: 3, ..JadeOptions::default() };
    assert_eq!(search(rosenbrock, &[(-30.0, 30.0); 10], 40, &options).ended, Ended::OutOfGenerations);
}

#[test]
fn places_where_the_function_is_infinite_are_left_and_nan_is_an_error() {
    let half = |x: &[f64]| if x[0] < 0.3 { f64::INFINITY } else { sphere(x) };
    let bounds = [(-1.0, 1.0); 2];
    let first = uniform_population(&bounds, 20, 1).unwrap();
    let found = minimise(&half, first.clone(), Some(&bounds), &JadeOptions::default(), &mut |_| true).unwrap();
    assert_eq!(found.ended, Ended::Agreed);
    assert!((found.point[0] - 0.3).abs() < 1e-4 && found.point[1].abs() < 1e-3, "{found:?}");
    let nan = |x: &[f64]| if x[0] < 0.3 { f64::NAN } else { sphere(x) };
    let refused = minimise(&nan, first, Some(&bounds), &JadeOptions::default(), &mut |_| true).unwrap_err();
    assert!(matches!(refused, JadeError::NotANumber { ref point } if point[0] < 0.3), "{refused}");
}

#[test]
fn bad_populations_bounds_and_options_are_refused() {
    let run = |first: Vec<Vec<f64>>, bounds: Option<&Bounds>, options: JadeOptions| {
        minimise(&sphere, first, bounds, &options, &mut |_| true).unwrap_err()
    };
    let usual = JadeOptions::default();
    let four = vec![vec![0.1, 0.2]; 4];
    assert_eq!(run(Vec::new(), None, usual), JadeError::TooFewMembers(0));
    assert_eq!(run(vec![vec![0.0]; 3], None, usual), JadeError::TooFewMembers(3));
    assert_eq!(run(vec![Vec::new(); 4], None, usual), JadeError::Length { member: 1, found: 0, expected: 1 });
    let mut uneven = four.clone();
    uneven[2].push(1.0);
    assert_eq!(run(uneven, None, usual), JadeError::Length { member: 3, found: 3, expected: 2 });
    let mut broken = four.clone();
    broken[1][1] = f64::NAN;
    assert!(matches!(run(broken, None, usual), JadeError::Outside { member: 2, number: 2, .. }));
    let outside = run(four.clone(), Some(&[(0.0, 1.0), (0.5, 1.0)]), usual);
    assert_eq!(outside, JadeError::Outside { member: 1, number: 2, value: 0.2 });
    assert!(matches!(run(four.clone(), Some(&[(0.0, 1.0), (1.0, 1.0)]), usual), JadeError::Bounds { number: 2, .. }));
    for options in [
        JadeOptions { greediness: 0.0, ..usual },
        JadeOptions { greediness: f64::NAN, ..usual },
        JadeOptions { adaptation: 1.5, ..usual },
        JadeOptions { agreement: -1.0, ..usual },
        JadeOptions { max_generations: 0, ..usual },
    ] {
        assert!(matches!(run(four.clone(), None, options), JadeError::Option { .. }), "{options:?}");
    }
    assert!(uniform_population(&[(0.0, f64::INFINITY)], 10, 1).is_err());
    assert!(uniform_population(&[(f64::NAN, 1.0)], 10, 1).is_err());
    assert!(perturbed_population(&[0.0], &[0.0], 10, 1).is_err());
    assert!(perturbed_population(&[0.0], &[1.0, 1.0], 10, 1).is_err());
}

#[test]
fn a_perturbed_population_scatters_about_the_estimate_as_asked() {
    let population = perturbed_population(&[5.0, -2.0], &[0.1, 3.0], 2000, 9).unwrap();
    for (k, (centre, deviation)) in [(5.0, 0.1), (-2.0, 3.0)].into_iter().enumerate() {
        let square = population.iter().map(|m| (m[k] - centre) * (m[k] - centre)).sum::<f64>() / 2000.0;
        // The variance of 2000 normal deviates scatters by 3 %; five of these.
        assert!((square.sqrt() / deviation - 1.0).abs() < 0.08);
    }
}
