//! Whether a logged quantity had one value at each station, so that what it does cannot be told from where stations stand.
//!
//! Place in the flow: from the campaign alone. A workpiece that lay on the table while one station measured bends the machine for that station
//! alone: its position and dead path take that, and the errors of the machine what is left. No residual tells it, and no uncertainty
//! of a fit holds it.

use super::{Finding, Grade, Subject};
use abbe_geometry::effects::is_derived;
use abbe_geometry::seen::is_changed;
use abbe_measurement::campaign::{Campaign, Covariate};
use std::collections::BTreeMap;

/// Scatter at a station, as a share of all scatter, up to which a station saw one value: a hundredth of the information is left within.
const AT_A_STATION: f64 = 0.1;

/// The quantities of a campaign that changed from station to station alone.
pub(super) fn by_station(campaign: &Campaign) -> Option<Finding> {
    let told = campaign.covariates.iter().filter(|own| is_by_station(campaign, own));
    let names: Vec<String> = told.map(|own| own.name.clone()).collect();
    let finding = |names| Finding { grade: Grade::Message, subject: Subject::ByStation { names }, causes: Vec::new() };
    (!names.is_empty()).then(|| finding(names))
}

fn is_by_station(campaign: &Campaign, own: &Covariate) -> bool {
    let mut stations: BTreeMap<u32, Vec<f64>> = BTreeMap::new();
    for (reading, value) in campaign.readings.iter().zip(&own.values) {
        if let Some(value) = value.filter(|value| value.is_finite()) {
            stations.entry(reading.station).or_default().push(value);
        }
    }
    let all: Vec<f64> = stations.values().flatten().copied().collect();
    let ends = all.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)));
    if stations.len() < 2 || is_derived(&own.name) || !is_changed(&own.name, ends) {
        return false;
    }
    let square: f64 = stations.values().map(|own| scatter(own)).sum();
    square <= AT_A_STATION.powi(2) * scatter(&all)
}

/// Sum of the squares about the mean.
fn scatter(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter().map(|value| (value - mean).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_measurement::campaign::RangeReading;

    /// Three stations of ten readings; a load at the second, a temperature that goes on.
    fn campaign(load_kg: fn(usize) -> f64) -> Campaign {
        let reading = |k: u32| RangeReading {
            station: k / 10,
            line: 0,
            time_s: f64::from(k),
            reading_m: [0.0; 3],
            offset_m: [0.0; 3],
            length_m: 0.0,
        };
        let logged = |name: &str, of: &dyn Fn(usize) -> f64| Covariate {
            name: name.to_owned(),
            values: (0..30).map(|k| Some(of(k))).collect(),
        };
        Campaign {
            readings: (0..30).map(reading).collect(),
            covariates: vec![
                logged("load_kg", &load_kg),
                logged("temp_air_c", &|k| 20.0 + 0.1 * k as f64),
                logged("supply_bar", &|k| 5.0 + 0.2 * (k / 10) as f64 + 0.01 * (k % 2) as f64),
                logged("pressure_hpa", &|k| 1000.0 + (k / 10) as f64),
            ],
            ..Campaign::default()
        }
    }

    #[test]
    fn a_load_at_one_station_is_told_and_one_that_changed_there_is_not() {
        let found = by_station(&campaign(|k| if k / 10 == 1 { 300.0 } else { 0.0 })).unwrap().to_string();
        assert!(found.contains("load_kg") && !found.contains("temp_air_c"), "{found}");
        assert!(found.contains("supply_bar") && !found.contains("pressure_hpa"), "{found}");
        for load_kg in [|k: usize| if (5..25).contains(&k) { 300.0 } else { 0.0 }, |_| 300.0] {
            assert!(!by_station(&campaign(load_kg)).unwrap().to_string().contains("load_kg"));
        }
    }
}
