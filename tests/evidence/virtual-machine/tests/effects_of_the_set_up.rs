//! Evidence for effects of the measuring set-up, for onsets, and for effects made from text, in whole campaigns.
//!
//! Place in the flow: two campaigns of one seed, with and without the effect, are subtracted; what is left must be
//! the effect's own formula, worked out here again from what the campaign logs. Lengths in m.

#![allow(clippy::unwrap_used)] // a preparation that fails fails its test

use std::sync::Arc;

use abbe_virtual_machine::effects::{Effect, ReflectorOffset, examples, from_text};
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::instrument::InstrumentConfig;
use abbe_virtual_machine::plan::presets;
use abbe_virtual_machine::{
    Simulated, SimulationConfig, SimulationError, TruthRecipe, simulate_campaign, verification_points,
};

/// Lengths near a metre are known to 2e-16; differences of four of them to 1e-15.
const ROUNDING_M: f64 = 2e-15;

/// Sensors without noise, so that the logged state is the state that acted.
fn quiet_room() -> EnvironmentConfig {
    let mut room = EnvironmentConfig::workshop();
    room.channels.iter_mut().for_each(|channel| channel.noise = 0.0);
    room
}

fn config(effects: Vec<Arc<dyn Effect>>) -> SimulationConfig {
    let machine = TruthRecipe::default().bridge_xyz().unwrap();
    SimulationConfig {
        seed: 5,
        plan: presets::case_like(machine.stroke_m, 4).build().unwrap(),
        machine,
        instrument: InstrumentConfig::NOISELESS,
        environment: quiet_room(),
        effects,
    }
}

/// Campaign without and with the effect that a text describes.
fn pair(text: &str) -> (Simulated, Simulated) {
    let touched = simulate_campaign(&config(vec![from_text(text).unwrap()])).unwrap();
    (simulate_campaign(&config(Vec::new())).unwrap(), touched)
}

fn differences_m((clean, touched): &(Simulated, Simulated)) -> Vec<f64> {
    let pairs = clean.campaign.readings.iter().zip(&touched.campaign.readings);
    pairs.map(|(a, b)| b.length_m - a.length_m).collect()
}

/// First reading of each reading's station.
fn references(simulated: &Simulated) -> Vec<usize> {
    let readings = &simulated.campaign.readings;
    readings.iter().map(|r| readings.iter().position(|first| first.station == r.station).unwrap()).collect()
}

#[test]
fn an_outlying_run_shifts_one_line_and_no_other() {
    let pair = pair("outlying_run line=17 shift_um=10");
    let mut hit = 0;
    for (reading, difference_m) in pair.0.campaign.readings.iter().zip(differences_m(&pair)) {
        let wanted_m = if reading.line == 17 { 10e-6 } else { 0.0 };
        hit += usize::from(reading.line == 17);
        assert!((difference_m - wanted_m).abs() < ROUNDING_M);
    }
    assert!(hit >= 12);
}

#[test]
fn a_run_that_is_not_in_the_plan_is_refused() {
    let effect = from_text("outlying_run line=900 shift_um=10 from_s=5").unwrap();
    let refused: SimulationError = simulate_campaign(&config(vec![effect])).unwrap_err();
    assert_eq!(refused.key, "effects[0].outlying_run.line");
}

#[test]
fn a_dead_path_follows_the_air_since_the_station_began() {
    let pair = pair("dead_path unseen_mm=500");
    let logged = |name: &str, k: usize| pair.0.campaign.covariate(name).unwrap().values[k].unwrap();
    // The textbook's sensitivities once more, in metres for half a metre of path.
    let air_m = |k: usize| {
        -0.48e-6 * logged("temp_air_c", k) + 0.135e-6 * logged("pressure_hpa", k)
            - 0.0045e-6 * logged("humidity_pct", k)
    };
    let mut largest_m: f64 = 0.0;
    for (k, (first, difference_m)) in references(&pair.0).into_iter().zip(differences_m(&pair)).enumerate() {
        assert!((difference_m - (air_m(k) - air_m(first))).abs() < ROUNDING_M);
        largest_m = largest_m.max(difference_m.abs());
    }
    assert!(largest_m > 0.05e-6, "the air of a workshop drifts: {largest_m:e}");
}

