//! Whether stated uncertainties hold: errors of many simulated spheres and guideways within ±2u.
//!
//! Place in the flow: for the documents too, which quote these figures. Seeded; noise is normal unless a test says other.

use abbe_measurement::guideway::{
    Guideway, GuidewayAxis, GuidewayFrame, GuidewayOptions, GuidewayRotation, StrayTarget, TargetPoint,
};
use abbe_measurement::sphere::{SphereFit, SphereRadius};
use abbe_measurement::tracker::{TrackerReading, TrackerUncertainty};
use nalgebra::{Matrix3, Rotation3, Vector3, Vector6};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Coverage that is asked for. Of 400 spheres and four figures each, 95.45 % come out as 95.45 ± 0.6 %: a figure that is as it should
/// be falls below this once in ten thousand times.
const ASKED: f64 = 0.93;
const NOISE_M: f64 = 0.5e-6;
const RADIUS_M: f64 = 0.0125;
const SPHERES: u64 = 400;

/// Points at random on a cap of this half angle (rad), off along the radius by normal noise.
fn probed(generator: &mut ChaCha8Rng, count: usize, half_angle: f64) -> Vec<Vector3<f64>> {
    let mut point = || {
        let up = 1.0 - generator.random::<f64>() * (1.0 - half_angle.cos());
        let around = std::f64::consts::TAU * generator.random::<f64>();
        let across = (1.0 - up * up).sqrt();
        let noise: f64 = StandardNormal.sample(generator);
        let direction = Vector3::new(across * around.cos(), across * around.sin(), up);
        Vector3::new(0.3, 0.2, 0.15) + direction * (RADIUS_M + NOISE_M * noise)
    };
    (0..count).map(|_| point()).collect()
}

/// Share of coordinates and radii within ±2u, and the same without widening.
fn of_spheres(count: usize, half_angle: f64, u_m: Option<f64>) -> (f64, f64) {
    let (mut held, mut bare, mut all) = (0, 0, 0);
    for seed in 0..SPHERES {
        let mut generator = ChaCha8Rng::seed_from_u64(1000 * count as u64 + seed);
        let points_m = probed(&mut generator, count, half_angle);
        // Random points may lie too near to each other to fix a sphere; that is refused, and no figure.
        let Ok((fit, _)) = SphereFit::without_strays(&points_m, SphereRadius::Free, u_m) else { continue };
        let off = fit.centre_m - Vector3::new(0.3, 0.2, 0.15);
        let widening = fit.claim.unwrap().widening;
        for (error_m, u_m) in [off.x, off.y, off.z, fit.radius_m - RADIUS_M].into_iter().zip(fit.u_m().unwrap()) {
            held += usize::from(error_m.abs() <= 2.0 * u_m);
            bare += usize::from(error_m.abs() <= 2.0 * u_m / widening);
            all += 1;
        }
    }
    assert!(all > 4 * SPHERES as usize * 9 / 10, "{all}");
    (held as f64 / all as f64, bare as f64 / all as f64)
}

#[test]
fn spheres_hold_what_they_state_with_few_points_and_a_noise_declared_too_small() {
    for half_angle in [1.57, 0.5] {
        for count in [5, 7, 10, 25] {
            for (name, u_m) in [("right", Some(NOISE_M)), ("half", Some(0.5 * NOISE_M)), ("not", None)] {
                let (held, bare) = of_spheres(count, half_angle, u_m);
                println!("{half_angle} rad, {count} points, declared {name}: {held:.3}, without widening {bare:.3}");
                assert!(held >= ASKED, "{half_angle} rad, {count} points, declared {name}: {held}");
            }
        }
    }
}

const TRACKER: TrackerUncertainty = TrackerUncertainty {
    range_constant_m: 0.5e-6,
    range_per_metre: 0.5e-6,
    transverse_constant_m: 5e-6,
    transverse_per_metre: 2e-6,
};
const GROSS_M: f64 = 1e-4;
const AXIS_M: f64 = 0.1;
const PLACES: usize = 9;
const OPTIONS: GuidewayOptions = GuidewayOptions {
    axis: GuidewayAxis::X,
    frame: GuidewayFrame::Given,
    rotation: GuidewayRotation::Exact,
    reference_m: None,
};

/// A table of targets on an axis, seen by a tracker at the origin.
struct Axis {
    points: Vec<TargetPoint>,
    truth: Vec<Vector6<f64>>,
    /// Points with a gross error.
    gross: Vec<usize>,
}

/// Which readings are gross, by position, target and a number from 0 to 1 drawn for each.
type IsGross<'a> = &'a dyn Fn(usize, usize, f64) -> bool;

