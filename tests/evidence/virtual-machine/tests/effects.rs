//! Evidence for the effects: each against a case computed by hand, and all of them in a campaign.

#![allow(clippy::unwrap_used)] // a preparation that fails fails its test

use std::f64::consts::FRAC_1_SQRT_2;
use std::sync::{Arc, LazyLock};

use abbe_virtual_machine::effects::{
    Acceleration, Backlash, Beam, CarriageSag, CarriageTwist, ColumnBow, Effect, Gimbal, GradientBow, Hysteresis,
    LaggedExpansion, MoistureBow, Moment, PeriodicScale, ReflectorIncidence, Refraction, ScaleExpansion, Screw,
    SpeedLag, Splice, StationDrift, TableLoad, Undescribed, WarmUp, Wear,
};
use abbe_virtual_machine::environment::{Environment, EnvironmentConfig, EnvironmentState};
use abbe_virtual_machine::instrument::InstrumentConfig;
use abbe_virtual_machine::machine::JointErrors;
use abbe_virtual_machine::plan::presets;
use abbe_virtual_machine::{Axis, SimulationConfig, TruthRecipe, simulate_campaign, verification_points};

/// Sizes are near 1e-6; formulas of a handful of operations agree far below this.
const TINY: f64 = 1e-17;

static ROOM: LazyLock<Environment> = LazyLock::new(|| Environment::new(&EnvironmentConfig::constant(), 1));

/// Everything in its middle: 20 °C, 1013.25 hPa, 50 %, no motion, no load.
fn calm() -> Moment<'static> {
    let mut values = [20.0; 9];
    values[7] = 1013.25;
    values[8] = 50.0;
    Moment {
        time_s: 0.0,
        reading_m: [0.4, 0.3, 0.3],
        stroke_m: [[0.0, 0.8], [0.0, 0.6], [0.0, 0.6]],
        offset_m: [0.0; 3],
        direction: [0.0; 3],
        feed_m_s: 0.05,
        acceleration_m_s2: [0.0; 3],
        load_kg: 0.0,
        environment: EnvironmentState { values },
        room: &ROOM,
        path_m: &[],
    }
}

fn joints(effect: &dyn Effect, moment: &Moment) -> JointErrors {
    effect.check().unwrap();
    let mut out = JointErrors::default();
    effect.disturb_machine(moment, &mut out);
    out
}

fn beam(toward_reflector: [f64; 3]) -> Beam {
    Beam { station: 0, line: 0, time_on_station_s: 0.0, range_m: 1.0, dead_path_m: 0.5, toward_reflector }
}

fn assert_close(found: f64, wanted: f64) {
    assert!((found - wanted).abs() < TINY, "{found} is not {wanted}");
}

#[test]
fn a_screw_grows_away_from_its_bearing() {
    let screw = Screw { axis: Axis::Y, growth: 50e-6, fixed_at_m: 0.1, time_constant_s: 1800.0 };
    assert_close(joints(&screw, &calm()).linear_m[1][1], 0.0);
    let warm = Moment { time_s: 1800.0, ..calm() };
    assert_close(
        joints(&screw, &warm).linear_m[1][1],
        50e-6 * 0.2 * (0.7 * 0.632_120_558_828_557_7 + 0.3 * 0.221_199_216_928_595_1),
    );
}

#[test]
fn a_warm_scale_sends_the_machine_too_far() {
    let effect = ScaleExpansion { axis: Axis::X, per_kelvin: 10e-6, fixed_at_m: 0.1 };
    let mut moment = calm();
    assert_eq!(joints(&effect, &moment), JointErrors::default());
    moment.environment.values[1] = 22.0;
    // 10 µm/(m·K) · 2 K · 0.3 m
    assert_close(joints(&effect, &moment).linear_m[0][0], 6e-6);
}

#[test]
fn a_scale_behind_its_sensor_expands_later() {
    let effect = LaggedExpansion { axis: Axis::X, per_kelvin: 10e-6, fixed_at_m: 0.0, lag_s: 1000.0 };
    let mut config = EnvironmentConfig::constant();
    // From 23 °C towards 20 °C with a time constant of 3000 s.
    (config.channels[1].settling, config.channels[1].settling_time_s) = (3.0, 3000.0);
    let room = Environment::new(&config, 1);
    let at = |time_s: f64| joints(&effect, &Moment { time_s, room: &room, ..calm() }).linear_m[0][0];
    // 10 µm/(m·K) · 3 K · 0.4 m at the start; after 3000 s (3 e⁻¹ − e⁻³)/2 of it.
    assert_close(at(0.0), 12e-6);
    assert_close(at(3000.0), 12e-6 * 0.5 * (3.0 * f64::exp(-1.0) - f64::exp(-3.0)));
}

