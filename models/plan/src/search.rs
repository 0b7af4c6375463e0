//! The lines of a plan: added where they help most for their time, and exchanged until nothing helps.
//!
//! Place in the flow: stations are chosen; [`crate::route`] orders what comes out. What a line adds only falls as others are
//! added (nearly so for the volume, exactly for the determinant), so a bound from an earlier look spares most looks (Minoux
//! 1978). The merit of a line is the share of the volume's variance that it takes away, and, at a smaller weight, what it adds
//! to the log determinant per unknown, over its time: D-optimality finds what nothing tells yet, I-optimality what matters.

use crate::candidates::Candidate;
use crate::covariates::of_candidate;
use crate::design::{Design, Gain, Told};
use crate::error::PlanError;
use crate::request::{Progress, Request, Stage};
use crate::stations::FEWEST_LINES;
use abbe_identify::{PlannedRows, SplitRows, in_parallel};
use faer::Mat;

/// Weight of the determinant beside the volume.
const DETERMINANT: f64 = 0.2;
/// Shares of the lines that are exchanged at once, one after the other as they stop helping.
const EXCHANGED: [f64; 3] = [0.15, 0.05, 0.02];
/// Exchanges of one share at most.
const PASSES: usize = 6;
/// Share by which the objective must fall for an exchange to count.
const WORTH: f64 = 2e-4;

/// The candidate lines of the chosen stations, and which of them are in the plan.
pub(crate) struct Search<'a> {
    request: &'a Request,
    pub(crate) candidates: Vec<Candidate>,
    rows: Vec<SplitRows>,
    /// Station of each candidate, as the design numbers them.
    pub(crate) station: Vec<usize>,
    stations: usize,
    pub(crate) design: Design,
    /// Indices of the lines in the plan.
    pub(crate) chosen: Vec<usize>,
    /// Largest gain that each candidate may still have, and what it told when that was computed.
    bounds: Vec<Gain>,
    told: Vec<Option<Told>>,
    /// Candidates for which there is no time any more.
    is_closed: Vec<bool>,
    /// W without the effects.
    points: Mat<f64>,
    objective: f64,
    done: usize,
}

/// A plan to come back to: its design, its lines and what it is worth.
type Kept = (Design, Vec<usize>, f64);

/// When to stop adding.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Until {
    /// Measuring time (s).
    pub(crate) budget_s: f64,
    /// Mean variance of a point without repeatability (m²).
    pub(crate) variance_m2: f64,
}

