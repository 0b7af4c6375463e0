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
    let column = |(station, lines): &(usize, Vec<usize>)| {
        let is_off = |k: usize| {
            let reading = &campaign.readings[k];
            let is_after = reading.station as usize == *station && lines.contains(&(reading.line as usize));
            is_after && round.rows.whitening[k] > 0.0
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
    let (station, lines) = &jumps[place];
    let names: Vec<String> = lines.iter().map(|line| campaign.lines[*line].clone()).collect();
    let shape = Shape::new().text("station", &campaign.stations[*station]).texts("lines", &names);
    let term = EffectTerm::new(known.name, shape, machine)?;
    Ok(Some(Candidate { known, term, score, trials: jumps.len(), absorbed, rest: None }))
}

/// Stations with the lines after each pause, in the order of measurement.
fn jumps(campaign: &Campaign) -> Vec<(usize, Vec<usize>)> {
    let mut all = Vec::new();
    for station in 0..campaign.stations.len() {
        let mut lines: Vec<usize> = Vec::new();
        for reading in campaign.readings.iter().filter(|reading| reading.station as usize == station) {
            let line = reading.line as usize;
            if !lines.contains(&line) {
                lines.push(line);
            }
        }
        let places = LEAST_LINES..(lines.len() + 1).saturating_sub(LEAST_LINES);
        all.extend(places.map(|first| (station, lines[first..].to_vec())));
    }
    all
}