#[test]
fn friction_comes_round_after_a_reversal() {
    let effect = Hysteresis { axis: Axis::Y, size_m: 2e-6, travel_m: 0.01 };
    let at = |path_m: &[[f64; 3]]| joints(&effect, &Moment { path_m, ..calm() }).linear_m[1][1];
    assert_close(at(&[[0.0, 0.3, 0.0]]), 0.0);
    // Far in + it lags behind by half the size; 10 mm back, one travel, it is at 2/e − 1 of that.
    let there = [[0.0, 0.1, 0.0], [0.0, 0.5, 0.0]];
    assert!((at(&there) + 1e-6).abs() < 1e-12);
    let back = [there[0], there[1], [0.3, 0.49, 0.0]];
    assert!((at(&back) + 1e-6 * (2.0 * f64::exp(-1.0) - 1.0)).abs() < 1e-12);
    // What other axes do changes nothing.
    assert_close(at(&[back[0], back[1], back[2], [0.9, 0.49, 0.4]]), at(&back));
}

#[test]
fn a_carriage_falls_into_a_worn_place() {
    let effect = Wear { axis: Axis::X, across: Axis::Z, size_m: 2e-6, at_m: 0.4, width_m: 0.03 };
    let at = |x_m: f64| joints(&effect, &Moment { reading_m: [x_m, 0.0, 0.0], ..calm() }).linear_m[0][2];
    assert_close(at(0.4), 2e-6);
    assert_close(at(0.43), 2e-6 * f64::exp(-0.5));
}

#[test]
fn a_bow_rises_in_the_middle_and_its_angle_is_its_slope() {
    let effect = GradientBow { curvature_per_kelvin: 1e-5 };
    let mut moment = calm();
    moment.environment.values[4] = 22.0;
    // κ = 2e-5 /m, half stroke 0.4 m: κh²/2, to the fourth order of κh
    assert_close(joints(&effect, &moment).linear_m[0][2], 1.6e-6);
    let mut at = |x: f64| {
        moment.reading_m[0] = x;
        joints(&effect, &moment)
    };
    assert_eq!([at(0.0), at(0.8)].map(|j| j.linear_m[0][2]), [0.0, 0.0]);
    let step = 1e-4;
    for x in [0.1, 0.4, 0.7] {
        let slope = (at(x + step).linear_m[0][2] - at(x - step).linear_m[0][2]) / (2.0 * step);
        // A climb along +X is a turn about −Y; rounding of 1e-6 over 2e-4 stays below 1e-11.
        assert!((slope + at(x).angular_rad[0][1]).abs() < 1e-11);
    }
}

#[test]
fn a_column_bows_toward_the_side_and_its_angle_is_its_slope() {
    for (toward, about, sign) in [(Axis::X, 1, 1.0), (Axis::Y, 0, -1.0)] {
        let effect = ColumnBow { axis: Axis::Z, toward, curvature_per_kelvin: 1e-5, lag_s: 1.0 };
        let mut config = EnvironmentConfig::constant();
        config.channels[0].mean = 22.0;
        let room = Environment::new(&config, 1);
        let at = |z: f64| joints(&effect, &Moment { reading_m: [0.1, 0.2, z], room: &room, ..calm() });
        // κ = 2e-5 /m: κs²/2 at 0.5 m, to the fourth order of κs
        assert!((at(0.5).linear_m[2][toward.index()] - 2.5e-6).abs() < 1e-15);
        let slope = (at(0.3 + 1e-4).linear_m[2][toward.index()] - at(0.3 - 1e-4).linear_m[2][toward.index()]) / 2e-4;
        // Leaning along +X is a turn about +Y, along +Y one about −X.
        assert!((slope - sign * at(0.3).angular_rad[2][about]).abs() < 1e-11);
    }
}

#[test]
fn warm_up_starts_at_nothing_and_ends_at_its_size() {
    let effect = WarmUp { final_m: [0.0, 2e-6, -5e-6], time_constant_s: 1000.0 };
    let mut moment = calm();
    assert_eq!(joints(&effect, &moment).tip_m, [0.0; 3]);
    moment.time_s = 1000.0;
    let grown = 0.7 * (1.0 - (-1.0_f64).exp()) + 0.3 * (1.0 - (-0.2_f64).exp());
    assert_close(joints(&effect, &moment).tip_m[2], -5e-6 * grown);
    moment.time_s = 1e6;
    assert_close(joints(&effect, &moment).tip_m[1], 2e-6);
}

