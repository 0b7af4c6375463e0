//! Evidence for whole campaigns: geometry of the range, noise statistics, determinism, verification points.

#![allow(clippy::unwrap_used)] // a preparation that fails fails its test

use abbe_measurement::instrument::RangeUncertainty;
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::instrument::{Correlated, InstrumentConfig, Outliers};
use abbe_virtual_machine::plan::presets;
use abbe_virtual_machine::simulate::covariate_names;
use abbe_virtual_machine::verification::{Frame, VerificationConfig};
use abbe_virtual_machine::{
    ReadingStream, SimulationConfig, TruthRecipe, simulate_campaign, verification_points, verification_points_with,
};

fn config(instrument: InstrumentConfig) -> SimulationConfig {
    let machine = TruthRecipe::default().bridge_xyz().unwrap();
    SimulationConfig {
        seed: 11,
        plan: presets::case_like(machine.stroke_m, 4).build().unwrap(),
        machine,
        instrument,
        environment: EnvironmentConfig::workshop(),
        effects: Vec::new(),
    }
}

fn distance_m(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|d| (a[d] - b[d]).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn a_noiseless_length_is_the_difference_of_two_distances() {
    let simulated = simulate_campaign(&config(InstrumentConfig::NOISELESS)).unwrap();
    let truth = &simulated.truth;
    for reading in &simulated.campaign.readings {
        let station = reading.station as usize;
        let point_m = truth.machine.actual_point_m(reading.reading_m, reading.offset_m);
        let range_m = distance_m(point_m, truth.stations_m[station]);
        let shown_m = reading.length_m + truth.first_ranges_m[station];
        // Two roundings of numbers below 2 m.
        assert!((range_m - shown_m).abs() < 1e-15, "{range_m} {shown_m}");
    }
}

#[test]
fn a_station_counts_from_its_first_reading() {
    let simulated = simulate_campaign(&config(InstrumentConfig::LASER_TRACER)).unwrap();
    let readings = &simulated.campaign.readings;
    let mut first = readings[0];
    assert_eq!(first.length_m, 0.0);
    for reading in readings {
        if reading.station != first.station {
            assert_eq!(reading.length_m, 0.0);
            first = *reading;
        }
    }
    assert_eq!(first.station, 4);
    // The noise of the first reading stands in the dead path.
    let truth = &simulated.truth;
    let noise_m = truth.first_ranges_m[0] - truth.readings[0].range_m;
    assert!(noise_m != 0.0 && noise_m.abs() < 1e-6);
}

#[test]
fn range_noise_has_the_declared_deviation_at_every_distance() {
    let mut config = config(InstrumentConfig::NOISELESS);
    config.instrument.range = RangeUncertainty { constant_m: 0.2e-6, per_metre: 0.5e-6, common_per_metre: 0.0 };
    config.plan = config.plan.repeated_to(20_000).unwrap();
    let mut near = (0.0, 0.0);
    let mut far = (0.0, 0.0);
    for simulated in ReadingStream::new(&config).unwrap() {
        let simulated = simulated.unwrap();
        let shown_m = simulated.reading.length_m + simulated.first_range_m;
        let range_m = simulated.truth.range_m;
        let scaled = (shown_m - range_m) / (0.2e-6 + 0.5e-6 * range_m);
        let half = if range_m < 0.8 { &mut near } else { &mut far };
        half.0 += 1.0;
        half.1 += scaled * scaled;
    }
    for (count, total) in [near, far] {
        assert!(count > 3000.0);
        // A mean of n squares of unit normals has the deviation √(2/n); four of them.
        assert!((total / count - 1.0).abs() < 4.0 * (2.0_f64 / count).sqrt());
    }
}

#[test]
fn repeatability_moves_the_machine_and_not_its_readings() {
    let mut config = config(InstrumentConfig::NOISELESS);
    config.instrument.repeatability_m = [0.1e-6, 0.2e-6, 0.4e-6];
    let simulated = simulate_campaign(&config).unwrap();
    let count = simulated.campaign.readings.len();
    let mut total = [0.0; 3];
    for (reading, truth) in simulated.campaign.readings.iter().zip(&simulated.truth.readings) {
        let machine = &simulated.truth.machine;
        let mean_m = machine.actual_point_m(reading.reading_m, reading.offset_m);
        for d in 0..3 {
            total[d] += (truth.actual_m[d] - mean_m[d]).powi(2);
        }
    }
    let tolerance = 4.0 * (2.0 / count as f64).sqrt();
    for (d, wanted_m) in [0.1e-6, 0.2e-6, 0.4e-6_f64].into_iter().enumerate() {
        let variance = total[d] / count as f64;
        assert!((variance / wanted_m.powi(2) - 1.0).abs() < tolerance);
    }
    let still = simulate_campaign(&self::config(InstrumentConfig::NOISELESS)).unwrap();
    let readings = |s: &abbe_virtual_machine::Simulated| -> Vec<[f64; 3]> {
        s.campaign.readings.iter().map(|r| r.reading_m).collect()
    };
    assert_eq!(readings(&simulated), readings(&still));
}

#[test]
fn a_machine_that_repeats_badly_leaves_the_tracers_noise_as_it_was() {
    let noise_m = |repeatability_m| {
        let mut config = config(InstrumentConfig::LASER_TRACER);
        config.instrument.repeatability_m = repeatability_m;
        let stream = ReadingStream::new(&config).unwrap().map(Result::unwrap);
        let shown = stream.map(|s| s.reading.length_m + s.first_range_m - s.truth.range_m);
        shown.collect::<Vec<f64>>()
    };
    for (calm, shaky) in noise_m([0.0; 3]).into_iter().zip(noise_m([1e-6; 3])) {
        // The range itself differs by micrometres, its noise by 0.15e-6 of that and by rounding.
        assert!((calm - shaky).abs() < 1e-11);
    }
}

#[test]
fn correlated_noise_hangs_together_as_asked_and_leaves_all_else_alone() {
    let shown = |correlated| {
        let config = config(InstrumentConfig { correlated, ..InstrumentConfig::LASER_TRACER });
        let stream = ReadingStream::new(&config).unwrap().map(Result::unwrap);
        let of = |s: abbe_virtual_machine::SimulatedReading| {
            (s.reading.station, s.reading.line, s.reading.length_m + s.first_range_m)
        };
        stream.map(of).collect::<Vec<_>>()
    };
    let white = shown(None);
    for by_line in [false, true] {
        let noisy = shown(Some(Correlated { deviation_m: 0.3e-6, neighbours: 0.8, by_line }));
        let noise: Vec<f64> = noisy.iter().zip(&white).map(|(a, b)| (a.2 - b.2) / 0.3e-6).collect();
        let count = noise.len() as f64;
        let pairs = |same: &dyn Fn(usize) -> bool| {
            let products: Vec<f64> = (1..noise.len()).filter(|k| same(*k)).map(|k| noise[k] * noise[k - 1]).collect();
            (products.iter().sum::<f64>() / products.len() as f64, products.len() as f64)
        };
        // Sums over correlated readings scatter like those of fewer: (1 + ρ²)/(1 − ρ²) times the variance.
        let scatter = |n: f64| 4.0 * (2.0 * 4.6 / n).sqrt();
        assert!((noise.iter().map(|v| v * v).sum::<f64>() / count - 1.0).abs() < scatter(count));
        let (on_lines, n) = pairs(&|k| noisy[k].1 == noisy[k - 1].1);
        assert!((on_lines - 0.8).abs() < scatter(n), "{by_line}: {on_lines}");
        let (between, n) = pairs(&|k| noisy[k].1 != noisy[k - 1].1 && noisy[k].0 == noisy[k - 1].0);
        let wanted = if by_line { 0.0 } else { 0.8 };
        assert!((between - wanted).abs() < scatter(n), "{by_line}: {between} of {n}");
    }
}

#[test]
fn outliers_come_as_often_as_asked_and_leave_all_else_alone() {
    let clean = simulate_campaign(&config(InstrumentConfig::LASER_TRACER)).unwrap();
    let mut instrument = InstrumentConfig::LASER_TRACER;
    instrument.outliers = Some(Outliers { fraction: 0.05, size_m: 30e-6 });
    let spoilt = simulate_campaign(&config(instrument)).unwrap();
    let count = clean.campaign.readings.len() as f64;
    let mut hits = 0.0;
    let both = clean.campaign.readings.iter().zip(&spoilt.campaign.readings);
    for ((before, after), truth) in both.zip(&spoilt.truth.readings) {
        match truth.outlier_m {
            None => assert_eq!(before.length_m, after.length_m),
            Some(size_m) => {
                hits += 1.0;
                assert_eq!(size_m.abs(), 30e-6);
                assert!((after.length_m - before.length_m - size_m).abs() < 1e-15);
            }
        }
    }
    // Binomial, four deviations.
    assert!((hits - 0.05 * count).abs() < 4.0 * (count * 0.05 * 0.95).sqrt());
}

#[test]
fn resolution_leaves_whole_steps() {
    let mut instrument = InstrumentConfig::LASER_TRACER;
    instrument.resolution_m = Some(1e-6);
    let simulated = simulate_campaign(&config(instrument)).unwrap();
    for reading in &simulated.campaign.readings {
        let steps = reading.length_m / 1e-6;
        assert!((steps - steps.round()).abs() < 1e-6);
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_other_ones() {
    let bytes = |config: &SimulationConfig| {
        let mut out: Vec<u8> = Vec::new();
        for simulated in ReadingStream::new(config).unwrap() {
            let simulated = simulated.unwrap();
            for value in [simulated.reading.length_m, simulated.reading.time_s]
                .into_iter()
                .chain(simulated.covariates)
                .chain(simulated.truth.actual_m)
            {
                out.extend(value.to_le_bytes());
            }
        }
        out
    };
    let mut config = config(InstrumentConfig::LASER_TRACER);
    let first = bytes(&config);
    assert_eq!(first, bytes(&config));
    config.seed += 1;
    assert_ne!(first, bytes(&config));
}

#[test]
fn the_stream_and_the_whole_campaign_are_the_same_readings() {
    let config = config(InstrumentConfig::LASER_TRACER);
    let whole = simulate_campaign(&config).unwrap();
    let stream = ReadingStream::new(&config).unwrap().map(Result::unwrap);
    assert!(stream.map(|s| s.reading).eq(whole.campaign.readings.iter().copied()));
}

#[test]
fn covariates_carry_the_column_names_of_the_recorded_campaigns() {
    let simulated = simulate_campaign(&config(InstrumentConfig::LASER_TRACER)).unwrap();
    let campaign = &simulated.campaign;
    let header = "dir_x,dir_y,dir_z,speed_mm_s,acc_x_mm_s2,acc_y_mm_s2,acc_z_mm_s2,load_kg,\
                  temp_air_c,temp_scale_x_c,temp_scale_y_c,temp_scale_z_c,temp_bridge_top_c,\
                  temp_bridge_bottom_c,temp_granite_c,pressure_hpa,humidity_pct";
    assert!(covariate_names().eq(header.split(',')));
    assert_eq!(campaign.lines.len(), 5 * 37);
    for column in &campaign.covariates {
        assert_eq!(column.values.len(), campaign.readings.len());
    }
    let feeds = &campaign.covariate("speed_mm_s").unwrap().values;
    assert!(feeds.iter().all(|v| [20.0, 60.0, 120.0].contains(&v.unwrap())));
    let air = &campaign.covariate("temp_air_c").unwrap().values;
    assert!(air.iter().all(|v| (18.0..23.0).contains(&v.unwrap())));
}

#[test]
fn verification_points_are_the_machines_own_points_within_its_strokes() {
    let config = config(InstrumentConfig::LASER_TRACER);
    let machine = config.checked_machine().unwrap();
    let points = verification_points(&config, 400, 3).unwrap();
    assert_eq!(points, verification_points(&config, 400, 3).unwrap());
    let end_s = config.plan.targets().last().unwrap().time_s;
    for point in &points {
        let wanted_m = machine.actual_point_m(point.reading_m, point.offset_m);
        assert_eq!(point.actual_m, wanted_m);
        assert!(point.time_s > end_s);
        let inside = |d: usize| (0.0..=config.machine.stroke_m[d][1]).contains(&point.reading_m[d]);
        assert!((0..3).all(inside));
    }
}

#[test]
fn an_unknown_frame_keeps_every_distance_between_points() {
    let config = config(InstrumentConfig::LASER_TRACER);
    let unknown = VerificationConfig { points: 50, seed: 3, frame: Frame::Unknown, known_to_m: 0.0 };
    let points = verification_points_with(&config, &unknown).unwrap();
    for pair in points.windows(2) {
        let inside = distance_m(pair[0].actual_in_machine_m, pair[1].actual_in_machine_m);
        let outside = distance_m(pair[0].actual_m, pair[1].actual_m);
        assert!((inside - outside).abs() < 5e-15);
        assert!(distance_m(pair[0].actual_m, pair[0].actual_in_machine_m) > 1e-6);
    }
}

#[test]
fn bad_settings_are_refused_by_their_key() {
    let key = |change: &dyn Fn(&mut SimulationConfig)| {
        let mut config = config(InstrumentConfig::LASER_TRACER);
        change(&mut config);
        simulate_campaign(&config).unwrap_err().key
    };
    assert_eq!(key(&|c| c.instrument.range.per_metre = -1e-7), "instrument.range.per_metre");
    assert_eq!(key(&|c| c.instrument.repeatability_m[1] = f64::NAN), "instrument.repeatability_m");
    assert_eq!(key(&|c| c.instrument.resolution_m = Some(0.0)), "instrument.resolution_m");
    assert_eq!(key(&|c| c.environment.channels[7].noise = -1.0), "environment.pressure_hpa.noise");
    // A station in the middle of a line: the reflector would run into the tracer.
    assert_eq!(
        key(&|c| {
            let line = &c.plan.stations[0].lines[0];
            let mut place = line.from_m;
            for d in 0..3 {
                place[d] += line.offset_m[d];
            }
            c.plan.stations[0].position_m = place;
        }),
        "plan.stations[0].position_m"
    );
}
