//! What a campaign offers: covariates that vary, offsets, time.
//!
//! Place in the flow: made once for a campaign; effects propose shapes from it, the look without candidates takes its
//! variables from it. Covariates in the unit of their name; positions and offsets in m.

use crate::columns::{range, varies};
use crate::lagged_columns::is_proposed;
use abbe_geometry::effects::{Effect, Observed, Shape, ShapeValue, is_derived, of_lagged};
use abbe_geometry::machine::Machine;
use abbe_identify::{EffectTerm, TIME};
use abbe_measurement::campaign::{Campaign, Covariate};

/// Offsets closer than this are one (m).
const SAME_OFFSET_M: f64 = 1e-6;

/// What a campaign offers to effects.
#[derive(Debug, Clone)]
pub(crate) struct Context {
    pub(crate) varying: Vec<String>,
    /// What varies, but was not logged at every reading: nothing is tried by it.
    pub(crate) with_gaps: Vec<Gaps>,
    pub(crate) stations: Vec<String>,
    pub(crate) offsets_m: Vec<[f64; 3]>,
    pub(crate) time_s: (f64, f64),
}

/// A quantity that is missing at some readings.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Gaps {
    pub(crate) name: String,
    /// Readings that have it.
    pub(crate) logged: usize,
    pub(crate) readings: usize,
}

impl Gaps {
    fn of(column: &Covariate) -> Option<Gaps> {
        let present: Vec<Option<f64>> = column.values.iter().copied().filter(Option::is_some).collect();
        let (logged, readings) = (present.len(), column.values.len());
        (logged < readings && varies(&present)).then(|| Gaps { name: column.name.clone(), logged, readings })
    }
}

impl Context {
    pub(crate) fn new(campaign: &Campaign) -> Context {
        let time_s = range(campaign.readings.iter().map(|r| r.time_s));
        let mut varying = if time_s.1 > time_s.0 { vec![TIME.to_owned()] } else { Vec::new() };
        let usable = campaign.covariates.iter().filter(|c| varies(&c.values) && is_proposed(campaign, c));
        varying.extend(usable.map(|column| column.name.clone()));
        let mut offsets_m: Vec<[f64; 3]> = Vec::new();
        for reading in &campaign.readings {
            if !offsets_m.iter().any(|known| same_offset(known, &reading.offset_m)) {
                offsets_m.push(reading.offset_m);
            }
        }
        let logged = campaign.covariates.iter().filter(|column| !is_derived(&column.name));
        let with_gaps = logged.filter_map(Gaps::of).collect();
        Context { varying, with_gaps, stations: campaign.stations.clone(), offsets_m, time_s }
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

/// Whether a term is a course in time. What happens once is none.
pub(crate) fn takes_its_time(term: &EffectTerm) -> bool {
    follows_time(term.effect.as_ref(), &term.shape) && !term.effect.happens_once()
}

/// Whether a quantity comes from a logger of the room: sides of approach, loads and feeds are the machine's own.
pub(crate) fn is_of_the_room(name: &str) -> bool {
    !is_derived(name) && ["temp_", "pressure_", "humidity_"].iter().any(|prefix| name.starts_with(prefix))
}

/// Whether stations were measured one after the other: no two at the same time.
pub(crate) fn in_turn(campaign: &Campaign) -> bool {
    let span = |station: usize| {
        let own = campaign.readings.iter().filter(|reading| reading.station as usize == station);
        range(own.map(|reading| reading.time_s))
    };
    let mut spans: Vec<(f64, f64)> = (0..campaign.stations.len()).map(span).collect();
    spans.sort_by(|a, b| a.0.total_cmp(&b.0));
    spans.windows(2).all(|pair| pair[1].0 >= pair[0].1)
}

/// Whether two offsets (m) are the same.
pub(crate) fn same_offset(a: &[f64; 3], b: &[f64; 3]) -> bool {
    (0..3).all(|d| (a[d] - b[d]).abs() < SAME_OFFSET_M)
}

/// Whether an effect reads what comes from a log of its own, as it is or behind a time constant.
pub(crate) fn follows_a_log(term: &EffectTerm) -> bool {
    read_by(term.effect.as_ref(), &term.shape).iter().any(|name| of_lagged(name).is_some() || is_of_the_room(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_varies_but_was_not_always_logged_has_gaps() {
        let column = |name: &str, values: &[Option<f64>]| Covariate { name: name.to_owned(), values: values.to_vec() };
        let covariates = vec![
            column("temp_ram_c", &[Some(20.0), None, Some(20.4)]),
            column("temp_bed_c", &[Some(20.0), Some(20.1), Some(20.4)]),
            column("load_kg", &[Some(2.0), None, Some(2.0)]),
            column("feed_m_s", &[None, None, None]),
        ];
        let context = Context::new(&Campaign { covariates, ..Campaign::default() });
        assert_eq!(context.with_gaps, [Gaps { name: "temp_ram_c".to_owned(), logged: 2, readings: 3 }]);
        assert_eq!(context.varying, ["temp_bed_c"]);
    }
}