#[test]
fn each_reflector_holder_has_an_error_of_its_own_along_the_beam() {
    let holder = ReflectorOffset { seed: 3, size_m: 2e-6 };
    let pair = pair("reflector_offset size_um=2 seed=3");
    let along_m = |k: usize| {
        let (reading, truth) = (&pair.0.campaign.readings[k], &pair.0.truth.readings[k]);
        let error_m = holder.error_m(reading.offset_m);
        (0..3).map(|d| error_m[d] * (truth.actual_m[d] - truth.station_m[d]) / truth.range_m).sum::<f64>()
    };
    for (k, (first, difference_m)) in references(&pair.0).into_iter().zip(differences_m(&pair)).enumerate() {
        assert!((difference_m - (along_m(k) - along_m(first))).abs() < ROUNDING_M);
    }
    let errors = presets::CASE_OFFSETS_M.map(|offset_m| holder.error_m(offset_m));
    assert!(errors[0] != errors[1] && errors[1] != errors[2] && errors[0] != errors[2]);
    let other = ReflectorOffset { seed: 4, ..holder };
    assert_ne!(other.error_m(presets::CASE_OFFSETS_M[0]), errors[0]);
}

#[test]
fn holders_of_many_seeds_have_the_size_asked_for() {
    let draws = 2000_u32;
    let squares: f64 = (0..draws)
        .flat_map(|seed| ReflectorOffset { seed: u64::from(seed), size_m: 2e-6 }.error_m([0.12, 0.0, -0.06]))
        .map(|component_m| component_m * component_m)
        .sum();
    let rms_m = (squares / f64::from(3 * draws)).sqrt();
    // The rms of 6000 normal deviates is known to 0.9 %; four of that.
    assert!((rms_m / 2e-6 - 1.0).abs() < 0.037, "{rms_m:e}");
}

#[test]
fn what_sets_in_is_nothing_before_and_everything_after() {
    for example in examples().filter(|text| !text.starts_with("station_drift")) {
        let always = pair(example);
        let onset_s = 0.5 * always.0.campaign.readings.last().unwrap().time_s;
        let late = pair(&format!("{example} from_s={onset_s}"));
        let (always_m, late_m) = (differences_m(&always), differences_m(&late));
        let first = references(&always.0);
        let mut seen = [0_usize; 2];
        for (k, reading) in always.0.campaign.readings.iter().enumerate() {
            let station_began_s = always.0.campaign.readings[first[k]].time_s;
            if reading.time_s < onset_s {
                assert_eq!(late_m[k], 0.0, "{example}");
                seen[0] += 1;
            } else if station_began_s >= onset_s {
                assert_eq!(late_m[k], always_m[k], "{example}");
                seen[1] += 1;
            }
        }
        assert!(seen[0] > 500 && seen[1] > 500, "{seen:?}");
    }
}

#[test]
fn a_stand_that_begins_to_creep_late_has_its_creep_at_once() {
    let always = pair("station_drift rate_x_um_h=3");
    let late = pair("station_drift rate_x_um_h=3 from_s=600");
    for (k, reading) in always.0.campaign.readings.iter().enumerate() {
        let shift_m =
            |p: &(Simulated, Simulated)| p.1.truth.readings[k].station_m[0] - p.0.truth.readings[k].station_m[0];
        let wanted_m = if reading.time_s < 600.0 { 0.0 } else { shift_m(&always) };
        assert_eq!(shift_m(&late), wanted_m);
    }
}

#[test]
fn effects_of_the_set_up_leave_the_true_tip_alone_and_those_of_the_machine_move_it() {
    let clean = verification_points(&config(Vec::new()), 60, 2).unwrap();
    for example in examples() {
        let effect = from_text(example).unwrap();
        let of_set_up = matches!(
            effect.name(),
            "beam_gradient"
                | "dead_path"
                | "gimbal"
                | "outlying_run"
                | "reflector_incidence"
                | "reflector_offset"
                | "refraction"
                | "stand_jump"
                | "station_drift"
                | "zero_jump"
        );
        let points = verification_points(&config(vec![effect]), 60, 2).unwrap();
        let same = clean.iter().zip(&points).all(|(a, b)| a.actual_m == b.actual_m);
        assert_eq!(same, of_set_up, "{example}");
    }
}
