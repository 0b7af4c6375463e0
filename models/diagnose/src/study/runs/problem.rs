//! Positioning runs as a study: rows, base column, candidates of each axis, cycles as blocks.
//!
//! Place in the flow: between the shapes and the common search. One row an approach, error over 1 µm.

mod aliases;
mod bands;
mod in_turn;
mod lack;
mod smooth;
mod untold;

use super::given::{given, mended};
use super::instrument;
use super::model;
use super::naming::named;
use super::order::{gaps, in_order};
use super::positions::key;
use super::shape::{Ranges, Shape, is_temperature};
use super::step::Steps;
use super::{Approach, Run};
use crate::error::DiagnoseError;
use crate::study::candidate::{Band, Candidate, Chain, Local, ModelTerm, Open, Question, Study, Untold};
use crate::study::grid::{common_step_m, equal_step_m};
use crate::study::outcome::{Ambiguity, Untestable};
use crate::study::smooth::{legendre, levels, range};
use crate::study::told::Changed;
use abbe_geometry::unseen_expansion::UnseenExpansion;
use faer::{Mat, Scale};
use std::collections::{BTreeMap, BTreeSet};

/// Only ratios matter: no uncertainty is declared.
const UNIT_M: f64 = 1e-6;
const FEWEST_CYCLES: usize = 3;
/// Steps of the scan of periods in a cycle over the range of targets.
const OVERSAMPLING: f64 = 4.0;
/// Targets from which a wave of unknown period, three unknowns in many guises, can be told from a table of errors.
const FEWEST_FOR_WAVES: usize = 12;
/// Time constants tested: the duration over the longest, their ratio, and how many.
const CREEP: (f64, f64, i32) = (2.9, 2.1, 5);
/// Of these, for offset and scale: a shorter one is over before an axis has been gone along, and is an error of some first runs.
const GROWTHS: i32 = 2;
/// Cycles from which such a growth is told from a drift when any one of them is left out: those of the standard.
const FEWEST_FOR_GROWTH: usize = 5;
/// How far a time constant may be adjusted, as a share of its inverse: halfway to the next one and a little more. The longest then stays
/// near half of the duration: what was not seen to come to rest is a drift.
const CREEP_REACH: f64 = 0.38;

/// One axis.
struct AxisRuns {
    name: String,
    rows: Vec<usize>,
    ranges: Ranges,
    quantities: Vec<(String, (f64, f64), usize)>,
    /// Equal distance of neighbouring targets (m).
    step_m: Option<f64>,
    /// Distance (m) of which all steps are whole multiples.
    common_step_m: Option<f64>,
    steps: Steps,
}

/// All runs.
pub(super) struct Runs {
    runs: Vec<Run>,
    /// Row of the file of each run.
    rows: Vec<usize>,
    axes: Vec<AxisRuns>,
    chains: Vec<Chain>,
    blocks: Vec<Vec<usize>>,
    candidates: Vec<Candidate>,
    /// Axis and shape of each candidate, and the shapes as they were proposed.
    shapes: Vec<(usize, Shape)>,
    proposed: Vec<(usize, Shape)>,
    questions: Vec<Question>,
    untestable: Vec<Untestable>,
    /// Frequencies (1/m) at which waves found go nearly as well.
    aliases: BTreeMap<usize, Vec<f64>>,
    notes: Vec<String>,
    /// Time of the first run (s).
    start_s: f64,
}

impl Runs {
    pub(super) fn new(runs: &[Run]) -> Result<Runs, DiagnoseError> {
        let (rows, mut notes) = given(runs)?;
        let (runs, said) = mended(rows.iter().map(|row| runs[*row].clone()).collect());
        notes.extend(said);
        let names: BTreeSet<String> = runs.iter().map(|run| run.axis.clone()).collect();
        let start_s = runs.iter().filter_map(|run| run.time_s).fold(f64::INFINITY, f64::min);
        let mut study = Runs {
            runs,
            rows,
            axes: Vec::new(),
            chains: Vec::new(),
            blocks: Vec::new(),
            candidates: Vec::new(),
            shapes: Vec::new(),
            proposed: Vec::new(),
            questions: Vec::new(),
            untestable: Vec::new(),
            aliases: BTreeMap::new(),
            notes,
            start_s,
        };
        for name in names {
            study.add_axis(&name)?;
        }
        study.proposed.clone_from(&study.shapes);
        Ok(study)
    }

