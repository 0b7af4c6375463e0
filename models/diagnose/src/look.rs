//! The look without candidates: does the residual depend on any logged quantity, or any two of them, in a smooth or
//! periodic way?
//!
//! Place in the flow: each round of [`crate::search`], beside the named effects. Quantities are covariates, time, scales
//! and offsets; each is scaled to −1 … 1 over its range. For each direction of the tip and for the range, Legendre
//! products up to total degree 2, 3 and 4 of every pair, with and without what each does alone, and sines of up to 48 half cycles of every quantity are
//! tested with the model's columns projected out. What is found becomes an empirical term if no named effect explains it.

use crate::candidates::Round;
use crate::context::Context;
use crate::linear::{Linear, Projected};
use crate::score::Score;
use abbe_geometry::ErrorId;
use abbe_geometry::effects::{self, Shape, State, is_scale};
use abbe_identify::{CampaignRow, Rows, in_parallel};
use abbe_measurement::campaign::Campaign;
use faer::Mat;
use std::f64::consts::TAU;

/// Total degree of the products.
const DEGREE: usize = 4;
/// Degrees tried when the term is made: as many as the data pay for.
pub(crate) const TERM_DEGREES: std::ops::RangeInclusive<usize> = 1..=6;
/// Mixed products of two quantities: degrees in each.
const MIXED: [(usize, usize); 6] = [(1, 1), (2, 1), (1, 2), (3, 1), (2, 2), (1, 3)];
/// Half cycles of sines over a quantity's range.
const HALF_CYCLES: std::ops::RangeInclusive<usize> = 3..=48;
/// Sines scored exactly, of those that look best before projection.
const SINES: usize = 24;
/// Correlation from which two quantities are one to the data.
const SAME: f64 = 0.9995;
/// Forms of each pair.
const FORMS: usize = 6;
/// Findings kept of one look.
const KEPT: usize = 3;
/// Quantities that every reading has: scales, and offsets of the reflector.
const POSITIONS: [&str; 6] = ["x_m", "y_m", "z_m", "offset_x_m", "offset_y_m", "offset_z_m"];
/// What a term may act on.
pub(crate) const ACTS: [&str; 4] = ["x", "y", "z", "range"];

/// A quantity over all readings.
#[derive(Debug, Clone)]
pub(crate) struct Variable {
    pub(crate) name: String,
    pub(crate) low: f64,
    pub(crate) high: f64,
    /// Scaled to −1 … 1, one a reading.
    scaled: Vec<f64>,
}

/// Something the residual depends on.
#[derive(Debug, Clone)]
pub(crate) struct Finding {
    /// What it acts on: one of [`ACTS`].
    pub(crate) acts: &'static str,
    /// One or two quantities.
    pub(crate) variables: Vec<usize>,
    /// Half cycles of a sine; `None` for a polynomial.
    pub(crate) half_cycles: Option<usize>,
    pub(crate) score: Score,
    /// Groups among which it was found.
    pub(crate) trials: usize,
}

impl Finding {
    /// Shapes that act as found, and on each joint's angles instead, of the degree looked with.
    pub(crate) fn acting(&self, variables: &[Variable]) -> Vec<Shape> {
        let joints = ErrorId::all().filter(|id| id.is_angular()).map(|id| id.name());
        let mut acts = vec![self.acts.to_owned()];
        if self.acts != "range" {
            acts.extend(joints);
        }
        acts.iter().map(|acts| self.shape(variables, acts).number(self.form().0, self.form().1)).collect()
    }

    fn form(&self) -> (&'static str, f64) {
        self.half_cycles.map_or(("degree", DEGREE as f64), |half| ("cycles", half as f64 / 2.0))
    }

    fn shape(&self, variables: &[Variable], acts: &str) -> Shape {
        let keys = [["p", "p_low", "p_high"], ["q", "q_low", "q_high"]];
        let mut shape = Shape::new().text("acts", acts);
        for (index, [name, low, high]) in self.variables.iter().zip(keys) {
            let variable = &variables[*index];
            shape = shape.text(name, &variable.name).number(low, variable.low).number(high, variable.high);
        }
        shape
    }
}

/// The same term in all degrees, with and without what each quantity does alone.
pub(crate) fn forms(shape: &Shape) -> Vec<Shape> {
    if shape.0.contains_key("cycles") {
        return vec![shape.clone()];
    }
    let all = TERM_DEGREES.map(|degree| shape.clone().number("degree", degree as f64));
    let mixed = TERM_DEGREES.map(|degree| shape.clone().number("degree", degree as f64).number("mixed", 1.0));
    if shape.0.contains_key("q") { all.chain(mixed).collect() } else { all.collect() }
}

