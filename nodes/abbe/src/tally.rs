//! What rows were worth: how many were corrected, in what state, where the first bad ones stand, and what most of them share.
//!
//! Place in the flow: what corrects rows (`abbe correct` of tables and bags, `verify`, `residuals`, the length test of a model)
//! counts here and says it on standard error, so that rows outside the machine do not pass for corrected ones. Lengths in m, shown in mm.

use crate::exit::Ended;
use abbe_files::status_word;
use abbe_geometry::correct::{Status, correct, is_within};
use abbe_geometry::effects::{CovariateSource, CovariateValue, State};
use abbe_geometry::model::MachineModel;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Share of rows that are not in volume from which it is a warning.
const WARNED_SHARE: f64 = 0.1;
const AXES: [&str; 3] = ["X", "Y", "Z"];
/// Factors by which readings of another unit miss millimetres.
const UNITS: [(f64, &str); 3] = [(1e3, "metres"), (25.4, "inches"), (1e-3, "micrometres")];
/// Share of the volume's largest extent that readings of the right unit cover.
const COVERED: f64 = 0.2;

/// Rows by status.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    rows: u64,
    kinds: BTreeMap<Status, Kind>,
    /// Those that are extrapolated only since something that no effect reads, or a difference of temperatures, was not seen so.
    beside: u64,
    /// Covariates that a residual model asks for.
    inputs: Vec<String>,
    /// Smallest and largest reading of each axis (m).
    span_m: Option<[(f64, f64); 3]>,
    /// Temperatures that widen the uncertainty and that no row has had.
    untold: Option<Vec<String>>,
}

/// Rows of one status.
#[derive(Debug, Default)]
struct Kind {
    rows: u64,
    first: u64,
    /// What is wrong, in how many of them, with the value furthest off.
    why: BTreeMap<Reason, (u64, f64)>,
}

impl Kind {
    fn count(&mut self, reason: Reason, value: f64) {
        let (rows, furthest) = self.why.entry(reason).or_insert((0, value));
        *rows += 1;
        if value.abs() > furthest.abs() {
            *furthest = value;
        }
    }

    /// What is wrong in most of them, and in how many.
    fn causes(&self, model: &MachineModel, status: Status) -> Option<(u64, String)> {
        let most = self.why.values().map(|(rows, _)| *rows).max()?;
        let of_most = self.why.iter().filter(|(_, (rows, _))| *rows == most);
        let words: Vec<String> = of_most.map(|(why, (_, furthest))| why.words(model, status, *furthest)).collect();
        Some((most, words.join("; ")))
    }
}

/// What is wrong with a row.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum Reason {
    Reading(usize),
    Offset(usize),
    OutsideCovariate(String),
    Parted(String, String),
    MissingCovariate(String),
    /// No single quantity: what an effect or the residual model adds, or the correction as a whole.
    Implausible,
}

/// Why a row is rejected, in words.
pub(crate) fn why_rejected(model: &MachineModel, state: &State) -> String {
    let words = |(reason, value): (Reason, f64)| reason.words(model, Status::Rejected, value);
    rejected_for(model, state).into_iter().map(words).collect::<Vec<_>>().join("; ")
}

impl Tally {
    /// Of rows that are also corrected with a residual model with these inputs.
    pub(crate) fn asking(inputs: Vec<String>) -> Tally {
        Tally { inputs, ..Tally::default() }
    }

    /// Counts a row; `place` is its line, or its number.
    pub(crate) fn add(&mut self, model: &MachineModel, state: &State, status: Status, place: u64) {
        self.rows += 1;
        let span_m = self.span_m.get_or_insert(state.reading_m.map(|value| (value, value)));
        for ((low, high), value) in span_m.iter_mut().zip(state.reading_m) {
            (*low, *high) = (low.min(value), high.max(value));
        }
        let untold = self.untold.get_or_insert_with(|| widening(model));
        untold.retain(|name| !matches!(state.covariates.covariate(name), CovariateValue::Fresh(_)));
        let kind = self.kinds.entry(status).or_default();
        kind.rows += 1;
        if status == Status::InVolume {
            return;
        }
        let found = reasons(model, &self.inputs, state, status);
        let read = model.reads();
        let is_beside = |(reason, _): &(Reason, f64)| match reason {
            Reason::OutsideCovariate(name) => !read.contains(name),
            Reason::Parted(..) => true,
            Reason::Reading(_) | Reason::Offset(_) | Reason::MissingCovariate(_) | Reason::Implausible => false,
        };
        self.beside += u64::from(status == Status::Extrapolated && found.iter().all(is_beside));
        if kind.rows == 1 {
            kind.first = place;
        }
        found.into_iter().for_each(|(reason, value)| kind.count(reason, value));
    }

