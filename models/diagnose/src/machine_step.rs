//! A step of the machine in the middle of the campaign: its squareness, how its ram stands, or its scales are other ones from some reading on.
//!
//! Place in the flow: near the end of [`crate::diagnose()`], on the rows that are left. A collision or a bumped axis is in no list of
//! effects, nor is a compensation of the controller that somebody switched: no model can be right before and after it. What no fit may
//! absorb of such a step is a motion of the tip that is linear in the readings: three angles between axes and three turns of the ram
//! (rad), or three scales. Each gap between two readings is tried as the instant,
//! and what any station measured across it is allowed to have moved there, or to have lost its zero. So a station that moved, a
//! tracer's zero and a shift of the whole machine are no step of its geometry; these have the same signature.
//!
//! ```text
//! motion of the tip from the gap on:  (γ_xy q_y + γ_xz q_z, γ_yz q_z, 0) + ω × offset,  or  (s_x q_x, s_y q_y, s_z q_z)
//! evidence = gain of 2 ln L − degrees · ln n − 2 ln(2 gaps)
//! ```
//!
//! A step is said only where the evidence beyond that of the moved stations passes, p times the number of all gaps too (the greatest
//! of as many tests is no larger by chance; Bonferroni), where nothing else explains the same as well (the same motions
//! as a course in time, in cycles, or by anything that was logged; a station that moved; all that the search found), and where lines
//! left out are predicted better with it.

use crate::candidates::Round;
use crate::error::DiagnoseError;
use crate::gate;
use crate::linear::Linear;
use crate::options::DiagnoseOptions;
use crate::score::{Score, p_of};
use abbe_geometry::Vector3;
use abbe_geometry::model::{MachineModel, ModelError};
use abbe_measurement::campaign::Campaign;
use faer::Mat;
use std::sync::Arc;

pub(crate) mod in_place;
mod rivals;

/// Gaps that are tried before the best is looked for among its neighbours.
const COARSE: usize = 96;
/// Gaps that are tried in one go: their columns are projected together.
const TOGETHER: usize = 16;
/// Readings that each side of a gap must have: fewer cannot tell six figures of the machine from what they are themselves.
const FEWEST: usize = 24;
/// Evidence by which another instant is nearly as likely: nineteen times in twenty the right one is among these.
const AS_GOOD: f64 = 6.0;
/// Figures of a step that are told: angles between axes, or scales.
const TOLD: usize = 3;

/// What changes in a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// Angles between X and Y, X and Z, Y and Z (rad), and how the ram stands.
    Angles,
    /// Scales of X, Y and Z (1).
    Scales,
}

/// A step of the machine at an instant of its campaign.
#[derive(Debug, Clone, PartialEq)]
pub struct MachineStep {
    /// Last reading that is surely before it and first that is surely after it, by place in the campaign, from 0.
    pub readings: (usize, usize),
    /// When these were taken (s).
    pub times_s: (f64, f64),
    /// What changed.
    pub change: Change,
    /// By how much each of the three did, with its standard uncertainty (rad for angles, 1 for scales).
    pub by: [(f64, f64); TOLD],
    /// Probability of as much by chance at any of the gaps.
    pub p_value: f64,
    /// Evidence beyond the stations' own motions: twice the log likelihood after the price of parameters and trials.
    pub evidence: f64,
    /// Rms of what it does to the tip over the readings (m), with what is not known of it.
    pub size_m: f64,
    /// It explains more than all that the search found: that only describes parts of it.
    pub outdoes_found: bool,
}

impl MachineStep {
    /// What it is and what to do, for readers.
    pub fn words(&self) -> String {
        let (first, second) = self.readings;
        let clock = |s: f64| {
            let minutes = (s / 60.0).floor() as i64;
            format!("{:02}:{:02}", minutes.div_euclid(60), minutes.rem_euclid(60))
        };
        let (names, what, unit) = match self.change {
            Change::Angles => (["XY", "XZ", "YZ"], "angles between its axes", "µrad"),
            Change::Scales => (["X", "Y", "Z"], "scales of its axes", "µm/m"),
        };
        let figure = |(name, (by, u)): (&str, (f64, f64))| format!("{name} {:+.1} ± {:.1}", by * 1e6, 2e6 * u);
        let figures: Vec<String> = names.into_iter().zip(self.by).map(figure).collect();
        format!(
            "The machine changed between reading {} and {} (time {} to {} h:min, {:.0} to {:.0} s): the {what} by {} \
             {unit} (k = 2), which moves the tip by {:.1} µm (rms). No model is right before and after it: find the cause, then \
             measure again, or use only what was measured after it. Until then this much stands in U.{}",
            first + 1,
            second + 1,
            clock(self.times_s.0),
            clock(self.times_s.1),
            self.times_s.0,
            self.times_s.1,
            figures.join(", "),
            self.size_m * 1e6,
            if self.outdoes_found { " What was found beside it describes parts of it, and is no cause." } else { "" }
        )
    }