    fn add_axis(&mut self, name: &str) -> Result<(), DiagnoseError> {
        let rows: Vec<usize> = (0..self.runs.len()).filter(|k| self.runs[*k].axis == name).collect();
        let (rows, note) = in_order(rows, &self.runs);
        self.notes.extend(note.map(|note| format!("Axis {name}: {note}")));
        let is_order = rows.iter().any(|row| self.runs[*row].time_s.is_none());
        if is_order {
            rows.iter().enumerate().for_each(|(k, row)| self.runs[*row].time_s = Some(k as f64));
        }
        let mut cycles: BTreeMap<i64, Vec<usize>> = BTreeMap::new();
        rows.iter().for_each(|row| cycles.entry(self.runs[*row].cycle).or_default().push(*row));
        if cycles.len() < FEWEST_CYCLES {
            return Err(DiagnoseError::Data {
                problem: format!("axis {name} has {} cycles, at least {FEWEST_CYCLES} are needed", cycles.len()),
                remedy: "repeat the targets; ISO 230-2 asks for five cycles".to_owned(),
            });
        }
        let axis = AxisRuns::new(name, rows, is_order, &self.runs)?;
        self.chains.push(axis.chain(&self.runs));
        self.blocks.extend(cycles.into_values());
        let (mut shapes, untestable) = axis.shapes(self.only_side(&axis).is_none(), &self.runs);
        shapes.extend(axis.steps.all(&self.runs, &self.rows).into_iter().map(Shape::Step));
        let first = self.candidates.len();
        let numbered = |wanted: &dyn Fn(&Shape) -> bool| -> Vec<usize> {
            shapes.iter().enumerate().filter(|(_, shape)| wanted(shape)).map(|(k, _)| first + k).collect()
        };
        let question =
            |what: &str, candidates: Vec<usize>| Question { what: format!("{what}, axis {name}"), candidates };
        self.questions.push(question("drift or step in time", numbered(&Shape::is_of_time)));
        self.questions.push(question("reversal value", numbered(&Shape::is_reversal)));
        for shape in shapes {
            self.candidates.push(named(&axis.name, &axis.ranges, &shape));
            self.shapes.push((self.axes.len(), shape));
        }
        self.untestable.extend(untestable);
        self.axes.push(axis);
        Ok(())
    }

    fn ranges(&self, axis: usize, shape: &Shape) -> Ranges {
        let axis = &self.axes[axis];
        let own = shape.scaled_by().and_then(|name| axis.quantities.iter().find(|(own, ..)| own == name));
        let quantity = own.map(|(_, range, _)| *range);
        Ranges { quantity, ..axis.ranges.clone() }
    }

    fn shape_columns(&self, axis: usize, shape: &Shape) -> Mat<f64> {
        let own = self.shape_at(axis, shape, &self.axes[axis].rows);
        let mut columns = Mat::zeros(self.runs.len(), own.ncols());
        for (i, row) in self.axes[axis].rows.iter().enumerate() {
            (0..own.ncols()).for_each(|j| columns[(*row, j)] = own[(i, j)]);
        }
        columns
    }

    /// Columns at some runs of the axis.
    fn shape_at(&self, axis: usize, shape: &Shape, rows: &[usize]) -> Mat<f64> {
        let ranges = self.ranges(axis, shape);
        let mut columns = Mat::zeros(rows.len(), shape.parameters(&ranges).len());
        for (i, row) in rows.iter().enumerate() {
            // Shapes are proposed only where every run of the axis has what they need.
            for (j, value) in shape.columns(&self.runs[*row], &ranges).into_iter().flatten().enumerate() {
                columns[(i, j)] = value / UNIT_M;
            }
        }
        columns
    }

    fn name(&mut self, candidate: usize) {
        let (axis, shape) = &self.shapes[candidate];
        self.candidates[candidate] = named(&self.axes[*axis].name, &self.axes[*axis].ranges, shape);
    }
}