    /// Number of rows of this status.
    pub(crate) fn count(&self, status: Status) -> u64 {
        self.kinds.get(&status).map_or(0, |kind| kind.rows)
    }

    /// Whether every row is inside what the model knows.
    pub(crate) fn is_inside(&self) -> bool {
        self.count(Status::InVolume) == self.rows
    }

    /// Number of rows.
    pub(crate) fn rows(&self) -> u64 {
        self.rows
    }

    /// The words for standard error; `place` is `line` or `reading`.
    pub(crate) fn words(&self, model: &MachineModel, file: &str, place: &str) -> String {
        let inside = self.count(Status::InVolume);
        let bad = (self.rows - inside) as f64;
        let warning = if bad > WARNED_SHARE * self.rows as f64 { "warning: " } else { "" };
        let corrected = self.rows - self.count(Status::Rejected);
        let mut text = format!("{warning}{file}: {} rows, {corrected} corrected, {inside} in volume", self.rows);
        for (status, kind) in self.kinds.iter().filter(|(status, _)| **status != Status::InVolume) {
            // Writing to a string cannot fail.
            let _ = write!(text, ", {} {} (first: {place} {})", kind.rows, status_word(*status), kind.first);
        }
        for (status, kind) in &self.kinds {
            if let Some((rows, causes)) = kind.causes(model, *status) {
                let which = if rows == kind.rows { "all".to_owned() } else { rows.to_string() };
                let _ = write!(text, "\n  {}, {which} of them: {causes}", status_word(*status));
            }
        }
        if let Some(unit) = self.unit(model).filter(|_| inside == 0) {
            let _ = write!(text, "\n  as {unit} the readings would lie inside; x_mm, y_mm and z_mm are millimetres");
        }
        if let Some(untold) = self.untold(model) {
            let _ = write!(text, "\n  {untold}");
        }
        text
    }

    /// That no row says how warm the machine was, of temperatures by which its scales may expand as no campaign has seen.
    fn untold(&self, model: &MachineModel) -> Option<String> {
        let ranges = &model.parts().identified.covariates;
        let range = |name: &String| match ranges.get(name) {
            Some((low, high)) => format!("{name} ({low:.2} … {high:.2})"),
            None => name.clone(),
        };
        let names: Vec<String> = self.untold.as_ref()?.iter().map(range).collect();
        (!names.is_empty()).then(|| {
            format!(
                "no row has {}, in brackets as in the campaign: the uncertainty holds where the machine stands at these temperatures",
                names.join(", ")
            )
        })
    }

    /// The same for a page, in sentences; `None` where all rows are inside and say how warm it was.
    pub(crate) fn sentences(&self, model: &MachineModel) -> Option<String> {
        let what = |status: Status| match status {
            Status::Extrapolated => {
                "lie outside of what the model was identified from, where the uncertainty is a lower bound"
            }
            Status::CovariateMissing => {
                "lack a quantity that the model reads, and are corrected with its effect in the middle of its usual range"
            }
            Status::Stale => {
                "have a quantity that is too old, and are corrected with its effect in the middle of its usual range"
            }
            Status::InVolume | Status::Rejected => "were not corrected",
        };
        let sentence = |(status, kind): (&Status, &Kind)| {
            let causes = match kind.causes(model, *status) {
                Some((rows, causes)) if rows == kind.rows => format!(" ({causes})"),
                Some((rows, causes)) => format!(" ({rows} of them: {causes})"),
                None => String::new(),
            };
            format!("{} of {} rows {}{causes}.", kind.rows, self.rows, what(*status))
        };
        let outside = self.kinds.iter().filter(|(status, _)| **status != Status::InVolume);
        let untold = self.untold(model).map(|untold| format!("N{}.", &untold[1..]));
        let sentences: Vec<String> = outside.map(sentence).chain(untold).collect();
        (!sentences.is_empty()).then(|| sentences.join(" "))
    }

