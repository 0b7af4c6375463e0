//! Jumps of a tracer's zero, or of its stand, between two of its lines.
//!
//! Place in the flow: proposes shapes of both to [`crate::search`]. A jump that is many times the noise shows in rejected
//! readings, and identification refuses it with the reading; one of a few times the noise is drawn into errors and stations. Every
//! pause between lines of a station is tested for its zero, two lines on either side at least: one line alone is an outlying run. A jump of
//! the stand has three columns in the place of one: some pauses are tried, then all beside the best.

use crate::candidates::{Candidate, Round, best_constant};
use crate::error::DiagnoseError;
use abbe_geometry::effects::Shape;
use abbe_geometry::machine::Machine;
use abbe_measurement::campaign::Campaign;
use faer::Mat;

/// Lines before and after.
const LEAST_LINES: usize = 2;
/// Pauses that are tried for a stand before the best is looked for among its neighbours.
const COARSE: usize = 48;

/// A station, and an instant from which its readings are off (s).
type Jump = (usize, f64);

/// The jump of a zero and that of a stand that stand out most.
pub(crate) fn candidates(
    round: &Round,
    machine: &Machine,
    campaign: &Campaign,
) -> Result<Vec<Candidate>, DiagnoseError> {
    let jumps = jumps(campaign);
    let of_zero = |jump: &Jump| after(round, campaign, jump, 1, |_, _| 1.0);
    let zero = best_of(round, ("zero_jump", machine), campaign, &jumps, of_zero)?;
    let of_stand = |jump: &Jump| after(round, campaign, jump, 3, |k, d| -round.rows.rays[k].direction[d]);
    let stand = |tried: &[Jump]| best_of(round, ("stand_jump", machine), campaign, tried, of_stand);
    let stride = jumps.len().div_ceil(COARSE).max(1);
    let coarse: Vec<Jump> = jumps.iter().copied().step_by(stride).collect();
    let Some((place, found)) = stand(&coarse)? else { return Ok(zero.into_iter().map(|(_, zero)| zero).collect()) };
    let near = (place * stride).saturating_sub(stride - 1)..jumps.len().min(place * stride + stride);
    let found = stand(&jumps[near])?.map_or(found, |(_, found)| found);
    // Any pause could have been it.
    let found = Candidate { trials: jumps.len(), ..found };
    Ok(zero.into_iter().map(|(_, zero)| zero).chain([found]).collect())
}

/// The best of some jumps, with its place among them.
fn best_of(
    round: &Round,
    effect: (&str, &Machine),
    campaign: &Campaign,
    jumps: &[Jump],
    columns: impl Fn(&Jump) -> Mat<f64>,
) -> Result<Option<(usize, Candidate)>, DiagnoseError> {
    best_constant(round, effect, jumps.iter().map(columns).collect(), |place| {
        let (station, after_s) = jumps[place];
        Shape::new().text("station", &campaign.stations[station]).number("after_s", after_s)
    })
}

/// Columns that are nothing but on the readings used of a station from an instant on.
fn after(
    round: &Round,
    campaign: &Campaign,
    (station, after_s): &Jump,
    count: usize,
    value: impl Fn(usize, usize) -> f64,
) -> Mat<f64> {
    let is_off = |k: usize| {
        let reading = &campaign.readings[k];
        reading.station as usize == *station && reading.time_s >= *after_s && round.rows.whitening[k] > 0.0
    };
    Mat::from_fn(round.rows.len(), count, |k, d| if is_off(k) { value(k, d) } else { 0.0 })
}

/// Stations with the instants of their pauses between lines (s): half-way between the last reading of one and the first of the next.
fn jumps(campaign: &Campaign) -> Vec<Jump> {
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