fn axis(seed: u64, targets: usize, is_gross: IsGross) -> Axis {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let generator = &mut generator;
    let mut even = |half: f64| half * (2.0 * generator.random::<f64>() - 1.0);
    let arms_m: Vec<Vector3<f64>> = (0..targets).map(|_| Vector3::from_fn(|_, _| even(0.2))).collect();
    let size = Vector6::from_fn(|i, _| even(if i < 3 { 10e-6 } else { 30e-6 }));
    let centre_m = Vector3::new(-1.4, 0.85, -0.3);
    let mean_m = arms_m.iter().sum::<Vector3<f64>>() / targets as f64;
    let mut axis = Axis { points: Vec::new(), truth: Vec::new(), gross: Vec::new() };
    for k in 0..PLACES {
        let position_m = AXIS_M * k as f64;
        let errors =
            size.map_with_location(|i, _, size| size * (3.0 * position_m + i as f64).sin() - size * (i as f64).sin());
        let turn = Rotation3::new(errors.fixed_rows::<3>(3).into_owned());
        for (j, arm_m) in arms_m.iter().enumerate() {
            let shift_m = Vector3::new(position_m, 0.0, 0.0) + errors.fixed_rows::<3>(0);
            let true_m = centre_m + mean_m + shift_m + turn * (arm_m - mean_m);
            let reading = TrackerReading::of_point(&true_m).unwrap();
            let covariance_m2 = TRACKER.covariance_m2(&reading);
            let factor = covariance_m2.cholesky().unwrap().l();
            let normal = Vector3::from_fn(|_, _| -> f64 { StandardNormal.sample(generator) });
            let mut point_m = true_m + factor * normal;
            let sign = if generator.random::<bool>() { GROSS_M } else { -GROSS_M };
            if is_gross(k, j, generator.random()) {
                point_m += true_m.normalize() * sign;
                axis.gross.push(axis.points.len());
            }
            let target = format!("T{j}");
            axis.points.push(TargetPoint { position_m, target, point_m, covariance_m2: Some(covariance_m2) });
        }
        axis.truth.push(errors);
    }
    axis
}

/// How many errors are within ±2u, and all.
fn held(solved: &Guideway, truth: &[Vector6<f64>], is_widened: bool) -> (usize, usize) {
    let (mut held, mut all) = (0, 0);
    for (position, truth) in solved.positions.iter().zip(truth) {
        let (Some(u), Some(widening)) = (Guideway::u(position), position.widening) else { continue };
        let factor = if is_widened { 2.0 } else { 2.0 / widening };
        for k in 0..6 {
            held += usize::from((position.errors[k] - truth[k]).abs() <= factor * u[k]);
            all += 1;
        }
    }
    (held, all)
}

/// Axes for each plan.
const AXES: u64 = 60;

/// Coverage with strays left out and u widened, without both, and how many gross readings were found of all.
fn of_axes(targets: usize, factor: f64, is_gross: IsGross) -> (f64, f64, [usize; 3]) {
    let (mut with, mut without, mut found) = ((0, 0), (0, 0), [0; 3]);
    for seed in 0..AXES {
        let mut axis = axis(seed, targets, is_gross);
        let scaled = |c: Matrix3<f64>| c * (factor * factor);
        axis.points.iter_mut().for_each(|point| point.covariance_m2 = point.covariance_m2.map(scaled));
        let (solved, strays) = Guideway::without_strays(&axis.points, OPTIONS).unwrap();
        let of = held(&solved, &axis.truth, true);
        with = (with.0 + of.0, with.1 + of.1);
        let of = held(&Guideway::new(&axis.points, OPTIONS).unwrap(), &axis.truth, false);
        without = (without.0 + of.0, without.1 + of.1);
        let is_found = |stray: &&StrayTarget| axis.gross.contains(&stray.point);
        let right = strays.iter().filter(is_found).count();
        found = [found[0] + right, found[1] + axis.gross.len(), found[2] + strays.len() - right];
    }
    (with.0 as f64 / with.1 as f64, without.0 as f64 / without.1 as f64, found)
}

#[test]
fn guideways_hold_what_they_state_with_gross_readings_and_a_noise_declared_too_small() {
    for (name, share) in [("no", 0.0), ("2 %", 0.02)] {
        for targets in [3, 4, 6] {
            for factor in [1.0, 0.5] {
                let (with, without, [right, all, wrong]) = of_axes(targets, factor, &|_, _, drawn| drawn < share);
                println!(
                    "{targets} targets, {name} gross, declared {factor} times: {with:.3}, before {without:.3}; found {right} of {all}, {wrong} others"
                );
                // Of three targets a gross reading shows in three of nine coordinates only, and nothing names it.
                let asked = if targets == 3 && share > 0.0 { 0.9 } else { ASKED };
                assert!(with >= asked, "{targets} targets, {name} gross, declared {factor} times: {with}");
            }
        }
    }
}
