//! Probability that a weighted sum of squares of normal deviates exceeds a value, where the noise is estimated beside it.
//!
//! Place in the flow: asked by [`crate::wander`]. Σ λ z² > q · χ²(ν)/ν is X = Σ w z² > 0 with the weights λ and, ν times, −q/ν. The
//! saddlepoint approximation of its tail (Lugannani and Rice 1980; Kuonen 1999 for quadratic forms) is right to some percent of the
//! probability, however small. No units.

use statrs::distribution::{ContinuousCDF, Normal};

/// Halvings of the interval that holds the saddlepoint.
const HALVINGS: usize = 200;
/// Deviate below which the approximation is 0/0: the form is where chance expects it.
const NEAR_MEAN: f64 = 1e-4;

/// Probability of a form beyond `form` (in units of the noise), `weights` above 0, `degrees` those of the noise; 1 without weights.
pub(crate) fn p_of_form(weights: &[f64], form: f64, degrees: f64) -> f64 {
    let largest = weights.iter().copied().fold(0.0, f64::max);
    if largest <= 0.0 || !form.is_finite() || form <= 0.0 || degrees <= 0.0 {
        return 1.0;
    }
    // The greatest weight is 1 from here on.
    let weights: Vec<f64> = weights.iter().map(|weight| weight / largest).collect();
    let noise = form / largest / degrees;
    let derivative = |at: f64| -> f64 {
        weights.iter().map(|w| w / (1.0 - 2.0 * at * w)).sum::<f64>() - degrees * noise / (1.0 + 2.0 * at * noise)
    };
    // The derivative grows from −∞ at one end to ∞ at the other.
    let (mut low, mut high) = (-0.5 / noise, 0.5);
    for _ in 0..HALVINGS {
        let middle = f64::midpoint(low, high);
        if derivative(middle) < 0.0 { low = middle } else { high = middle }
    }
    let at = f64::midpoint(low, high);
    let cumulant = -0.5 * weights.iter().map(|w| (-2.0 * at * w).ln_1p()).sum::<f64>()
        - 0.5 * degrees * (2.0 * at * noise).ln_1p();
    let curvature = weights.iter().map(|w| 2.0 * (w / (1.0 - 2.0 * at * w)).powi(2)).sum::<f64>()
        + 2.0 * degrees * (noise / (1.0 + 2.0 * at * noise)).powi(2);
    let deviate = at.signum() * (-2.0 * cumulant).max(0.0).sqrt();
    let scaled = at * curvature.sqrt();
    let Ok(normal) = Normal::new(0.0, 1.0) else { return 1.0 };
    if deviate.abs() < NEAR_MEAN || scaled.abs() < NEAR_MEAN {
        return 0.5;
    }
    normal.cdf(-(deviate + (scaled / deviate).ln() / deviate)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use statrs::distribution::FisherSnedecor;

    /// Equal weights: the ratio is that of the F test.
    #[test]
    fn val_fisher_equal_weights_are_an_f_test() {
        for (count, degrees) in [(1_usize, 60.0), (3, 500.0), (12, 100.0), (90, 400.0)] {
            let exact = FisherSnedecor::new(count as f64, degrees).unwrap();
            for f in [0.3, 1.5, 2.5, 6.0] {
                let p = p_of_form(&vec![0.4; count], f * 0.4 * count as f64, degrees);
                let wanted = 1.0 - exact.cdf(f);
                assert!((p - wanted).abs() <= 0.06 * wanted + 1e-12, "{count} {degrees} {f}: {p} {wanted}");
            }
        }
    }

    /// Very unequal weights, against draws.
    #[test]
    fn unequal_weights_agree_with_draws() {
        use rand::{Rng, SeedableRng};
        const DRAWS: usize = 40_000;
        let weights: Vec<f64> = (0..30).map(|k| 1.0 / f64::from(1 + k * k)).collect();
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        // Box and Muller.
        let mut square = || {
            let (radius, turn): (f64, f64) = (random.random(), random.random());
            -2.0 * (1.0 - radius).ln() * (std::f64::consts::TAU * turn).cos().powi(2)
        };
        let mut form = || -> f64 { weights.iter().map(|w| w * square()).sum() };
        let mut forms: Vec<f64> = (0..DRAWS).map(|_| form()).collect();
        forms.sort_by(f64::total_cmp);
        for share in [0.5, 0.9, 0.99, 0.999] {
            let p = p_of_form(&weights, forms[(share * DRAWS as f64) as usize], 1e7);
            // Two standard deviations of the count, and what the approximation may miss.
            let slack = 2.0 * ((1.0 - share) * share / DRAWS as f64).sqrt() + 0.06 * (1.0 - share);
            assert!((p - (1.0 - share)).abs() < slack, "{share}: {p}");
        }
    }
}
