//! From a request to a plan: the stations, the search, the order, and what it all comes to.
//!
//! Place in the flow: the one entry point. Same request, same plan to the bit, however many threads there are. What the search
//! believes of the uncertainty only steers it; the plan is judged by [`crate::promise`], and a budget by the times of the
//! ordered path.

use crate::candidates::{Candidate, paths};
use crate::check::check;
use crate::covariates::{self, Planned};
use crate::error::PlanError;
use crate::prior::{Prior, terms};
use crate::promise::{self, Known, Promise};
use crate::request::{Progress, Request};
use crate::route::{Leg, ordered, way_s};
use crate::search::{Search, Until};
use crate::stations::{self, Seen};
use crate::timing::move_s;
use abbe_geometry::Vector3;
use abbe_identify::station_start::StationStart;
use abbe_identify::{Belief, IdentifyError, PlannedRows};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::planned::{Line, Station};

/// Attempts to bring what identification will state to what is wanted.
const ATTEMPTS: usize = 6;

/// Share of the time that ordered lines take of what the search reckoned, at least.
const LEAST_SAVED: f64 = 0.5;

/// Stations of the shortest plan at most: it has few.
const MOST_OF_SHORTEST: usize = 4;

/// A search with its plan, if there is one, and whether it went to its end.
type Found<'a> = (Option<(Search<'a>, Plan)>, bool);

/// A plan and what it will reach.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Stations in order.
    pub stations: Vec<Station>,
    /// Lines in order.
    pub lines: Vec<Line>,
    /// The plan as a campaign of nominal readings, lengths zero; without what was measured before.
    pub nominal: Campaign,
    /// Measuring time with all changes (s).
    pub time_s: f64,
    /// What will be reached, together with what was measured before.
    pub promise: Promise,
    /// What was reached before, where something was measured.
    pub before: Option<Promise>,
    /// What would be reached if the errors bent half and twice as much as believed (rms uncertainty over the volume, m).
    pub if_bent_m: [f64; 2],
    /// The observer stopped it: the best so far.
    pub stopped: bool,
}

/// Plans a campaign. `observe` sees each step and returns false to stop; the best plan so far is then kept.
///
/// # Errors
/// A request that makes no sense or asks for what cannot be, by the key and with a remedy.
pub fn plan(request: &Request, observe: &mut dyn FnMut(Progress) -> bool) -> Result<Plan, PlanError> {
    check(request)?;
    let wishes = terms(request)?;
    let rows = PlannedRows::new(&request.machine, request.instrument, &wishes.searched, request.offset_centre_m())?;
    let all = stations::look(request, &rows, &paths(request), observe)?;
    let prior = Prior::new(request, &rows, &wishes.searched)?;
    let set = stations::choose(request, &all, (&prior.information, &prior.weight), observe)?;
    let planner = Planner { request, rows: &rows, all: &all, prior: &prior, may_turn: wishes.searched.is_empty() };
    let mut plan = planner.plan(&set, observe)?;
    look_at_effects(request, &mut plan)?;
    Ok(plan)
}

/// What the finished plan tells of effects: once, not for each plan that the search comes by.
fn look_at_effects(request: &Request, plan: &mut Plan) -> Result<(), PlanError> {
    let new = plan.stations.iter().map(|s| start(s.position_m)).collect();
    let (campaign, stations, misfit) = with_measured(request, &plan.nominal, new);
    plan.promise.effects = promise::of_effects(known(request, &request.belief, misfit), (&campaign, &stations))?;
    Ok(())
}

/// What stays the same while lines are chosen.
struct Planner<'a> {
    request: &'a Request,
    rows: &'a PlannedRows<'a>,
    all: &'a [Seen],
    prior: &'a Prior,
    may_turn: bool,
}

