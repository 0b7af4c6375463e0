//! Readings of targets that contradict all others.
//!
//! Place in the flow: before the errors of an axis are used. Squares give one reading that is 0.1 mm off a share of every error of
//! its position, and where it is one at the lowest position, of every position. The reading without which the rest fits best
//! is taken out, again and again; the last of them that an F test tells from noise, and those before it, count as strays
//! (Rosner 1983, Percentage points for a generalized ESD many-outlier procedure). A target that contradicts the others at most
//! positions was wrong at the lowest, to which all refer: it is left out everywhere.

use super::check::{self, Run, common, spread_enough};
use super::frame;
use super::solve::{Arm, Solver, independent};
use super::{Guideway, GuidewayError, GuidewayOptions, TargetPoint};
use crate::chance::beyond;
use crate::robust;
use nalgebra::Vector3;
use statrs::distribution::FisherSnedecor;

/// Campaigns without a gross error in which a reading is left out all the same.
const FALSE_ALARMS: f64 = 1e-4;
/// Strays at most, as a share of the readings: more of them are no strays.
const MOST_SHARE: usize = 5;
/// How much better the typical single reading of a target must explain than the best single one, to blame the lowest position.
const AT_THE_LOWEST: f64 = 2.0;
/// Improvement of the residual (m², rms) below which nothing is a stray: no coordinate resolves it.
const RESOLVED_M: f64 = 1e-9;

/// A reading that contradicts all others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StrayTarget {
    /// Its place among the points, from 0.
    pub point: usize,
    /// How far it is off where the others put it (m); of a reading at the lowest position the mean over the others.
    pub off_m: f64,
    /// Whether it is at the lowest position, so that its target was left out everywhere.
    pub everywhere: bool,
}

impl Guideway {
    /// The errors without the readings that contradict all others, and these readings in their order.
    ///
    /// # Errors
    /// As for [`Guideway::new`].
    pub fn without_strays(
        points: &[TargetPoint],
        options: GuidewayOptions,
    ) -> Result<(Guideway, Vec<StrayTarget>), GuidewayError> {
        let runs = check::by_position(points)?;
        let turn = frame::machine_from_points(&runs, &options)?;
        let solver = Solver::new(&runs, turn, options);
        let strays = Search::new(&solver, &runs)?.strays();
        if strays.is_empty() {
            return Ok((Guideway::new(points, options)?, strays));
        }
        let is_left_out = |(k, point): (usize, &TargetPoint)| {
            strays
                .iter()
                .any(|stray| stray.point == k || (stray.everywhere && points[stray.point].target == point.target))
        };
        let kept: Vec<TargetPoint> =
            points.iter().enumerate().filter(|one| !is_left_out(*one)).map(|(_, point)| point.clone()).collect();
        // The centroid stays that of all targets: leaving one out must not move the point that is reported.
        let pinned = GuidewayOptions { reference_m: Some(solver.reference_m), ..options };
        Ok((Guideway { options, ..Guideway::new(&kept, pinned)? }, strays))
    }
}

/// The targets of one position.
struct Place<'a> {
    run: &'a Run<'a>,
    names: Vec<&'a str>,
    /// Places of the readings here and at the lowest position among the points.
    readings: Vec<(usize, usize)>,
    arms: Vec<Arm>,
    is_kept: Vec<bool>,
    chi2: f64,
    degrees: usize,
    /// By how much χ² falls without each; `None` for what cannot be spared.
    gains: Vec<Option<f64>>,
}

/// What is taken out at once.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Suspect<'a> {
    /// A target at a position.
    Single { place: usize, arm: usize },
    /// A target everywhere.
    Target(&'a str),
}

struct Removed<'a> {
    suspect: Suspect<'a>,
    /// Probability that noise makes as much of a difference.
    probability: f64,
}

struct Search<'a> {
    solver: &'a Solver<'a>,
    places: Vec<Place<'a>>,
}

