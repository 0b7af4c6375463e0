//! Lagged temperatures: a structure follows what is logged with a time constant that nobody knows.
//!
//! Place in the flow: a diagnosis begins with the campaign and what its temperatures and humidity would be behind a ladder of time constants
//! ([`with_lags`]). Effects propose every fifth of its steps; what comes of that is moved along the ladder to the step that explains
//! most ([`refined`]), as periods are. So it is with the travel over which the side of an axis follows. Then each temperature of its own is
//! tried behind and ahead of what was logged ([`apart`]): a sensor in a housing, or glued on, follows late itself. Times in s, travels in µm.

use crate::candidates::{Candidate, Round, score_all};
use crate::context::{range, varies};
use crate::error::DiagnoseError;
use crate::look::correlation;
use crate::score::Score;
use abbe_geometry::Axis;
use abbe_geometry::effects::{
    Shape, ShapeValue, is_derived, lagged_name, logged_side, of_lagged, of_travelled, travelled_name,
};
use abbe_geometry::machine::Machine;
use abbe_identify::{EffectTerm, with_lagged};
use abbe_measurement::campaign::{Campaign, Covariate};

/// Shortest time constant (s): less than anything but a wire takes, and as little as the clock of a log is often off by.
const SHORTEST_S: f64 = 40.0;
/// Ratio of neighbouring steps: neighbours differ by some percent of what they do.
const RATIO: f64 = 1.25;
/// Steps of the ladder: up to some years, whatever the times of a campaign say.
const STEPS: usize = 64;
/// Steps from one proposed time constant to the next (a factor of three), and the first.
const COARSE: usize = 5;
const FIRST: usize = 3;
/// Longest time constant, as a share of the campaign's duration: half of the readings are then past what the beginning left.
const LONGEST: f64 = 1.0 / 6.0;
/// Longest time constant of a sensor (s): in still air, in a thick housing.
const LATEST_S: i32 = 3600;
/// Steps from one time constant of a sensor that is tried to the next (a factor of 1.6); the best one's neighbours are tried as well.
const APART: usize = 2;
/// Effects at their places that are tried by late sensors before one is chosen: those that explain most by sensors as they are.
const MOST_LATE: usize = 6;
/// Shortest travel (µm): less than that is a reversal.
const SHORTEST_UM: f64 = 250.0;
/// Ratio of neighbouring travels, and steps from one proposed to the next (a factor of five): what they do differs slowly.
const TRAVEL_RATIO: f64 = 1.5;
const COARSE_TRAVEL: usize = 4;
/// Longest travel, as a share of what an axis was moved: a longer one is a position.
const LONGEST_TRAVEL: f64 = 0.25;
/// Share of what a lagged temperature explains from which a logged one is taken instead.
const NEARLY: f64 = 0.9;
/// Correlation from which a lagged temperature is the logged one to the data.
const SAME: f64 = 0.999;

/// The campaign with its temperatures behind all time constants of the ladder, and behind those that `asked` names.
pub(crate) fn with_lags(campaign: &Campaign, asked: impl IntoIterator<Item = String>) -> Campaign {
    let mut names: Vec<String> = asked.into_iter().filter(|name| of_lagged(name).is_some()).collect();
    let (first_s, last_s) = range(campaign.readings.iter().map(|reading| reading.time_s));
    let longest_s = LONGEST * (last_s - first_s);
    // Stone follows the humidity of its air; a sensor of humidity is not late by what matters.
    for (is_own, latest_s) in [(is_temperature as fn(&str) -> bool, LATEST_S), (is_humidity, 0)] {
        for logged in campaign.covariates.iter().filter(|column| is_own(&column.name) && varies(&column.values)) {
            let steps = (0..STEPS).map(lag_s).take_while(|lag_s| f64::from(*lag_s) <= longest_s);
            let late = steps.clone().take_while(|lag_s| *lag_s <= latest_s).map(|lag_s| -lag_s);
            names.extend(steps.chain(late).filter_map(|lag_s| lagged_name(&logged.name, lag_s)));
        }
    }
    for axis in Axis::ALL {
        let (low_m, high_m) = range(campaign.readings.iter().map(|reading| reading.reading_m[axis.index()]));
        let longest_um = LONGEST_TRAVEL * (high_m - low_m) * 1e6;
        let steps = (0..STEPS).map(travel_um).take_while(|travel_um| f64::from(*travel_um) <= longest_um);
        names.extend(steps.map(|travel_um| travelled_name(axis, travel_um)));
    }
    with_lagged(campaign.clone(), &names)
}

/// Travel of a step of its ladder (µm).
fn travel_um(step: usize) -> u32 {
    (SHORTEST_UM * TRAVEL_RATIO.powi(step as i32)).round() as u32
}

