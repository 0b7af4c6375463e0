//! Probabilities by chance of statistics that may be no number, or larger than any table.
//!
//! Place in the flow: every test here and in the diagnosis asks for its probability by [`beyond`]. The library's distributions end the
//! program where a statistic overflows or is no number, which exact copies of readings can make of it.

use statrs::distribution::ContinuousCDF;

/// Largest statistic that is looked up: beyond it distributions overflow, and probabilities are zero anyway.
const LARGEST: f64 = 1e100;

/// Probability of a statistic beyond this one, which is not negative but for rounding; 1 where it is no number.
#[expect(clippy::disallowed_methods, reason = "the one place that guards it")]
pub fn beyond(distribution: &impl ContinuousCDF<f64, f64>, statistic: f64) -> f64 {
    if statistic.is_nan() { 1.0 } else { distribution.sf(statistic.clamp(0.0, LARGEST)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use statrs::distribution::{ChiSquared, FisherSnedecor, StudentsT};

    #[test]
    fn any_statistic_has_a_probability() {
        let of_all = |statistic: f64| {
            let (f, chi2) = (FisherSnedecor::new(3.0, 40.0).unwrap(), ChiSquared::new(5.0).unwrap());
            [
                beyond(&f, statistic),
                beyond(&chi2, statistic),
                beyond(&StudentsT::new(0.0, 1.0, 7.0).unwrap(), statistic),
            ]
        };
        assert_eq!(of_all(f64::NAN), [1.0; 3]);
        for huge in [1e99, f64::MAX, f64::INFINITY] {
            assert!(of_all(huge).iter().all(|p| (0.0..1e-30).contains(p)), "{:?}", of_all(huge));
        }
        assert_eq!(of_all(-1e-12), of_all(0.0));
    }
}
