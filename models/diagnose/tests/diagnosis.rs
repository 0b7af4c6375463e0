//! Diagnoses of simulated campaigns: what is there is named, what is not there is not, what cannot be told is said.
//!
//! The power of the method over many machines and sizes is the business of the trial bench (`tests/evidence/trials`); here each
//! rule has one or two cases that fail when it breaks.

use crate::common;
use crate::common::{Case, INSTRUMENT};
use abbe_diagnose::Explanation;
use abbe_diagnose::{Departure, DiagnoseError, DiagnoseOptions, Diagnosis, NotIdentifiable, diagnose};
use abbe_geometry::Vector3;
use abbe_geometry::axis::{Axis, ErrorId};
use abbe_geometry::chain::nominal_point_m;
use abbe_geometry::correct::correct;
use abbe_geometry::effects::{CovariateSource, CovariateValue, Lag, Shape, ShapeValue, State, of_lagged};
use abbe_geometry::error_function;
use abbe_identify::{IdentifyOptions, identify};
use abbe_measurement::campaign::Covariate;
use abbe_virtual_machine::effects::from_text;
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::plan::presets::case_like;
use abbe_virtual_machine::simulate_campaign;

fn names(diagnosis: &Diagnosis) -> Vec<&str> {
    diagnosis.found.iter().map(|found| found.name).collect()
}

fn text<'a>(diagnosis: &'a Diagnosis, name: &str, key: &str) -> &'a str {
    let found = diagnosis.found.iter().find(|found| found.name == name).unwrap();
    match found.shape.0.get(key) {
        Some(ShapeValue::Text(value)) => value,
        other => panic!("{name} {key}: {other:?}"),
    }
}

/// Covariates by name.
struct By<F>(F);
impl<F: Fn(&str) -> CovariateValue> CovariateSource for By<F> {
    fn covariate(&self, name: &str) -> CovariateValue {
        (self.0)(name)
    }
}

#[test]
fn a_clean_machine_stays_without_effect() {
    for seed in [1, 2, 3] {
        let diagnosis = Case::new(seed, &[]).diagnose();
        assert_eq!(names(&diagnosis), [""; 0], "seed {seed}: {:?}", diagnosis.steps);
        assert!(diagnosis.consistent_with_noise, "{}", diagnosis.detection_after.verdict());
        assert!(diagnosis.unseen.is_none(), "nothing to judge");
    }
}

/// A ram that stands turned by some 60 µrad moves the reflector at each offset as a wrong holder would, and was taken for one.
#[test]
fn regress_a_clean_machine_with_a_turned_ram_is_not_made_worse() {
    for (seed, turn_rad) in [(21_u64, [40e-6, -30e-6, 20e-6]), (22, [-25e-6, 10e-6, 50e-6])] {
        let mut case = Case::new(seed, &[]);
        let turned = |offset_m: [f64; 3]| {
            let offset_m = Vector3::from(offset_m);
            <[f64; 3]>::from(offset_m - Vector3::from(turn_rad).cross(&offset_m))
        };
        // What stands in the campaign is turned back, so that the ram is turned against what it says.
        case.simulated.campaign.readings.iter_mut().for_each(|r| r.offset_m = turned(r.offset_m));
        let diagnosis = case.diagnose();
        assert_eq!(names(&diagnosis), [""; 0], "seed {seed}: {:?}", diagnosis.steps);
        let (before_m, after_m) = (case.verification_m(&diagnosis.before.model), case.verification_m(&diagnosis.model));
        assert!(after_m <= before_m, "seed {seed}: {before_m} {after_m}");
    }
}

