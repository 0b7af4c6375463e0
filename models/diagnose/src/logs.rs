//! What a logger of the room left out, or cannot have measured, before anything is explained by it.
//!
//! Place in the flow: before [`crate::diagnose()`]. One empty cell would keep the right temperature from being tried, and its neighbours in the
//! room would stand in for it. So a gap is drawn straight between its neighbours where what was logged elsewhere can be drawn so, within a
//! part of what it varies by. A value far from all others, and a log that stands still, are taken for missing. All of it is said. Values in
//! the unit of their column; times in s.

use crate::columns::range;
use crate::context::is_of_the_room;
use abbe_geometry::seen::TEMPERATURE;
use abbe_measurement::campaign::{Campaign, Covariate, RangeReading};
use abbe_measurement::robust::median;
use std::collections::{BTreeMap, BTreeSet};

/// Distance from the median, in widths of the middle 95 %, from which a value is none of the sensor's.
const FAR: f64 = 10.0;
/// Share of the readings from which a value that does not change is a log that stands still, where at least so many differ elsewhere.
const STILL: f64 = 0.25;
/// How many times as long as any other run of one value it is where it stood still for less, and fewest readings of such a run.
const LONGER: usize = 20;
const FEWEST_STILL: usize = 20;
const DISTINCT: usize = 20;
/// Error of drawing across a gap, as a share of the standard deviation of the column, up to which it is drawn.
const DRAWN: f64 = 0.3;

/// Difference from the other temperatures from which one is in no °C of the same room (K).
const ELSEWHERE_K: f64 = 25.0;
/// Difference within which it is, once it is taken for another unit (K).
const SAME_ROOM_K: f64 = 5.0;

/// The campaign with its logs mended, and what was done to them, for readers.
pub fn mended(campaign: &Campaign) -> (Campaign, Vec<String>) {
    let times_s: Vec<f64> = campaign.readings.iter().map(|reading| reading.time_s).collect();
    let mut order: Vec<usize> = (0..times_s.len()).collect();
    order.sort_by(|a, b| times_s[*a].total_cmp(&times_s[*b]));
    let mut said = Vec::new();
    let mut mend = |column: &Covariate| {
        if !is_of_the_room(&column.name) {
            return column.clone();
        }
        let mut values = column.values.clone();
        values.resize(times_s.len(), None);
        Log { name: &column.name, times_s: &times_s, order: &order, values }.mended(&mut said)
    };
    let covariates = campaign.covariates.iter().map(&mut mend).collect();
    said.extend(in_another_unit(campaign));
    (Campaign { covariates, ..campaign.clone() }, said)
}

/// The same for what was logged beside the rows of a study, by name; rows without a time are taken in their order.
pub(crate) fn mended_rows(
    times_s: &[Option<f64>],
    logged: &[&BTreeMap<String, f64>],
) -> (Vec<BTreeMap<String, f64>>, Vec<String>) {
    let has_times = times_s.iter().all(Option::is_some);
    let reading = |(k, time_s): (usize, &Option<f64>)| RangeReading {
        station: 0,
        line: 0,
        time_s: time_s.filter(|_| has_times).unwrap_or(k as f64),
        reading_m: [0.0; 3],
        offset_m: [0.0; 3],
        length_m: 0.0,
    };
    let names: BTreeSet<&String> = logged.iter().flat_map(|row| row.keys()).collect();
    let column = |name: &String| Covariate {
        name: name.clone(),
        values: logged.iter().map(|row| row.get(name).copied()).collect(),
    };
    let campaign = Campaign {
        readings: times_s.iter().enumerate().map(reading).collect(),
        covariates: names.into_iter().map(column).collect(),
        ..Campaign::default()
    };
    let (campaign, said) = mended(&campaign);
    let row = |k: usize| {
        let own = campaign.covariates.iter().filter_map(|column| Some((column.name.clone(), column.values[k]?)));
        own.collect::<BTreeMap<String, f64>>()
    };
    ((0..logged.len()).map(row).collect(), said)
}

