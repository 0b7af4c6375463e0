//! How the noise of ranges is correlated, and what that does to the rows of a campaign.
//!
//! Place in the flow: [`crate::range_noise`] finds it, fits and diagnosis whiten their rows by it ([`crate::correlation`]).

use crate::correlation::{Correlation, Sequence, Whitener};
use abbe_measurement::campaign::Campaign;
use std::collections::BTreeMap;

/// What is correlated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Along {
    /// Readings of one line.
    Line,
    /// Readings of one station, from line to line.
    Station,
}

/// What the distance of two readings is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum By {
    /// Readings between them.
    Order,
    /// Time between them (s).
    Time,
}

/// How the noise of ranges is correlated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeCorrelation {
    /// Shares of the variance, and the length in readings or s.
    pub noise: Correlation,
    /// What is correlated.
    pub along: Along,
    /// What the distance is.
    pub by: By,
    /// Gain of twice the restricted log likelihood over white noise.
    pub gain: f64,
}

impl RangeCorrelation {
    /// What whitens rows of this campaign, one a reading, each divided by its declared uncertainty.
    pub fn whitener(&self, campaign: &Campaign, weights: &[f64]) -> Whitener {
        let all: Vec<usize> = (0..campaign.readings.len()).collect();
        Whitener::new(&sequence(campaign, &all, (self.along, self.by)), &self.noise, weights)
    }

    /// How many independent readings would tell as much of what neighbours have in common.
    pub fn effective_readings(&self, campaign: &Campaign, weights: &[f64]) -> f64 {
        self.whitener(campaign, weights).effective_rows(weights.len())
    }

    /// Correlation of readings that follow one another on a line, at the usual step.
    pub fn of_neighbours(&self, campaign: &Campaign) -> f64 {
        let all: Vec<usize> = (0..campaign.readings.len()).collect();
        let step = sequence(campaign, &all, (Along::Line, self.by)).usual_step();
        step.map_or(0.0, |step| self.noise.at(step))
    }
}

/// Rows of these readings (row k is reading `readings[k]`) in such an order.
pub(crate) fn sequence(campaign: &Campaign, readings: &[usize], (along, by): (Along, By)) -> Sequence {
    let of = |row: usize| &campaign.readings[readings[row]];
    let mut blocks: BTreeMap<(u32, u32), Vec<usize>> = BTreeMap::new();
    // Number of each reading among those of its block, left-out ones counted.
    let mut counts: BTreeMap<(u32, u32), usize> = BTreeMap::new();
    let mut numbers = Vec::with_capacity(readings.len());
    let key = |station: u32, line: u32| (station, if along == Along::Line { line } else { 0 });
    let mut rows = readings.iter().enumerate().peekable();
    for (k, reading) in campaign.readings.iter().enumerate() {
        let own = key(reading.station, reading.line);
        let number = counts.entry(own).or_default();
        if let Some((row, _)) = rows.next_if(|(_, index)| **index == k) {
            blocks.entry(own).or_default().push(row);
            numbers.push(*number);
        }
        *number += 1;
    }
    let place = |row: usize| match by {
        By::Order => numbers[row] as f64,
        By::Time => of(row).time_s,
    };
    let blocks: Vec<Vec<usize>> = blocks.into_values().collect();
    Sequence::new(&blocks, place, |row| of(row).line as usize)
}
