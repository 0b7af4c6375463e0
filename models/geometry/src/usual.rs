//! The range in which a covariate was identified, and where a value lies to it.
//!
//! Place in the flow: [`crate::model`] makes them; [`crate::seen`] and [`crate::doubt`] hold samples to them.

/// A covariate of an effect, and the range in which the effect was identified, in the unit of its name.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Usual {
    pub(crate) name: String,
    /// `None` in models of earlier software that do not tell it.
    pub(crate) range: Option<(f64, f64)>,
}

impl Usual {
    /// Where in its range a value lies: at the nearest place of it, and how many widths beyond.
    pub(crate) fn place(&self, value: f64) -> Option<(f64, f64)> {
        let (low, high) = self.range?;
        let nearest = value.clamp(low, high);
        let beyond = (value - nearest).abs();
        Some((nearest, if beyond == 0.0 { 0.0 } else { beyond / (high - low) }))
    }
}