/// Temperatures that are in °F or K by all that the others say, though their name says °C. They are told, not changed.
fn in_another_unit(campaign: &Campaign) -> Vec<String> {
    let is_temperature = |column: &&Covariate| column.name.starts_with("temp_") && column.name.ends_with("_c");
    let usual =
        |column: &Covariate| Some((column.name.clone(), median(column.values.iter().flatten().copied().collect())?));
    let all: Vec<(String, f64)> = campaign.covariates.iter().filter(is_temperature).filter_map(usual).collect();
    let one = |(name, value): &(String, f64)| {
        let others = all.iter().filter(|(other, _)| other != name).map(|(_, value)| *value).collect();
        let room_c = median(others).filter(|room_c| (value - room_c).abs() > ELSEWHERE_K)?;
        let units = [("°F", (value - 32.0) / 1.8), ("K", value - 273.15)];
        let (unit, value_c) = units.into_iter().find(|(_, value_c)| (value_c - room_c).abs() < SAME_ROOM_K)?;
        Some(format!(
            "{name} is at {value:.1}, where the other temperatures are at {room_c:.1}: that would fit {unit}, which were {value_c:.1} °C. It is taken as \
             its name says; if it is not hot or cold there, convert it, and diagnose again."
        ))
    };
    all.iter().filter_map(one).collect()
}

/// A column of a logger.
struct Log<'l> {
    name: &'l str,
    times_s: &'l [f64],
    /// Readings by time.
    order: &'l [usize],
    values: Vec<Option<f64>>,
}

impl Log<'_> {
    fn mended(mut self, said: &mut Vec<String>) -> Covariate {
        said.extend(self.without_what_is_far());
        said.extend(self.without_what_stands_still());
        said.extend(self.drawn());
        Covariate { name: self.name.to_owned(), values: self.values }
    }

    /// Takes out what is far from all others and was not come to on the way: a room that warms up passes all values between.
    fn without_what_is_far(&mut self) -> Option<String> {
        let mut logged: Vec<f64> = self.values.iter().flatten().copied().collect();
        logged.sort_by(f64::total_cmp);
        let at = |share: f64| logged.get((share * logged.len().saturating_sub(1) as f64).round() as usize).copied();
        let (middle, far_by) = (at(0.5)?, FAR * (at(0.975)? - at(0.025)?));
        let (mut far, mut last) = (Vec::new(), middle);
        for k in self.order.iter().copied().filter(|_| far_by > 0.0) {
            let Some(value) = self.values[k] else { continue };
            let is_near = (value - middle).abs() <= far_by || (value - last).abs() <= 0.5 * far_by;
            if is_near { last = value } else { far.push(k) }
        }
        let first = self.values[*far.first()?]?;
        far.iter().for_each(|k| self.values[*k] = None);
        let more = if far.len() > 1 { format!(" and {} more", far.len() - 1) } else { String::new() };
        Some(format!(
            "{} is {first} at reading {}{more}, far from its usual {middle:.1}: taken for missing there.",
            self.name,
            far[0] + 1
        ))
    }

    /// Takes out the longest run of one value, where that is no matter of the display.
    fn without_what_stands_still(&mut self) -> Option<String> {
        let of = |k: usize| self.order.get(k).and_then(|reading| self.values[*reading]);
        let (mut longest, mut second, mut first) = (0..0, 0, 0);
        for k in 0..=self.order.len() {
            if k == self.order.len() || of(k) != of(first) {
                if of(first).is_some() && k - first > longest.len() {
                    second = longest.len();
                    longest = first..k;
                } else if of(first).is_some() {
                    second = second.max(k - first);
                }
                first = k;
            }
        }
        let mut others: Vec<f64> = (0..self.order.len()).filter(|k| !longest.contains(k)).filter_map(of).collect();
        others.sort_by(f64::total_cmp);
        others.dedup();
        let is_long = longest.len() as f64 >= STILL * self.order.len() as f64;
        // A temperature that scatters from reading to reading does not come to rest by itself; a load or a speed may.
        let is_apart = self.name.ends_with(TEMPERATURE) && longest.len() >= FEWEST_STILL.max(LONGER * second);
        if !(is_long || is_apart) || others.len() < DISTINCT {
            return None;
        }
        let value = of(longest.start)?;
        longest.clone().for_each(|k| self.values[self.order[k]] = None);
        Some(format!(
            "{} stays at {value} for {} of {} readings and moves at the others: the sensor or its log stood still, and that is taken for missing.",
            self.name,
            longest.len(),
            self.order.len()
        ))
    }

    /// Draws straight lines across the gaps, and says what could not be drawn.
    fn drawn(&mut self) -> Option<String> {
        let missing = self.values.iter().filter(|value| value.is_none()).count();
        if missing == 0 || missing == self.values.len() {
            return None;
        }
        let log: Vec<(f64, f64)> =
            self.order.iter().filter_map(|k| Some((self.times_s[*k], self.values[*k]?))).collect();
        let steps = log.windows(2).map(|pair| pair[1].0 - pair[0].0).collect();
        let step_s = median(steps).unwrap_or(0.0);
        let (mut drawn, order) = (0, self.order);
        let is_missing: Vec<bool> = self.values.iter().map(Option::is_none).collect();
        for gap in order.chunk_by(|a, b| is_missing[*a] == is_missing[*b]).filter(|run| is_missing[run[0]]) {
            let across = Across::of(&log, self.times_s[gap[0]], step_s);
            for k in gap {
                self.values[*k] = across.at(self.times_s[*k]);
                drawn += usize::from(self.values[*k].is_some());
            }
        }
        let of = format!("{} is missing at {missing} of {} readings", self.name, self.values.len());
        Some(match drawn == missing {
            true => format!("{of}; there it was drawn straight between its neighbours."),
            false => format!(
                "{of}, too long to be drawn between its neighbours: nothing was tried by it. Log it throughout."
            ),
        })
    }
}

