//! Scores of named effects: every registered effect in every shape that it proposes for the campaign.
//!
//! Place in the flow: one pass over the candidates per round of [`crate::search`]; shapes that need a search of their
//! own (periods, runs) come from [`crate::periodic`] and [`crate::runs`].

use crate::context::Context;
use crate::error::DiagnoseError;
use crate::linear::{Linear, Projected, joined};
use crate::peak::peak_within;
use crate::score::{Score, score};
use abbe_geometry::effects::{Known, REGISTRY, Shape, known};
use abbe_geometry::machine::Machine;
use abbe_geometry::model::FittedEffect;
use abbe_identify::{EffectTerm, Identified, Rows, in_parallel};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use faer::Mat;
use std::sync::Arc;

/// An effect in one shape, and what the data say of it.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    pub(crate) known: &'static Known,
    pub(crate) term: EffectTerm,
    pub(crate) score: Score,
    /// Shapes among which this one was chosen.
    pub(crate) trials: usize,
    /// Share of its information that the model's own columns absorb, each parameter counting the same.
    pub(crate) absorbed: f64,
    /// Score without the parameters that make it this effect; `None` where all do.
    pub(crate) rest: Option<Score>,
}

impl Candidate {
    /// Evidence after the price of parameters and trials.
    pub(crate) fn evidence(&self, rows: usize) -> f64 {
        self.score.evidence(rows, self.trials)
    }

    /// Evidence of the parameters that make it this effect, beside the rest.
    pub(crate) fn essential_evidence(&self, rows: usize) -> f64 {
        match &self.rest {
            Some(rest) => self.evidence(rows) - rest.evidence(rows, self.trials),
            None => f64::INFINITY,
        }
    }

    /// Whether it has more evidence by an amount that matters: of equals, the one proposed first stays, on every machine
    /// and whatever the rounding.
    pub(crate) fn better_than(&self, other: &Candidate, rows: usize) -> bool {
        self.evidence(rows) > other.evidence(rows) + EQUAL
    }
}

/// Difference of evidence that counts as none.
const EQUAL: f64 = 1.0;

/// The fit of one round, as rows and as a linear problem.
#[derive(Debug, Clone)]
pub(crate) struct Round<'a> {
    pub(crate) rows: Arc<Rows<'a>>,
    /// The fit as it is, with the priors of its error functions: predicts blocks left out.
    pub(crate) linear: Arc<Linear>,
    /// The same columns without priors: candidates are tested against it.
    pub(crate) free: Arc<Linear>,
    /// Rows that are not rejected.
    pub(crate) used: usize,
}

impl<'a> Round<'a> {
    /// The rows of a fit.
    pub(crate) fn new(
        fit: &Identified,
        instrument: RangeUncertainty,
        campaign: &'a Campaign,
    ) -> Result<Round<'a>, DiagnoseError> {
        let rows = Rows::new(fit, instrument, campaign);
        let used = rows.whitening.iter().filter(|w| **w > 0.0).count();
        let linear = Linear::new(rows.jacobian.clone(), rows.residuals.clone(), rows.covariance.clone(), used)?;
        let free = linear.without_priors(used)?;
        Ok(Round { rows: Arc::new(rows), linear: Arc::new(linear), free: Arc::new(free), used })
    }

    /// The same fit, where effects read what this campaign logged: the same readings with covariates of which none is read by an effect of
    /// the fit.
    pub(crate) fn logged_as<'b>(&self, campaign: &'b Campaign) -> Round<'b>
    where
        'a: 'b,
    {
        let rows = Arc::new(self.rows.logged_as(campaign));
        Round { rows, linear: Arc::clone(&self.linear), free: Arc::clone(&self.free), used: self.used }
    }

    /// What a fitted effect does to the range of each row used, with the number of the row (m).
    pub(crate) fn on_ranges_m(&self, fitted: &FittedEffect) -> Result<Vec<(usize, f64)>, DiagnoseError> {
        let partials = self.rows.partials(fitted.effect.as_ref())?;
        let value = |k: usize| fitted.parameters.iter().enumerate().map(|(j, p)| partials[(k, j)] * p).sum();
        Ok((0..self.rows.len()).filter(|k| self.rows.whitening[*k] > 0.0).map(|k| (k, value(k))).collect())
    }

    /// What these columns tell.
    pub(crate) fn score(&self, projected: &Projected) -> Score {
        score(projected, self.free.chi2(), self.free.degrees())
    }
}