    /// An error where no row is inside what the model knows, but for quantities that it does not ask for.
    pub(crate) fn judge(&self, file: &str) -> Result<(), Ended> {
        if self.count(Status::InVolume) + self.beside > 0 {
            return Ok(());
        }
        let why = format!(
            "{file}: no row could be corrected inside what the model was identified from; do not use them as corrected"
        );
        Err(Ended::nothing_inside(why))
    }

    /// The unit in which the readings would fill the volume, where they do not as millimetres.
    fn unit(&self, model: &MachineModel) -> Option<&'static str> {
        let (span_m, bounds_m) = (self.span_m?, &model.parts().identified.reading_m);
        let covered = |factor: f64| {
            let shares = span_m.iter().zip(bounds_m).map(|(s, b)| (s.1 - s.0) * factor / (b.1 - b.0));
            shares.fold(0.0, f64::max)
        };
        let inside = |factor: f64| {
            let mut axes = span_m.iter().zip(bounds_m);
            axes.all(|(s, b)| is_within(*b, s.0 * factor) && is_within(*b, s.1 * factor))
        };
        UNITS.iter().find(|(factor, _)| inside(*factor) && covered(*factor) > COVERED).map(|(_, name)| *name)
    }
}

/// Temperatures that the campaign logged and by which scales may expand.
fn widening(model: &MachineModel) -> Vec<String> {
    let all = &model.parts().quality.unseen_expansions.by_sensor;
    let widens = all.iter().filter(|unseen| !unseen.is_none());
    widens.map(|unseen| unseen.sensor.clone()).collect()
}

impl Reason {
    fn words(&self, model: &MachineModel, status: Status, furthest: f64) -> String {
        let parts = model.parts();
        let outside = |what: String, (low, high): (f64, f64), unit: &str| {
            format!("{what} is outside {low:.4} … {high:.4}{unit}, {furthest:.4}{unit} at the furthest")
        };
        let mm = |(low, high): (f64, f64)| (low * 1e3, high * 1e3);
        match self {
            Reason::Reading(axis)
                if status == Status::Rejected && !is_within(parts.machine.stroke_m[*axis], furthest / 1e3) =>
            {
                outside(AXES[*axis].to_owned(), mm(parts.machine.stroke_m[*axis]), " mm")
            }
            Reason::Reading(axis) => outside(AXES[*axis].to_owned(), mm(parts.identified.reading_m[*axis]), " mm"),
            Reason::Offset(axis) => {
                outside(format!("the offset in {}", AXES[*axis]), mm(parts.identified.offset_m[*axis]), " mm")
            }
            Reason::OutsideCovariate(name) => match parts.identified.covariates.get(name) {
                Some((low, high)) => {
                    format!("{name} was {low:.4} … {high:.4} in the campaign, here {furthest:.4} at the furthest")
                }
                None => name.clone(),
            },
            Reason::Parted(name, other) => {
                format!("{name} and {other} stand further apart than in the campaign, so that either may be what acts")
            }
            Reason::MissingCovariate(name) => format!("{name} is missing, empty, no number or too old"),
            Reason::Implausible => {
                "the correction is larger than any machine's, cannot be bounded, or is no number".to_owned()
            }
        }
    }
}

