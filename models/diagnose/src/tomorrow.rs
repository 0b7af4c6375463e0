//! What will not be the same tomorrow: explanations that are only a course in time, without a cause.
//!
//! Place in the flow: the last step of [`crate::diagnose()`], on the model that is adopted. A term that follows the time in a form
//! that nobody has a name for explains the readings at hand, and cleans errors and stations of what it did; of the time at which a
//! coordinate is corrected it knows nothing. What it did then acts there as well, unseen: its mean square counts as
//! unexplained. The same holds for a term without a name that follows a logged quantity, where that quantity itself went along with the
//! time: the data do not tell which. So does that of named terms in time beside it, or beside a correlated rest, since one tracer after the other
//! cannot tell a drift of its stand from one of the machine, and both say that there is something like it; the motion of a stand alone
//! counts so where no two stations measured at the same time. Ranges in m; a motion of the tip counts three times its
//! mean square on the ranges, which see one direction of three. Where stands move, the zero of the machine may have moved instead, and goes on from
//! station to station: along each axis U holds at least that. Not so where a stand jumped along two axes at once: a scale that loses counts is one
//! axis, and whoever bumps the whole machine moves the part on its table with it.

use crate::candidates::Round;
use crate::columns::range;
use crate::context::{follows_time, in_turn, read_by};
use crate::gate;
use crate::linear::Linear;
use crate::same_claim::is_of;
use abbe_geometry::effects::{CovariateSource, CovariateValue, Ray, ShapeValue, Sight, State, of_lagged};
use abbe_geometry::model::{FittedEffect, MachineModel, ModelError};
use abbe_geometry::{Axis, Vector3};
use abbe_identify::{EffectTerm, TIME};
use abbe_measurement::campaign::{Campaign, RangeReading};
use faer::Mat;

/// Directions that a motion of the tip has and a range does not see, and the one that it sees.
pub(crate) const DIRECTIONS: f64 = 3.0;
/// Coefficients of a smooth course in time: a cubic.
const COURSE: usize = 4;
/// Share of a growth between two readings from which it is as well a step.
const IN_A_PAUSE: f64 = 0.5;
/// Share of a growth still to come at the last reading from which nobody has seen it come to rest.
const STILL_TO_COME: f64 = 0.2;
/// Share of a quantity's variance beside its course in time below which both are alike.
const ALIKE: f64 = 0.1;

/// Says of a term of a model whether it is one of some.
type Is<'a> = &'a dyn Fn(&FittedEffect) -> bool;

/// The model with what follows the time in its uncertainty; `is_found` says which of its terms the diagnosis added, `is_bump` which of them can
/// only be a bump of a stand.
pub(crate) fn told(
    model: MachineModel,
    round: &Round,
    campaign: &Campaign,
    (is_found, is_bump): (Is, Is),
) -> Result<MachineModel, ModelError> {
    let may_be_the_machine = |fitted: &FittedEffect| moves_stand(fitted, campaign) && !is_bump(fitted);
    let found: Vec<&FittedEffect> = model.parts().effects.iter().filter(|fitted| is_found(fitted)).collect();
    let is_open = round.rows.correlation.is_some() || found.iter().any(|fitted| is_course(fitted, campaign));
    let is_in_doubt = |fitted: &FittedEffect| {
        is_course(fitted, campaign)
            || happened_in_a_pause(fitted, campaign)
            || follows_time(fitted.effect.as_ref(), &fitted.shape) && (is_open || may_be_the_machine(fitted))
    };
    let squares = found.into_iter().filter(|fitted| is_in_doubt(fitted)).map(|fitted| {
        let directions = if gate::moves_tip(campaign, &[EffectTerm::of(fitted)]) { DIRECTIONS } else { 1.0 };
        directions * on_range_m2(round, campaign, fitted)
    });
    let doubted_m = squares.sum::<f64>().sqrt();
    let effects = model.parts().effects.iter();
    let moving: Vec<&FittedEffect> = effects.filter(|own| is_found(own) && may_be_the_machine(own)).collect();
    let moved_m = zero_instead_m(&moving, campaign);
    let unexplained_m = model.parts().quality.unexplained_m;
    model.with_unexplained(std::array::from_fn(|d| unexplained_m[d].hypot(doubted_m.max(moved_m[d]))))
}

