//! Evidence for the fit of measured positions: both ways, outliers, what cannot be seen, what is refused.

use crate::common::{description, of_low_order};
use abbe_geometry::correct::correct;
use abbe_geometry::effects::{NoCovariates, State};
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::Machine;
use abbe_geometry::{ErrorId, Vector3};
use abbe_identify::points::{
    FittedPoints, JadeChoices, Loss, MeasuredPoint, Method, PointOptions, PointsError, fit_points,
    fit_points_of_best_degree, fit_points_smooth,
};
use abbe_virtual_machine::{TruthRecipe, VirtualMachine};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Standard deviation of each measured coordinate (m).
const NOISE_M: f64 = 0.3e-6;
const OFFSETS_M: [[f64; 3]; 3] = [[0.0, 0.0, -0.06], [0.12, 0.0, -0.06], [0.0, 0.14, -0.09]];

/// A bridge whose errors are polynomials of this degree, and what its maker writes down of it.
fn bridge(seed: u64, degree: u32) -> (VirtualMachine, Machine) {
    let mut truth = of_low_order(TruthRecipe { seed, ..TruthRecipe::default() }.bridge_xyz().unwrap(), degree);
    // The frame of the model: nothing of it moves with the mean of the offsets.
    truth.ram_turn.about_m = std::array::from_fn(|d| OFFSETS_M.iter().map(|offset| offset[d]).sum::<f64>() / 3.0);
    let mut machine = description(&truth, FunctionKind::Polynomial { degree: degree as usize });
    machine.repeatability_m = [0.0; 3];
    (VirtualMachine::new(truth).unwrap(), machine)
}

/// Random points in the stroke, seen from a frame that is turned by more than a radian.
fn measure(truth: &VirtualMachine, count: usize, noise_m: f64, seed: u64) -> Vec<MeasuredPoint> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let turn = nalgebra::Rotation3::new(Vector3::new(0.4, -0.7, 1.2));
    let stroke = truth.truth().stroke_m;
    let mut point = |k: usize| {
        let reading_m = stroke.map(|[low, high]| low + (high - low) * generator.random::<f64>());
        let offset_m = OFFSETS_M[k % 3];
        let mut noise = || noise_m * generator.sample::<f64, _>(StandardNormal);
        let actual = Vector3::from(truth.actual_point_m(reading_m, offset_m)) + Vector3::new(noise(), noise(), noise());
        MeasuredPoint { reading_m, offset_m, actual_m: turn * actual + Vector3::new(3.0, -1.0, 0.7), u_m: NOISE_M }
    };
    (0..count).map(&mut point).collect()
}

fn fit(machine: &Machine, points: &[MeasuredPoint], options: &PointOptions) -> Result<FittedPoints, PointsError> {
    fit_points(machine, points, options, &mut |_| true)
}

fn with(method: Method, loss: Loss) -> PointOptions {
    PointOptions { method, loss }
}

const LM: Method = Method::LevenbergMarquardt;

/// Rms of corrected minus true position (m) at points that no fit has seen, in the machine frame without alignment.
fn verification_rms_m(truth: &VirtualMachine, found: &FittedPoints) -> f64 {
    let fresh = measure(truth, 200, 0.0, 999);
    let error = |p: &MeasuredPoint| {
        let state = State { reading_m: p.reading_m, offset_m: p.offset_m, covariates: &NoCovariates };
        let actual = Vector3::from(truth.actual_point_m(p.reading_m, p.offset_m));
        (correct(&found.model, &state).position_m - actual).norm_squared()
    };
    (fresh.iter().map(error).sum::<f64>() / 200.0).sqrt()
}

