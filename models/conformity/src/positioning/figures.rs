//! The equations of ISO 230-2, target by target and for the axis.
//!
//! Place in the flow: called by [`super::evaluate`] with checked approaches. All in m.

use super::Group;
use crate::departure::Departure;
use crate::error::ConformityError;
use std::collections::BTreeMap;

/// Mean and scatter of the approaches from one direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DirectionFigures {
    /// Number of approaches n.
    pub approaches: usize,
    /// Mean deviation x̄_i↑ or x̄_i↓ (m).
    pub mean_m: f64,
    /// Standard deviation s_i↑ or s_i↓ with n − 1 (m); one approach has none.
    pub deviation_m: Option<f64>,
}

impl DirectionFigures {
    /// Unidirectional repeatability R_i↑ or R_i↓ = 4 s (m).
    pub fn repeatability_m(&self) -> Option<f64> {
        Some(4.0 * self.deviation_m?)
    }

    /// x̄ − 2s and x̄ + 2s (m).
    pub fn bounds_m(&self) -> Option<(f64, f64)> {
        let half_m = 2.0 * self.deviation_m?;
        Some((self.mean_m - half_m, self.mean_m + half_m))
    }
}

/// One target; what needs both directions is missing where only one was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetFigures {
    /// Target position (m).
    pub target_m: f64,
    /// Approaches towards larger positions (↑).
    pub up: Option<DirectionFigures>,
    /// Approaches towards smaller positions (↓).
    pub down: Option<DirectionFigures>,
}

impl TargetFigures {
    /// Mean bidirectional deviation x̄_i (m).
    pub fn mean_m(&self) -> Option<f64> {
        Some((self.up?.mean_m + self.down?.mean_m) / 2.0)
    }

    /// Reversal error B_i (m), with sign.
    pub fn reversal_m(&self) -> Option<f64> {
        Some(self.up?.mean_m - self.down?.mean_m)
    }

    /// Bidirectional repeatability R_i (m).
    pub fn repeatability_m(&self) -> Option<f64> {
        let (up, down) = (self.up?, self.down?);
        let both = 2.0 * up.deviation_m? + 2.0 * down.deviation_m? + self.reversal_m()?.abs();
        Some(both.max(up.repeatability_m()?).max(down.repeatability_m()?))
    }
}

/// One axis or diagonal; bidirectional figures are missing unless every target was approached from both directions, repeatabilities and
/// accuracies where one was approached once.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisFigures {
    /// Name.
    pub axis: String,
    /// Targets in ascending order.
    pub targets: Vec<TargetFigures>,
    /// Reversal error of the axis B = max |B_i| (m).
    pub reversal_m: Option<f64>,
    /// Mean reversal error B̄ (m), with sign.
    pub mean_reversal_m: Option<f64>,
    /// Unidirectional repeatability R↑ (m).
    pub repeatability_up_m: Option<f64>,
    /// Unidirectional repeatability R↓ (m).
    pub repeatability_down_m: Option<f64>,
    /// Bidirectional repeatability R (m).
    pub repeatability_m: Option<f64>,
    /// Unidirectional systematic positioning error E↑ (m).
    pub systematic_up_m: Option<f64>,
    /// Unidirectional systematic positioning error E↓ (m).
    pub systematic_down_m: Option<f64>,
    /// Bidirectional systematic positioning error E (m).
    pub systematic_m: Option<f64>,
    /// Mean bidirectional positioning error M (m).
    pub mean_bidirectional_m: Option<f64>,
    /// Unidirectional positioning accuracy A↑ (m).
    pub accuracy_up_m: Option<f64>,
    /// Unidirectional positioning accuracy A↓ (m).
    pub accuracy_down_m: Option<f64>,
    /// Bidirectional positioning accuracy A (m).
    pub accuracy_m: Option<f64>,
    /// What a whole test after the standard has and these data lack.
    pub departures: Vec<Departure>,
}

