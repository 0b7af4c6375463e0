//! Lines that could be driven: along each axis, on the diagonals of the volume and of its faces.
//!
//! Place in the flow: the search chooses among them. Each path is a line of scale readings through the volume (m); a candidate
//! is the stretch of a path that a stand sees with a holder, in one direction.

use crate::request::Request;
use crate::sight::{length, seen_part};
use crate::timing::{fastest_m_s, line_s, move_s};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A straight path of readings (m) with its number of points and its feed (m/s).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Path {
    pub(crate) ends_m: [[f64; 3]; 2],
    pub(crate) points: u32,
    pub(crate) feed_m_s: f64,
}

/// A path as driven from a stand with a holder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Candidate {
    /// Index of the stand.
    pub(crate) stand: usize,
    /// Index of the holder.
    pub(crate) holder: usize,
    /// First and last reading (m).
    pub(crate) ends_m: [[f64; 3]; 2],
    pub(crate) points: u32,
    pub(crate) feed_m_s: f64,
    /// Time it takes with a usual move to its start (s).
    pub(crate) time_s: f64,
}

impl Candidate {
    /// Readings of its points (m), evenly spaced; the ends as given.
    pub(crate) fn readings_m(&self) -> impl Iterator<Item = [f64; 3]> + '_ {
        let steps = self.points.saturating_sub(1).max(1);
        let [from_m, to_m] = self.ends_m;
        (0..self.points).map(move |k| {
            let share = f64::from(k) / f64::from(steps);
            std::array::from_fn(|d| if k == steps { to_m[d] } else { from_m[d] + share * (to_m[d] - from_m[d]) })
        })
    }

    /// The same, driven the other way.
    pub(crate) fn reversed(mut self) -> Candidate {
        self.ends_m.reverse();
        self
    }

    /// Length of the path (m).
    pub(crate) fn length_m(&self) -> f64 {
        distance_m(self.ends_m[0], self.ends_m[1])
    }
}

/// Distance between two readings (m).
pub(crate) fn distance_m(a: [f64; 3], b: [f64; 3]) -> f64 {
    length(std::array::from_fn(|d| b[d] - a[d]))
}

/// All paths through the volume, in a fixed order; numbers of points and feeds by the seed.
pub(crate) fn paths(request: &Request) -> Vec<Path> {
    let mut generator = ChaCha8Rng::seed_from_u64(request.seed);
    let mut ends: Vec<[[f64; 3]; 2]> = (0..3).flat_map(|axis| parallels(request, axis)).collect();
    if request.lines.diagonals {
        ends.extend(body_diagonals(request));
        ends.extend(face_diagonals(request));
    }
    let feeds = &request.motion.feeds_m_s;
    let (fewest, most) = request.lines.points;
    let path = |(k, ends_m): (usize, [[f64; 3]; 2])| {
        let ends_m = if generator.random() { [ends_m[1], ends_m[0]] } else { ends_m };
        Path { ends_m, points: generator.random_range(fewest..=most), feed_m_s: feeds[k % feeds.len()] }
    };
    ends.into_iter().enumerate().map(path).collect()
}

fn parallels(request: &Request, axis: usize) -> Vec<[[f64; 3]; 2]> {
    let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
    let levels = request.lines.levels;
    let level = |axis: usize, k: usize| {
        let (low_m, high_m) = request.volume_m[axis];
        if k + 1 == levels { high_m } else { low_m + (high_m - low_m) * k as f64 / (levels - 1) as f64 }
    };
    let mut lines = Vec::new();
    for i in 0..levels {
        for j in 0..levels {
            let mut ends_m = [[0.0; 3]; 2];
            for end_m in &mut ends_m {
                (end_m[a], end_m[b]) = (level(a, i), level(b, j));
            }
            (ends_m[0][axis], ends_m[1][axis]) = request.volume_m[axis];
            lines.push(ends_m);
        }
    }
    lines
}

/// A corner of the volume (m); true for the upper end of an axis.
pub(crate) fn corner_m(request: &Request, upper: [bool; 3]) -> [f64; 3] {
    std::array::from_fn(|d| if upper[d] { request.volume_m[d].1 } else { request.volume_m[d].0 })
}

fn body_diagonals(request: &Request) -> Vec<[[f64; 3]; 2]> {
    let starts = [[false; 3], [false, true, false], [false, false, true], [false, true, true]];
    starts.map(|start| [corner_m(request, start), corner_m(request, start.map(|upper| !upper))]).to_vec()
}

fn face_diagonals(request: &Request) -> Vec<[[f64; 3]; 2]> {
    let mut lines = Vec::new();
    for normal in 0..3 {
        for side in [false, true] {
            for rising in [false, true] {
                let mut start = [false; 3];
                start[(normal + 2) % 3] = rising;
                let mut end = start.map(|upper| !upper);
                (start[normal], end[normal]) = (side, side);
                lines.push([corner_m(request, start), corner_m(request, end)]);
            }
        }
    }
    lines
}

/// What a stand sees of the paths, with every holder, in one direction each.
pub(crate) fn seen_from(request: &Request, stand: usize, paths: &[Path]) -> Vec<Candidate> {
    let stand_m = request.stands[stand].position_m;
    let mut seen = Vec::new();
    for path in paths {
        for (holder, own) in request.holders.iter().enumerate() {
            if let Some(ends_m) = seen_part(request, stand_m, own, path.ends_m) {
                seen.push(candidate(request, (stand, holder), path, ends_m));
            }
        }
    }
    seen
}

fn candidate(request: &Request, (stand, holder): (usize, usize), path: &Path, ends_m: [[f64; 3]; 2]) -> Candidate {
    let motion = &request.motion;
    let Path { points, feed_m_s, .. } = *path;
    let usual_m = request.volume_m.iter().map(|(low_m, high_m)| high_m - low_m).sum::<f64>() / 3.0;
    let approach_s = move_s(usual_m, fastest_m_s(motion), motion.acceleration_m_s2);
    let time_s = line_s(motion, distance_m(ends_m[0], ends_m[1]), points, feed_m_s) + approach_s;
    Candidate { stand, holder, ends_m, points, feed_m_s, time_s }
}