#[test]
fn without_noise_every_error_and_the_measuring_frame_come_out() {
    let (truth, mut machine) = bridge(3, 3);
    let points = measure(&truth, 150, 0.0, 1);
    machine.rotation = abbe_geometry::rotation::RotationForm::Exact;
    // Nothing is known before: a prior of 200 µrad would pull 20 µrad by their ratio to what these points tell.
    machine.u_ram_turn_rad = [0.05; 3];
    let found = fit(&machine, &points, &PointOptions::default()).unwrap();
    for id in ErrorId::all() {
        for reading_m in [0.1, 0.3, 0.55] {
            let difference = found.model.error(id, reading_m).0 - truth.error_value(&id.name(), reading_m).unwrap();
            // Truth and model order their small rotations differently: (20 µrad)² over a metre.
            assert!(difference.abs() < 1e-9, "{} {difference:e}", id.name());
        }
    }
    for (k, squareness) in machine.squareness.iter().enumerate() {
        let truth = truth.squareness_rad(&squareness.name).unwrap();
        assert!((found.model.squareness(k).0 - truth).abs() < 1e-9, "{}", squareness.name);
    }
    for ((value, _), truth) in found.model.ram_turn().into_iter().zip(truth.truth().ram_turn.angles_rad) {
        assert!((value - truth).abs() < 1e-9, "{value:e} {truth:e}");
    }
    let p = &points[7];
    let back = found.pose.machine_from_measured * p.actual_m + found.pose.origin_m;
    let actual = Vector3::from(truth.actual_point_m(p.reading_m, p.offset_m));
    assert!((back - actual).norm() < 1e-9, "{:e}", (back - actual).norm());
    assert_eq!(found.evidence.rank, found.evidence.unknowns);
}

#[test]
fn with_noise_the_intervals_hold_and_chi_square_is_one() {
    let (mut inside, mut all) = (0, 0);
    for seed in 1..=12 {
        let (truth, machine) = bridge(seed, 3);
        let found = fit(&machine, &measure(&truth, 120, NOISE_M, seed), &PointOptions::default()).unwrap();
        // 360 equations, 57 unknowns: χ²/ν scatters by √(2/303) = 0.08; five of these.
        assert!((found.evidence.chi2_per_dof - 1.0).abs() < 0.4, "{}", found.evidence.chi2_per_dof);
        for id in ErrorId::all() {
            let (value, u) = found.model.error(id, 0.31);
            let truth = truth.error_value(&id.name(), 0.31).unwrap();
            inside += usize::from((value - truth).abs() <= 1.96 * u);
            all += 1;
        }
    }
    // 216 intervals of 95 %: 205 expected, deviation 3.2; widened where χ²/ν exceeds one by chance.
    assert!(inside as f64 > 0.90 * f64::from(all), "{inside} of {all}");
}

#[test]
fn jade_ends_where_levenberg_marquardt_does() {
    let (truth, mut machine) = bridge(5, 2);
    // Small enough for a test: what an offset is needed for is left out.
    for name in ["EAZ", "EBZ", "ECZ", "ECX", "ECY"] {
        machine.kinds[ErrorId::from_name(name).unwrap().index()] = None;
    }
    let points = measure(&truth, 60, NOISE_M, 2);
    let direct = fit(&machine, &points, &with(LM, Loss::Squares)).unwrap();
    let jade = fit(&machine, &points, &with(Method::Jade(JadeChoices::default()), Loss::Squares)).unwrap();
    assert!((jade.evidence.objective / direct.evidence.objective - 1.0).abs() < 1e-3);
    assert!(jade.evidence.objective >= direct.evidence.objective * (1.0 - 1e-12), "the minimum is not one");
    assert!(jade.evidence.largest_step <= 0.1);
    for id in ErrorId::all() {
        let ((a, u), (b, u_jade)) = (direct.model.error(id, 0.4), jade.model.error(id, 0.4));
        assert!((a - b).abs() <= 0.1 * u && (u - u_jade).abs() <= 1e-3 * u, "{}: {a:e} {b:e} {u:e}", id.name());
    }
    let again = fit(&machine, &points, &with(Method::Jade(JadeChoices::default()), Loss::Squares)).unwrap();
    assert_eq!(again.model.parts().coefficients, jade.model.parts().coefficients);
}

#[test]
fn a_jade_that_ran_out_of_generations_is_refused() {
    let (truth, machine) = bridge(5, 2);
    let points = measure(&truth, 60, NOISE_M, 2);
    for loss in [Loss::Squares, Loss::Huber] {
        let choices = JadeChoices { max_generations: 20, ..JadeChoices::default() };
        let refused = fit(&machine, &points, &with(Method::Jade(choices), loss)).unwrap_err();
        assert!(matches!(refused, PointsError::NotConverged { method: "JADE", steps: 20, .. }), "{refused}");
    }
}

