//! Laws of kriging, on fields drawn from a known process and on smooth ones.

use super::likelihood::{Data, Scaled};
use super::*;
use crate::measured::tests::lattice;
use faer::linalg::solvers::Llt;
use faer::{Mat, Side};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

const OPTIONS: KrigingOptions =
    KrigingOptions { kernel: Kernel::Matern52, trend: Trend::Constant, noise: Noise::Fitted };

fn scatter(count: usize, seed: u64) -> Vec<Vector3<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..count).map(|_| Vector3::from_fn(|_, _| random.random_range(0.0..1.0))).collect()
}

/// Values of a process of known parameters at points (scaled units), without noise.
fn drawn(points: &[Vector3<f64>], kernel: Kernel, length: [f64; 3], seed: u64) -> Vec<f64> {
    let parameters = Scaled { signal: 1.0, length: length.to_vec(), noise: None };
    let count = points.len();
    let covariance = Mat::from_fn(count, count, |i, j| {
        kernel.correlation(parameters.square(points[i].as_slice(), points[j].as_slice()))
            + if i == j { 1e-9 } else { 0.0 }
    });
    let factor = Llt::new(covariance.as_ref(), Side::Lower).unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let white: Vec<f64> = (0..count).map(|_| random.sample(StandardNormal)).collect();
    (0..count).map(|i| (0..=i).map(|j| factor.L()[(i, j)] * white[j]).sum()).collect()
}

fn normal(random: &mut ChaCha8Rng) -> f64 {
    random.sample(StandardNormal)
}

/// Micrometres of error over a metre, with noise of `noise_m`, and the truth without.
fn drawn_field(count: usize, noise_m: f64, seed: u64) -> (MeasuredField, Vec<Vector3<f64>>) {
    let points = scatter(count, seed);
    let length = [0.5, 0.8, 1.5];
    let components = [1, 2, 3].map(|k| drawn(&points, Kernel::Matern52, length, seed * 10 + k));
    let truth: Vec<_> = (0..count).map(|k| Vector3::from_fn(|d, _| components[d][k] * 1e-6)).collect();
    let mut random = ChaCha8Rng::seed_from_u64(seed + 1000);
    let errors = truth.iter().map(|e| e + Vector3::from_fn(|_, _| normal(&mut random)) * noise_m).collect();
    (MeasuredField::new(points, errors, None).unwrap(), truth)
}

/// A smooth field such as a machine makes (m).
fn smooth(p: &Vector3<f64>) -> Vector3<f64> {
    let along = |a: f64| (2.0 * a).sin();
    Vector3::new(along(p.x) + 0.3 * p.y * p.z, along(p.y) * p.x, p.x * p.x - 0.5 * along(p.z)) * 5e-6
}

#[test]
fn the_gradient_of_the_likelihood_is_its_slope() {
    for (kernel, trend) in [
        (Kernel::Matern52, Trend::Linear),
        (Kernel::SquaredExponential, Trend::Constant),
        (Kernel::Matern52, Trend::Zero),
    ] {
        let points = scatter(40, 3);
        let values = drawn(&points, Kernel::Matern52, [0.4, 0.6, 0.9], 5);
        let declared = Some((0..40).map(|k| 1e-3 * (1.0 + f64::from(k))).collect());
        let shares = (trend == Trend::Constant).then(|| (0..40).map(|k| (1.0 + f64::from(k)) / 20.5).collect());
        let points = points.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
        let data = Data { size: 3, points, values, declared, shares, kernel, trend, normal: None };
        let at = [0.2, -0.7, -0.3, 0.4, -1.5];
        let (_, gradient) = data.minus_two_log(&at).unwrap();
        for k in 0..5 {
            let step = 1e-5;
            let moved = |by: f64| {
                let mut there = at;
                there[k] += by;
                data.minus_two_log(&there).unwrap().0
            };
            let slope = (moved(step) - moved(-step)) / (2.0 * step);
            assert!((slope - gradient[k]).abs() < 1e-5 * (1.0 + slope.abs()), "{kernel:?} {trend:?} {k} {slope}");
        }
    }
}

