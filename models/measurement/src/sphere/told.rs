//! Whether the points contradict a radius that is said to be known.
//!
//! Place in the flow: after a fit with a known radius. Held to a wrong radius, the centre of a cap moves along its axis, and the
//! residuals hardly tell. So the points are fitted once more with a free radius, and what they say is held against what was
//! given, each with its uncertainty: |r − R| against t·√(u² + u_R²), Student's t of the degrees that the scatter is known from.

use super::{SphereFit, SphereRadius};

/// Probability that a right radius is called wrong: doubted, and refused.
const DOUBTED: f64 = 1e-2;
const REFUSED: f64 = 1e-4;
/// Differences below this (m) are rounding: no coordinate resolves them.
const RESOLVED_M: f64 = 1e-9;

/// A radius that the points tell, against the one that was given.
#[derive(Debug, Clone, PartialEq)]
pub struct ToldRadius {
    /// The fit with a free radius.
    pub free: SphereFit,
    /// Its radius less the given one (m).
    pub difference_m: f64,
    /// Whether chance is out of the question.
    pub is_certain: bool,
}

impl SphereFit {
    /// The radius that the points tell where it contradicts the known one; `None` where they agree within their uncertainties, or the
    /// points cannot tell a radius.
    pub fn contradicting(
        points_m: &[nalgebra::Vector3<f64>],
        radius: SphereRadius,
        u_point_m: Option<f64>,
    ) -> Option<ToldRadius> {
        let SphereRadius::Known { radius_m, u_m } = radius else { return None };
        let (free, _) = SphereFit::without_strays(points_m, SphereRadius::Free, u_point_m).ok()?;
        let (own_m, claim) = (free.u_m()?[3], free.claim?);
        let difference_m = free.radius_m - radius_m;
        // The given uncertainty is taken as well known.
        let limit_m = |chance| (claim.beyond(chance) * own_m).hypot(crate::claim::normal(chance) * u_m);
        let differs = |chance| difference_m.abs() > limit_m(chance).max(RESOLVED_M);
        differs(DOUBTED).then(|| ToldRadius { is_certain: differs(REFUSED), difference_m, free: free.clone() })
    }
}