/// Standard deviation of the place of the machine's zero over the readings, along each axis (m), if it moved in the place of the stands: to a
/// station both are the same, and where the next begins, the zero is where the last one left it.
fn zero_instead_m(moving: &[&FittedEffect], campaign: &Campaign) -> [f64; 3] {
    let mut order: Vec<&RangeReading> = campaign.readings.iter().collect();
    order.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    let mut place_m = Vector3::zeros();
    let mut last: Option<(u32, Vector3<f64>)> = None;
    let mut places_m: Vec<Vector3<f64>> = Vec::with_capacity(order.len());
    for reading in order {
        let stand_m = stand_m(moving, campaign, reading);
        if let Some((_, before_m)) = last.filter(|(station, _)| *station == reading.station) {
            place_m -= stand_m - before_m;
        }
        last = Some((reading.station, stand_m));
        places_m.push(place_m);
    }
    let count = places_m.len().max(1) as f64;
    let mean_m = places_m.iter().sum::<Vector3<f64>>() / count;
    let square_m2 = places_m.iter().map(|own| (own - mean_m).component_mul(&(own - mean_m))).sum::<Vector3<f64>>();
    std::array::from_fn(|d| (square_m2[d] / count).sqrt())
}

/// Where the stand of a reading's station is at its time, as effects have it (m, from where the fit has the station).
fn stand_m(moving: &[&FittedEffect], campaign: &Campaign, reading: &RangeReading) -> Vector3<f64> {
    let state = State { reading_m: reading.reading_m, offset_m: reading.offset_m, covariates: &Time(reading.time_s) };
    let (station, line) = (&campaign.stations[reading.station as usize], &campaign.lines[reading.line as usize]);
    let along = |axis: Axis| {
        let sight = Sight { station, line, ray: Ray { direction: axis.direction(), range_m: 1.0 } };
        let mut away_m = 0.0;
        for fitted in moving {
            // A stand reads the time alone, and that is there.
            let _ = fitted.effect.range(&state, &sight, &mut |k, part| away_m -= part * fitted.parameters[k]);
        }
        away_m
    };
    let [x, y, z] = Axis::ALL.map(along);
    Vector3::new(x, y, z)
}

/// The time of a reading, as effects read it.
struct Time(f64);

impl CovariateSource for Time {
    fn covariate(&self, name: &str) -> CovariateValue {
        if name == TIME { CovariateValue::Fresh(self.0) } else { CovariateValue::Missing }
    }
}

/// Whether an effect is only a course in time without a cause: it is in the uncertainty and not in the correction, since the time of a
/// campaign is not that of a coordinate. What has no name and follows a logged quantity that itself went along with the time is not
/// told from one.
pub(crate) fn is_course(fitted: &FittedEffect, campaign: &Campaign) -> bool {
    let reads = || read_by(fitted.effect.as_ref(), &fitted.shape);
    has_no_name(fitted)
        && (follows_time(fitted.effect.as_ref(), &fitted.shape)
            || reads().iter().any(|name| goes_along_with_time(campaign, name)))
}

/// Whether a term that is none of these is only a course in time.
pub(crate) fn is_course_beside(base: &[EffectTerm], fitted: &FittedEffect, campaign: &Campaign) -> bool {
    !is_of(base, fitted) && is_course(fitted, campaign)
}

/// Whether a growth that comes to rest did most of it while nothing was measured, overnight or while the tracer was moved: a step would leave
/// the same readings, and nobody knows when it was.
pub(crate) fn happened_in_a_pause(fitted: &FittedEffect, campaign: &Campaign) -> bool {
    let Some(tau_s) = time_constant_s(fitted) else { return false };
    let mut grown: Vec<f64> = campaign.readings.iter().map(|reading| -(-reading.time_s / tau_s).exp_m1()).collect();
    grown.sort_by(f64::total_cmp);
    let whole = grown.last().zip(grown.first()).map_or(0.0, |(last, first)| last - first);
    let between = grown.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
    between > IN_A_PAUSE * whole
}

