//! Is an observed error within a limit? The rule, and whether the uncertainty of the test counts.
//!
//! Place in the flow: the only place where an observed and a permissible error meet. ISO 10360 asks for ISO 14253-1: to
//! prove conformity the limit is narrowed by the expanded uncertainty U of the test value, to prove nonconformity it is
//! widened by U; in between neither is proved. Simple acceptance leaves the uncertainty out; who uses it must say so.
//! U is taken with k = 2, as in editions of ISO 14253-1 up to 2013. That of 2017 starts from a probability of conformity of
//! 95 %, which for the same u makes a narrower guard band (1.65 u); what conforms here conforms there too.

use crate::error::ConformityError;
use crate::quantity::{ObservedError, PermissibleError};

/// Two magnitudes that differ by less are the same (m): a tenth of what any data file resolves, above rounding.
const SAME_M: f64 = 1e-13;

/// What can be said of one observed error, or of a whole test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// Within the limit.
    Conforms,
    /// So near the limit that the uncertainty of the test forbids to say.
    Undecided,
    /// Beyond the limit.
    DoesNotConform,
}

/// Expanded uncertainty of the test value at a length: constant + proportional part (m, m/m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TestUncertainty {
    constant_m: f64,
    per_metre: f64,
}

impl TestUncertainty {
    /// Expanded uncertainty (k = 2) of the test value: constant part (m) and part that grows with length (m/m).
    ///
    /// # Errors
    /// Figures that are negative or not finite.
    pub fn expanded(constant_m: f64, per_metre: f64) -> Result<TestUncertainty, ConformityError> {
        let fine = [constant_m, per_metre].iter().all(|v| v.is_finite() && *v >= 0.0);
        fine.then_some(TestUncertainty { constant_m, per_metre }).ok_or_else(|| {
            let remedy = "give the expanded uncertainty (k = 2) as two figures of zero or more";
            ConformityError::new("uncertainty of the test", "a figure is negative or not finite", remedy)
        })
    }

    /// U at a length (m).
    pub fn at_m(&self, length_m: f64) -> f64 {
        self.constant_m + self.per_metre * length_m.abs()
    }
}

/// How an observed error is held against a limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DecisionRule {
    /// The uncertainty of the test is *not* taken into account (simple acceptance).
    SimpleAcceptance,
    /// ISO 14253-1: limits narrowed (to prove conformity) or widened (to prove nonconformity) by U.
    GuardBand(TestUncertainty),
}

impl DecisionRule {
    /// Holds an error observed at a length (m) against the limit there.
    pub fn decide(&self, observed: ObservedError, limit: PermissibleError, length_m: f64) -> Verdict {
        let u_m = self.guard_m(length_m);
        let beyond_m = observed.magnitude_m() - limit.metres();
        match beyond_m {
            b if b <= -u_m + SAME_M => Verdict::Conforms,
            b if b > u_m + SAME_M => Verdict::DoesNotConform,
            b if b.is_nan() => Verdict::Undecided,
            _ => Verdict::Undecided,
        }
    }

    /// Smallest limit to which an error observed at a length (m) conforms.
    pub fn least_limit(&self, observed: ObservedError, length_m: f64) -> PermissibleError {
        PermissibleError::from_metres(observed.magnitude_m() + self.guard_m(length_m))
    }

    /// By how much the limit is narrowed or widened at a length (m), m.
    fn guard_m(&self, length_m: f64) -> f64 {
        match self {
            DecisionRule::SimpleAcceptance => 0.0,
            DecisionRule::GuardBand(uncertainty) => uncertainty.at_m(length_m),
        }
    }

    /// The rule in words, as it has to stand beside every verdict.
    pub fn words(&self) -> &'static str {
        match self {
            DecisionRule::SimpleAcceptance => {
                "simple acceptance: the uncertainty of the test is not taken into account"
            }
            DecisionRule::GuardBand(_) => {
                "ISO 14253-1: the limit is narrowed by the expanded uncertainty of the test to prove conformity, \
                 widened by it to prove nonconformity"
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: PermissibleError = PermissibleError::from_metres(1e-6);

    fn decide(rule: DecisionRule, observed_um: f64) -> Verdict {
        rule.decide(ObservedError::from_metres(observed_um * 1e-6), LIMIT, 0.5)
    }

    #[test]
    fn simple_acceptance_knows_no_doubt() {
        let rule = DecisionRule::SimpleAcceptance;
        for (observed_um, verdict) in
            [(1.0, Verdict::Conforms), (-1.0, Verdict::Conforms), (1.0001, Verdict::DoesNotConform)]
        {
            assert_eq!(decide(rule, observed_um), verdict, "{observed_um}");
        }
    }

    #[test]
    fn the_guard_band_leaves_a_zone_of_doubt_on_both_sides_of_the_limit() {
        // U = 0.1 µm + 0.5 m · 0.2 µm/m = 0.2 µm around a limit of 1 µm.
        let rule = DecisionRule::GuardBand(TestUncertainty::expanded(0.1e-6, 0.2e-6).unwrap());
        for (observed_um, verdict) in [
            (0.79, Verdict::Conforms),
            (-0.8, Verdict::Conforms),
            (0.81, Verdict::Undecided),
            (-1.19, Verdict::Undecided),
            (1.21, Verdict::DoesNotConform),
        ] {
            assert_eq!(decide(rule, observed_um), verdict, "{observed_um}");
        }
    }

    #[test]
    fn the_least_limit_is_the_one_that_turns_doubt_into_conformity() {
        let observed = ObservedError::from_metres(-0.8e-6);
        for rule in [
            DecisionRule::SimpleAcceptance,
            DecisionRule::GuardBand(TestUncertainty::expanded(0.1e-6, 0.2e-6).unwrap()),
        ] {
            let least_m = rule.least_limit(observed, 0.5).metres();
            let at = |limit_m: f64| rule.decide(observed, PermissibleError::from_metres(limit_m), 0.5);
            assert_eq!(at(least_m), Verdict::Conforms, "{rule:?}");
            assert_ne!(at(least_m - 1e-12), Verdict::Conforms, "{rule:?}");
        }
    }

    #[test]
    fn an_observation_that_is_no_number_never_conforms() {
        assert_eq!(decide(DecisionRule::SimpleAcceptance, f64::NAN), Verdict::Undecided);
    }

    #[test]
    fn an_uncertainty_below_zero_is_refused() {
        assert!(TestUncertainty::expanded(-1e-9, 0.0).is_err());
        assert!(TestUncertainty::expanded(0.0, f64::NAN).is_err());
    }
}