#[test]
fn gross_errors_spoil_squares_but_not_the_robust_losses() {
    let (truth, machine) = bridge(7, 3);
    let mut points = measure(&truth, 150, NOISE_M, 3);
    (0..10).for_each(|k| points[15 * k].actual_m += Vector3::new(30e-6, -20e-6, 25e-6));
    let error = |loss| verification_rms_m(&truth, &fit(&machine, &points, &with(LM, loss)).unwrap());
    let clean = verification_rms_m(
        &truth,
        &fit(&machine, &measure(&truth, 150, NOISE_M, 3), &PointOptions::default()).unwrap(),
    );
    assert!(error(Loss::Squares) > 5.0 * clean);
    assert!(error(Loss::Huber) < 1.5 * clean);
    assert!(error(Loss::Trimmed) < 1.2 * clean);
    let trimmed = fit(&machine, &points, &with(LM, Loss::Trimmed)).unwrap();
    let rejected: Vec<usize> = trimmed.evidence.rejected.iter().map(|r| r.point).collect();
    assert_eq!(rejected, (0..10).map(|k| 15 * k + 1).collect::<Vec<_>>());
    assert_eq!(trimmed.model.parts().quality.rejected, 10);
}

#[test]
fn the_degree_is_the_one_that_the_machine_has() {
    for degree in [2, 4] {
        let (truth, machine) = bridge(9, degree);
        let points = measure(&truth, 250, NOISE_M, 4);
        let found =
            fit_points_of_best_degree(&machine, &points, 1..=7, &PointOptions::default(), &mut |_| true).unwrap();
        assert_eq!(found.model.parts().machine.kinds[0], Some(FunctionKind::Polynomial { degree: degree as usize }));
    }
}

/// The same grid of places along each axis, as artefacts are probed.
fn grid(truth: &VirtualMachine, places: usize, seed: u64) -> Vec<MeasuredPoint> {
    let mut points = measure(truth, places.pow(3), NOISE_M, seed);
    let stroke = truth.truth().stroke_m;
    let mut generator = ChaCha8Rng::seed_from_u64(seed + 1000);
    for (k, point) in points.iter_mut().enumerate() {
        let place = [k % places, k / places % places, k / places / places];
        let at = |d: usize| stroke[d][0] + (stroke[d][1] - stroke[d][0]) * place[d] as f64 / (places - 1) as f64;
        let (reading_m, offset_m) = ([0, 1, 2].map(at), OFFSETS_M[generator.random_range(0..3)]);
        let noise = Vector3::from_fn(|_, _| NOISE_M * generator.sample::<f64, _>(StandardNormal));
        let actual_m = Vector3::from(truth.actual_point_m(reading_m, offset_m)) + noise;
        *point = MeasuredPoint { reading_m, offset_m, actual_m, ..*point };
    }
    points
}

/// Error (m, machine frame) and standard uncertainty of each coordinate at points that no fit has seen.
fn verification(truth: &VirtualMachine, found: &FittedPoints) -> Vec<(f64, f64)> {
    let one = |p: &MeasuredPoint| {
        let state = State { reading_m: p.reading_m, offset_m: p.offset_m, covariates: &NoCovariates };
        let correction = correct(&found.model, &state);
        let off_m = correction.position_m - Vector3::from(truth.actual_point_m(p.reading_m, p.offset_m));
        let u_m = correction.covariance_m2.unwrap().diagonal().map(f64::sqrt);
        [0, 1, 2].map(|d| (off_m[d], u_m[d]))
    };
    measure(truth, 200, 0.0, 999).iter().flat_map(one).collect()
}

/// An error departs from a polynomial between the places of a grid, and no residual shows it: that was not in u, with coverages of
/// 35 to 66 %.
#[test]
fn regress_smooth_functions_know_what_lies_between_the_places_of_a_grid() {
    let (mut left, mut covered) = ([0.0; 2], [0, 0]);
    let seeds = 6;
    for seed in 1..=seeds {
        let mut truth = TruthRecipe { seed, ..TruthRecipe::default() }.bridge_xyz().unwrap();
        truth.ram_turn.about_m = std::array::from_fn(|d| OFFSETS_M.iter().map(|o| o[d]).sum::<f64>() / 3.0);
        let mut machine = description(&truth, FunctionKind::BSpline { intervals: 9 });
        machine.repeatability_m = [0.0; 3];
        let truth = VirtualMachine::new(truth).unwrap();
        let points = grid(&truth, 6, seed);
        let smooth = fit_points_smooth(&machine, &points, &PointOptions::default(), &mut |_| true).unwrap();
        let chosen = fit_points_of_best_degree(&machine, &points, 1..=8, &PointOptions::default(), &mut |_| true);
        for (k, found) in [smooth, chosen.unwrap()].iter().enumerate() {
            let all = verification(&truth, found);
            left[k] += all.iter().map(|(off_m, _)| off_m * off_m).sum::<f64>();
            covered[k] += all.iter().filter(|(off_m, u_m)| off_m.abs() <= 2.0 * u_m).count();
        }
    }
    let share = |k: usize| covered[k] as f64 / (600 * seeds) as f64;
    assert!(share(0) > 0.93, "{}, polynomials {}", share(0), share(1));
    assert!(left[0] < left[1], "{left:?}");
}

