//! Columns with holes: which readings a diagnosis can use where a sensor dropped out now and then.
//!
//! Place in the flow: before [`crate::diagnose()`], which tests a covariate only where every reading has it. A column with a
//! few holes would be no candidate at all, and what it did would be laid to something else (a station that drifts, another
//! sensor). A reading without it cannot tell for or against, so it is left out; a column is used so only if that costs no
//! station more than a fifth of its readings.

use abbe_measurement::campaign::Campaign;

/// Share of its readings that a station may lose to the holes of all columns together.
const MOST_LOST: f64 = 0.2;

/// The readings of a campaign that have all its columns, and what was left out for it, in words.
#[derive(Debug, Clone, PartialEq)]
pub struct Complete {
    /// Readings to diagnose.
    pub campaign: Campaign,
    /// What was left out.
    pub said: Vec<String>,
}

/// Leaves out readings in the holes of columns that have few; columns with many stay as they are, and are no covariate.
pub fn without_holes(campaign: &Campaign) -> Complete {
    let mut kept = vec![true; campaign.readings.len()];
    let mut said = Vec::new();
    let mut columns: Vec<(usize, &str, Vec<bool>)> = Vec::new();
    for column in &campaign.covariates {
        let there: Vec<bool> = column.values.iter().map(Option::is_some).collect();
        let holes = there.iter().filter(|there| !**there).count();
        if holes > 0 {
            columns.push((holes, &column.name, there));
        }
    }
    // Fewest first, so that one bad sensor does not cost the good ones.
    columns.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.cmp(b.1)));
    for (holes, name, there) in columns {
        let both: Vec<bool> = kept.iter().zip(&there).map(|(a, b)| *a && *b).collect();
        if costs_too_much(campaign, &both) {
            said.push(format!("{name} is not used: {holes} of {} readings lack it", kept.len()));
        } else {
            said.push(format!("{holes} readings that lack {name} are left out"));
            kept = both;
        }
    }
    if kept.iter().all(|kept| *kept) {
        return Complete { campaign: campaign.clone(), said };
    }
    let indices: Vec<usize> = (0..kept.len()).filter(|k| kept[*k]).collect();
    Complete { campaign: campaign.part(&indices), said }
}

fn costs_too_much(campaign: &Campaign, kept: &[bool]) -> bool {
    let mut counts = vec![(0_usize, 0_usize); campaign.stations.len()];
    for (reading, kept) in campaign.readings.iter().zip(kept) {
        let (all, lost) = &mut counts[reading.station as usize];
        *all += 1;
        *lost += usize::from(!kept);
    }
    counts.into_iter().any(|(all, lost)| lost as f64 > MOST_LOST * all as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_measurement::campaign::{Covariate, RangeReading};

    fn campaign(columns: &[(&str, &dyn Fn(usize) -> bool)]) -> Campaign {
        let reading = |k: usize| RangeReading {
            station: (k / 50) as u32,
            line: (k / 10) as u32,
            time_s: k as f64,
            reading_m: [0.0; 3],
            offset_m: [0.0; 3],
            length_m: 0.0,
        };
        let column = |(name, there): &(&str, &dyn Fn(usize) -> bool)| Covariate {
            name: (*name).to_owned(),
            values: (0..100).map(|k| there(k).then_some(k as f64)).collect(),
        };
        Campaign {
            stations: ["S1", "S2"].map(str::to_owned).to_vec(),
            lines: (0..10).map(|k| k.to_string()).collect(),
            readings: (0..100).map(reading).collect(),
            covariates: columns.iter().map(column).collect(),
        }
    }

    #[test]
    fn readings_in_a_few_holes_are_left_out_and_said() {
        let complete = without_holes(&campaign(&[("a_c", &|k| k % 25 != 0), ("b_c", &|_| true)]));
        assert_eq!(complete.campaign.readings.len(), 96);
        assert!(complete.campaign.covariates.iter().all(|c| c.values.iter().all(Option::is_some)));
        assert_eq!(complete.said, ["4 readings that lack a_c are left out"]);
    }

    #[test]
    fn a_sensor_that_failed_at_a_station_costs_no_reading() {
        let whole = campaign(&[("a_c", &|k| k < 60), ("b_c", &|k| k != 7)]);
        let complete = without_holes(&whole);
        assert_eq!(complete.campaign.readings.len(), 99);
        assert!(complete.said[1].starts_with("a_c is not used: 40 of 100"), "{:?}", complete.said);
        assert_eq!(without_holes(&campaign(&[("b_c", &|_| true)])).said, [""; 0]);
    }
}
