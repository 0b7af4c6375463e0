//! The sphere fit against hand cases, SciPy, and its own uncertainty.

use super::*;

/// Directions spread evenly over a cap of this half angle (rad): a spiral with equal steps in height.
fn cap(count: usize, half_angle_rad: f64) -> Vec<Vector3<f64>> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let direction = |k: usize| {
        let share = (k as f64 + 0.5) / count as f64;
        let up = 1.0 - share * (1.0 - half_angle_rad.cos());
        let across = (1.0 - up * up).max(0.0).sqrt();
        Vector3::new(across * (golden * k as f64).cos(), across * (golden * k as f64).sin(), up)
    };
    (0..count).map(direction).collect()
}

/// Deterministic noise of unit variance (uniform on ±√3), without a random number generator.
fn noise(seed: u64, k: usize) -> f64 {
    let mut state = (seed << 32 | k as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1B5_4A32_D192_ED03;
    for _ in 0..3 {
        state = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        state ^= state >> 27;
    }
    12f64.sqrt() * ((state >> 11) as f64 / (1u64 << 53) as f64 - 0.5)
}

const CENTRE_M: [f64; 3] = [0.412, -0.233, 0.871];

fn sphere(directions: &[Vector3<f64>], radius_m: f64, sigma_m: f64, seed: u64) -> Vec<Vector3<f64>> {
    let at = |(k, n): (usize, &Vector3<f64>)| Vector3::from(CENTRE_M) + n * (radius_m + sigma_m * noise(seed, k));
    directions.iter().enumerate().map(at).collect()
}

fn free(points_m: &[Vector3<f64>]) -> SphereFit {
    SphereFit::new(points_m, SphereRadius::Free, None).unwrap()
}

/// SciPy 1.x `least_squares` with all tolerances 1e-15 on the same eight points; its differences are numerical.
const SCIPY_MM: f64 = 2e-8;

#[test]
fn val_scipy_least_squares_gives_the_same_sphere() {
    const POINTS_MM: [[f64; 3]; 8] = [
        [122.551, -43.373, 60.13],
        [108.532, -32.658, 57.342],
        [116.577, -25.11, 58.671],
        [119.407, -31.713, 62.581],
        [119.865, -30.582, 62.28],
        [109.193, -31.115, 57.619],
        [119.921, -35.002, 62.959],
        [109.641, -38.619, 58.213],
    ];
    let points_m: Vec<_> = POINTS_MM.iter().map(|p| Vector3::from(*p) / 1e3).collect();
    let fit = free(&points_m);
    let expected = Vector3::new(119.951299901, -35.023700771, 48.032942245);
    assert!((fit.centre_m * 1e3 - expected).norm() < SCIPY_MM, "{:?}", fit.centre_m);
    assert!((fit.radius_m * 1e3 - 14.926817336).abs() < SCIPY_MM);
    // Theirs are without Student's factor.
    let widening = fit.claim.unwrap().widening;
    for (u_m, expected) in fit.u_m().unwrap().iter().zip([0.0070721, 0.0041513, 0.0169716, 0.0152746]) {
        assert!((u_m * 1e3 / widening - expected).abs() < 1e-6, "{u_m} {expected}");
    }
    let known = SphereRadius::Known { radius_m: 14.985e-3, u_m: 0.0 };
    let centre_mm = SphereFit::new(&points_m, known, None).unwrap().centre_m * 1e3;
    assert!((centre_mm - Vector3::new(119.974452493, -35.021271534, 47.968784892)).norm() < SCIPY_MM);
}

/// Six points on the axes: JᵀJ = diag(2, 2, 2, 6), so u(centre) = σ/√2 and u(radius) = σ/√6.
#[test]
fn six_points_on_the_axes_have_the_uncertainties_of_the_hand_case() {
    let directions: Vec<_> = (0..6).map(|k| Vector3::ith(k / 2, if k % 2 == 0 { 1.0 } else { -1.0 })).collect();
    let fit = SphereFit::new(&sphere(&directions, 0.015, 0.0, 0), SphereRadius::Free, Some(1e-6)).unwrap();
    assert!((fit.centre_m - Vector3::from(CENTRE_M)).norm() < 1e-15 && (fit.radius_m - 0.015).abs() < 1e-15);
    let u_m = fit.u_m().unwrap();
    assert!(u_m[..3].iter().all(|u| (u - 1e-6 / 2f64.sqrt()).abs() < 1e-15), "{u_m:?}");
    assert!((u_m[3] - 1e-6 / 6f64.sqrt()).abs() < 1e-15);
    assert!((fit.condition - 1.0).abs() < 1e-9 && fit.degrees_of_freedom == 2);
}

/// The smaller the cap, the less its radius can be told from its height: the condition grows as 1/θ².
#[test]
fn a_smaller_cap_is_reported_as_worse() {
    let at = |half_angle: f64| free(&sphere(&cap(200, half_angle), 0.015, 1e-7, 3));
    let (wide, narrow) = (at(0.4), at(0.1));
    let ratio = narrow.condition / wide.condition;
    assert!((12.0..20.0).contains(&ratio), "{ratio}");
    assert!(narrow.u_m().unwrap()[3] > 10.0 * wide.u_m().unwrap()[3]);
    assert!(free(&sphere(&cap(200, std::f64::consts::PI), 0.015, 0.0, 0)).condition < 1.01);
    for half_angle in [1e-2, 1e-3] {
        let exact = free(&sphere(&cap(200, half_angle), 0.015, 0.0, 0));
        // Rounding of coordinates of a metre, 1e-16 m, is magnified by the condition.
        assert!((exact.radius_m - 0.015).abs() < 1e-15 * exact.condition, "{half_angle} {}", exact.radius_m);
    }
}

/// Reported covariance against the scatter over 400 spheres: the mean of 4 squared deviations has sd √(8/400) = 0.14.
#[test]
fn the_covariance_holds_what_it_says() {
    for known in [false, true] {
        let mut total = 0.0;
        for seed in 0..400 {
            // The radius calibrated with an error that its uncertainty states.
            let u_m = 2e-6;
            let radius_m = 0.0125 + u_m * noise(seed, 1000);
            let radius = if known { SphereRadius::Known { radius_m, u_m } } else { SphereRadius::Free };
            let fit = SphereFit::new(&sphere(&cap(60, 1.2), 0.0125, 5e-6, seed), radius, Some(5e-6)).unwrap();
            let off = fit.centre_m - Vector3::from(CENTRE_M);
            let off = Vector4::new(off.x, off.y, off.z, fit.radius_m - 0.0125);
            total += (fit.covariance_m2.unwrap().try_inverse().unwrap() * off).dot(&off);
        }
        let mean = total / 400.0;
        assert!((mean - 4.0).abs() < 5.0 * 0.14, "known {known}: {mean}");
    }
}

#[test]
fn the_result_moves_and_grows_with_the_points() {
    let points_m = sphere(&cap(40, 1.0), 0.015, 3e-6, 9);
    let fit = free(&points_m);
    let shift = Vector3::new(3.0, -2.0, 0.5);
    let other = free(&points_m.iter().map(|p| p * 1000.0 + shift).collect::<Vec<_>>());
    assert!((other.centre_m - (fit.centre_m * 1000.0 + shift)).norm() < 1e-9);
    assert!((other.radius_m / fit.radius_m / 1000.0 - 1.0).abs() < 1e-11);
    assert!((other.scatter_m.unwrap() / fit.scatter_m.unwrap() / 1000.0 - 1.0).abs() < 1e-8);
    assert!((other.condition / fit.condition - 1.0).abs() < 1e-9);
    let (low, high) = fit.residuals_m.iter().fold((f64::MAX, f64::MIN), |(l, h), r| (l.min(*r), h.max(*r)));
    assert_eq!(fit.form_m(), high - low);
}

#[test]
fn four_points_fit_exactly_and_claim_no_scatter() {
    let points_m = sphere(&cap(4, 2.5), 0.015, 1e-5, 1);
    let fit = free(&points_m);
    assert!(fit.residuals_m.iter().all(|r| r.abs() < 1e-15));
    assert_eq!((fit.degrees_of_freedom, fit.scatter_m, fit.covariance_m2), (0, None, None));
    assert!(SphereFit::new(&points_m, SphereRadius::Free, Some(1e-6)).unwrap().covariance_m2.is_some());
}

#[test]
fn what_fixes_no_sphere_is_refu_with_a_remedy() {
    let refu = |points_m: &[Vector3<f64>], says: &str| {
        let message = SphereFit::new(points_m, SphereRadius::Free, None).unwrap_err().to_string();
        assert!(message.contains(says), "{message}");
    };
    let whole = sphere(&cap(25, 1.5), 0.015, 1e-6, 2);
    refu(&whole[..3], "3 points");
    refu(&[], "0 points");
    let mut broken = whole.clone();
    broken[6].z = f64::NAN;
    refu(&broken, "point 7");
    let mut twice = whole.clone();
    twice[11] = twice[4];
    refu(&twice, "points 5 and 12");
    refu(&[whole[0]; 5], "points 1 and 2");
    let ring = |sigma: f64| -> Vec<_> {
        let off = |k: usize, seed| sigma * noise(seed, k);
        let at = |k: usize| {
            Vector3::new((k as f64 * 0.26).cos() + off(k, 1), (k as f64 * 0.26).sin() + off(k, 2), 0.3 + off(k, 3))
        };
        (0..24).map(|k| at(k) * 0.01).collect()
    };
    refu(&ring(0.0), "one plane");
    refu(&ring(1e-4), "too flat");
    refu(&(0..9).map(|k| Vector3::new(k as f64, 2.0 * k as f64, 0.5)).collect::<Vec<_>>(), "one plane");
    // A cap of 0.02 rad on 15 mm is 3 µm high; 5 µm of scatter hide that.
    refu(&sphere(&cap(100, 0.02), 0.015, 5e-6, 4), "too flat");
}

#[test]
fn a_known_radius_that_is_not_that_of_the_points_is_refu() {
    let points_m = sphere(&cap(25, 1.5), 0.015, 1e-6, 2);
    let with = |radius_m: f64, u_m: f64| SphereFit::new(&points_m, SphereRadius::Known { radius_m, u_m }, None);
    assert!(with(0.015, 1e-6).is_ok());
    let message = with(15.0, 0.0).unwrap_err().to_string();
    assert!(message.contains("radius 14.99") && message.contains("15000.0") && message.contains("unit"), "{message}");
    for (radius_m, u_m) in [(0.0, 0.0), (-1.0, 0.0), (f64::NAN, 0.0), (0.015, -1e-6), (0.015, f64::INFINITY)] {
        assert_eq!(with(radius_m, u_m), Err(SphereError::Radius));
    }
    let uncertain = |u: f64| SphereFit::new(&points_m, SphereRadius::Free, Some(u));
    assert!([0.0, -1.0, f64::NAN].iter().all(|u| uncertain(*u) == Err(SphereError::Uncertainty)));
}

/// Points of a sphere of 12.5 mm, some of them moved along the radius.
fn moved(count: usize, half_angle_rad: f64, off_m: &[(usize, f64)], seed: u64) -> Vec<Vector3<f64>> {
    let directions = cap(count, half_angle_rad);
    let mut points_m = sphere(&directions, 0.0125, 1e-6, seed);
    off_m.iter().for_each(|(k, m)| points_m[*k] += directions[*k] * *m);
    points_m
}

/// Rounding turned good steps down, and a fit with a point 1.2 mm off never ended.
#[test]
fn regress_a_fit_settles_whatever_one_point_does() {
    for half_angle_rad in [0.5, 1.0, 1.57, 3.0] {
        for k in 0..25 {
            for tenths in (-30..=30).step_by(3).filter(|tenths| *tenths != 0) {
                let points_m = moved(25, half_angle_rad, &[(k, f64::from(tenths) * 1e-4)], k as u64);
                let fit = SphereFit::new(&points_m, SphereRadius::Free, None);
                assert!(!matches!(fit, Err(SphereError::NotSettled(_))), "{half_angle_rad} {k} {tenths}: {fit:?}");
            }
        }
    }
}

#[test]
fn regress_points_off_the_sphere_are_found_and_left_out() {
    for seed in 0..20 {
        for off_m in [2e-3, -1.2e-3, 3e-5] {
            let (k, l) = (seed as usize % 25, (seed as usize + 7) % 25);
            let points_m = moved(25, 1.57, &[(k, off_m), (l, 0.7 * off_m)], seed);
            let (fit, strays) = SphereFit::without_strays(&points_m, SphereRadius::Free, None).unwrap();
            let mut expected = [k, l];
            expected.sort_unstable();
            assert_eq!(strays.iter().map(|stray| stray.point).collect::<Vec<_>>(), expected, "{off_m}: {strays:?}");
            let first = strays.iter().find(|stray| stray.point == k).unwrap();
            assert!((first.off_m - off_m).abs() < 5e-6, "{strays:?}");
            assert!((fit.centre_m - Vector3::from(CENTRE_M)).norm() < 3e-6 && fit.residuals_m.len() == 23);
        }
    }
}

#[test]
fn a_rough_sphere_has_no_strays() {
    for seed in 0..200 {
        let count = 9 + seed as usize % 30;
        let directions = cap(count, 1.57);
        // Heavy tails: the cube of an even distribution, and lobes.
        let rough = |k: usize| 2e-6 * noise(seed, k).powi(3) + 5e-6 * (3.0 * k as f64).sin();
        let at = |(k, n): (usize, &Vector3<f64>)| Vector3::from(CENTRE_M) + n * (0.0125 + rough(k));
        let points_m: Vec<_> = directions.iter().enumerate().map(at).collect();
        let (fit, strays) = SphereFit::without_strays(&points_m, SphereRadius::Free, None).unwrap();
        assert_eq!((strays.len(), &fit), (0, &free(&points_m)));
    }
    let exact = sphere(&cap(25, 1.57), 0.0125, 0.0, 0);
    assert!(SphereFit::without_strays(&exact, SphereRadius::Free, None).unwrap().1.is_empty());
}

#[test]
fn a_point_that_makes_it_no_sphere_is_named() {
    let message = SphereFit::new(&moved(25, 1.57, &[(6, 3e-3)], 4), SphereRadius::Free, None).unwrap_err().to_string();
    assert!(message.contains("point 7 lies ") && message.contains("(1 of the points"), "{message}");
}

/// A cap of 12.52047 mm held to 12.5 mm: the centre is 5 U off, and only the free fit tells. Where the points tell no radius, nothing is said.
#[test]
fn regress_a_known_radius_that_the_points_contradict_is_told() {
    let exactly = |radius_m: f64| SphereRadius::Known { radius_m, u_m: 0.0 };
    for declared in [None, Some(2e-6)] {
        for (count, half_angle_rad) in [(25, 1.57), (60, 0.8), (200, 0.5)] {
            let points_m = sphere(&cap(count, half_angle_rad), 12.52047e-3, 2e-6, 5);
            let told = SphereFit::contradicting(&points_m, exactly(12.5e-3), declared).unwrap();
            let u_m = told.free.u_m().unwrap()[3];
            assert!(told.is_certain && (told.difference_m - 20.47e-6).abs() < 4.0 * u_m, "{told:?}");
            // What it would have published, and what it may say with this difference as an uncertainty of the radius.
            let off_m = |u_m: f64| {
                let fit = SphereFit::new(&points_m, SphereRadius::Known { radius_m: 12.5e-3, u_m }, declared).unwrap();
                let off_m = (fit.centre_m - Vector3::from(CENTRE_M)).z.abs();
                (off_m, 2.0 * fit.u_m().unwrap()[2])
            };
            let ((off_m, before_m), (_, widened_m)) = (off_m(0.0), off_m(told.difference_m));
            assert!(off_m > 3.0 * before_m && off_m < widened_m, "{count}: {off_m:e} {before_m:e} {widened_m:e}");
            assert_eq!(SphereFit::contradicting(&points_m, exactly(12.5204e-3), declared), None);
            assert_eq!(SphereFit::contradicting(&points_m, SphereRadius::Free, declared), None);
        }
        // Its uncertainty as given explains the difference.
        let points_m = sphere(&cap(60, 0.8), 12.52047e-3, 2e-6, 5);
        let loosely = SphereRadius::Known { radius_m: 12.5e-3, u_m: 10e-6 };
        assert_eq!(SphereFit::contradicting(&points_m, loosely, declared), None);
        // A small cap, and few points, tell no radius of a micrometre.
        for (count, half_angle_rad) in [(60, 0.12), (5, 0.5), (4, 1.57)] {
            let points_m = sphere(&cap(count, half_angle_rad), 12.52047e-3, 2e-6, 5);
            let told = SphereFit::contradicting(&points_m, exactly(12.515e-3), declared);
            assert!(told.as_ref().is_none_or(|told| !told.is_certain), "{count}: {told:?}");
        }
    }
    // Points without any noise are a sphere to rounding.
    let exact = sphere(&cap(60, 0.8), 0.0125, 0.0, 0);
    assert_eq!(SphereFit::contradicting(&exact, exactly(0.0125), None), None);
}

/// Of 1000 right radii 10 are doubted by chance (sd 3), and 0.1 refused.
#[test]
fn a_known_radius_that_is_right_is_not_contradicted() {
    for declared in [None, Some(5e-6)] {
        for count in [6, 12, 60] {
            let told: Vec<_> = (0..1000)
                .filter_map(|seed| {
                    let u_m = 3e-6;
                    let radius = SphereRadius::Known { radius_m: 0.0125 + u_m * noise(seed, 1000), u_m };
                    SphereFit::contradicting(&sphere(&cap(count, 1.2), 0.0125, 5e-6, seed), radius, declared)
                })
                .collect();
            let certain = told.iter().filter(|told| told.is_certain).count();
            assert!(told.len() <= 22 && certain <= 2, "{count}: {} {certain}", told.len());
        }
    }
}