#[test]
fn parameters_of_a_known_process_come_back() {
    let (field, _) = drawn_field(500, 0.1e-6, 7);
    let kriging = Kriging::fit(&field, &OPTIONS).unwrap();
    for fitted in kriging.fitted() {
        let found = &fitted.hyperparameters;
        // One realisation fixes noise to a few per cent, lengths to some ten per cent.
        assert!((found.noise_m.unwrap() / 0.1e-6 - 1.0).abs() < 0.25, "{found:?}");
        for (length, truth) in found.length.iter().zip([0.5, 0.8, 1.5]) {
            assert!((length / truth).ln().abs() < 0.7, "{found:?}");
        }
        assert!(fitted.at_bound.is_empty(), "{fitted:?}");
    }
}

#[test]
fn ninety_five_per_cent_intervals_hold_ninety_five_per_cent() {
    let (mut inside, mut all) = (0, 0);
    for seed in 0..6 {
        let (field, truth) = drawn_field(260, 0.2e-6, seed);
        let known: Vec<usize> = (0..200).collect();
        let kriging = Kriging::fit(&field.part(&known).unwrap(), &OPTIONS).unwrap();
        for k in 200..260 {
            let at = kriging.predict(&field.points_m()[k]);
            let z = (at.error_m - truth[k]).component_div(&at.u_m);
            inside += z.iter().filter(|z| z.abs() < 1.96).count();
            all += 3;
        }
    }
    let share = f64::from(inside as u32) / f64::from(all);
    // 1080 values that depend on each other: twice the binomial deviation of 0.7 %.
    assert!((0.92..0.98).contains(&share), "{share}");
}

#[test]
fn leaving_one_out_is_fitting_without_it() {
    let (field, _) = drawn_field(60, 0.3e-6, 4);
    for trend in [Trend::Constant, Trend::Linear] {
        let options = KrigingOptions { trend, ..OPTIONS };
        let kriging = Kriging::fit(&field, &options).unwrap();
        let parameters = kriging.fitted().clone().map(|fitted| fitted.hyperparameters);
        let rest: Vec<usize> = (0..60).filter(|k| *k != 17).collect();
        let without = Kriging::with_hyperparameters(&field.part(&rest).unwrap(), &options, &parameters).unwrap();
        let there = without.predict(&field.points_m()[17]);
        let (error_m, u_m) = kriging.leave_one_out()[17];
        for d in 0..3 {
            assert!((there.error_m[d] - error_m[d]).abs() < 1e-14, "{trend:?}");
            let noise = parameters[d].noise_m.unwrap();
            assert!((there.u_m[d].hypot(noise) - u_m[d]).abs() < 1e-13, "{trend:?}");
        }
    }
}

#[test]
fn a_smooth_field_is_met_between_its_points_and_marked_beyond_them() {
    let points = lattice([5, 4, 4], 0.25);
    let errors = points.iter().map(smooth).collect();
    let field = MeasuredField::new(points, errors, None).unwrap();
    let kriging = Kriging::fit(&field, &OPTIONS).unwrap();
    let inside = Vector3::new(0.37, 0.4, 0.6);
    let at = kriging.predict(&inside);
    assert!((at.error_m - smooth(&inside)).norm() < 0.1e-6, "{}", at.error_m - smooth(&inside));
    assert_eq!(at.region, Region::Inside);
    assert_eq!(at.error_m, kriging.error_m(&inside));
    let beyond = kriging.predict(&Vector3::new(1.3, 0.4, 0.6));
    assert!(!beyond.region.is_inside() && beyond.u_m.x > 3.0 * at.u_m.x);
}

