//! Is what follows the room told while a station stands, or only from one station to the next?
//!
//! Place in the flow: beside the gate, before [`crate::search`] adopts an effect that reads what the room does by itself. Where one tracer
//! stands in one place after the other, whatever is wrong at each place for a reason of its own (a floor that gives way, a path of
//! the air) is a value a station. Of some hundred courses of the room one follows so few values. So the effect, in the size that
//! was fitted, is tested beside itself with the room as it was on average at each station: what is left is seen by one station alone.
//! A growth with time that nobody has seen come to rest is such a course without a sensor, and stays out.

use crate::candidates::Round;
use crate::context::{in_turn, is_of_the_room, read_by};
use crate::error::DiagnoseError;
use crate::score::score_of;
use crate::search::Search;
use crate::tomorrow::still_growing;
use abbe_geometry::effects::of_lagged;
use abbe_geometry::model::FittedEffect;
use abbe_identify::{Identified, Rows};
use abbe_measurement::campaign::{Campaign, Covariate};
use faer::Mat;

/// Why an effect stays out; `None` where stations tell it by themselves, or where it follows neither the room nor the time. `before` is the
/// fit without it.
pub(crate) fn refusal(
    search: &Search,
    (before, round): (&Identified, &Round),
    fitted: &FittedEffect,
) -> Result<Option<String>, DiagnoseError> {
    let campaign = search.campaign;
    if let Some(because) = still_growing(fitted, campaign) {
        return Ok(Some(because));
    }
    let follows = |name: &String| is_of_the_room(name) || of_lagged(name).is_some();
    let read: Vec<String> =
        read_by(fitted.effect.as_ref(), &fitted.shape).into_iter().filter(|name| follows(name)).collect();
    if read.is_empty() || !in_turn(campaign) {
        return Ok(None);
    }
    let levelled = levelled(campaign, &read);
    let on_average = effect(&Rows::new(before, search.instrument, &levelled), fitted)?;
    // What the machine's own errors hold takes nothing away from what single stations tell.
    let Ok(beside) = round.free.widened(&[on_average], round.used) else { return Ok(None) };
    let own = effect(&round.rows, fitted)?;
    let score = score_of(&beside, own.as_ref());
    // What single stations tell pays for all figures of the effect: they were fitted to all stations together.
    let price = fitted.parameters.len() as f64 * (round.used.max(2) as f64).ln();
    let is_told = score.estimate.iter().all(|size| *size > 0.0) && score.gain > price;
    Ok((!is_told).then(|| {
        "it is told from one station to the next only: what each place has of its own looks the same".to_owned()
    }))
}

/// What a fitted effect does to the whitened rows.
fn effect(rows: &Rows, fitted: &FittedEffect) -> Result<Mat<f64>, DiagnoseError> {
    let columns = rows.columns(fitted.effect.as_ref())?;
    let sum = |row: usize| fitted.parameters.iter().enumerate().map(|(j, value)| columns[(row, j)] * value).sum();
    Ok(Mat::from_fn(columns.nrows(), 1, |row, _| sum(row)))
}

/// The campaign with these quantities as they were on average while each station stood.
fn levelled(campaign: &Campaign, names: &[String]) -> Campaign {
    let level = |column: &Covariate| -> Covariate {
        if !names.contains(&column.name) {
            return column.clone();
        }
        let mut sums = vec![(0.0, 0.0); campaign.stations.len()];
        for (reading, value) in campaign.readings.iter().zip(&column.values) {
            if let (Some((count, sum)), Some(value)) = (sums.get_mut(reading.station as usize), value) {
                (*count, *sum) = (*count + 1.0, *sum + value);
            }
        }
        let mean = |station: u32| sums.get(station as usize).map(|(count, sum)| sum / count);
        let values =
            campaign.readings.iter().zip(&column.values).map(|(reading, value)| value.and(mean(reading.station)));
        Covariate { name: column.name.clone(), values: values.collect() }
    };
    Campaign { covariates: campaign.covariates.iter().map(level).collect(), ..campaign.clone() }
}