/// Each injected effect is named with its axis, and the error on another day falls to near that of the clean machine.
#[test]
fn one_effect_is_named_and_removed() {
    let clean_m = {
        let case = Case::new(4, &[]);
        case.verification_m(&case.diagnose().model)
    };
    let cases = [
        ("backlash axis=y size_um=1.5", "reversal", Some(("axis", "y"))),
        ("scale_expansion axis=x per_kelvin_um_m=9 fixed_at_mm=0", "scale_expansion", Some(("axis", "x"))),
        ("station_drift rate_x_um_h=3 rate_y_um_h=1", "station_drift", None),
    ];
    for (injected, name, axis) in cases {
        let case = Case::new(4, &[injected]);
        let diagnosis = case.diagnose();
        assert_eq!(names(&diagnosis), [name], "{injected}: {:?}", diagnosis.steps);
        if let Some((key, value)) = axis {
            assert_eq!(text(&diagnosis, name, key), value, "{injected}");
        }
        let found = &diagnosis.found[0];
        assert_eq!(found.kind, Explanation::Attributed);
        assert!(found.p_value < 1e-6 && found.parameters.iter().all(|p| p.is_plausible()), "{found:?}");
        let own = found.placebo.as_ref().unwrap();
        let placebo = own.placebo_gains.iter().copied().fold(f64::MIN, f64::max);
        assert!(own.gain > 5.0 * placebo.max(0.0), "{injected}: placebo {placebo}");
        let (before_m, after_m) = (case.verification_m(&diagnosis.before.model), case.verification_m(&diagnosis.model));
        assert!(after_m < 1.15 * clean_m && before_m > 1.15 * clean_m, "{injected}: {before_m} {after_m} {clean_m}");
    }
}

/// A tip that a temperature pushes along Y by the same everywhere was called an expansion of the scale, of 0.13 ± 0.56 µm/(m·K).
#[test]
fn regress_a_push_by_a_temperature_is_no_expansion_of_a_scale() {
    // As good as fixed at infinity: 3 µm/K at every reading.
    let case = Case::new(4, &["scale_expansion axis=y per_kelvin_um_m=0.1 fixed_at_mm=-30000"]);
    let diagnosis = case.diagnose();
    assert_eq!(names(&diagnosis), ["empirical"], "{:?}", diagnosis.steps);
    assert_eq!([text(&diagnosis, "empirical", "acts"), text(&diagnosis, "empirical", "p")], ["y", "temp_scale_y_c"]);
    let (before_m, after_m) = (case.verification_m(&diagnosis.before.model), case.verification_m(&diagnosis.model));
    assert!(after_m < 0.8 * before_m, "{before_m} {after_m}");
}

/// Two sensors side by side explain the same: whichever is taken, a coordinate is uncertain where they part.
#[test]
fn explanations_that_compete_are_averaged_and_their_disagreement_is_uncertainty() {
    let mut case = Case::new(4, &["scale_expansion axis=x per_kelvin_um_m=9 fixed_at_mm=0"]);
    let campaign = &mut case.simulated.campaign;
    let near = |(k, value): (usize, &Option<f64>)| value.map(|value| value + 0.002 * (1.7 * k as f64).sin());
    let values = campaign.covariate("temp_scale_x_c").unwrap().values.iter().enumerate().map(near).collect();
    campaign.covariates.push(Covariate { name: "temp_beside_c".to_owned(), values });
    let diagnosis = case.diagnose();
    assert_eq!(names(&diagnosis), ["scale_expansion"], "{:?}", diagnosis.steps);
    let found = &diagnosis.found[0];
    let sensor = |shape: &Shape| shape.0.get("sensor").cloned();
    let other =
        found.competing.iter().find(|c| c.name == found.name && sensor(&c.shape) != sensor(&found.shape)).unwrap();
    assert!((0.02..0.98).contains(&other.weight), "{other:?}");
    let corrected = |own_c: f64, beside_c: f64| {
        let logged = By(|name: &str| match name {
            "temp_scale_x_c" => CovariateValue::Fresh(own_c),
            "temp_beside_c" => CovariateValue::Fresh(beside_c),
            _ => CovariateValue::Missing,
        });
        let state = State { reading_m: [0.6, 0.2, 0.1], offset_m: [0.0; 3], covariates: &logged };
        let correction = correct(&diagnosis.model, &state);
        (correction.position_m.x, correction.covariance_m2.unwrap()[(0, 0)].sqrt())
    };
    let (range, middle_c) =
        diagnosis.model.covariate_range("temp_scale_x_c").map(|(l, h)| (h - l, (l + h) / 2.0)).unwrap();
    let (together_m, u_together_m) = corrected(middle_c, middle_c);
    let (parted_m, u_parted_m) = corrected(middle_c + range / 2.0, middle_c);
    let disagree_m = 9e-6 * 0.6 * range / 2.0;
    let spread_m = (other.weight * (1.0 - other.weight)).sqrt() * disagree_m;
    assert!(
        u_parted_m > 0.9 * spread_m.hypot(u_together_m) && spread_m > u_together_m,
        "{u_parted_m} {spread_m} {u_together_m}"
    );
    // The truth, by the sensor that the scale really follows.
    let truth_m = together_m + disagree_m;
    assert!((parted_m - truth_m).abs() < 3.0 * u_parted_m, "{parted_m} {truth_m} {u_parted_m}");
}

