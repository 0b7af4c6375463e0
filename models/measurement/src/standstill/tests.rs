//! Evidence for standstills: what is none is not taken for one, and what is one ends where it ends.

use super::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SETTINGS: StandstillSettings =
    StandstillSettings { span_m: 3e-6, creep_m: 0.5e-6, shortest_s: 0.5, longest_s: 2.0, pause_s: 0.25 };
/// Interval of the readings (s).
const EVERY_S: f64 = 0.01;

/// Positions of X by the time (s); Y and Z stand. All standstills that ended, and how long the last one lasts.
fn rests(until_s: f64, x_m: impl Fn(f64) -> f64) -> (Vec<(f64, f64)>, Option<f64>) {
    let mut standstill = Standstill::new(SETTINGS);
    let mut ended = Vec::new();
    for k in 0..(until_s / EVERY_S) as usize {
        let time_s = 1.7e9 + k as f64 * EVERY_S;
        let reading_m = [0.4 + x_m(k as f64 * EVERY_S), 0.3, 0.1];
        if let Change::Left(rest) = standstill.push(Scaled { time_s, reading_m }) {
            let (from_s, to_s) = rest.ends_s();
            ended.push((from_s - 1.7e9, to_s - 1.7e9));
        }
    }
    (ended, standstill.lasts_s())
}

/// Repeatable noise between −1 and 1.
fn noise(time_s: f64) -> f64 {
    let mut generator = ChaCha8Rng::seed_from_u64((time_s * 1e4).round() as u64);
    generator.random_range(-1.0..1.0)
}

#[test]
fn a_move_between_two_places_leaves_two_standstills_with_the_right_ends() {
    let x_m = |t: f64| 0.05 * (t - 1.0).clamp(0.0, 0.5) + 0.2e-6 * noise(t);
    let (ended, lasts_s) = rests(3.0, x_m);
    assert_eq!(ended.len(), 1, "{ended:?}");
    assert!(ended[0].0 < 0.02 && (ended[0].1 - 1.0).abs() < 0.03, "{ended:?}");
    assert!((lasts_s.unwrap() - 1.5).abs() < 0.05, "{lasts_s:?}");
}

#[test]
fn a_slow_creep_is_no_standstill_though_each_moment_of_it_is_within_the_span() {
    // 1.2 um/s: within the span for 2.5 s, and 0.6 um in the shortest standstill.
    assert_eq!(rests(10.0, |t| 1.2e-6 * t + 0.1e-6 * noise(t)), (vec![], None));
    // A creep that is allowed for the shortest one ends it as soon as it has come further than that.
    let (ended, _) = rests(10.0, |t| 0.6e-6 * t);
    assert!(
        !ended.is_empty() && ended.iter().all(|(from_s, to_s)| (to_s - from_s) * 0.6e-6 <= 0.5e-6 + 1e-9),
        "{ended:?}"
    );
}

#[test]
fn vibration_beyond_the_span_and_a_ring_that_has_not_died_away_are_none() {
    assert_eq!(rests(10.0, |t| 2e-6 * (31.0 * t).sin()), (vec![], None));
    let (ended, lasts_s) = rests(3.0, |t| 2e-6 * (31.0 * t).sin() * (1.0 - t).clamp(0.0, 1.0));
    assert!(ended.is_empty() && lasts_s.unwrap() > 2.0, "{ended:?} {lasts_s:?}");
    // Within the span it is averaged over.
    assert!(rests(3.0, |t| 0.5e-6 * (31.0 * t).sin()).1.unwrap() > 2.9);
}