impl AxisRuns {
    fn new(name: &str, rows: Vec<usize>, is_order: bool, runs: &[Run]) -> Result<AxisRuns, DiagnoseError> {
        let of = |value: &dyn Fn(&Run) -> Option<f64>| -> Option<Vec<f64>> {
            rows.iter().map(|row| value(&runs[*row])).collect()
        };
        let targets: BTreeSet<i64> = rows.iter().map(|row| key(runs[*row].target_m)).collect();
        let targets: Vec<i64> = targets.into_iter().collect();
        let target_m = of(&|run| Some(run.target_m)).as_deref().and_then(range).ok_or_else(|| DiagnoseError::Data {
            problem: format!("axis {name} has one target only"),
            remedy: "measure at several targets along the axis; what drifts at one place goes in as residual vectors"
                .to_owned(),
        })?;
        let names: BTreeSet<&String> = rows.iter().flat_map(|row| runs[*row].covariates.keys()).collect();
        let quantity = |name: &&String| {
            let values = of(&|run| run.covariates.get(*name).copied())?;
            Some(((*name).clone(), range(&values)?, levels(&values)))
        };
        let quantities = names.iter().filter_map(quantity).collect();
        let ranges = Ranges {
            target_m,
            time_s: of(&|run| run.time_s).as_deref().and_then(range),
            is_order,
            cycle: of(&|run| Some(run.cycle as f64)).as_deref().and_then(range),
            quantity: None,
            targets,
        };
        let step_m = equal_step_m(&ranges.targets);
        let common_step_m = common_step_m(&ranges.targets);
        let steps = Steps::new(&rows, is_order, runs);
        Ok(AxisRuns { name: name.to_owned(), rows, ranges, quantities, step_m, common_step_m, steps })
    }

    /// The runs in order; single ones are held against the mean of their place (target and direction) and the offset and
    /// slope of their cycle, as far as there are runs for these.
    fn chain(&self, runs: &[Run]) -> Chain {
        let distinct = |key: &dyn Fn(&Run) -> i64| -> Vec<i64> {
            let all: BTreeSet<i64> = self.rows.iter().map(|row| key(&runs[*row])).collect();
            all.into_iter().collect()
        };
        let (places, cycles) = (distinct(&place), distinct(&|run| run.cycle));
        let count = self.rows.len();
        let with_slopes = places.len() + 2 * cycles.len() <= count / 2;
        let width = places.len() + cycles.len() * if with_slopes { 2 } else { 1 };
        let mut rich = Mat::zeros(count, width);
        for (i, row) in self.rows.iter().enumerate() {
            let run = &runs[*row];
            let along = legendre(run.target_m, self.ranges.target_m, 1)[1];
            if let (Ok(p), Ok(c)) = (places.binary_search(&place(run)), cycles.binary_search(&run.cycle)) {
                rich[(i, p)] = 1.0;
                rich[(i, places.len() + c)] = 1.0;
                if with_slopes {
                    rich[(i, places.len() + cycles.len() + c)] = along;
                }
            }
        }
        Chain {
            of: format!("axis {}", self.name),
            rows: self.rows.clone(),
            gaps: gaps(&self.rows, runs),
            rich,
            unit_m: UNIT_M,
            along: model::axis_of(&self.name),
        }
    }

