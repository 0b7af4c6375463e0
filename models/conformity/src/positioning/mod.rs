//! Positioning of a linear axis after ISO 230-2: reversal, repeatability, systematic error, accuracy.
//!
//! Place in the flow: approaches to target positions (m) in, figures of each target and of the axis (m) out. Deviation
//! x = actual − target, as in ISO 230-1 and everywhere in Abbe. Also used along diagonals ([`crate::diagonals`]).
//!
//! Equations (ISO 230-2:2014, for target i, ↑ approached towards larger positions, ↓ towards smaller, n approaches):
//!
//! - x̄_i↑, x̄_i↓ means; s_i↑, s_i↓ standard deviations with n − 1; x̄_i = (x̄_i↑ + x̄_i↓)/2; B_i = x̄_i↑ − x̄_i↓
//! - R_i↑ = 4 s_i↑, R_i↓ = 4 s_i↓, R_i = max(2 s_i↑ + 2 s_i↓ + |B_i|, R_i↑, R_i↓)
//! - B = max |B_i|, B̄ = mean of B_i, R↑ = max R_i↑, R↓ = max R_i↓, R = max R_i
//! - E↑ = max x̄_i↑ − min x̄_i↑, E↓ likewise, E = max(x̄_i↑, x̄_i↓) − min(x̄_i↑, x̄_i↓), M = max x̄_i − min x̄_i
//! - A↑ = max(x̄_i↑ + 2 s_i↑) − min(x̄_i↑ − 2 s_i↑), A↓ likewise, A the same over both directions
//!
//! On more than 2 m (ISO 230-2:2014, 5.3.3) one approach from each direction is enough, at targets 250 mm apart on average; B, E and M are
//! stated then, and neither R nor A.

mod figures;

pub use figures::{AxisFigures, DirectionFigures, TargetFigures};

use crate::departure::Departure;
use crate::error::ConformityError;
use abbe_measurement::positioning::{Approach, Run};
use std::borrow::Borrow;
use std::collections::BTreeMap;

/// Approaches to a target from each direction that the standard asks for.
pub const APPROACHES: usize = 5;
/// Targets an axis at least.
pub const TARGETS: usize = 5;
/// Targets a metre of travel at least.
pub const TARGETS_PER_METRE: f64 = 5.0;
/// Longest travel on which each target is approached five times (m).
pub const LONGEST_M: f64 = 2.0;
/// Mean distance of targets on more than that (m).
pub const LONG_STEP_M: f64 = 0.25;
/// Departure of the targets from equal steps, relative to the step, below which they are equally spaced: no such shift moves a
/// target to another place of a periodic error.
const EQUAL_STEPS: f64 = 0.01;
/// A deviation beyond this is a slip of units, or another target (m).
const PLAUSIBLE_M: f64 = 2e-3;
/// Where the targets of an axis span less than this, they are metres (m): steps within a millimetre or so show a scale, and are
/// no test of an axis.
const SHORTEST_M: f64 = 5e-3;
/// Targets of one position are the same to this (m).
const SAME_TARGET_M: f64 = 1e-6;

/// Figures of one axis; what a run names as its axis is not looked at.
///
/// # Errors
/// No approach; a figure that is not finite; the same approach twice; a deviation of millimetres; fewer than two targets, or all within
/// a few millimetres;
/// a target approached once only from a direction on up to 2 m, so that its scatter is unknown. What else a test after the standard
/// asks for is a departure.
pub fn evaluate<R: Borrow<Run>>(axis: &str, runs: &[R]) -> Result<AxisFigures, ConformityError> {
    let place = format!("axis {axis}");
    let approaches: Vec<&Run> = runs.iter().map(Borrow::borrow).collect();
    if approaches.is_empty() {
        return Err(ConformityError::new(place, "there is no approach", "give measured positions"));
    }
    approaches.iter().try_for_each(|approach| check(&place, approach))?;
    let grouped = by_target(&place, approaches)?;
    if grouped.len() < 2 {
        let remedy = "measure at five targets at least";
        return Err(ConformityError::new(place, "one target is no axis", remedy));
    }
    let travel_m = travel_m(&grouped);
    if travel_m < SHORTEST_M {
        let problem = format!("the targets span {:.4} mm, which is no travel of an axis", travel_m * 1e3);
        return Err(ConformityError::new(place, problem, "multiply the positions by 1000 if they are metres"));
    }
    let targets =
        grouped.iter().map(|group| figures::target(&place, group, is_long(travel_m))).collect::<Result<Vec<_>, _>>()?;
    let departures = departures(&place, &grouped);
    Ok(figures::axis(axis, targets, departures))
}

/// Approaches to one target: deviations (m) by direction.
struct Group {
    target_m: f64,
    up_m: BTreeMap<i64, f64>,
    down_m: BTreeMap<i64, f64>,
}

