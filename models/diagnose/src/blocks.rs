//! Blocks of readings that are left out together: lines, stations, times.
//!
//! Place in the flow: what is judged on readings that a fit did not see takes its blocks from here, the gate, the judge and the floor alike.

use crate::candidates::Round;
use abbe_measurement::campaign::Campaign;

/// Blocks of time.
const TIME_BLOCKS: usize = 20;

/// Blocks of readings used, by line, station and time.
pub(crate) fn blocks(campaign: &Campaign, round: &Round) -> [(&'static str, Vec<Vec<usize>>); 3] {
    let used = || (0..campaign.readings.len()).filter(|k| round.rows.whitening[*k] > 0.0);
    let group = |key: &dyn Fn(usize) -> usize, count: usize| {
        let mut groups = vec![Vec::new(); count];
        used().for_each(|k| groups[key(k)].push(k));
        groups.retain(|g| !g.is_empty());
        groups
    };
    let readings = &campaign.readings;
    let share = readings.len().div_ceil(TIME_BLOCKS).max(1);
    [
        ("line", group(&|k| readings[k].line as usize, campaign.lines.len())),
        ("station", group(&|k| readings[k].station as usize, campaign.stations.len())),
        ("time", group(&|k| k / share, TIME_BLOCKS)),
    ]
}
