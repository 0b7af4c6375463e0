//! Report of a diagnosis: what the model lacks, how sure that is, what it gains, and what the data cannot tell.
//!
//! In: a [`Record`], which is also the content of `diagnosis.json`, and the residuals to be drawn. Out: the sections of
//! a [`Report`], the answer first. The same for tracer campaigns, positioning runs, sphere centres and residual vectors.

mod bins;
mod build;
mod names;
mod pictures;
mod record;
mod shaped;
mod tables;
mod units;
mod words;

pub use names::parameter as parameter_name;
pub use pictures::{Residuals, Split, View};
pub use record::{
    Alternative, Averaged, Blocked, Both, Considered, Detection, Effect, ErrorFigures, File, Group, HeldOut, LeftOut,
    ModelOut, NotIdentifiable, Parameter, Placebo, Predicts, Record, Rival, Rung, SetAside, Structure, Untestable,
    Verification,
};

use crate::error::ReportError;
use crate::finite::check_finite;
use crate::identity::Identity;
use crate::report::{NextStep, Report, to_json};
use crate::sections::Section;

/// A diagnosis and what its pictures need.
#[derive(Debug, Clone, PartialEq)]
pub struct DiagnosisReport {
    /// What was found.
    pub record: Record,
    /// Residuals before and after; `None` where the data have none to show.
    pub residuals: Option<Residuals>,
    /// Further pictures of the data, shown after what was found.
    pub figures: Vec<Section>,
    /// Who, when and which.
    pub identity: Identity,
    /// What to do with the answer.
    pub next: Option<NextStep>,
}

impl DiagnosisReport {
    /// The page.
    ///
    /// # Errors
    /// [`ReportError`] naming the section and the place in it.
    pub fn html(&self) -> Result<String, ReportError> {
        check_finite("diagnosis", &self.record)?;
        self.report().html()
    }

    /// The content of `diagnosis.json`.
    ///
    /// # Errors
    /// [`ReportError::NotFinite`] naming the field.
    pub fn json(&self) -> Result<String, ReportError> {
        to_json("diagnosis", &self.record)
    }

    /// Title, key figures and chapters.
    pub fn report(&self) -> Report {
        build::report(self)
    }
}

/// A parameter with its unit as people read it: value, standard uncertainty, plausible magnitude, unit, decimals.
pub fn readable(parameter: &Parameter) -> (Option<f64>, Option<f64>, Option<f64>, String, u8) {
    let units::Readable { factor, unit } = units::readable(parameter);
    let scaled = |value: Option<f64>| value.map(|v| v * factor);
    let (value, u) = (scaled(parameter.value), scaled(parameter.u));
    let decimals = crate::digits::of(value.unwrap_or(0.0), u);
    (value, u, scaled(parameter.plausible), unit, decimals)
}

/// What makes an SI unit one that readers use, and that unit: 1e6 and µrad/(m/s²) of `rad/(m/s2)`.
pub fn readable_unit(si: &str) -> (f64, String) {
    let units::Readable { factor, unit } = units::from_si(si, false);
    (factor, unit)
}

/// A shape in words: axes in capitals, lengths in mm, times in minutes.
pub fn shape_words(shape: &std::collections::BTreeMap<String, serde_json::Value>) -> String {
    shaped::entries(&names::shape(shape))
}

/// A share as text: two decimals, and of one that is nearly whole that it is above 0.99.
pub fn share_text(share: f64) -> String {
    if share > NEARLY_ALL { "above 0.99".to_owned() } else { crate::digits::plain(share, 2) }
}

/// A share above this would read as the whole.
const NEARLY_ALL: f64 = 0.99;

/// Below this share of what is plausible, a parameter and its uncertainty are rounding: nothing was left for it to tell.
const ROUNDING: f64 = 1e-9;

/// Said instead of a figure of such a parameter.
pub const HELD_ALREADY: &str = "held by the model or another form already";

/// Whether the model, or another form that was found, holds already what this parameter does; it then has no figure.
pub fn is_held_already(parameter: &Parameter) -> bool {
    let is_nothing = |value: Option<f64>, plausible: f64| value.is_some_and(|v| v.abs() < ROUNDING * plausible);
    parameter.plausible.is_some_and(|p| is_nothing(parameter.value, p) && is_nothing(parameter.u, p))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A form in y shares its straight part with another in y and q: the second tells 1e-18 m of it, and no more.
    #[test]
    fn regress_a_parameter_that_another_form_holds_has_no_figure() {
        let own = |value: f64, u: f64| Parameter {
            name: "c_1_0".into(),
            value: Some(value),
            unit: "m".into(),
            u: Some(u),
            plausible: Some(1e-3),
            is_plausible: true,
        };
        assert!(is_held_already(&own(-1.4e-20, 1.8e-19)));
        assert!(!is_held_already(&own(0.0, 2e-8)) && !is_held_already(&own(3e-7, 1e-13)));
        assert!(!is_held_already(&Parameter { u: None, ..own(0.0, 0.0) }));
    }
}
