//! Evidence for what the nodes compute: one output a reading, honest statuses, a monitor that notices.

use crate::common::{Bench, HASH, bench, monitor, other_bench};
use abbe_geometry::correct::correct;
use abbe_geometry::effects::{NoCovariates, Shape, State};
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::{ErrorId, Vector3};
use abbe_graph::step::{
    GeometricStep, Health, HealthState, Mark, MonitorSettings, MonitorStep, ResidualStep, StreamWatch,
};
use abbe_identify::{EffectTerm, IdentifyOptions, OrderChoice, TIME, identify_with};
use abbe_measurement::campaign::Campaign;
use abbe_msgs::{
    CorrectedCoordinates, CorrectionStatus, RangeResidual, ResidualStatus, ScaleReading, Sha256, Stamp, Text,
    TracerReading,
};
use abbe_virtual_machine::effects::from_text;
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::instrument::InstrumentConfig;
use abbe_virtual_machine::machine::{Roughness, Term};
use abbe_virtual_machine::plan::presets::case_like;
use abbe_virtual_machine::plan::{LineSelection, PlanRecipe};
use abbe_virtual_machine::{SimulationConfig, TruthRecipe, simulate_campaign};
use std::sync::Arc;

const OTHER_HASH: Sha256 = Sha256::from_bytes([4; 32]);

fn geometric() -> GeometricStep {
    GeometricStep::new(Some((bench().model.clone(), HASH)), 10.0)
}

fn scale(row: usize) -> ScaleReading {
    bench().scale(row)
}

fn tracer(row: usize, error_m: f64) -> TracerReading {
    bench().tracer(row, error_m)
}

/// Runs rows through correction and monitor; `error_m` is added to the lengths.
fn run(monitor: &mut MonitorStep, rows: std::ops::Range<usize>, error_m: impl Fn(usize) -> f64) -> Vec<RangeResidual> {
    let step = geometric();
    let each = |row: usize| {
        assert!(monitor.corrected(&step.correct(&scale(row))).is_empty());
        monitor.tracer(&tracer(row, error_m(row))).unwrap()
    };
    rows.map(each).collect()
}

#[test]
fn the_node_gives_what_the_correcting_function_gives() {
    for row in (0..bench().campaign.readings.len()).step_by(97) {
        let sample = ResidualStep::default().correct(&geometric().correct(&scale(row)), None);
        let reading = &bench().campaign.readings[row];
        let state = State { reading_m: reading.reading_m, offset_m: reading.offset_m, covariates: &NoCovariates };
        let expected = correct(&bench().model, &state);
        assert_eq!(sample.corrected_m, <[f64; 3]>::from(expected.position_m));
        assert_eq!(sample.status, CorrectionStatus::InVolume);
        assert_eq!((sample.sequence, sample.stamp), (row as u64, scale(row).stamp));
        assert_eq!(sample.model_sha256, HASH);
        let sum = |d: usize| {
            sample.reading_m[d] + sample.offset_m[d] + sample.geometric_correction_m[d] + sample.effect_correction_m[d]
        };
        assert!((0..3).all(|d| (sum(d) - sample.corrected_m[d]).abs() < 1e-15));
    }
}

#[test]
fn without_a_model_the_sample_says_so_and_repeats_the_indicated_position() {
    let sample = GeometricStep::new(None, 10.0).correct(&scale(0));
    assert_eq!(sample.status, CorrectionStatus::NoModel);
    assert!(!sample.corrected_valid && sample.corrected_point_in_machine_m().is_none());
    assert!(sample.model_sha256.is_none());
}

#[test]
fn extrapolated_and_rejected_readings_are_told_apart() {
    let at = |x_m: f64| {
        let mut reading = scale(0);
        reading.reading_m[0] = x_m;
        geometric().correct(&reading)
    };
    assert_eq!(at(0.4).status, CorrectionStatus::InVolume);
    assert_eq!(at(0.81).status, CorrectionStatus::Extrapolated);
    assert!(at(0.81).corrected_valid);
    for x_m in [5.0, f64::NAN, f64::INFINITY] {
        assert_eq!(at(x_m).status, CorrectionStatus::Rejected, "{x_m}");
        assert!(!at(x_m).corrected_valid);
    }
    let mut far_offset = scale(0);
    far_offset.offset_m[2] = 0.3;
    assert_eq!(geometric().correct(&far_offset).status, CorrectionStatus::Extrapolated);
}