#[test]
fn backlash_is_the_difference_between_the_two_approaches() {
    let effect = Backlash { axis: Axis::Y, size_m: 1e-6, growth_m: 0.5e-6 };
    let at = |y: f64, direction: f64| {
        let mut moment = calm();
        moment.reading_m[1] = y;
        moment.direction[1] = direction;
        joints(&effect, &moment).linear_m[1][1]
    };
    assert_close(at(0.0, -1.0) - at(0.0, 1.0), 1e-6);
    assert_close(at(0.3, -1.0) - at(0.3, 1.0), 1.5e-6);
    assert!(at(0.3, 1.0) < 0.0, "coming upward the axis stops short");
    assert_eq!(at(0.3, 0.0), 0.0);
}

#[test]
fn an_accelerated_carriage_twists() {
    let effect = Acceleration { axis: Axis::X, about: Axis::Z, rad_per_m_s2: 4e-6 };
    let mut moment = calm();
    moment.acceleration_m_s2 = [-0.5, 9.0, 9.0];
    assert_close(joints(&effect, &moment).angular_rad[0][2], -2e-6);
}

#[test]
fn a_periodic_scale_repeats_with_its_pitch() {
    let effect = PeriodicScale { axis: Axis::Z, size_m: 0.3e-6, pitch_m: 0.04, phase_rad: 0.0 };
    let at = |z: f64| {
        let mut moment = calm();
        moment.reading_m[2] = z;
        joints(&effect, &moment).linear_m[2][2]
    };
    assert_close(at(0.0), 0.3e-6);
    // Angles of some 30 rad are known to 4e-15, times 0.3 µm.
    assert!((at(0.2) - 0.3e-6).abs() < 1e-20);
    assert!((at(0.22) + 0.3e-6).abs() < 1e-20);
    assert!(at(0.21).abs() < 1e-20);
}

#[test]
fn behind_a_splice_the_whole_scale_stands_off() {
    let effect = Splice { axis: Axis::Z, size_m: 6e-6, at_m: 0.21 };
    let at = |z: f64| {
        let mut moment = calm();
        moment.reading_m[2] = z;
        joints(&effect, &moment).linear_m[2]
    };
    assert_eq!([0.0, 0.2099, 0.2101, 0.5].map(at), [[0.0; 3], [0.0; 3], [0.0, 0.0, 6e-6], [0.0, 0.0, 6e-6]]);
}

#[test]
fn a_beam_sags_under_the_carriage() {
    let effect = CarriageSag { carrying: Axis::X, carriage: Axis::Y, sag_m: 2e-6, twist_rad: 8e-6 };
    let found = joints(&effect, &calm());
    assert_close(found.linear_m[0][2], -2e-6);
    assert_close(found.angular_rad[0][0], 2e-6);
    let mut moment = calm();
    moment.reading_m[1] = 0.6;
    let found = joints(&effect, &moment);
    assert_close(found.linear_m[0][2], 0.0);
    assert_close(found.angular_rad[0][0], 4e-6);
}

#[test]
fn a_twist_by_two_positions_is_no_sum_of_functions_of_one() {
    let effect = CarriageTwist { carrying: Axis::X, carriage: Axis::Y, twist_rad: 8e-6 };
    let at = |x: f64, y: f64| {
        let mut moment = calm();
        (moment.reading_m[0], moment.reading_m[1]) = (x, y);
        joints(&effect, &moment).angular_rad[0][0]
    };
    assert_close(at(0.4, 0.3), 2e-6);
    assert_close(at(0.8, 0.6), 8e-6);
    // The mixed difference of a sum f(x) + g(y) is zero.
    assert_close(at(0.8, 0.6) - at(0.8, 0.0) - at(0.0, 0.6) + at(0.0, 0.0), 8e-6);
    let itself = CarriageTwist { carriage: Axis::X, ..effect };
    assert_eq!(itself.check().unwrap_err().key, "carrying, carriage");
}

#[test]
fn an_axis_lags_behind_its_approach_in_proportion_to_the_feed() {
    let effect = SpeedLag { axis: Axis::Z, lag_s: 40e-6 };
    let at = |feed_m_s: f64, direction: f64| {
        let mut moment = calm();
        moment.feed_m_s = feed_m_s;
        moment.direction = [1.0, 1.0, direction];
        joints(&effect, &moment).linear_m
    };
    assert_close(at(0.1, 1.0)[2][2], -4e-6);
    assert_close(at(0.05, -1.0)[2][2], 2e-6);
    assert_eq!(at(0.1, 0.0), [[0.0; 3]; 3]);
}

