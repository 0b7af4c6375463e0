//! Do the logged quantities carry the time of the readings?
//!
//! Place in the flow: near the end of [`crate::diagnose()`], where what was found reads what was logged. A logger whose clock is off, or
//! that stamps late, gives each reading the temperatures of another instant. A lagged sensor or two sensors together then stand in for the
//! right one, and part from it on another day. So all that was logged is moved by up to an eighth of the campaign, together, to either
//! side, and the strongest effect is tried again by every sensor. Logs are averaged over some readings for it, moved or not, since one
//! between two entries has less noise than an entry. Times in s.

use crate::candidates::{Candidate, Round, columns_of, proposals, score_all};
use crate::columns::range;
use crate::context::{Context, follows_a_log, is_of_the_room, takes_its_time};
use crate::error::DiagnoseError;
use crate::lagged_columns::{with_lags, with_proposed_lags};
use crate::lags::{apart, is_lagged, place_of};
use crate::logs::between;
use crate::options::Progress;
use crate::same_claim::has;
use crate::score::score_of;
use crate::search::{Search, State};
use crate::step::Step;
use abbe_geometry::effects::is_derived;
use abbe_geometry::machine::Machine;
use abbe_identify::EffectTerm;
use abbe_measurement::campaign::{Campaign, Covariate};
use abbe_measurement::robust::median;

/// Largest shift, as a share of the campaign's duration.
const LARGEST: f64 = 0.125;
/// Shifts to either side, each larger than the one before by the same factor.
const SHIFTS: usize = 8;
const RATIO: f64 = 1.4;
/// Sensors that are tried behind and ahead of what they logged: those by which the effect explains most.
const MOST_LATE: usize = 4;
/// Share of what a late sensor explains, beside the sensors as they are, that a log of later instants must explain beyond it: what is ahead of a sensor carries
/// its noise, and a shift does not. What is behind one does not either, so that nothing more is asked of a log of earlier instants.
const BEYOND_LATE: f64 = 0.5;
/// Readings to either side over which a log is averaged.
const WINDOW: i32 = 3;

/// A log that goes by another clock than the readings.
#[derive(Debug, Clone, PartialEq)]
pub struct ClockShift {
    /// What acts at a time t explains the readings best as it was logged at t + this (s).
    pub shift_s: f64,
    /// Title of the effect that shows it.
    pub title: &'static str,
    /// Evidence beyond the best that the log explains as it is.
    pub evidence: f64,
}

impl ClockShift {
    /// What it is and what to do, for readers.
    pub fn words(&self) -> String {
        // A sensor shows late what acts at once.
        let (later, ahead, slow) = match self.shift_s > 0.0 {
            true => ("later", "ahead of", ", or its sensors are that slow"),
            false => ("earlier", "behind", ""),
        };
        format!(
            "{} is explained far better by what was logged some {:.0} s {later} (evidence {:.0}): the clock of the log is that much {ahead} \
             the clock of the readings{slow}, or heat takes another way than past these sensors. What follows the log is not adopted. \
             Set the clocks, or move the log, and diagnose again.",
            capitalised(self.title),
            self.shift_s.abs(),
            self.evidence
        )
    }
}

