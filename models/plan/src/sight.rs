//! What a tracer on a stand sees of a path: range, blind zone, elevation, and the reflector's angle of acceptance.
//!
//! Place in the flow: [`crate::candidates`] keeps the stretches of lines that are seen, [`crate::route`] the moves between them
//! during which the beam is not lost. Nominal positions (m, machine frame): errors of micrometres hide no reflector.

use crate::request::Request;
use abbe_measurement::planned::{Holder, Tracer};

/// Places of a path that are looked at.
const PLACES: usize = 41;
/// Share of a line that must be seen for it to be worth driving.
const WORTH: f64 = 0.5;

/// Whether the tracer at a stand (m) sees the reflector of a holder at a reading (m).
pub(crate) fn sees(tracer: &Tracer, stand_m: [f64; 3], holder: &Holder, reading_m: [f64; 3]) -> bool {
    let beam: [f64; 3] = std::array::from_fn(|d| reading_m[d] + holder.offset_m[d] - stand_m[d]);
    let range_m = length(beam);
    if range_m < tracer.nearest_m || range_m > tracer.farthest_m {
        return false;
    }
    let elevation = (beam[2] / range_m).clamp(-1.0, 1.0).asin();
    if elevation < tracer.elevation_rad.0 || elevation > tracer.elevation_rad.1 {
        return false;
    }
    let Some((faces, angle_rad)) = holder.acceptance else { return true };
    // The beam comes from the stand: against the direction from stand to reflector.
    let along: f64 = (0..3).map(|d| -beam[d] * faces[d]).sum::<f64>() / (range_m * length(faces));
    along.clamp(-1.0, 1.0).acos() <= angle_rad
}

/// How a stand lies to the volume that the reflector moves in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Place {
    /// Outside, and no nearer than the blind zone with some holder.
    Free,
    /// The reflector would run into the tracer.
    Inside,
    /// With every holder the reflector enters the blind zone.
    Blind,
}

/// How a stand (m) lies to the boxes in which the reflector moves.
pub(crate) fn place(request: &Request, stand_m: [f64; 3]) -> Place {
    let away_m = |holder: &Holder| {
        length(std::array::from_fn(|d| {
            let (low_m, high_m) = request.volume_m[d];
            let at_m = stand_m[d] - holder.offset_m[d];
            (low_m - at_m).max(at_m - high_m).max(0.0)
        }))
    };
    let distances: Vec<f64> = request.holders.iter().map(away_m).collect();
    if distances.contains(&0.0) {
        Place::Inside
    } else if distances.iter().all(|away_m| *away_m < request.tracer.nearest_m) {
        Place::Blind
    } else {
        Place::Free
    }
}

/// Whether all of a straight move between two readings (m) is seen.
pub(crate) fn sees_move(request: &Request, stand_m: [f64; 3], holder: &Holder, ends_m: [[f64; 3]; 2]) -> bool {
    (0..PLACES).all(|k| sees(&request.tracer, stand_m, holder, at(ends_m, k as f64 / (PLACES - 1) as f64)))
}

/// The longest stretch of a straight line between two readings (m) that is seen, where that is enough of it.
pub(crate) fn seen_part(
    request: &Request,
    stand_m: [f64; 3],
    holder: &Holder,
    ends_m: [[f64; 3]; 2],
) -> Option<[[f64; 3]; 2]> {
    let (mut best, mut first): ((usize, usize), Option<usize>) = ((0, 0), None);
    for k in 0..PLACES {
        if !sees(&request.tracer, stand_m, holder, at(ends_m, share(k))) {
            first = None;
            continue;
        }
        let from = *first.get_or_insert(k);
        if k - from > best.1 - best.0 {
            best = (from, k);
        }
    }
    let is_worth = (best.1 - best.0) as f64 >= WORTH * (PLACES - 1) as f64;
    is_worth.then(|| [at(ends_m, share(best.0)), at(ends_m, share(best.1))])
}

fn share(place: usize) -> f64 {
    place as f64 / (PLACES - 1) as f64
}

/// A place on a straight line; its ends are taken as given.
fn at([from_m, to_m]: [[f64; 3]; 2], share: f64) -> [f64; 3] {
    std::array::from_fn(|d| if share >= 1.0 { to_m[d] } else { from_m[d] + share * (to_m[d] - from_m[d]) })
}

/// Length of a vector.
pub(crate) fn length(vector: [f64; 3]) -> f64 {
    vector.iter().map(|v| v * v).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRACER: Tracer = Tracer { nearest_m: 0.2, farthest_m: 2.0, elevation_rad: (-0.5, 1.2) };
    const BALL: Holder = Holder { offset_m: [0.0, 0.0, -0.1], acceptance: None };

    #[test]
    fn range_blind_zone_elevation_and_acceptance_each_hide_the_reflector() {
        let seen = |holder: &Holder, at: [f64; 3]| sees(&TRACER, [0.0; 3], holder, at);
        assert!(seen(&BALL, [1.0, 0.0, 0.1]));
        // The holder brings it to 0.15 m, 2.3 m, and 45° below.
        assert!(!seen(&BALL, [0.15, 0.0, 0.1]) && !seen(&BALL, [2.3, 0.0, 0.1]) && !seen(&BALL, [1.0, 0.0, -0.9]));
        // A reflector that looks towards -X sees a tracer there, and not one that stands sideways.
        let facing = Holder { acceptance: Some(([-1.0, 0.0, 0.0], 0.5)), ..BALL };
        assert!(seen(&facing, [1.0, 0.0, 0.1]) && !seen(&facing, [0.5, 1.0, 0.1]) && !seen(&facing, [-1.0, 0.0, 0.1]));
    }
}
