//! Positioning runs of a linear axis after ISO 230-2.
//!
//! Place in the flow: files are read into [`Run`]s; the figures of the standard and the diagnosis of an axis share that one form.
//! Error = actual − indicated = measured − target.

use std::collections::BTreeMap;

/// Direction from which a target was approached.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Approach {
    /// Towards larger positions (ISO 230-2: ↑).
    Positive,
    /// Towards smaller positions (↓).
    Negative,
}

impl Approach {
    /// +1 or −1.
    pub fn sign(self) -> f64 {
        match self {
            Approach::Positive => 1.0,
            Approach::Negative => -1.0,
        }
    }
}

/// One approach to one target.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Name of the axis.
    pub axis: String,
    /// Target position, which the axis indicates when it stands there (m).
    pub target_m: f64,
    /// Direction of approach.
    pub approach: Approach,
    /// Number of the cycle.
    pub cycle: i64,
    /// Position actually reached (m).
    pub measured_m: f64,
    /// Time (s).
    pub time_s: Option<f64>,
    /// Further logged quantities by name, in the unit of their name.
    pub covariates: BTreeMap<String, f64>,
}

impl Run {
    /// Actual − indicated (m).
    pub fn error_m(&self) -> f64 {
        self.measured_m - self.target_m
    }
}
