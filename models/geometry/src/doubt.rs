//! What an effect may do where it cannot be evaluated, or where nobody has seen it: the part of the uncertainty that no
//! fit knows of.
//!
//! Place in the flow: [`crate::correct`] and [`crate::predict`] add these covariances (m²) to what the model's own says. All
//! of it rests on the range in which each covariate was identified, and on the effect with its fitted parameters.
//!
//! **Left open** (a covariate is missing or stale): the effect is evaluated on a grid over the usual range of the covariates that are
//! lacking. What is published has them in the middle of their ranges, and the effect not at zero: at the 20 °C of a law nobody may have
//! measured. What it does beside that is covered: no distribution of covariates over that range has a larger mean square, in any direction. A
//! sign of approach or a load that is on or off does stand at the ends of its range, where a uniform distribution would allow too little.
//!
//! **Outside** (a covariate beyond its usual range): nothing that was measured supports the law there. What it adds beyond
//! the end of the range counts in full as uncertainty. A law that is held at the end of its range adds nothing there: what counts is how the
//! parabola through both ends and the middle of the range goes on. Some laws saturate, and add
//! next to nothing; so the effect may also have changed by as much as it does over its range, in the share to which the
//! distance is of that range, from one width on in full.
//!
//! **Apart** (two temperatures stand further from each other than in the campaign): the effect may follow the other one, so what it
//! does by the part of the difference that was not seen counts in full, that of the sensor with which it is largest.

use crate::effects::{CovariateSource, CovariateValue, State};
use crate::seen::{Apart, is_implausible};
use crate::usual::Usual;
use nalgebra::{Matrix3, Vector3};
use smallvec::SmallVec;

/// Places a grid has at most.
const GRID: usize = 625;
/// Most covariates that an effect may lack: a grid over more has no two places for each.
const MOST_LACKING: usize = 9;
/// Places along one covariate at most.
const LEVELS: usize = 9;
/// The same for what varies as the square of a motion: its ends and its middle.
const FEW_LEVELS: usize = 3;
/// Variance that the cover starts from in every direction, relative to the largest motion's: keeps it invertible.
const FLOOR: f64 = 1e-9;

/// Whether any of these covariates that can be read lies outside its range, or has none.
pub(crate) fn is_outside(usual: &[Usual], state: &State) -> bool {
    is_outside_or_none(usual, state).unwrap_or(true)
}

/// The same; `None` where one is no such quantity: a broken sensor, or another unit.
pub(crate) fn is_outside_or_none(usual: &[Usual], state: &State) -> Option<bool> {
    let mut outside = false;
    for covariate in usual {
        // A problem in words would be made for each sample that lacks it.
        let CovariateValue::Fresh(value) = state.covariates.covariate(&covariate.name) else { continue };
        let Some((nearest, widths)) = covariate.place(value) else {
            outside = true;
            continue;
        };
        if is_implausible(&covariate.name, (value - nearest).abs()) {
            return None;
        }
        outside |= widths > 0.0;
    }
    Some(outside)
}

/// Covariates that an effect lacks, each with its usual range.
pub(crate) struct Open<'a> {
    lacking: SmallVec<[&'a Usual; 4]>,
    middles: SmallVec<[f64; 4]>,
    state: &'a State<'a>,
}

impl<'a> Open<'a> {
    /// Those of these that a sample lacks; `None` where the range of one of them is not known, so that nothing bounds it.
    pub(crate) fn new(usual: &'a [Usual], state: &'a State<'a>) -> Option<Open<'a>> {
        let lacking: SmallVec<[&Usual; 4]> = usual.iter().filter(|c| state.covariate(&c.name).is_err()).collect();
        let middle = |covariate: &&Usual| covariate.range.map(|(low, high)| 0.5 * (low + high));
        let middles = lacking.iter().map(middle).collect::<Option<_>>()?;
        Some(Open { lacking, middles, state })
    }

    /// The sample with each of them in the middle of its range.
    pub(crate) fn middle(&self) -> impl CovariateSource + '_ {
        Put { state: self.state, put: &self.lacking, values: &self.middles }
    }

