//! The six errors against an exact motion of a rigid table, and what each arrangement of targets is worth.

use super::*;

const SPREAD_M: f64 = 0.3;

fn layout() -> Vec<(&'static str, Vector3<f64>)> {
    let at = |x: f64, y: f64, z: f64| Vector3::new(1.2 + x, -0.4 + y, 0.1 + z);
    vec![
        ("P", at(0.0, 0.0, 0.0)),
        ("Q", at(SPREAD_M, 0.0, 0.05)),
        ("K", at(0.1, 0.25, 0.02)),
        ("L", at(0.2, 0.15, 0.2)),
    ]
}

/// δ (m) and ε (rad) at a position; zero at the lowest, −0.2 m.
fn truth(position_m: f64, size: f64) -> Vector6<f64> {
    let s = position_m + 0.2;
    Vector6::new(5e-6, -3e-6, 2e-6, 20e-6, -15e-6, 30e-6)
        .map_with_location(|i, _, v| v * size * s * (1.0 + i as f64 * s))
}

fn motion(axis: GuidewayAxis, size: f64, noise_m: f64, seed: usize) -> Vec<TargetPoint> {
    let start = layout();
    let reference_m = start[0].1;
    let mut points = Vec::new();
    for k in 0..6 {
        let position_m = -0.2 + 0.15 * k as f64;
        let errors = truth(position_m, size);
        let turn = Rotation3::new(errors.fixed_rows::<3>(3).into_owned());
        let shift_m = axis.unit() * (position_m + 0.2) + errors.fixed_rows::<3>(0);
        for (j, (target, start_m)) in start.iter().enumerate() {
            let off_m = Vector3::from_fn(|d, _| noise_m * noise(seed, 100 * k + 10 * j + d));
            let point_m = reference_m + turn * (start_m - reference_m) + shift_m + off_m;
            points.push(TargetPoint { position_m, target: (*target).to_owned(), point_m, covariance_m2: None });
        }
    }
    points
}

/// Deterministic noise of unit variance.
fn noise(seed: usize, k: usize) -> f64 {
    let mut state = ((seed as u64) << 32 | k as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1B5_4A32_D192_ED03;
    for _ in 0..3 {
        state = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        state ^= state >> 27;
    }
    12f64.sqrt() * ((state >> 11) as f64 / (1u64 << 53) as f64 - 0.5)
}

fn options(axis: GuidewayAxis, rotation: GuidewayRotation) -> GuidewayOptions {
    GuidewayOptions { axis, frame: GuidewayFrame::Given, rotation, reference_m: Some(layout()[0].1) }
}

const AXES: [GuidewayAxis; 3] = [GuidewayAxis::X, GuidewayAxis::Y, GuidewayAxis::Z];

#[test]
fn an_exact_motion_is_found_for_every_axis_by_its_iso_names() {
    for axis in AXES {
        let found = Guideway::new(&motion(axis, 1.0, 0.0, 0), options(axis, GuidewayRotation::Exact)).unwrap();
        assert_eq!(found.positions.len(), 6);
        for position in &found.positions {
            let off = position.errors - truth(position.position_m, 1.0);
            assert!(off.norm() < 1e-14, "{off:?}");
        }
        assert!(found.positions[0].covariance.is_none() && found.positions[1].covariance.is_some());
    }
    assert_eq!(GuidewayAxis::X.error_names(), ["EXX", "EYX", "EZX", "EAX", "EBX", "ECX"]);
    assert_eq!(GuidewayAxis::Z.error_names(), ["EXZ", "EYZ", "EZZ", "EAZ", "EBZ", "ECZ"]);
}

/// Hand case of eq. 9: only εz = 1e-4 about P moves Q, 0.3 m along x, by 30 µm along y.
#[test]
fn a_yaw_moves_a_target_ahead_sideways() {
    let mut points = motion(GuidewayAxis::X, 0.0, 0.0, 0);
    let pivot_m = layout()[0].1;
    for point in points.iter_mut().filter(|p| p.position_m > 0.5) {
        let arm_m = point.point_m - pivot_m - Vector3::x() * (point.position_m + 0.2);
        point.point_m += Vector3::new(-arm_m.y, arm_m.x, 0.0) * 1e-4;
    }
    let found = Guideway::new(&points, options(GuidewayAxis::X, GuidewayRotation::SmallAngle)).unwrap();
    let last = found.positions.last().unwrap();
    assert!((last.errors - Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, 1e-4)).norm() < 1e-14, "{:?}", last.errors);
    let at = |target: &str| points.iter().rev().find(|p| p.target == target).unwrap().point_m;
    assert!((at("Q").y - layout()[1].1.y - 30e-6).abs() < 1e-12);
}