/// The name some steps further along the ladder that it stands on.
fn further(name: &str, steps: isize) -> Option<String> {
    let place = |step: Option<usize>| step?.checked_add_signed(steps);
    if let Some((logged, lag)) = of_lagged(name) {
        return lagged_name(&logged, lag.signum() * lag_s(place(step_of(lag))?));
    }
    let (axis, travel) = of_travelled(name)?;
    Some(travelled_name(axis, travel_um(place((0..STEPS).find(|step| travel_um(*step) == travel))?)))
}

fn is_temperature(name: &str) -> bool {
    name.starts_with("temp_") && name.ends_with("_c") && of_lagged(name).is_none()
}

fn is_humidity(name: &str) -> bool {
    name.starts_with("humidity_") && name.ends_with("pct") && of_lagged(name).is_none()
}

/// Time constant of a step of the ladder (s).
fn lag_s(step: usize) -> i32 {
    (SHORTEST_S * RATIO.powi(step as i32)).round() as i32
}

/// The step of the ladder with that time constant, behind or ahead.
fn step_of(lag: i32) -> Option<usize> {
    (0..STEPS).find(|step| lag_s(*step) == lag.abs())
}

/// Whether a column is proposed to effects: what is logged is, of the lagged ones some, where they differ from the logged one and no pause
/// is longer than they lag: each stands for a sensor that is not there, and must be known as well as one.
pub(crate) fn is_proposed(campaign: &Campaign, column: &Covariate) -> bool {
    let values = |column: &Covariate| column.values.iter().map(|value| value.unwrap_or(0.0)).collect::<Vec<f64>>();
    let differs = |logged: &Covariate| correlation(&values(logged), &values(column)).abs() < SAME;
    if let Some((axis, travel)) = of_travelled(&column.name) {
        // Where every way after a reversal was long, the side over a travel is the logged side.
        return (0..STEPS).step_by(COARSE_TRAVEL).any(|step| travel_um(step) == travel)
            && campaign.covariate(logged_side(axis)).is_none_or(differs);
    }
    let Some((logged, lag)) = of_lagged(&column.name) else { return true };
    let is_coarse = lag > 0 && step_of(lag).is_some_and(|step| step % COARSE == FIRST);
    is_coarse && longest_pause_s(campaign) <= f64::from(lag) && campaign.covariate(&logged).is_some_and(differs)
}

fn longest_pause_s(campaign: &Campaign) -> f64 {
    campaign.readings.windows(2).map(|pair| pair[1].time_s - pair[0].time_s).fold(0.0, f64::max)
}

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

/// What a derived covariate is made from; any other, itself.
pub(crate) fn logged_of(name: &str) -> String {
    match (of_lagged(name), of_travelled(name)) {
        (Some((logged, _)), _) => logged,
        (_, Some((axis, _))) => logged_side(axis).to_owned(),
        (None, None) => name.to_owned(),
    }
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
    use abbe_measurement::campaign::RangeReading;

    fn reading(time_s: f64) -> RangeReading {
        RangeReading { station: 0, line: 0, time_s, reading_m: [0.0; 3], offset_m: [0.0; 3], length_m: 0.0 }
    }

    #[test]
    fn the_ladder_reads_back_and_its_steps_are_a_quarter_apart() {
        for step in 0..30 {
            assert_eq!(step_of(lag_s(step)), Some(step));
        }
        let steps = (0..20).map(|step| f64::from(lag_s(step + 1)) / f64::from(lag_s(step)));
        assert!(steps.into_iter().all(|ratio| (ratio - RATIO).abs() < 0.02));
        assert_eq!(step_of(1), None);
    }

    /// Granite takes hours to get damp; a sensor of humidity is not late by what matters.
    #[test]
    fn humidity_is_known_behind_the_ladder_and_not_ahead() {
        let values = (0..400).map(|k| Some(45.0 + f64::from(k % 7))).collect();
        let campaign = Campaign {
            readings: (0..400).map(|k| reading(60.0 * f64::from(k))).collect(),
            covariates: vec![Covariate { name: "humidity_pct".to_owned(), values }],
            ..Campaign::default()
        };
        let known = with_lags(&campaign, []);
        let lags_s: Vec<i32> = known.covariates.iter().filter_map(|c| of_lagged(&c.name)).map(|(_, lag)| lag).collect();
        assert!(lags_s.len() > 10 && lags_s.iter().all(|lag_s| *lag_s > 0), "{lags_s:?}");
        assert!(lags_s.iter().all(|lag_s| f64::from(*lag_s) <= LONGEST * 60.0 * 399.0), "{lags_s:?}");
    }

    /// Times from 1970 beside times since the campaign began: the search for time constants has to end.
    #[test]
    fn regress_times_that_are_decades_apart_end_the_ladder() {
        let campaign = Campaign {
            readings: vec![reading(0.0), reading(1.7e9)],
            covariates: vec![Covariate { name: "temp_air_c".to_owned(), values: vec![Some(20.0), Some(21.0)] }],
            ..Campaign::default()
        };
        assert_eq!(with_lags(&campaign, []), campaign, "a pause of decades hides how the temperature went");
    }

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
