//! Figures of the probing test against spheres that are known, and points that are no sphere.

use super::*;

const CENTRE_M: Vector3<f64> = Vector3::new(0.3, -0.2, 0.9);
const RADIUS_M: f64 = 0.0149868;
/// Rounding of coordinates of a metre, a few times.
const ROUNDING_M: f64 = 2e-15;

fn directions() -> Vec<Vector3<f64>> {
    recommended_points(&Vector3::new(0.2, 0.1, 1.0)).unwrap()
}

fn on_sphere(out_m: impl Fn(usize) -> f64) -> Vec<Vector3<f64>> {
    directions().iter().enumerate().map(|(k, d)| CENTRE_M + d * (RADIUS_M + out_m(k))).collect()
}

#[test]
fn recommended_points_are_25_over_a_hemisphere_and_apart() {
    let points = directions();
    assert_eq!(points.len(), POINTS);
    let axis = Vector3::new(0.2, 0.1, 1.0).normalize();
    assert!(points.iter().all(|p| (p.norm() - 1.0).abs() < 1e-15 && p.dot(&axis) > -1e-12));
    let rings = [1.0, 22.5_f64.to_radians().cos(), 0.5_f64.sqrt(), 67.5_f64.to_radians().cos(), 0.0];
    for (height, count) in rings.iter().zip([1, 4, 8, 4, 8]) {
        assert_eq!(points.iter().filter(|p| (p.dot(&axis) - height).abs() < 1e-12).count(), count);
    }
    let nearest = (0..25).flat_map(|a| (0..a).map(move |b| (a, b))).map(|(a, b)| (points[a] - points[b]).norm());
    assert!(nearest.fold(f64::INFINITY, f64::min) > 0.38, "22.5 degrees apart");
    assert!(recommended_points(&Vector3::zeros()).is_err());
}

#[test]
fn a_sphere_without_error_is_found_exactly() {
    let found = evaluate(&on_sphere(|_| 0.0), Some(2.0 * RADIUS_M)).unwrap();
    assert!((found.sphere.centre_m - CENTRE_M).amax() < ROUNDING_M && found.form.metres() < ROUNDING_M);
    assert!(found.size.unwrap().magnitude_m() < 2.0 * ROUNDING_M && found.departures.is_empty(), "{found:?}");
}

#[test]
fn a_sphere_that_is_probed_too_large_has_a_size_error_and_no_form_error() {
    let found = evaluate(&on_sphere(|_| 0.3e-6), Some(2.0 * RADIUS_M)).unwrap();
    assert!((found.size.unwrap().metres() - 0.6e-6).abs() < 4.0 * ROUNDING_M && found.form.metres() < ROUNDING_M);
}

/// A term that centre and radius cannot take up: two lobes, ± 1 µm, sampled where the rings of 8 carry it whole. It is
/// orthogonal to the columns of the fit on these points, so the form error is its whole range.
#[test]
fn form_is_the_range_of_what_no_sphere_takes_up() {
    let axis = Vector3::new(0.2, 0.1, 1.0).normalize();
    let points = directions();
    let across = points[17] - axis * points[17].dot(&axis);
    let lobes = |k: usize| {
        let equator = points[k].dot(&axis).abs() < 1e-9;
        let angle = points[k].dot(&across.normalize()).clamp(-1.0, 1.0).acos();
        if equator { 1e-6 * (4.0 * angle).cos() } else { 0.0 }
    };
    let found = evaluate(&on_sphere(lobes), Some(2.0 * RADIUS_M)).unwrap();
    assert!((found.form.metres() - 2e-6).abs() < 1e-11, "{found:?}");
}