/// What is wrong with a row, and the value that is (mm, or the unit of a covariate).
fn reasons(model: &MachineModel, inputs: &[String], state: &State, status: Status) -> Vec<(Reason, f64)> {
    let parts = model.parts();
    let beyond = |values: [f64; 3], bounds: &[(f64, f64); 3]| -> Vec<(usize, f64)> {
        let axes =
            values.into_iter().zip(bounds).enumerate().filter(|(_, (value, bounds))| !is_within(**bounds, *value));
        axes.map(|(axis, (value, _))| (axis, value * 1e3)).collect()
    };
    let readings = |bounds| beyond(state.reading_m, bounds).into_iter().map(|(axis, mm)| (Reason::Reading(axis), mm));
    match status {
        Status::InVolume => Vec::new(),
        Status::Rejected => rejected_for(model, state),
        Status::Extrapolated => {
            let offsets = beyond(state.offset_m, &parts.identified.offset_m).into_iter();
            let covariates = parts.identified.covariates.keys().filter_map(|name| {
                match (state.covariates.covariate(name), model.covariate_range(name)) {
                    (CovariateValue::Fresh(value), Some((low, high))) if value < low || value > high => {
                        Some((Reason::OutsideCovariate(name.clone()), value))
                    }
                    _ => None,
                }
            });
            let offsets = offsets.map(|(axis, mm)| (Reason::Offset(axis), mm));
            let parted = model.parted(state).into_iter();
            let parted = parted.map(|(name, other)| (Reason::Parted(name.to_owned(), other.to_owned()), 0.0));
            readings(&parts.identified.reading_m).chain(offsets).chain(covariates).chain(parted).collect()
        }
        Status::CovariateMissing | Status::Stale => {
            let of_effects = parts.effects.iter().flat_map(|fitted| fitted.effect.covariates());
            let names = of_effects.chain(inputs.iter().cloned());
            let lacks = |name: &String| !matches!(state.covariates.covariate(name), CovariateValue::Fresh(_));
            names.filter(lacks).map(|name| (Reason::MissingCovariate(name), 0.0)).collect()
        }
    }
}

/// Covariates, taken into the ranges of the campaign but for one.
struct Ranged<'a> {
    state: &'a State<'a>,
    model: &'a MachineModel,
    but: Option<&'a str>,
}

impl CovariateSource for Ranged<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        let value = self.state.covariates.covariate(name);
        match (value, self.model.covariate_range(name)) {
            (CovariateValue::Fresh(value), Some((low, high))) if self.but != Some(name) => {
                CovariateValue::Fresh(value.max(low).min(high))
            }
            _ => value,
        }
    }
}

/// What a row is rejected for: each quantity outside of what was identified that is enough for it while all others are inside; all of them
/// where none is alone. So no limit of the correction is known here a second time.
fn rejected_for(model: &MachineModel, state: &State) -> Vec<(Reason, f64)> {
    let identified = &model.parts().identified;
    let is_rejected = |state: &State| correct(model, state).status == Status::Rejected;
    let with = |kept: Option<&Reason>| {
        let within = |values: [f64; 3], bounds: &[(f64, f64); 3], own: fn(usize) -> Reason| {
            let axis = |d: usize| match kept == Some(&own(d)) {
                true => values[d],
                // Not clamp, which ends the program where a damaged model has its bounds the wrong way round.
                false => values[d].max(bounds[d].0).min(bounds[d].1),
            };
            [axis(0), axis(1), axis(2)]
        };
        let but = match kept {
            Some(Reason::OutsideCovariate(name)) => Some(name.as_str()),
            _ => None,
        };
        let covariates = Ranged { state, model, but };
        let reading_m = within(state.reading_m, &identified.reading_m, Reason::Reading);
        let offset_m = within(state.offset_m, &identified.offset_m, Reason::Offset);
        is_rejected(&State { reading_m, offset_m, covariates: &covariates })
    };
    let outside = reasons(model, &[], state, Status::Extrapolated).into_iter();
    let outside: Vec<(Reason, f64)> = outside.filter(|(reason, _)| !matches!(reason, Reason::Parted(..))).collect();
    if !is_rejected(state) || with(None) || outside.is_empty() {
        return vec![(Reason::Implausible, 0.0)];
    }
    let alone: Vec<(Reason, f64)> = outside.iter().filter(|(reason, _)| with(Some(reason))).cloned().collect();
    if alone.is_empty() { outside } else { alone }
}