fn check(place: &str, approach: &Run) -> Result<(), ConformityError> {
    let at = || format!("{place}, target {} mm, cycle {}", approach.target_m * 1e3, approach.cycle);
    if !(approach.target_m.is_finite() && approach.error_m().is_finite()) {
        return Err(ConformityError::new(at(), "target or deviation is not a finite number", "correct or remove it"));
    }
    if approach.error_m().abs() > PLAUSIBLE_M {
        let problem = format!("a deviation of {:.3} mm is that of another target or unit", approach.error_m() * 1e3);
        return Err(ConformityError::new(at(), problem, "check target, measured position and their units"));
    }
    Ok(())
}

fn by_target(place: &str, mut approaches: Vec<&Run>) -> Result<Vec<Group>, ConformityError> {
    approaches.sort_by(|a, b| a.target_m.total_cmp(&b.target_m));
    let mut groups: Vec<Group> = Vec::new();
    for approach in approaches {
        let same = groups.last().is_some_and(|group| approach.target_m - group.target_m <= SAME_TARGET_M);
        if !same {
            groups.push(Group { target_m: approach.target_m, up_m: BTreeMap::new(), down_m: BTreeMap::new() });
        }
        let Some(group) = groups.last_mut() else { continue };
        let own = match approach.approach {
            Approach::Positive => &mut group.up_m,
            Approach::Negative => &mut group.down_m,
        };
        if own.insert(approach.cycle, approach.error_m()).is_some() {
            let at = format!("{place}, target {} mm, cycle {}", approach.target_m * 1e3, approach.cycle);
            let remedy = "number the cycles 1, 2, 3, and give each approach once";
            return Err(ConformityError::new(at, "the approach from this direction stands twice", remedy));
        }
    }
    Ok(groups)
}

/// From the first target to the last (m).
fn travel_m(groups: &[Group]) -> f64 {
    groups.last().map_or(0.0, |last| last.target_m) - groups.first().map_or(0.0, |first| first.target_m)
}

/// Whether one approach from each direction is enough. Two metres that begin elsewhere than at zero are still two metres.
fn is_long(travel_m: f64) -> bool {
    travel_m > LONGEST_M + SAME_TARGET_M
}

fn departures(place: &str, groups: &[Group]) -> Vec<Departure> {
    let mut found = Vec::new();
    let travel_m = travel_m(groups);
    // Rounding of a travel of whole metres must not ask for one target more.
    let asked = match is_long(travel_m) {
        true => 1 + (travel_m / LONG_STEP_M).round() as usize,
        false => TARGETS.max((TARGETS_PER_METRE * travel_m - 1e-9).ceil() as usize),
    };
    if groups.len() < asked {
        let text = format!("{asked} targets are asked for on {:.0} mm, there are {}", travel_m * 1e3, groups.len());
        found.push(Departure::new(place, text));
    }
    let (approaches, times) = if is_long(travel_m) { (1, "once") } else { (APPROACHES, "5 times") };
    let few = groups.iter().filter(|g| g.up_m.len().min(g.down_m.len()) < approaches).count();
    if few > 0 {
        let text = format!("{few} of {} targets were approached fewer than {times} from each direction", groups.len());
        found.push(Departure::new(place, text));
    }
    let only = |is_own: fn(&Group) -> bool| groups.iter().filter(|group| is_own(group)).count();
    let (up, down) = (only(|g| g.down_m.is_empty()), only(|g| g.up_m.is_empty()));
    if up.min(down) > 0 {
        let text = format!(
            "{up} targets were approached upwards alone and {down} downwards alone: a reversal value needs one target for both directions; \
             give what was commanded as the target, the same each way"
        );
        found.push(Departure::new(place, text));
    }
    if let Some(step_m) = equal_step_m(groups) {
        let text = format!(
            "the targets stand in equal steps of {:.3} mm, which hide errors of that period and of its fractions; the standard asks for \
             another random shift at each target",
            step_m * 1e3
        );
        found.push(Departure::new(place, text));
    }
    found
}

/// The step (m) of three or more targets in equal steps.
fn equal_step_m(groups: &[Group]) -> Option<f64> {
    let (first, last) = (groups.first()?, groups.last()?);
    let step_m = (last.target_m - first.target_m) / (groups.len() - 1) as f64;
    let off_m = |(k, group): (usize, &Group)| (group.target_m - first.target_m - k as f64 * step_m).abs();
    let farthest_m = groups.iter().enumerate().map(off_m).fold(0.0, f64::max);
    (groups.len() > 2 && farthest_m < EQUAL_STEPS * step_m).then_some(step_m)
}

#[cfg(test)]
pub(crate) mod tests;