/// Residuals of a least-squares sphere are orthogonal to what moves it: their sum, and their sum along each direction.
#[test]
fn the_fit_is_the_least_squares_one() {
    let found = evaluate(&on_sphere(|k| 1e-6 * (k as f64 * 1.3).sin()), Some(2.0 * RADIUS_M)).unwrap();
    assert!(found.sphere.residuals_m.iter().sum::<f64>().abs() < 1e-14);
    let along: Vector3<f64> = on_sphere(|k| 1e-6 * (k as f64 * 1.3).sin())
        .iter()
        .zip(&found.sphere.residuals_m)
        .map(|(p, r)| (p - found.sphere.centre_m).normalize() * *r)
        .sum();
    assert!(along.amax() < 1e-14, "{along}");
    let range = |v: &[f64]| v.iter().copied().fold(f64::MIN, f64::max) - v.iter().copied().fold(f64::MAX, f64::min);
    assert_eq!(found.form.metres(), range(&found.sphere.residuals_m));
}

#[test]
fn limits_for_form_and_size_are_held_apart() {
    let found = evaluate(&on_sphere(|k| if k == 0 { 0.5e-6 } else { 0.0 }), Some(2.0 * RADIUS_M)).unwrap();
    let limit = |um: f64| Some(PermissibleError::from_metres(um * 1e-6));
    let rule = DecisionRule::SimpleAcceptance;
    assert_eq!(
        found.verdicts(limit(0.35), limit(0.35), &rule),
        (Some(Verdict::DoesNotConform), Some(Verdict::Conforms))
    );
    assert_eq!(found.verdicts(None, None, &rule), (None, None));
}

#[test]
fn what_a_whole_test_lacks_is_named() {
    let says = |points: &[Vector3<f64>], diameter_m: Option<f64>, says: &str| {
        let departures = evaluate(points, diameter_m).unwrap().departures;
        assert!(departures.iter().any(|d| d.to_string().contains(says)), "{says}: {departures:?}");
    };
    says(&on_sphere(|_| 0.0)[..24], Some(2.0 * RADIUS_M), "25 points are asked for, there are 24");
    says(&on_sphere(|_| 0.0), None, "no size error");
    let small: Vec<_> = directions().iter().map(|d| d * 0.004).collect();
    says(&small, Some(0.008), "10 mm to 50 mm");
    let cap = &on_sphere(|_| 0.0)[..17];
    says(cap, Some(2.0 * RADIUS_M), "a hemisphere is asked for");
}

/// Points on rings: angle from the pole (degrees), their number, and the angle by which the ring is turned (degrees).
fn rings(rings: &[(f64, usize, f64)]) -> Vec<Vector3<f64>> {
    let ring = |(polar_deg, count, turned_deg): (f64, usize, f64)| {
        let polar_rad = polar_deg.to_radians();
        (0..count).map(move |k| {
            let around_rad = turned_deg.to_radians() + std::f64::consts::TAU * k as f64 / count as f64;
            Vector3::new(polar_rad.sin() * around_rad.cos(), polar_rad.sin() * around_rad.sin(), polar_rad.cos())
        })
    };
    rings.iter().copied().flat_map(ring).map(|d| CENTRE_M + d * RADIUS_M).collect()
}

