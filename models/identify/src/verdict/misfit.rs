//! Grades of two figures that every fit has: how many were rejected, and the noise against the declared one.
//!
//! Place in the flow: called by [`super::of_campaign()`] and by the commands of other fits (positions, guideways, spheres). The
//! limits are argued in [`super`].

use super::{Cause, Finding, Grade, Subject};
use statrs::distribution::{Binomial, DiscreteCDF};

/// Probability of a gross error that a message and a warning still allow.
const CAREFUL: f64 = 0.01;
const HASTY: f64 = 0.02;
/// Probability that chance stays below the count that is still explained.
const CONFIDENCE: f64 = 0.999;
/// Residual over declared noise, or its inverse, from which a warning and a refusal are due.
pub(super) const MISTAKEN: f64 = 3.0;
const IMPOSSIBLE: f64 = 10.0;
/// χ² per degree of freedom beyond which a reader is told, where chance does not explain it.
const TOLD: std::ops::RangeInclusive<f64> = 0.7..=1.3;
/// Standard deviations of χ² per degree of freedom that count as chance.
const CHANCE: f64 = 4.0;

/// Things counted, and how many of them a fit rejected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Counted {
    /// What they are called, in the plural.
    pub what: &'static str,
    /// Rejected.
    pub rejected: usize,
    /// All.
    pub all: usize,
}

/// Grades how many were rejected; nothing where none was. Each measurement has a few: of these, only what they have in common is a cause.
pub fn of_rejected(counted: Counted, mut causes: Vec<Cause>) -> Option<Finding> {
    let Counted { what, rejected, all } = counted;
    if rejected == 0 {
        return None;
    }
    let [careful, hasty] = [CAREFUL, HASTY].map(|share| (share, most_of(all, share)));
    let (grade, (share, explained)) = match rejected {
        few if few <= careful.1 => (Grade::Message, careful),
        some if some <= hasty.1 => (Grade::Warning, careful),
        _ => (Grade::Refusal, hasty),
    };
    if grade == Grade::Message {
        causes.retain(Cause::is_in_common);
    }
    Some(Finding { grade, subject: Subject::Rejected { what, rejected, all, share, explained }, causes })
}

/// As many of `all` as a probability explains.
fn most_of(all: usize, probability: f64) -> usize {
    // The distribution is defined for these probabilities; without it nothing is explained.
    Binomial::new(probability, all as u64).map_or(0, |binomial| binomial.inverse_cdf(CONFIDENCE) as usize)
}

/// Grades χ² per degree of freedom with the declared uncertainties; nothing where it is as it should be.
pub fn of_noise(chi2_per_dof: f64, degrees_of_freedom: f64, causes: Vec<Cause>) -> Option<Finding> {
    if degrees_of_freedom < 1.0 || !chi2_per_dof.is_finite() {
        return None;
    }
    // Nearly normal down to few degrees of freedom and down to zero (Wilson and Hilferty 1931).
    let variance = 2.0 / (9.0 * degrees_of_freedom);
    let by_chance = (chi2_per_dof.max(0.0).cbrt() - (1.0 - variance)).abs() <= CHANCE * variance.sqrt();
    if by_chance || TOLD.contains(&chi2_per_dof) {
        return None;
    }
    let ratio = chi2_per_dof.max(0.0).sqrt();
    let grade = match ratio.max(ratio.recip()) {
        far if far > IMPOSSIBLE => Grade::Refusal,
        far if far > MISTAKEN => Grade::Warning,
        _ => Grade::Message,
    };
    Some(Finding { grade, subject: Subject::Noise { ratio, chi2_per_dof }, causes })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grade(rejected: usize, all: usize) -> Option<Grade> {
        of_rejected(Counted { what: "readings", rejected, all }, Vec::new()).map(|finding| finding.grade)
    }

    #[test]
    fn as_many_gross_errors_as_chance_gives_are_never_refused() {
        // Mean 1 % and 2 % of 2831: 28.3 ± 5.3 and 56.6 ± 7.4; 99.9 % points by the normal law are 45 and 80.
        let grades: Vec<_> = [0, 28, 44, 57, 78, 84, 1108].into_iter().map(|rejected| grade(rejected, 2831)).collect();
        let (message, warning, refusal) = (Some(Grade::Message), Some(Grade::Warning), Some(Grade::Refusal));
        assert_eq!(grades, [None, message, message, warning, warning, refusal, refusal]);
        // Of 200, 2 % are 4 ± 2: eleven still happen once in a thousand campaigns.
        assert_eq!([2, 7, 10, 14].map(|rejected| grade(rejected, 200)), [message, message, warning, refusal]);
        // One of ten is no share of anything.
        assert_eq!(grade(1, 10), message);
    }

    #[test]
    fn regress_a_few_gross_errors_have_no_cause_but_what_they_have_in_common() {
        let lines = Cause::Lines { lines: vec![("L1".to_owned(), "S1".to_owned(), 2, 9)] };
        let causes = vec![Cause::Scattered, lines.clone(), Cause::Understated, Cause::Lacks];
        let of =
            |rejected| of_rejected(Counted { what: "readings", rejected, all: 2831 }, causes.clone()).unwrap().causes;
        assert_eq!((of(2), of(100)), (vec![lines], causes.clone()));
    }

    #[test]
    fn noise_is_graded_either_way_and_chance_is_let_through() {
        let of = |ratio: f64, dof: f64| of_noise(ratio * ratio, dof, Vec::new()).map(|finding| finding.grade);
        let (message, warning, refusal) = (Some(Grade::Message), Some(Grade::Warning), Some(Grade::Refusal));
        // Thirty points on a sphere: scatter far below what was declared is no chance.
        assert_eq!([1.0, 0.7, 0.2, 0.05].map(|ratio| of(ratio, 26.0)), [None, None, warning, refusal]);
        assert_eq!(
            [1.0, 1.1, 1.5, 2.9, 3.1, 9.9, 10.1].map(|ratio| of(ratio, 2600.0)),
            [None, None, message, message, warning, warning, refusal]
        );
        assert_eq!(
            [0.9, 0.67, 0.34, 0.3, 0.11, 0.09, 0.0].map(|ratio| of(ratio, 2600.0)),
            [None, message, message, warning, warning, refusal, refusal]
        );
        // Ten degrees of freedom: χ²/ν of 2.25 is chance at 4 · √(2/10) = 1.8.
        assert_eq!(of(1.5, 10.0), None);
        assert_eq!(of(4.0, 0.0), None);
    }
}
