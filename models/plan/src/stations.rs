//! Which stands to use: what each sees, what its lines would tell, and the set that tells most in the time there is.
//!
//! Place in the flow: before lines are chosen one by one. A stand counts with all its lines at an equal share (an approximate
//! design: weights instead of whole lines), its own position and dead path eliminated. Sets grow by the stand that helps most
//! and are then exchanged one by one; the number of stations is the one that reaches most, moving the tracer being paid for.

use crate::candidates::{Candidate, Path, corner_m, seen_from};
use crate::check::wrong;
use crate::covariates::of_candidate;
use crate::design::inverse;
use crate::error::PlanError;
use crate::request::{Progress, Request, Stage};
use crate::sight::{self, Place};
use abbe_identify::{PlannedRows, in_parallel, trace_of_product};
use faer::Mat;
use faer::Side;
use faer::linalg::solvers::{Llt, Solve};

/// Stands looked at between two reports of progress.
const TOGETHER: usize = 4;
/// Lines of a station by which sets of stands are compared while they grow.
const USUAL_LINES: f64 = 25.0;
/// Fewest lines of a station: fewer do not place it well.
pub(crate) const FEWEST_LINES: usize = 4;
/// Fewest stations of a campaign: from one place ranges cannot be told from a motion of the whole machine.
const FEWEST_STATIONS: usize = 2;
/// Rounds of exchanges at most.
const ROUNDS: usize = 3;
/// Halvings in the search for the number of lines that reach an uncertainty.
const HALVINGS: usize = 24;

/// A stand that sees enough.
pub(crate) struct Seen {
    pub(crate) lines: Vec<Candidate>,
    /// Information about the machine that a line from here has on average, the station eliminated.
    per_line: Mat<f64>,
    /// Mean time of a line (s).
    line_s: f64,
}

/// What all usable stands see and would tell.
pub(crate) fn look(
    request: &Request,
    rows: &PlannedRows,
    paths: &[Path],
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Vec<Seen>, PlanError> {
    check_corners(request)?;
    let free = |k: &usize| sight::place(request, request.stands[*k].position_m) == Place::Free;
    let usable: Vec<usize> = (0..request.stands.len()).filter(free).collect();
    let mut all = Vec::new();
    for part in usable.chunks(TOGETHER) {
        for seen in in_parallel(part, |stand| seen(request, rows, *stand, paths)) {
            all.extend(seen?);
        }
        if !observe(Progress { stage: Stage::Stands, done: all.len(), best_m: None }) {
            return Err(PlanError::Stopped);
        }
    }
    if all.is_empty() {
        return Err(wrong(
            "stand",
            format!("none of the {} stands sees {FEWEST_LINES} lines of the volume", request.stands.len()),
            "give stands outside the volume and within tracer.farthest_mm of it, and check tracer.elevation_deg and acceptance_deg",
        ));
    }
    let fewest = if request.measured.is_some() { 1 } else { FEWEST_STATIONS };
    if all.len() < fewest || request.most_stations < fewest {
        let (key, found) =
            if all.len() < fewest { ("stand", all.len()) } else { ("most_stations", request.most_stations) };
        let problem = format!("{found} usable stand is too few to tell the machine's errors from its place");
        return Err(wrong(key, problem, "give at least 2, better 4 or more that are not in one plane"));
    }
    Ok(all)
}

/// Every corner of the volume must be seen by some stand with some holder.
fn check_corners(request: &Request) -> Result<(), PlanError> {
    for bits in 0..8_u8 {
        let at_m = corner_m(request, [bits & 1 != 0, bits & 2 != 0, bits & 4 != 0]);
        let is_seen = request.stands.iter().any(|stand| {
            let mut holders = request.holders.iter();
            holders.any(|holder| sight::sees(&request.tracer, stand.position_m, holder, at_m))
        });
        if !is_seen {
            let [x, y, z] = at_m.map(|v| v * 1e3);
            return Err(wrong(
                "volume_mm",
                format!("no stand sees the corner X {x:.0}, Y {y:.0}, Z {z:.0} mm with any holder"),
                "add a stand that does, shrink the volume, or check tracer.farthest_mm, elevation_deg and acceptance_deg",
            ));
        }
    }
    Ok(())
}

fn seen(request: &Request, rows: &PlannedRows, stand: usize, paths: &[Path]) -> Result<Option<Seen>, PlanError> {
    let lines = seen_from(request, stand, paths);
    if lines.len() < FEWEST_LINES {
        return Ok(None);
    }
    let n = rows.machine_parameters();
    let (mut machine, mut cross) = (Mat::<f64>::zeros(n, n), Mat::<f64>::zeros(4, n));
    let mut station = Mat::from_fn(4, 4, |i, j| if i == j { 1.0 } else { 0.0 });
    for line in &lines {
        let own = rows.rows(&of_candidate(request, line), request.stands[stand].position_m)?;
        machine += own.machine.transpose() * &own.machine;
        cross += own.station.transpose() * &own.machine;
        station += own.station.transpose() * &own.station;
    }
    let Ok(known) = Llt::new(station.as_ref(), Side::Lower) else { return Ok(None) };
    let taken = cross.transpose() * known.solve(&cross);
    let count = lines.len() as f64;
    let per_line = faer::Scale(1.0 / count) * (machine - taken);
    let line_s = lines.iter().map(|line| line.time_s).sum::<f64>() / count;
    Ok(Some(Seen { lines, per_line, line_s }))
}

/// The set of stands (indices into `all`) that serves the goal best.
pub(crate) fn choose(
    request: &Request,
    all: &[Seen],
    (prior, weight): (&Mat<f64>, &Mat<f64>),
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Vec<usize>, PlanError> {
    let scale = Scale { request, all, prior, weight };
    let fewest = if request.measured.is_some() { 1 } else { FEWEST_STATIONS };
    let mut set: Vec<usize> = Vec::new();
    let mut best: Option<(f64, Vec<usize>)> = None;
    while set.len() < request.most_stations.min(all.len()) {
        let rest: Vec<usize> = (0..all.len()).filter(|k| !set.contains(k)).collect();
        let with = |k: &usize| scale.variance(set.iter().chain([k]).copied(), USUAL_LINES);
        let variances = in_parallel(&rest, with);
        let Some((_, next)) = variances.into_iter().zip(rest).min_by(|a, b| a.0.total_cmp(&b.0)) else { break };
        set.push(next);
        if set.len() >= fewest {
            scale.exchange(&mut set);
            let cost = scale.cost(&set);
            if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                best = Some((cost, set.clone()));
            }
        }
        if !observe(Progress { stage: Stage::Stations, done: set.len(), best_m: None }) {
            return Err(PlanError::Stopped);
        }
    }
    let mut set = best.map_or(set, |(_, set)| set);
    set.sort_unstable();
    Ok(set)
}

/// By which sets of stands are compared.
struct Scale<'a> {
    request: &'a Request,
    all: &'a [Seen],
    prior: &'a Mat<f64>,
    weight: &'a Mat<f64>,
}

