//! One reading out of a standstill: means of scales and lengths, or why there is none.
//!
//! Place in the flow: [`super::Capturer`] hands over what was read while the machine stood still. What is no stillness of the
//! beam is refused: a pause, a gross error, a step, a drift, scatter beyond what is allowed, an old length that is repeated. SI.

use super::config::LengthsConfig;
use abbe_measurement::robust;
use abbe_measurement::standstill::{Rest, drift};
use abbe_measurement::steady_mean::steady_mean;
use thiserror::Error;

/// A uniform distribution of this width has a standard deviation of one.
const WIDTH: f64 = 3.464_101_6;
/// Gross errors are so many times the allowed scatter from the median.
const GROSS: f64 = 3.0;
/// Or so many times the scatter that most of the lengths have, where that is more than this share of the allowed one: a quiet
/// tracer tells a smaller one.
const BESIDE_MOST: f64 = 10.0;
const LEAST_GROSS: f64 = 0.1;

/// A length and its instant (s).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Length {
    pub(super) time_s: f64,
    pub(super) length_m: f64,
}

/// What a standstill gives.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Averaged {
    pub(super) reading_m: [f64; 3],
    pub(super) u_reading_m: [f64; 3],
    pub(super) length_m: f64,
    pub(super) u_length_m: f64,
    pub(super) scatter_m: f64,
    pub(super) lengths: usize,
    pub(super) effective: f64,
}

/// Why a standstill gives no reading, with what to do.
#[derive(Debug, Clone, PartialEq, Error)]
pub(super) enum NoReading {
    #[error("no length came while the machine stood; see that the tracer has its beam and sends")]
    NoLength,
    #[error(
        "only {0} lengths came while the machine stood, and {1} are needed; let it stand longer, or have the tracer send faster"
    )]
    Few(usize, usize),
    #[error("no length came for {0:.2} s while the machine stood: the beam was lost, or the connection")]
    Pause(f64),
    #[error("{0} of {1} lengths are far from the others, by up to {2:.1} µm: the beam was disturbed")]
    Gross(usize, usize, f64),
    #[error(
        "the length drifted by {0:.2} µm while the scales stood still, and {1:.2} µm are allowed (lengths.creep_um); let it settle longer"
    )]
    Drift(f64, f64),
    #[error(
        "a single length scatters by {0:.2} µm, and {1:.2} µm are allowed (lengths.scatter_um); something vibrates, or the air moves"
    )]
    Scatter(f64, f64),
    #[error(
        "{0} lengths are the same to the last digit: the tracer repeats an old one; see whether the beam is lost. Where its last \
         digit is coarser than its noise, name it with lengths.step_um"
    )]
    Repeated(usize),
}

/// Means over a window of a standstill (s).
pub(super) fn average(
    rest: &Rest,
    (from_s, to_s): (f64, f64),
    lengths: &[Length],
    allowed: &LengthsConfig,
) -> Result<Averaged, NoReading> {
    let values: Vec<f64> = lengths.iter().map(|length| length.length_m).collect();
    let mean = steady_mean(&values).ok_or(NoReading::NoLength)?;
    if values.len() < allowed.fewest {
        return Err(NoReading::Few(values.len(), allowed.fewest));
    }
    let instants = || std::iter::once(from_s).chain(lengths.iter().map(|length| length.time_s)).chain([to_s]);
    let pause_s = instants().zip(instants().skip(1)).map(|(a, b)| b - a).fold(0.0, f64::max);
    if pause_s > allowed.pause_s {
        return Err(NoReading::Pause(pause_s));
    }
    let scatter_m = allowed.scatter_um / 1e6;
    let middle = robust::median(values.clone()).unwrap_or(mean.mean);
    let off_m: Vec<f64> = values.iter().map(|value| (value - middle).abs()).collect();
    let most_m = robust::scale(&off_m) * BESIDE_MOST;
    let limit_m = most_m.clamp(LEAST_GROSS * scatter_m, GROSS * scatter_m);
    let gross = off_m.iter().filter(|off_m| **off_m > limit_m).count();
    // Where most are far off it is no few, but all that scatters.
    if gross > 0 && gross * 4 < values.len() {
        return Err(NoReading::Gross(
            gross,
            values.len(),
            off_m.iter().fold(0.0_f64, |most, off| most.max(*off)) * 1e6,
        ));
    }
    let times: Vec<f64> = lengths.iter().map(|length| length.time_s).collect();
    let (half, whole_m) = (values.len() / 2, drift(&times, &values));
    let step_m = mean_of(&values[half..]) - mean_of(&values[..half]);
    // A step in the middle is a line of one and a half times its height.
    let drift_m = if whole_m.abs() > step_m.abs() { whole_m } else { step_m };
    if drift_m.abs() > allowed.creep_um / 1e6 {
        return Err(NoReading::Drift(drift_m * 1e6, allowed.creep_um));
    }
    if mean.scatter > scatter_m {
        return Err(NoReading::Scatter(mean.scatter * 1e6, allowed.scatter_um));
    }
    if mean.distinct == 1 && allowed.step_um.is_none() {
        return Err(NoReading::Repeated(values.len()));
    }
    let digit_m = allowed.step_um.unwrap_or(0.0) / 1e6 / WIDTH;
    let axis = |d: usize| {
        let own: Vec<f64> = rest.between(from_s, to_s).map(|scaled| scaled.reading_m[d]).collect();
        steady_mean(&own).map(|mean| (mean.mean, mean.u))
    };
    let scales: Vec<(f64, f64)> = (0..3).filter_map(axis).collect();
    let [x, y, z] = scales[..] else { return Err(NoReading::Pause(to_s - from_s)) };
    Ok(Averaged {
        reading_m: [x.0, y.0, z.0],
        u_reading_m: [x.1, y.1, z.1],
        length_m: mean.mean,
        u_length_m: mean.u.hypot(drift_m / WIDTH).hypot(digit_m),
        scatter_m: mean.scatter,
        lengths: values.len(),
        effective: mean.effective,
    })
}