#[test]
fn a_pause_ends_a_standstill_and_a_clock_that_goes_back_is_not_used() {
    let mut standstill = Standstill::new(SETTINGS);
    let at = |time_s: f64| Scaled { time_s, reading_m: [0.1; 3] };
    for k in 0..100 {
        standstill.push(at(0.01 * f64::from(k)));
    }
    assert_eq!(standstill.push(at(0.5)), Change::NotLater);
    assert_eq!(standstill.push(at(0.99)), Change::NotLater, "the same stamp twice is one reading");
    assert_eq!(standstill.push(Scaled { time_s: 1.0, reading_m: [f64::NAN; 3] }), Change::NotLater);
    let Change::Left(rest) = standstill.push(at(5.0)) else { panic!("a pause") };
    assert_eq!((rest.scales.len(), rest.ends_s()), (100, (0.0, 0.99)));
    assert_eq!(standstill.lasts_s(), None);
    standstill.forget();
    assert_eq!(standstill.push(at(0.0)), Change::Moving);
}

#[test]
fn a_machine_that_stands_for_hours_takes_no_more_memory_and_creeps_away_in_the_end() {
    let mut standstill = Standstill::new(SETTINGS);
    let mut left = None;
    for k in 0..2_000_000_u32 {
        let time_s = EVERY_S * f64::from(k);
        // 1 um in an hour and a half.
        let reading_m = [0.5e-6 * (time_s / 2700.0), 0.0, 0.0];
        if let Change::Left(rest) = standstill.push(Scaled { time_s, reading_m }) {
            left = Some((time_s, rest.scales.len()));
            break;
        }
    }
    let (time_s, kept) = left.unwrap();
    assert!((time_s / 16_200.0 - 1.0).abs() < 0.01 && kept <= 202, "{time_s} {kept}");
}

#[test]
fn whatever_the_stream_a_standstill_is_what_it_says() {
    for seed in 0..300 {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        let mut standstill = Standstill::new(SETTINGS);
        let (mut time_s, mut at_m, mut feed_m_s) = (generator.random_range(-1e9..2e9), [0.0_f64; 3], [0.0_f64; 3]);
        for _ in 0..600 {
            time_s += match generator.random_range(0..40) {
                0 => generator.random_range(-1.0..2.0),
                _ => EVERY_S,
            };
            if generator.random_range(0..60) == 0 {
                let size: f64 = 10.0_f64.powi(generator.random_range(-8..-1));
                feed_m_s = std::array::from_fn(|_| [0.0, size, -size][generator.random_range(0..3)]);
            }
            let noise_m = generator.random_range(0.0..1e-6);
            at_m = std::array::from_fn(|d| at_m[d] + feed_m_s[d] * EVERY_S);
            let reading_m = at_m.map(|m| m + noise_m);
            if let Change::Left(rest) = standstill.push(Scaled { time_s, reading_m }) {
                check(&rest);
            }
            standstill.rest().iter().for_each(check);
        }
    }
}

fn check(rest: &Rest) {
    let (from_s, to_s) = rest.ends_s();
    assert!(to_s - from_s >= SETTINGS.shortest_s);
    assert!(rest.scales.windows(2).all(|pair| (0.0..=SETTINGS.pause_s).contains(&(pair[1].time_s - pair[0].time_s))));
    let times: Vec<f64> = rest.scales.iter().map(|scaled| scaled.time_s).collect();
    for d in 0..3 {
        let values: Vec<f64> = rest.scales.iter().map(|scaled| scaled.reading_m[d]).collect();
        let (low, high) = values.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
        assert!(high - low <= SETTINGS.span_m && drift(&times, &values).abs() <= SETTINGS.creep_m * (1.0 + 1e-9));
    }
}

#[test]
fn drift_is_that_of_the_line() {
    let times: Vec<f64> = (0..11).map(|k| 1.7e9 + f64::from(k)).collect();
    let values: Vec<f64> = (0..11).map(|k| 3.0 + 2e-7 * f64::from(k) + if k == 5 { 1e-7 } else { 0.0 }).collect();
    assert!((drift(&times, &values) - 2e-6).abs() < 1e-12);
    assert_eq!((drift(&[], &[]), drift(&[1.0], &[2.0])), (0.0, 0.0));
}