/// The quantities of a campaign that vary, each one once.
pub(crate) fn variables(campaign: &Campaign, context: &Context) -> Vec<Variable> {
    let mut variables: Vec<Variable> = Vec::new();
    for name in POSITIONS.into_iter().chain(context.varying.iter().map(String::as_str)) {
        let Some(variable) = variable(campaign, name) else { continue };
        if !variables.iter().any(|other| correlation(&other.scaled, &variable.scaled).abs() > SAME) {
            variables.push(variable);
        }
    }
    variables
}

fn variable(campaign: &Campaign, name: &str) -> Option<Variable> {
    let value = |reading: usize| {
        let r = &campaign.readings[reading];
        let row = CampaignRow { campaign, reading };
        State { reading_m: r.reading_m, offset_m: r.offset_m, covariates: &row }.quantity(name).ok()
    };
    let values = (0..campaign.readings.len()).map(value).collect::<Option<Vec<f64>>>()?;
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if high <= low {
        return None;
    }
    let scaled = values.iter().map(|v| 2.0 * (v - low) / (high - low) - 1.0).collect();
    Some(Variable { name: name.to_owned(), low, high, scaled })
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len().max(1) as f64;
    let (ma, mb) = (mean(a), mean(b));
    let sum = |f: &dyn Fn(f64, f64) -> f64| a.iter().zip(b).map(|(x, y)| f(x - ma, y - mb)).sum::<f64>();
    sum(&|x, y| x * y) / (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt()
}

/// The dependences that explain most after the price of their parameters and of the search, best first.
pub(crate) fn look(round: &Round, variables: &[Variable]) -> Vec<Finding> {
    let trials = ACTS.len() * variables.len() * (variables.len() + 1) / 2 * FORMS;
    let acts: Vec<usize> = (0..ACTS.len()).collect();
    let mut all = in_parallel(&acts, |act| acting(round, variables, *act, trials)).concat();
    let evidence = |finding: &Finding| finding.score.evidence(round.used, finding.trials);
    all.sort_by(|a, b| evidence(b).total_cmp(&evidence(a)));
    // Of one pair and act the best form is enough.
    let mut kept: Vec<Finding> = Vec::new();
    for finding in all {
        let same = |other: &Finding| other.acts == finding.acts && other.variables == finding.variables;
        if kept.len() < KEPT && !kept.iter().any(same) {
            kept.push(finding);
        }
    }
    kept
}

/// Factor of each reading that turns a motion (m) into a whitened range.
fn weights(rows: &Rows, act: usize) -> Vec<f64> {
    let along = |k: usize| if act < 3 { rows.rays[k].direction[act] } else { 1.0 };
    (0..rows.len()).map(|k| rows.whitening[k] * along(k)).collect()
}

fn acting(round: &Round, variables: &[Variable], act: usize, trials: usize) -> Vec<Finding> {
    let weights = weights(&round.rows, act);
    let mut found = smooth(round, variables, act, &weights, trials);
    found.extend(sines(round, variables, act, &weights, trials));
    found
}

/// Columns of one act with what projection takes of them.
struct Block {
    columns: Mat<f64>,
    taken: Mat<f64>,
    gradient: Vec<f64>,
}

impl Block {
    fn new(linear: &Linear, columns: Mat<f64>) -> Block {
        let taken = linear.taken(columns.as_ref());
        let gradient = linear.gradient(columns.as_ref());
        Block { columns, taken, gradient }
    }

    fn group(&self, members: &[usize]) -> Projected {
        let pick = |matrix: &Mat<f64>| Mat::from_fn(matrix.nrows(), members.len(), |i, j| matrix[(i, members[j])]);
        let (columns, taken) = (pick(&self.columns), pick(&self.taken));
        let alone = columns.transpose() * &columns;
        let left = &alone - taken.transpose() * &taken;
        Projected { gradient: members.iter().map(|k| self.gradient[*k]).collect(), alone, left }
    }
}

/// Legendre polynomials P_1 … P_4 of each quantity and mixed products of each pair.
fn smooth(round: &Round, variables: &[Variable], act: usize, weights: &[f64], trials: usize) -> Vec<Finding> {
    let powers: Vec<Vec<Vec<f64>>> = variables.iter().map(|v| legendre(&v.scaled)).collect();
    let count = variables.len();
    let pairs: Vec<(usize, usize)> = (0..count).flat_map(|i| (0..i).map(move |j| (j, i))).collect();
    let mains = DEGREE * count;
    let columns = Mat::from_fn(weights.len(), mains + MIXED.len() * pairs.len(), |k, column| {
        if column < mains {
            return weights[k] * powers[column / DEGREE][column % DEGREE][k];
        }
        let ((a, b), (i, j)) = (pairs[(column - mains) / MIXED.len()], MIXED[(column - mains) % MIXED.len()]);
        weights[k] * powers[a][i - 1][k] * powers[b][j - 1][k]
    });
    let block = Block::new(&round.free, columns);
    let finding = |variables: Vec<usize>, members: &[usize]| {
        let score = round.score(&block.group(members));
        Finding { acts: ACTS[act], variables, half_cycles: None, score, trials }
    };
    // What scales alone do to the tip is the error functions' business.
    let has_own = |v: usize| !(act < 3 && is_scale(&variables[v].name));
    let own = |v: usize| if has_own(v) { (DEGREE * v..DEGREE * (v + 1)).collect() } else { Vec::<usize>::new() };
    let mut found: Vec<Finding> = Vec::new();
    for v in (0..count).filter(|v| has_own(*v)) {
        found.extend((1..=DEGREE).map(|degree| finding(vec![v], &own(v)[..degree])));
    }
    for (p, (a, b)) in pairs.iter().enumerate() {
        for degree in 2..=DEGREE {
            let mixed = (0..MIXED.len()).filter(|m| MIXED[*m].0 + MIXED[*m].1 <= degree);
            let mixed: Vec<usize> = mixed.map(|m| mains + p * MIXED.len() + m).collect();
            found.push(finding(vec![*a, *b], &mixed));
            let mut all: Vec<usize> =
                own(*a).into_iter().take(degree).chain(own(*b).into_iter().take(degree)).collect();
            if !all.is_empty() {
                all.extend(mixed);
                found.push(finding(vec![*a, *b], &all));
            }
        }
    }
    found
}

/// P_1 … P_DEGREE of each value, by degree.
fn legendre(values: &[f64]) -> Vec<Vec<f64>> {
    let powers: Vec<Vec<f64>> = values.iter().map(|value| effects::legendre(*value, DEGREE)).collect();
    (1..=DEGREE).map(|degree| powers.iter().map(|of_value| of_value[degree]).collect()).collect()
}

/// Sines over the range of a quantity; scales have a periodogram of their own.
fn sines(round: &Round, variables: &[Variable], act: usize, weights: &[f64], trials: usize) -> Vec<Finding> {
    let residuals = round.free.residuals();
    let logged = variables.iter().enumerate().filter(|(_, v)| !POSITIONS.contains(&v.name.as_str()));
    let mut raw: Vec<(f64, usize, usize)> = Vec::new();
    for (index, variable) in logged {
        for half in HALF_CYCLES {
            let (mut sine, mut cosine, mut norm) = (0.0, 0.0, 0.0);
            for (k, value) in variable.scaled.iter().enumerate() {
                let (s, c) = turn(*value, half).sin_cos();
                sine += weights[k] * s * residuals[k];
                cosine += weights[k] * c * residuals[k];
                norm += weights[k] * weights[k];
            }
            raw.push(((sine * sine + cosine * cosine) / norm.max(f64::MIN_POSITIVE), index, half));
        }
    }
    raw.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
    let trials = trials + ACTS.len() * raw.len();
    raw.truncate(SINES);
    let columns = Mat::from_fn(weights.len(), 2 * raw.len(), |k, j| {
        let (_, variable, half) = raw[j / 2];
        let angle = turn(variables[variable].scaled[k], half);
        weights[k] * if j % 2 == 0 { angle.sin() } else { angle.cos() }
    });
    let block = Block::new(&round.free, columns);
    let finding = |(k, (_, variable, half)): (usize, &(f64, usize, usize))| Finding {
        acts: ACTS[act],
        variables: vec![*variable],
        half_cycles: Some(*half),
        score: round.score(&block.group(&[2 * k, 2 * k + 1])),
        trials,
    };
    raw.iter().enumerate().map(finding).collect()
}

/// Phase of a sine of so many half cycles over the range.
fn turn(scaled: f64, half_cycles: usize) -> f64 {
    TAU * 0.5 * half_cycles as f64 * 0.5 * (scaled + 1.0)
}