fn mean_of(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_measurement::standstill::Scaled;

    /// Lengths each 10 ms over a second with a noise of 0.1 um.
    fn read(length_m: impl Fn(usize, f64) -> f64) -> Result<Averaged, NoReading> {
        let noise = |k: usize| 1e-7 * ((((k * 7919 + 13) % 1000) as f64) / 500.0 - 1.0);
        let rest = Rest {
            scales: (0..=100).map(|k| Scaled { time_s: 0.01 * f64::from(k), reading_m: [0.1, 0.2, 0.3] }).collect(),
        };
        let lengths: Vec<Length> = (1..100)
            .map(|k| Length { time_s: 0.01 * k as f64, length_m: length_m(k, noise(k)) })
            .filter(|length| length.length_m.is_finite())
            .collect();
        average(&rest, (0.0, 1.0), &lengths, &LengthsConfig::default())
    }

    #[test]
    fn a_quiet_standstill_gives_means_and_what_they_are_worth() {
        let found = read(|_, noise| 0.5 + noise).unwrap();
        assert!((found.length_m - 0.5).abs() < 3.0 * found.u_length_m && found.u_length_m < 5e-8, "{found:?}");
        assert_eq!((found.reading_m, found.lengths), ([0.1, 0.2, 0.3], 99));
    }

    #[test]
    fn what_is_no_stillness_of_the_beam_is_refused_by_its_cause() {
        let refused = |length_m: &dyn Fn(usize, f64) -> f64| read(length_m).unwrap_err();
        assert_eq!(refused(&|_, _| f64::NAN), NoReading::NoLength);
        assert_eq!(refused(&|k, noise| if k < 4 { noise } else { f64::NAN }), NoReading::Few(3, 5));
        assert!(
            matches!(refused(&|k, noise| if (40..70).contains(&k) { f64::NAN } else { noise }), NoReading::Pause(s) if s > 0.3)
        );
        assert!(
            matches!(refused(&|k, noise| if k > 60 { f64::NAN } else { noise }), NoReading::Pause(_)),
            "the beam went before the end"
        );
        assert!(
            matches!(refused(&|k, noise| noise + if k == 50 { 5e-5 } else { 0.0 }), NoReading::Gross(1, 99, um) if um > 49.0)
        );
        let small = refused(&|k, noise| noise + if k == 50 { 1e-6 } else { 0.0 });
        assert!(matches!(small, NoReading::Gross(1, 99, _)), "ten times what most scatter by: {small}");
        assert!(
            matches!(refused(&|k, noise| noise + if k > 50 { 3e-6 } else { 0.0 }), NoReading::Drift(um, _) if um > 2.5),
            "a jump"
        );
        assert!(matches!(refused(&|k, noise| noise + 2e-8 * k as f64), NoReading::Drift(..)), "a drift");
        assert!(matches!(refused(&|k, noise| 20.0 * noise + 3e-6 * (k as f64 * 0.9).sin()), NoReading::Scatter(..)));
        assert_eq!(refused(&|_, _| 0.5), NoReading::Repeated(99));
    }

    #[test]
    fn an_instrument_of_coarse_digits_is_taken_with_the_uncertainty_of_its_digit() {
        let rest = Rest {
            scales: vec![Scaled { time_s: 0.0, reading_m: [0.0; 3] }, Scaled { time_s: 1.0, reading_m: [0.0; 3] }],
        };
        let lengths: Vec<Length> = (0..=20).map(|k| Length { time_s: 0.05 * f64::from(k), length_m: 0.5 }).collect();
        let allowed = LengthsConfig { step_um: Some(1.0), ..LengthsConfig::default() };
        let found = average(&rest, (0.0, 1.0), &lengths, &allowed).unwrap();
        assert!((found.u_length_m * 1e6 - 0.289).abs() < 1e-3);
    }
}