/// Why a growth with time stays out that was still going on at the last reading: of a time constant as long as the campaign little but a
/// straight line is seen, and whatever went along with the time is the same, a room that gets warm above all. It may be described as a course.
pub(crate) fn still_growing(fitted: &FittedEffect, campaign: &Campaign) -> Option<String> {
    let last_s = campaign.readings.iter().map(|reading| reading.time_s).fold(0.0, f64::max);
    let to_come = (-last_s / time_constant_s(fitted)?).exp();
    (to_come > STILL_TO_COME).then(|| {
        format!(
            "at the last reading {:.0} % of it were still to come: whatever went along with the time, such as a room that gets warm, looks the same",
            100.0 * to_come
        )
    })
}

/// Time constant (s) of a growth that comes to rest; `None` of any other effect.
fn time_constant_s(fitted: &FittedEffect) -> Option<f64> {
    match fitted.shape.0.get("tau_s") {
        Some(ShapeValue::Number(tau_s)) if follows_time(fitted.effect.as_ref(), &fitted.shape) => Some(*tau_s),
        _ => None,
    }
}

/// Whether a logged quantity is a smooth course in time, but for a tenth of its variance. What follows it follows another smooth course
/// about as well.
fn goes_along_with_time(campaign: &Campaign, name: &str) -> bool {
    let logged = of_lagged(name).map_or_else(|| name.to_owned(), |(logged, _)| logged);
    let Some(column) = campaign.covariate(&logged) else { return false };
    let known = column.values.iter().zip(&campaign.readings).filter_map(|(value, r)| Some((r.time_s, (*value)?)));
    let (times_s, values): (Vec<f64>, Vec<f64>) = known.unzip();
    let (first_s, last_s) = range(times_s.iter().copied());
    if times_s.len() <= COURSE || last_s <= first_s {
        return false;
    }
    let scaled = |k: usize| 2.0 * (times_s[k] - first_s) / (last_s - first_s) - 1.0;
    let powers = Mat::from_fn(times_s.len(), COURSE, |k, j| scaled(k).powi(j as i32));
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let about: Vec<f64> = values.iter().map(|value| value - mean).collect();
    let whole: f64 = about.iter().map(|value| value * value).sum();
    Linear::least_squares(powers, &about).is_ok_and(|(fit, _)| fit.chi2() < ALIKE * whole)
}

/// Whether an effect moves the stands of tracers in time, of which no two measured together: to one after the other, a machine that
/// turns on its bed in that time is the same, whatever the sights.
fn moves_stand(fitted: &FittedEffect, campaign: &Campaign) -> bool {
    fitted.effect.moves_stand() && in_turn(campaign)
}

fn has_no_name(fitted: &FittedEffect) -> bool {
    ["p", "q"].into_iter().any(|key| fitted.shape.0.contains_key(key))
}

/// Variance of what an effect does to the ranges used (m²), about the mean of each station, which place and dead path hold.
fn on_range_m2(round: &Round, campaign: &Campaign, fitted: &FittedEffect) -> f64 {
    let Ok(values_m) = round.on_ranges_m(fitted) else { return 0.0 };
    let mut stations = vec![(0.0_f64, 0.0_f64, 0.0_f64); campaign.stations.len()];
    for (k, value) in values_m {
        let (count, sum, square) = &mut stations[campaign.readings[k].station as usize];
        (*count, *sum, *square) = (*count + 1.0, *sum + value, *square + value * value);
    }
    let about = |(count, sum, square): &(f64, f64, f64)| (square - sum * sum / count.max(1.0)).max(0.0);
    let count: f64 = stations.iter().map(|(count, ..)| count).sum();
    stations.iter().map(about).sum::<f64>() / count.max(1.0)
}
