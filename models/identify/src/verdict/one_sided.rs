//! Whether a campaign saw both sides of approach, and any temperature: what it did not see is in no uncertainty.
//!
//! Place in the flow: from the campaign alone.

use super::{Finding, Grade, Subject};
use crate::unseen_expansion::logged_temperatures;
use abbe_geometry::Axis;
use abbe_measurement::campaign::Campaign;

/// Axes that moved and whose points were all approached from one side, as far as sides were logged.
pub(super) fn one_sided(campaign: &Campaign) -> Option<Finding> {
    let axes: Vec<char> =
        Axis::ALL.into_iter().filter(|axis| is_one_sided(campaign, *axis)).map(Axis::letter).collect();
    let finding = |axes| Finding { grade: Grade::Message, subject: Subject::OneSided { axes }, causes: Vec::new() };
    (!axes.is_empty()).then(|| finding(axes))
}

fn is_one_sided(campaign: &Campaign, axis: Axis) -> bool {
    let name = ["dir_x", "dir_y", "dir_z"][axis.index()];
    let Some(column) = campaign.covariate(name) else { return false };
    let mut sides = column.values.iter().flatten().filter(|side| **side != 0.0).map(|side| side.is_sign_positive());
    let places = || campaign.readings.iter().map(|reading| reading.reading_m[axis.index()]);
    let moved = places().zip(places().skip(1)).any(|(before, after)| before != after);
    sides.next().is_some_and(|first| sides.all(|side| side == first)) && moved
}

/// A campaign without any temperature.
pub(super) fn no_temperature(campaign: &Campaign) -> Option<Finding> {
    logged_temperatures(campaign).next().is_none().then(|| Finding {
        grade: Grade::Message,
        subject: Subject::NoTemperature,
        causes: Vec::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_measurement::campaign::{Covariate, RangeReading};

    fn campaign(columns: &[(&str, [f64; 4])]) -> Campaign {
        let reading = |k: u32| RangeReading {
            station: 0,
            line: 0,
            time_s: f64::from(k),
            reading_m: [f64::from(k), 0.1, f64::from(k % 2)],
            offset_m: [0.0; 3],
            length_m: 0.0,
        };
        let covariate = |(name, values): &(&str, [f64; 4])| Covariate {
            name: (*name).to_owned(),
            values: values.iter().map(|value| Some(*value)).collect(),
        };
        let covariates = columns.iter().map(covariate).collect();
        Campaign { readings: (0..4).map(reading).collect(), covariates, ..Campaign::default() }
    }

    #[test]
    fn axes_that_moved_and_were_seen_from_one_side_are_named() {
        let sides = [("dir_x", [1.0; 4]), ("dir_y", [-1.0; 4]), ("dir_z", [1.0, -1.0, 1.0, 0.0])];
        let subject = one_sided(&campaign(&sides)).unwrap().subject;
        assert_eq!(subject, Subject::OneSided { axes: vec!['X'] }, "Y did not move");
        assert_eq!(one_sided(&campaign(&[])), None, "nothing is known of sides");
    }

    #[test]
    fn a_campaign_without_any_temperature_says_so() {
        assert!(no_temperature(&campaign(&[("dir_x", [1.0; 4])])).is_some());
        assert_eq!(no_temperature(&campaign(&[("temp_air_c", [20.0; 4])])), None);
    }
}
