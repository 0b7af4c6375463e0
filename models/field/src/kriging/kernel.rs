//! Covariance of the signal between two points, with a length scale for each input.
//!
//! Place in the flow: entries of covariance matrices in [`super::likelihood`], and of fields that other crates estimate.
//! With r² = Σ (Δ_d/ℓ_d)²:
//! Matérn 5/2 (1 + √5 r + 5r²/3) e^(−√5 r); squared exponential e^(−r²/2). Source: Rasmussen & Williams 2006 eq. 4.17, 4.9.

/// Kind of covariance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kernel {
    /// Twice differentiable fields: the usual choice for machines, whose errors bend but do not jump.
    Matern52,
    /// Infinitely smooth fields.
    SquaredExponential,
}

impl Kernel {
    /// Correlation at a scaled square distance Σ (Δ_d/ℓ_d)².
    pub fn correlation(self, square: f64) -> f64 {
        match self {
            Kernel::Matern52 => {
                let a = (5.0 * square).sqrt();
                (1.0 + a + a * a / 3.0) * (-a).exp()
            }
            Kernel::SquaredExponential => (-0.5 * square).exp(),
        }
    }

    /// Correlation, and the factor that makes (Δ_d/ℓ_d)² its derivative by ln ℓ_d.
    pub(crate) fn with_derivative(self, square: f64) -> (f64, f64) {
        match self {
            Kernel::Matern52 => {
                let a = (5.0 * square).sqrt();
                let decay = (-a).exp();
                ((1.0 + a + a * a / 3.0) * decay, 5.0 / 3.0 * (1.0 + a) * decay)
            }
            Kernel::SquaredExponential => {
                let correlation = (-0.5 * square).exp();
                (correlation, correlation)
            }
        }
    }
}