impl<'a> Search<'a> {
    /// All lines of these stations, both ways, none of them in the plan.
    pub(crate) fn new(
        request: &'a Request,
        planned: &PlannedRows,
        lines: &[&[Candidate]],
        (information, weight, points): (Mat<f64>, Mat<f64>, Mat<f64>),
    ) -> Result<Search<'a>, PlanError> {
        let mut candidates = Vec::new();
        let mut station = Vec::new();
        for (k, own) in lines.iter().enumerate() {
            for line in *own {
                candidates.extend([*line, line.reversed()]);
                station.extend([k; 2]);
            }
        }
        let rows = in_parallel(&candidates, |line: &Candidate| {
            planned.rows(&of_candidate(request, line), request.stands[line.stand].position_m)
        });
        let rows = rows.into_iter().collect::<Result<Vec<_>, _>>()?;
        let singular = || PlanError::Identify(abbe_identify::IdentifyError::Singular);
        let absolute = request.options.absolute_range;
        let design = Design::new(&information, weight, lines.len(), absolute).ok_or_else(singular)?;
        let (bounds, told) = (vec![Gain::UNBOUNDED; candidates.len()], vec![None; candidates.len()]);
        let is_closed = vec![false; candidates.len()];
        let (chosen, stations) = (Vec::new(), lines.len());
        let mut search = Search {
            request,
            candidates,
            rows,
            station,
            stations,
            design,
            chosen,
            bounds,
            told,
            is_closed,
            points,
            objective: 0.0,
            done: 0,
        };
        search.look_again();
        Ok(search)
    }

    /// Mean variance of a point over the volume, without repeatability (m²).
    pub(crate) fn variance_m2(&self) -> f64 {
        self.design.mean(&self.points)
    }

    /// Time of the chosen lines, with stations and holders (s).
    pub(crate) fn time_s(&self) -> f64 {
        self.time_with_s(None)
    }

    /// The same with one more.
    fn time_with_s(&self, more: Option<usize>) -> f64 {
        let all = || self.chosen.iter().copied().chain(more);
        let lines: f64 = all().map(|k| self.candidates[k].time_s).sum();
        let mut holders: Vec<(usize, usize)> = all().map(|k| (self.station[k], self.candidates[k].holder)).collect();
        holders.sort_unstable();
        holders.dedup();
        let mut stations: Vec<usize> = holders.iter().map(|(station, _)| *station).collect();
        stations.dedup();
        let changes = holders.len() - stations.len();
        let motion = &self.request.motion;
        lines + stations.len() as f64 * motion.station_change_s + changes as f64 * motion.holder_change_s
    }

    /// Looks at all candidates anew.
    fn look_again(&mut self) {
        self.design.forget();
        let (design, look) = (&self.design, self.design.look());
        let gain = |k: &usize| {
            let (station, rows) = (self.station[*k], &self.rows[*k]);
            let mut told = look.as_ref().map(|look| look.told(station, rows));
            (design.gain(station, rows, &mut told).unwrap_or(Gain::NONE), told)
        };
        let all: Vec<usize> = (0..self.candidates.len()).collect();
        (self.bounds, self.told) = in_parallel(&all, gain).into_iter().unzip();
    }

    /// What a gain is worth where the mean variance of a point is this (m²).
    fn merit(&self, gain: Gain, time_s: f64, volume_m2: f64) -> f64 {
        (gain.volume / volume_m2 + DETERMINANT * gain.determinant / self.design.unknowns() as f64) / time_s
    }

    /// The best line that is not in the plan, of one station or of all, that takes no longer than this.
    fn best(&mut self, station: Option<usize>, most_s: f64) -> Option<usize> {
        let (design, candidates) = (&self.design, &self.candidates);
        let is_open = |k: &usize| {
            station.is_none_or(|own| self.station[*k] == own)
                && candidates[*k].time_s <= most_s
                && !self.is_closed[*k]
                && !self.chosen.contains(k)
        };
        let open: Vec<usize> = (0..candidates.len()).filter(is_open).collect();
        let mut fresh = vec![false; candidates.len()];
        let volume_m2 = design.volume();
        loop {
            let merit = |k: usize| self.merit(self.bounds[k], candidates[k].time_s, volume_m2);
            // Of equals the first: the same on every machine.
            let best = open.iter().copied().reduce(|a, b| if merit(b) > merit(a) { b } else { a })?;
            if fresh[best] {
                return (merit(best) > 0.0).then_some(best);
            }
            fresh[best] = true;
            let gain = design.gain(self.station[best], &self.rows[best], &mut self.told[best]);
            self.bounds[best] = gain.unwrap_or(Gain::NONE);
        }
    }

    fn add(&mut self, line: usize) -> bool {
        let (station, before) = (self.station[line], self.design.volume());
        let determinant = self.bounds[line].determinant;
        if self.design.add(station, &self.rows[line]).is_none() {
            return false;
        }
        self.objective +=
            (self.design.volume() / before).ln() - DETERMINANT * determinant / self.design.unknowns() as f64;
        self.chosen.push(line);
        true
    }

    fn remove(&mut self, place: usize) -> bool {
        let line = self.chosen[place];
        let (station, before) = (self.station[line], self.design.volume());
        let lost = self.design.loss(station, &self.rows[line]);
        let Some(lost) = lost else { return false };
        if self.design.remove(station, &self.rows[line]).is_none() {
            return false;
        }
        self.objective +=
            (self.design.volume() / before).ln() + DETERMINANT * lost.determinant / self.design.unknowns() as f64;
        self.chosen.remove(place);
        self.forget();
        true
    }

    /// The plan as it was.
    fn take_back(&mut self, (design, chosen, objective): Kept) {
        (self.design, self.chosen, self.objective) = (design, chosen, objective);
        self.forget();
    }

    /// What candidates told and could gain is no bound any more.
    fn forget(&mut self) {
        self.told.fill(None);
        self.bounds.fill(Gain::UNBOUNDED);
    }

    fn kept(&self) -> Kept {
        (self.design.clone(), self.chosen.clone(), self.objective)
    }

    /// How many lines a station has.
    fn lines_of(&self, station: usize) -> usize {
        self.chosen.iter().filter(|k| self.station[**k] == station).count()
    }

    fn report(&mut self, stage: Stage, observe: &mut dyn FnMut(Progress) -> bool) -> bool {
        self.done += 1;
        let best_m = Some((self.variance_m2() + self.request.repeatability_m2()).sqrt());
        observe(Progress { stage, done: self.done, best_m })
    }

    /// Gives every station its first lines, then adds the best until there is enough. False where it was stopped.
    pub(crate) fn fill(&mut self, until: Until, observe: &mut dyn FnMut(Progress) -> bool) -> bool {
        self.is_closed.fill(false);
        if self.told.iter().all(Option::is_none) {
            self.look_again();
        }
        for _ in 0..FEWEST_LINES {
            for station in 0..self.stations {
                if self.lines_of(station) >= FEWEST_LINES {
                    continue;
                }
                let Some(line) = self.best(Some(station), f64::INFINITY) else { continue };
                if self.add(line) && !self.report(Stage::Lines, observe) {
                    return false;
                }
            }
        }
        while self.variance_m2() > until.variance_m2 {
            let left_s = until.budget_s - self.time_s();
            let Some(line) = self.best(None, left_s) else { break };
            // A holder that has to be changed for it costs more than its own time.
            if self.time_with_s(Some(line)) > until.budget_s {
                self.is_closed[line] = true;
                continue;
            }
            if !self.add(line) {
                break;
            }
            if !self.report(Stage::Lines, observe) {
                return false;
            }
        }
        true
    }

    /// Exchanges the lines that tell least for their time, many at once and then few, while the plan gets better. False where
    /// it was stopped.
    pub(crate) fn exchange(&mut self, budget_s: f64, observe: &mut dyn FnMut(Progress) -> bool) -> bool {
        let until = Until { budget_s: budget_s.min(self.time_s().max(1.0)), variance_m2: 0.0 };
        let mut better = true;
        for share in EXCHANGED {
            for _ in 0..PASSES {
                let kept = self.kept();
                let count = ((self.chosen.len() as f64 * share).ceil() as usize).max(1);
                for _ in 0..count {
                    if !self.drop_least() {
                        break;
                    }
                }
                self.look_again();
                let goes_on = self.fill(until, &mut |_| true);
                better = self.objective < kept.2 - WORTH;
                if !better {
                    // The next exchange looks at all candidates itself, once it has taken lines out.
                    self.take_back(kept);
                }
                if !self.report(Stage::Exchange, observe) || !goes_on {
                    return false;
                }
                if !better {
                    break;
                }
            }
        }
        if !better {
            self.look_again();
        }
        true
    }

    /// Takes out the line that tells least for its time, of stations that have more than their fewest.
    pub(crate) fn drop_least(&mut self) -> bool {
        let can_lose: Vec<usize> =
            (0..self.chosen.len()).filter(|p| self.lines_of(self.station[self.chosen[*p]]) > FEWEST_LINES).collect();
        let volume_m2 = self.design.volume();
        let loss = |place: &usize| {
            let line = self.chosen[*place];
            let gain = self.design.loss(self.station[line], &self.rows[line]);
            gain.map_or(f64::INFINITY, |gain| self.merit(gain, self.candidates[line].time_s, volume_m2))
        };
        let losses = in_parallel(&can_lose, loss);
        let least = losses.into_iter().zip(can_lose).reduce(|a, b| if b.0 < a.0 { b } else { a });
        least.is_some_and(|(loss, place)| loss.is_finite() && self.remove(place))
    }

    /// Takes out lines as long as the mean variance of a point stays within this (m²).
    pub(crate) fn trim(&mut self, variance_m2: f64) {
        loop {
            let kept = self.kept();
            if !self.drop_least() || self.variance_m2() > variance_m2 {
                self.take_back(kept);
                return;
            }
        }
    }
}
