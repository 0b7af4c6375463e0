//! What temperatures and humidities would be behind a ladder of time constants, and sides over a ladder of travels, as columns of a campaign.
//!
//! Place in the flow: a diagnosis begins with the campaign and these columns ([`with_lags`]). Effects propose some of the steps
//! ([`is_proposed`]); [`crate::lags`] moves what comes of that along the ladder. Times in s, travels in µm.

use crate::columns::{correlation, range, varies};
use abbe_geometry::Axis;
use abbe_geometry::effects::{lagged_name, logged_side, of_lagged, of_travelled, travelled_name};
use abbe_identify::with_lagged;
use abbe_measurement::campaign::{Campaign, Covariate};

/// Shortest time constant (s): less than anything but a wire takes, and as little as the clock of a log is often off by.
const SHORTEST_S: f64 = 40.0;
/// Ratio of neighbouring steps: neighbours differ by some percent of what they do.
const RATIO: f64 = 1.25;
/// Steps of the ladder: up to some years, whatever the times of a campaign say.
pub(crate) const STEPS: usize = 64;
/// Steps from one proposed time constant to the next (a factor of three), and the first.
pub(crate) const COARSE: usize = 5;
const FIRST: usize = 3;
/// Longest time constant, as a share of the campaign's duration: half of the readings are then past what the beginning left.
const LONGEST: f64 = 1.0 / 6.0;
/// Longest time constant of a sensor (s): in still air, in a thick housing.
const LATEST_S: i32 = 3600;
/// Shortest travel (µm): less than that is a reversal.
const SHORTEST_UM: f64 = 250.0;
/// Ratio of neighbouring travels, and steps from one proposed to the next (a factor of five): what they do differs slowly.
const TRAVEL_RATIO: f64 = 1.5;
const COARSE_TRAVEL: usize = 4;
/// Longest travel, as a share of what an axis was moved: a longer one is a position.
const LONGEST_TRAVEL: f64 = 0.25;
/// Correlation from which a lagged temperature is the logged one to the data.
const SAME: f64 = 0.999;

/// The campaign with its temperatures behind all time constants of the ladder, and behind those that `asked` names.
pub(crate) fn with_lags(campaign: &Campaign, asked: impl IntoIterator<Item = String>) -> Campaign {
    with_steps(campaign, asked, |_| true)
}

/// The same with those time constants alone that are proposed to effects.
pub(crate) fn with_proposed_lags(campaign: &Campaign) -> Campaign {
    with_steps(campaign, [], is_coarse)
}

fn with_steps(campaign: &Campaign, asked: impl IntoIterator<Item = String>, is_wanted: fn(i32) -> bool) -> Campaign {
    let mut names: Vec<String> = asked.into_iter().filter(|name| of_lagged(name).is_some()).collect();
    let (first_s, last_s) = range(campaign.readings.iter().map(|reading| reading.time_s));
    let longest_s = LONGEST * (last_s - first_s);
    // Stone follows the humidity of its air; a sensor of humidity is not late by what matters.
    for (is_own, latest_s) in [(is_temperature as fn(&str) -> bool, LATEST_S), (is_humidity, 0)] {
        for logged in campaign.covariates.iter().filter(|column| is_own(&column.name) && varies(&column.values)) {
            let steps = (0..STEPS).map(lag_s).take_while(|lag_s| f64::from(*lag_s) <= longest_s);
            let late = steps.clone().take_while(|lag_s| *lag_s <= latest_s).map(|lag_s| -lag_s);
            let wanted = steps.chain(late).filter(|lag_s| is_wanted(*lag_s));
            names.extend(wanted.filter_map(|lag_s| lagged_name(&logged.name, lag_s)));
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
pub(crate) fn further(name: &str, steps: isize) -> Option<String> {
    let place = |step: Option<usize>| step?.checked_add_signed(steps);
    if let Some((logged, lag)) = of_lagged(name) {
        return lagged_name(&logged, lag.signum() * lag_s(place(step_of(lag))?));
    }
    let (axis, travel) = of_travelled(name)?;
    Some(travelled_name(axis, travel_um(place((0..STEPS).find(|step| travel_um(*step) == travel))?)))
}

pub(crate) fn is_temperature(name: &str) -> bool {
    name.starts_with("temp_") && name.ends_with("_c") && of_lagged(name).is_none()
}

fn is_humidity(name: &str) -> bool {
    name.starts_with("humidity_") && name.ends_with("pct") && of_lagged(name).is_none()
}

/// Time constant of a step of the ladder (s).
pub(crate) fn lag_s(step: usize) -> i32 {
    (SHORTEST_S * RATIO.powi(step as i32)).round() as i32
}

/// The step of the ladder with that time constant, behind or ahead.
fn step_of(lag: i32) -> Option<usize> {
    (0..STEPS).find(|step| lag_s(*step) == lag.abs())
}

/// Whether a time constant, behind what was logged, is one of those that are proposed.
fn is_coarse(lag_s: i32) -> bool {
    lag_s > 0 && step_of(lag_s).is_some_and(|step| step % COARSE == FIRST)
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
    is_coarse(lag) && longest_pause_s(campaign) <= f64::from(lag) && campaign.covariate(&logged).is_some_and(differs)
}

fn longest_pause_s(campaign: &Campaign) -> f64 {
    campaign.readings.windows(2).map(|pair| pair[1].time_s - pair[0].time_s).fold(0.0, f64::max)
}

/// What a derived covariate is made from; any other, itself.
pub(crate) fn logged_of(name: &str) -> String {
    match (of_lagged(name), of_travelled(name)) {
        (Some((logged, _)), _) => logged,
        (_, Some((axis, _))) => logged_side(axis).to_owned(),
        (None, None) => name.to_owned(),
    }
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

    #[test]
    fn proposed_lags_are_those_of_all_that_are_proposed() {
        let values = (0..400).map(|k| Some(20.0 + (0.05 * f64::from(k)).sin())).collect();
        let campaign = Campaign {
            readings: (0..400).map(|k| reading(60.0 * f64::from(k))).collect(),
            covariates: vec![Covariate { name: "temp_air_c".to_owned(), values }],
            ..Campaign::default()
        };
        let (all, some) = (with_lags(&campaign, []), with_proposed_lags(&campaign));
        let proposed = |known: &Campaign| {
            let own = known.covariates.iter().filter(|column| is_proposed(known, column));
            own.map(|column| column.name.clone()).collect::<Vec<String>>()
        };
        assert_eq!(proposed(&all), proposed(&some));
        assert!(proposed(&some).len() > 2 && 4 * some.covariates.len() < all.covariates.len());
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
}