#[test]
fn the_monitor_finds_a_sound_model_consistent() {
    let mut monitor = monitor();
    let residuals = run(&mut monitor, 0..600, |_| 0.0);
    assert_eq!(monitor.health().state, HealthState::Consistent, "{:?}", monitor.health());
    assert!(residuals.iter().all(|r| r.residual_valid));
    let worst = residuals.iter().map(|r| r.residual_m.abs()).fold(0.0, f64::max);
    assert!(worst < 3e-6, "{worst}");
}

#[test]
fn the_monitor_allows_for_what_a_residual_field_leaves_open() {
    let judged = |sample: &CorrectedCoordinates| {
        let mut monitor = monitor();
        monitor.corrected(sample);
        monitor.tracer(&tracer(0, 0.0)).unwrap()
    };
    let sample = geometric().correct(&scale(0));
    let added_m2 = Vector3::new(1e-12, 4e-12, 9e-12);
    let mut widened = sample;
    (0..3).for_each(|axis| widened.covariance_m2[4 * axis] += added_m2[axis]);
    let (plain, widened) = (judged(&sample), judged(&widened));
    let (_, station) = bench().model.station(plain.station.as_str()).unwrap();
    let direction = (Vector3::from(sample.corrected_m) - station.position_m).normalize();
    let expected_m = (plain.u_residual_m.powi(2) + direction.component_mul(&direction).dot(&added_m2)).sqrt();
    assert!((widened.u_residual_m / expected_m - 1.0).abs() < 1e-9, "{} {expected_m}", widened.u_residual_m);
    assert!(widened.u_residual_m > 2.0 * plain.u_residual_m);
    assert_eq!(widened.residual_m, plain.residual_m);
}

#[test]
fn the_monitor_notices_a_machine_that_drifts() {
    let mut monitor = monitor();
    run(&mut monitor, 0..300, |_| 0.0);
    assert_eq!(monitor.health().state, HealthState::Consistent);
    let residuals = run(&mut monitor, 300..600, |row| (row - 300) as f64 * 20e-9);
    assert_eq!(monitor.health().state, HealthState::Degraded, "{:?}", monitor.health());
    assert!(residuals.iter().any(|r| r.status == ResidualStatus::OutOfBounds));
}

#[test]
fn the_order_of_arrival_changes_nothing() {
    let step = geometric();
    let rows = 0..50;
    let mut corrected_first = monitor();
    let expected = run(&mut corrected_first, rows.clone(), |_| 0.0);
    let mut tracer_first = monitor();
    assert!(rows.clone().all(|row| tracer_first.tracer(&tracer(row, 0.0)).is_none()));
    let samples: Vec<CorrectedCoordinates> = rows.map(|row| step.correct(&scale(row))).collect();
    let found: Vec<RangeResidual> = samples.iter().flat_map(|sample| tracer_first.corrected(sample)).collect();
    assert_eq!(found, expected);
}

#[test]
fn what_cannot_be_predicted_is_said_not_guessed() {
    let mut monitor = monitor();
    monitor.corrected(&geometric().correct(&scale(0)));
    let mut stranger = tracer(0, 0.0);
    stranger.station = Text::new("S99").unwrap();
    let residual = monitor.tracer(&stranger).unwrap();
    assert_eq!(residual.status, ResidualStatus::UnknownStation);
    assert!(residual.residual().is_none());
    monitor.corrected(&GeometricStep::new(None, 10.0).correct(&scale(1)));
    assert_eq!(monitor.tracer(&tracer(1, 0.0)).unwrap().status, ResidualStatus::NotCorrected);
    assert_eq!(monitor.health().unpredicted, 2);
    assert_eq!(monitor.health().state, HealthState::Unknown);
}

/// The machine of the other bench, corrected by its own model.
fn other_sample(row: usize) -> CorrectedCoordinates {
    GeometricStep::new(Some((other_bench().model.clone(), OTHER_HASH)), 10.0).correct(&other_bench().scale(row))
}

