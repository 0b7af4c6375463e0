//! Uncertainty of a laser tracer's range, U(L) = constant + proportional · L, and of the zero of one that measures distances.
//!
//! Place in the flow: the machine file declares it, identification weights with it, the monitor bounds with it.

use nalgebra::Vector3;

/// How well the zero of an instrument of absolute distances is known (m, k = 1). Its offset and that of a reflector's centre are some 10 µm
/// each, and held at zero, 20 µm of it were 3.6 µm of error at an uncertainty of 1 µm. So wide that a reflector whose radius was left out is
/// found as well.
pub const U_ABSOLUTE_ZERO_M: f64 = 1e-3;

/// Standard uncertainty (k = 1) of an interferometric range: u(L) = `constant_m` + `per_metre` · L from reading to reading, and a scale that
/// all lengths have in common.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeUncertainty {
    /// Length-independent part, k = 1 (m).
    pub constant_m: f64,
    /// Length-proportional part, k = 1 (m/m).
    pub per_metre: f64,
    /// The scale that all lengths have in common, k = 1 (m/m): wavelength, air, certificate. It makes a machine larger or smaller as a
    /// whole, so that no reading shows it and no number of readings averages it out.
    pub common_per_metre: f64,
}

impl RangeUncertainty {
    /// Standard uncertainty (m, k = 1) of a range of `range_m` metres, as far as it scatters from reading to reading.
    pub fn standard_m(&self, range_m: f64) -> f64 {
        self.constant_m + self.per_metre * range_m.abs()
    }

    /// The same of one reading of a point to which axes come back with these repeatabilities (m, k = 1), along a sight of length 1: with
    /// lᵀ Σ l.
    pub fn with_repeatability_m(&self, range_m: f64, sight: &Vector3<f64>, repeatability_m: [f64; 3]) -> f64 {
        let along_m = Vector3::from(repeatability_m).component_mul(sight);
        (self.standard_m(range_m).powi(2) + along_m.norm_squared()).sqrt()
    }
}