/// What a log says across a gap.
enum Across {
    /// A straight line between two entries.
    Line((f64, f64), (f64, f64)),
    /// The entry at an end, not farther from it than the usual step from one entry to the next (s).
    Entry((f64, f64), f64),
    /// Nothing: lines as long do not follow what is logged elsewhere.
    Nothing,
}

impl Across {
    /// Of the gap around a time.
    fn of(log: &[(f64, f64)], time_s: f64, step_s: f64) -> Across {
        let next = log.partition_point(|(entry_s, _)| *entry_s < time_s);
        match (next.checked_sub(1).and_then(|k| log.get(k)), log.get(next)) {
            (Some(before), Some(after)) if is_drawn_well(log, 0.5 * (after.0 - before.0)) => {
                Across::Line(*before, *after)
            }
            (Some(end), None) | (None, Some(end)) => Across::Entry(*end, step_s),
            _ => Across::Nothing,
        }
    }

    fn at(&self, time_s: f64) -> Option<f64> {
        match self {
            Across::Line(before, after) => Some(between(*before, *after, time_s)),
            Across::Entry((entry_s, value), step_s) => ((entry_s - time_s).abs() <= *step_s).then_some(*value),
            Across::Nothing => None,
        }
    }
}

/// Straight from one entry to the next; times (s) and values.
pub(crate) fn between(before: (f64, f64), after: (f64, f64), time_s: f64) -> f64 {
    match after.0 > before.0 {
        true => before.1 + (after.1 - before.1) * ((time_s - before.0) / (after.0 - before.0)),
        false => after.1,
    }
}