#[test]
fn each_sample_is_judged_by_the_model_that_it_names() {
    let mut monitor = monitor();
    run(&mut monitor, 0..250, |_| 0.0);
    assert!(monitor.learn(other_bench().model.clone(), OTHER_HASH).is_empty());
    assert_eq!(monitor.health().model_sha256, HASH, "known, but nothing is corrected by it yet");
    // Two late readings of samples made by the first model.
    let late = [geometric().correct(&scale(250)), geometric().correct(&scale(251))];
    late.iter().for_each(|sample| assert!(monitor.corrected(sample).is_empty()));
    (400..650).for_each(|row| assert!(monitor.corrected(&other_sample(row)).is_empty()));
    // The tracer is behind: its readings of the first model come when the second is in use.
    for row in [250, 251] {
        let residual = monitor.tracer(&tracer(row, 0.0)).unwrap();
        assert_eq!((residual.model_sha256, residual.status), (HASH, ResidualStatus::Consistent), "{residual:?}");
    }
    let health = monitor.health();
    assert_eq!((health.residuals, health.model_sha256), (0, OTHER_HASH), "late ones say nothing about the one in use");
    for row in 400..650 {
        let residual = monitor.tracer(&other_bench().tracer(row, 0.0)).unwrap();
        assert_eq!((residual.model_sha256, residual.status), (OTHER_HASH, ResidualStatus::Consistent), "{residual:?}");
    }
    let in_use = monitor.health();
    assert_eq!((in_use.state, in_use.model_sha256), (HealthState::Consistent, OTHER_HASH));
}

#[test]
fn the_verdict_begins_anew_with_a_new_model() {
    let mut monitor = monitor();
    run(&mut monitor, 0..300, |_| 5e-6);
    assert_eq!(monitor.health().state, HealthState::Degraded);
    monitor.learn(other_bench().model.clone(), OTHER_HASH);
    monitor.corrected(&other_sample(400));
    let health = monitor.health();
    assert_eq!((health.state, health.residuals, health.unsound), (HealthState::Unknown, 0, None));
    let residual = monitor.tracer(&other_bench().tracer(400, 0.0)).unwrap();
    assert_eq!(monitor.health().unsound.unwrap().since, residual.stamp, "not yet shown to be sound");
}

#[test]
fn a_sample_waits_for_the_model_it_names_and_is_told_when_that_never_comes() {
    let pair = |monitor: &mut MonitorStep, row: usize| {
        monitor.corrected(&other_sample(row));
        monitor.tracer(&other_bench().tracer(row, 0.0))
    };
    let mut early = monitor();
    assert!((0..20).all(|row| pair(&mut early, row).is_none()));
    assert_eq!(early.awaited_model(), Some(OTHER_HASH));
    let residuals = early.learn(other_bench().model.clone(), OTHER_HASH);
    assert_eq!(residuals.iter().map(|r| r.sequence).collect::<Vec<_>>(), (0..20).collect::<Vec<_>>());
    assert!(residuals.iter().all(|r| r.status == ResidualStatus::Consistent));
    assert_eq!((early.awaited_model(), early.health().residuals), (None, 20));
    let mut never = monitor();
    assert!((0..20).all(|row| pair(&mut never, row).is_none()));
    let residuals = never.give_up();
    assert!(residuals.iter().all(|r| r.status == ResidualStatus::NotCorrected && !r.residual_valid));
    assert_eq!((residuals.len(), never.health().unpredicted, never.health().residuals), (20, 20, 0));
}

/// A simulated machine with this effect on its ranges, measured and then identified from every second line with `effect` in
/// the model.
fn with_effect(seed: u64, truth: &str, effect: &str, shape: Shape) -> Bench {
    let recipe = TruthRecipe { seed, roughness: Roughness::SMOOTH, volumetric_rms_m: 20e-6 };
    let mut machine_truth = recipe.bridge_xyz().unwrap();
    // Polynomials of that degree hold the truth, so that nothing but the effect is to be seen.
    for terms in machine_truth.errors.values_mut() {
        terms.retain(|term| matches!(term, Term::Chebyshev { order, .. } if *order <= DEGREE as u32));
    }
    let few = PlanRecipe { selection: LineSelection::Drawn(20), ..case_like(machine_truth.stroke_m, seed) };
    let config = SimulationConfig {
        seed,
        machine: machine_truth,
        plan: few.build().unwrap(),
        instrument: InstrumentConfig::LASER_TRACER,
        environment: EnvironmentConfig::workshop(),
        effects: vec![from_text(truth).unwrap()],
    };
    let campaign = simulate_campaign(&config).unwrap().campaign;
    let mut machine = bench().machine.clone();
    machine.machine.kinds = [Some(FunctionKind::Polynomial { degree: DEGREE }); ErrorId::COUNT];
    let term = EffectTerm::new(effect, shape, &machine.machine).unwrap();
    let options = IdentifyOptions { order: OrderChoice::Fixed, ..IdentifyOptions::default() };
    let seen = half(&campaign, false);
    let found = identify_with(&machine.machine, machine.instrument, &seen, &[term], &options, &mut |_| true).unwrap();
    Bench { machine, campaign, model: Arc::new(found.model) }
}

