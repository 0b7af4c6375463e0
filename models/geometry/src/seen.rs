//! What a campaign saw of logged quantities, beyond the ranges of what its effects read.
//!
//! Place in the flow: [`crate::model`] makes these limits, [`crate::correct`] holds samples to them.
//!
//! **No effect reads it**: what such a quantity does was too little to be seen over its range. Half of its range beyond, a straight law
//! does twice what it did at the end, counted from the middle. So what was as large as a standard uncertainty (k = 1) there is as large as
//! U (k = 2) here. A square law does four times as much here, and nine times where it is as far again. Some change is usual anywhere
//! (`least_beyond`). A quantity of another kind (an air pressure, a number of a probe) is not judged.
//!
//! **What nobody explained** may be a law of any quantity that changed, and a law grows: beyond the range at least straight on from
//! the middle of it (`growth`).
//!
//! **Temperatures that went together**: which of two sensors an effect follows shows only where they part. Beyond the differences of
//! the campaign, what the effect does by that part of the difference counts in full as uncertainty.

use crate::effects::State;
use crate::usual::Usual;
use std::collections::BTreeMap;

/// Temperatures (°C) end so.
pub const TEMPERATURE: &str = "_c";
/// Pressures of the air (hPa) end so.
const AIR_PRESSURE: &str = "_hpa";
/// How far a temperature may lie from all that was seen (K) before it is taken for a broken sensor, or for another unit.
const IMPLAUSIBLE_K: f64 = 50.0;
/// What a quantity may change beyond its range whatever that is, by the end or the beginning of its name: what a machine that was
/// identified at rest in a good room meets there on another day. By 0.5 K a steel scale of a metre grows by nearly 6 µm.
const USUAL_CHANGE: [(&str, f64); 5] =
    [(TEMPERATURE, 0.2), ("_pct", 10.0), ("_kg", 1.0), ("_mm_s", 20.0), ("dir_", 0.0)];

/// Share of its range by which a quantity may lie beyond it: 1 + 2·0.5 is 2, what a straight law has grown by there.
const BEYOND: f64 = 0.5;

/// How far beyond this range a quantity that no effect reads is still as in the campaign, in the unit of its name; `None` where its kind
/// is not judged.
pub(crate) fn as_seen_beyond(name: &str, (low, high): (f64, f64)) -> Option<f64> {
    Some((BEYOND * (high - low)).max(least_beyond(name)?))
}

/// How often as large as in the campaign what nobody explained may be (standard deviation), did it go straight with a quantity counted from
/// the middle of its range. From one width beyond on nothing more is known. What stood still then says nothing.
pub(crate) fn growth(name: &str, (low, high): (f64, f64), value: f64) -> f64 {
    let (width, beyond) = (high - low, (low - value).max(value - high));
    let changed = least_beyond(name).is_some_and(|usual| width > usual);
    match changed && beyond > 0.0 {
        true => 1.0 + 2.0 * (beyond / width).min(1.0),
        false => 1.0,
    }
}

/// Whether a quantity changed more over its range than one of its kind does anywhere. Of a kind that is not known any change counts, but
/// for that of the weather.
pub fn is_changed(name: &str, (low, high): (f64, f64)) -> bool {
    match least_beyond(name) {
        Some(usual) => usual > 0.0 && high - low > usual,
        None => high > low && !name.ends_with(AIR_PRESSURE),
    }
}

/// How far beyond its range a quantity that no effect reads is still as in the campaign, at least, in the unit of its name; `None` where
/// its kind is not judged.
fn least_beyond(name: &str) -> Option<f64> {
    let known = USUAL_CHANGE.iter().find(|(part, _)| name.ends_with(part) || name.starts_with(part));
    known.map(|(_, change)| *change)
}

/// Whether a value that lies so far beyond its range is none of that quantity.
pub(crate) fn is_implausible(name: &str, beyond: f64) -> bool {
    name.ends_with(TEMPERATURE) && beyond > IMPLAUSIBLE_K
}

/// How far a temperature that an effect reads stood from another one (K). Sensors that went together in the campaign cannot be told
/// apart by it: which of them an effect follows shows only where they part.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// Of the covariate that is read.
    pub name: String,
    /// Less that of this one.
    pub less: String,
    /// Smallest and largest (K).
    pub range: (f64, f64),
}

/// A temperature that an effect reads, and another that it stood within so much of.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Apart {
    pub(crate) own: Usual,
    other: String,
    range_k: (f64, f64),
}

impl Apart {
    pub(crate) fn new(difference: &Difference, seen: &BTreeMap<String, (f64, f64)>) -> Apart {
        let own = Usual { name: difference.name.clone(), range: seen.get(&difference.name).copied() };
        Apart { own, other: difference.less.clone(), range_k: difference.range }
    }

    /// What is read, and what it stood to.
    pub(crate) fn names(&self) -> (&str, &str) {
        (&self.own.name, &self.other)
    }

    /// The temperature (°C) that would be no further from the other than in the campaign, where it is further, and whether that is
    /// more than chance: beyond by more than the range of differences is wide, and by a usual change.
    pub(crate) fn beyond(&self, state: &State) -> Option<(f64, bool)> {
        let (own_c, other_c) = (state.covariate(&self.own.name).ok()?, state.covariate(&self.other).ok()?);
        let (low_k, high_k) = self.range_k;
        let difference_k = own_c - other_c;
        let beyond_k = difference_k - difference_k.max(low_k).min(high_k);
        let least_k = (high_k - low_k).max(least_beyond(&self.own.name).unwrap_or(0.0));
        (beyond_k != 0.0).then_some((own_c - beyond_k, beyond_k.abs() > least_k))
    }
}