/// Whether entries are met by lines from those that were logged half a gap before to those half a gap later.
fn is_drawn_well(log: &[(f64, f64)], half_s: f64) -> bool {
    let (mut square, mut count) = (0.0, 0.0);
    for (time_s, value) in log {
        let before = log.partition_point(|(entry_s, _)| *entry_s <= time_s - half_s).checked_sub(1);
        let after = log.partition_point(|(entry_s, _)| *entry_s < time_s + half_s);
        if let (Some(before), Some(after)) = (before.and_then(|k| log.get(k)), log.get(after)) {
            square += (between(*before, *after, *time_s) - value).powi(2);
            count += 1.0;
        }
    }
    let mean = log.iter().map(|(_, value)| value).sum::<f64>() / log.len().max(1) as f64;
    let variance = log.iter().map(|(_, value)| (value - mean).powi(2)).sum::<f64>() / log.len().max(1) as f64;
    let (low_s, high_s) = range(log.iter().map(|(time_s, _)| *time_s));
    count > 0.0 && 4.0 * half_s < high_s - low_s && square / count <= DRAWN * DRAWN * variance
}

#[cfg(test)]
mod tests {
    use super::*;

    const READINGS: usize = 400;

    fn course(k: usize) -> f64 {
        20.0 + 0.4 * (k as f64 / 60.0).sin()
    }

    fn mended_of(value: impl Fn(usize) -> Option<f64>) -> (Vec<Option<f64>>, Vec<String>) {
        let reading = |k: usize| RangeReading {
            station: 0,
            line: 0,
            time_s: 10.0 * k as f64,
            reading_m: [0.0; 3],
            offset_m: [0.0; 3],
            length_m: 0.0,
        };
        let values = (0..READINGS).map(value).collect();
        let covariates = vec![Covariate { name: "temp_ram_c".to_owned(), values }];
        let readings = (0..READINGS).map(reading).collect();
        let (mut campaign, said) = mended(&Campaign { readings, covariates, ..Campaign::default() });
        (campaign.covariates.remove(0).values, said)
    }

    #[test]
    fn nothing_measured_is_nothing_mended() {
        let covariates = vec![Covariate { name: "temp_ram_c".to_owned(), values: Vec::new() }];
        assert!(mended(&Campaign { covariates, ..Campaign::default() }).1.is_empty());
    }

    /// A column in °F under a name of °C was taken as it is without a word, and another sensor stood in for it.
    #[test]
    fn regress_a_temperature_in_another_unit_than_its_name_says_is_told() {
        let said = |values: [f64; 4]| {
            let column = |(k, value): (usize, f64)| Covariate {
                name: format!("temp_{k}_c"),
                values: (0..READINGS).map(|row| Some(value + course(row) - 20.0)).collect(),
            };
            let covariates = values.into_iter().enumerate().map(column).collect();
            in_another_unit(&Campaign { covariates, ..Campaign::default() })
        };
        let fahrenheit = said([20.3, 68.4, 19.8, 20.0]);
        assert!(
            fahrenheit.len() == 1 && fahrenheit[0].contains("temp_1_c is at 68.4") && fahrenheit[0].contains("20.2 °C")
        );
        let kelvin = said([20.3, 20.0, 293.1, 20.0]);
        assert!(
            kelvin.len() == 1
                && kelvin[0].contains("temp_2_c")
                && kelvin[0].contains("would fit K, which were 20.0 °C"),
            "{kelvin:?}"
        );
        assert!(said([20.3, 55.0, 19.8, 21.0]).is_empty(), "a motor is warm, and no °F of this room");
        assert!(said([20.3, 33.0, 19.8, 21.0]).is_empty());
    }

    /// Of runs with one empty cell the temperature was not tried, and the expansion was a drift or noise.
    #[test]
    fn regress_an_empty_cell_beside_a_row_of_a_study_is_drawn() {
        let row = |k: usize| {
            let temperature = (k != 17).then(|| ("temp_ram_c".to_owned(), course(k)));
            temperature.into_iter().chain([("load_kg".to_owned(), 5.0)]).collect::<BTreeMap<String, f64>>()
        };
        let logged: Vec<BTreeMap<String, f64>> = (0..60).map(row).collect();
        let times_s: Vec<Option<f64>> = (0..60).map(|k| Some(10.0 * f64::from(k))).collect();
        for times_s in [times_s, vec![None; 60]] {
            let (mended, said) = mended_rows(&times_s, &logged.iter().collect::<Vec<_>>());
            assert!((mended[17]["temp_ram_c"] - course(17)).abs() < 0.01 && said.len() == 1, "{said:?}");
            assert!((0..60).filter(|k| *k != 17).all(|k| mended[k] == logged[k]));
        }
    }

