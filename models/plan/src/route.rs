//! The order in which a station's lines are driven: little time between them, and the beam never lost.
//!
//! Place in the flow: after the search; [`crate::plan()`] puts times to what comes out. Lines of one holder follow each other. A
//! nearest-neighbour tour is improved by reversing runs of lines (2-opt) and moving single ones; a line may be turned round
//! unless directions were chosen on purpose. A move between two lines that would lose the beam goes by way of a place from
//! where both are seen; a line that cannot be reached so is left out. Readings in m.

use crate::candidates::{Candidate, distance_m};
use crate::request::Request;
use crate::sight::sees_move;
use crate::timing::{fastest_m_s, move_s};
use std::collections::BTreeMap;

/// Cost of a move that loses the beam (s): more than any tour.
const LOST_S: f64 = 1e7;
/// Rounds of improvement at most.
const ROUNDS: usize = 30;
/// How many places away a line or the other end of a run may be: all of a usual tour, fewer where hundreds of lines would take
/// longer to order than the order saves.
const FAR: usize = 6000;
const NEAR: usize = 5;
/// Levels of the grid of places by way of which a move may go.
const LEVELS: usize = 3;

/// A line in its order.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Leg {
    /// The line, in the direction in which it is driven.
    pub(crate) line: Candidate,
    /// Places between the line before and this one (m).
    pub(crate) via_m: Vec<[f64; 3]>,
}

/// Lines of one station in order; those that the beam cannot be brought to are left out.
pub(crate) fn ordered(request: &Request, lines: &[Candidate], may_turn: bool) -> Vec<Leg> {
    let mut legs: Vec<Leg> = Vec::new();
    for holder in 0..request.holders.len() {
        let own: Vec<Candidate> = lines.iter().filter(|line| line.holder == holder).copied().collect();
        if own.is_empty() {
            continue;
        }
        let mut tour = Tour { request, known: BTreeMap::new(), may_turn };
        let order = tour.improved(tour_start(legs.last().map(|leg| leg.line.ends_m[1]), &own, may_turn));
        for line in order {
            let same_holder = legs.last().filter(|leg| leg.line.holder == holder);
            match same_holder.map(|leg| way(request, leg.line, line)) {
                None => legs.push(Leg { line, via_m: Vec::new() }),
                Some(Some(via_m)) => legs.push(Leg { line, via_m }),
                Some(None) => {}
            }
        }
    }
    legs
}

/// From a start (or the first line), always the nearest line next.
fn tour_start(start_m: Option<[f64; 3]>, lines: &[Candidate], may_turn: bool) -> Vec<Candidate> {
    let mut rest = lines.to_vec();
    let mut order: Vec<Candidate> = Vec::new();
    let mut at_m = start_m.unwrap_or(rest[0].ends_m[0]);
    while !rest.is_empty() {
        let away = |line: &Candidate| {
            let ahead_m = distance_m(at_m, line.ends_m[0]);
            if may_turn { ahead_m.min(distance_m(at_m, line.ends_m[1])) } else { ahead_m }
        };
        let nearest = (0..rest.len()).reduce(|a, b| if away(&rest[b]) < away(&rest[a]) { b } else { a });
        let Some(nearest) = nearest else { break };
        let mut line = rest.remove(nearest);
        if may_turn && distance_m(at_m, line.ends_m[1]) < distance_m(at_m, line.ends_m[0]) {
            line = line.reversed();
        }
        at_m = line.ends_m[1];
        order.push(line);
    }
    order
}

/// Ends of a move, exactly.
type Ends = [[u64; 3]; 2];

struct Tour<'a> {
    request: &'a Request,
    /// Time of moves that were looked at (s).
    known: BTreeMap<Ends, f64>,
    may_turn: bool,
}