fn capitalised(title: &str) -> String {
    let mut letters = title.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// Takes what follows a log out of what was found, where that log goes by another clock, and what follows the time: it was found beside the
/// former, for what that left.
pub(crate) fn hold<'a>(
    search: &Search<'a>,
    state: &mut State<'a>,
    base: &[EffectTerm],
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Option<ClockShift>, DiagnoseError> {
    // A jump left in the residuals would pass for them as well.
    let follows = |term: &EffectTerm| !has(base, term) && (follows_a_log(term) || takes_its_time(term));
    let (out, kept): (Vec<EffectTerm>, Vec<EffectTerm>) = state.terms.clone().into_iter().partition(follows);
    // What the model had before was made with a log of its own.
    if base.iter().any(follows_a_log) || !out.iter().any(follows_a_log) {
        return Ok(None);
    }
    // What follows neither a log nor the time stays: its residuals would pass for those of a log that is off.
    let Ok((fit, round)) = search.attempt_under(&state.machine, &kept, state.fit.correlation, observe)? else {
        return Ok(None);
    };
    let Some(shift) = found(search, state, &round, base, observe)? else { return Ok(None) };
    (state.fit, state.round, state.terms, state.named) = (fit, round, kept, None);
    state.distrusts_log = true;
    for term in out {
        let because = match follows_a_log(&term) {
            true => "the log that it follows goes by another clock than the readings",
            false => "it was found beside what follows a log by another clock",
        };
        state.steps.push(Step::set_aside(term, because.to_owned()));
    }
    Ok(Some(shift))
}

/// The shift with which one effect explains more than all that was found by the log as it is, beside stands that drift; `None` where that is
/// right, or cannot be told. The fit of `round` lacks all that follows a log or the time.
fn found(
    search: &Search,
    state: &State,
    round: &Round,
    base: &[EffectTerm],
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Option<ClockShift>, DiagnoseError> {
    let added = state.added(search.campaign.readings.len());
    // A stand that drifts counts with it: a log of another instant describes that, too.
    let drifts = |term: &EffectTerm| takes_its_time(term) && term.effect.moves_stand();
    let added: Vec<(&EffectTerm, f64)> =
        added.filter(|(term, _)| !has(base, term) && (follows_a_log(term) || drifts(term))).collect();
    let by_log = added.iter().filter(|(term, _)| follows_a_log(term));
    let Some((strongest, _)) = by_log.max_by(|a, b| a.1.total_cmp(&b.1)).copied() else { return Ok(None) };
    let Some(known) = abbe_geometry::effects::known(strongest.effect.name()) else { return Ok(None) };
    let look = Look { search, machine: &state.machine, round, strongest };
    let terms: Vec<&EffectTerm> = added.iter().map(|(term, _)| *term).collect();
    let mut as_it_is = together(round, &terms)?;
    let still = with_lags(&shifted(search.campaign, 0.0), terms.iter().flat_map(|term| term.effect.reads()));
    let of_still = round.logged_as(&still);
    let (by_sensor, or_late) = look.best_or_late(&of_still, &still)?;
    as_it_is = as_it_is.max(together(&of_still, &terms)?).max(or_late);
    let mut best = (0.0, f64::NEG_INFINITY);
    let shifts_s = shifts_s(search.campaign);
    for shift_s in &shifts_s {
        if !observe(Progress::Scoring { round: 1, effects: state.terms.len() }) {
            return Err(DiagnoseError::Stopped);
        }
        let evidence = look.best(&with_proposed_lags(&shifted(search.campaign, *shift_s)))?;
        if evidence > best.1 {
            best = (*shift_s, evidence);
        }
    }
    let evidence = best.1 - as_it_is - 2.0 * (shifts_s.len() as f64).ln();
    let beyond_late = if best.0 > 0.0 { BEYOND_LATE * (as_it_is - by_sensor) } else { 0.0 };
    let is_told = evidence > search.options.least_evidence.max(beyond_late);
    Ok(is_told.then_some(ClockShift { shift_s: best.0, title: known.title, evidence }))
}

/// The fit without what was found, and the strongest effect that follows a log.
struct Look<'l, 'a> {
    search: &'l Search<'a>,
    machine: &'l Machine,
    round: &'l Round<'a>,
    strongest: &'l EffectTerm,
}

impl Look<'_, '_> {
    /// Evidence of the strongest effect by whichever sensor of this campaign explains most.
    fn best(&self, campaign: &Campaign) -> Result<f64, DiagnoseError> {
        let round = self.round.logged_as(campaign);
        let scored = self.by_each_sensor(&round, campaign)?;
        Ok(scored.iter().map(|candidate| candidate.evidence(round.used)).fold(f64::NEG_INFINITY, f64::max))
    }

    /// The same by sensors as they are, and by what is ahead of one or behind it as well: one that follows late is no clock that is off.
    fn best_or_late(&self, round: &Round, campaign: &Campaign) -> Result<(f64, f64), DiagnoseError> {
        let mut by_sensor = self.by_each_sensor(round, campaign)?;
        by_sensor.sort_by(|a, b| b.evidence(round.used).total_cmp(&a.evidence(round.used)));
        let best = by_sensor.first().map_or(f64::NEG_INFINITY, |candidate| candidate.evidence(round.used));
        let of_sensors: Vec<Candidate> = by_sensor.into_iter().filter(|candidate| !is_lagged(candidate)).collect();
        let as_logged = of_sensors.first().map_or(best, |candidate| candidate.evidence(round.used));
        let mut or_late = best;
        for candidate in of_sensors.into_iter().take(MOST_LATE) {
            let moved = apart(round, (self.machine, campaign), candidate, self.search.options.least_evidence)?;
            or_late = or_late.max(moved.evidence(round.used));
        }
        Ok((as_logged, or_late))
    }

    /// The strongest effect by all sensors that it may read.
    fn by_each_sensor(&self, round: &Round, campaign: &Campaign) -> Result<Vec<Candidate>, DiagnoseError> {
        let terms = proposals(self.machine, &Context::new(campaign))?;
        let alike = terms.into_iter().filter(|(known, term, _)| {
            known.name == self.strongest.effect.name() && place_of(term) == place_of(self.strongest)
        });
        score_all(round, alike.collect())
    }
}

/// Evidence of all these together.
fn together(round: &Round, terms: &[&EffectTerm]) -> Result<f64, DiagnoseError> {
    let columns = columns_of(round, terms)?;
    Ok(score_of(&round.free, columns.as_ref()).evidence(round.used, 1))
}

/// Shifts that are tried (s), none of them zero.
fn shifts_s(campaign: &Campaign) -> Vec<f64> {
    let (first_s, last_s) = range(campaign.readings.iter().map(|reading| reading.time_s));
    let largest_s = LARGEST * (last_s - first_s);
    let sizes = (0..SHIFTS).map(|k| largest_s / RATIO.powi(k as i32)).filter(|size_s| *size_s > 0.0);
    sizes.flat_map(|size_s| [size_s, -size_s]).collect()
}

/// The campaign with what was logged at t + shift at the reading of t; beyond its ends a log stays as it was there.
fn shifted(campaign: &Campaign, shift_s: f64) -> Campaign {
    let steps: Vec<f64> = campaign.readings.windows(2).map(|p| (p[1].time_s - p[0].time_s).abs()).collect();
    let step_s = median(steps).unwrap_or(0.0);
    let moved = |column: &Covariate| -> Covariate {
        let mut log: Vec<(f64, f64)> =
            campaign.readings.iter().zip(&column.values).filter_map(|(r, v)| Some((r.time_s, (*v)?))).collect();
        log.sort_by(|a, b| a.0.total_cmp(&b.0));
        let values = campaign.readings.iter().zip(&column.values).map(|(reading, value)| {
            let around = (-WINDOW..=WINDOW).filter_map(|k| at(&log, reading.time_s + shift_s + f64::from(k) * step_s));
            let values: Vec<f64> = around.collect();
            value.map(|_| values.iter().sum::<f64>() / values.len().max(1) as f64)
        });
        Covariate { name: column.name.clone(), values: values.collect() }
    };
    let logged = campaign.covariates.iter().filter(|column| !is_derived(&column.name));
    let covariates =
        logged.map(|column| if is_of_the_room(&column.name) { moved(column) } else { column.clone() }).collect();
    Campaign { covariates, ..campaign.clone() }
}

/// A log at a time, straight from one entry to the next.
fn at(log: &[(f64, f64)], time_s: f64) -> Option<f64> {
    let next = log.partition_point(|(entry_s, _)| *entry_s < time_s);
    let (before, after) = (log.get(next.saturating_sub(1))?, log.get(next).or(log.last())?);
    Some(between(*before, *after, time_s))
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_measurement::campaign::RangeReading;

    fn campaign(times_s: &[f64], value: impl Fn(f64) -> f64) -> Campaign {
        let reading = |time_s: &f64| RangeReading {
            station: 0,
            line: 0,
            time_s: *time_s,
            reading_m: [0.0; 3],
            offset_m: [0.0; 3],
            length_m: 0.0,
        };
        let column =
            |name: &str| Covariate { name: name.to_owned(), values: times_s.iter().map(|t| Some(value(*t))).collect() };
        Campaign {
            readings: times_s.iter().map(reading).collect(),
            covariates: vec![column("temp_air_c"), column("dir_x")],
            ..Campaign::default()
        }
    }

    #[test]
    fn a_log_is_moved_and_the_machines_own_is_not() {
        let times_s: Vec<f64> = (0..50).map(|k| 10.0 * f64::from(k)).collect();
        let moved = shifted(&campaign(&times_s, |t| 20.0 + 0.01 * t), 60.0);
        let of = |name: &str, k: usize| moved.covariate(name).unwrap().values[k].unwrap();
        assert!((of("temp_air_c", 20) - (20.0 + 0.01 * 260.0)).abs() < 1e-9);
        assert!((of("temp_air_c", 49) - (20.0 + 0.01 * 490.0)).abs() < 1e-9, "a log stays as it ended");
        assert!((of("dir_x", 20) - (20.0 + 0.01 * 200.0)).abs() < 1e-9);
    }

    #[test]
    fn shifts_go_to_either_side_up_to_an_eighth_of_the_campaign() {
        let shifts_s = shifts_s(&campaign(&[0.0, 8000.0], |_| 20.0));
        assert_eq!((shifts_s.len(), shifts_s[0], shifts_s[1]), (2 * SHIFTS, 1000.0, -1000.0));
        assert!(super::shifts_s(&campaign(&[5.0, 5.0], |_| 20.0)).is_empty(), "without times there are none");
    }
}
