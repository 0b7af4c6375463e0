//! Positioning runs as a study: rows, base column, candidates of each axis, cycles as blocks.
//!
//! Place in the flow: between the shapes and the common search. One row an approach, error over 1 µm.

use super::naming::named;
use super::positions::key;
use super::shape::{Ranges, Shape};
use super::{Approach, Run};
use crate::error::DiagnoseError;
use crate::linear::Linear;
use crate::score::{Score, score};
use crate::study::candidate::{Candidate, Local, Study};
use crate::study::diagnosis::{Ambiguity, Untestable};
use crate::study::fit::Fit;
use crate::study::smooth::{levels, range};
use faer::Mat;
use std::collections::{BTreeMap, BTreeSet};

/// Only ratios matter: no uncertainty is declared.
const UNIT_M: f64 = 1e-6;
const FEWEST_CYCLES: usize = 3;
/// Steps of the scan of periods in a cycle over the range of targets.
const OVERSAMPLING: f64 = 4.0;
/// Slowest periodic error told from a smooth one: cycles over the range of targets.
const SLOWEST: f64 = 2.0;
/// How far beyond the mean sampling limit irregular targets are trusted.
const BEYOND_LIMIT: f64 = 4.0;
/// Ratio of the time constants tested, and how many.
const CREEP: (f64, i32) = (2.1, 6);

/// One axis.
struct AxisRuns {
    name: String,
    rows: Vec<usize>,
    ranges: Ranges,
    quantities: Vec<(String, (f64, f64), usize)>,
    /// Equal distance of neighbouring targets (m).
    step_m: Option<f64>,
}

/// All runs.
pub(super) struct Runs {
    runs: Vec<Run>,
    axes: Vec<AxisRuns>,
    blocks: Vec<Vec<usize>>,
    candidates: Vec<Candidate>,
    /// Axis and shape of each candidate.
    shapes: Vec<(usize, Shape)>,
    untestable: Vec<Untestable>,
}

impl Runs {
    pub(super) fn new(runs: &[Run]) -> Result<Runs, DiagnoseError> {
        check(runs)?;
        let names: BTreeSet<&str> = runs.iter().map(|run| run.axis.as_str()).collect();
        let mut study = Runs {
            runs: runs.to_vec(),
            axes: Vec::new(),
            blocks: Vec::new(),
            candidates: Vec::new(),
            shapes: Vec::new(),
            untestable: Vec::new(),
        };
        for name in names {
            study.add_axis(name)?;
        }
        Ok(study)
    }

    fn add_axis(&mut self, name: &str) -> Result<(), DiagnoseError> {
        let rows: Vec<usize> = (0..self.runs.len()).filter(|k| self.runs[*k].axis == name).collect();
        let mut cycles: BTreeMap<i64, Vec<usize>> = BTreeMap::new();
        rows.iter().for_each(|row| cycles.entry(self.runs[*row].cycle).or_default().push(*row));
        if cycles.len() < FEWEST_CYCLES {
            return Err(DiagnoseError::Data {
                problem: format!("axis {name} has {} cycles, at least {FEWEST_CYCLES} are needed", cycles.len()),
                remedy: "repeat the targets; ISO 230-2 asks for five cycles".to_owned(),
            });
        }
        let axis = AxisRuns::new(name, rows, &self.runs)?;
        self.blocks.extend(cycles.into_values());
        let both = [Approach::Positive, Approach::Negative]
            .iter()
            .all(|approach| axis.rows.iter().any(|row| self.runs[*row].approach == *approach));
        let (shapes, untestable) = axis.shapes(both, &self.runs);
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
        let quantity = match shape {
            Shape::Smooth(name, _) => axis.quantities.iter().find(|(own, ..)| own == name).map(|(_, range, _)| *range),
            _ => None,
        };
        Ranges { quantity, ..axis.ranges.clone() }
    }

    fn shape_columns(&self, axis: usize, shape: &Shape) -> Mat<f64> {
        let ranges = self.ranges(axis, shape);
        let mut columns = Mat::zeros(self.runs.len(), shape.parameters(&ranges).len());
        for row in &self.axes[axis].rows {
            // Shapes are proposed only where every run of the axis has what they need.
            for (j, value) in shape.columns(&self.runs[*row], &ranges).into_iter().flatten().enumerate() {
                columns[(*row, j)] = value / UNIT_M;
            }
        }
        columns
    }
}