/// In much noise a low degree is chosen, and what it leaves out is in no covariance of it.
#[test]
fn regress_smooth_functions_know_what_noise_hides() {
    let (mut covered, mut all_of_them) = (0, 0);
    for seed in 1..=6 {
        let (truth, machine) = bridge(seed, 5);
        let mut points = measure(&truth, 200, 20.0 * NOISE_M, seed);
        points.iter_mut().for_each(|point| point.u_m = 20.0 * NOISE_M);
        let found = fit_points_smooth(&machine, &points, &PointOptions::default(), &mut |_| true).unwrap();
        assert!((found.evidence.chi2_per_dof - 1.0).abs() < 0.4, "{}", found.evidence.chi2_per_dof);
        let all = verification(&truth, &found);
        covered += all.iter().filter(|(off_m, u_m)| off_m.abs() <= 2.0 * u_m).count();
        all_of_them += all.len();
    }
    let share = covered as f64 / all_of_them as f64;
    assert!(share > 0.9, "{share}");
}

#[test]
fn smooth_functions_bear_gross_errors_as_polynomials_do() {
    let (truth, machine) = bridge(6, 3);
    let mut points = measure(&truth, 150, NOISE_M, 2);
    (0..5).for_each(|k| points[30 * k].actual_m += Vector3::new(0.0, 80e-6, -60e-6));
    let trimmed = fit_points_smooth(&machine, &points, &with(LM, Loss::Trimmed), &mut |_| true).unwrap();
    let rejected: Vec<usize> = trimmed.evidence.rejected.iter().map(|r| r.point).collect();
    assert_eq!(rejected, (0..5).map(|k| 30 * k + 1).collect::<Vec<_>>());
    let jade = with(Method::Jade(JadeChoices::default()), Loss::Squares);
    let refused = fit_points_smooth(&machine, &points, &jade, &mut |_| true).unwrap_err().to_string();
    assert!(refused.contains("JADE fits a fixed number"), "{refused}");
}

#[test]
fn points_that_cannot_see_an_error_are_refused_with_its_name() {
    let (truth, machine) = bridge(1, 2);
    let all = measure(&truth, 200, 0.0, 1);
    let refusal = |points: &[MeasuredPoint]| fit(&machine, points, &PointOptions::default()).unwrap_err();
    let moved = |change: fn(&mut MeasuredPoint)| {
        let mut points = all.clone();
        points.iter_mut().for_each(|p| {
            change(p);
            // In a frame of its own: where the scales say it would be a copy.
            p.actual_m = Vector3::from(p.reading_m) + Vector3::from(p.offset_m) + Vector3::new(1.0, 0.0, 0.0);
        });
        refusal(&points)
    };
    // One offset on the axis of Z: ECZ turns a point on its own axis, and so on.
    let text = moved(|p| p.offset_m = [0.0; 3]).to_string();
    assert!(text.contains("ECZ") && text.contains("EBZ") && text.contains("offset"), "{text}");
    // A plane: nothing of Z.
    let text = moved(|p| p.reading_m[2] = 0.3).to_string();
    assert!(text.contains("EZZ"), "{text}");
    // A line.
    let text = moved(|p| (p.reading_m[1], p.reading_m[2]) = (0.2, 0.3)).to_string();
    assert!(text.contains("EYY") && text.contains("EZZ"), "{text}");
    assert!(matches!(refusal(&all[..14]), PointsError::TooFew { points: 14, equations: 42, unknowns: 42 }));
    assert!(matches!(refusal(&[]), PointsError::TooFew { points: 0, .. }));
}

