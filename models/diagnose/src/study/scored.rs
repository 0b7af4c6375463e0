//! What a candidate scores, and when another scores about the same.
//!
//! Place in the flow: [`super::search`] makes and orders them, [`super::placing`] places what they are of.

use crate::score::Score;

/// Difference in evidence within which two candidates explain the same: odds of 20 to 1 (Kass & Raftery 1995).
pub(super) const COMPARABLE: f64 = 6.0;

/// Score of a candidate among others.
#[derive(Debug, Clone)]
pub(super) struct Scored {
    pub(super) candidate: usize,
    pub(super) score: Score,
    pub(super) p_holm: f64,
    pub(super) evidence: f64,
}
