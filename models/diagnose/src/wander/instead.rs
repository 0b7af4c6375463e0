//! A slow change of the machine in the place of an effect that was found.
//!
//! Place in the flow: near the end of [`crate::diagnose()`], for each effect found, on the rows of the fit that lacks it alone. What changes slowly
//! and was logged nowhere goes with any temperature, moisture or pressure that is slow as well. Both are weighed by their likelihood:
//!
//! ```text
//! ln odds = E(effect) + E(course | effect) − E(course),   share of the course = 1 / (1 + odds)
//! ```
//!
//! E is what the logarithm of the likelihood gains by one variance, estimated by REML with the noise: that of the parameters of the effect, each
//! column of length one, less the price of its choice among all that have a name; and that of motions of the tip in the course of time, the
//! mean over motions and courses. Courses are cosines of any size, what goes on evenly, and what comes to rest. Where the odds are below one, the
//! effect is no cause. What the course would do instead stands in the uncertainty with its share.

use super::courses::{in_course_of_time, steady_courses};
use super::motions::{Motions, Span};
use super::{LN_RATIO, SEEN, Seen, Tested, by_likelihood, by_place_and_taken, told};
use crate::candidates::{Candidate, Round, proposals};
use crate::competing::Without;
use crate::error::DiagnoseError;
use crate::linear::Linear;
use crate::named::named;
use crate::options::Progress;
use crate::peak::peak;
use crate::same_claim::is_of;
use crate::score::inverse_root;
use crate::search::{Search, State};
use crate::step::added;
use crate::taken::Taken;
use abbe_geometry::by_place::VarianceByPlace;
use abbe_geometry::model::{FittedEffect, MachineModel, ModelError};
use abbe_identify::{EffectTerm, symmetric_eigen};
use abbe_measurement::campaign::Campaign;
use faer::Mat;
use std::sync::Arc;

/// Share of a course below which it is left out.
const LEAST_SHARE: f64 = 0.01;
/// Share from which readers are told.
const SAID: f64 = 0.1;

/// Courses in the place of effects that were found, one at a time.
#[derive(Debug, Clone, Default)]
pub struct Slow(Vec<Instead>);

impl Slow {
    /// Of the terms that are found, each with the fit without it alone, where a course may stand in its place.
    pub(crate) fn of(
        (search, state): (&Search, &State),
        without: &[Option<Without>],
        may_be: &dyn Fn(&FittedEffect) -> bool,
        observe: &mut dyn FnMut(Progress) -> bool,
    ) -> Result<Slow, DiagnoseError> {
        let mut go_on = || match observe(Progress::Scoring { round: 1, effects: state.terms.len() }) {
            true => Ok(()),
            false => Err(DiagnoseError::Stopped),
        };
        let effects = state.fit.model.parts().effects.iter();
        let open: Vec<_> = effects.zip(without).filter(|(fitted, _)| may_be(fitted)).collect();
        if open.is_empty() {
            return Ok(Slow::default());
        }
        let proposed = proposals(&state.machine, &search.context)?.len();
        let mut all = Vec::new();
        for (fitted, without) in open {
            let term = EffectTerm::of(fitted);
            if let (Some((fit, round)), Some(added)) = (without, added(state, &term)) {
                let candidate = (added.candidate, proposed);
                all.extend(Instead::of(term, candidate, (&fit.model, round), search.campaign, &mut go_on)?);
            }
        }
        Ok(Slow(all))
    }

    /// Whether a course explains the readings better than this effect does.
    pub(crate) fn outdoes(&self, fitted: &FittedEffect) -> bool {
        self.0.iter().any(|own| own.share > 0.5 && is_of(std::slice::from_ref(&own.term), fitted))
    }

    /// A model with it in the uncertainty, whichever effects it has. A course takes the place of one effect at a time: together they have a share of
    /// one at most.
    pub(crate) fn told(&self, model: MachineModel) -> Result<MachineModel, ModelError> {
        let told = || self.0.iter().filter(|own| own.share > LEAST_SHARE);
        let together = told().map(|own| own.share).sum::<f64>().max(1.0);
        told().try_fold(model, |model, own| own.told(own.share / together, model))
    }

    /// Of which effects nobody knows whether they are a slow change, for readers; `None` without any.
    pub fn words(&self) -> Option<String> {
        let list: Vec<String> = self.0.iter().filter(|own| own.share > SAID).map(Instead::words).collect();
        (!list.is_empty()).then(|| {
            format!(
                "What was found may be a slow change of the machine that no log follows: {}. U holds what such a change would do, weighted by its probability.",
                list.join("; ")
            )
        })
    }
}

/// A course in the place of an effect.
#[derive(Debug, Clone)]
struct Instead {
    term: EffectTerm,
    title: &'static str,
    /// Probability that it is the course, of the two.
    share: f64,
    by_place: VarianceByPlace,
    taken: Taken,
}