/// The small-angle form leaves out products of the angles: nanoradians at 0.1 mrad, which is large for a guideway, a tenth of a
/// microradian at 1 mrad.
#[test]
fn small_angles_differ_from_the_exact_rotation_by_their_square() {
    for (size, bound) in [(1.0, 1e-8), (10.0, 1e-5)] {
        let points = motion(GuidewayAxis::X, size, 0.0, 0);
        let of = |rotation| Guideway::new(&points, options(GuidewayAxis::X, rotation)).unwrap();
        let (exact, small) = (of(GuidewayRotation::Exact), of(GuidewayRotation::SmallAngle));
        let (exact, small) = (exact.positions.last().unwrap(), small.positions.last().unwrap());
        let angle = exact.errors.fixed_rows::<3>(3).norm();
        let off = (exact.errors - small.errors).norm();
        assert!(off < angle * angle && off > 1e-3 * angle * angle && off < bound, "{size}: {off} {angle}");
    }
}

#[test]
fn a_frame_turned_against_the_machine_is_turned_back() {
    for axis in AXES {
        // A levelled tracker, turned by 137° about the vertical; for Z it is tilted instead, as its azimuth cannot be told.
        let turn = match axis {
            GuidewayAxis::Z => Rotation3::new(Vector3::new(0.03, -0.02, 0.0)),
            _ => Rotation3::new(Vector3::new(0.0, 0.0, 2.4)),
        };
        let mut points = motion(axis, 1.0, 0.0, 0);
        points.iter_mut().for_each(|p| p.point_m = turn * p.point_m + Vector3::new(3.0, -1.0, 0.2));
        let mut asked = options(axis, GuidewayRotation::Exact);
        asked.reference_m = None;
        if axis != GuidewayAxis::Z {
            let message = Guideway::new(&points, asked).unwrap_err().to_string();
            assert!(message.contains("degrees off the"), "{message}");
        }
        asked.frame = GuidewayFrame::AlongMotion;
        let found = Guideway::new(&points, asked).unwrap();
        // What is left is that the mean direction of motion is the truth's only but for its slopes.
        let off = (found.machine_from_points * turn).angle();
        assert!(off < 2e-4, "{off}");
        for position in &found.positions {
            let angles = position.errors.fixed_rows::<3>(3) - truth(position.position_m, 1.0).fixed_rows::<3>(3);
            assert!(angles.norm() < 1e-4 * 2e-4 + 1e-12, "{angles:?}");
        }
        // Slopes of straightness are gone.
        let (mut product, mut mean) = (Vector3::zeros(), Vector3::zeros());
        for position in &found.positions {
            mean += position.errors.fixed_rows::<3>(0) / 6.0;
            product += position.errors.fixed_rows::<3>(0) * (position.position_m - 0.175);
        }
        product[axis.index()] = 0.0;
        assert!(product.norm() < 1e-12, "{product:?}");
    }
}

/// χ² of the errors under the covariance before it was widened, over 400 seeds, for four and for three targets: mean 6, sd √(12/400) = 0.17.
#[test]
fn the_covariance_holds_what_it_says_before_it_is_widened() {
    let u_m = 5e-6;
    for (targets, declared) in [(4, true), (3, true), (4, false)] {
        let mut total = 0.0;
        for seed in 0..400 {
            let mut points = motion(GuidewayAxis::Y, 1.0, u_m, seed);
            points.retain(|p| targets == 4 || p.target != "L");
            if declared {
                points.iter_mut().for_each(|p| p.covariance_m2 = Some(Matrix3::identity() * u_m * u_m));
            }
            let found = Guideway::new(&points, options(GuidewayAxis::Y, GuidewayRotation::SmallAngle)).unwrap();
            let last = &found.positions[3];
            let off = last.errors - truth(last.position_m, 1.0);
            let narrow = last.covariance.unwrap() / last.widening.unwrap().powi(2);
            total += (narrow.try_inverse().unwrap() * off).dot(&off);
            assert_eq!(found.chi2_per_dof.is_some(), declared);
        }
        // A scatter from 30 degrees of freedom makes χ² larger by 30/28.
        let expected = if declared { 6.0 } else { 6.0 * 30.0 / 28.0 };
        assert!((total / 400.0 - expected).abs() < 5.0 * 0.18, "{targets} {declared}: {}", total / 400.0);
    }
}