impl<'a> Search<'a> {
    fn new(solver: &'a Solver<'a>, runs: &'a [Run<'a>]) -> Result<Search<'a>, GuidewayError> {
        let place = |run: &'a Run<'a>| {
            let (names, readings): (Vec<&str>, Vec<(usize, usize)>) =
                common(&runs[0], run).map(|(name, first, here)| (name, (here.place, first.place))).unzip();
            let arms = solver.arms(run);
            let is_kept = vec![true; arms.len()];
            Place { run, names, readings, gains: vec![None; arms.len()], arms, is_kept, chi2: 0.0, degrees: 0 }
        };
        let mut search = Search { solver, places: runs[1..].iter().map(place).collect() };
        (0..search.places.len()).try_for_each(|place| search.refresh(place))?;
        Ok(search)
    }

    /// χ² and degrees of a position by these of its targets; `None` where they do not determine it.
    fn fitted(&self, place: &Place, kept: &dyn Fn(usize) -> bool) -> Option<(f64, usize)> {
        let arms: Vec<&Arm> = place.arms.iter().enumerate().filter(|(k, _)| kept(*k)).map(|(_, arm)| arm).collect();
        let starts_m: Vec<Vector3<f64>> = arms.iter().map(|arm| arm.start_m).collect();
        spread_enough(&starts_m, place.run.position_mm()).ok()?;
        let solved = self.solver.solved(place.run, &arms).ok()?;
        Some((solved.chi2, solved.degrees))
    }

    fn refresh(&mut self, place: usize) -> Result<(), GuidewayError> {
        let own = &self.places[place];
        let position_mm = own.run.position_mm();
        let (chi2, degrees) =
            self.fitted(own, &|k| own.is_kept[k]).ok_or(GuidewayError::Undetermined { position_mm })?;
        let gain = |arm: usize| {
            let without = self.fitted(own, &|k| own.is_kept[k] && k != arm).filter(|_| own.is_kept[arm])?;
            Some(chi2 - without.0)
        };
        let gains = (0..own.arms.len()).map(gain).collect();
        let own = &mut self.places[place];
        (own.chi2, own.degrees, own.gains) = (chi2, degrees, gains);
        Ok(())
    }

    fn strays(mut self) -> Vec<StrayTarget> {
        let count: usize = self.places.iter().map(|place| place.arms.len()).sum();
        let level = FALSE_ALARMS / count as f64;
        let mut removed: Vec<Removed> = Vec::new();
        while removed.len() < count / MOST_SHARE {
            let Some((suspect, gain, degrees)) = self.worst() else { break };
            if self.take_out(suspect).is_none() {
                break;
            }
            removed.push(Removed { suspect, probability: self.probability(gain, degrees) });
        }
        let last = removed.iter().rposition(|one| one.probability < level).map_or(0, |last| last + 1);
        let mut strays: Vec<StrayTarget> = removed[..last].iter().filter_map(|one| self.stray(one.suspect)).collect();
        strays.sort_by_key(|stray| stray.point);
        strays
    }

    /// What explains most, its gain and the equations that it takes along.
    fn worst(&self) -> Option<(Suspect<'a>, f64, usize)> {
        let singles = self.places.iter().enumerate().flat_map(|(place, own)| {
            let single = move |(arm, gain): (usize, &Option<f64>)| Some((Suspect::Single { place, arm }, (*gain)?, 3));
            own.gains.iter().enumerate().filter_map(single)
        });
        let single = singles.max_by(|a, b| a.1.total_cmp(&b.1))?;
        let names = self.places.iter().flat_map(|place| place.names.iter().copied());
        let names: std::collections::BTreeSet<&'a str> = names.collect();
        let whole = names.into_iter().filter_map(|name| self.everywhere(name)).max_by(|a, b| a.0.total_cmp(&b.0));
        match whole {
            Some((typical, gain, degrees, name)) if AT_THE_LOWEST * typical > single.1 => {
                Some((Suspect::Target(name), gain, degrees))
            }
            _ => Some(single),
        }
    }

    /// The typical gain of a target's readings, their sum and equations; `None` where it cannot be spared, or is at one position only,
    /// where nothing tells which of its two readings is wrong.
    fn everywhere(&self, name: &'a str) -> Option<(f64, f64, usize, &'a str)> {
        let mut gains = Vec::new();
        for place in &self.places {
            let Some(arm) = place.names.iter().position(|own| *own == name).filter(|arm| place.is_kept[*arm]) else {
                continue;
            };
            gains.push(place.gains[arm]?);
        }
        let (sum, count) = (gains.iter().sum(), gains.len());
        // The lower of the two middle values of an even number: of two positions both must say so.
        let lower = -robust::median(gains.into_iter().map(|gain| -gain).collect())?;
        (count > 1).then_some((lower, sum, 3 * count, name))
    }

    fn take_out(&mut self, suspect: Suspect<'a>) -> Option<()> {
        for place in 0..self.places.len() {
            let own = &mut self.places[place];
            let arm = match suspect {
                Suspect::Single { place: its, arm } => Some(arm).filter(|_| its == place),
                Suspect::Target(name) => own.names.iter().position(|own| *own == name),
            };
            if let Some(arm) = arm {
                own.is_kept[arm] = false;
                self.refresh(place).ok()?;
            }
        }
        Some(())
    }

    /// Probability of this gain by chance, judged by what is left.
    fn probability(&self, gain: f64, degrees: usize) -> f64 {
        let chi2: f64 = self.places.iter().map(|place| place.chi2).sum();
        let left: usize = self.places.iter().map(|place| place.degrees).sum();
        // What the declared noise explains is no stray, however well the rest fits.
        let floor = if self.solver.is_declared { 1.0 } else { RESOLVED_M * RESOLVED_M };
        let variance = (chi2 / left as f64).max(floor);
        let (own, left) = (independent(degrees, degrees / 3), independent(left, self.places.len()));
        let law = FisherSnedecor::new(own as f64, left as f64);
        law.map_or(1.0, |law| beyond(&law, gain / degrees as f64 / variance))
    }

    fn stray(&self, suspect: Suspect) -> Option<StrayTarget> {
        let off_m = |place: &Place, arm: usize| {
            let kept: Vec<&Arm> =
                place.arms.iter().zip(&place.is_kept).filter(|(_, kept)| **kept).map(|(arm, _)| arm).collect();
            self.solver.off_m(place.run, &kept, &place.arms[arm])
        };
        match suspect {
            Suspect::Single { place, arm } => {
                let own = &self.places[place];
                Some(StrayTarget { point: own.readings[arm].0, off_m: off_m(own, arm)?.norm(), everywhere: false })
            }
            Suspect::Target(name) => {
                let mut offs_m = Vec::new();
                let mut point = None;
                for place in &self.places {
                    let Some(arm) = place.names.iter().position(|own| *own == name) else { continue };
                    offs_m.extend(off_m(place, arm));
                    point = Some(place.readings[arm].1);
                }
                let mean_m = offs_m.iter().sum::<Vector3<f64>>() / offs_m.len().max(1) as f64;
                Some(StrayTarget { point: point?, off_m: mean_m.norm(), everywhere: true })
            }
        }
    }
}
