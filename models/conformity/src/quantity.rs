//! What was observed and what is permitted, as types that cannot be taken for each other.
//!
//! Place in the flow: every figure of ISO 10360 carries one of the two. Neither converts into the other.

/// An error of indication as observed: measured − calibrated (m), with sign.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct ObservedError(f64);

impl ObservedError {
    /// From metres.
    pub const fn from_metres(metres: f64) -> ObservedError {
        ObservedError(metres)
    }

    /// Value (m).
    pub const fn metres(self) -> f64 {
        self.0
    }

    /// Its magnitude (m).
    pub const fn magnitude_m(self) -> f64 {
        self.0.abs()
    }
}

/// The largest magnitude of an error that a specification permits (m).
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct PermissibleError(f64);

impl PermissibleError {
    /// From metres.
    pub const fn from_metres(metres: f64) -> PermissibleError {
        PermissibleError(metres)
    }

    /// Value (m).
    pub const fn metres(self) -> f64 {
        self.0
    }
}