#[test]
fn the_size_of_a_backlash_is_found_within_its_uncertainty() {
    let diagnosis = Case::new(5, &["backlash axis=x size_um=1.2"]).diagnose();
    let parameter = &diagnosis.found[0].parameters[0];
    // Play of 1.2 µm from side to side is a reversal value of −1.2 µm.
    assert!((parameter.value + 1.2e-6).abs() < 4.0 * parameter.u, "{parameter:?}");
    assert!(parameter.u < 0.1e-6, "{parameter:?}");
}

#[test]
fn two_effects_are_found_one_after_the_other() {
    let effects = ["backlash axis=z size_um=1.5", "speed_lag axis=y lag_us=20"];
    let mut found = Case::new(6, &effects).diagnose().found;
    found.sort_by_key(|f| f.name);
    let names: Vec<&str> = found.iter().map(|f| f.name).collect();
    assert_eq!(names, ["reversal", "speed_lag"]);
}

/// A scale that follows the room with a time constant: waves of the room arrive smaller and later, by the known formula, once what
/// the beginning left is over.
#[test]
fn val_analytic_an_expansion_that_follows_late_is_found_with_its_time_constant() {
    const TAU_S: f64 = 1800.0;
    const ROOM_K: f64 = 0.4;
    const PER_KELVIN: f64 = 10e-6;
    let omega = std::f64::consts::TAU / 14_000.0;
    let mut case = Case::new(9, &[]);
    let clean = case.diagnose().before.model;
    let campaign = &mut case.simulated.campaign;
    let (gain, delay) = ((1.0 + (omega * TAU_S).powi(2)).sqrt().recip(), (omega * TAU_S).atan());
    let late_k = |time_s: f64| {
        let forgotten = (-time_s / TAU_S).exp();
        ROOM_K * (1.0 - forgotten - gain * ((omega * time_s - delay).cos() - delay.cos() * forgotten))
    };
    for reading in &mut campaign.readings {
        let (_, station) = clean.station(&campaign.stations[reading.station as usize]).unwrap();
        let sight = nominal_point_m(reading.reading_m, reading.offset_m) - station.position_m;
        reading.length_m += PER_KELVIN * late_k(reading.time_s) * reading.reading_m[0] * sight.x / sight.norm();
    }
    let room =
        campaign.readings.iter().map(|reading| Some(20.0 + ROOM_K * (1.0 - (omega * reading.time_s).cos()))).collect();
    campaign.covariates = vec![Covariate { name: "temp_room_c".to_owned(), values: room }];
    let diagnosis = case.diagnose();
    assert_eq!(names(&diagnosis), ["scale_expansion"], "{:?}", diagnosis.steps);
    assert_eq!(text(&diagnosis, "scale_expansion", "axis"), "x");
    let (logged, lag_s) = of_lagged(text(&diagnosis, "scale_expansion", "sensor")).unwrap();
    assert_eq!(logged, "temp_room_c");
    assert!((f64::from(lag_s) / TAU_S - 1.0).abs() < 0.25, "{lag_s} s");
    let alpha = &diagnosis.found[0].parameters[0];
    assert!((alpha.value / PER_KELVIN - 1.0).abs() < 0.1, "{alpha:?}");
}

