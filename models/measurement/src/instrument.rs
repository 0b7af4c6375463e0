//! Uncertainty of a laser tracer's range: U(L) = constant + proportional · L.
//!
//! Place in the flow: the machine file declares it, identification weights with it, the monitor bounds with it.

/// Standard uncertainty (k = 1) of an interferometric range, u(L) = `constant_m` + `per_metre` · L.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeUncertainty {
    /// Length-independent part, k = 1 (m).
    pub constant_m: f64,
    /// Length-proportional part, k = 1 (m/m).
    pub per_metre: f64,
}

impl RangeUncertainty {
    /// Standard uncertainty (m, k = 1) of a range of `range_m` metres.
    pub fn standard_m(&self, range_m: f64) -> f64 {
        self.constant_m + self.per_metre * range_m.abs()
    }
}