    /// The model with the step in the uncertainty of all that it corrects: before or after, it is wrong by as much.
    pub(crate) fn told(&self, model: MachineModel) -> Result<MachineModel, ModelError> {
        model.with_unexplained(model.parts().quality.unexplained_m.map(|u_m| u_m.hypot(self.size_m)))
    }
}

/// What competes with a step, as whitened columns that the rows do not have.
#[derive(Default)]
pub(crate) struct Competing {
    /// All that the search found.
    pub(crate) found: Option<Mat<f64>>,
    /// Each effect with a cause that it set aside: a cause that is not proven speaks against a step all the same.
    pub(crate) set_aside: Vec<Mat<f64>>,
}

/// The step that these rows show; `None` where they show none.
pub(crate) fn find(
    round: &Round,
    campaign: &Campaign,
    options: &DiagnoseOptions,
    competing: &Competing,
    go_on: &mut dyn FnMut() -> bool,
) -> Result<Option<MachineStep>, DiagnoseError> {
    let angles = of(Change::Angles, (round, campaign), options, competing, go_on)?;
    let scales = of(Change::Scales, (round, campaign), options, competing, go_on)?;
    Ok([angles, scales].into_iter().flatten().max_by(|a, b| a.evidence.total_cmp(&b.evidence)))
}

fn of(
    change: Change,
    (round, campaign): (&Round, &Campaign),
    options: &DiagnoseOptions,
    competing: &Competing,
    go_on: &mut dyn FnMut() -> bool,
) -> Result<Option<MachineStep>, DiagnoseError> {
    let used: Vec<usize> = (0..round.rows.len()).filter(|k| round.rows.whitening[*k] > 0.0).collect();
    let gaps: Vec<usize> = used.iter().copied().skip(FEWEST).take(used.len().saturating_sub(2 * FEWEST)).collect();
    if gaps.len() < FEWEST {
        return Ok(None);
    }
    let scan = Scan::new((round, campaign), change, 2 * gaps.len());
    let stride = gaps.len().div_ceil(COARSE);
    let mut tried = scan.tried(gaps.iter().step_by(stride).copied(), go_on)?;
    let best = |tried: &[Tried]| tried.iter().max_by(|a, b| a.beyond().total_cmp(&b.beyond())).map(|tried| tried.gap);
    let Some(coarse) = best(&tried) else { return Ok(None) };
    let place = gaps.partition_point(|gap| *gap < coarse);
    let near = gaps.iter().enumerate().filter(|(k, _)| k.abs_diff(place) < stride && k.abs_diff(place) > 0);
    tried.extend(scan.tried(near.map(|(_, gap)| *gap), go_on)?);
    let Some(step) = tried.iter().max_by(|a, b| a.beyond().total_cmp(&b.beyond())) else { return Ok(None) };
    let p_value = (scan.p_value(step) * scan.gaps as f64).min(1.0);
    if step.beyond() < options.least_evidence || p_value > options.significance {
        return Ok(None);
    }
    let outdoes_found = competing.found.is_some();
    let moved = tried.iter().map(|tried| tried.moved).fold(f64::NEG_INFINITY, f64::max);
    let most = step.whole - options.least_evidence;
    if moved > most || rivals::any_beyond(&scan, competing, most, go_on)? {
        return Ok(None);
    }
    let Some(by) = scan.judged(step)? else { return Ok(None) };
    let (before, after) = between(&tried, step, &used);
    let size_m = scan.size_m(&used, &by, step);
    Ok(Some(MachineStep {
        readings: (before, after),
        times_s: (campaign.readings[before].time_s, campaign.readings[after].time_s),
        change,
        by,
        p_value,
        evidence: step.beyond(),
        size_m,
        outdoes_found,
    }))
}

/// Last reading that is surely before the step, and first that is surely after it: all instants nearly as likely lie between them, since
/// readings that do not see what changed do not tell it. Instants that were not tried lie beside those that were.
fn between(tried: &[Tried], step: &Tried, used: &[usize]) -> (usize, usize) {
    let mut gaps: Vec<(usize, bool)> =
        tried.iter().map(|tried| (tried.gap, tried.whole > step.whole - AS_GOOD)).collect();
    gaps.sort_unstable();
    let first = gaps.iter().position(|(_, as_good)| *as_good).unwrap_or(0);
    let last = gaps.iter().rposition(|(_, as_good)| *as_good).unwrap_or(0);
    let one_before = |gap: usize| used.iter().copied().rev().find(|k| *k < gap);
    let earliest = match first.checked_sub(1) {
        Some(other) if gaps[other].0 + 1 < gaps[first].0 => gaps[other].0,
        _ => one_before(gaps[first].0).unwrap_or(gaps[first].0),
    };
    let latest = match gaps.get(last + 1) {
        Some((other, _)) if gaps[last].0 + 1 < *other => one_before(*other).unwrap_or(*other),
        _ => gaps[last].0,
    };
    (earliest, latest)
}

