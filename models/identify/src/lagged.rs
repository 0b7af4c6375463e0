//! Campaigns with lagged covariates, and sides that follow over a travel, beside what was logged.
//!
//! Place in the flow: before a campaign meets a model, or a search, that asks for them. Times in s, values in the unit of the name.

use abbe_geometry::effects::{Lag, Travel, of_lagged};
use abbe_measurement::campaign::{Campaign, Covariate, RangeReading};

/// Longest pause across which what is logged is taken to run straight (s): a tracer is moved to its next station.
const PAUSE_S: f64 = 1800.0;

/// The campaign with these derived covariates beside what was logged. One that is there already stays; a lagged one without its logged
/// quantity, or with a pause longer than half an hour and than the time constant, is left out, and a side over a travel where time goes back: nobody knows the
/// order then. Names of other covariates ask for nothing.
pub fn with_lagged<'a>(mut campaign: Campaign, names: impl IntoIterator<Item = &'a String>) -> Campaign {
    for name in names {
        let values = match campaign.covariate(name) {
            Some(_) => None,
            None => lagged(&campaign, name).or_else(|| travelled(&campaign, name)),
        };
        if let Some(values) = values {
            campaign.covariates.push(Covariate { name: name.clone(), values });
        }
    }
    campaign
}

/// A machine is taken to have been for a long time as its first value says; what a cold start leaves is a warm-up.
fn lagged(campaign: &Campaign, name: &str) -> Option<Vec<Option<f64>>> {
    let (logged, lag_s) = of_lagged(name)?;
    let inputs = &campaign.covariate(&logged)?.values;
    let mut lag = Lag::across(f64::from(lag_s), PAUSE_S);
    let mut values = Vec::with_capacity(inputs.len());
    for (reading, input) in campaign.readings.iter().zip(inputs) {
        let lagged = lag.push(reading.time_s, input.filter(|value| value.is_finite())?);
        if lagged.is_new && !values.is_empty() {
            return None;
        }
        values.push(Some(lagged.value));
    }
    Some(values)
}

/// The side of an axis over its travel, from the readings in their order. What the axis did between two of them is taken to be straight.
fn travelled(campaign: &Campaign, name: &str) -> Option<Vec<Option<f64>>> {
    let mut travel = Travel::of(name)?;
    let is_in_order = campaign.readings.windows(2).all(|pair| pair[1].time_s >= pair[0].time_s);
    let logged = campaign.covariate(travel.logged_side());
    let side = |(k, reading): (usize, &RangeReading)| {
        let logged = logged.and_then(|column| column.values.get(k).copied().flatten());
        travel.push(reading.reading_m, logged).map(|now| Some(now.side))
    };
    if is_in_order { campaign.readings.iter().enumerate().map(side).collect() } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AT_REST: RangeReading =
        RangeReading { station: 0, line: 0, time_s: 0.0, reading_m: [0.0; 3], offset_m: [0.0; 3], length_m: 0.0 };

    fn campaign(times_s: &[f64], values: &[Option<f64>]) -> Campaign {
        let reading = |time_s: &f64| RangeReading { time_s: *time_s, ..AT_REST };
        Campaign {
            readings: times_s.iter().map(reading).collect(),
            covariates: vec![Covariate { name: "temp_air_c".to_owned(), values: values.to_vec() }],
            ..Campaign::default()
        }
    }

    #[test]
    fn a_campaign_gets_the_side_over_a_travel_where_its_order_is_known() {
        let name = &["dir_x_over_1000um".to_owned()];
        let mut walked = campaign(&[0.0, 1.0, 2.0], &[None; 3]);
        (walked.readings[1].reading_m, walked.readings[2].reading_m) = ([0.1, 0.0, 0.0], [0.099, 0.0, 0.0]);
        let sides = with_lagged(walked.clone(), name).covariate(&name[0]).unwrap().values.clone();
        let expected = [0.0, 1.0, 2.0 * (-1.0_f64).exp() - 1.0];
        assert!(
            sides.iter().zip(expected).all(|(side, expected)| (side.unwrap() - expected).abs() < 1e-12),
            "{sides:?}"
        );
        walked.readings[2].time_s = 0.5;
        assert_eq!(with_lagged(walked, name).covariate(&name[0]), None);
    }

    #[test]
    fn a_campaign_gets_the_lagged_column_that_it_can_have() {
        let whole = campaign(&[0.0, 600.0, 1200.0], &[Some(20.0), Some(21.0), Some(21.0)]);
        let with =
            with_lagged(whole, &["temp_air_lag_600s_c", "temp_room_lag_600s_c", "temp_air_c"].map(str::to_owned));
        assert_eq!(with.covariates.len(), 2);
        let values = &with.covariate("temp_air_lag_600s_c").unwrap().values;
        // 1 K in one time constant, straight: 1 − (1 − e^−1) of it is there at its end.
        let after = values[1].unwrap();
        assert!((after - 20.0 - (-1.0_f64).exp()).abs() < 1e-12, "{after}");
        let name = &["temp_air_lag_600s_c".to_owned()];
        let moved = with_lagged(campaign(&[0.0, 600.0, 2000.0], &[Some(20.0); 3]), name);
        assert_eq!(moved.covariates.len(), 2, "a station is moved in that time");
        let paused = with_lagged(campaign(&[0.0, 600.0, 2401.0], &[Some(20.0); 3]), name);
        assert_eq!(paused.covariates.len(), 1, "what happened in a pause nobody knows");
        let hole = with_lagged(campaign(&[0.0, 600.0], &[Some(20.0), None]), name);
        assert_eq!(hole.covariates.len(), 1);
    }
}