/// A scale that follows its room at once, beside a sensor that follows late: what acts is ahead of what was logged.
#[test]
fn regress_a_sensor_that_follows_late_is_found_and_not_taken_for_a_cause() {
    const TAU_S: f64 = 900.0;
    const PER_KELVIN: f64 = 10e-6;
    let omega = std::f64::consts::TAU / 9000.0;
    let room_c = |time_s: f64| 20.0 + 0.4 * (1.0 - (omega * time_s).cos());
    let mut case = Case::new(9, &[]);
    let clean = case.diagnose().before.model;
    let campaign = &mut case.simulated.campaign;
    let (mut sensor, mut logged) = (Lag::new(TAU_S), Vec::new());
    let mut last_s = campaign.readings[0].time_s;
    for reading in &mut campaign.readings {
        let (_, station) = clean.station(&campaign.stations[reading.station as usize]).unwrap();
        let sight = nominal_point_m(reading.reading_m, reading.offset_m) - station.position_m;
        let expanded_m = PER_KELVIN * (room_c(reading.time_s) - 20.0) * reading.reading_m[0];
        reading.length_m += expanded_m * sight.x / sight.norm();
        // The sensor goes on where a station is moved.
        while last_s + 10.0 < reading.time_s {
            last_s += 10.0;
            sensor.push(last_s, room_c(last_s));
        }
        last_s = reading.time_s;
        logged.push(Some(sensor.push(last_s, room_c(last_s)).value));
    }
    campaign.covariates = vec![Covariate { name: "temp_room_c".to_owned(), values: logged }];
    let diagnosis = case.diagnose();
    assert_eq!(names(&diagnosis), ["scale_expansion"], "{:?}", diagnosis.steps);
    assert_eq!(text(&diagnosis, "scale_expansion", "axis"), "x");
    let (logged, lag_s) = of_lagged(text(&diagnosis, "scale_expansion", "sensor")).unwrap();
    assert_eq!(logged, "temp_room_c");
    assert!((f64::from(-lag_s) / TAU_S - 1.0).abs() < 0.3, "{lag_s} s");
    let alpha = &diagnosis.found[0].parameters[0];
    assert!((alpha.value / PER_KELVIN - 1.0).abs() < 0.1, "{alpha:?}");
}

#[test]
fn what_no_effect_describes_becomes_an_empirical_term() {
    let injected =
        "undescribed seed=3 of=temp_air_c of_from=19 of_to=21.5 and=y_mm and_from=0 and_to=600 along=x size_um=1.5";
    let case = Case::new(7, &[injected]);
    let diagnosis = case.diagnose();
    assert!(diagnosis.found.iter().any(|f| f.kind == Explanation::Empirical), "{:?}", diagnosis.steps);
    let clean = Case::new(7, &[]);
    let clean_m = clean.verification_m(&clean.diagnose().model);
    let square = |model| case.verification_m(model).powi(2) - clean_m * clean_m;
    let removed = 1.0 - square(&diagnosis.model) / square(&diagnosis.before.model);
    assert!(removed > 0.7, "{removed}");
}

#[test]
fn too_few_coefficients_are_no_effect() {
    let kind = error_function::FunctionKind::Polynomial { degree: 2 };
    let diagnosis = Case::with(8, &[], kind, case_like).diagnose();
    assert!(diagnosis.enriched, "{:?}", diagnosis.steps);
    assert_eq!(names(&diagnosis), [""; 0], "{:?}", diagnosis.steps);
    assert!(!diagnosis.consistent_with_noise, "the model as it was is not");
}

/// A scale two kelvin warm for the whole campaign is a longer scale: nothing in the data says which.
#[test]
fn expansion_at_a_constant_temperature_is_not_claimed() {
    let mut case = Case::new(9, &[]);
    case.config.environment = EnvironmentConfig::constant();
    case.config.environment.channels[1].mean = 22.0;
    case.config.effects = vec![from_text("scale_expansion axis=x per_kelvin_um_m=10 fixed_at_mm=0").unwrap()];
    case.simulated = simulate_campaign(&case.config).unwrap();
    let diagnosis = case.diagnose();
    assert_eq!(names(&diagnosis), [""; 0], "{:?}", diagnosis.steps);
    let untestable = diagnosis.untestable.iter().find(|u| u.name == "scale_expansion").unwrap();
    assert!(untestable.needs.contains("changes in the campaign"), "{}", untestable.needs);
    assert!(
        diagnosis.next_measurements.iter().any(|m| m.contains("temp_scale_x_c")),
        "{:?}",
        diagnosis.next_measurements
    );
}