/// Four targets at the corners of a square of side 2a about the reference: ε along z sees 4·2a², so its u is σ·√2/(a·√8).
#[test]
fn arrangements_have_the_uncertainties_of_the_hand_case() {
    let (a, sigma_m) = (0.15, 2e-6);
    let square = |height_m: f64| -> Vec<ArrangedTarget> {
        let corner = |(x, y): (f64, f64)| ArrangedTarget {
            point_m: Vector3::new(x * a, y * a, height_m),
            covariance_m2: Matrix3::identity() * sigma_m * sigma_m,
        };
        [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].into_iter().map(corner).collect()
    };
    let u = |height_m: f64| {
        let covariance = arrangement_covariance(&square(height_m), &Vector3::zeros()).unwrap();
        Vector6::from_fn(|k, _| covariance[(k, k)].sqrt())
    };
    let flat = u(0.0);
    let root = 2f64.sqrt() * sigma_m;
    let expected = [root / 2.0, root / 2.0, root / 2.0, root / (2.0 * a), root / (2.0 * a), root / (a * 8f64.sqrt())];
    assert!((flat - Vector6::from(expected)).norm() < 1e-12, "{flat:?}");
    // Half a metre above the reference, x and y carry the angles with that lever; the angles themselves do not change.
    let high = u(0.5);
    let lever = (expected[0].powi(2) + (0.5 * expected[4]).powi(2)).sqrt();
    assert!((high[0] - lever).abs() < 1e-12 && (high[1] - lever).abs() < 1e-12 && (high[2] - flat[2]).abs() < 1e-12);
    assert!((high - flat).fixed_rows::<3>(3).norm() < 1e-12);
}

/// The plan's covariance is the fit's.
#[test]
fn a_planned_arrangement_is_as_certain_as_the_measured_one() {
    let u_m = 3e-6;
    let mut points = motion(GuidewayAxis::X, 0.0, 0.0, 0);
    points.iter_mut().for_each(|p| p.covariance_m2 = Some(Matrix3::identity() * u_m * u_m));
    let found = Guideway::new(&points, options(GuidewayAxis::X, GuidewayRotation::SmallAngle)).unwrap();
    let target = |(_, point_m): &(&str, Vector3<f64>)| ArrangedTarget {
        point_m: *point_m,
        covariance_m2: Matrix3::identity() * u_m * u_m,
    };
    let targets: Vec<ArrangedTarget> = layout().iter().map(target).collect();
    let planned = arrangement_covariance(&targets, &layout()[0].1).unwrap();
    assert!((planned - found.positions[2].covariance.unwrap()).norm() < 1e-9 * planned.norm());
}

#[test]
fn targets_on_a_line_are_refused_whatever_the_unit() {
    for unit in [1e-3, 1.0, 1e3] {
        for (aside, is_refused) in [(0.0, true), (1e-4, true), (0.02, false)] {
            let mut points = motion(GuidewayAxis::X, 0.0, 0.0, 0);
            points.retain(|p| p.target != "L");
            for point in &mut points {
                let along = ["P", "Q", "K"].iter().position(|name| *name == point.target).unwrap() as f64;
                let off = if point.target == "K" { aside } else { 0.0 };
                let start = Vector3::new(along * 0.1, along * 0.2, off);
                point.point_m = (start + Vector3::x() * point.position_m) * unit;
                point.position_m *= unit;
            }
            let mut asked = options(GuidewayAxis::X, GuidewayRotation::SmallAngle);
            asked.reference_m = None;
            let found = Guideway::new(&points, asked);
            assert_eq!(matches!(found, Err(GuidewayError::Collinear { .. })), is_refused, "{unit} {aside} {found:?}");
            let arranged = |p: &TargetPoint| ArrangedTarget { point_m: p.point_m, covariance_m2: Matrix3::identity() };
            let plan: Vec<ArrangedTarget> = points[..3].iter().map(arranged).collect();
            assert_eq!(arrangement_covariance(&plan, &Vector3::zeros()).is_err(), is_refused);
        }
    }
}

#[test]
fn bad_points_are_refused_with_a_remedy() {
    let refused = |change: &dyn Fn(&mut Vec<TargetPoint>), says: &str| {
        let mut points = motion(GuidewayAxis::X, 1.0, 0.0, 0);
        change(&mut points);
        let message =
            Guideway::new(&points, options(GuidewayAxis::X, GuidewayRotation::SmallAngle)).unwrap_err().to_string();
        assert!(message.contains(says), "{message}");
    };
    refused(&|p| p[4].point_m.y = f64::NAN, "point 5");
    refused(&|p| p[4].position_m = f64::INFINITY, "point 5");
    refused(&|p| p[3].covariance_m2 = Some(Matrix3::zeros()), "point 4");
    refused(&|p| p[5] = p[4].clone(), "points 5 and 6");
    refused(&|p| p.truncate(4), "1 position");
    refused(&|p| p.clear(), "0 position");
    refused(&|p| drop(p.drain(20..22)), "550 mm has 2 targets");
    refused(&|p| p.iter_mut().for_each(|p| p.position_m *= 1e3), "unit");
    refused(&|p| p.iter_mut().for_each(|p| p.position_m *= -1.0), "degrees off the X axis");
    refused(
        &|p| p.iter_mut().for_each(|p| p.point_m = Vector3::new(p.point_m.y, p.point_m.x, p.point_m.z)),
        "90.0 degrees",
    );
    let exchanged = |points: &mut Vec<TargetPoint>| {
        points[8].target = "Q".to_owned();
        points[9].target = "P".to_owned();
    };
    refused(&exchanged, "exchanged names");
    refused(&|p| p[10].point_m.z += 0.05, "rigid");
    let copied = |points: &mut Vec<TargetPoint>| {
        for k in (0..points.len()).step_by(4) {
            points[k + 1].point_m = points[k].point_m;
        }
    };
    refused(&copied, "same coordinates");
}

