//! Lagged temperatures: a structure follows what is logged with a time constant that nobody knows.
//!
//! Place in the flow: effects propose some steps of the ladder ([`crate::lagged_columns`]); what comes of that is moved along it to the step
//! that explains most ([`refined`]), as periods are. So it is with the travel over which the side of an axis follows. Then each temperature
//! of its own is tried behind and ahead of what was logged ([`apart`]): a sensor in a housing, or glued on, follows late itself.

use crate::candidates::{Candidate, Round, score_all};
use crate::error::DiagnoseError;
use crate::lagged_columns::{COARSE, STEPS, further, is_temperature, lag_s};
use crate::score::Score;
use abbe_geometry::effects::{Shape, ShapeValue, is_derived, lagged_name, logged_side, of_lagged, of_travelled};
use abbe_geometry::machine::Machine;
use abbe_identify::EffectTerm;
use abbe_measurement::campaign::Campaign;

/// Steps from one time constant of a sensor that is tried to the next (a factor of 1.6); the best one's neighbours are tried as well.
const APART: usize = 2;
/// Effects at their places that are tried by late sensors before one is chosen: those that explain most by sensors as they are.
const MOST_LATE: usize = 6;
/// Share of what a lagged temperature explains from which a logged one is taken instead.
const NEARLY: f64 = 0.9;

/// Whether an effect reads a quantity that lags behind a logged one.
pub(crate) fn is_lagged(candidate: &Candidate) -> bool {
    candidate.term.effect.reads().iter().any(|name| of_lagged(name).is_some())
}

/// The candidate, or the same effect by what is logged where that explains nearly as much: what lags is missing at first.
pub(crate) fn logged_instead<'c>(best: &'c Candidate, open: impl Iterator<Item = &'c Candidate>) -> &'c Candidate {
    if !is_lagged(best) {
        return best;
    }
    let alike = |c: &&Candidate| c.known.name == best.known.name && place(c) == place(best) && !is_lagged(c);
    let logged = open.filter(alike).max_by(|a, b| a.score.reduction.total_cmp(&b.score.reduction));
    logged.filter(|logged| logged.score.reduction > NEARLY * best.score.reduction).unwrap_or(best)
}

/// What its shape says beside the quantities that it reads: where an effect acts.
fn place(candidate: &Candidate) -> Vec<(&String, &ShapeValue)> {
    place_of(&candidate.term)
}

pub(crate) fn place_of(term: &EffectTerm) -> Vec<(&String, &ShapeValue)> {
    let reads = term.effect.reads();
    let is_read = |value: &ShapeValue| matches!(value, ShapeValue::Text(name) if reads.contains(name));
    term.shape.0.iter().filter(|(_, value)| !is_read(value)).collect()
}

/// The candidate, or, where it follows the side of an axis over a travel, what follows the logged side of that axis, if the travel makes
/// the data no likelier by what a choice asks for: most axes turn at once.
pub(crate) fn logged_side_instead<'c>(
    best: &'c Candidate,
    open: impl Iterator<Item = &'c Candidate>,
    (rows, least_evidence): (usize, f64),
) -> &'c Candidate {
    let side = |c: &Candidate| c.term.effect.reads().iter().find_map(|name| of_travelled(name)).map(|(axis, _)| axis);
    let Some(axis) = side(best) else { return best };
    let logged = logged_side(axis);
    let alike = open.filter(|c| c.term.effect.reads() == [logged]);
    let logged = alike.max_by(|a, b| a.evidence(rows).total_cmp(&b.evidence(rows)));
    logged.filter(|logged| logged.evidence(rows) + least_evidence > best.evidence(rows)).unwrap_or(best)
}

/// Moves the derived quantities of a candidate along the ladder, all alike, to where they explain most.
pub(crate) fn refined(
    round: &Round,
    (machine, campaign): (&Machine, &Campaign),
    candidate: Candidate,
) -> Result<Candidate, DiagnoseError> {
    let start = candidate.term.shape.clone();
    let moved = |steps: isize| -> Result<Option<Candidate>, DiagnoseError> {
        let Some(shape) = shifted(&start, steps, campaign) else { return Ok(None) };
        let term = EffectTerm::new(candidate.known.name, shape, machine)?;
        Ok(score_all(round, vec![(candidate.known, term, candidate.trials)])?.pop())
    };
    let mut best = candidate.clone();
    for direction in [1, -1] {
        for steps in 1..COARSE as isize {
            match moved(direction * steps)? {
                Some(other) if other.score.reduction > best.score.reduction => best = other,
                _ => break,
            }
        }
    }
    Ok(best)
}

/// The candidate with its logged temperatures behind or ahead of what was logged, the one first that gains most, while that is worth its
/// price: a figure more, chosen among all that were tried, and what any choice asks for.
pub(crate) fn apart(
    round: &Round,
    (machine, campaign): (&Machine, &Campaign),
    candidate: Candidate,
    least_evidence: f64,
) -> Result<Candidate, DiagnoseError> {
    let mut best = candidate;
    loop {
        let (mut next, mut tried) = (None::<Candidate>, 0);
        for key in temperatures(&best.term.shape) {
            let shapes = others(&best.term.shape, &key, campaign);
            tried += shapes.len();
            let moved = best_of(round, machine, &best, &shapes)?;
            next = [next, moved].into_iter().flatten().max_by(|a, b| a.score.gain.total_cmp(&b.score.gain));
        }
        let price = (round.used.max(2) as f64).ln() + 2.0 * (tried.max(1) as f64).ln() + least_evidence;
        match next {
            Some(next) if next.score.gain - best.score.gain > price => best = next,
            _ => return Ok(best),
        }
    }
}

