//! What a campaign offers: covariates that vary, offsets, time.
//!
//! Place in the flow: made once for a campaign; effects propose shapes from it, the look without candidates takes its
//! variables from it. Covariates in the unit of their name; positions and offsets in m.

use crate::lags;
use abbe_geometry::effects::{Effect, Observed, Shape, ShapeValue};
use abbe_geometry::machine::Machine;
use abbe_identify::TIME;
use abbe_measurement::campaign::Campaign;

/// Offsets closer than this are one (m).
const SAME_OFFSET_M: f64 = 1e-6;
/// Spread, as a share of the largest magnitude, from which a covariate counts as varying.
const VARYING: f64 = 1e-9;

/// What a campaign offers to effects.
#[derive(Debug, Clone)]
pub(crate) struct Context {
    pub(crate) varying: Vec<String>,
    pub(crate) stations: Vec<String>,
    pub(crate) offsets_m: Vec<[f64; 3]>,
    pub(crate) time_s: (f64, f64),
}

impl Context {
    pub(crate) fn new(campaign: &Campaign) -> Context {
        let time_s = range(campaign.readings.iter().map(|r| r.time_s));
        let mut varying = if time_s.1 > time_s.0 { vec![TIME.to_owned()] } else { Vec::new() };
        let usable = campaign.covariates.iter().filter(|c| varies(&c.values) && lags::is_proposed(campaign, c));
        varying.extend(usable.map(|column| column.name.clone()));
        let mut offsets_m: Vec<[f64; 3]> = Vec::new();
        for reading in &campaign.readings {
            if !offsets_m.iter().any(|known| same_offset(known, &reading.offset_m)) {
                offsets_m.push(reading.offset_m);
            }
        }
        Context { varying, stations: campaign.stations.clone(), offsets_m, time_s }
    }

    pub(crate) fn observed<'a>(&'a self, machine: &'a Machine) -> Observed<'a> {
        Observed {
            machine,
            varying: &self.varying,
            stations: &self.stations,
            offsets_m: &self.offsets_m,
            time_s: self.time_s,
        }
    }
}

/// Quantities that an effect of that shape reads: its covariates, and those that an empirical term names in its shape.
pub(crate) fn read_by(effect: &dyn Effect, shape: &Shape) -> Vec<String> {
    let mut names = effect.reads();
    for key in ["p", "q"] {
        if let Some(ShapeValue::Text(name)) = shape.0.get(key)
            && !names.contains(name)
        {
            names.push(name.clone());
        }
    }
    names.dedup();
    names
}

/// Whether an effect of that shape reads the time.
pub(crate) fn follows_time(effect: &dyn Effect, shape: &Shape) -> bool {
    read_by(effect, shape).iter().any(|name| name == TIME)
}

/// Least and greatest of some values.
pub(crate) fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
}

/// Whether two offsets (m) are the same.
pub(crate) fn same_offset(a: &[f64; 3], b: &[f64; 3]) -> bool {
    (0..3).all(|d| (a[d] - b[d]).abs() < SAME_OFFSET_M)
}

/// Whether a column has a number everywhere, and more than one.
pub(crate) fn varies(values: &[Option<f64>]) -> bool {
    let is_whole = values.iter().all(|value| value.is_some_and(f64::is_finite));
    let (low, high) = range(values.iter().flatten().copied());
    is_whole && high - low > VARYING * low.abs().max(high.abs())
}
