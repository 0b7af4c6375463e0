//! Which method the held-out data speak for.
//!
//! Place in the flow: errors of several methods at the same held-out points (m) in, the method to use and why out. Rule: the
//! method with the least squared error wins, unless a simpler one is not demonstrably worse. Demonstrably: the difference of
//! squared errors, summed block by block of what was held out together, exceeds zero by so many of its standard errors: one
//! between methods (the rule of one standard error; Hastie, Tibshirani & Friedman 2009, section 7.10), 2.326 (99 %) against no
//! correction at all, as to correct where nothing is to be corrected is worse than not to, and against the position alone where the
//! others have further inputs, as an input that does not help is one more that can be wrong or missing.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Name of the method that predicts no residual at all.
pub const ZERO: &str = "zero";
/// Standard errors by which a method must be worse to be passed over.
const BETWEEN_METHODS: f64 = 1.0;
/// The same for no correction, and for fewer inputs: 99 %, one-sided.
const AGAINST_PLAINER: f64 = 2.326;
/// What the name of a method ends with that had the position alone, beside others that had further inputs.
pub const POSITION_ALONE: &str = " (position alone)";

/// Name of a method.
pub(crate) fn named(method: &str, position_alone: bool) -> String {
    format!("{method}{}", if position_alone { POSITION_ALONE } else { "" })
}

/// A method with its errors at held-out points.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Name.
    pub method: String,
    /// Whether it needs less of a sample than the others: no correction, or the position alone.
    pub is_plainer: bool,
    /// Predicted − measured (m), point by point.
    pub errors_m: Vec<Vector3<f64>>,
}

/// The method to use.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recommendation {
    /// Its name.
    pub method: String,
    /// Why, in figures.
    pub why: String,
}

/// Chooses among candidates, the simplest first; `block` says for each point what it was held out with. `None` without
/// candidates, without points, or if the lists differ in length.
pub fn recommend(candidates: &[Candidate], block: &[usize]) -> Option<Recommendation> {
    if block.is_empty() || candidates.iter().any(|c| c.errors_m.len() != block.len()) {
        return None;
    }
    let square = |c: &Candidate| c.errors_m.iter().map(Vector3::norm_squared).sum::<f64>();
    let best = candidates.iter().min_by(|a, b| square(a).total_cmp(&square(b)))?;
    let is_plainer = |c: &Candidate| c.method == ZERO || c.is_plainer && !best.is_plainer;
    let limit = |c: &Candidate| if is_plainer(c) { AGAINST_PLAINER } else { BETWEEN_METHODS };
    let chosen = candidates.iter().find(|c| excess(c, best, block) < limit(c))?;
    let rms_um = |c: &Candidate| (square(c) / (3 * block.len()) as f64).sqrt() * 1e6;
    let blocks = block.iter().collect::<std::collections::BTreeSet<_>>().len();
    let why = if chosen.method == best.method {
        let next = candidates.iter().filter(|c| c.method != best.method).min_by(|a, b| square(a).total_cmp(&square(b)));
        let next = next.map_or(String::new(), |n| format!("; next is {} with {:.3} µm", n.method, rms_um(n)));
        format!("least error on {} points held out in {blocks} blocks: {:.3} µm rms{next}", block.len(), rms_um(best))
    } else {
        format!(
            "{:.3} µm rms on {} points held out in {blocks} blocks; {} has {:.3} µm, which is not demonstrably better \
             ({:.1} standard errors)",
            rms_um(chosen),
            block.len(),
            best.method,
            rms_um(best),
            excess(chosen, best, block)
        )
    };
    Some(Recommendation { method: chosen.method.clone(), why })
}