/// Positions as a display rounds them, or as the axis stood when each target was read: good data was refused.
#[test]
fn regress_positions_that_differ_by_rounding_are_one() {
    for axis in AXES {
        let mut points = motion(axis, 1.0, 0.0, 0);
        for (k, point) in points.iter_mut().enumerate() {
            // The axis is where it says it is: what is indicated goes with what is measured.
            let by_m = 0.4e-6 * noise(3, k).clamp(-1.2, 1.2);
            point.position_m += by_m;
            point.point_m += axis.unit() * by_m;
        }
        let found = Guideway::new(&points, options(axis, GuidewayRotation::Exact)).unwrap();
        assert_eq!(found.positions.len(), 6);
        for (k, position) in found.positions.iter().enumerate() {
            let at_m = -0.2 + 0.15 * k as f64;
            assert!((position.position_m - at_m).abs() < 0.5e-6);
            // The errors change by 30 µrad/m along half a micrometre; the reference point moves along with the lowest position.
            let off = position.errors - truth(at_m, 1.0);
            assert!(off.norm() < 1e-9, "{off:?}");
        }
    }
    let mut apart = motion(GuidewayAxis::X, 1.0, 0.0, 0);
    apart[5].position_m += 2e-6;
    let why = Guideway::new(&apart, options(GuidewayAxis::X, GuidewayRotation::Exact)).unwrap_err().to_string();
    assert!(why.contains("1 targets in common") && why.contains("up to 1 µm apart are one"), "{why}");
    let mut twice = motion(GuidewayAxis::X, 1.0, 0.0, 0);
    twice.push(TargetPoint { position_m: twice[4].position_m + 0.5e-6, ..twice[4].clone() });
    let why = Guideway::new(&twice, options(GuidewayAxis::X, GuidewayRotation::Exact)).unwrap_err();
    assert!(matches!(why, GuidewayError::Twice { first: 5, second: 25, .. }), "{why}");
}

/// L·θ²/2 of 0.75 m: 0.29 µm at 0.05°, 10.3 µm at 0.3° and 114 µm at 1°, where U is about 4 µm. What is given holds the truth.
#[test]
fn regress_a_tilted_frame_makes_no_cosine_error_in_the_position() {
    const NOISE_M: f64 = 2e-6;
    for axis in AXES {
        for (angle_deg, is_refused) in [(0.0, false), (0.05, false), (0.3, true), (1.0, true)] {
            // About a direction across the axis, so that all of it is off the motion.
            let across = Vector3::ith((axis.index() + 1) % 3, 1.0);
            let turn = Rotation3::new(across * f64::to_radians(angle_deg));
            let mut points = motion(axis, 1.0, NOISE_M, 7);
            points.iter_mut().for_each(|p| p.point_m = turn * p.point_m);
            let mut asked = options(axis, GuidewayRotation::Exact);
            asked.reference_m = None;
            let given = Guideway::without_strays(&points, asked);
            asked.frame = GuidewayFrame::AlongMotion;
            let along = Guideway::without_strays(&points, asked).unwrap().0;
            let own = axis.index();
            // The truth is that of the first target; the centroid moves by a few micrometres more or less with the rotations.
            let last = along.positions.last().unwrap();
            match given {
                Err(error) => {
                    let message = error.to_string();
                    assert!(is_refused && message.contains("--frame along-motion"), "{angle_deg}: {message}");
                    assert!(message.contains(&format!("{angle_deg:.2} degrees off the {}", axis.name())), "{message}");
                    assert!(message.contains(&axis.error_names()[own]), "{message}");
                }
                Ok((found, _)) => {
                    assert!(!is_refused, "{axis:?} {angle_deg}: {:?}", found.positions.last().unwrap());
                    let position = found.positions.last().unwrap();
                    let expanded_m = 2.0 * Guideway::u(position).unwrap()[own];
                    let off_m = (position.errors[own] - last.errors[own]).abs();
                    assert!(off_m < 0.3 * expanded_m, "{axis:?} {angle_deg}: {off_m:e} {expanded_m:e}");
                }
            }
        }
    }
}