const DEGREE: usize = 5;

/// Readings of every second line, or of the others.
fn half(campaign: &Campaign, odd: bool) -> Campaign {
    let of_half = |k: &usize| (campaign.readings[*k].line % 2 == 1) == odd;
    campaign.part(&(0..campaign.readings.len()).filter(of_half).collect::<Vec<_>>())
}

/// The scale reading of a row with all that the campaign logged, but for `without`.
fn logged_scale(bench: &Bench, row: usize, without: &str) -> ScaleReading {
    let mut reading = bench.scale(row);
    let campaign = &bench.campaign;
    let logged = campaign.covariates.iter().filter_map(|c| Some((c.name.as_str(), c.values[row]?)));
    for (name, value) in logged.chain([(TIME, campaign.readings[row].time_s)]).filter(|(name, _)| *name != without) {
        reading.covariates.push(name, value, 0.0).unwrap();
    }
    reading
}

/// What the monitor says of the lines that the model was not identified from.
fn judged(bench: &Bench, without: &str) -> (Health, Vec<RangeResidual>) {
    let settings = MonitorSettings { single_bound: 5.0, window: usize::MAX, match_within_s: 0.0005 };
    let mut monitor = MonitorStep::new(bench.model.clone(), HASH, settings).with_scales(10.0);
    let step = GeometricStep::new(Some((bench.model.clone(), HASH)), 10.0);
    let mut residuals = Vec::new();
    for row in (0..bench.campaign.readings.len()).filter(|row| bench.campaign.readings[*row].line % 2 == 1) {
        let scale = logged_scale(bench, row, without);
        // In every order of arrival.
        let corrected = step.correct(&scale);
        if row % 3 == 0 {
            residuals.extend(monitor.scale(&scale));
        }
        residuals.extend(monitor.corrected(&corrected));
        if row % 3 == 1 {
            residuals.extend(monitor.scale(&scale));
        }
        let reading = TracerReading { u_length_m: bench.u_length_m(row), ..bench.tracer(row, 0.0) };
        residuals.extend(monitor.tracer(&reading));
        if row % 3 == 2 {
            residuals.extend(monitor.scale(&scale));
        }
    }
    residuals.extend(monitor.give_up());
    (monitor.health(), residuals)
}

/// Refraction and drift of a station act on the range alone: the model holds them, so the monitor must predict them.
#[test]
fn regress_the_monitor_is_consistent_once_what_acts_on_the_range_is_in_the_model() {
    let stations = ["S1", "S2", "S3", "S4", "S5"].map(str::to_owned);
    let drift = Shape::new().texts("stations", &stations).number("start_s", 0.0);
    let cases = [
        ("refraction range_share=1.0", "refraction", refraction(), "pressure_hpa"),
        ("station_drift rate_x_um_h=8 rate_y_um_h=5 rate_z_um_h=-5", "station_drift", drift, TIME),
    ];
    for (truth, effect, shape, asked) in cases {
        let seeds = 1..=SEEDS;
        let mean_squares: Vec<f64> = seeds
            .map(|seed| {
                let bench = with_effect(seed, truth, effect, shape.clone());
                let (health, residuals) = judged(&bench, "");
                assert_eq!(health.state, HealthState::Consistent, "{effect}, seed {seed}: {health:?}");
                assert!(residuals.iter().all(|r| r.residual_valid), "{effect}, seed {seed}");
                if seed == 1 {
                    // Without what the effect depends on nothing is predicted, and nothing is guessed.
                    let (blind, residuals) = judged(&bench, asked);
                    assert!(residuals.iter().all(|r| r.status == ResidualStatus::NotPredicted), "{:?}", residuals[0]);
                    assert_eq!((blind.state, blind.unpredicted), (HealthState::Unknown, residuals.len() as u64));
                    assert_eq!(residuals.len(), health.residuals);
                    // What the length would be without the effect: this is what the monitor used to compare with.
                    assert!(without_effect(&bench) > 2.0, "{effect} shows: {}", without_effect(&bench));
                }
                health.mean_square.unwrap()
            })
            .collect();
        let mean = mean_squares.iter().sum::<f64>() / mean_squares.len() as f64;
        println!("{effect}: mean square {mean:.3} over {} seeds, {mean_squares:.2?}", mean_squares.len());
        // Some 600 residuals a seed, which share what is uncertain of the model: a twentieth of scatter each.
        assert!((mean - 1.0).abs() < 0.1, "{effect}: {mean}");
    }
}