/// The candidates, and beside them what the best of each effect at its place does by sensors that follow late: one that does not stand out as it was
/// logged would never be tried so. What is late pays for its time constant.
pub(crate) fn with_late(
    round: &Round,
    found_in: (&Machine, &Campaign),
    mut named: Vec<Candidate>,
    least_evidence: f64,
) -> Result<Vec<Candidate>, DiagnoseError> {
    let evidence = |c: &Candidate| c.evidence(round.used);
    let mut best: Vec<&Candidate> = Vec::new();
    for candidate in named.iter().filter(|c| !is_lagged(c) && !temperatures(&c.term.shape).is_empty()) {
        match best.iter_mut().find(|own| own.known.name == candidate.known.name && place(own) == place(candidate)) {
            Some(own) if evidence(candidate) > evidence(own) => *own = candidate,
            Some(_) => {}
            None => best.push(candidate),
        }
    }
    best.retain(|own| evidence(own) > least_evidence);
    best.sort_by(|a, b| evidence(b).total_cmp(&evidence(a)));
    let mut late = Vec::new();
    for own in best.into_iter().take(MOST_LATE) {
        let tried = apart(round, found_in, own.clone(), least_evidence)?;
        if is_lagged(&tried) {
            let price = (round.used.max(2) as f64).ln() + 2.0 * (STEPS as f64).ln();
            late.push(Candidate { score: Score { gain: tried.score.gain - price, ..tried.score.clone() }, ..tried });
        }
    }
    named.extend(late);
    Ok(named)
}

/// The candidate in that of these neighbouring shapes which gains most; only every other one is tried where it is far from the best.
fn best_of(
    round: &Round,
    machine: &Machine,
    candidate: &Candidate,
    shapes: &[Shape],
) -> Result<Option<Candidate>, DiagnoseError> {
    let of = |shapes: Vec<&Shape>| -> Result<Option<Candidate>, DiagnoseError> {
        let term = |shape: &Shape| EffectTerm::new(candidate.known.name, shape.clone(), machine);
        let terms = shapes.into_iter().map(|shape| Ok((candidate.known, term(shape)?, candidate.trials)));
        let scored = score_all(round, terms.collect::<Result<Vec<_>, DiagnoseError>>()?)?;
        Ok(scored.into_iter().max_by(|a, b| a.score.gain.total_cmp(&b.score.gain)))
    };
    let Some(rough) = of(shapes.iter().step_by(APART).collect())? else { return Ok(None) };
    let place = shapes.iter().position(|shape| *shape == rough.term.shape).unwrap_or(0);
    of(shapes[place.saturating_sub(APART - 1)..shapes.len().min(place + APART)].iter().collect())
}

/// Keys of a shape under which a logged temperature stands.
fn temperatures(shape: &Shape) -> Vec<String> {
    let is_logged = |value: &ShapeValue| matches!(value, ShapeValue::Text(name) if is_temperature(name));
    shape.0.iter().filter(|(_, value)| is_logged(value)).map(|(key, _)| key.clone()).collect()
}

/// The shape with the temperature of one key at all time constants of the campaign, from furthest ahead to furthest behind.
fn others(shape: &Shape, key: &str, campaign: &Campaign) -> Vec<Shape> {
    let Some(ShapeValue::Text(logged)) = shape.0.get(key) else { return Vec::new() };
    let lags_s = (0..STEPS).rev().map(|step| -lag_s(step)).chain((0..STEPS).map(lag_s));
    let names = lags_s.filter_map(|lag_s| lagged_name(logged, lag_s));
    names.filter(|name| campaign.covariate(name).is_some()).map(|name| shape.clone().text(key, name)).collect()
}

/// The shape with its derived quantities some steps further; `None` where there is none, or the ladder ends.
fn shifted(shape: &Shape, steps: isize, campaign: &Campaign) -> Option<Shape> {
    let mut shifted = shape.clone();
    let mut is_lagged = false;
    for (key, value) in &shape.0 {
        let ShapeValue::Text(name) = value else { continue };
        if !is_derived(name) {
            continue;
        }
        let name = further(name, steps)?;
        campaign.covariate(&name)?;
        is_lagged = true;
        shifted = shifted.text(key, name);
    }
    is_lagged.then_some(shifted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_measurement::campaign::Covariate;

    #[test]
    fn a_shape_moves_with_all_its_lagged_quantities() {
        let column = |name: String, high: f64| Covariate { name, values: vec![Some(1.0), Some(high)] };
        let campaign = Campaign {
            covariates: vec![
                column(lagged_name("temp_a_c", lag_s(4)).unwrap(), 3.0),
                column(lagged_name("temp_b_c", lag_s(4)).unwrap(), 4.0),
            ],
            ..Campaign::default()
        };
        let name = |of: &str, step: usize| lagged_name(of, lag_s(step)).unwrap();
        let shape = Shape::new().text("warm", name("temp_a_c", 3)).text("cold", name("temp_b_c", 3)).text("axis", "x");
        let moved = shifted(&shape, 1, &campaign).unwrap();
        let expected = Shape::new().text("warm", name("temp_a_c", 4)).text("cold", name("temp_b_c", 4));
        assert_eq!(moved, expected.text("axis", "x"));
        assert_eq!(shifted(&shape, 2, &campaign), None, "the campaign has no such column");
        assert_eq!(shifted(&shape, -4, &campaign), None, "the ladder begins at 40 s");
        assert_eq!(shifted(&Shape::new().text("axis", "x"), 1, &campaign), None);
    }
}
