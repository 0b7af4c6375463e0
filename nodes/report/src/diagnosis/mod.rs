//! Report of a diagnosis: what the model lacks, how sure that is, what it gains, and what the data cannot tell.
//!
//! In: a [`Record`], which is also the content of `diagnosis.json`, and the residuals to be drawn. Out: the sections of
//! a [`Report`], the answer first. The same for tracer campaigns, positioning runs, sphere centres and residual vectors.

mod bins;
mod build;
mod pictures;
mod record;
mod tables;
mod units;
mod words;

pub(crate) use units::decimals;

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
    let u = scaled(parameter.u);
    (scaled(parameter.value), u, scaled(parameter.plausible), unit, units::decimals(u))
}
