//! Powers by polynomials of their own: as accurate as their type, the same bits on every platform, and free of calls,
//! so that loops over them run in the processor's vector registers.
//!
//! Place in the flow: softmax and kernels of a prediction. Method: the exponent is split into an integer n, which goes straight
//! into the exponent bits, and a rest of at most half a step, for which there is a polynomial. [`halved`] is in powers of 2, as
//! this needs a quarter fewer operations than e^x; [`exp_f32`] is a Taylor series. Arguments are taken as 1000 beyond that (−80
//! in single precision), where the result vanishes beside 1.

/// 1.5 · 2⁵²: added and taken away again, it rounds to an integer.
const ROUND: f64 = 6_755_399_441_055_744.0;
const LN2_HIGH_F32: f32 = 0.693_359_4;
const LN2_LOW_F32: f32 = -2.121_944_4e-4;
/// 1.5 · 2²³.
const ROUND_F32: f32 = 12_582_912.0;
/// Polynomial 1 + f q(f) for 2^f on |f| ≤ ½ with the least largest relative error, 1.8e-17 (Remez): q, highest power first.
const POWER_OF_2: [f64; 11] = [
    4.078_070_473_394_136e-10,
    7.072_570_455_730_148e-9,
    1.018_064_767_059_439e-7,
    1.321_544_267_510_645_4e-6,
    1.525_272_738_516_203e-5,
    1.540_353_044_157_249e-4,
    1.333_355_815_344_000_3e-3,
    9.618_129_107_607_003e-3,
    5.550_410_866_479_039e-2,
    2.402_265_069_591_009_7e-1,
    6.931_471_805_599_457e-1,
];

/// 2^−t for t ≥ 0.
#[inline(always)]
pub(crate) fn halved(t: f64) -> f64 {
    let t = if t > 1000.0 { 1000.0 } else { t };
    let shifted = ROUND - t;
    let f = (ROUND - shifted) - t;
    let mut series = POWER_OF_2[0];
    for coefficient in &POWER_OF_2[1..] {
        series = series * f + coefficient;
    }
    let series = series * f + 1.0;
    // The lowest bits of the shifted number are −(t + f); moved to the exponent they multiply by that power of 2.
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
            let t = f64::from(step) * 0.004_7;
            assert!((halved(t) / (-t).exp2() - 1.0).abs() < TOLERANCE, "{t}: {} {}", halved(t), (-t).exp2());
            let x = -(step as f32) * 0.000_39;
            assert!((exp_f32(x) / x.exp() - 1.0).abs() < TOLERANCE_F32, "{x}: {} {}", exp_f32(x), x.exp());
        }
        assert_eq!((halved(0.0), exp_f32(0.0)), (1.0, 1.0));
    }

    #[test]
    fn vanishes_far_from_zero() {
        assert!(halved(1e9) < 1e-300 && halved(f64::INFINITY) < 1e-300);
        assert!(exp_f32(-1e9) < 1e-34 && exp_f32(f32::NEG_INFINITY) < 1e-34);
    }
}