#[test]
fn a_loaded_table_sinks_most_in_its_middle() {
    let effect = TableLoad { compliance_m_kg: 0.2e-6 };
    let mut moment = calm();
    moment.load_kg = 10.0;
    assert_close(joints(&effect, &moment).tip_m[2], 2e-6);
    moment.reading_m[0] = 0.0;
    assert_close(joints(&effect, &moment).tip_m[2], 0.0);
}

#[test]
fn val_refraction_has_the_textbook_sensitivities() {
    let shift = |range_share: f64, dead_path_share: f64, channel: usize, by: f64| {
        let effect = Refraction { range_share, dead_path_share };
        effect.check().unwrap();
        let mut moment = calm();
        moment.environment.values[channel] += by;
        effect.range_shift_m(&moment, &beam([1.0, 0.0, 0.0]))
    };
    assert_close(shift(1.0, 0.0, 0, 1.0), -0.96e-6);
    assert_close(shift(1.0, 0.0, 7, 1.0), 0.27e-6);
    assert_close(shift(1.0, 0.0, 8, 1.0), -0.009e-6);
    assert_close(shift(0.0, 1.0, 0, 1.0), -0.48e-6);
    assert_eq!(shift(0.0, 0.0, 0, 1.0), 0.0);
}

#[test]
fn a_stand_creeps_from_its_first_reading_on() {
    let effect = StationDrift { rate_m_s: [1e-9, 0.0, -2e-9] };
    effect.check().unwrap();
    assert_eq!(effect.station_shift_m(&calm(), 0, 0.0), [0.0; 3]);
    let [x, y, z] = effect.station_shift_m(&calm(), 0, 3600.0);
    assert_close(x, 3.6e-6);
    assert_close(y, 0.0);
    assert_close(z, -7.2e-6);
    let [x, y, _] = effect.station_shift_m(&calm(), 3, 3600.0);
    assert_close(x.hypot(y), 3.6e-6);
    assert!((x - 3.6e-6).abs() > 1e-8);
}

#[test]
fn gimbal_harmonics_follow_the_beam() {
    let effect = Gimbal { sizes_m: [0.1e-6, 0.2e-6, 0.3e-6] };
    effect.check().unwrap();
    let along = |v| effect.range_shift_m(&calm(), &beam(v));
    assert_close(along([1.0, 0.0, 0.0]), 0.0);
    assert_close(along([0.0, 1.0, 0.0]), 0.1e-6);
    let c = FRAC_1_SQRT_2;
    assert_close(along([c, c, 0.0]), 0.1e-6 * c + 0.2e-6);
    assert_close(along([c, 0.0, c]), 0.3e-6);
    assert_eq!(along([0.0, 0.0, 1.0]), 0.0);
}

#[test]
fn a_reflector_is_right_head_on_and_wrong_at_sixty_degrees() {
    let effect = ReflectorIncidence { size_m: 0.5e-6, looks_along: [0.0, 0.0, -2.0] };
    effect.check().unwrap();
    let along = |v| effect.range_shift_m(&calm(), &beam(v));
    assert_close(along([0.0, 0.0, 1.0]), 0.0);
    let (sin, cos) = (60.0_f64.to_radians().sin(), 60.0_f64.to_radians().cos());
    assert_close(along([sin, 0.0, cos]), 0.5e-6);
    let mut blind = effect;
    blind.looks_along = [0.0; 3];
    assert_eq!(blind.check().unwrap_err().key, "looks_along");
}

#[test]
fn an_undescribed_effect_has_its_rms_and_depends_on_its_two_quantities_only() {
    let quantities = [("temp_air_c", [19.0, 21.0]), ("y_mm", [0.0, 600.0])];
    let effect = Undescribed::new(3, quantities, Axis::Z, 2e-6).unwrap();
    let steps = 40_u32;
    let mut total = 0.0;
    for i in 0..steps {
        for j in 0..steps {
            let mut moment = calm();
            moment.environment.values[0] = 19.0 + 2.0 * (f64::from(i) + 0.5) / f64::from(steps);
            moment.reading_m[1] = 0.6 * (f64::from(j) + 0.5) / f64::from(steps);
            let found = joints(&effect, &moment);
            total += found.tip_m[2].powi(2);
            moment.reading_m[0] = 0.1;
            moment.environment.values[7] = 990.0;
            assert_eq!(joints(&effect, &moment), found);
        }
    }
    let rms = total.sqrt() / f64::from(steps);
    // Midpoint rule on another grid: waves of at most 1.5 periods, errors far below a percent.
    assert!((rms / 2e-6 - 1.0).abs() < 0.01, "{rms}");
    let wrong = [("temp_air", [19.0, 21.0]), ("y_mm", [0.0, 600.0])];
    let refused = Undescribed::new(3, wrong, Axis::Z, 2e-6).unwrap_err();
    assert_eq!(refused.key, "temp_air");
}

