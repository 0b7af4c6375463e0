//! Evidence for the fit of plates: what a plane supports comes out, in one pose or several, with heights or without; what it
//! does not is named and held at zero; what lies in the plane is corrected as well as the noise allows.

use crate::common::{description, of_low_order};
use abbe_geometry::correct::correct;
use abbe_geometry::effects::{NoCovariates, State};
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::Machine;
use abbe_geometry::{Axis, Vector3};
use abbe_identify::points::{
    FittedPoints, Loss, MeasuredPoint, Method, Plates, PointOptions, PointsError, fit_plates,
    fit_plates_of_best_degree, fit_plates_smooth, fit_points,
};
use abbe_measurement::alignment::aligned_residuals_m;
use abbe_virtual_machine::{TruthRecipe, VirtualMachine};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

const NOISE_M: f64 = 0.2e-6;
const OFFSET_M: [f64; 3] = [0.0, 0.0, -0.06];
const HEIGHT_M: f64 = 0.25;

fn bridge(seed: u64, degree: u32) -> (VirtualMachine, Machine) {
    let mut truth = of_low_order(TruthRecipe { seed, ..TruthRecipe::default() }.bridge_xyz().unwrap(), degree);
    truth.ram_turn.about_m = OFFSET_M;
    let mut machine = description(&truth, FunctionKind::Polynomial { degree: degree as usize });
    machine.repeatability_m = [0.0; 3];
    (VirtualMachine::new(truth).unwrap(), machine)
}

/// A plate of 12 by 10 points over most of the stroke, turned and shifted by an unknown amount.
fn plate(truth: &VirtualMachine, height_m: f64, noise_m: f64, seed: u64) -> Vec<MeasuredPoint> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let turn = nalgebra::Rotation3::new(Vector3::new(0.1, -0.05, 0.8));
    let stroke = truth.truth().stroke_m;
    let mut point = |k: usize| {
        let share = [(k % 12) as f64 / 11.0, (k / 12) as f64 / 9.0];
        let place = |d: usize| stroke[d][0] + (0.03 + 0.94 * share[d]) * (stroke[d][1] - stroke[d][0]);
        let reading_m = [place(0), place(1), height_m];
        let mut noise = || noise_m * generator.sample::<f64, _>(StandardNormal);
        let actual = Vector3::from(truth.actual_point_m(reading_m, OFFSET_M)) + Vector3::new(noise(), noise(), noise());
        let actual_m = turn * actual + Vector3::new(0.3, -0.1, 0.7);
        MeasuredPoint { reading_m, offset_m: OFFSET_M, actual_m, u_m: NOISE_M }
    };
    (0..120).map(&mut point).collect()
}

fn one_pose(points: &[MeasuredPoint], lacks: Option<Axis>) -> Plates {
    Plates::new(&vec!["on the table".to_owned(); points.len()], lacks).unwrap()
}

fn fit(machine: &Machine, points: &[MeasuredPoint], plates: &Plates) -> FittedPoints {
    let options = PointOptions { method: Method::LevenbergMarquardt, loss: Loss::Huber };
    fit_plates(machine, points, plates, &options, &mut |_| true).unwrap()
}

/// Corrected less actual positions (m) at points of a plane that no fit has seen, after the best fit of all; the components
/// named.
fn left_m(truth: &VirtualMachine, found: &FittedPoints, height_m: f64, components: &[usize]) -> f64 {
    let fresh = plate(truth, height_m, 0.0, 1);
    let corrected: Vec<_> = fresh
        .iter()
        .map(|p| {
            let state = State { reading_m: p.reading_m, offset_m: p.offset_m, covariates: &NoCovariates };
            let mut at = correct(&found.model, &state).position_m;
            (0..3).filter(|d| !components.contains(d)).for_each(|d| at[d] = 0.0);
            at
        })
        .collect();
    let actual: Vec<_> = fresh
        .iter()
        .map(|p| {
            let mut at = Vector3::from(truth.actual_point_m(p.reading_m, p.offset_m));
            (0..3).filter(|d| !components.contains(d)).for_each(|d| at[d] = 0.0);
            at
        })
        .collect();
    let left = aligned_residuals_m(&corrected, &actual).unwrap();
    (left.iter().map(|r| r.norm_squared()).sum::<f64>() / (components.len() * left.len()) as f64).sqrt()
}

