//! The 95 % intervals of corrected coordinates hold 95 % of the truth.
//!
//! Place in the flow: many simulated machines, each with a campaign of its own, are identified; the corrected
//! coordinates of random points are compared with where the reflector really was, in the machine frame. Points of
//! one machine share its frame and its error functions, so machines, not points, make the statistics.
//!
//! A second set of machines has rams that stand hundreds of microradians off the axes, campaigns that tell all, some or
//! nothing of it, and points with offsets that were measured, that lie between them, and far outside.

use crate::common::{Case, INSTRUMENT, SPLINE, held_zero};
use abbe_geometry::ErrorId;
use abbe_geometry::correct::correct;
use abbe_geometry::effects::{NoCovariates, State};
use abbe_geometry::machine::USUAL_RAM_TURN_RAD;
use abbe_geometry::model::MachineModel;
use abbe_geometry::{Matrix3, Vector3};
use abbe_identify::{IdentifyOptions, in_parallel};
use abbe_virtual_machine::TruthRecipe;
use abbe_virtual_machine::plan::{PlanRecipe, presets};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Machines: the share covered by one varies by 4 %, so that the mean of 80 is known to 0.5 %.
const MACHINES: u64 = 120;
/// Points of each machine.
const POINTS: usize = 150;
/// Quantile of the normal distribution for 95 %.
const QUANTILE: f64 = 1.96;

/// Share of the coordinates inside their interval, by axis.
#[derive(Debug, Clone, Copy, Default)]
struct Covered {
    /// Where the reflector went, repeatability included: what a user of the machine sees.
    one_reading: [f64; 3],
    /// Where it goes on average, without repeatability in the interval: the model's own uncertainty.
    model_alone: [f64; 3],
    /// Mean square of the model's error in units of its uncertainty.
    model_square: [f64; 3],
}

fn covered(seed: u64) -> Covered {
    let truth = TruthRecipe { seed, ..TruthRecipe::default() }.bridge_xyz().unwrap();
    let case = Case::case_like(truth, SPLINE, seed + 500);
    let found = case.identify(&IdentifyOptions::default());
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut generator) };
    let mut share = Covered::default();
    let repeatability = Vector3::from(INSTRUMENT.repeatability_m);
    for (error_m, correction) in case.verify(&found.model, POINTS) {
        let full = correction.covariance_m2.unwrap();
        let model = full - Matrix3::from_diagonal(&repeatability.component_mul(&repeatability));
        let stopped_m = repeatability.component_mul(&Vector3::from_fn(|_, _| normal()));
        for d in 0..3 {
            let inside = |error_m: f64, variance: f64| f64::from(error_m.abs() <= QUANTILE * variance.sqrt());
            share.one_reading[d] += inside(error_m[d] - stopped_m[d], full[(d, d)]) / POINTS as f64;
            share.model_alone[d] += inside(error_m[d], model[(d, d)]) / POINTS as f64;
            share.model_square[d] += error_m[d].powi(2) / model[(d, d)] / POINTS as f64;
        }
    }
    share
}

/// Runs `machines` on the threads there are; the order of the results is that of the seeds.
fn all_machines<T: Send>(machines: u64, run: impl Fn(u64) -> T + Sync) -> Vec<T> {
    in_parallel(&(1..=machines).collect::<Vec<_>>(), |seed| run(*seed))
}

