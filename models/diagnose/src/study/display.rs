//! What a display of few digits hides.
//!
//! Place in the flow: beside the noise of each axis or component. A reading that is rounded to a step q is off by up to q/2. Where the
//! noise is smaller than the step, repeats are off by the same and show nothing of it: a standard uncertainty of q/√12 (GUM, F.2.2.1)
//! that no mean makes less. Larger noise moves repeats over the edges of steps; of noise of deviation σ, e^(−2π²σ²/q²) is left, the first
//! term of the Fourier series of rounding (Widrow & Kollár, Quantization Noise, 2008, chapter 4). One unit for all lengths.

use std::f64::consts::PI;

/// Finest step that is looked for (m): no instrument shows more.
pub(super) const FINEST_M: f64 = 1e-10;
/// Share of it that numbers in files are off by.
const ROUNDING: f64 = 1e-2;
/// Rows below which some step fits by chance.
const FEWEST: usize = 8;
/// Different values below which they may all be multiples of more than one step of the display: then a round step is taken.
const FEW_VALUES: usize = 5;

/// Largest step (a round one, 1·10ᵏ, where values are few) of which all differences between values (m) are multiples; `None` where that
/// is finer than `finest`.
pub(super) fn step(values: &[f64], finest: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let differences = sorted.windows(2).map(|pair| pair[1] - pair[0]);
    let nothing = ROUNDING * finest;
    let distinct = 1 + differences.clone().filter(|difference| *difference > nothing).count();
    let step = differences.fold(0.0, |step, difference| common(step, difference, nothing));
    let step = if distinct < FEW_VALUES { round_divisor(step, nothing) } else { step };
    (values.len() >= FEWEST && step >= finest).then_some(step)
}

/// Largest 10ᵏ that divides a length, zero where none does.
fn round_divisor(length: f64, nothing: f64) -> f64 {
    let divides = |ten: &f64| (length - (length / ten).round() * ten).abs() <= nothing;
    (-10..0).rev().map(|k| 10f64.powi(k)).filter(|ten| *ten <= length + nothing).find(divides).unwrap_or(0.0)
}

/// Greatest common divisor, what is below `nothing` being rounding of numbers.
fn common(mut a: f64, mut b: f64, nothing: f64) -> f64 {
    while b > nothing {
        (a, b) = (b, (a - (a / b).round() * b).abs());
    }
    a
}

/// Standard uncertainty that rounding to a step leaves in the mean of many repeats of this deviation, which holds the scatter of
/// rounding (Sheppard's q²/12).
pub(super) fn hidden(step: f64, sigma: f64) -> f64 {
    let noise = ((sigma / step).powi(2) - 1.0 / 12.0).max(0.0);
    step / 12f64.sqrt() * (-2.0 * PI * PI * noise).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On a step, but for rounding of numbers: some places of a sequence that visits all.
    fn on_step(q: f64) -> Vec<f64> {
        (0..40).map(|k| f64::from(k * 7 % 11) * q + 0.4).collect()
    }

    #[test]
    fn a_step_is_found_and_none_where_values_are_continuous() {
        for q in [1e-6, 0.5e-6, 1e-7, 25.4e-9] {
            assert!((step(&on_step(q), FINEST_M).unwrap() / q - 1.0).abs() < 1e-4, "{q}");
        }
        // Multiples of 2 and of 3 steps.
        let uneven = [0.0, 2.0, 5.0, 7.0, 10.0, 12.0, 14.0, 17.0].map(|k| k * 1e-6);
        assert!((step(&uneven, FINEST_M).unwrap() - 1e-6).abs() < 1e-10);
        let smooth: Vec<f64> = (0..40).map(|k| 1e-6 * (f64::from(k) * 0.7).sin()).collect();
        assert_eq!(step(&smooth, FINEST_M), None);
        assert_eq!(step(&on_step(1e-6)[..7], FINEST_M), None);
        assert_eq!(step(&[0.0; 20], FINEST_M), None);
        // Two values, which a display of 1 or of 2 µm may show.
        let two: Vec<f64> = (0..20).map(|k| f64::from(k % 2) * 2e-6).collect();
        assert!((step(&two, FINEST_M).unwrap() - 1e-6).abs() < 1e-12);
    }

    /// Means of many rounded repeats, taken anywhere on the step, are off by what is said.
    #[test]
    fn what_rounding_hides_is_what_means_are_off_by() {
        for sigma in [0.01, 0.2, 0.3, 0.4] {
            let noise: Vec<f64> = (0..2000).map(|k| normal((f64::from(k) + 0.5) / 2000.0) * sigma).collect();
            let (mut bias, mut scatter) = (0.0, 0.0);
            for place in 0..200 {
                let place = f64::from(place) / 200.0;
                let shown: Vec<f64> = noise.iter().map(|noise| (place + noise).round()).collect();
                let mean = shown.iter().sum::<f64>() / 2000.0;
                bias += (mean - place).powi(2) / 200.0;
                scatter += shown.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 2000.0 / 200.0;
            }
            // What is shown scatters by less than noise and rounding together where the noise is small: then more is said, not less.
            let (said, off) = (hidden(1.0, scatter.sqrt()), bias.sqrt());
            assert!(said >= 0.9 * off && said < 0.3, "{sigma}: {said} {off}");
        }
        assert!(hidden(1.0, 1.0) < 1e-6);
    }

    fn normal(probability: f64) -> f64 {
        use statrs::distribution::{ContinuousCDF, Normal};
        Normal::standard().inverse_cdf(probability)
    }
}