fn names(found: &FittedPoints) -> Vec<&str> {
    found.not_seen.iter().map(|own| own.name.as_str()).collect()
}

#[test]
fn a_plate_is_corrected_in_its_plane_and_what_it_cannot_tell_has_its_name() {
    let (truth, machine) = bridge(3, 3);
    let points = plate(&truth, HEIGHT_M, NOISE_M, 2);
    let found = fit(&machine, &points, &one_pose(&points, None));
    let before = indicated_m(&truth);
    let after = left_m(&truth, &found, HEIGHT_M, &[0, 1, 2]);
    assert!(before > 3e-6 && after < 0.5 * NOISE_M, "{before:e} {after:e}");
    assert!((0.8..1.25).contains(&found.evidence.chi2_per_dof), "{}", found.evidence.chi2_per_dof);
    let unseen = names(&found);
    for name in ["B0Z", "A0Z", "EZZ", "EXZ", "EYZ", "EAZ", "EBZ", "ECZ"] {
        assert!(unseen.contains(&name), "{name} is not in {unseen:?}");
    }
    for name in ["C0Y", "EXX", "EYY", "EYX", "EXY", "EZX", "EZY"] {
        assert!(!unseen.contains(&name), "{name}: {unseen:?}");
    }
}

/// Indicated less actual positions (m) in the plane, after the best fit of all.
fn indicated_m(truth: &VirtualMachine) -> f64 {
    let fresh = plate(truth, HEIGHT_M, 0.0, 1);
    let indicated: Vec<_> = fresh.iter().map(|p| Vector3::from(p.reading_m) + Vector3::from(p.offset_m)).collect();
    let actual: Vec<_> = fresh.iter().map(|p| Vector3::from(truth.actual_point_m(p.reading_m, p.offset_m))).collect();
    let left = aligned_residuals_m(&indicated, &actual).unwrap();
    (left.iter().map(|r| r.norm_squared()).sum::<f64>() / (3 * left.len()) as f64).sqrt()
}

#[test]
fn a_plate_without_heights_tells_what_lies_in_its_plane() {
    let (truth, machine) = bridge(4, 3);
    let points: Vec<MeasuredPoint> = plate(&truth, HEIGHT_M, NOISE_M, 5)
        .into_iter()
        .map(|p| MeasuredPoint { actual_m: in_plane(&p), ..p })
        .collect();
    let found = fit(&machine, &points, &one_pose(&points, Some(Axis::Z)));
    let after = left_m(&truth, &found, HEIGHT_M, &[0, 1]);
    assert!(after < 0.5 * NOISE_M, "{after:e}");
    assert!((0.75..1.3).contains(&found.evidence.chi2_per_dof), "{}", found.evidence.chi2_per_dof);
    let unseen = names(&found);
    assert!(unseen.contains(&"EZX") && unseen.contains(&"EZY") && !unseen.contains(&"C0Y"), "{unseen:?}");
}

/// As a camera sees it: x and y of a frame of its own, no height.
fn in_plane(point: &MeasuredPoint) -> Vector3<f64> {
    let turn = nalgebra::Rotation3::new(Vector3::new(0.1, -0.05, 0.8));
    let actual = turn.inverse() * (point.actual_m - Vector3::new(0.3, -0.1, 0.7));
    let flat = nalgebra::Rotation3::new(Vector3::new(0.0, 0.0, 0.6)) * actual;
    Vector3::new(flat.x, flat.y, 0.0)
}

#[test]
fn each_pose_has_a_frame_of_its_own_and_two_heights_tell_more_than_one() {
    let (truth, machine) = bridge(6, 2);
    let (low, high) = (plate(&truth, 0.1, NOISE_M, 7), plate(&truth, 0.45, NOISE_M, 8));
    let turn = nalgebra::Rotation3::new(Vector3::new(0.0, 0.0, 1.5));
    let moved = high.into_iter().map(|p| MeasuredPoint { actual_m: turn * p.actual_m + Vector3::x(), ..p });
    let points: Vec<MeasuredPoint> = low.into_iter().chain(moved).collect();
    let poses: Vec<String> = (0..points.len()).map(|k| format!("pose {}", k / 120)).collect();
    let found = fit(&machine, &points, &Plates::new(&poses, None).unwrap());
    for height_m in [0.1, 0.45] {
        let after = left_m(&truth, &found, height_m, &[0, 1, 2]);
        assert!(after < 0.6 * NOISE_M, "{height_m}: {after:e}");
    }
    let one = fit(&machine, &points[..120], &one_pose(&points[..120], None));
    assert!(found.not_seen.len() < one.not_seen.len(), "{:?} {:?}", names(&found), names(&one));
}