/// Figures of one target; `is_once_enough` where the standard asks for one approach from each direction.
pub(super) fn target(place: &str, group: &Group, is_once_enough: bool) -> Result<TargetFigures, ConformityError> {
    let of = |word: &str, deviations_m: &BTreeMap<i64, f64>| {
        let at = format!("{place}, target {} mm, approached {word}", group.target_m * 1e3);
        direction(&at, deviations_m, is_once_enough)
    };
    Ok(TargetFigures {
        target_m: group.target_m,
        up: of("upwards", &group.up_m)?,
        down: of("downwards", &group.down_m)?,
    })
}

fn direction(
    place: &str,
    deviations_m: &BTreeMap<i64, f64>,
    is_once_enough: bool,
) -> Result<Option<DirectionFigures>, ConformityError> {
    let n = deviations_m.len();
    if n == 0 {
        return Ok(None);
    }
    if n == 1 && !is_once_enough {
        let remedy = "measure five cycles; the standard deviation needs two at least";
        return Err(ConformityError::new(place, "one approach has no scatter", remedy));
    }
    let mean_m = deviations_m.values().sum::<f64>() / n as f64;
    let sum = deviations_m.values().map(|x| (x - mean_m).powi(2)).sum::<f64>();
    let deviation_m = (n > 1).then(|| (sum / (n - 1) as f64).sqrt());
    Ok(Some(DirectionFigures { approaches: n, mean_m, deviation_m }))
}

/// Figures of the axis from those of its targets.
pub(super) fn axis(axis: &str, targets: Vec<TargetFigures>, departures: Vec<Departure>) -> AxisFigures {
    let up: Option<Vec<DirectionFigures>> = targets.iter().map(|t| t.up).collect();
    let down: Option<Vec<DirectionFigures>> = targets.iter().map(|t| t.down).collect();
    let both: Option<Vec<DirectionFigures>> =
        up.as_ref().zip(down.as_ref()).map(|(up, down)| up.iter().chain(down).copied().collect());
    let reversals: Option<Vec<f64>> = targets.iter().map(TargetFigures::reversal_m).collect();
    let means: Option<Vec<f64>> = targets.iter().map(TargetFigures::mean_m).collect();
    let repeatabilities: Option<Vec<f64>> = targets.iter().map(TargetFigures::repeatability_m).collect();
    let mean = |values: &Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
    AxisFigures {
        axis: axis.to_owned(),
        reversal_m: reversals.as_ref().map(|b| largest(b.iter().map(|b| b.abs()))),
        mean_reversal_m: reversals.as_ref().map(mean),
        repeatability_up_m: up.as_deref().and_then(unidirectional_repeatability_m),
        repeatability_down_m: down.as_deref().and_then(unidirectional_repeatability_m),
        repeatability_m: repeatabilities.map(|r| largest(r.into_iter())),
        systematic_up_m: up.as_deref().map(systematic_m),
        systematic_down_m: down.as_deref().map(systematic_m),
        systematic_m: both.as_deref().map(systematic_m),
        mean_bidirectional_m: means.map(|x| largest(x.iter().copied()) - smallest(x.iter().copied())),
        accuracy_up_m: up.as_deref().and_then(accuracy_m),
        accuracy_down_m: down.as_deref().and_then(accuracy_m),
        accuracy_m: both.as_deref().and_then(accuracy_m),
        targets,
        departures,
    }
}

fn unidirectional_repeatability_m(figures: &[DirectionFigures]) -> Option<f64> {
    let each: Option<Vec<f64>> = figures.iter().map(DirectionFigures::repeatability_m).collect();
    Some(largest(each?.into_iter()))
}

fn systematic_m(figures: &[DirectionFigures]) -> f64 {
    largest(figures.iter().map(|f| f.mean_m)) - smallest(figures.iter().map(|f| f.mean_m))
}

fn accuracy_m(figures: &[DirectionFigures]) -> Option<f64> {
    let bounds_m = figures.iter().map(DirectionFigures::bounds_m).collect::<Option<Vec<_>>>()?;
    Some(largest(bounds_m.iter().map(|b| b.1)) - smallest(bounds_m.iter().map(|b| b.0)))
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(f64::NEG_INFINITY, f64::max)
}

fn smallest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(f64::INFINITY, f64::min)
}