#[test]
fn points_in_a_wrong_unit_order_or_hand_are_refused() {
    let (truth, machine) = bridge(1, 2);
    let refusal = |change: fn(&mut MeasuredPoint)| {
        let mut points = measure(&truth, 100, NOISE_M, 1);
        points.iter_mut().for_each(change);
        fit(&machine, &points, &PointOptions::default()).unwrap_err()
    };
    assert!(matches!(refusal(|p| p.actual_m *= 1e3), PointsError::Mixed(_)));
    assert!(matches!(refusal(|p| p.actual_m.swap_rows(0, 1)), PointsError::Mixed(_)));
    assert!(matches!(refusal(|p| p.actual_m.x = -p.actual_m.x), PointsError::Mixed(_)));
    assert!(matches!(refusal(|p| p.reading_m = p.reading_m.map(|v| v * 1e3)), PointsError::OutsideStroke { .. }));
    assert!(matches!(refusal(|p| p.u_m = f64::NAN), PointsError::Uncertainty { point: 1, .. }));
    let jade = |choices| with(Method::Jade(choices), Loss::Squares);
    let points = measure(&truth, 100, NOISE_M, 1);
    for choices in [
        JadeChoices { members: Some(0), ..JadeChoices::default() },
        JadeChoices { members: Some(3), ..JadeChoices::default() },
        JadeChoices { max_generations: 0, ..JadeChoices::default() },
    ] {
        assert!(matches!(fit(&machine, &points, &jade(choices)), Err(PointsError::Jade(_))), "{choices:?}");
    }
    let choices = JadeChoices { perturbation: 0.0, ..JadeChoices::default() };
    assert!(matches!(fit(&machine, &points, &jade(choices)), Err(PointsError::Choice(_))));
}

#[test]
fn a_stop_ends_both_ways() {
    let (truth, machine) = bridge(1, 2);
    let points = measure(&truth, 100, NOISE_M, 1);
    for method in [LM, Method::Jade(JadeChoices::default())] {
        let stopped = fit_points(&machine, &points, &with(method, Loss::Squares), &mut |p| p.step < 2);
        assert_eq!(stopped.unwrap_err(), PointsError::Stopped);
    }
}

/// Measured positions tell the turn of the ram where offsets differ, and say what they do not know where they do not.
#[test]
fn positions_tell_the_turn_of_the_ram_or_carry_it_as_uncertainty() {
    let (mut inside, mut all) = (0, 0);
    for seed in 1..=8 {
        let (mut truth, mut machine) = bridge(seed, 3);
        let mut data = truth.truth().clone();
        data.ram_turn.angles_rad =
            [1.7, -0.6, 0.9].map(|factor| factor * 150e-6 * if seed % 2 == 0 { 1.0 } else { -1.0 });
        truth = VirtualMachine::new(data.clone()).unwrap();
        let found = fit(&machine, &measure(&truth, 120, NOISE_M, seed), &PointOptions::default()).unwrap();
        for ((value, u), truth) in found.model.ram_turn().into_iter().zip(data.ram_turn.angles_rad) {
            assert!(u < 5e-6, "{u:e}");
            inside += usize::from((value - truth).abs() <= 1.96 * u);
            all += 1;
        }
        // One offset: nothing is told of the turn, points with that offset do not suffer, others carry it.
        for name in ["ECY", "ECZ", "EAZ", "EBZ"] {
            machine.kinds[ErrorId::from_name(name).unwrap().index()] = None;
            data.errors.remove(name).unwrap();
        }
        let truth = VirtualMachine::new(data).unwrap();
        let mut points = measure(&truth, 120, NOISE_M, seed);
        points.retain(|point| point.offset_m == OFFSETS_M[1]);
        points.extend(measure(&truth, 240, NOISE_M, seed + 50).into_iter().filter(|p| p.offset_m == OFFSETS_M[1]));
        let one = fit(&machine, &points, &PointOptions::default()).unwrap();
        let u_m = |offset_m: [f64; 3]| {
            let state = State { reading_m: [0.3, 0.2, 0.4], offset_m, covariates: &NoCovariates };
            correct(&one.model, &state).covariance_m2.unwrap().trace().sqrt()
        };
        assert!(u_m(OFFSETS_M[1]) < 1e-6, "{:e}", u_m(OFFSETS_M[1]));
        // 185 mm away, 200 µrad about two axes across it: 52 µm.
        assert!((40e-6..65e-6).contains(&u_m(OFFSETS_M[2])), "{:e}", u_m(OFFSETS_M[2]));
    }
    // 24 intervals of 95 %.
    assert!(inside >= 20, "{inside} of {all}");
}