    /// The covariance of what they may do beside their middles over all of their ranges: `moved` says what in a state, and `uncertain`
    /// the covariance that the effect's parameters give that. `None` where it cannot be said.
    pub(crate) fn doubt_m2(
        &self,
        moved: impl Fn(&State) -> Option<Vector3<f64>>,
        uncertain: impl Fn(&State) -> Option<Matrix3<f64>>,
    ) -> Option<Matrix3<f64>> {
        let covered = cover(&over(&self.lacking, LEVELS, self.state, moved)?)?;
        let all = over(&self.lacking, FEW_LEVELS, self.state, uncertain)?;
        let widest = all.into_iter().max_by(|a, b| a.trace().total_cmp(&b.trace()));
        Some(covered + widest?)
    }
}

/// What an effect does beyond the ranges of its covariates: the part of the motion that lies beyond, and the covariance of
/// all that is not known there. `None` where it cannot be said.
pub(crate) fn outside(
    usual: &[Usual],
    state: &State,
    motion: impl Fn(&State) -> Option<Vector3<f64>>,
) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    let (mut beyond, mut nearest, mut farthest) = (Vec::new(), Vec::new(), 0.0_f64);
    for covariate in usual {
        let Ok(value) = state.covariate(&covariate.name) else { continue };
        // What has no known range cannot be compared with it; the status says so.
        let Some((place, widths)) = covariate.place(value) else { continue };
        if is_implausible(&covariate.name, (value - place).abs()) {
            return None;
        }
        if widths > 0.0 {
            beyond.push(covariate);
            nearest.push(place);
            farthest = farthest.max(widths);
        }
    }
    let at_end = motion(&State { covariates: &Put { state, put: &beyond, values: &nearest }, ..*state })?;
    let added = motion(state)? - at_end;
    let from_end: Vec<Vector3<f64>> = over(&beyond, LEVELS, state, &motion)?.into_iter().map(|m| m - at_end).collect();
    let share = farthest.min(1.0);
    let mut goes_on = added * added.transpose();
    if added == Vector3::zeros() {
        for k in 0..nearest.len() {
            let carried = carried_on(&beyond, (&nearest, k), state, &motion)? - at_end;
            goes_on += carried * carried.transpose();
        }
    }
    Some((added, goes_on + cover(&from_end)? * (share * share)))
}

/// What an effect that is held at the end of a range would do beyond it, if the parabola through what it does at both ends and in the
/// middle went on, up to one width; all others of these covariates stand at these nearest values.
fn carried_on(
    beyond: &[&Usual],
    (nearest, k): (&[f64], usize),
    state: &State,
    motion: impl Fn(&State) -> Option<Vector3<f64>>,
) -> Option<Vector3<f64>> {
    let ((low, high), value) = (beyond[k].range?, state.covariate(&beyond[k].name).ok()?);
    let widths = (beyond[k].place(value)?.1).min(1.0);
    let inwards = if nearest[k] == high { low - high } else { high - low };
    let at = |share: f64| {
        let mut values = nearest.to_vec();
        values[k] += share * inwards;
        motion(&State { covariates: &Put { state, put: beyond, values: &values }, ..*state })
    };
    let (end, middle, far) = (at(0.0)?, at(0.5)?, at(1.0)?);
    let square = widths * widths;
    Some(end * (1.0 + 3.0 * widths + 2.0 * square) - middle * (4.0 * (widths + square)) + far * (widths + 2.0 * square))
}

/// What an effect does by the part of a difference of temperatures that its campaign did not see: the covariance of it, and whether
/// that part is more than chance. `None` where it cannot be said.
pub(crate) fn apart(
    all: &[Apart],
    state: &State,
    motion: impl Fn(&State) -> Option<Vector3<f64>>,
) -> Option<(Matrix3<f64>, bool)> {
    let (mut largest, mut is_outside) = (Vector3::zeros(), false);
    for apart in all {
        let Some((within_c, is_beyond)) = apart.beyond(state) else { continue };
        let within = motion(&State { covariates: &Put { state, put: &[&apart.own], values: &[within_c] }, ..*state })?;
        let added = motion(state)? - within;
        is_outside |= is_beyond;
        if added.norm_squared() > largest.norm_squared() {
            largest = added;
        }
    }
    Some((largest * largest.transpose(), is_outside))
}

