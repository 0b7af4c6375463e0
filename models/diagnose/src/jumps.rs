//! Jumps of a tracer's zero between two of its lines.
//!
//! Place in the flow: proposes shapes of the zero jump to [`crate::search`]. A jump that is many times the noise shows in rejected
//! readings, and identification refuses it with the reading; one of a few times the noise is drawn into errors and stations. Every
//! pause between lines of a station is tested, two lines on either side at least: one line alone is an outlying run.

use crate::candidates::{Candidate, Round, best_constant};
use crate::error::DiagnoseError;
use abbe_geometry::effects::Shape;
use abbe_geometry::machine::Machine;
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
    let jumps = jumps(campaign);
    let column = |(station, after_s): &(usize, f64)| {
        let is_off = |k: usize| {
            let reading = &campaign.readings[k];
            reading.station as usize == *station && reading.time_s >= *after_s && round.rows.whitening[k] > 0.0
        };
        Mat::from_fn(round.rows.len(), 1, |k, _| if is_off(k) { 1.0 } else { 0.0 })
    };
    best_constant(round, ("zero_jump", machine), jumps.iter().map(column).collect(), |place| {
        let (station, after_s) = jumps[place];
        Shape::new().text("station", &campaign.stations[station]).number("after_s", after_s)
    })
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