fn all_effects() -> Vec<Arc<dyn Effect>> {
    let quantities = [("temp_granite_c", [19.8, 20.4]), ("x_mm", [0.0, 800.0])];
    vec![
        Arc::new(ScaleExpansion { axis: Axis::Y, per_kelvin: 9e-6, fixed_at_m: 0.0 }),
        Arc::new(GradientBow { curvature_per_kelvin: 2e-5 }),
        Arc::new(MoistureBow { curvature_per_percent: 2e-6 }),
        Arc::new(ColumnBow { axis: Axis::Z, toward: Axis::X, curvature_per_kelvin: 2e-5, lag_s: 900.0 }),
        Arc::new(WarmUp { final_m: [0.0, 1e-6, -4e-6], time_constant_s: 3000.0 }),
        Arc::new(Backlash { axis: Axis::X, size_m: 1e-6, growth_m: 1e-6 }),
        Arc::new(Acceleration { axis: Axis::Y, about: Axis::X, rad_per_m_s2: 8e-6 }),
        Arc::new(PeriodicScale { axis: Axis::X, size_m: 0.4e-6, pitch_m: 0.04, phase_rad: 0.3 }),
        Arc::new(CarriageSag { carrying: Axis::X, carriage: Axis::Y, sag_m: 2e-6, twist_rad: 5e-6 }),
        Arc::new(TableLoad { compliance_m_kg: 0.3e-6 }),
        Arc::new(Refraction { range_share: 0.5, dead_path_share: 1.0 }),
        Arc::new(StationDrift { rate_m_s: [5e-10, 5e-10, 2e-10] }),
        Arc::new(Gimbal { sizes_m: [0.3e-6, 0.2e-6, 0.2e-6] }),
        Arc::new(ReflectorIncidence { size_m: 0.5e-6, looks_along: [0.0, 0.0, -1.0] }),
        Arc::new(Undescribed::new(1, quantities, Axis::Y, 2e-6).unwrap()),
    ]
}

fn config(effects: Vec<Arc<dyn Effect>>) -> SimulationConfig {
    let machine = TruthRecipe::default().bridge_xyz().unwrap();
    SimulationConfig {
        seed: 5,
        plan: presets::case_like(machine.stroke_m, 4).build().unwrap(),
        machine,
        instrument: InstrumentConfig::LASER_TRACER,
        environment: EnvironmentConfig::workshop(),
        effects,
    }
}

#[test]
fn every_effect_shows_in_a_campaign_and_leaves_what_is_logged_alone() {
    let clean = simulate_campaign(&config(Vec::new())).unwrap();
    for effect in all_effects() {
        let name = effect.name();
        let touched = simulate_campaign(&config(vec![effect])).unwrap();
        assert_eq!(touched.campaign.covariates, clean.campaign.covariates);
        let pairs = clean.campaign.readings.iter().zip(&touched.campaign.readings);
        let squares: f64 = pairs.map(|(a, b)| (a.length_m - b.length_m).powi(2)).sum();
        let rms_m = (squares / clean.campaign.readings.len() as f64).sqrt();
        // The literature's range of sizes: from a tenth of a micrometre to some ten.
        assert!((0.1e-6..20e-6).contains(&rms_m), "{name}: {rms_m}");
    }
}

#[test]
fn what_moves_the_tip_is_in_the_verification_points_and_what_moves_the_range_is_not() {
    let clean = verification_points(&config(Vec::new()), 50, 2).unwrap();
    for effect in all_effects() {
        let name = effect.name();
        let of_range = matches!(name, "refraction" | "station_drift" | "gimbal" | "reflector_incidence");
        let points = verification_points(&config(vec![effect]), 50, 2).unwrap();
        let same = clean.iter().zip(&points).all(|(a, b)| a.actual_m == b.actual_m);
        assert_eq!(same, of_range, "{name}");
    }
}

#[test]
fn a_bad_effect_is_refused_by_its_place_and_key() {
    let bad = PeriodicScale { axis: Axis::X, size_m: 1e-6, pitch_m: 0.0, phase_rad: 0.0 };
    let mut effects = all_effects();
    effects.push(Arc::new(bad));
    let refused = simulate_campaign(&config(effects)).unwrap_err();
    assert_eq!(refused.key, "effects[15].periodic_scale.pitch_m");
}