/// The sample with some covariates put in place of its own.
struct Put<'a> {
    state: &'a State<'a>,
    put: &'a [&'a Usual],
    values: &'a [f64],
}

impl CovariateSource for Put<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        match self.put.iter().position(|covariate| covariate.name == name) {
            Some(k) => CovariateValue::Fresh(self.values[k]),
            None => self.state.covariates.covariate(name),
        }
    }
}

/// Values of a function of the state on a grid over the ranges of these covariates, all others as they are.
fn over<T>(grid: &[&Usual], most_levels: usize, state: &State, of: impl Fn(&State) -> Option<T>) -> Option<Vec<T>> {
    if grid.len() > MOST_LACKING {
        return None;
    }
    let ranges: Vec<(f64, f64)> = grid.iter().map(|covariate| covariate.range).collect::<Option<_>>()?;
    let levels = (2..=most_levels).rev().find(|levels| levels.pow(grid.len() as u32) <= GRID).unwrap_or(2);
    let at = |place: usize| {
        let level = |k: usize| place / levels.pow(k as u32) % levels;
        let share = |k: usize| level(k) as f64 / (levels - 1) as f64;
        let values: Vec<f64> = ranges.iter().enumerate().map(|(k, (l, h))| l + (h - l) * share(k)).collect();
        of(&State { covariates: &Put { state, put: grid, values: &values }, ..*state })
    };
    (0..levels.pow(grid.len() as u32)).map(at).collect()
}