impl<'a> Planner<'a> {
    fn search(&self, set: &[usize]) -> Result<Search<'a>, PlanError> {
        let lines: Vec<&[Candidate]> = set.iter().map(|k| self.all[*k].lines.as_slice()).collect();
        let Prior { information, weight, points } = self.prior;
        Search::new(self.request, self.rows, &lines, (information.clone(), weight.clone(), points.clone()))
    }

    fn plan(&self, set: &[usize], observe: &mut dyn FnMut(Progress) -> bool) -> Result<Plan, PlanError> {
        let goal = self.request.goal;
        let repeatability_m2 = self.request.repeatability_m2();
        let wanted_m2 = goal.uncertainty_m.map(|u_m| u_m * u_m - repeatability_m2);
        let budget_s = goal.budget_s.unwrap_or(f64::INFINITY);
        let mut search = self.search(set)?;
        let mut aim_m2 = wanted_m2.unwrap_or(0.0);
        let mut best: Option<Plan> = None;
        for _ in 0..ATTEMPTS {
            let mut goes_on = search.fill(Until { budget_s, variance_m2: aim_m2 }, observe);
            goes_on = goes_on && search.exchange(budget_s, observe);
            goes_on = goes_on && self.use_up(&mut search, Until { budget_s, variance_m2: aim_m2 }, observe);
            if goes_on && wanted_m2.is_some() {
                search.trim(aim_m2);
            }
            let mut found = match self.within_budget(&mut search, budget_s) {
                Ok(found) => found,
                Err(problem) if !goes_on => {
                    let kept = best.ok_or_else(|| stopped(problem))?;
                    return Ok(Plan { stopped: true, ..kept });
                }
                Err(problem) => return self.judged(self.shortest_within((set, budget_s), problem, observe)?),
            };
            found.stopped = !goes_on;
            let reached = self.is_reached(&found);
            let no_more = search.variance_m2() > aim_m2 || !goes_on;
            let stated_m2 = found.promise.u_m.powi(2) - repeatability_m2;
            // What identification will state is a little more than what the search went by: aim lower by as much.
            aim_m2 *= wanted_m2.map_or(1.0, |wanted_m2| (wanted_m2 / stated_m2).min(1.0) * 0.995);
            let is_better = best.as_ref().is_none_or(|plan| found.promise.u_m < plan.promise.u_m);
            if is_better || reached {
                best = Some(found);
            }
            if let Some(best) = &mut best {
                best.stopped = !goes_on;
            }
            if reached || no_more {
                break;
            }
        }
        self.judged(best.ok_or(PlanError::Stopped)?)
    }

    /// Whether a plan comes to the uncertainty that is wanted, if one is.
    fn is_reached(&self, plan: &Plan) -> bool {
        self.request.goal.uncertainty_m.is_none_or(|wanted_m| plan.promise.u_m <= wanted_m)
    }

    /// The plan, unless it ran to its end without what is wanted.
    fn judged(&self, plan: Plan) -> Result<Plan, PlanError> {
        let goal = self.request.goal;
        match goal.uncertainty_m {
            Some(wanted_m) if plan.promise.u_m > wanted_m && !plan.stopped => Err(PlanError::Unreached {
                wanted_m,
                budget_s: goal.budget_s,
                best_m: plan.promise.u_m,
                common_m: common_m(self.request, &plan)?,
                time_s: plan.time_s,
                stations: plan.stations.len(),
                lines: plan.lines.len(),
            }),
            _ => Ok(plan),
        }
    }

    /// Fills the time that the order of the lines saves beside the usual move to each. False where it was stopped.
    fn use_up(&self, search: &mut Search, until: Until, observe: &mut dyn FnMut(Progress) -> bool) -> bool {
        if until.budget_s.is_infinite() {
            return true;
        }
        let saved = Path::new(self.request, search, self.may_turn).time_s / search.time_s();
        let budget_s = until.budget_s / saved.clamp(LEAST_SAVED, 1.0);
        search.fill(Until { budget_s, ..until }, observe)
    }

    /// The ordered plan, with lines taken out until its time is within the budget.
    fn within_budget(&self, search: &mut Search, budget_s: f64) -> Result<Plan, PlanError> {
        loop {
            let path = Path::new(self.request, search, self.may_turn);
            if path.time_s <= budget_s {
                return path.stated(self.request);
            }
            if !search.drop_least() {
                return Err(IdentifyError::TooFewStations { found: path.stations.len() }.into());
            }
        }
    }

    /// A goal so easy, or a budget so short, that the lines which help most do not tell everything: the shortest plan that
    /// does, filled up to the goal, or the error that names it.
    fn shortest_within(
        &self,
        (set, budget_s): (&[usize], f64),
        problem: PlanError,
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<Plan, PlanError> {
        let unobservable = |problem| match problem {
            PlanError::Identify(problem) => PlanError::Unobservable(problem),
            other => other,
        };
        let (shortest, goes_on) = self.shortest_of_sets(observe)?;
        let (search, mut plan) = match shortest {
            Some(shortest) => shortest,
            None if !goes_on => return Err(PlanError::Stopped),
            None => return Err(unobservable(problem)),
        };
        plan.stopped = !goes_on;
        match (plan.time_s > budget_s, goes_on) {
            (false, true) if self.request.goal.uncertainty_m.is_none() => {
                Ok(self.filled_up((search, plan), budget_s, observe))
            }
            (false, true) if !self.is_reached(&plan) => self.shortest_from((set, budget_s), (search, plan), observe),
            (false, _) => Ok(plan),
            (true, false) => Err(PlanError::Stopped),
            (true, true) => {
                let (shortest_s, stations, lines) = (plan.time_s, plan.stations.len(), plan.lines.len());
                Err(PlanError::Budget { budget_s, shortest_s, stations, lines })
            }
        }
    }

    /// The shortest plan from these stations, filled up to the goal. Few stations may tell everything and not reach it.
    fn shortest_from(
        &self,
        (set, budget_s): (&[usize], f64),
        of_few: (Search<'a>, Plan),
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<Plan, PlanError> {
        let found = match self.shortest(set, observe) {
            Ok(Some((_, plan))) if plan.stopped && plan.time_s <= budget_s => return Ok(plan),
            Ok(Some((search, plan))) if plan.time_s <= budget_s => self.filled_up((search, plan), budget_s, observe),
            Ok(_) => return Ok(self.filled_up(of_few, budget_s, observe)),
            Err(PlanError::Stopped) => return Ok(Plan { stopped: true, ..of_few.1 }),
            Err(problem) => return Err(problem),
        };
        if found.stopped || self.is_reached(&found) {
            return Ok(found);
        }
        let other = self.filled_up(of_few, budget_s, observe);
        let is_better = other.promise.u_m < found.promise.u_m;
        Ok(if is_better { other } else { Plan { stopped: other.stopped, ..found } })
    }

    /// The shortest of the plans from few stations, if one of them tells everything, and whether the search went to its end.
    fn shortest_of_sets(&self, observe: &mut dyn FnMut(Progress) -> bool) -> Result<Found<'a>, PlanError> {
        let mut request = self.request.clone();
        let mut shortest: Option<(Search, Plan)> = None;
        let fewest = if request.measured.is_some() { 1 } else { 2 };
        let most = self.request.most_stations.min(self.all.len()).min(MOST_OF_SHORTEST);
        for stations in fewest..=most {
            request.most_stations = stations;
            request.goal.budget_s = Some(stations as f64 * (self.request.motion.station_change_s + 7200.0));
            let information = (&self.prior.information, &self.prior.weight);
            let set = stations::choose(&request, self.all, information, observe);
            match set.and_then(|set| self.shortest(&set, observe)) {
                Ok(Some((search, plan))) => {
                    let goes_on = !plan.stopped;
                    if shortest.as_ref().is_none_or(|(_, least)| plan.time_s < least.time_s) {
                        shortest = Some((search, plan));
                    }
                    if !goes_on {
                        return Ok((shortest, false));
                    }
                }
                Ok(None) => {}
                Err(PlanError::Stopped) => return Ok((shortest, false)),
                Err(problem) => return Err(problem),
            }
        }
        Ok((shortest, true))
    }

    /// A plan that tells everything, with lines added until it reaches what is wanted or the budget is used up.
    fn filled_up(
        &self,
        (mut search, mut plan): (Search<'a>, Plan),
        budget_s: f64,
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Plan {
        let wanted_m2 = self.request.goal.uncertainty_m.map(|u_m| u_m * u_m - self.request.repeatability_m2());
        let mut aim_m2 = wanted_m2.unwrap_or(0.0);
        for _ in 0..ATTEMPTS {
            if wanted_m2.is_some() && self.is_reached(&plan) {
                break;
            }
            let goes_on = search.fill(Until { budget_s, variance_m2: aim_m2 }, observe);
            let no_more = search.variance_m2() > aim_m2 || !goes_on;
            if let Ok(found) = self.within_budget(&mut search, budget_s)
                && found.promise.u_m < plan.promise.u_m
            {
                plan = found;
            }
            plan.stopped = !goes_on;
            if no_more {
                break;
            }
            let stated_m2 = plan.promise.u_m.powi(2) - self.request.repeatability_m2();
            aim_m2 *= wanted_m2.map_or(1.0, |wanted_m2| (wanted_m2 / stated_m2).min(1.0) * 0.995);
        }
        plan
    }

    /// The plan with the fewest lines from these stands that tells everything. Stopped, it is what there was by then.
    fn shortest(
        &self,
        set: &[usize],
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<Option<(Search<'a>, Plan)>, PlanError> {
        let mut search = self.search(set)?;
        let mut goes_on = search.fill(Until { budget_s: 0.0, variance_m2: 0.0 }, observe);
        loop {
            let path = Path::new(self.request, &search, self.may_turn);
            if let Ok(plan) = path.stated(self.request) {
                return Ok(Some((search, Plan { stopped: !goes_on, ..plan })));
            }
            if !goes_on {
                return Err(PlanError::Stopped);
            }
            let (before, time_s) = (search.chosen.len(), search.time_s());
            let one_more_s = search.candidates.iter().map(|line| line.time_s).fold(0.0, f64::max) * 1.5;
            let more_s = one_more_s + self.request.motion.holder_change_s;
            goes_on = search.fill(Until { budget_s: time_s + more_s, variance_m2: 0.0 }, observe);
            if search.chosen.len() == before {
                return Ok(None);
            }
        }
    }
}

fn stopped(problem: PlanError) -> PlanError {
    match problem {
        PlanError::Identify(_) => PlanError::Stopped,
        other => other,
    }
}

/// The lines in their order, with times.
struct Path {
    stations: Vec<Station>,
    lines: Vec<Line>,
    planned: Vec<Planned>,
    time_s: f64,
}

impl Path {
    fn new(request: &Request, search: &Search, may_turn: bool) -> Path {
        let mut path = Path { stations: Vec::new(), lines: Vec::new(), planned: Vec::new(), time_s: 0.0 };
        let mut numbers: Vec<usize> = search.chosen.iter().map(|k| search.station[*k]).collect();
        numbers.sort_unstable();
        numbers.dedup();
        for number in numbers {
            let own = search.chosen.iter().filter(|k| search.station[**k] == number);
            let lines: Vec<Candidate> = own.map(|k| search.candidates[*k]).collect();
            path.drive(request, &ordered(request, &lines, may_turn));
        }
        path
    }

    fn drive(&mut self, request: &Request, legs: &[Leg]) {
        let Some(first) = legs.first() else { return };
        let stand = &request.stands[first.line.stand];
        let motion = &request.motion;
        self.time_s += motion.station_change_s;
        let name = free_name(request, &stand.name);
        let mut before: Option<Candidate> = None;
        for (k, leg) in legs.iter().enumerate() {
            let (line, start_m) = (leg.line, leg.line.ends_m[0]);
            let from_m = before.map_or(start_m, |line| line.ends_m[1]);
            self.time_s += way_s(request, from_m, &leg.via_m, start_m);
            if before.is_some_and(|before| before.holder != line.holder) {
                self.time_s += motion.holder_change_s;
            }
            let name = format!("{name}-{:02}", k + 1);
            self.measure(request, leg, (name, leg.via_m.last().copied().unwrap_or(from_m)));
            before = Some(line);
        }
        self.stations.push(Station { name, position_m: stand.position_m });
    }

    fn measure(&mut self, request: &Request, leg: &Leg, (name, mut at_m): (String, [f64; 3])) {
        let (line, motion) = (&leg.line, &request.motion);
        let offset_m = request.holders[line.holder].offset_m;
        let points_m: Vec<[f64; 3]> = line.readings_m().collect();
        let step_m = line.length_m() / f64::from(line.points.saturating_sub(1).max(1));
        let mut times_s = Vec::with_capacity(points_m.len());
        for (k, reading_m) in points_m.iter().enumerate() {
            if k > 0 {
                self.time_s += move_s(step_m, line.feed_m_s, motion.acceleration_m_s2);
            }
            self.time_s += motion.dwell_s;
            times_s.push(self.time_s);
            self.planned.push(Planned {
                station: self.stations.len() as u32,
                line: self.lines.len() as u32,
                time_s: self.time_s,
                reading_m: *reading_m,
                offset_m,
                moved_m: std::array::from_fn(|d| reading_m[d] - at_m[d]),
                feed_m_s: line.feed_m_s,
            });
            at_m = *reading_m;
        }
        let (station, holder, feed_m_s) = (self.stations.len(), line.holder, line.feed_m_s);
        self.lines.push(Line {
            name,
            station,
            holder,
            offset_m,
            via_m: leg.via_m.clone(),
            points_m,
            times_s,
            feed_m_s,
        });
    }

    /// The plan with what it will reach.
    fn stated(self, request: &Request) -> Result<Plan, PlanError> {
        let names = self.stations.iter().map(|s| s.name.clone()).collect();
        let lines = self.lines.iter().map(|line| line.name.clone()).collect();
        let nominal = covariates::campaign(request, (names, lines), &self.planned);
        let new: Vec<StationStart> = self.stations.iter().map(|s| start(s.position_m)).collect();
        let (campaign, stations, misfit) = with_measured(request, &nominal, new);
        let state = |campaign: &Campaign, stations: &[StationStart]| {
            promise::of_geometry(
                known(request, &request.belief, misfit),
                (campaign, stations),
                &request.volume_m,
                &request.tips_m,
            )
        };
        let promise = state(&campaign, &stations)?;
        let bent = |times: f64| {
            let belief = request.belief.bending(times);
            let nominal = (&campaign, stations.as_slice());
            promise::rms_m(known(request, &belief, misfit), nominal, &request.volume_m, &request.tips_m)
        };
        let if_bent_m = [bent(0.5)?, bent(2.0)?];
        let before = match &request.measured {
            Some(measured) => {
                let own = measured.stations();
                Some(state(&measured.campaign, &own)?)
            }
            None => None,
        };
        let Path { stations, lines, time_s, .. } = self;
        Ok(Plan { stations, lines, nominal, time_s, promise, before, if_bent_m, stopped: false })
    }
}

fn known<'a>(request: &'a Request, belief: &'a Belief, misfit: (f64, [f64; 3])) -> Known<'a> {
    let Request { machine, instrument, options, .. } = request;
    Known { machine, instrument: *instrument, options, belief, misfit }
}

/// What of a plan's uncertainty the scale makes that all lengths of the instrument have in common (m).
fn common_m(request: &Request, plan: &Plan) -> Result<f64, PlanError> {
    if request.instrument.common_per_metre == 0.0 {
        return Ok(0.0);
    }
    let new: Vec<StationStart> = plan.stations.iter().map(|s| start(s.position_m)).collect();
    let (campaign, stations, misfit) = with_measured(request, &plan.nominal, new);
    let mut without = known(request, &request.belief, misfit);
    without.instrument.common_per_metre = 0.0;
    let rest_m = promise::rms_m(without, (&campaign, &stations), &request.volume_m, &request.tips_m)?;
    Ok((plan.promise.u_m.powi(2) - rest_m.powi(2)).max(0.0).sqrt())
}

fn start(position_m: [f64; 3]) -> StationStart {
    StationStart { position_m: Vector3::from(position_m), dead_path_m: 0.0 }
}

/// A stand's name, unless the measured campaign has a station of that name.
fn free_name(request: &Request, name: &str) -> String {
    let taken = |name: &str| request.measured.as_ref().is_some_and(|m| m.campaign.stations.iter().any(|s| s == name));
    let mut free = name.to_owned();
    while taken(&free) {
        free.push_str("-new");
    }
    free
}

/// The planned readings behind those that were measured, with their stations and what is known of the noise.
fn with_measured(
    request: &Request,
    nominal: &Campaign,
    new: Vec<StationStart>,
) -> (Campaign, Vec<StationStart>, (f64, [f64; 3])) {
    let Some(measured) = &request.measured else { return (nominal.clone(), new, (1.0, [0.0; 3])) };
    let quality = &measured.fit.model.parts().quality;
    let mut all = measured.campaign.clone();
    let (stations, lines) = (all.stations.len() as u32, all.lines.len() as u32);
    let end_s = all.readings.iter().map(|r| r.time_s).fold(0.0, f64::max);
    all.stations.extend(nominal.stations.iter().cloned());
    all.lines.extend(nominal.lines.iter().cloned());
    all.readings.extend(nominal.readings.iter().map(|r| {
        let (station, line) = (r.station + stations, r.line + lines);
        abbe_measurement::campaign::RangeReading { station, line, time_s: r.time_s + end_s, ..*r }
    }));
    // A covariate that is logged in only one of the two is not logged for every reading.
    all.covariates.retain(|column| nominal.covariate(&column.name).is_some());
    for column in &mut all.covariates {
        column.values.extend(nominal.covariate(&column.name).into_iter().flat_map(|own| own.values.iter().copied()));
    }
    let starts = measured.stations().into_iter().chain(new).collect();
    (all, starts, (quality.chi2_per_dof, quality.unexplained_m))
}
