//! Laws of judged and averaged kriging, on seeded smooth fields whose truth is known.

#![allow(clippy::unwrap_used, clippy::panic)] // helpers of a test

use abbe_field::kriging::{Kernel, KrigingError, KrigingOptions, Noise, Trend, judge};
use abbe_field::{Interpolator, Kriging, MeasuredField};
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

const OPTIONS: KrigingOptions =
    KrigingOptions { kernel: Kernel::Matern52, trend: Trend::Linear, noise: Noise::DeclaredAndFitted };
const U_M: f64 = 0.3e-6;

fn normal(random: &mut ChaCha8Rng) -> f64 {
    random.sample(StandardNormal)
}

fn place(random: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| random.random_range(0.0..1.0))
}

/// Four sines of several wavelengths a component, some ten micrometres (m).
fn sines(seed: u64) -> impl Fn(&Vector3<f64>) -> Vector3<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut wave = || {
        let along = Vector3::from_fn(|_, _| 2.5 * normal(&mut random));
        (5e-6 * normal(&mut random), along, random.random_range(0.0..6.0))
    };
    let waves: Vec<[(f64, Vector3<f64>, f64); 4]> = (0..3).map(|_| [0; 4].map(|_| wave())).collect();
    move |p| {
        Vector3::from_fn(|d, _| waves[d].iter().map(|(size, along, phase)| size * (p.dot(along) + phase).sin()).sum())
    }
}

/// Vectors of such a field at random places, scattering by `noise_m`, declared `U_M`; what they are drawn with.
fn measured(count: usize, noise_m: f64, seed: u64) -> (Vec<Vector3<f64>>, Vec<Vector3<f64>>, ChaCha8Rng) {
    let truth = sines(seed);
    let mut random = ChaCha8Rng::seed_from_u64(seed + 500);
    let points: Vec<_> = (0..count).map(|_| place(&mut random)).collect();
    let errors = points.iter().map(|p| truth(p) + Vector3::from_fn(|_, _| noise_m * normal(&mut random))).collect();
    (points, errors, random)
}

fn field(points: Vec<Vector3<f64>>, errors: Vec<Vector3<f64>>) -> MeasuredField {
    let u = vec![Vector3::repeat(U_M); points.len()];
    MeasuredField::new(points, errors, Some(u)).unwrap()
}

/// Values in the hull of which twice u holds the truth, and all of them; the largest error (m).
fn held(method: &dyn Interpolator, seed: u64, random: &mut ChaCha8Rng) -> (usize, usize, f64) {
    let truth = sines(seed);
    let (mut inside, mut all, mut largest_m) = (0, 0, 0.0_f64);
    for _ in 0..60 {
        let at = place(random);
        let found = method.at(&at).unwrap();
        let off = found.error_m - truth(&at);
        if found.region.is_inside() {
            inside += (0..3).filter(|d| off[*d].abs() <= 2.0 * found.u_m.unwrap()[*d]).count();
            all += 3;
            largest_m = largest_m.max(off.amax());
        }
    }
    (inside, all, largest_m)
}

#[test]
fn regress_one_gross_vector_bends_nothing_and_is_named() {
    for (seed, gross_m) in [(1, 60e-6), (2, -60e-6), (3, 8e-6)] {
        let (points, mut errors, mut random) = measured(90, U_M, seed);
        errors[17].x += gross_m;
        let field = field(points, errors);
        let (kriging, judgement) = judge(&field, &OPTIONS).unwrap();
        let named: Vec<usize> = judgement.left_out.iter().map(|one| one.index).collect();
        assert_eq!(named, [17], "seed {seed}");
        let one = judgement.left_out[0];
        assert_eq!(one.axis(), "x");
        // The others predict this place to three quarters of a micrometre.
        assert!((one.off_m - gross_m).abs() < 2.5e-6 && one.deviations.abs() > FAR_AT_LEAST, "{one:?}");
        let (inside, all, largest_m) = held(&kriging, seed, &mut random);
        assert!(largest_m < 2e-6 && 100 * inside > 90 * all, "seed {seed}: {inside} of {all}, {largest_m}");
    }
}

/// The least deviations of whatever is left out.
const FAR_AT_LEAST: f64 = 6.0;

#[test]
fn vectors_that_belong_together_stay() {
    for seed in 1..=6 {
        let (points, errors, _) = measured(60, U_M, seed);
        let (_, judgement) = judge(&field(points, errors), &OPTIONS).unwrap();
        assert_eq!((judgement.left_out, judgement.kept.len()), (vec![], 60), "seed {seed}");
        assert_eq!(judgement.contradicted, [None; 3], "seed {seed}");
    }
}