/// A covariance M ⪰ v·vᵀ of each of these motions: so of their mean under any weights. `None` where one is not finite.
///
/// Each motion in turn stretches M along itself, just so far that vᵀM⁻¹v = 1.
fn cover(motions: &[Vector3<f64>]) -> Option<Matrix3<f64>> {
    let largest = motions.iter().map(Vector3::norm_squared).fold(0.0, f64::max);
    if !motions.iter().all(|motion| motion.norm_squared().is_finite()) {
        return None;
    }
    if largest == 0.0 {
        return Some(Matrix3::zeros());
    }
    let mut cover = Matrix3::identity() * (FLOOR * largest);
    for motion in motions {
        let distance = motion.dot(&(cover.try_inverse()? * motion));
        if distance > 1.0 {
            cover += motion * motion.transpose() * (1.0 - 1.0 / distance);
        }
    }
    Some(cover)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::NoCovariates;

    const STATE: State = State { reading_m: [0.0; 3], offset_m: [0.0; 3], covariates: &NoCovariates };

    fn usual(name: &str, low: f64, high: f64) -> Usual {
        Usual { name: name.to_owned(), range: Some((low, high)) }
    }

    /// A source in which every covariate has this value.
    struct All(f64);
    impl CovariateSource for All {
        fn covariate(&self, _name: &str) -> CovariateValue {
            CovariateValue::Fresh(self.0)
        }
    }

    #[test]
    fn a_cover_holds_every_motion_and_is_no_larger_than_one_that_stands_alone() {
        let motions: Vec<Vector3<f64>> = (0..40)
            .map(|k| {
                let t = f64::from(k) * 0.7;
                Vector3::new(t.sin(), 0.3 * (2.0 * t).cos(), 0.1 * t) * 1e-6
            })
            .collect();
        let covered = cover(&motions).unwrap();
        for direction in [Vector3::x(), Vector3::y(), Vector3::z(), Vector3::new(0.6, 0.48, 0.64)] {
            let most = motions.iter().map(|m| m.dot(&direction).powi(2)).fold(0.0, f64::max);
            assert!(direction.dot(&(covered * direction)) >= most * (1.0 - 1e-9));
        }
        let alone = Vector3::new(1e-6, -2e-6, 0.0);
        let covered = cover(&[alone, -alone, alone * 0.3]).unwrap();
        assert!((covered - alone * alone.transpose()).norm() < 1e-8 * alone.norm_squared());
        assert_eq!(cover(&[Vector3::zeros(); 3]), Some(Matrix3::zeros()));
        assert_eq!(cover(&[Vector3::repeat(f64::NAN)]), None);
        assert_eq!(cover(&[Vector3::repeat(1e300)]), None);
    }

    #[test]
    fn what_is_left_open_stands_in_the_middle_and_its_ends_are_covered() {
        // 2 µm/K along X, seen from 19 to 22 °C.
        let motion = |state: &State| Some(Vector3::x() * (2e-6 * (state.covariate("t").ok()? - 20.0)));
        let range = [usual("t", 19.0, 22.0)];
        let open = Open::new(&range, &STATE).unwrap();
        let middle = open.middle();
        let middle_m = motion(&State { covariates: &middle, ..STATE }).unwrap();
        assert!((middle_m - Vector3::x() * 1e-6).norm() < 1e-12, "{middle_m}");
        let beside = |state: &State| Some(motion(state)? - middle_m);
        let covered = open.doubt_m2(beside, |_| Some(Matrix3::zeros())).unwrap();
        assert!((covered[(0, 0)].sqrt() - 3e-6).abs() < 1e-12, "{covered}");
        assert!(Open::new(&[Usual { name: "t".to_owned(), range: None }], &STATE).is_none());
        // A parameter that no data told of is as uncertain as its prior says, wherever that shows most.
        let vague = |state: &State| Some(Matrix3::identity() * (3e-6 * (state.covariate("t").ok()? - 20.5)).powi(2));
        let covered = open.doubt_m2(|_| Some(Vector3::zeros()), vague).unwrap();
        assert!((covered[(2, 2)].sqrt() - 4.5e-6).abs() < 1e-12, "{covered}");
    }

    #[test]
    fn beyond_its_range_a_law_counts_as_uncertain_by_what_it_adds_and_by_what_it_may_hide() {
        let linear = |state: &State| Some(Vector3::x() * (2e-6 * (state.covariate("t").ok()? - 20.0)));
        let held = |state: &State| Some(Vector3::x() * (2e-6 * (state.covariate("t").ok()?.clamp(20.0, 21.0) - 20.0)));
        let range = [usual("t", 20.0, 21.0)];
        let at = |value: f64, motion: &dyn Fn(&State) -> Option<Vector3<f64>>| {
            let source = All(value);
            let (added, covered) = outside(&range, &State { covariates: &source, ..STATE }, motion).unwrap();
            (added.x, covered[(0, 0)].sqrt())
        };
        let near = |found: (f64, f64), expected: (f64, f64)| {
            assert!((found.0 - expected.0).abs() < 1e-12 && (found.1 - expected.1).abs() < 1e-12, "{found:?}");
        };
        near(at(20.5, &linear), (0.0, 0.0));
        // A quarter of the range beyond: 0.5 µm added, and a quarter of the 2 µm that the range itself spans.
        near(at(21.25, &linear), (0.5e-6, 0.5e-6 * 2.0_f64.sqrt()));
        near(at(23.0, &linear), (4e-6, (16e-12 + 4e-12_f64).sqrt()));
        // Held at its end, it may as well go on as it came.
        near(at(21.25, &held), (0.0, 0.5e-6 * 2.0_f64.sqrt()));
        near(at(90.0, &held), (0.0, 2e-6 * 2.0_f64.sqrt()));
        // 2 µm/K² about 20.5 °C: half a width beyond, 1.5 µm more than at the end, and 0.5 µm that it does over the range, by a half.
        let square = |state: &State| {
            let from_middle_k = state.covariate("t").ok()?.clamp(20.0, 21.0) - 20.5;
            Some(Vector3::x() * (2e-6 * from_middle_k * from_middle_k))
        };
        near(at(21.5, &square), (0.0, (1.5e-6_f64.powi(2) + 0.25e-6_f64.powi(2)).sqrt()));
        near(at(19.5, &square), (0.0, (1.5e-6_f64.powi(2) + 0.25e-6_f64.powi(2)).sqrt()));
        assert!(is_outside(&range, &State { covariates: &All(21.25), ..STATE }));
        assert!(!is_outside(&range, &State { covariates: &All(21.0), ..STATE }));
        assert!(!is_outside(&range, &STATE), "what is missing has a status of its own");
    }
}