#[test]
fn squareness_holds_the_truth_as_often_as_it_says() {
    let (truth, mut machine) = bridge(9, 1);
    machine.kinds = machine.kinds.map(|_| Some(FunctionKind::Polynomial { degree: 1 }));
    // At one height a roll of an axis that grows along it is squareness as well: what holds is what no noise disturbs.
    let still = plate(&truth, HEIGHT_M, 0.0, 1);
    let (expected, _) = fit(&machine, &still, &one_pose(&still, None)).model.squareness(0);
    let trials = 100;
    let within = |seed: &u64| {
        let points = plate(&truth, HEIGHT_M, NOISE_M, 100 + seed);
        let found = fit(&machine, &points, &one_pose(&points, None));
        let (value, u) = found.model.squareness(0);
        (value - expected).abs() <= 1.96 * u
    };
    let share = (0..trials).filter(within).count() as f64 / trials as f64;
    // 95 % less three standard deviations.
    assert!((0.88..=1.0).contains(&share), "{share}");
}

#[test]
fn the_degree_is_chosen_by_the_data_and_gross_points_have_little_weight() {
    let (truth, machine) = bridge(10, 2);
    let mut points = plate(&truth, HEIGHT_M, NOISE_M, 11);
    points[40].actual_m += Vector3::new(20e-6, 0.0, 0.0);
    let options = PointOptions { method: Method::LevenbergMarquardt, loss: Loss::Huber };
    let plates = one_pose(&points, None);
    let found = fit_plates_of_best_degree(&machine, &points, &plates, 1..=6, &options, &mut |_| true).unwrap();
    let after = left_m(&truth, &found, HEIGHT_M, &[0, 1, 2]);
    assert!(after < 0.7 * NOISE_M, "{after:e}");
}

#[test]
fn smooth_functions_hold_at_zero_what_a_plate_does_not_show() {
    let (truth, machine) = bridge(10, 4);
    let points = plate(&truth, HEIGHT_M, NOISE_M, 11);
    let plates = one_pose(&points, None);
    let options = PointOptions { method: Method::LevenbergMarquardt, loss: Loss::Huber };
    let found = fit_plates_smooth(&machine, &points, &plates, &options, &mut |_| true).unwrap();
    let names: Vec<&str> = found.not_seen.iter().map(|own| own.name.as_str()).collect();
    assert!(names.contains(&"EZZ") && names.contains(&"A0Z") && !names.contains(&"EXX"), "{names:?}");
    let after = left_m(&truth, &found, HEIGHT_M, &[0, 1, 2]);
    assert!(after < 0.8 * NOISE_M, "{after:e}");
}

#[test]
fn what_is_no_plate_is_refused_with_a_remedy() {
    let (truth, machine) = bridge(3, 2);
    let points = plate(&truth, HEIGHT_M, NOISE_M, 2);
    assert!(matches!(
        fit_points(&machine, &points, &PointOptions::default(), &mut |_| true),
        Err(PointsError::RankDeficient { .. })
    ));
    let names: Vec<String> = (0..points.len()).map(|k| format!("{k}")).collect();
    assert!(Plates::new(&names, None).unwrap_err().to_string().contains("four points"));
    let jade = PointOptions { method: Method::LevenbergMarquardt, loss: Loss::Trimmed };
    let refused = fit_plates(&machine, &points, &one_pose(&points, None), &jade, &mut |_| true).unwrap_err();
    assert!(refused.to_string().contains("huber or squares"), "{refused}");
    let few = &points[..5];
    assert!(fit_plates(&machine, few, &one_pose(few, None), &PointOptions::default(), &mut |_| true).is_err());
}
