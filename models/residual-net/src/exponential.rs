//! Exponential by its own polynomial: as accurate as its type, the same bits on every platform, and free of calls, so that
//! loops over it run in the processor's vector registers.
//!
//! Place in the flow: softmax and kernels of a prediction. Method: e^x = 2^n e^r with n = round(x / ln 2), |r| ≤ ln 2 / 2, and
//! e^r by its Taylor series; n goes straight into the exponent bits. Arguments are at most 0 here and are taken as
//! −700 (−80 in single precision) below that, where the result vanishes beside 1.

const LOG2_E: f64 = std::f64::consts::LOG2_E;
/// ln 2 in two parts: products of the first with small integers are exact.
const LN2_HIGH: f64 = 6.931_471_803_691_238e-1;
const LN2_LOW: f64 = 1.908_214_929_270_587_7e-10;
/// 1.5 · 2⁵²: added and taken away again, it rounds to an integer.
const ROUND: f64 = 6_755_399_441_055_744.0;
const LN2_HIGH_F32: f32 = 0.693_359_4;
const LN2_LOW_F32: f32 = -2.121_944_4e-4;
/// 1.5 · 2²³.
const ROUND_F32: f32 = 12_582_912.0;

/// e^x for x ≤ 0.
#[inline(always)]
pub(crate) fn exp(x: f64) -> f64 {
    let x = if x < -700.0 { -700.0 } else { x };
    let shifted = x * LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = (x - n * LN2_HIGH) - n * LN2_LOW;
    let mut series = 1.0 / 479_001_600.0;
    for reciprocal in [
        1.0 / 39_916_800.0,
        1.0 / 3_628_800.0,
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5_040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
        1.0,
    ] {
        series = series * r + reciprocal;
    }
    // The lowest bits of the shifted number are n; moved to the exponent they multiply by 2^n.
    f64::from_bits(series.to_bits().wrapping_add(shifted.to_bits() << 52))
}

/// e^x for x ≤ 0 in single precision.
#[inline(always)]
pub(crate) fn exp_f32(x: f32) -> f32 {
    let x = if x < -80.0 { -80.0 } else { x };
    let shifted = x * std::f32::consts::LOG2_E + ROUND_F32;
    let n = shifted - ROUND_F32;
    let r = (x - n * LN2_HIGH_F32) - n * LN2_LOW_F32;
    let mut series = 1.0_f32 / 5_040.0;
    for reciprocal in [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0] {
        series = series * r + reciprocal;
    }
    f32::from_bits(series.to_bits().wrapping_add(shifted.to_bits() << 23))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A few units in the last place.
    const TOLERANCE: f64 = 1e-15;
    const TOLERANCE_F32: f32 = 3e-7;

    #[test]
    fn agrees_with_the_exponential_of_the_platform() {
        for step in 0..200_000 {
            let x = -f64::from(step) * 0.0031;
            assert!((exp(x) / x.exp() - 1.0).abs() < TOLERANCE, "{x}: {} {}", exp(x), x.exp());
            let x = -(step as f32) * 0.000_39;
            assert!((exp_f32(x) / x.exp() - 1.0).abs() < TOLERANCE_F32, "{x}: {} {}", exp_f32(x), x.exp());
        }
        assert_eq!((exp(0.0), exp_f32(0.0)), (1.0, 1.0));
    }

    #[test]
    fn vanishes_far_below_zero() {
        assert!(exp(-1e9) < 1e-300 && exp(f64::NEG_INFINITY) < 1e-300);
        assert!(exp_f32(-1e9) < 1e-34 && exp_f32(f32::NEG_INFINITY) < 1e-34);
    }
}