    /// Shapes worth testing, and what cannot be.
    fn shapes(&self, both: bool, runs: &[Run]) -> (Vec<Shape>, Vec<Untestable>) {
        let mut untestable = Vec::new();
        let mut needs = |what: &str, needs: String| {
            untestable.push(Untestable { name: format!("{what}, axis {}", self.name), needs });
        };
        let count = self.ranges.targets.len();
        // With more coefficients than half of the targets a polynomial only passes through them, and runs off between and beyond.
        let degree = |most: usize| most.min((count / 2).max(1));
        let mut shapes: Vec<Shape> = (1..=degree(6)).map(Shape::Position).collect();
        shapes.push(Shape::PositionTable);
        if both {
            shapes.extend([Shape::Lost(0), Shape::Lost(degree(1)), Shape::Lost(degree(3)), Shape::LostTable]);
        } else {
            needs("reversal value", "approach every target from both sides".to_owned());
        }
        shapes.extend([Shape::Cycle(1), Shape::DriftTable]);
        if both {
            shapes.push(Shape::LostWithCycle);
        }
        if let Some((first, last)) = self.ranges.time_s {
            shapes.extend([Shape::Time(1), Shape::Time(2), Shape::Time(4), Shape::TimeAndTarget]);
            let span_s = |k: i32| (last - first) / (CREEP.0 * CREEP.1.powi(k));
            shapes.extend((0..CREEP.2).map(|k| Shape::Creep(span_s(k))));
            let cycles = self.rows.iter().map(|row| runs[*row].cycle).collect::<BTreeSet<i64>>().len();
            let growths = if cycles >= FEWEST_FOR_GROWTH { GROWTHS } else { 0 };
            shapes.extend((0..growths).map(|k| Shape::Growth(span_s(k))));
        }
        if self.ranges.is_order || self.ranges.time_s.is_none() {
            let remedy = "write the time of every run in time_s; the order of measurement stands for it until then";
            needs("drift with time", remedy.to_owned());
        }
        if count < FEWEST_FOR_WAVES {
            let problem = format!(
                "measure {FEWEST_FOR_WAVES} targets or more: at {count} a wave cannot be told from errors target by target"
            );
            needs("periodic error", problem);
        }
        if let Some(step_m) = self.common_step_m {
            let step_mm = step_m * 1e3;
            let remedy = "measure at irregular steps: where all are whole multiples of one, such a wave is the same everywhere, and in no uncertainty";
            needs(&format!("periodic error whose period divides the step of {step_mm:.3} mm"), remedy.to_owned());
        }
        self.logged_shapes(both, &mut shapes, &mut needs);
        let partly: BTreeSet<&String> = self.rows.iter().flat_map(|row| runs[*row].covariates.keys()).collect();
        for name in partly.into_iter().filter(|name| self.quantities.iter().all(|(own, ..)| own != *name)) {
            let logged = self.rows.iter().filter(|row| runs[**row].covariates.contains_key(name)).count();
            let problem = if logged < self.rows.len() {
                format!("log {name} in every run: it stands in {logged} of {}", self.rows.len())
            } else {
                format!("vary {name}: it is the same in all runs")
            };
            needs(&format!("dependence on {name}"), problem);
        }
        shapes.extend(self.periods_m().into_iter().map(Shape::Periodic));
        shapes.dedup();
        (shapes, untestable)
    }

    fn logged_shapes(&self, both: bool, shapes: &mut Vec<Shape>, needs: &mut dyn FnMut(&str, String)) {
        for (name, _, levels) in &self.quantities {
            shapes.push(if is_temperature(name) {
                Shape::Expansion(name.clone())
            } else {
                Shape::ScaleBy(name.clone())
            });
            if both {
                shapes.push(Shape::LostBy(name.clone()));
            }
            shapes
                .extend([1, 2, 3].into_iter().filter(|degree| degree < levels).map(|d| Shape::Smooth(name.clone(), d)));
        }
        if !self.quantities.iter().any(|(name, ..)| is_temperature(name)) {
            let sensor =
                "log a temperature of the scale (temp_scale_x_c or the like) while it changes by a kelvin or more";
            needs("expansion of the scale", sensor.to_owned());
        }
    }
}