/// Machines that the monitor is tried on.
const SEEDS: u64 = 20;

/// Mean square of the residuals against the range to the corrected position alone.
fn without_effect(bench: &Bench) -> f64 {
    let step = GeometricStep::new(Some((bench.model.clone(), HASH)), 10.0);
    let squares = |row: usize| {
        let (sample, reading) = (step.correct(&logged_scale(bench, row, "")), &bench.campaign.readings[row]);
        let (_, station) = bench.model.station(&bench.campaign.stations[reading.station as usize]).unwrap();
        let range_m = (Vector3::from(sample.corrected_m) - station.position_m).norm() - station.dead_path_m;
        ((reading.length_m - range_m) / bench.u_length_m(row)).powi(2)
    };
    let rows = bench.campaign.readings.len();
    (0..rows).map(squares).sum::<f64>() / rows as f64
}

#[test]
fn a_line_of_the_name_of_an_outlying_run_is_not_predicted() {
    let bench = bench();
    let shape = Shape::new().text("line", "L7");
    let mut parts = bench.model.parts().clone();
    let run = abbe_geometry::model::MachineModel::fitted_effect("outlying_run", shape, &parts.machine, vec![20e-6]);
    parts.effects.push(run.unwrap());
    parts.quality.unseen_expansions = Default::default();
    // One parameter more, between the geometry and the stations, of no uncertainty.
    let (before, size) =
        (bench.model.machine_parameters(), bench.model.machine_parameters() + 4 * parts.stations.len());
    let old = |k: usize| (k != before).then(|| k - usize::from(k > before));
    let entry = |(a, b): (usize, usize)| match (old(a), old(b)) {
        (Some(a), Some(b)) => bench.model.covariance(a, b),
        _ => 0.0,
    };
    parts.covariance = (0..=size).flat_map(|a| (0..=a).map(move |b| (a, b))).map(entry).collect();
    let model = Arc::new(abbe_geometry::model::MachineModel::new(parts).unwrap());
    let settings = MonitorSettings { single_bound: 4.0, window: 200, match_within_s: 0.0005 };
    let mut monitor = MonitorStep::new(model.clone(), HASH, settings);
    let step = GeometricStep::new(Some((model, HASH)), 10.0);
    let mut status = |row: usize, line: &str| {
        monitor.corrected(&step.correct(&scale(row)));
        monitor.tracer(&TracerReading { line: Text::new(line).unwrap(), ..tracer(row, 0.0) }).unwrap().status
    };
    assert_eq!(status(0, "L7"), ResidualStatus::NotPredicted);
    assert_eq!(status(1, "L8"), ResidualStatus::Consistent);
    assert!(monitor.lacking().unwrap().contains("L7"));
}