/// What acts on the range alone can look like a moved station to this plan: whoever asks is told, with what would decide.
#[test]
fn what_stations_and_errors_absorb_is_listed_with_what_absorbs_it() {
    let diagnosis = Case::new(9, &[]).diagnose();
    let by_station = |n: &&NotIdentifiable| n.aliased_with.iter().any(|name| name.contains("station"));
    let hidden = diagnosis.not_identifiable.iter().find(by_station).unwrap();
    assert!(hidden.alias_share > 0.95 && hidden.alias_share <= 1.0);
    assert!(diagnosis.next_measurements.iter().any(|m| m == hidden.decided_by));
}

/// An instrument that compensates for another air than the formula's stretches all ranges, which no reading tells from a scale.
#[test]
fn the_zero_of_the_air_is_in_the_uncertainty_of_the_scale() {
    let stretched = |stretch: f64| {
        let mut case = Case::new(14, &["refraction range_share=1 dead_path_share=0"]);
        case.simulated.campaign.readings.iter_mut().for_each(|reading| reading.length_m *= 1.0 + stretch);
        let diagnosis = case.diagnose();
        assert!(names(&diagnosis).contains(&"refraction"), "{:?}", diagnosis.steps);
        assert!(diagnosis.steps.iter().any(|words| words.contains("at which air")), "{:?}", diagnosis.steps);
        diagnosis.model.error(ErrorId::linear(Axis::X, Axis::X), case.machine.stroke_m[0].1)
    };
    let ((as_it_is_m, u_m), (shifted_m, _)) = (stretched(0.0), stretched(0.7e-6));
    assert!((shifted_m - as_it_is_m).abs() > 0.4e-6, "{as_it_is_m} {shifted_m}");
    assert!((shifted_m - as_it_is_m).abs() < 2.0 * u_m && u_m < 2e-6, "{as_it_is_m} {shifted_m} {u_m}");
    let (_, clean_m) = Case::new(14, &[]).diagnose().model.error(ErrorId::linear(Axis::X, Axis::X), 0.8);
    assert!(2.0 * clean_m < u_m, "it is no doubt where no refraction is found: {clean_m} {u_m}");
}

#[test]
fn without_covariates_effects_are_untestable_by_name_and_sensor() {
    let mut case = Case::new(10, &[]);
    case.simulated.campaign.covariates.clear();
    let diagnosis = case.diagnose();
    let needs = |name: &str| diagnosis.untestable.iter().find(|u| u.name == name).unwrap().needs.clone();
    assert!(needs("scale_expansion").contains("temp_scale_x_c"));
    assert!(needs("table_load").contains("load"));
    assert_eq!(names(&diagnosis), [""; 0]);
}

#[test]
fn the_error_on_lines_that_no_step_saw_falls() {
    let case = Case::new(11, &["backlash axis=y size_um=1.5"]);
    let diagnosis = case.diagnose_with(&DiagnoseOptions { folds: 2, placebos: 2, ..DiagnoseOptions::default() });
    let unseen = diagnosis.unseen.unwrap();
    assert!(unseen.gain_m2.0 > 0.0, "{unseen:?}");
    assert!(unseen.after.interval_m.1 < unseen.before.interval_m.0, "{unseen:?}");
    assert!(unseen.found.iter().all(|fold| fold == &["reversal"]), "{:?}", unseen.found);
}

#[test]
fn the_same_input_gives_the_same_model() {
    let bits = || {
        let diagnosis = Case::new(12, &["speed_lag axis=x lag_us=20"]).diagnose();
        let parts = diagnosis.model.parts().clone();
        parts.coefficients.iter().chain(&parts.covariance).map(|v| v.to_bits()).collect::<Vec<_>>()
    };
    assert_eq!(bits(), bits());
}