/// All shapes worth testing on this campaign, with the number that each effect proposes.
pub(crate) fn proposals(
    machine: &Machine,
    context: &Context,
) -> Result<Vec<(&'static Known, EffectTerm, usize)>, DiagnoseError> {
    let observed = context.observed(machine);
    let mut all = Vec::new();
    for known in REGISTRY {
        let shapes: Vec<Shape> = (known.propose)(&observed);
        let trials = shapes.len();
        for shape in shapes {
            all.push((known, EffectTerm::new(known.name, shape, machine)?, trials));
        }
    }
    Ok(all)
}

/// Scores terms in one go: their columns are projected together.
pub(crate) fn score_all(
    round: &Round,
    terms: Vec<(&'static Known, EffectTerm, usize)>,
) -> Result<Vec<Candidate>, DiagnoseError> {
    let of_term = |(_, term, _): &(&'static Known, EffectTerm, usize)| round.rows.columns(term.effect.as_ref());
    let columns = in_parallel(&terms, of_term).into_iter().collect::<Result<Vec<Mat<f64>>, _>>()?;
    let projected = round.free.project_all(&columns);
    let scored = |((known, term, trials), projected): ((&'static Known, EffectTerm, usize), Projected)| {
        let (score, absorbed) = (round.score(&projected), projected.absorbed());
        let essential = term.effect.essential();
        let rest: Vec<usize> = (0..projected.gradient.len()).filter(|k| !essential.contains(k)).collect();
        let rest = (!essential.is_empty()).then(|| round.score(&projected.pick(&rest)));
        Candidate { known, term, score, trials, absorbed, rest }
    };
    Ok(terms.into_iter().zip(projected).map(scored).collect())
}

/// The best of some effects that are constant on the ranges of some readings, each given by its columns, not whitened: its place among them, and the
/// candidate, with the shape that the effect of this name has for it.
pub(crate) fn best_constant(
    round: &Round,
    (name, machine): (&str, &Machine),
    mut columns: Vec<Mat<f64>>,
    shape: impl Fn(usize) -> Shape,
) -> Result<Option<(usize, Candidate)>, DiagnoseError> {
    let Some(known) = known(name) else { return Ok(None) };
    for own in &mut columns {
        (0..own.ncols()).for_each(|j| round.rows.whiten(own.col_as_slice_mut(j)));
    }
    let groups = round.free.project_all(&columns).into_iter();
    let scores = groups.map(|group| (round.score(&group), group.absorbed()));
    let best = scores.enumerate().max_by(|a, b| a.1.0.reduction.total_cmp(&b.1.0.reduction));
    let Some((place, (score, absorbed))) = best else { return Ok(None) };
    let term = EffectTerm::new(known.name, shape(place), machine)?;
    Ok(Some((place, Candidate { known, term, score, trials: columns.len(), absorbed, rest: None })))
}

/// Whitened columns of some terms, side by side.
pub(crate) fn columns_of(round: &Round, terms: &[&EffectTerm]) -> Result<Mat<f64>, DiagnoseError> {
    let each = terms.iter().map(|term| round.rows.columns(term.effect.as_ref()));
    let each = each.collect::<Result<Vec<Mat<f64>>, _>>()?;
    Ok(joined(&each))
}

/// Refines the figure of a candidate's shape between its neighbours, where it reduces χ² most.
pub(crate) fn refined(round: &Round, machine: &Machine, candidate: Candidate) -> Result<Candidate, DiagnoseError> {
    use abbe_geometry::effects::ShapeValue;
    let Some(refine) = candidate.known.refine else { return Ok(candidate) };
    let Some(ShapeValue::Number(start)) = candidate.term.shape.0.get(refine.key).cloned() else {
        return Ok(candidate);
    };
    let at = |log_ratio: f64| -> Result<Candidate, DiagnoseError> {
        let shape = candidate.term.shape.clone().number(refine.key, start * log_ratio.exp());
        let term = EffectTerm::new(candidate.known.name, shape, machine)?;
        let mut scored = score_all(round, vec![(candidate.known, term, candidate.trials)])?;
        scored.pop().ok_or(DiagnoseError::Singular)
    };
    let span = refine.ratio.ln().abs();
    let mut best = candidate.clone();
    let reduction = |log_ratio: f64| {
        let own = at(log_ratio)?;
        let reduction = own.score.reduction;
        if reduction > best.score.reduction {
            best = own;
        }
        Ok::<f64, DiagnoseError>(reduction)
    };
    peak_within((-span, span), NEAR, reduction)?;
    Ok(best)
}

/// Share of the way between both neighbours to which the figure is found: closer than data tell.
const NEAR: f64 = 0.02;