impl Study for Runs {
    fn of(&self) -> &'static str {
        "positioning runs (ISO 230-2)"
    }

    fn candidates(&self) -> &[Candidate] {
        &self.candidates
    }

    fn together(&self) -> Vec<Vec<usize>> {
        self.tables()
    }

    fn local(&self, _added: &[(usize, Vec<f64>)]) -> Result<Local, DiagnoseError> {
        let mut base = Mat::zeros(self.runs.len(), self.axes.len());
        for (k, axis) in self.axes.iter().enumerate() {
            axis.rows.iter().for_each(|row| base[(*row, k)] = 1.0 / UNIT_M);
        }
        let residual = self.runs.iter().map(|run| run.error_m() / UNIT_M).collect();
        Ok(Local { residual, base, point: Vec::new() })
    }

    fn columns(&self, _point: &[f64], candidate: usize) -> Mat<f64> {
        let (axis, shape) = &self.shapes[candidate];
        self.shape_columns(*axis, shape)
    }

    fn chain_columns(&self, candidate: usize, rows: &[usize]) -> Option<(usize, Mat<f64>)> {
        let (axis, shape) = &self.shapes[candidate];
        Some((*axis, self.shape_at(*axis, shape, rows)))
    }

    fn frequency(&self, candidate: usize) -> Option<(f64, f64)> {
        let (axis, shape) = &self.shapes[candidate];
        let (low, high) = self.axes[*axis].ranges.target_m;
        let reach = |rate: f64| match shape {
            Shape::Periodic(_) => (OVERSAMPLING * (high - low)).recip(),
            _ => rate * CREEP_REACH,
        };
        shape.rate().map(|rate| (rate, reach(rate)))
    }

    fn columns_at(&self, candidate: usize, frequency: f64, rows: &[usize]) -> Mat<f64> {
        let (axis, shape) = &self.shapes[candidate];
        self.shape_at(*axis, &shape.at_rate(frequency), rows)
    }

    fn band(&self, candidate: usize, rows: &[usize]) -> Option<Band> {
        let (axis, Shape::Periodic(_)) = &self.shapes[candidate] else { return None };
        self.axes[*axis].band(rows, &self.runs)
    }

    fn set_aliases(&mut self, candidate: usize, frequencies: Vec<f64>) {
        self.aliases.insert(candidate, frequencies);
    }

    fn set_frequency(&mut self, candidate: usize, frequency: f64) {
        self.shapes[candidate].1 = self.shapes[candidate].1.at_rate(frequency);
        self.name(candidate);
    }

    fn reset(&mut self) {
        self.shapes.clone_from(&self.proposed);
        let is_set = |k: &usize| self.shapes[*k].1.rate().is_some() || matches!(self.shapes[*k].1, Shape::Step(_));
        let all: Vec<usize> = (0..self.shapes.len()).filter(is_set).collect();
        all.into_iter().for_each(|k| self.name(k));
    }

    fn steps_after(&self, candidate: usize) -> Vec<usize> {
        let Shape::Step(jump) = &self.shapes[candidate].1 else { return Vec::new() };
        jump.step.before()
    }

    fn places(&self, candidate: usize) -> &[usize] {
        let (axis, Shape::Step(jump)) = &self.shapes[candidate] else { return &[] };
        self.axes[*axis].steps.places.of(&jump.step)
    }

    fn choices(&self, candidate: usize, places: &[usize]) -> f64 {
        let (axis, shape) = &self.shapes[candidate];
        match shape {
            Shape::Periodic(period_m) => self.axes[*axis].waves(*period_m, &self.runs) * self.forms_of(candidate),
            _ if self.places(candidate).is_empty() => 1.0,
            _ => self.axes[*axis].steps.places.tried(places),
        }
    }

    fn columns_from(&self, candidate: usize, places: &[usize], rows: &[usize]) -> Mat<f64> {
        let step = self.axes[self.shapes[candidate].0].steps.places.steps(places);
        let rows: Vec<(f64, f64)> =
            rows.iter().map(|row| (self.runs[*row].time_s.unwrap_or_default(), UNIT_M)).collect();
        step.columns(&rows)
    }

    fn set_places(&mut self, candidate: usize, places: &[usize]) {
        let axis = self.shapes[candidate].0;
        self.shapes[candidate].1 = Shape::Step(self.axes[axis].steps.at(places, &self.runs, &self.rows));
        self.name(candidate);
    }

    fn simpler(&self, candidate: usize) -> Mat<f64> {
        self.smooth_for(candidate)
    }

    fn smooth_beside(&self, candidate: usize) -> Vec<usize> {
        self.smooth_of(candidate)
    }

    fn passes(&self, candidate: usize) -> bool {
        self.shapes[candidate].1.is_of_time()
    }

    fn instrument_beside(&self, candidate: usize) -> Mat<f64> {
        let (axis, shape) = &self.shapes[candidate];
        let AxisRuns { rows, ranges, .. } = &self.axes[*axis];
        Scale(1.0 / UNIT_M) * instrument::columns(shape, (&self.runs, rows), ranges)
    }

    fn is_of_instrument(&self, candidate: usize) -> bool {
        instrument::does(&self.shapes[candidate].1)
    }

    fn instrument_words(&self) -> (&'static str, &'static str) {
        (instrument::RIVAL, instrument::STANDS_STILL)
    }

    fn keeps_doubted(&self) -> bool {
        true
    }

    fn changed_by_instrument(&self, candidate: usize, found: &[(usize, Vec<f64>)]) -> Option<Changed> {
        let (axis, shape) = &self.shapes[candidate];
        let of_axis = found.iter().filter(|(by, _)| self.shapes[*by].0 == *axis);
        let changed = |(by, values): &(usize, Vec<f64>)| {
            let reach = instrument::changed(shape, &self.shapes[*by].1, values, &self.axes[*axis].ranges)?;
            Some(Changed { by: *by, reach })
        };
        of_axis.filter_map(changed).next()
    }

    fn chains(&self) -> &[Chain] {
        &self.chains
    }

    fn given(&self, row: usize) -> Option<(usize, usize)> {
        Some((self.rows[row], 0))
    }

    fn row_name(&self, row: usize) -> String {
        let run = &self.runs[row];
        let sign = if run.approach == Approach::Positive { '+' } else { '-' };
        format!(
            "run {} (axis {}, target {:.3} mm, {sign}, cycle {})",
            self.rows[row] + 1,
            run.axis,
            run.target_m * 1e3,
            run.cycle
        )
    }

    fn questions(&self) -> Vec<Question> {
        self.questions.clone()
    }

    fn blocks(&self) -> &[Vec<usize>] {
        &self.blocks
    }

    fn block_word(&self) -> &str {
        "cycle"
    }

    fn rows_per_point(&self) -> usize {
        1
    }

    fn unit_m(&self) -> f64 {
        UNIT_M
    }

    fn is_declared(&self) -> bool {
        false
    }

    fn replicates(&self) -> Option<(String, Mat<f64>)> {
        let place = |run: &Run| (run.axis.clone(), place(run));
        let places: BTreeSet<_> = self.runs.iter().map(place).collect();
        let places: Vec<_> = places.into_iter().collect();
        let mut columns = Mat::zeros(self.runs.len(), places.len());
        for (row, run) in self.runs.iter().enumerate() {
            if let Ok(k) = places.binary_search(&place(run)) {
                columns[(row, k)] = 1.0 / UNIT_M;
            }
        }
        let repeated = places.len() < self.runs.len();
        repeated.then(|| ("runs to the same target in the same direction".to_owned(), columns))
    }

    fn base_word(&self) -> &'static str {
        "the mean offset of the axis"
    }

    fn model_terms(&self, candidate: usize) -> Result<Vec<ModelTerm>, String> {
        let (own, shape) = &self.shapes[candidate];
        let name = &self.axes[*own].name;
        let axis = model::axis_of(name).ok_or_else(|| format!("axis {name} is none of X, Y and Z"))?;
        let ranges = self.ranges(*own, shape);
        let mut terms = model::terms(axis, &ranges, shape, self.start_s)?;
        if !self.aliases_of(candidate).is_empty() {
            terms.push(model::alias(axis, &ranges));
        }
        Ok(terms)
    }

    fn model_covariates(&self, candidate: usize) -> Vec<String> {
        let (own, shape) = &self.shapes[candidate];
        model::axis_of(&self.axes[*own].name).map_or_else(Vec::new, |axis| model::covariates(axis, shape))
    }

    fn logged_rows(&self) -> Vec<&BTreeMap<String, f64>> {
        self.runs.iter().map(|run| &run.covariates).collect()
    }

    fn logged_at(&self, candidate: usize) -> Vec<&BTreeMap<String, f64>> {
        self.axes[self.shapes[candidate].0].rows.iter().map(|row| &self.runs[*row].covariates).collect()
    }

    fn unseen_expansions(&self, open: &Open) -> Vec<UnseenExpansion> {
        self.unseen(open)
    }

    fn model_range(&self, name: &str) -> Option<(f64, f64)> {
        self.measured_range(name)
    }

    fn untold(&self, open: &Open) -> Vec<Untold> {
        let beside = [self.untold_reversals(), self.untold_in_turn(open)].concat();
        [self.between_targets(open), self.untold_expansions(open), beside].concat()
    }

    fn apart(&self) -> Vec<String> {
        self.ranges_apart()
    }

    fn readings_m(&self) -> [Option<(f64, f64)>; 3] {
        let of =
            |axis| self.axes.iter().find(|own| model::axis_of(&own.name) == Some(axis)).map(|own| own.ranges.target_m);
        abbe_geometry::Axis::ALL.map(of)
    }

    fn hidden(&self) -> Vec<String> {
        [self.repeating(), self.one_after_the_other()].concat()
    }

    fn untestable(&self) -> Vec<Untestable> {
        self.untestable.clone()
    }

    fn ambiguities(&self, found: &[usize]) -> Vec<Ambiguity> {
        self.aliases_in_words(found)
    }

    fn notes(&self) -> Vec<String> {
        let meaning = "Reversal value B: mean error approaching in the positive direction less that in the negative.";
        std::iter::once(meaning.to_owned()).chain(self.notes.iter().cloned()).collect()
    }
}

/// Target and direction as one number.
fn place(run: &Run) -> i64 {
    2 * key(run.target_m) + i64::from(run.approach == Approach::Positive)
}