impl Tour<'_> {
    fn improved(&mut self, mut order: Vec<Candidate>) -> Vec<Candidate> {
        let mut least_s = self.time_s(&order);
        for _ in 0..ROUNDS {
            let before_s = least_s;
            let reach = FAR / order.len().max(1) + NEAR;
            for i in 0..order.len() {
                for j in i.saturating_sub(reach)..order.len().min(i + reach + 1) {
                    for other in [self.with_run_reversed(&order, i, j), with_moved(&order, i, j)].into_iter().flatten()
                    {
                        let time_s = self.time_s(&other);
                        if time_s < least_s - 1e-9 {
                            (order, least_s) = (other, time_s);
                        }
                    }
                }
            }
            if least_s >= before_s {
                break;
            }
        }
        order
    }

    fn with_run_reversed(&self, order: &[Candidate], i: usize, j: usize) -> Option<Vec<Candidate>> {
        if i > j || (i == j && !self.may_turn) {
            return None;
        }
        let mut other = order.to_vec();
        other[i..=j].reverse();
        if self.may_turn {
            other[i..=j].iter_mut().for_each(|line| *line = line.reversed());
        }
        Some(other)
    }

    fn time_s(&mut self, order: &[Candidate]) -> f64 {
        order.windows(2).map(|pair| self.move_s(pair[0], pair[1])).sum()
    }

    fn move_s(&mut self, from: Candidate, to: Candidate) -> f64 {
        let key = [from.ends_m[1], to.ends_m[0]].map(|at_m| at_m.map(f64::to_bits));
        if let Some(known_s) = self.known.get(&key) {
            return *known_s;
        }
        let time_s = way(self.request, from, to)
            .map_or(LOST_S, |via_m| way_s(self.request, from.ends_m[1], &via_m, to.ends_m[0]));
        self.known.insert(key, time_s);
        time_s
    }
}

fn with_moved(order: &[Candidate], i: usize, j: usize) -> Option<Vec<Candidate>> {
    (i != j).then(|| {
        let mut other = order.to_vec();
        let line = other.remove(i);
        other.insert(j, line);
        other
    })
}

/// Time of a move by way of places (s).
pub(crate) fn way_s(request: &Request, from_m: [f64; 3], via_m: &[[f64; 3]], to_m: [f64; 3]) -> f64 {
    let stops = std::iter::once(&from_m).chain(via_m).chain([&to_m]).collect::<Vec<_>>();
    let (feed_m_s, acceleration_m_s2) = (fastest_m_s(&request.motion), request.motion.acceleration_m_s2);
    stops.windows(2).map(|pair| move_s(distance_m(*pair[0], *pair[1]), feed_m_s, acceleration_m_s2)).sum()
}

