//! Lattice behind measured points: axis coordinates, and for each unit cell the smallest box of measured corners.
//!
//! Place in the flow: made once by [`crate::cells`], so that a target costs a binary search on each axis. Coordinates (m)
//! that differ by less than a tolerance are one lattice plane; nodes may be missing. "Smallest enclosing hexahedron" (Chen
//! 2020, section 2.2) is the box of least volume whose eight corners are all measured and that contains the unit cell.

use nalgebra::Vector3;

/// Largest share of nodes to points up to which planes are worth calling a lattice; more missing nodes are a scatter.
const MOST_NODES_PER_POINT: usize = 16;

/// Axis coordinates of a lattice and the box of measured corners around each of its unit cells.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Lattice {
    /// Plane coordinates of each axis, ascending (m).
    pub(crate) axes_m: [Vec<f64>; 3],
    /// For each unit cell, x fastest: the eight measured corners around it (x fastest, lower first), if there are any.
    boxes: Vec<Option<[usize; 8]>>,
    /// Whether a point stands at every node.
    pub(crate) is_complete: bool,
}

impl Lattice {
    /// The lattice of checked points, unless they are a scatter.
    pub(crate) fn of(points_m: &[Vector3<f64>], tolerance_m: f64) -> Option<Lattice> {
        let axes_m = [0, 1, 2].map(|d| planes(points_m.iter().map(|p| p[d]).collect(), tolerance_m));
        if axes_m.iter().any(|axis| axis.len() < 2) {
            return None;
        }
        let counts = [0, 1, 2].map(|d| axes_m[d].len());
        let nodes = counts.iter().try_fold(1_usize, |product, n| product.checked_mul(*n))?;
        if nodes > MOST_NODES_PER_POINT * points_m.len() {
            return None;
        }
        let mut at = vec![None; nodes];
        for (index, point) in points_m.iter().enumerate() {
            let place = [0, 1, 2].map(|d| nearest(&axes_m[d], point[d]));
            let node = &mut at[flat(place, counts)];
            // Two points at one node: planes merge what is no lattice.
            if node.replace(index).is_some() {
                return None;
            }
        }
        let is_complete = at.iter().all(Option::is_some);
        let boxes = Search { axes_m: &axes_m, counts, at: &at }.boxes();
        Some(Lattice { axes_m, boxes, is_complete })
    }

    /// The measured corners around the unit cell that contains a target, or that is nearest to it; `None` where no box of
    /// measured corners contains that cell.
    pub(crate) fn around(&self, target_m: &Vector3<f64>) -> Option<[usize; 8]> {
        let cell = [0, 1, 2].map(|d| unit_cell(&self.axes_m[d], target_m[d]));
        self.boxes[flat(cell, [0, 1, 2].map(|d| self.axes_m[d].len() - 1))]
    }

    /// Distance (m) of a target from the box that the lattice spans.
    pub(crate) fn distance_m(&self, target_m: &Vector3<f64>) -> f64 {
        let beyond = |d: usize| {
            let axis = &self.axes_m[d];
            (axis[0] - target_m[d]).max(target_m[d] - axis[axis.len() - 1]).max(0.0)
        };
        Vector3::new(beyond(0), beyond(1), beyond(2)).norm()
    }
}

/// Index of the cell between two neighbouring planes that holds a coordinate; the first or last one beyond the ends.
pub(crate) fn unit_cell(axis_m: &[f64], coordinate_m: f64) -> usize {
    let above = axis_m.partition_point(|plane| *plane <= coordinate_m);
    above.saturating_sub(1).min(axis_m.len() - 2)
}

/// Place in a list of three indices, x fastest.
pub(crate) fn flat(place: [usize; 3], counts: [usize; 3]) -> usize {
    place[0] + counts[0] * (place[1] + counts[1] * place[2])
}