#[test]
fn an_observer_that_says_no_stops_it() {
    let case = Case::new(13, &[]);
    let mut steps = 0;
    let mut observe = |_| {
        steps += 1;
        steps < 4
    };
    let campaign = &case.simulated.campaign;
    let stopped = diagnose(&case.machine, &[], INSTRUMENT.range, campaign, &DiagnoseOptions::default(), &mut observe);
    assert!(matches!(stopped, Err(DiagnoseError::Stopped)));
}

/// A tape scale that was spliced: the fit rounded the step off, and U held four tenths of what is within 120 mm of it.
#[test]
fn regress_a_splice_of_a_scale_is_found_where_it_is_and_held_by_u() {
    let (at_m, size_m) = (0.313, 6e-6);
    let case = Case::new(4, &["splice axis=y size_um=6 at_mm=313"]);
    let diagnosis = case.diagnose();
    assert_eq!(names(&diagnosis), ["scale_step"], "{:?}", diagnosis.steps);
    assert_eq!(text(&diagnosis, "scale_step", "axis"), "y");
    let found = &diagnosis.found[0];
    let number = |key: &str| match found.shape.0.get(key) {
        Some(ShapeValue::Number(value)) => *value,
        other => panic!("{key}: {other:?}"),
    };
    assert!(number("from_m") <= at_m && number("to_m") >= at_m, "{:?}", found.shape);
    let step = &found.parameters[0];
    assert!((step.value - size_m).abs() < 2.0 * step.u, "{} {}", step.value, step.u);
    let (before_m, after_m) = (case.verification_m(&diagnosis.before.model), case.verification_m(&diagnosis.model));
    assert!(after_m < 0.8 * before_m, "{before_m} {after_m}");
    let near = |point: &&common::Erring| (point.reading_m[1] - at_m).abs() < 0.06;
    let held = |model| {
        let points = case.errors_m(model);
        let near: Vec<_> = points.iter().filter(near).collect();
        near.iter().filter(|point| point.error_m.y.abs() <= 2.0 * point.u_m.y).count() as f64 / near.len() as f64
    };
    assert!(held(&diagnosis.before.model) < 0.8, "{}", held(&diagnosis.before.model));
    assert!(held(&diagnosis.model) > 0.93, "{}", held(&diagnosis.model));
}

/// Places that bend sharply, waves, play and zeros that jump are no steps of a scale.
#[test]
fn what_bends_or_jumps_otherwise_is_no_step_of_a_scale() {
    for text in [
        "wear axis=x across=y size_um=4 at_mm=130 width_mm=20",
        "periodic_scale axis=y size_um=1.5 pitch_mm=150",
        "backlash axis=x size_um=4",
        "zero_jump station=1 after_s=600 shift_um=2",
    ] {
        let diagnosis = Case::new(5, &[text]).diagnose();
        assert!(!names(&diagnosis).contains(&"scale_step"), "{text}: {:?}", diagnosis.steps);
    }
}

/// The same machine measured twice is what its model says; with one angle between its axes changed by 15 µrad, it was "consistent with noise".
#[test]
fn regress_a_machine_that_somebody_ran_into_is_not_what_its_model_says() {
    let fit = |case: &Case| {
        let options = IdentifyOptions::default();
        identify(&case.machine, INSTRUMENT.range, &case.simulated.campaign, &options, &mut |_| true).unwrap().model
    };
    let again = |seed: u64, tilt_rad: f64| {
        let mut case = Case::new(1, &[]);
        case.config.seed = seed;
        case.config.machine.squareness[0].angle_rad += tilt_rad;
        case.simulated = simulate_campaign(&case.config).unwrap();
        case
    };
    let given = fit(&again(1, 0.0));
    let departure = |case: &Case| Departure::of(&given, &fit(case), &case.simulated.campaign).unwrap();
    for seed in 2..=4 {
        let same = departure(&again(seed, 0.0));
        assert!(!same.is_another(), "{seed}: {same:?}");
    }
    let another = departure(&again(2, 15e-6));
    assert!(another.is_another() && another.rms_m > 1e-6, "{another:?}");
}