#[test]
fn regress_points_that_leave_most_of_the_hemisphere_blind_are_no_whole_test() {
    let said = |points: &[Vector3<f64>]| {
        assert_eq!(points.len(), POINTS);
        let departures = evaluate(points, Some(2.0 * RADIUS_M)).unwrap().departures;
        departures.iter().map(|d| format!("{d}.")).collect::<String>()
    };
    // A cap of 12 degrees and one point at the equator; a band along one meridian; the equator and the pole.
    let cap = [(3.0, 6, 0.0), (7.0, 8, 10.0), (11.0, 10, 20.0), (90.0, 1, 0.0)];
    let told = said(&rings(&cap));
    assert!(told.contains("a place of the hemisphere is 73 degrees from the nearest point"), "{told}");
    // Turned to and fro, since points in one plane are refused.
    let turned_deg = |k: u32| if k.is_multiple_of(2) { 10.0 } else { -10.0 };
    let band = (1..=12).map(|k| (7.5 * f64::from(k), 2, turned_deg(k)));
    let meridian: Vec<(f64, usize, f64)> = band.chain([(0.0, 1, 0.0)]).collect();
    let told = said(&rings(&meridian));
    assert!(told.contains("degrees from the nearest point"), "{told}");
    let equator = [(0.0, 1, 0.0), (90.0, 24, 0.0)];
    let told = said(&rings(&equator));
    assert!(told.contains("45 degrees from the nearest point"), "{told}");
    // The recommended pattern, its rings unturned or fewer, an equator that is a little short, and a spiral.
    let even: [&[(f64, usize, f64)]; 5] = [
        &[(0.0, 1, 0.0), (22.5, 4, 22.5), (45.0, 8, 45.0), (67.5, 4, 67.5), (90.0, 8, 90.0)],
        &[(0.0, 1, 0.0), (22.5, 4, 0.0), (45.0, 8, 0.0), (67.5, 4, 0.0), (90.0, 8, 0.0)],
        &[(0.0, 1, 0.0), (45.0, 8, 0.0), (90.0, 16, 0.0)],
        &[(0.0, 1, 0.0), (22.5, 6, 0.0), (45.0, 6, 0.0), (67.5, 6, 0.0), (90.0, 6, 0.0)],
        &[(0.0, 1, 0.0), (21.2, 4, 22.5), (42.5, 8, 45.0), (63.8, 4, 67.5), (85.0, 8, 90.0)],
    ];
    for pattern in even {
        assert_eq!(said(&rings(pattern)), "", "{pattern:?}");
    }
    let spiral: Vec<(f64, usize, f64)> = (0..25)
        .map(|k| (f64::from(k) / 24.0, f64::from(k) * 137.5))
        .map(|(z, turn)| (z.acos().to_degrees(), 1, turn))
        .collect();
    assert_eq!(said(&rings(&spiral)), "");
}

#[test]
fn points_that_fix_no_sphere_are_refused() {
    let refused = |points: Vec<Vector3<f64>>, diameter_m: Option<f64>, says: &str| {
        let told = evaluate(&points, diameter_m).unwrap_err().to_string();
        assert!(told.contains(says), "{told}");
    };
    let good = || on_sphere(|_| 0.0);
    refused(Vec::new(), None, "0 points");
    refused(good()[..4].to_vec(), None, "4 points");
    refused((0..25).map(|k| Vector3::new(f64::from(k) * 1e-3, 0.0, 0.0)).collect(), None, "one plane");
    let ring = |k: i32| Vector3::new((f64::from(k) * 0.25).cos(), (f64::from(k) * 0.25).sin(), 0.0) * RADIUS_M;
    refused((0..25).map(ring).collect(), None, "one plane");
    let speck = |k: i32| {
        let (around, polar) = (f64::from(k), 0.01 * f64::from(k + 1));
        Vector3::new(polar.sin() * around.cos(), polar.sin() * around.sin(), polar.cos()) * RADIUS_M
    };
    refused((0..12).map(speck).collect(), None, "middle of their cap");
    let mut spoilt = good();
    spoilt[7].y = f64::NAN;
    refused(spoilt, None, "not a finite number");
    let mut double = good();
    double[9] = double[2];
    refused(double, None, "points 3 and 10");
    refused(good(), Some(29.97), "no test sphere");
    // Metres where millimetres are to stand, of a sphere whose diameter is not stated.
    refused(good().iter().map(|p| p / 1e3).collect(), None, "is that of no test sphere; give the points");
    refused(good(), Some(0.0319736), "size error of -2.000 mm");
    let mut far = good();
    far[0] += Vector3::new(0.0, 0.0, 0.0012);
    refused(far.clone(), Some(2.0 * RADIUS_M), "form error");
    far[0] += Vector3::new(0.0, 0.0, 0.0028);
    refused(far, Some(2.0 * RADIUS_M), "point 1 lies");
}