#[test]
fn a_pair_whose_scale_reading_was_lost_is_told_when_the_next_one_comes() {
    let asking = with_effect(1, "refraction range_share=1.0", "refraction", refraction());
    let settings = MonitorSettings { single_bound: 5.0, window: 200, match_within_s: 0.0005 };
    let mut monitor = MonitorStep::new(asking.model.clone(), HASH, settings).with_scales(10.0);
    let step = GeometricStep::new(Some((asking.model.clone(), HASH)), 10.0);
    let lost = logged_scale(&asking, 0, "");
    monitor.corrected(&step.correct(&lost));
    assert!(monitor.tracer(&asking.tracer(0, 0.0)).is_none(), "its scale reading may still come");
    let told = monitor.scale(&logged_scale(&asking, 1, ""));
    assert_eq!((told.len(), told[0].sequence, told[0].status), (1, 0, ResidualStatus::NotPredicted));
    // A clock that goes back.
    let [first, back] = [2, 1].map(|s| Stamp::from_nanos(lost.stamp.to_nanos() - s * 1_000_000_000).unwrap());
    // The first of each stream after that is not to be trusted.
    monitor.corrected(&step.correct(&ScaleReading { stamp: first, sequence: 1, ..lost }));
    let reading = TracerReading { stamp: first, ..asking.tracer(0, 0.0) };
    assert_eq!(monitor.tracer(&reading).unwrap().status, ResidualStatus::OutOfOrder);
    let early = ScaleReading { stamp: back, sequence: 2, ..lost };
    monitor.scale(&early);
    monitor.corrected(&step.correct(&early));
    let reading = TracerReading { stamp: back, ..asking.tracer(0, 0.0) };
    let is_predicted = |monitor: &mut MonitorStep| {
        let status = monitor.tracer(&reading).unwrap().status;
        matches!(status, ResidualStatus::Consistent | ResidualStatus::OutOfBounds)
    };
    assert!(is_predicted(&mut monitor));
    // Another reading of that stamp takes nothing from it.
    monitor.scale(&ScaleReading { sequence: 3, ..early });
    assert!(is_predicted(&mut monitor));
    // Without scale readings there is nothing to wait for.
    let mut alone = MonitorStep::new(asking.model.clone(), HASH, settings);
    alone.corrected(&step.correct(&lost));
    assert_eq!(alone.tracer(&asking.tracer(0, 0.0)).unwrap().status, ResidualStatus::NotPredicted);
    assert!(alone.lacking().unwrap().contains("no scale reading comes to the monitor"));
}

fn refraction() -> Shape {
    Shape::new().texts("terms", &["temp_air_c", "pressure_hpa", "humidity_pct"].map(str::to_owned))
}

#[test]
fn regress_a_scale_reading_of_another_frame_or_of_none_is_refused() {
    for frame_id in ["other_machine", "", "machine/", "Machine"] {
        let reading = ScaleReading { frame_id: Text::new(frame_id).unwrap(), ..scale(0) };
        let sample = geometric().correct(&reading);
        assert_eq!(sample.status, CorrectionStatus::OtherFrame, "{frame_id:?}");
        assert!(sample.corrected_point_in_machine_m().is_none() && sample.covariance_m2 == [0.0; 9]);
        assert_eq!((sample.sequence, sample.frame_id), (reading.sequence, reading.frame_id));
    }
    assert_eq!(geometric().correct(&scale(0)).status, CorrectionStatus::InVolume);
}

#[test]
fn regress_what_is_of_another_frame_is_not_compared_with_this_machine() {
    let mut monitor = monitor();
    let other = Text::new("other_machine").unwrap();
    let stray = CorrectedCoordinates { frame_id: other, ..geometric().correct(&scale(1)) };
    assert!(monitor.corrected(&stray).is_empty());
    assert!(monitor.tracer(&tracer(1, 0.0)).is_none(), "a tracer reading met the sample of another machine");
    let residuals = monitor.corrected(&geometric().correct(&scale(1)));
    assert_eq!(residuals.iter().map(|r| r.status).collect::<Vec<_>>(), [ResidualStatus::Consistent]);
    let residual = monitor.tracer(&TracerReading { frame_id: other, ..tracer(1, 0.0) }).unwrap();
    assert_eq!((residual.status, residual.residual()), (ResidualStatus::OtherFrame, None));
    let [corrected, tracers] = monitor.streams();
    assert_eq!((corrected.other_frame, tracers.other_frame), (1, 1));
}

/// Samples as the geometric node gives them.
fn corrected(readings: impl IntoIterator<Item = ScaleReading>) -> Vec<CorrectedCoordinates> {
    let (step, mut watch) = (geometric(), StreamWatch::default());
    readings.into_iter().map(|reading| watch.pass(Mark::from(&reading), step.correct(&reading))).collect()
}

#[test]
fn regress_readings_of_two_sources_are_not_corrected_and_those_of_one_that_starts_again_are() {
    let statuses = |samples: &[CorrectedCoordinates]| samples.iter().map(|sample| sample.status).collect::<Vec<_>>();
    let at = |row: usize, sequence: u64| ScaleReading { sequence, stamp: scale(row).stamp, ..scale(row) };
    let mixed = corrected((0..200).flat_map(|row| [at(row, 1000 + row as u64), at(300 + row, row as u64)]));
    let refused = mixed.iter().filter(|sample| sample.status == CorrectionStatus::SeveralSources);
    assert!(refused.clone().all(|sample| sample.corrected_point_in_machine_m().is_none()));
    assert!(refused.count() >= 395, "{:?}", &statuses(&mixed)[..10]);
    let again =
        corrected((0..200).map(|row| at(row, row as u64)).chain((200..400).map(|row| at(row, row as u64 - 200))));
    assert_eq!(statuses(&again), vec![CorrectionStatus::InVolume; 400]);
}

