//! The look without candidates: does the residual depend on any logged quantity, or any two of them, in a smooth or
//! periodic way?
//!
//! Place in the flow: each round of [`crate::search`], beside the named effects. Quantities are covariates, time, scales
//! and offsets; each is scaled to −1 … 1 over its range. For each direction of the tip and for the range, Legendre
//! products up to total degree 2, 3 and 4 of every pair, with and without what each does alone, and sines of up to 48 half cycles of every quantity are
//! tested with the model's columns projected out. What is found becomes an empirical term if no named effect explains it.

mod bound;
mod products;
mod sines;

use crate::candidates::Round;
use crate::columns::correlation;
use crate::context::Context;
use crate::linear::Projected;
use crate::score::Score;
use abbe_geometry::ErrorId;
use abbe_geometry::effects::{self, Shape, State, is_derived, is_scale};
use abbe_identify::{CampaignRow, Rows, in_parallel};
use abbe_measurement::campaign::Campaign;
use bound::{Pairs, Part};
use faer::Mat;
use products::{Over, Products};

/// Total degree of the products.
const DEGREE: usize = 4;
/// Degrees tried when the term is made: as many as the data pay for.
pub(crate) const TERM_DEGREES: std::ops::RangeInclusive<usize> = 1..=6;
/// Mixed products of two quantities: degrees in each.
const MIXED: [(usize, usize); 6] = [(1, 1), (2, 1), (1, 2), (3, 1), (2, 2), (1, 3)];
/// Correlation from which two quantities are one to the data.
const SAME: f64 = 0.9995;
/// Forms of each pair.
const FORMS: usize = 6;
/// Pairs projected together: enough for matrix products to be fast, few enough for their columns to stay in the cache.
const TOGETHER: usize = 24;
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
    // What is derived, above all what lags behind a temperature, can follow time itself, and would describe anything; only effects with a name read it.
    let logged = context.varying.iter().map(String::as_str).filter(|name| !is_derived(name));
    for name in POSITIONS.into_iter().chain(logged) {
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

/// The dependences that explain most after the price of their parameters and of the search, best first; those whose evidence is not beyond
/// the least that matters may be left out.
pub(crate) fn look(round: &Round, variables: &[Variable], least_evidence: f64) -> Vec<Finding> {
    let trials = ACTS.len() * variables.len() * (variables.len() + 1) / 2 * FORMS;
    let weights: Vec<Vec<f64>> = (0..ACTS.len()).map(|act| weights(&round.rows, act)).collect();
    let powers: Vec<Mat<f64>> = variables.iter().map(|v| legendre(&v.scaled)).collect();
    let waves = sines::strongest(round, variables, &weights);
    let acts: Vec<usize> = (0..ACTS.len()).collect();
    let part = Part::of(round);
    let acting = |act: &usize| {
        let of_act = (*act, weights[*act].as_slice());
        let mut found = smooth(round, (variables, &powers), of_act, trials, (part.as_ref(), least_evidence));
        found.extend(sines::findings(round, variables, *act, (weights[*act].as_slice(), &waves[*act]), trials));
        found
    };
    let mut all = in_parallel(&acts, acting).concat();
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

/// What a motion (m) does to each range used (m).
fn weights(rows: &Rows, act: usize) -> Vec<f64> {
    let along = |k: usize| if act < 3 { rows.rays[k].direction[act] } else { 1.0 };
    (0..rows.len()).map(|k| if rows.whitening[k] > 0.0 { along(k) } else { 0.0 }).collect()
}

/// Legendre polynomials P_1 … P_4 of each quantity and mixed products of each pair; of pairs, those that may be among the best of this act.
fn smooth(
    round: &Round,
    (variables, powers): (&[Variable], &[Mat<f64>]),
    (act, weights): (usize, &[f64]),
    trials: usize,
    (part, least_evidence): (Option<&Part>, f64),
) -> Vec<Finding> {
    let finding = |variables: Vec<usize>, group: &Projected| {
        let score = round.score(group);
        Finding { acts: ACTS[act], variables, half_cycles: None, score, trials }
    };
    // What scales alone do to the tip is the error functions' business.
    let has_own = |v: usize| !(act < 3 && is_scale(&variables[v].name));
    let over = Over { round, part: None };
    let own = Products::of_each(over, powers, weights);
    let alone = |v: usize| -> Vec<Finding> {
        let all = own.of(v);
        (1..=DEGREE).map(|degree| finding(vec![v], &all.pick(&(0..degree).collect::<Vec<_>>()))).collect()
    };
    let mut found: Vec<Vec<Finding>> = (0..variables.len()).filter(|v| has_own(*v)).map(alone).collect();
    let pairs = (0..variables.len()).flat_map(|i| (0..i).map(move |j| (j, i)));
    let pairs: Vec<((usize, usize), Vec<usize>)> =
        pairs.map(|(a, b)| ((a, b), [a, b].into_iter().filter(|v| has_own(*v)).collect())).collect();
    let of_act = Pairs { round, powers, weights, own: &own, trials };
    let at_most = part.map_or_else(|| vec![f64::INFINITY; pairs.len()], |part| of_act.at_most(part, &pairs));
    let mut order: Vec<usize> = (0..pairs.len()).collect();
    order.sort_by(|a, b| at_most[*b].total_cmp(&at_most[*a]));
    let first = found.len();
    found.resize(first + pairs.len(), Vec::new());
    for some in order.chunks(TOGETHER) {
        let limit = least_evidence.max(evidence_kept(&found, round.used));
        let some: Vec<usize> = some.iter().copied().filter(|k| at_most[*k] > limit).collect();
        if some.is_empty() {
            break;
        }
        let batch: Vec<(usize, usize)> = some.iter().map(|k| pairs[*k].0).collect();
        let mixed = Products::of_pairs(over, powers, weights, &batch);
        for (place, k) in some.iter().enumerate() {
            let ((a, b), quantities) = &pairs[*k];
            let all = mixed.with(place, &own, quantities);
            let forms = forms_of(quantities.len()).into_iter();
            found[first + k] = forms.map(|members| finding(vec![*a, *b], &all.pick(&members))).collect();
        }
    }
    found.concat()
}

/// Evidence of the last that is kept of these, each a quantity or a pair in several forms; none where fewer were found.
fn evidence_kept(found: &[Vec<Finding>], rows: usize) -> f64 {
    let best =
        |forms: &Vec<Finding>| forms.iter().map(|found| found.score.evidence(rows, found.trials)).reduce(f64::max);
    let mut best: Vec<f64> = found.iter().filter_map(best).collect();
    best.sort_by(|a, b| b.total_cmp(a));
    best.get(KEPT - 1).copied().unwrap_or(f64::NEG_INFINITY)
}

/// Columns of the forms of a pair: of each degree the mixed products, then these with what each of so many quantities does alone.
fn forms_of(quantities: usize) -> Vec<Vec<usize>> {
    let mut forms = Vec::new();
    for degree in 2..=DEGREE {
        let products: Vec<usize> = (0..MIXED.len()).filter(|m| MIXED[*m].0 + MIXED[*m].1 <= degree).collect();
        forms.push(products.clone());
        if quantities > 0 {
            let of = |q: usize| (0..degree).map(move |d| MIXED.len() + DEGREE * q + d);
            forms.push((0..quantities).flat_map(of).chain(products).collect());
        }
    }
    forms
}

/// P_1 … P_DEGREE of each value, by degree.
fn legendre(values: &[f64]) -> Mat<f64> {
    let mut powers = Mat::zeros(values.len(), DEGREE);
    for (k, value) in values.iter().enumerate() {
        let of_value = effects::legendre(*value, DEGREE);
        (0..DEGREE).for_each(|degree| powers[(k, degree)] = of_value[degree + 1]);
    }
    powers
}