#[test]
fn a_local_feature_of_several_vectors_is_no_gross_error() {
    let (points, mut errors, _) = measured(120, U_M, 4);
    // A dent of 30 µm within a fifth of the volume's extent.
    let middle = Vector3::new(0.5, 0.5, 0.5);
    let dent = |p: &Vector3<f64>| 30e-6 * (-0.5 * (p - middle).norm_squared() / (0.12 * 0.12)).exp();
    let (mut points, mut random) = (points, ChaCha8Rng::seed_from_u64(8));
    for k in 0..8 {
        points[k] = middle + Vector3::from_fn(|_, _| 0.09 * normal(&mut random));
        errors[k] = sines(4)(&points[k]);
    }
    points.iter().zip(&mut errors).for_each(|(p, error)| error.z += dent(p));
    let (_, judgement) = judge(&field(points, errors), &OPTIONS).unwrap();
    assert_eq!(judgement.left_out, vec![]);
}

#[test]
fn many_gross_vectors_are_no_accidents() {
    let (points, mut errors, mut random) = measured(80, U_M, 5);
    (0..8).for_each(|k| errors[10 * k].y += 60e-6 * (1.0 + random.random_range(0.0..1.0)));
    let refused = judge(&field(points, errors), &OPTIONS).unwrap_err();
    let KrigingError::TooManyGross { gross, vectors } = &refused else { panic!("{refused}") };
    // So many hide some of each other; four would be accidents.
    assert!(gross.len() > 4 && gross.iter().all(|one| one.index % 10 == 0) && *vectors == 80, "{refused}");
    assert!(refused.to_string().contains("of 80 vectors contradict"), "{refused}");
}

#[test]
fn scatter_beyond_the_declared_uncertainty_is_told_and_widens() {
    let (points, errors, mut random) = measured(120, 5.0 * U_M, 6);
    let (kriging, judgement) = judge(&field(points, errors), &OPTIONS).unwrap();
    for ratio in judgement.contradicted {
        // Five times, and the scatter of 120 vectors is known to some ten per cent.
        assert!((3.5..6.0).contains(&ratio.unwrap()), "{judgement:?}");
    }
    let (inside, all, _) = held(&kriging, 6, &mut random);
    assert!(100 * inside > 90 * all, "{inside} of {all}");
}

#[test]
fn regress_twice_u_of_few_vectors_holds_the_truth() {
    let (mut averaged, mut likeliest, mut all) = (0, 0, 0);
    for seed in 20..32 {
        let (points, errors, mut random) = measured(12, U_M, seed);
        let field = field(points, errors);
        let (kriging, _) = judge(&field, &OPTIONS).unwrap();
        let (inside, answered, _) = held(&kriging, seed, &mut random.clone());
        let alone = Kriging::fit(&field, &OPTIONS).unwrap();
        likeliest += held(&alone, seed, &mut random).0;
        averaged += inside;
        all += answered;
    }
    // Of some hundred values that depend on each other; the likeliest parameters alone hold four fifths.
    assert!(100 * averaged > 93 * all, "{averaged} of {all}");
    assert!(100 * likeliest < 90 * all, "{likeliest} of {all}: the case must not be trivial");
}

#[test]
fn two_planes_show_no_bend() {
    let at = |k: u32| Vector3::new(f64::from(k % 5), f64::from(k / 5 % 4), f64::from(k / 20)) * 0.2;
    let points: Vec<_> = (0..40).map(at).collect();
    let errors = points.iter().map(sines(1)).collect();
    let refused = judge(&field(points, errors), &OPTIONS).unwrap_err();
    assert_eq!(refused, KrigingError::TwoPlanes { axis: "Z" });
}

#[test]
fn the_same_vectors_give_the_same_bits() {
    let (points, errors, _) = measured(30, U_M, 9);
    let field = field(points, errors);
    let at = Vector3::new(0.4, 0.3, 0.2);
    let [a, b] = [0, 1].map(|_| judge(&field, &OPTIONS).unwrap().0.predict(&at));
    assert_eq!(a, b);
}

/// A wave that is finer than the vectors was taken for their noise: of points beside them 24 to 30 % were within U.
#[test]
fn regress_a_field_finer_than_the_vectors_is_in_the_uncertainty() {
    for (seed, period_m) in [(11, 0.04), (12, 0.08), (13, 0.1)] {
        let (points, mut errors, mut random) = measured(200, U_M, seed);
        let fine = |p: &Vector3<f64>| Vector3::from_fn(|d, _| 1.5e-6 * (std::f64::consts::TAU * p[d] / period_m).sin());
        errors.iter_mut().zip(&points).for_each(|(error, point)| *error += fine(point));
        let (kriging, judgement) = judge(&field(points, errors), &OPTIONS).unwrap();
        let truth = sines(seed);
        let held = (0..300).filter(|_| {
            let at = place(&mut random);
            let (own, actual) = (kriging.predict(&at), truth(&at) + fine(&at));
            (0..3).all(|d| (own.error_m[d] - actual[d]).abs() < 2.0 * own.u_m[d])
        });
        let held = held.count();
        assert!(held > 255, "{seed}: {held} of 300 places within U in all components, {:?}", judgement.contradicted);
        assert!(judgement.contradicted.iter().any(Option::is_some), "{seed}: {:?}", judgement.contradicted);
    }
}