/// Means of runs of coordinates whose gaps are within the tolerance, ascending.
fn planes(mut coordinates_m: Vec<f64>, tolerance_m: f64) -> Vec<f64> {
    coordinates_m.sort_by(f64::total_cmp);
    let runs = coordinates_m.chunk_by(|a, b| b - a <= tolerance_m);
    runs.map(|run| run.iter().sum::<f64>() / run.len() as f64).collect()
}

/// Index of the plane nearest to a coordinate.
fn nearest(axis_m: &[f64], coordinate_m: f64) -> usize {
    let above = axis_m.partition_point(|plane| *plane < coordinate_m);
    let below = above.saturating_sub(1);
    let is_above = above < axis_m.len() && axis_m[above] - coordinate_m < (coordinate_m - axis_m[below]).abs();
    if is_above { above } else { below }
}

/// Search for the smallest measured box around each unit cell.
struct Search<'a> {
    axes_m: &'a [Vec<f64>; 3],
    counts: [usize; 3],
    at: &'a [Option<usize>],
}

/// A corner of a box and how far it reaches from the unit cell.
type Corner = ([usize; 3], f64);

impl Search<'_> {
    fn boxes(&self) -> Vec<Option<[usize; 8]>> {
        let cells = self.counts.map(|n| n - 1);
        let cell = |k: usize| [k % cells[0], k / cells[0] % cells[1], k / cells[0] / cells[1]];
        (0..cells.iter().product()).map(|k| self.smallest(cell(k))).collect()
    }

    /// The smallest box around one unit cell. Lower and upper corners are tried nearest first; a lower corner whose box up
    /// to the cell is already too large ends the search.
    fn smallest(&self, cell: [usize; 3]) -> Option<[usize; 8]> {
        let next = cell.map(|k| k + 1);
        if let Some(corners) = self.corners(cell, next) {
            return Some(corners);
        }
        let lowers = self.measured([0; 3], next, |corner| self.volume(corner, next));
        let uppers = self.measured(next, self.counts, |corner| self.volume(cell, corner));
        let mut best: Option<(f64, [usize; 8])> = None;
        for (lower, least) in &lowers {
            if best.is_some_and(|(volume, _)| *least >= volume) {
                break;
            }
            for (upper, least) in &uppers {
                if best.is_some_and(|(volume, _)| *least >= volume) {
                    break;
                }
                let volume = self.volume(*lower, *upper);
                if best.is_none_or(|(smallest, _)| volume < smallest)
                    && let Some(corners) = self.corners(*lower, *upper)
                {
                    best = Some((volume, corners));
                }
            }
        }
        best.map(|(_, corners)| corners)
    }

    /// Measured nodes from `first` up to, not including, `end`, those with the least volume first.
    fn measured(&self, first: [usize; 3], end: [usize; 3], volume: impl Fn([usize; 3]) -> f64) -> Vec<Corner> {
        let mut found = Vec::new();
        for z in first[2]..end[2] {
            for y in first[1]..end[1] {
                for x in first[0]..end[0] {
                    if self.at[flat([x, y, z], self.counts)].is_some() {
                        found.push(([x, y, z], volume([x, y, z])));
                    }
                }
            }
        }
        found.sort_by(|a, b| a.1.total_cmp(&b.1));
        found
    }

    /// Volume (m³) of the box between two nodes.
    fn volume(&self, lower: [usize; 3], upper: [usize; 3]) -> f64 {
        (0..3).map(|d| self.axes_m[d][upper[d]] - self.axes_m[d][lower[d]]).product()
    }

    /// The points at the eight corners of a box, x fastest, if all are measured.
    fn corners(&self, lower: [usize; 3], upper: [usize; 3]) -> Option<[usize; 8]> {
        let mut corners = [0; 8];
        for (k, corner) in corners.iter_mut().enumerate() {
            let node = [0, 1, 2].map(|d| if k >> d & 1 == 1 { upper[d] } else { lower[d] });
            *corner = self.at[flat(node, self.counts)]?;
        }
        Some(corners)
    }
}
