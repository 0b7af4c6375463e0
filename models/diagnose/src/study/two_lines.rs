//! Two quantities with which something goes straight at once.
//!
//! Place in the flow: in each round of the search, before single candidates are tried. Where one thing stretches and another takes it back, as
//! a bed that warms and a frame that follows, neither is seen alone, and a form that bends with one of them and the time describes
//! both: it fits, and runs off in the next hour. So straight lines are tried in pairs, and taken where two explain clearly more than any one
//! candidate.

use super::candidate::Goes;
use super::fit::Fit;
use super::reasons::{reason_against, with_together};
use super::scored::{COMPARABLE, Scored};
use super::view::View;
use crate::error::DiagnoseError;
use crate::score::score;

/// Two straight lines of one chain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TwoLines {
    members: [usize; 2],
    evidence: f64,
    /// Pairs among which it is the best.
    tried: usize,
}

impl TwoLines {
    /// The two with most evidence beside a fit, in its noise.
    pub(super) fn best(view: &View, fit: &Fit) -> Option<TwoLines> {
        let inside = fit.set();
        let is_line = |k: &usize| view.study.is_line(*k) && view.study.is_offered(*k) && !inside.contains(k);
        let lines: Vec<usize> = (0..view.study.candidates().len()).filter(is_line).collect();
        let each = (0..view.chains().len()).flat_map(|chain| of_chain(view, fit, (chain, &lines)));
        let each: Vec<TwoLines> = each.collect();
        let tried = each.len();
        let priced =
            each.into_iter().map(|own| TwoLines { evidence: own.evidence - 2.0 * (tried as f64).ln(), tried, ..own });
        priced.max_by(|a, b| a.evidence.total_cmp(&b.evidence))
    }

    /// The set with them, where they explain clearly more than any candidate alone and each passes beside the other all that one must. What has
    /// a name and passes comes before them.
    pub(super) fn passed(
        self,
        view: &mut View,
        fit: &Fit,
        scored: &[Scored],
        significance: f64,
    ) -> Result<Option<Vec<usize>>, DiagnoseError> {
        let alone = scored.iter().map(|own| own.evidence).fold(0.0, f64::max);
        let candidates = view.study.candidates();
        let is_named = |own: &Scored| candidates[own.candidate].goes == Goes::First && own.p_holm <= significance;
        if self.evidence < alone + COMPARABLE || scored.iter().any(is_named) {
            return Ok(None);
        }
        let Some(set) = with_together(view, fit, &self.members, self.tried, significance)? else { return Ok(None) };
        let noises = view.noises();
        // In the noise that both leave: without them, what they explain would pass for slow noise.
        view.adapt(&set)?;
        let is_refused = self.is_refused(view, &fit.set(), significance);
        view.take_noises(noises);
        Ok((!is_refused?).then_some(set))
    }

    /// Whether one of them does not pass beside the other.
    fn is_refused(&self, view: &View, own: &[usize], significance: f64) -> Result<bool, DiagnoseError> {
        let [first, second] = self.members;
        for (asked, other) in [(first, second), (second, first)] {
            let beside = Fit::settle(view, &[own, &[other]].concat())?;
            if reason_against(view, &beside, asked, self.tried, significance)?.is_some() {
                return Ok(true);
            }
        }
        Ok(false)
    }
}

/// All pairs of the lines of one chain that the rows tell apart, unpriced.
fn of_chain(view: &View, fit: &Fit, (chain, lines): (usize, &[usize])) -> Vec<TwoLines> {
    let own: Vec<usize> = lines.iter().copied().filter(|k| view.chain_of(*k) == Some(chain)).collect();
    if own.len() < 2 {
        return Vec::new();
    }
    let (columns, _) = view.chain_columns(chain, &own);
    let part = fit.part(view, &[chain]);
    let all = part.project(columns.as_ref());
    let pairs = (0..own.len()).flat_map(|i| (0..i).map(move |j| [j, i]));
    let of = |places: [usize; 2]| {
        let score = score(&all.pick(&places), part.chi2, part.degrees);
        let members = places.map(|place| own[place]);
        (score.degrees == 2).then(|| TwoLines { members, evidence: score.evidence(part.rows(), 1), tried: 1 })
    };
    pairs.filter_map(of).collect()
}
