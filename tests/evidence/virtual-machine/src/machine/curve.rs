//! Error functions of one axis: sums of Chebyshev terms, waves and bumps with the gauge taken out.
//!
//! Place in the flow: [`crate::machine::MachineTruth`] declares the terms, the virtual machine evaluates the
//! curve. Input: axis reading (m). Output: m for a linear error, rad for an angular one.
//! Equation: e(u) = r(u) − r(0) for positioning and angles, e(u) = r(u) − r(0) − u·(r(1) − r(0)) for
//! straightness, r the sum of the terms and u = (reading − stroke start) / stroke.

use std::f64::consts::TAU;

use crate::error::{SimulationError, require_finite, require_positive};

/// One term of an error function over the stroke fraction u; sizes in m or rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Term {
    /// `size` · T_order(2u − 1), the Chebyshev polynomial of the first kind.
    Chebyshev {
        /// Degree of the polynomial.
        order: u32,
        /// Factor before the polynomial (m or rad).
        size: f64,
    },
    /// `size` · sin(2π · `waves` · u + `phase_rad`).
    Wave {
        /// Waves in the stroke; need not be whole.
        waves: f64,
        /// Amplitude (m or rad).
        size: f64,
        /// Phase at the stroke's start (rad).
        phase_rad: f64,
    },
    /// `size` · exp(−½((u − `centre`)/`width`)²).
    Bump {
        /// Centre as a fraction of the stroke.
        centre: f64,
        /// Standard width as a fraction of the stroke.
        width: f64,
        /// Height (m or rad).
        size: f64,
    },
}

impl Term {
    /// Value at stroke fraction `u`.
    fn value(&self, u: f64) -> f64 {
        match *self {
            Term::Chebyshev { order, size } => size * chebyshev(order, 2.0 * u - 1.0),
            Term::Wave { waves, size, phase_rad } => size * (TAU * waves * u + phase_rad).sin(),
            Term::Bump { centre, width, size } => {
                let t = (u - centre) / width;
                size * (-0.5 * t * t).exp()
            }
        }
    }

    /// The same term with its size multiplied.
    pub(crate) fn scaled(self, by: f64) -> Self {
        match self {
            Term::Chebyshev { order, size } => Term::Chebyshev { order, size: size * by },
            Term::Wave { waves, size, phase_rad } => Term::Wave { waves, size: size * by, phase_rad },
            Term::Bump { centre, width, size } => Term::Bump { centre, width, size: size * by },
        }
    }

    pub(crate) fn check(&self) -> Result<(), SimulationError> {
        match *self {
            Term::Chebyshev { order, size } => {
                require_finite("size", &[size])?;
                if order > 64 {
                    return Err(SimulationError::new(
                        "order",
                        format!("{order} is above 64"),
                        "use waves or bumps for a rough curve",
                    ));
                }
                Ok(())
            }
            Term::Wave { waves, size, phase_rad } => {
                require_finite("waves, size, phase_rad", &[waves, size, phase_rad])
            }
            Term::Bump { centre, width, size } => {
                require_finite("centre, size", &[centre, size])?;
                require_positive("width", width)
            }
        }
    }
}

/// T_n(t) by the three-term recurrence, which also holds outside [−1, 1].
fn chebyshev(order: u32, t: f64) -> f64 {
    let (mut before, mut now) = (1.0, t);
    if order == 0 {
        return before;
    }
    for _ in 1..order {
        (before, now) = (now, 2.0 * t * now - before);
    }
    now
}

/// Which rigid-body freedom is taken out of the sum of terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Gauge {
    /// Zero at the lower end of the stroke: positioning and angular errors.
    ZeroAtStart,
    /// Zero at both ends of the stroke: straightness, so that squareness carries the slope.
    ZeroAtBothEnds,
}

/// An error function ready to be evaluated.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ErrorCurve {
    terms: Vec<Term>,
    stroke_m: [f64; 2],
    at_start: f64,
    slope: f64,
}

impl ErrorCurve {
    pub(crate) fn new(terms: Vec<Term>, stroke_m: [f64; 2], gauge: Gauge) -> Self {
        let at_start = sum(&terms, 0.0);
        let slope = match gauge {
            Gauge::ZeroAtStart => 0.0,
            Gauge::ZeroAtBothEnds => sum(&terms, 1.0) - at_start,
        };
        Self { terms, stroke_m, at_start, slope }
    }

    /// Error (m or rad) at an axis reading (m).
    pub(crate) fn value(&self, reading_m: f64) -> f64 {
        if self.terms.is_empty() {
            return 0.0;
        }
        let [start, end] = self.stroke_m;
        let u = (reading_m - start) / (end - start);
        // The slope's own product comes last, so that both ends are zero to the bit.
        (sum(&self.terms, u) - self.at_start) - u * self.slope
    }
}

fn sum(terms: &[Term], u: f64) -> f64 {
    terms.iter().map(|term| term.value(u)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_chebyshev_recurrence_equals_the_cosine_form() {
        for order in 0..12_u32 {
            for t in [-1.0, -0.7, 0.0, 0.35, 1.0_f64] {
                let cosine = (f64::from(order) * t.acos()).cos();
                assert!((chebyshev(order, t) - cosine).abs() < 1e-13);
            }
        }
    }

    #[test]
    fn straightness_is_zero_at_both_ends_to_the_bit() {
        let terms = vec![
            Term::Wave { waves: 1.37, size: 4e-6, phase_rad: 0.4 },
            Term::Bump { centre: 0.8, width: 0.1, size: -3e-6 },
        ];
        let curve = ErrorCurve::new(terms, [-0.2, 0.6], Gauge::ZeroAtBothEnds);
        assert_eq!(curve.value(-0.2), 0.0);
        assert_eq!(curve.value(0.6), 0.0);
        assert!(curve.value(0.3).abs() > 1e-7);
    }

    #[test]
    fn straightness_loses_its_slope_everywhere_and_keeps_its_bow() {
        let terms = |order| vec![Term::Chebyshev { order, size: 3e-6 }];
        let slope = ErrorCurve::new(terms(1), [0.0, 0.8], Gauge::ZeroAtBothEnds);
        let bow = ErrorCurve::new(terms(2), [0.0, 0.8], Gauge::ZeroAtBothEnds);
        let positioning = ErrorCurve::new(terms(1), [0.0, 0.8], Gauge::ZeroAtStart);
        for reading_m in [0.1, 0.2, 0.4, 0.7] {
            let t = 2.0 * reading_m / 0.8 - 1.0;
            assert!(slope.value(reading_m).abs() < 1e-20);
            // T₂(t) − 1 = 2t² − 2
            assert!((bow.value(reading_m) - 3e-6 * (2.0 * t * t - 2.0)).abs() < 1e-20);
            assert!((positioning.value(reading_m) - 3e-6 * (t + 1.0)).abs() < 1e-20);
        }
    }
}
