//! What uncertainty a fit may claim: Student's factor where the noise is estimated, and what a misfit does to a declared one.
//!
//! Place in the flow: between the residuals of a fit and its covariance, for spheres, laser probes, guideways and networks of
//! stations. Every u here is stated so that ±2u holds the truth with 95.45 % (what k = 2 means for a normal error); where the
//! noise is known from few degrees of freedom ν, u grows by t(ν)/2 (GUM G.3). A declared u is worth about one degree of
//! freedom: declarations are wrong by half or by two now and then (k = 1 taken for k = 2), which is Δu/u of 0.7 and ν = 1
//! (GUM G.4.2). So declaration and residuals make a variance of (1 + χ²)/(1 + ν) with 1 + ν degrees of freedom. Misfit widens;
//! luck narrows nothing. Without a degree of freedom nothing judges the declaration, and it stands as given.

use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

/// Probability that ±2u is to have.
const COVERED: f64 = 0.954_499_736_103_641_6;
/// Coverage factor that all uncertainties are stated for.
const COVERAGE: f64 = 2.0;
/// Degrees of freedom that a declared uncertainty is worth.
const OF_DECLARATION: f64 = 1.0;

/// Where an uncertainty comes from, and by how much it was widened.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Claim {
    /// Whether the noise was declared.
    pub is_declared: bool,
    /// Degrees of freedom that judged or gave the noise.
    pub degrees: usize,
    /// Factor on a standard uncertainty, at least one: over the declared noise, or over the one estimated from the residuals.
    pub widening: f64,
}

impl Claim {
    /// Of a declared noise, judged by χ² per degree of freedom where there is a degree.
    pub fn declared(chi2_per_dof: f64, degrees: usize) -> Claim {
        let freedom = degrees as f64;
        let widening = match degrees {
            0 => 1.0,
            _ => {
                let all = OF_DECLARATION + freedom;
                let variance = (OF_DECLARATION + freedom * chi2_per_dof) / all;
                (student(all) / COVERAGE * variance.sqrt()).max(1.0)
            }
        };
        Claim { is_declared: true, degrees, widening }
    }

    /// Of a noise estimated from the residuals; `None` without a degree of freedom.
    pub fn estimated(degrees: usize) -> Option<Claim> {
        let widening = |degrees: usize| (student(degrees as f64) / COVERAGE).max(1.0);
        (degrees > 0).then(|| Claim { is_declared: false, degrees, widening: widening(degrees) })
    }

    /// Multiples of such a u that a difference exceeds with this probability, either way, if there is none.
    pub fn beyond(&self, chance: f64) -> f64 {
        let quantile = |share: f64| match (self.is_declared, self.degrees) {
            // Nothing judged it: it stands as given.
            (true, 0) => normal_quantile(share),
            (true, judged) => student_quantile(judged as f64 + OF_DECLARATION, share),
            (false, own) => student_quantile(own as f64, share),
        };
        COVERAGE * quantile(1.0 - chance / 2.0) / quantile((1.0 + COVERED) / 2.0)
    }

    /// Factor on a covariance.
    pub fn variance(&self) -> f64 {
        self.widening * self.widening
    }
}

/// Multiples of a well known u that a difference exceeds with this probability, either way.
pub(crate) fn normal(chance: f64) -> f64 {
    normal_quantile(1.0 - chance / 2.0)
}

fn normal_quantile(share: f64) -> f64 {
    Normal::standard().inverse_cdf(share)
}

fn student_quantile(degrees: f64, share: f64) -> f64 {
    // Defined for every degree above zero; an infinite factor would claim nothing, which is the safe side.
    StudentsT::new(0.0, 1.0, degrees).map_or(f64::INFINITY, |student| student.inverse_cdf(share))
}

/// What ±t·s must reach to hold the truth with the probability of ±2σ.
fn student(degrees: f64) -> f64 {
    student_quantile(degrees, (1.0 + COVERED) / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Table G.2 of the GUM (JCGM 100:2008), column 95.45 %, rounded there to two decimals.
    #[test]
    fn val_gum_table_g2_gives_the_same_factors() {
        let table = [(1, 13.97), (2, 4.53), (3, 3.31), (4, 2.87), (5, 2.65), (10, 2.28), (20, 2.13), (100, 2.025)];
        for (degrees, factor) in table {
            let claim = Claim::estimated(degrees).unwrap();
            assert!((claim.widening * COVERAGE - factor).abs() <= 0.0051, "{degrees}: {claim:?}");
        }
        assert_eq!(Claim::estimated(0), None);
    }

    #[test]
    fn a_misfit_widens_and_luck_does_not_narrow() {
        assert_eq!(Claim::declared(0.0, 21).widening, 1.0);
        assert_eq!(Claim::declared(0.4, 1000).widening, 1.0);
        // Nothing judges it.
        assert_eq!(Claim::declared(0.0, 0).widening, 1.0);
        // Of many degrees the residuals say it: √χ²/ν.
        assert!((Claim::declared(25.0, 100_000).widening - 5.0).abs() < 1e-3);
        // As declared, of three: t(4)/2 = 2.87/2.
        assert!((Claim::declared(1.0, 3).widening - 1.434).abs() < 2e-3);
    }

    /// Tables of Student's t, two-sided 1 %: 63.66 of one degree, 4.032 of five; 2.576 of a normal error.
    #[test]
    fn val_tables_of_t_say_what_is_beyond_chance() {
        for (claim, expected) in [
            (Claim::estimated(1).unwrap(), 63.66 / 13.97),
            (Claim::estimated(5).unwrap(), 4.032 / 2.65),
            (Claim::declared(1.0, 4), 4.032 / 2.65),
            (Claim::declared(0.0, 0), 2.576 / 2.0),
        ] {
            assert!((claim.beyond(0.01) / (2.0 * expected) - 1.0).abs() < 3e-3, "{claim:?} {}", claim.beyond(0.01));
        }
    }
}