impl AxisRuns {
    fn new(name: &str, rows: Vec<usize>, runs: &[Run]) -> Result<AxisRuns, DiagnoseError> {
        let of = |value: &dyn Fn(&Run) -> Option<f64>| -> Option<Vec<f64>> {
            rows.iter().map(|row| value(&runs[*row])).collect()
        };
        let targets: BTreeSet<i64> = rows.iter().map(|row| key(runs[*row].target_m)).collect();
        let targets: Vec<i64> = targets.into_iter().collect();
        let target_m = of(&|run| Some(run.target_m)).as_deref().and_then(range).ok_or_else(|| DiagnoseError::Data {
            problem: format!("axis {name} has one target only"),
            remedy: "measure at several targets along the axis".to_owned(),
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
            cycle: of(&|run| Some(run.cycle as f64)).as_deref().and_then(range),
            quantity: None,
            targets,
        };
        let step_m = equal_step_m(&ranges.targets);
        Ok(AxisRuns { name: name.to_owned(), rows, ranges, quantities, step_m })
    }

    /// Shapes worth testing, and what cannot be.
    fn shapes(&self, both: bool, runs: &[Run]) -> (Vec<Shape>, Vec<Untestable>) {
        let mut untestable = Vec::new();
        let mut needs = |what: &str, needs: String| {
            untestable.push(Untestable { name: format!("{what}, axis {}", self.name), needs });
        };
        let count = self.ranges.targets.len();
        let degree = |most: usize| most.min(count.saturating_sub(1));
        let mut shapes: Vec<Shape> = (1..=degree(6)).map(Shape::Position).collect();
        shapes.push(Shape::PositionTable);
        if both {
            shapes.extend([Shape::Lost(0), Shape::Lost(degree(1)), Shape::Lost(degree(3)), Shape::LostTable]);
        } else {
            needs("reversal value", "approach every target from both sides".to_owned());
        }
        shapes.push(Shape::Cycle(1));
        match self.ranges.time_s {
            Some((first, last)) => {
                shapes.extend([Shape::Time(1), Shape::Time(2), Shape::Time(4), Shape::TimeAndTarget]);
                shapes.extend((0..CREEP.1).map(|k| Shape::Creep((last - first) / CREEP.0.powi(k))));
            }
            None => needs("drift with time", "write the time of every run in time_s".to_owned()),
        }
        self.logged_shapes(&mut shapes, &mut needs);
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

    fn logged_shapes(&self, shapes: &mut Vec<Shape>, needs: &mut dyn FnMut(&str, String)) {
        let is_temperature = |name: &str| name.starts_with("temp_") && name.ends_with("_c");
        for (name, _, levels) in &self.quantities {
            if is_temperature(name) {
                shapes.push(Shape::Expansion(name.clone()));
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

    /// Periods from the slowest told from a smooth error to the fastest that the targets resolve.
    fn periods_m(&self) -> Vec<f64> {
        let span_m = self.ranges.target_m.1 - self.ranges.target_m.0;
        let limit = (self.ranges.targets.len() as f64 - 1.0) / 2.0;
        // At the limit itself a sine at equal steps is the sampled zero.
        let fastest = if self.step_m.is_some() { limit * (1.0 - 1e-9) } else { limit * BEYOND_LIMIT };
        let first = (SLOWEST * OVERSAMPLING).ceil() as usize;
        let last = (fastest * OVERSAMPLING).floor() as usize;
        (first..=last).map(|k| span_m * OVERSAMPLING / k as f64).collect()
    }
}

impl Study for Runs {
    fn of(&self) -> &'static str {
        "positioning runs (ISO 230-2)"
    }

    fn candidates(&self) -> &[Candidate] {
        &self.candidates
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

    /// The period between those scanned that explains most (golden section on the frequency).
    fn refine(&mut self, without: &Linear, candidate: usize) {
        let (axis, Shape::Periodic(period_m)) = self.shapes[candidate].clone() else { return };
        let span_m = self.axes[axis].ranges.target_m.1 - self.axes[axis].ranges.target_m.0;
        let explained = |frequency: f64| {
            let columns = self.shape_columns(axis, &Shape::Periodic(1.0 / frequency));
            score(&without.project(columns.as_ref()), without.chi2(), without.degrees()).reduction
        };
        let reach = 1.0 / (OVERSAMPLING * span_m);
        let frequency = golden_section((1.0 / period_m - reach, 1.0 / period_m + reach), explained);
        self.shapes[candidate].1 = Shape::Periodic(1.0 / frequency);
        let refined = named(&self.axes[axis].name, &self.axes[axis].ranges, &self.shapes[candidate].1);
        self.candidates[candidate] = refined;
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

    fn lack_of_fit(&self, fit: &Fit) -> Option<(String, Score)> {
        let place = |run: &Run| (run.axis.clone(), key(run.target_m), run.approach);
        let places: BTreeSet<_> = self.runs.iter().map(place).collect();
        let places: Vec<_> = places.into_iter().collect();
        let mut columns = Mat::zeros(self.runs.len(), places.len());
        for (row, run) in self.runs.iter().enumerate() {
            if let Ok(k) = places.binary_search(&place(run)) {
                columns[(row, k)] = 1.0 / UNIT_M;
            }
        }
        let repeated = places.len() < self.runs.len();
        repeated
            .then(|| ("runs to the same target in the same direction".to_owned(), fit.score_columns(columns.as_ref())))
    }

    fn base_word(&self) -> &'static str {
        "the mean offset of the axis"
    }

    fn untestable(&self) -> Vec<Untestable> {
        self.untestable.clone()
    }

    /// Equal steps make a short period look like a long one.
    fn ambiguities(&self, found: &[usize]) -> Vec<Ambiguity> {
        let mut list = Vec::new();
        for candidate in found {
            let (axis, Shape::Periodic(period_m)) = &self.shapes[*candidate] else { continue };
            let Some(step_m) = self.axes[*axis].step_m else { continue };
            let alias_mm = |sign: f64| 1e3 / (1.0 / step_m + sign / period_m);
            let because = format!(
                "targets at equal steps of {:.4} mm: periods of {:.4} mm, {:.4} mm and shorter ones give the same errors",
                step_m * 1e3,
                alias_mm(-1.0),
                alias_mm(1.0)
            );
            let decided_by = "measure a stretch at irregular steps, or at a tenth of the shortest period suspected";
            let effects = vec![self.candidates[*candidate].name.clone()];
            list.push(Ambiguity { effects, because, decided_by: decided_by.to_owned() });
        }
        list
    }

    fn notes(&self) -> Vec<String> {
        vec!["Reversal value B: mean error approaching in the positive direction less that in the negative.".to_owned()]
    }
}

/// The distance of neighbouring targets where all are equal to a thousandth.
fn equal_step_m(targets: &[i64]) -> Option<f64> {
    let steps: Vec<f64> = targets.windows(2).map(|pair| (pair[1] - pair[0]) as f64 * 1e-9).collect();
    let mean = steps.iter().sum::<f64>() / steps.len() as f64;
    steps.iter().all(|step| (step - mean).abs() <= 1e-3 * mean).then_some(mean)
}

/// Maximum of a function with one peak between the ends.
fn golden_section((mut low, mut high): (f64, f64), value: impl Fn(f64) -> f64) -> f64 {
    let ratio = 0.5 * (5f64.sqrt() - 1.0);
    for _ in 0..40 {
        let (a, b) = (high - ratio * (high - low), low + ratio * (high - low));
        if value(a) > value(b) { high = b } else { low = a }
    }
    0.5 * (low + high)
}

fn check(runs: &[Run]) -> Result<(), DiagnoseError> {
    let data = |problem: String, remedy: &str| Err(DiagnoseError::Data { problem, remedy: remedy.to_owned() });
    if runs.is_empty() {
        return data("there are no runs".to_owned(), "give one row for each approach to a target");
    }
    for (k, run) in runs.iter().enumerate() {
        let logged = run.covariates.values().chain(&run.time_s);
        if !logged.chain([&run.target_m, &run.measured_m]).all(|value| value.is_finite()) {
            return data(format!("run {} holds a figure that is not finite", k + 1), "remove or correct it");
        }
    }
    Ok(())
}