#[test]
fn declared_uncertainties_weigh_the_points() {
    let points = lattice([5, 4, 4], 0.25);
    let mut errors: Vec<_> = points.iter().map(smooth).collect();
    let mut u = vec![Vector3::repeat(0.05e-6); points.len()];
    // One point is off by 3 µm, and known to be that uncertain.
    errors[31] += Vector3::repeat(3e-6);
    let fit = |u: &[Vector3<f64>]| {
        let field = MeasuredField::new(points.clone(), errors.clone(), Some(u.to_vec())).unwrap();
        let kriging = Kriging::fit(&field, &KrigingOptions { noise: Noise::Declared, ..OPTIONS }).unwrap();
        (kriging.error_m(&points[31]) - smooth(&points[31])).norm()
    };
    let trusted = fit(&u);
    u[31] = Vector3::repeat(5e-6);
    let doubted = fit(&u);
    assert!(trusted > 4e-6 && doubted < 0.5e-6, "{trusted} {doubted}");
}

#[test]
fn how_much_of_the_declared_uncertainty_the_errors_scatter_by_is_found() {
    let points = scatter(300, 5);
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let u: Vec<_> = (0..300).map(|k| Vector3::repeat(1e-6 * (0.2 + f64::from(k % 5)))).collect();
    let mut one = |(p, u): (&Vector3<f64>, &Vector3<f64>)| smooth(p) + u.map(|u| 0.2 * u * normal(&mut random));
    let errors = points.iter().zip(&u).map(&mut one).collect();
    let mean_square = u.iter().map(|u| u.x * u.x).sum::<f64>() / 300.0;
    let field = MeasuredField::new(points, errors, Some(u)).unwrap();
    let kriging = Kriging::fit(&field, &KrigingOptions { noise: Noise::Scaled, ..OPTIONS }).unwrap();
    for fitted in kriging.fitted() {
        let factor = fitted.hyperparameters.noise_m.unwrap() / mean_square.sqrt();
        assert!((factor / 0.2 - 1.0).abs() < 0.15, "{factor}");
    }
}

#[test]
fn the_same_field_gives_the_same_bits() {
    let (field, _) = drawn_field(120, 0.1e-6, 9);
    let [a, b] = [0, 1].map(|_| Kriging::fit(&field, &OPTIONS).unwrap().predict(&Vector3::new(0.4, 0.3, 0.2)));
    assert_eq!(a, b);
}

#[test]
fn what_cannot_be_fitted_is_refused() {
    let points = lattice([4, 3, 3], 0.2);
    let flat = MeasuredField::new(points.clone(), vec![Vector3::repeat(1e-6); 36], None).unwrap();
    assert_eq!(Kriging::fit(&flat, &OPTIONS).unwrap_err(), KrigingError::Constant { component: "x" });
    let errors: Vec<_> = points.iter().map(smooth).collect();
    let field = MeasuredField::new(points.clone(), errors.clone(), None).unwrap();
    let declared = KrigingOptions { noise: Noise::Declared, ..OPTIONS };
    assert_eq!(Kriging::fit(&field, &declared).unwrap_err(), KrigingError::NoiseNotDeclared);
    // No noise to speak of on an infinitely smooth covariance with long scales: singular, and nothing is added to hide it.
    let sure = MeasuredField::new(points, errors, Some(vec![Vector3::repeat(1e-18); 36])).unwrap();
    let long = Hyperparameters { length: vec![40.0; 3], signal_m: 1e-6, noise_m: None };
    let squared = KrigingOptions { kernel: Kernel::SquaredExponential, ..declared };
    let refused = Kriging::with_hyperparameters(&sure, &squared, &[(); 3].map(|()| long.clone())).unwrap_err();
    assert_eq!(refused, KrigingError::NotPositiveDefinite { component: "x" });
    let negative = Hyperparameters { length: vec![0.1, -0.1, 0.1], signal_m: 1e-6, noise_m: None };
    let refused = Kriging::with_hyperparameters(&sure, &squared, &[(); 3].map(|()| negative.clone())).unwrap_err();
    assert_eq!(refused, KrigingError::Parameter { component: "x", what: "a length scale" });
}
