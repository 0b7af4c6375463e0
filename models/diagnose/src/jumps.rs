//! Jumps of a tracer's zero between two of its lines.
//!
//! Place in the flow: proposes shapes of the zero jump to [`crate::search`]. A jump that is many times the noise shows in rejected
//! readings, and identification refuses it with the reading; one of a few times the noise is drawn into errors and stations. Every
//! pause between lines of a station is tested, two lines on either side at least: one line alone is an outlying run.

use crate::candidates::{Candidate, Round};
use crate::error::DiagnoseError;
use abbe_geometry::effects::{Shape, known};
use abbe_geometry::machine::Machine;
use abbe_identify::EffectTerm;
use abbe_measurement::campaign::Campaign;
use faer::Mat;

/// Lines before and after.
const LEAST_LINES: usize = 2;

/// The jump that stands out most.
pub(crate) fn candidate(
    round: &Round,
    machine: &Machine,
    campaign: &Campaign,
) -> Result<Option<Candidate>, DiagnoseError> {
    let Some(known) = known("zero_jump") else { return Ok(None) };
    let jumps = jumps(campaign);
    let column = |jump: &(usize, f64)| {
        let is_off = |k: usize| {
            let reading = &campaign.readings[k];
            reading.station as usize == jump.0 && reading.time_s >= jump.1 && round.rows.whitening[k] > 0.0
        };
        let mut column = Mat::from_fn(round.rows.len(), 1, |k, _| if is_off(k) { 1.0 } else { 0.0 });
        round.rows.whiten(column.col_as_slice_mut(0));
        column
    };
    let columns: Vec<Mat<f64>> = jumps.iter().map(column).collect();
    let groups = round.free.project_all(&columns).into_iter();
    let scores = groups.map(|group| (round.score(&group), group.absorbed()));
    let best = scores.enumerate().max_by(|a, b| a.1.0.reduction.total_cmp(&b.1.0.reduction));
    let Some((place, (score, absorbed))) = best else { return Ok(None) };
    let (station, after_s) = jumps[place];
    let shape = Shape::new().text("station", &campaign.stations[station]).number("after_s", after_s);
    let term = EffectTerm::new(known.name, shape, machine)?;
    Ok(Some(Candidate { known, term, score, trials: jumps.len(), absorbed, rest: None }))
}

/// Stations with the instants of their pauses between lines (s): half-way between the last reading of one and the first of the next.
fn jumps(campaign: &Campaign) -> Vec<(usize, f64)> {
    let mut all = Vec::new();
    for station in 0..campaign.stations.len() {
        let own = campaign.readings.iter().filter(|reading| reading.station as usize == station);
        let mut pauses: Vec<f64> = Vec::new();
        for (last, next) in own.clone().zip(own.skip(1)) {
            if last.line != next.line && last.time_s < next.time_s {
                pauses.push(0.5 * (last.time_s + next.time_s));
            }
        }
        let inner = pauses.len().saturating_sub(1).max(LEAST_LINES - 1);
        all.extend(pauses.get(LEAST_LINES - 1..inner).into_iter().flatten().map(|after_s| (station, *after_s)));
    }
    all
}