impl Scale<'_> {
    /// Mean variance of a point (m²) with so many lines from each station; infinite where rounding leaves no covariance.
    fn variance(&self, set: impl Iterator<Item = usize>, lines: f64) -> f64 {
        let mut information = self.prior.clone();
        set.for_each(|k| information += faer::Scale(lines) * &self.all[k].per_line);
        let of = |covariance: Mat<f64>| trace_of_product(covariance.as_ref(), self.weight.as_ref());
        inverse(&information).map_or(f64::INFINITY, of)
    }

    /// Replaces stands by better ones until none is better.
    fn exchange(&self, set: &mut [usize]) {
        let mut least = self.variance(set.iter().copied(), USUAL_LINES);
        for _ in 0..ROUNDS {
            let mut changed = false;
            for place in 0..set.len() {
                let rest: Vec<usize> = (0..self.all.len()).filter(|k| !set.contains(k)).collect();
                let instead = |k: &usize| {
                    let others = set.iter().enumerate().filter(|(other, _)| *other != place).map(|(_, k)| *k);
                    self.variance(others.chain([*k]), USUAL_LINES)
                };
                let variances = in_parallel(&rest, instead);
                let found = variances.into_iter().zip(rest).min_by(|a, b| a.0.total_cmp(&b.0));
                if let Some((variance, stand)) = found.filter(|(variance, _)| *variance < least * (1.0 - 1e-6)) {
                    (set[place], least, changed) = (stand, variance, true);
                }
            }
            if !changed {
                return;
            }
        }
    }

    /// What a set costs: the variance that it reaches within the budget, or the time in which it reaches the uncertainty.
    fn cost(&self, set: &[usize]) -> f64 {
        let line_s = set.iter().map(|k| self.all[*k].line_s).sum::<f64>() / set.len() as f64;
        let count = set.len() as f64;
        let of_stations_s = count * self.request.motion.station_change_s;
        let goal = self.request.goal;
        if let Some(budget_s) = goal.budget_s {
            let lines = (budget_s - of_stations_s) / line_s / count;
            // Too little time for a station's fewest lines: worse than any that has it, and the worse the more it lacks.
            let enough = FEWEST_LINES as f64;
            return if lines < enough {
                f64::MAX / (1.0 + lines.max(0.0))
            } else {
                self.variance(set.iter().copied(), lines)
            };
        }
        let wanted_m2 = goal.uncertainty_m.map_or(0.0, |u_m| u_m * u_m - self.request.repeatability_m2());
        let most = set.iter().map(|k| 2 * self.all[*k].lines.len()).sum::<usize>() as f64 / count;
        let (mut few, mut many) = (1.0_f64, most);
        if self.variance(set.iter().copied(), many) > wanted_m2 {
            // Out of reach: the set that comes nearest.
            return f64::MAX.sqrt() * self.variance(set.iter().copied(), many);
        }
        for _ in 0..HALVINGS {
            let middle = (few * many).sqrt();
            if self.variance(set.iter().copied(), middle) > wanted_m2 { few = middle } else { many = middle }
        }
        of_stations_s + count * many.max(FEWEST_LINES as f64) * line_s
    }
}