#[test]
fn regress_a_sample_whose_stamp_does_not_follow_says_so_and_is_corrected() {
    let at = |nanos: i64, sequence: usize| ScaleReading {
        stamp: Stamp::from_nanos(nanos).unwrap(),
        sequence: sequence as u64,
        ..scale(sequence)
    };
    let hour_ns = 3_600_000_000_000;
    let samples = corrected([at(hour_ns, 0), at(2 * hour_ns, 1), at(5, 2), at(5, 3), at(6, 4)]);
    use CorrectionStatus::{InVolume, OutOfOrder};
    let statuses: Vec<CorrectionStatus> = samples.iter().map(|sample| sample.status).collect();
    assert_eq!(statuses, [InVolume, InVolume, OutOfOrder, OutOfOrder, InVolume]);
    assert!(samples.iter().all(|sample| sample.corrected_valid && sample.covariance_m2[0] > 0.0));
}

/// A box that stamps to the second took the doubt about the position from every second sample.
#[test]
fn regress_a_position_that_is_extrapolated_stays_so_whatever_its_stream_is_like() {
    let outside = |sequence: usize| {
        let within = scale(sequence);
        let reading_m = [within.reading_m[0], within.reading_m[1], -0.02 - 1e-4 * sequence as f64];
        let stamp = Stamp::from_nanos(1_000_000_000 * (sequence as i64 / 2)).unwrap();
        ScaleReading { stamp, reading_m, ..within }
    };
    let samples = corrected((0..6).map(outside));
    assert!(samples.iter().all(|sample| sample.status == CorrectionStatus::Extrapolated), "{samples:?}");
    let beside = samples[0].beside_another_publisher();
    assert_eq!(beside.status, CorrectionStatus::Extrapolated);
    // To the monitor their instants are none all the same.
    let mut monitor = monitor();
    samples.iter().for_each(|sample| assert!(monitor.corrected(sample).is_empty()));
    assert_eq!(monitor.streams()[0].stamps_standing, 3);
}

#[test]
fn regress_the_monitor_predicts_nothing_where_the_instant_is_not_to_be_trusted() {
    // A tracer whose stamps stand still while the machine moves: millimetres at the wrong instant.
    let mut frozen = monitor();
    corrected((0..20).map(scale)).iter().for_each(|sample| assert!(frozen.corrected(sample).is_empty()));
    let at = |row: usize| TracerReading { stamp: tracer(3, 0.0).stamp, ..tracer(row, 0.0) };
    let statuses: Vec<ResidualStatus> = (3..10).filter_map(|row| Some(frozen.tracer(&at(row))?.status)).collect();
    assert_eq!(statuses[0], ResidualStatus::Consistent);
    assert_eq!(statuses[1..], [ResidualStatus::OutOfOrder; 6]);
    // Two correctors: neither of their models is the one in use.
    let mut two = monitor();
    let mut seen = Vec::new();
    for row in 0..100 {
        two.corrected(&geometric().correct(&scale(row)));
        two.corrected(&CorrectedCoordinates { model_sha256: OTHER_HASH, ..geometric().correct(&scale(row)) });
        seen.extend(two.tracer(&tracer(row, 0.0)).map(|residual| residual.status));
    }
    assert!(seen[10..].iter().all(|status| *status == ResidualStatus::SeveralSources), "{seen:?}");
    assert!(two.streams()[0].several_sources > 150);
}

#[test]
fn regress_the_monitor_goes_on_after_the_clock_was_set_back() {
    let mut monitor = monitor();
    let sample = geometric().correct(&scale(0));
    let day_ns = 86_400_000_000_000;
    // More than the monitor keeps waiting.
    for sequence in 0..25_000_u64 {
        let stamp = Stamp::from_nanos(day_ns + sequence as i64 * 1_000_000).unwrap();
        monitor.corrected(&CorrectedCoordinates { stamp, sequence, ..sample });
    }
    let residuals = run(&mut monitor, 0..300, |_| 0.0);
    assert!(residuals[1..].iter().all(|residual| residual.residual_valid), "{:?}", &residuals[..3]);
    assert_eq!(monitor.health().state, HealthState::Consistent);
}
