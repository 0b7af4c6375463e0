//! What was measured, when, with what, as far as the data and the machine file say: lines for the head of a report.
//!
//! Place in the flow: beside a report's figures, which a reader months later cannot place without it. What the data do not
//! say has no line. °C, h and µm.

use crate::pipeline::software;
use abbe_files::{hex, is_temperature, sha256_hex};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use abbe_report::MetaItem;
use anyhow::Context;
use std::path::Path;

/// Coverage factor of an instrument's uncertainty as data sheets state it.
const COVERAGE: f64 = 2.0;

/// Each line: what it is about, and what there is to say.
pub(crate) fn of_campaign(campaign: &Campaign, instrument: RangeUncertainty) -> Vec<(&'static str, String)> {
    let lines = [
        ("Declared uncertainty", Some(of_instrument(instrument))),
        ("Readings", measured(campaign)),
        ("Sensors of temperature", temperatures(campaign)),
    ];
    lines.into_iter().filter_map(|(what, words)| Some((what, words?))).collect()
}

/// Last lines of a report on a table: its name, its hash, the program.
pub(crate) fn made_from(path: &Path, sha256: &[u8; 32]) -> Vec<MetaItem> {
    vec![MetaItem::file("Data", &file_name(path), Some(&hex(sha256))), MetaItem::software(software())]
}

/// A line that names a file with the hash of its bytes; a folder, such as that of a bag, by its name alone.
pub(crate) fn hashed(label: &str, path: &Path) -> anyhow::Result<MetaItem> {
    let bytes = || std::fs::read(path).with_context(|| format!("{}: cannot be read", path.display()));
    let hash = if path.is_dir() { None } else { Some(sha256_hex(&bytes()?)) };
    Ok(MetaItem::file(label, &file_name(path), hash.as_deref()))
}

/// A file without its folder: a report is read elsewhere.
pub(crate) fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

fn of_instrument(instrument: RangeUncertainty) -> String {
    let [constant_um, per_metre_um] = [instrument.constant_m, instrument.per_metre].map(|u| COVERAGE * u * 1e6);
    format!("of the tracer, {constant_um:.3} µm + {per_metre_um:.3} µm/m (k = 2)")
}

fn measured(campaign: &Campaign) -> Option<String> {
    let times = || campaign.readings.iter().map(|reading| reading.time_s);
    let hours = (times().reduce(f64::max)? - times().reduce(f64::min)?) / 3600.0;
    let (readings, stations) = (campaign.readings.len(), campaign.stations.len());
    Some(format!("{readings} from {stations} stations within {hours:.1} h"))
}

/// Range over all temperatures that were logged.
fn temperatures(campaign: &Campaign) -> Option<String> {
    let logged = campaign.covariates.iter().filter(|c| is_temperature(&c.name));
    let values = || logged.clone().flat_map(|covariate| covariate.values.iter().flatten().copied());
    let (lowest, highest) = (values().reduce(f64::min)?, values().reduce(f64::max)?);
    Some(format!("{}, {lowest:.1} to {highest:.1} °C", logged.clone().count()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_measurement::campaign::{Covariate, RangeReading};

    fn campaign(temperatures: &[(&str, Vec<Option<f64>>)]) -> Campaign {
        let reading = |time_s: f64| {
            let place = [0.0; 3];
            RangeReading { station: 0, line: 0, time_s, reading_m: place, offset_m: place, length_m: 0.0 }
        };
        let covariate =
            |(name, values): &(&str, Vec<Option<f64>>)| Covariate { name: (*name).to_owned(), values: values.clone() };
        Campaign {
            stations: vec!["S1".to_owned()],
            lines: vec!["L1".to_owned()],
            readings: vec![reading(60.0), reading(60.0 + 5400.0)],
            covariates: temperatures.iter().map(covariate).collect(),
        }
    }

    #[test]
    fn the_range_is_over_all_sensors_and_what_is_missing_has_no_line() {
        let instrument = RangeUncertainty { constant_m: 0.025e-6, per_metre: 0.15e-6, common_per_metre: 0.0 };
        let logged = [
            ("temp_air_c", vec![Some(20.04), None]),
            ("temp_granite_c", vec![Some(19.51), Some(21.26)]),
            ("pressure_hpa", vec![Some(1000.0), Some(1001.0)]),
        ];
        let said = of_campaign(&campaign(&logged), instrument);
        assert_eq!(said[0], ("Declared uncertainty", "of the tracer, 0.050 µm + 0.300 µm/m (k = 2)".to_owned()));
        assert_eq!(said[1], ("Readings", "2 from 1 stations within 1.5 h".to_owned()));
        assert_eq!(said[2], ("Sensors of temperature", "2, 19.5 to 21.3 °C".to_owned()));
        assert_eq!(of_campaign(&campaign(&[]), instrument).len(), 2);
        assert_eq!(of_campaign(&Campaign::default(), instrument).len(), 1);
    }
}