impl Instead {
    /// `without` is the fit that lacks the term alone. `None` where the rows tell nothing of it, or are too few for a course.
    fn of(
        term: EffectTerm,
        (candidate, proposed): (&Candidate, usize),
        (model, without): (&MachineModel, &Round),
        campaign: &Campaign,
        go_on: &mut dyn FnMut() -> Result<(), DiagnoseError>,
    ) -> Result<Option<Instead>, DiagnoseError> {
        let columns = without.rows.columns(term.effect.as_ref())?;
        let Some(effect) = evidence_of(without, &columns) else { return Ok(None) };
        let Ok(beside) = without.linear.widened(&[columns], without.used) else { return Ok(None) };
        let beside = Round { free: Arc::new(beside), ..without.clone() };
        let [alone, left] = [without, &beside].map(|round| Seen::of(round, campaign, Span::of(campaign)));
        let (looks, looks_beside) = (alone.slow(campaign, go_on)?, left.slow(campaign, go_on)?);
        let of_looks = [&looks, &looks_beside].map(|looks| looks.iter().map(Tested::evidence).collect::<Vec<f64>>());
        let [Some(course), Some(beside)] = of_looks.each_ref().map(|of| mean(of)) else { return Ok(None) };
        let ln_odds = effect - (candidate.trials.max(proposed) as f64).ln() + beside - course;
        let weighed: Vec<(&Tested, f64)> = by_likelihood(&looks, &of_looks[0]);
        let (by_place, taken) = by_place_and_taken(&weighed, &alone.places, without.rows.parameters.len());
        let (share, taken) = (1.0 / (1.0 + ln_odds.exp()), Taken::new(model, &without.rows, taken));
        Ok(Some(Instead { term, title: candidate.known.title, share, by_place, taken }))
    }

    fn told(&self, share: f64, model: MachineModel) -> Result<MachineModel, ModelError> {
        told(model, self.by_place.scaled(share), &self.taken.scaled(share))
    }

    fn words(&self) -> String {
        let percent = 100.0 * self.share;
        let share = if percent > 99.0 { "more than 99".to_owned() } else { format!("{percent:.0}") };
        format!("{}, {share} % likely", named(self.title, &self.term.shape))
    }
}

/// What the logarithm of the likelihood gains by the parameters of an effect.
fn evidence_of(round: &Round, columns: &Mat<f64>) -> Option<f64> {
    let projected = round.free.project(columns.as_ref());
    let count = columns.ncols();
    let scale: Vec<f64> = (0..count).map(|k| inverse_root(projected.alone[(k, k)])).collect();
    let both = |i: usize, j: usize| 0.5 * (projected.left[(i, j)] + projected.left[(j, i)]) * scale[i] * scale[j];
    let (values, vectors) = symmetric_eigen(&Mat::from_fn(count, count, both))?;
    let along = (0..count).map(|k| (0..count).map(|i| vectors[(i, k)] * projected.gradient[i] * scale[i]).sum());
    Some(evidence(&values, &along.collect::<Vec<f64>>(), &round.free))
}

/// What the logarithm of the likelihood gains by one variance of what multiplies columns, by REML with the noise estimated; 0 where the noise
/// explains the rows best.
fn evidence(values: &[f64], along: &[f64], linear: &Linear) -> f64 {
    let largest = values.last().copied().unwrap_or(0.0);
    let (chi2, degrees) = (linear.chi2(), linear.degrees());
    let seen = || values.iter().zip(along).filter(|(value, _)| **value > SEEN * largest);
    let likelihood = |ratio: f64| -> f64 {
        let price: f64 = seen().map(|(value, _)| (ratio * value).ln_1p()).sum();
        let explained: f64 = seen().map(|(value, along)| along * along * ratio / (1.0 + ratio * value)).sum();
        -0.5 * (price + degrees * (chi2 - explained).max(f64::MIN_POSITIVE).ln())
    };
    let of = |ln_ratio: f64| ln_ratio.exp() / largest;
    let best = of(peak(LN_RATIO, |ln_ratio| likelihood(of(ln_ratio))));
    (likelihood(best) - likelihood(0.0)).max(0.0)
}

/// Logarithm of the mean likelihood of looks of such an evidence; `None` without any, as where the rows are too few.
fn mean(evidence: &[f64]) -> Option<f64> {
    let most = evidence.iter().copied().fold(0.0, f64::max);
    let sum: f64 = evidence.iter().map(|own| (own - most).exp()).sum();
    (!evidence.is_empty()).then(|| most + (sum / evidence.len() as f64).ln())
}

impl Seen<'_> {
    /// All that may be slow: in any course, and in those of few parts that are the usual ones.
    fn slow(
        &self,
        campaign: &Campaign,
        go_on: &mut dyn FnMut() -> Result<(), DiagnoseError>,
    ) -> Result<Vec<Tested<'_>>, DiagnoseError> {
        go_on()?;
        let each = Motions::each(&self.places);
        let mut all = self.of_sets(each.clone(), &in_course_of_time(campaign, &self.used));
        for course in steady_courses(campaign, &self.used) {
            go_on()?;
            all.extend(self.of_sets([each.clone(), Motions::bows(&self.places)].concat(), &course));
        }
        Ok(all)
    }
}

impl Tested<'_> {
    fn evidence(&self) -> f64 {
        evidence(&self.values, &self.along, &self.look.round.free)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cut of weights that were already shares left nothing of 143 looks that are alike, and nothing of them stood in U.
    #[test]
    fn regress_weights_are_whole_however_many_look_alike() {
        for evidence in [vec![3.0; 143], vec![0.0; 2], vec![0.0, 40.0, 41.0, 2.0]] {
            let weights = by_likelihood(0.., &evidence);
            assert!((weights.iter().map(|(_, weight)| weight).sum::<f64>() - 1.0).abs() < 1e-12, "{evidence:?}");
        }
        assert_eq!(by_likelihood(0.., &[0.0, 40.0]), [(1, 1.0)]);
        assert_eq!(mean(&[]), None);
        assert!(mean(&[7.0, 7.0]).is_some_and(|mean| (mean - 7.0).abs() < 1e-12));
    }
}