/// What one gap tells.
struct Tried {
    /// First reading after it.
    gap: usize,
    /// With the machine's figures and the stations across it.
    both: Score,
    /// With the stations alone; `None` where no station was measured across it.
    alone: Option<Score>,
    /// Evidence of both together, and of the stations alone.
    whole: f64,
    moved: f64,
}

impl Tried {
    /// Evidence of the machine's figures beyond the stations'.
    fn beyond(&self) -> f64 {
        self.whole - self.moved
    }
}

/// Rows, and what each figure of a step does to their ranges (m per unit).
pub(super) struct Scan<'s> {
    round: &'s Round<'s>,
    campaign: &'s Campaign,
    change: Change,
    /// Angles and turns of the ram, or scales.
    figures: Vec<Vec<f64>>,
    /// Gaps, and kinds of step, among which the best is taken.
    gaps: usize,
}

impl<'s> Scan<'s> {
    fn new((round, campaign): (&'s Round<'s>, &'s Campaign), change: Change, gaps: usize) -> Scan<'s> {
        let figure = |of: &dyn Fn(usize) -> Vector3<f64>| -> Vec<f64> {
            (0..campaign.readings.len()).map(|k| round.rows.rays[k].direction.dot(&of(k))).collect()
        };
        let reading = |k: usize| &campaign.readings[k].reading_m;
        let figures = match change {
            Change::Angles => {
                let angles = PLANES.iter().map(|(moves, by)| figure(&|k| Vector3::ith(*moves, reading(k)[*by])));
                let offset = |k: usize| Vector3::from(campaign.readings[k].offset_m);
                angles.chain((0..3).map(|d| figure(&|k| Vector3::ith(d, 1.0).cross(&offset(k))))).collect()
            }
            Change::Scales => (0..TOLD).map(|d| figure(&|k| Vector3::ith(d, reading(k)[d]))).collect(),
        };
        Scan { round, campaign, change, figures, gaps }
    }

    /// Whitened columns of these values where `factor` says so.
    fn column(&self, values: &[f64], factor: impl Fn(usize) -> f64) -> Vec<f64> {
        let of = |k: usize| if self.round.rows.whitening[k] > 0.0 { values[k] * factor(k) } else { 0.0 };
        let mut column: Vec<f64> = (0..values.len()).map(of).collect();
        self.round.rows.whiten(&mut column);
        column
    }

    fn matrix(&self, columns: &[Vec<f64>]) -> Mat<f64> {
        Mat::from_fn(self.round.rows.len(), columns.len(), |k, j| columns[j][k])
    }

    /// Motion and zero, from the gap on, of each station that was measured on both sides of it.
    fn stations(&self, gap: usize) -> Vec<Vec<f64>> {
        let readings = &self.campaign.readings;
        let used = |k: &usize| self.round.rows.whitening[*k] > 0.0;
        let across = |station: u32| {
            let of = |k: &usize| readings[*k].station == station;
            (0..gap).filter(used).any(|k| of(&k)) && (gap..readings.len()).filter(used).any(|k| of(&k))
        };
        let stations = (0..self.campaign.stations.len() as u32).filter(|station| across(*station));
        let own = |station: u32| {
            let after = move |k: usize| f64::from(u8::from(k >= gap && readings[k].station == station));
            let along =
                move |d: usize| -> Vec<f64> { self.round.rows.rays.iter().map(|ray| ray.direction[d]).collect() };
            let mut own: Vec<Vec<f64>> = (0..3).map(|d| self.column(&along(d), after)).collect();
            own.push(self.column(&vec![1.0; readings.len()], after));
            own
        };
        stations.flat_map(own).collect()
    }

    fn figures(&self, factor: impl Fn(usize) -> f64 + Copy) -> Vec<Vec<f64>> {
        self.figures.iter().map(|figure| self.column(figure, factor)).collect()
    }

    fn machine(&self, gap: usize) -> Vec<Vec<f64>> {
        self.figures(|k| f64::from(u8::from(k >= gap)))
    }

    fn tried(
        &self,
        gaps: impl Iterator<Item = usize>,
        go_on: &mut dyn FnMut() -> bool,
    ) -> Result<Vec<Tried>, DiagnoseError> {
        let gaps: Vec<usize> = gaps.collect();
        let mut all = Vec::with_capacity(gaps.len());
        for some in gaps.chunks(TOGETHER) {
            if !go_on() {
                return Err(DiagnoseError::Stopped);
            }
            let groups: Vec<Mat<f64>> =
                some.iter().map(|gap| self.matrix(&[self.stations(*gap), self.machine(*gap)].concat())).collect();
            let projected = self.round.free.project_all(&groups);
            all.extend(some.iter().zip(projected).map(|(gap, projected)| {
                let stations: Vec<usize> = (0..projected.gradient.len() - self.figures.len()).collect();
                let alone = (!stations.is_empty()).then(|| self.round.score(&projected.pick(&stations)));
                let both = self.round.score(&projected);
                let whole = both.evidence(self.round.used, self.gaps);
                let moved = alone.as_ref();
                let moved = moved.map_or(-2.0 * (self.gaps as f64).ln(), |s| s.evidence(self.round.used, self.gaps));
                // The price of the search is paid by what is beyond the stations.
                Tried { gap: *gap, both, alone, whole, moved: moved + 2.0 * (self.gaps as f64).ln() }
            }));
        }
        Ok(all)
    }

    /// Probability of what the machine's figures explain beyond the stations', at this gap.
    fn p_value(&self, tried: &Tried) -> f64 {
        let (reduction, degrees) = tried.alone.as_ref().map_or((0.0, 0), |alone| (alone.reduction, alone.degrees));
        let more = tried.both.degrees.saturating_sub(degrees);
        let rest = (self.round.free.degrees() - tried.both.degrees as f64).max(1.0);
        let remaining = (self.round.free.chi2() - tried.both.reduction).max(f64::MIN_POSITIVE);
        p_of((tried.both.reduction - reduction).max(0.0), more, remaining, rest)
    }

    /// Angles or scales with their standard uncertainty where lines left out are predicted better with the step; `None` where not.
    fn judged(&self, tried: &Tried) -> Result<Option<[(f64, f64); TOLD]>, DiagnoseError> {
        let stations = self.matrix(&self.stations(tried.gap));
        let machine = self.matrix(&self.machine(tried.gap));
        let with = |columns: &[Mat<f64>]| self.round.free.widened(columns, self.round.used);
        let (without, with) = (with(std::slice::from_ref(&stations))?, with(&[stations, machine])?);
        let own = with.covariance();
        let first = own.nrows() - self.figures.len();
        let unit = with.noise_factor().max(1.0);
        let at = tried.both.estimate.len() - self.figures.len();
        let by = std::array::from_fn(|k| {
            (tried.both.estimate[at + k], (own[(first + k, first + k)] * unit).max(0.0).sqrt())
        });
        let round =
            |linear: Linear| Round { free: Arc::new(linear.clone()), linear: Arc::new(linear), ..self.round.clone() };
        let is_better = gate::gains_on_lines(&round(without), &round(with), self.campaign);
        Ok(is_better.then_some(by))
    }

    /// Rms of the tip's motion over the readings (m). Of two axes that turn against each other nobody can tell which one did, so the
    /// longer counts.
    fn size_m(&self, used: &[usize], by: &[(f64, f64); TOLD], tried: &Tried) -> f64 {
        let count = used.len().max(1) as f64;
        let variance = |d: usize| {
            let at = |k: &usize| self.campaign.readings[*k].reading_m[d];
            let mean = used.iter().map(at).sum::<f64>() / count;
            used.iter().map(|k| (at(k) - mean).powi(2)).sum::<f64>() / count
        };
        let square = |(by, u): &(f64, f64)| by * by + u.min(by.abs()).powi(2);
        if self.change == Change::Scales {
            return (0..TOLD).map(|d| square(&by[d]) * variance(d)).sum::<f64>().sqrt();
        }
        let turned = |((first, second), by): (&(usize, usize), &(f64, f64))| {
            square(by) * variance(*first).max(variance(*second))
        };
        let square_m2: f64 = PLANES.iter().zip(by).map(turned).sum();
        let turn = Vector3::from_column_slice(&tried.both.estimate[tried.both.estimate.len() - 3..]);
        let offset = |k: &usize| Vector3::from(self.campaign.readings[*k].offset_m);
        let mean = used.iter().map(offset).sum::<Vector3<f64>>() / count;
        let ram_m2 = used.iter().map(|k| turn.cross(&(offset(k) - mean)).norm_squared()).sum::<f64>() / count;
        (square_m2 + ram_m2).sqrt()
    }
}

/// Axis that an angle moves, and axis along which it grows.
const PLANES: [(usize, usize); TOLD] = [(0, 1), (0, 2), (1, 2)];