    #[test]
    fn a_whole_log_stays_as_it_is() {
        let (values, said) = mended_of(|k| Some(course(k)));
        assert!(said.is_empty() && (0..READINGS).all(|k| values[k] == Some(course(k))), "{said:?}");
    }

    #[test]
    fn short_gaps_are_drawn_and_said() {
        for missing in [|k: usize| k == 17, |k: usize| k % 6 != 3, |k: usize| k == 0 || (100..112).contains(&k)] {
            let (values, said) = mended_of(|k| (!missing(k)).then(|| course(k)));
            let error = |k: usize| (values[k].unwrap() - course(k)).abs();
            assert!((0..READINGS).all(|k| error(k) < 0.03), "{said:?}");
            assert!(said.len() == 1 && said[0].contains("drawn straight between its neighbours"), "{said:?}");
        }
    }

    #[test]
    fn what_is_missing_for_long_or_at_an_end_stays_missing_and_is_said() {
        for missing in [|k: usize| k > 200, |k: usize| k < 5, |k: usize| (100..290).contains(&k)] {
            let (values, said) = mended_of(|k| (!missing(k)).then(|| course(k)));
            assert!(values.iter().any(Option::is_none), "{said:?}");
            assert!(said.len() == 1 && said[0].contains("nothing was tried by it"), "{said:?}");
        }
    }

    /// A load that is put on and taken off cannot be drawn: no line tells when.
    #[test]
    fn what_jumps_is_not_drawn() {
        let load = |k: usize| if (k * 7919 / 13).is_multiple_of(3) { 10.0 } else { 0.0 };
        let (values, _) = mended_of(|k| (k % 40 > 12).then(|| load(k)));
        assert!(values.iter().any(Option::is_none));
    }

    #[test]
    fn what_no_sensor_of_its_kind_says_is_taken_for_missing() {
        let (values, said) = mended_of(|k| Some(if [50, 51, 260].contains(&k) { 850.0 } else { course(k) }));
        assert!((0..READINGS).all(|k| (values[k].unwrap() - course(k)).abs() < 0.02));
        assert!(said[0].contains("temp_ram_c is 850 at reading 51 and 2 more"), "{said:?}");
    }

    #[test]
    fn what_is_come_to_on_the_way_is_no_wild_value() {
        let (values, said) = mended_of(|k| Some(20.0 + 0.01 * (k % 3) as f64 + 0.05 * (k as f64 - 391.0).max(0.0)));
        assert!(said.is_empty() && values.iter().all(Option::is_some), "{said:?}");
    }

    #[test]
    fn a_log_that_stands_still_is_missing_and_a_coarse_display_is_none() {
        let (values, said) = mended_of(|k| Some(course(k.min(250))));
        assert!(values[399].is_none() && said[0].contains("stood still"), "{said:?}");
        let (_, said) = mended_of(|k| Some(course(k).round()));
        assert!(said.is_empty(), "{said:?}");
        // For a twelfth of the time only: of a log that changes at each reading, and of one that has few digits.
        let still = |k: usize| if (200..232).contains(&k) { 200 } else { k };
        let (values, said) = mended_of(|k| Some(course(still(k)) + 1e-4 * (still(k) % 7) as f64));
        assert!(
            said[0].contains("for 32 of") && values[216].is_none_or(|value| (value - course(216)).abs() < 0.05),
            "{said:?}"
        );
        let (_, said) = mended_of(|k| Some((10.0 * course(still(k))).round() / 10.0));
        assert!(said.is_empty(), "{said:?}");
    }
}