/// Places by way of which the beam is kept from the end of one line to the start of another; `None` if there is no such way.
fn way(request: &Request, from: Candidate, to: Candidate) -> Option<Vec<[f64; 3]>> {
    let (from_m, to_m) = (from.ends_m[1], to.ends_m[0]);
    let stand_m = request.stands[to.stand].position_m;
    let holder = &request.holders[to.holder];
    let is_seen = |ends_m| sees_move(request, stand_m, holder, ends_m);
    if is_seen([from_m, to_m]) {
        return Some(Vec::new());
    }
    let place = |k: usize| -> [f64; 3] {
        let level = [k % LEVELS, k / LEVELS % LEVELS, k / (LEVELS * LEVELS)];
        std::array::from_fn(|d| {
            let (low_m, high_m) = request.volume_m[d];
            low_m + (high_m - low_m) * level[d] as f64 / (LEVELS - 1) as f64
        })
    };
    let places = (0..LEVELS * LEVELS * LEVELS).map(place);
    let ways = places.filter(|at_m| is_seen([from_m, *at_m]) && is_seen([*at_m, to_m]));
    let length_m = |at_m: &[f64; 3]| distance_m(from_m, *at_m) + distance_m(*at_m, to_m);
    ways.min_by(|a, b| length_m(a).total_cmp(&length_m(b))).map(|at_m| vec![at_m])
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_geometry::error_function::FunctionKind;
    use abbe_geometry::machine::{Joint, Machine, Side, Squareness};
    use abbe_geometry::rotation::RotationForm;
    use abbe_geometry::{Axis, ErrorId};
    use abbe_identify::{Belief, IdentifyOptions};
    use abbe_measurement::instrument::RangeUncertainty;
    use abbe_measurement::planned::{Goal, Holder, Lines, Motion, Stand, Tracer};

    /// A cube of a metre with a tracer in front of the middle of one side.
    fn request(nearest_m: f64, stand_m: [f64; 3]) -> Request {
        let tilt = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
        let machine = Machine {
            name: "cube".to_owned(),
            frame_id: "machine".to_owned(),
            joints: Axis::ALL.map(|axis| Joint { axis, side: Side::Tool }),
            stroke_m: [(0.0, 1.0); 3],
            squareness: [tilt("C0Y", Axis::Y, Axis::Z), tilt("B0Z", Axis::Z, Axis::Y), tilt("A0Z", Axis::Z, Axis::X)],
            rotation: RotationForm::Exact,
            kinds: [Some(FunctionKind::BSpline { intervals: 4 }); ErrorId::COUNT],
            repeatability_m: [0.0; 3],
            u_ram_turn_rad: [abbe_geometry::machine::USUAL_RAM_TURN_RAD; 3],
            default_offset_m: None,
        };
        Request {
            instrument: RangeUncertainty { constant_m: 1e-7, per_metre: 1e-7, common_per_metre: 0.0 },
            options: IdentifyOptions::default(),
            volume_m: machine.stroke_m,
            tips_m: vec![[0.0; 3]],
            tracer: Tracer { nearest_m, farthest_m: 5.0, elevation_rad: (-1.5, 1.5) },
            stands: vec![Stand { name: "S".to_owned(), position_m: stand_m, of_region: true }],
            most_stations: 1,
            holders: vec![Holder { offset_m: [0.0; 3], acceptance: None }],
            motion: Motion {
                feeds_m_s: vec![0.1],
                acceleration_m_s2: 0.5,
                dwell_s: 1.0,
                station_change_s: 0.0,
                holder_change_s: 0.0,
            },
            lines: Lines { points: (5, 5), levels: 2, diagonals: false },
            goal: Goal { uncertainty_m: None, budget_s: Some(1.0) },
            tell: Vec::new(),
            sensors: Vec::new(),
            belief: Belief::of_bends(&machine, |_| 1e-6).unwrap(),
            seed: 1,
            measured: None,
            machine,
        }
    }

    fn line(ends_m: [[f64; 3]; 2]) -> Candidate {
        Candidate { stand: 0, holder: 0, ends_m, points: 5, feed_m_s: 0.1, time_s: 10.0 }
    }

    #[test]
    fn lines_that_could_be_one_run_are_driven_without_a_way_between_them() {
        let request = request(0.1, [0.5, -0.5, 0.5]);
        // A square, given out of order and with one side the other way round.
        let (a, b, c, d) = ([0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]);
        let lines = [line([a, b]), line([c, d]), line([c, b]), line([d, a])];
        let legs = ordered(&request, &lines, true);
        let way_m: f64 = legs.windows(2).map(|p| distance_m(p[0].line.ends_m[1], p[1].line.ends_m[0])).sum();
        assert_eq!((legs.len(), way_m), (4, 0.0));
        // Where directions are on purpose, none is turned.
        let kept = ordered(&request, &lines, false);
        assert!(kept.iter().all(|leg| lines.contains(&leg.line)) && kept.len() == 4);
    }

    #[test]
    fn the_beam_is_kept_by_way_of_a_place_that_is_seen_and_no_move_passes_the_blind_zone() {
        // The tracer stands in front of the middle of an edge, which a move along it would bring too near.
        let request = request(0.45, [0.5, -0.3, 0.0]);
        let lines = [line([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]), line([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])];
        let legs = ordered(&request, &lines, false);
        assert_eq!(legs.len(), 2);
        for pair in legs.windows(2) {
            let stops: Vec<[f64; 3]> =
                [vec![pair[0].line.ends_m[1]], pair[1].via_m.clone(), vec![pair[1].line.ends_m[0]]].concat();
            let holder = &request.holders[0];
            assert!(stops.windows(2).all(|m| sees_move(&request, request.stands[0].position_m, holder, [m[0], m[1]])));
        }
        let via_m = way(&request, lines[0], lines[1]).unwrap();
        assert_eq!(via_m.len(), 1, "straight on, the reflector would come within 0.3 m");
    }
}