/// Mean and standard deviation of the mean.
fn mean(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    (mean, (values.map(|v| (v - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt())
}

#[test]
fn the_95_per_cent_intervals_hold_95_per_cent_of_the_points_in_each_axis() {
    let all = all_machines(MACHINES, covered);
    let mut shares = Vec::new();
    for d in 0..3 {
        let (seen, u_seen) = mean(all.iter().map(|c| c.one_reading[d]));
        let (alone, u_alone) = mean(all.iter().map(|c| c.model_alone[d]));
        let (square, u_square) = mean(all.iter().map(|c| c.model_square[d]));
        let axis = ['X', 'Y', 'Z'][d];
        println!(
            "{axis}: one reading {:.1} ± {:.1} %, model alone {:.1} ± {:.1} %, mean square {square:.2} ± {u_square:.2}",
            seen * 1e2,
            u_seen * 1e2,
            alone * 1e2,
            u_alone * 1e2
        );
        shares.push((axis, seen, alone));
    }
    for (axis, seen, alone) in shares {
        assert!((seen - 0.95).abs() <= 0.02, "{axis}: {seen:.4} of one reading's points");
        assert!((alone - 0.95).abs() <= 0.02, "{axis}: {alone:.4} of the model's points");
    }
}

/// Offsets of the case-like plan, and what is asked for besides: between these, and far outside (m, ram frame).
const MEASURED_M: [[f64; 3]; 3] = presets::CASE_OFFSETS_M;
const BETWEEN_M: [f64; 3] = [0.04, 0.05, -0.07];
const OUTSIDE_M: [f64; 3] = [-0.15, 0.1, -0.25];
/// Machines of each plan: 48 angles, whose intervals hold 95 ± 3 % of the truth.
const TURNED_MACHINES: u64 = 16;

/// A machine whose ram is turned by normal angles of this standard deviation, measured with these offsets.
fn turned(seed: u64, turn_rad: f64, offsets_m: &[[f64; 3]], zero: &[&str]) -> (Case, MachineModel) {
    let mut truth = TruthRecipe { seed, ..TruthRecipe::default() }.bridge_xyz().unwrap();
    let mut generator = ChaCha8Rng::seed_from_u64(seed + 9000);
    truth.ram_turn.angles_rad = [0; 3].map(|_| {
        let drawn: f64 = StandardNormal.sample(&mut generator);
        turn_rad * drawn
    });
    let mut kinds = [Some(SPLINE); ErrorId::COUNT];
    held_zero(&mut truth, &mut kinds, zero);
    let recipe = PlanRecipe { offsets_m: offsets_m.to_vec(), ..presets::case_like(truth.stroke_m, seed) };
    let mut case = Case::new(truth, recipe.build().unwrap(), SPLINE, seed + 700);
    case.machine.kinds = kinds;
    let model = case.identify(&IdentifyOptions::default()).model;
    (case, model)
}

/// Share of the coordinates within their interval at random points with this offset, and rms of error and uncertainty (m).
fn held(machines: &[(Case, MachineModel)], offset_m: [f64; 3]) -> (f64, f64, f64) {
    let (mut inside, mut square, mut variance, mut count) = (0.0, 0.0, 0.0, 0.0);
    for (case, model) in machines {
        let repeatability = Vector3::from(INSTRUMENT.repeatability_m);
        for point in case.verification(40) {
            let state = State { reading_m: point.reading_m, offset_m, covariates: &NoCovariates };
            let correction = correct(model, &state);
            let actual_m = Vector3::from(case.simulated.truth.machine.actual_point_m(point.reading_m, offset_m));
            let error_m = correction.position_m - actual_m;
            let of_model = correction.covariance_m2.unwrap()
                - Matrix3::from_diagonal(&repeatability.component_mul(&repeatability));
            for d in 0..3 {
                inside += f64::from(error_m[d].abs() <= QUANTILE * of_model[(d, d)].sqrt());
                square += error_m[d].powi(2);
                variance += of_model[(d, d)];
                count += 1.0;
            }
        }
    }
    (inside / count, (square / count).sqrt(), (variance / count).sqrt())
}

/// Shares within their interval at each of these offsets, printed with what they are made of.
#[track_caller]
fn assert_held(what: &str, machines: &[(Case, MachineModel)], offsets_m: &[([f64; 3], f64, f64)]) {
    for (offset_m, least, widest_m) in offsets_m {
        let (share, error_m, u_m) = held(machines, *offset_m);
        let (error_um, u_um) = (error_m * 1e6, u_m * 1e6);
        println!("{what} {offset_m:?}: {:.1} % within, error {error_um:.2} µm, u {u_um:.2} µm", share * 1e2);
        assert!(share >= *least, "{what} {offset_m:?}: {share}");
        assert!(u_m < *widest_m, "{what} {offset_m:?}: {u_um} µm is no use");
    }
}

#[test]
fn regress_three_offsets_tell_how_the_ram_stands() {
    let machines = all_machines(TURNED_MACHINES, |seed| turned(seed, 150e-6, &MEASURED_M, &[]));
    // Angles of hundreds of microradians are known to some: no part of them is left to the splines.
    let (mut inside, mut largest_u) = (0, 0.0_f64);
    for (case, model) in &machines {
        for ((value, u), truth) in model.ram_turn().into_iter().zip(case.config.machine.ram_turn.angles_rad) {
            inside += usize::from((value - truth).abs() <= QUANTILE * u);
            largest_u = largest_u.max(u);
        }
    }
    println!("{inside} of {} angles within, u up to {:.1} µrad", 3 * machines.len(), largest_u * 1e6);
    assert!(inside >= 42 && largest_u < 6e-6, "{inside} {largest_u}");
    let measured = MEASURED_M.map(|offset_m| (offset_m, 0.91, 0.6e-6));
    assert_held("three", &machines, &measured);
    assert_held("three", &machines, &[(BETWEEN_M, 0.91, 0.6e-6), (OUTSIDE_M, 0.91, 2e-6)]);
}

#[test]
fn offsets_along_a_line_leave_one_angle_and_the_uncertainty_says_so() {
    let along_x = [[0.0, 0.0, -0.06], [0.12, 0.0, -0.06]];
    let machines = all_machines(TURNED_MACHINES, |seed| turned(seed, USUAL_RAM_TURN_RAD, &along_x, &["EAZ"]));
    for (_, model) in &machines {
        let [about_the_line, b, c] = model.ram_turn().map(|(_, u)| u);
        assert!((about_the_line / USUAL_RAM_TURN_RAD - 1.0).abs() < 0.05, "{about_the_line:e}");
        assert!(b.max(c) < 6e-6, "{b:e} {c:e}");
    }
    let on_the_line = [along_x[0], along_x[1], [0.06, 0.0, -0.06]].map(|offset_m| (offset_m, 0.91, 0.6e-6));
    assert_held("line", &machines, &on_the_line);
    // 0.14 m off the line: 28 µm, and the truth is as far off.
    assert_held("line", &machines, &[([0.06, 0.14, -0.06], 0.88, 30e-6), (OUTSIDE_M, 0.88, 60e-6)]);
}

#[test]
fn an_offset_a_station_tells_nothing_and_its_points_say_so() {
    let machines = all_machines(TURNED_MACHINES, |seed| {
        let mut truth = TruthRecipe { seed, ..TruthRecipe::default() }.bridge_xyz().unwrap();
        let mut generator = ChaCha8Rng::seed_from_u64(seed + 9000);
        truth.ram_turn.angles_rad = [0; 3].map(|_| {
            let drawn: f64 = StandardNormal.sample(&mut generator);
            USUAL_RAM_TURN_RAD * drawn
        });
        let mut plan = presets::case_like(truth.stroke_m, seed).build().unwrap();
        for (k, station) in plan.stations.iter_mut().enumerate() {
            station.lines.iter_mut().for_each(|line| line.offset_m = MEASURED_M[k % 3]);
        }
        let case = Case::new(truth, plan, SPLINE, seed + 700);
        let model = case.identify(&IdentifyOptions::default()).model;
        (case, model)
    });
    for (_, model) in &machines {
        assert!(model.ram_turn().iter().all(|(_, u)| (u / USUAL_RAM_TURN_RAD - 1.0).abs() < 0.05));
    }
    assert_held("station", &machines, &MEASURED_M.map(|offset_m| (offset_m, 0.88, 30e-6)));
}

#[test]
fn one_offset_is_as_certain_as_ever_and_others_are_not() {
    let one = [MEASURED_M[1]];
    let zero = ["ECY", "ECZ", "EAZ", "EBZ"];
    let machines = all_machines(TURNED_MACHINES, |seed| turned(seed, USUAL_RAM_TURN_RAD, &one, &zero));
    for (_, model) in &machines {
        assert_eq!(model.parts().offset_centre_m, one[0]);
        assert!(model.ram_turn().iter().all(|(value, u)| *value == 0.0 && (u / USUAL_RAM_TURN_RAD - 1.0).abs() < 0.05));
    }
    assert_held("one", &machines, &[(one[0], 0.91, 0.6e-6)]);
    assert_held("one", &machines, &[(MEASURED_M[2], 0.88, 60e-6), (OUTSIDE_M, 0.88, 100e-6)]);
}
