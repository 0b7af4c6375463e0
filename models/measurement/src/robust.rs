//! Robust weights: one up to a threshold, falling smoothly to zero, in three parts like Hampel's.
//!
//! Place in the flow: between two passes. The scale is the median absolute residual, so that an effect the model
//! lacks widens the accepted band instead of throwing half the campaign away. Full weight up to 3.5 keeps χ² of
//! clean normal data unbiased (to 0.6 %), which Tukey's biweight does not. Source: Huber & Ronchetti, Robust
//! Statistics, ch. 4.

/// Standardised residual up to which a reading has full weight.
const FULL: f64 = 3.5;
/// Standardised residual from which a reading is rejected.
const CUT: f64 = 6.0;
/// Median of |z| for a standard normal z.
const MEDIAN_OF_NORMAL: f64 = 0.674_489_750_196_081_7;

/// Robust standard deviation of the standardised residuals; 0 for none.
pub fn scale(standardised: &[f64]) -> f64 {
    median(standardised.iter().map(|z| z.abs()).collect()).map_or(0.0, |median| median / MEDIAN_OF_NORMAL)
}

/// Median, the upper of the two middle values of an even number; `None` for none.
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Weight of each reading from its residual divided by `u` (declared) and by `scale` (found).
pub fn weights(standardised: &[f64], scale: f64) -> Vec<f64> {
    let weight = |z: &f64| {
        let excess = (z.abs() / scale - FULL) / (CUT - FULL);
        match excess {
            // With a scale of zero too.
            _ if *z == 0.0 || excess <= 0.0 => 1.0,
            _ if excess < 1.0 => (1.0 - excess * excess).powi(2),
            // What is no number is no reading either.
            _ => 0.0,
        }
    };
    standardised.iter().map(weight).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scale_of_a_normal_sample_is_its_deviation_and_outliers_lose_their_weight() {
        // Quantiles of a normal distribution with deviation 3, by a rational approximation good to 1e-3.
        let quantile = |p: f64| 3.0 * 4.91 * (p.powf(0.14) - (1.0 - p).powf(0.14));
        let mut sample: Vec<f64> = (1..1000).map(|k| quantile(f64::from(k) / 1000.0)).collect();
        sample.push(1e4);
        let found = scale(&sample);
        assert!((found - 3.0).abs() < 0.05, "{found}");
        let weights = weights(&sample, found);
        assert_eq!(weights[999], 0.0);
        assert!(weights[..999].iter().all(|w| *w == 1.0));
        assert_eq!(super::weights(&[f64::NAN, f64::INFINITY, 0.0], 1.0), [0.0, 0.0, 1.0]);
        assert_eq!(super::weights(&[1.0, 0.0], 0.0), [0.0, 1.0]);
    }
}