/// By how many standard errors a candidate's squared error exceeds the best one's; 0 for the best itself.
fn excess(candidate: &Candidate, best: &Candidate, block: &[usize]) -> f64 {
    let mut differences: BTreeMap<usize, f64> = BTreeMap::new();
    for ((own, least), block) in candidate.errors_m.iter().zip(&best.errors_m).zip(block) {
        *differences.entry(*block).or_default() += own.norm_squared() - least.norm_squared();
    }
    let count = differences.len() as f64;
    let mean = differences.values().sum::<f64>() / count;
    let variance = differences.values().map(|d| (d - mean).powi(2)).sum::<f64>() / (count - 1.0);
    let ratio = mean / (variance / count).sqrt();
    // One block, or no difference anywhere: nothing is demonstrated.
    if ratio.is_nan() { 0.0 } else { ratio }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn candidate(method: &str, deviation_um: f64, seed: u64) -> Candidate {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let errors_m = (0..400).map(|_| Vector3::from_fn(|_, _| (random.random::<f64>() - 0.5) * deviation_um * 1e-6));
        Candidate { method: method.into(), is_plainer: method == ZERO, errors_m: errors_m.collect() }
    }

    fn blocks() -> Vec<usize> {
        (0..400).map(|k| k / 10).collect()
    }

    #[test]
    fn a_clearly_better_method_is_taken_however_complex() {
        let candidates = [candidate("zero", 3.0, 1), candidate("kriging", 2.0, 2), candidate("network", 1.0, 3)];
        assert_eq!(recommend(&candidates, &blocks()).unwrap().method, "network");
    }

    #[test]
    fn a_method_that_is_better_by_chance_only_is_not_taken() {
        let mut lucky = candidate("kriging", 1.0, 2);
        lucky.errors_m[7] *= 0.5;
        let candidates = [candidate("zero", 1.0, 2), lucky];
        let found = recommend(&candidates, &blocks()).unwrap();
        assert!(found.method == "zero" && found.why.contains("not demonstrably better"), "{found:?}");
    }

    #[test]
    fn an_input_that_does_not_clearly_help_is_left_out() {
        let of = |method: String, is_plainer, square: fn(usize) -> f64| Candidate {
            method,
            is_plainer,
            errors_m: (0..400).map(|k| Vector3::x() * square(k / 10).sqrt() * 1e-6).collect(),
        };
        let zero = || of(ZERO.into(), true, |_| 9.0);
        let kriging = |position_alone| of(named("kriging", position_alone), position_alone, |_| 1.0);
        // By blocks 0.25 less and 0.15 more: 0.05 in the mean, with a standard error of 0.032.
        let slightly = of("kriging-network".into(), false, |block| if block % 2 == 0 { 0.75 } else { 1.15 });
        assert!((excess(&kriging(true), &slightly, &blocks()) - 1.56).abs() < 0.01);
        let found = recommend(&[zero(), kriging(true), slightly.clone()], &blocks()).unwrap();
        assert!(
            found.method == "kriging (position alone)" && found.why.contains("not demonstrably better"),
            "{found:?}"
        );
        // Between methods with the same inputs that is enough.
        assert_eq!(recommend(&[zero(), kriging(false), slightly], &blocks()).unwrap().method, "kriging-network");
        let clearly = of("kriging".into(), false, |block| if block % 2 == 0 { 0.3 } else { 0.4 });
        assert_eq!(recommend(&[zero(), kriging(true), clearly], &blocks()).unwrap().method, "kriging");
    }

    #[test]
    fn a_single_block_demonstrates_nothing() {
        let candidates = [candidate("zero", 3.0, 1), candidate("network", 1.0, 3)];
        assert_eq!(recommend(&candidates, &vec![0; 400]).unwrap().method, "zero");
    }

    #[test]
    fn without_points_or_with_lists_that_differ_there_is_no_recommendation() {
        assert_eq!(recommend(&[], &blocks()), None);
        assert_eq!(recommend(&[candidate("zero", 1.0, 1)], &[]), None);
        assert_eq!(recommend(&[candidate("zero", 1.0, 1)], &[1, 2]), None);
    }
}
