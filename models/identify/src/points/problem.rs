//! The objective and its derivatives: residuals of measured positions, normal equations.
//!
//! Place in the flow: both ways to the minimum evaluate this one object, so that they have the same objective. Unknowns:
//! the geometric parameters in [`Layout`] order (m, rad), then shift (m) and turn (rad) of the measuring frame about the
//! middle of the points, one frame a pose of a plate. Residual = measured − predicted (m, measuring frame brought near the
//! machine's). What a plate cannot see is held at zero.

use super::loss::{Loss, scale_of};
use super::poses::Plates;
use super::{MeasuredPoint, PointsError};
use crate::chords::Chords;
use crate::normal::NormalEquations;
use abbe_geometry::between_nodes::BetweenNodes;
use abbe_geometry::chain::nominal_point_m;
use abbe_geometry::layout::{Layout, Locals};
use abbe_geometry::machine::Machine;
use abbe_geometry::model::packed;
use abbe_geometry::rotation::{RotationForm, rotation, rotation_partials};
use abbe_geometry::{ErrorId, Matrix3, Vector3};
use abbe_measurement::alignment::RigidAlignment;
use faer::Mat;

/// Unknowns of the measuring frame.
pub(super) const FRAME: usize = 6;

/// Standard uncertainty of what is held at zero (m, rad): nothing beside anything that is measured.
const HELD: f64 = 1e-9;

/// Points, brought near the machine frame, and what they are compared with.
#[derive(Clone)]
pub(super) struct Problem<'a> {
    pub(super) machine: &'a Machine,
    pub(super) layout: &'a Layout,
    pub(super) points: &'a [MeasuredPoint],
    /// Measured positions after the alignment to the nominal ones (m).
    measured_m: Vec<Vector3<f64>>,
    /// Basis functions at each reading.
    locals: Vec<Locals>,
    /// 1/u² of each component of each point, repeatability of the axes included (1/m²).
    information: Vec<Vector3<f64>>,
    /// Turn and centroids of the alignment of each pose.
    pub(super) alignments: Vec<RigidAlignment>,
    plates: Plates,
    /// Unknowns that are held at zero.
    held: Vec<usize>,
}

impl<'a> Problem<'a> {
    /// Aligns the positions with the nominal points.
    pub(super) fn new(
        machine: &'a Machine,
        layout: &'a Layout,
        points: &'a [MeasuredPoint],
    ) -> Result<Problem<'a>, PointsError> {
        Problem::of_plates(machine, layout, points, &Plates::volume(points.len()))
    }

    /// Aligns each pose by itself; nothing is held yet but what no component of the points can tell of their frames.
    pub(super) fn of_plates(
        machine: &'a Machine,
        layout: &'a Layout,
        points: &'a [MeasuredPoint],
        plates: &Plates,
    ) -> Result<Problem<'a>, PointsError> {
        let nominal_m: Vec<Vector3<f64>> = points.iter().map(|p| nominal_point_m(p.reading_m, p.offset_m)).collect();
        let actual_m: Vec<Vector3<f64>> = points.iter().map(|p| p.actual_m).collect();
        let aligned = |pose: usize| {
            let own = |list: &[Vector3<f64>]| -> Vec<Vector3<f64>> { plates.members(pose).map(|k| list[k]).collect() };
            RigidAlignment::between(&own(&actual_m), &own(&nominal_m))
        };
        let alignments = (0..plates.poses()).map(aligned).collect::<Result<Vec<_>, _>>()?;
        let measured_m = actual_m.iter().enumerate().map(|(k, p)| alignments[plates.pose(k)].apply(p)).collect();
        // Measuring frames are turned into the machine's, so that a component is that of an axis.
        let of = |u_m: f64| Vector3::from(machine.repeatability_m).map(|r| 1.0 / (u_m * u_m + r * r));
        let information = points.iter().map(|p| of(p.u_m)).collect();
        let locals = points.iter().map(|p| layout.locals(p.reading_m)).collect();
        let (plates, held) = (plates.clone(), Vec::new());
        let problem = Problem { machine, layout, points, measured_m, locals, information, alignments, plates, held };
        let Some(normal) = problem.plates.lacks() else { return Ok(problem) };
        let frame = |pose: usize| {
            let first = layout.len() + FRAME * pose;
            (0..3).map(move |d| first + if d == normal { d } else { 3 + d })
        };
        let held: Vec<usize> = (0..problem.plates.poses()).flat_map(frame).collect();
        Ok(problem.holding(held))
    }

    /// The same with further unknowns held at zero.
    pub(super) fn holding(mut self, held: impl IntoIterator<Item = usize>) -> Problem<'a> {
        self.held.extend(held);
        self
    }

    /// Unknowns that are held at zero.
    pub(super) fn held(&self) -> &[usize] {
        &self.held
    }

    /// Components of a point that were measured.
    pub(super) fn dimensions(&self) -> usize {
        if self.plates.lacks().is_some() { 2 } else { 3 }
    }

    /// Robust standard deviation in units of the declared one.
    pub(super) fn scale(&self, unknowns: &[f64]) -> f64 {
        scale_of(&self.squares(unknowns), self.dimensions())
    }

    /// A vector without the component that nobody measured.
    fn seen(&self, mut vector: Vector3<f64>) -> Vector3<f64> {
        if let Some(normal) = self.plates.lacks() {
            vector[normal] = 0.0;
        }
        vector
    }

    /// The same with every point's information multiplied by its weight.
    pub(super) fn with_weights(&self, weights: &[f64]) -> Problem<'a> {
        let mut problem = self.clone();
        problem.information.iter_mut().zip(weights).for_each(|(information, weight)| *information *= *weight);
        problem
    }

    /// Number of unknowns: geometry and measuring frames.
    pub(super) fn unknowns(&self) -> usize {
        self.layout.len() + FRAME * self.plates.poses()
    }

    /// Number of unknowns that are fitted.
    pub(super) fn free(&self) -> usize {
        self.unknowns() - self.held.len()
    }

    /// Residual of one point (m).
    pub(super) fn residual_m(&self, k: usize, unknowns: &[f64]) -> Vector3<f64> {
        self.seen(self.measured_m[k] - self.frame_of(k, unknowns).apply(&self.position_m(k, unknowns)))
    }

    /// Squared standardised distance of each point.
    pub(super) fn squares(&self, unknowns: &[f64]) -> Vec<f64> {
        let frames: Vec<Frame> = (0..self.plates.poses()).map(|pose| self.frame(unknowns, pose)).collect();
        let square = |k: usize| {
            let frame = &frames[self.plates.pose(k)];
            let residual_m = self.seen(self.measured_m[k] - frame.apply(&self.position_m(k, unknowns)));
            residual_m.dot(&residual_m.component_mul(&self.information[k]))
        };
        (0..self.points.len()).map(square).collect()
    }

    /// Where the model puts a point (m, machine frame).
    fn position_m(&self, k: usize, unknowns: &[f64]) -> Vector3<f64> {
        let point = &self.points[k];
        let at = (point.reading_m, point.offset_m);
        self.layout.position_from_m(self.machine, unknowns, at, &self.locals[k])
    }

    /// The objective: the loss, and what the turn of the ram is known by before.
    pub(super) fn objective(&self, unknowns: &[f64], loss: Loss, scale: f64) -> f64 {
        let known: f64 = self.priors().map(|(k, information)| information * unknowns[k] * unknowns[k]).sum();
        loss.total(&mut self.squares(unknowns), unknowns.len(), scale) + known
    }

    /// The turn of the ram, which the offsets of the points need not tell, and what is held: index and information of the prior
    /// (1/rad², 1/m²).
    fn priors(&self) -> impl Iterator<Item = (usize, f64)> {
        let held = self.held.iter().map(|k| (*k, 1.0 / (HELD * HELD)));
        self.layout.ram_turn().zip(self.machine.u_ram_turn_rad.map(|u| 1.0 / (u * u))).chain(held)
    }

    /// JᵀWJ and JᵀWr of the weighted least-squares problem at these unknowns, with the prior of the turn of the ram.
    pub(super) fn normal(&self, unknowns: &[f64], weights: &[f64]) -> NormalEquations {
        let mut normal = self.normal_of_points(unknowns, weights);
        for (k, information) in self.priors() {
            normal.matrix[k * normal.size + k] += information;
            normal.gradient[k] -= information * unknowns[k];
        }
        normal
    }

    /// The same of the points alone.
    pub(super) fn normal_of_points(&self, unknowns: &[f64], weights: &[f64]) -> NormalEquations {
        let size = unknowns.len();
        let mut normal = NormalEquations {
            size,
            matrix: vec![0.0; size * size],
            gradient: vec![0.0; size],
            weighted_square: 0.0,
            weight: weights.iter().sum(),
            log_determinant: 0.0,
        };
        let mut rows = vec![Vector3::zeros(); size];
        for k in (0..self.points.len()).filter(|k| weights[*k] > 0.0) {
            let residual_m = self.rows(k, unknowns, &mut rows);
            let information = self.information[k] * weights[k];
            normal.weighted_square += residual_m.dot(&residual_m.component_mul(&information));
            for i in 0..size {
                let scaled = rows[i].component_mul(&information);
                normal.gradient[i] += scaled.dot(&residual_m);
                let line = &mut normal.matrix[i * size + i..(i + 1) * size];
                line.iter_mut().zip(&rows[i..]).for_each(|(entry, other)| *entry += scaled.dot(other));
            }
        }
        normal
    }

    /// What straight lines between nodes add to the packed covariance of the geometric parameters; `inverse` is that of all
    /// unknowns, not widened.
    pub(super) fn chord_covariance(
        &self,
        unknowns: &[f64],
        weights: &[f64],
        (inverse, covariance): (&Mat<f64>, &[f64]),
    ) -> Vec<f64> {
        let of = |a: usize, b: usize| covariance[packed(a, b)];
        let between_nodes = BetweenNodes::new(self.layout, unknowns, of);
        if between_nodes.is_empty() {
            return Vec::new();
        }
        let mut chords = Chords::new(unknowns.len(), &between_nodes);
        let mut rows = vec![Vector3::zeros(); unknowns.len()];
        for (k, point) in self.points.iter().enumerate().filter(|(k, _)| weights[*k] > 0.0) {
            self.rows(k, unknowns, &mut rows);
            let turn = self.frame_of(k, unknowns).turn;
            let at = self.layout.point(self.machine, unknowns, point.reading_m, point.offset_m);
            for id in ErrorId::all() {
                let Some((departure, shape)) = between_nodes.at(id, point.reading_m[id.axis().index()]) else {
                    continue;
                };
                let partial =
                    (turn * at.chain.by_error[id.index()]).component_mul(&self.information[k]) * (shape * weights[k]);
                rows.iter().enumerate().for_each(|(i, row)| chords.add(i, departure, row.dot(&partial)));
            }
        }
        let all: Vec<usize> = (0..unknowns.len()).collect();
        let mut triangle = chords.packed(&between_nodes, (&all, inverse), unknowns.len());
        // The pose of the measuring frame comes last.
        triangle.truncate(covariance.len());
        triangle
    }

    /// Residual of one point (m), and the partials of its prediction by every unknown.
    fn rows(&self, k: usize, unknowns: &[f64], rows: &mut [Vector3<f64>]) -> Vector3<f64> {
        let point = &self.points[k];
        let frame = self.frame_of(k, unknowns);
        let at = self.layout.point(self.machine, unknowns, point.reading_m, point.offset_m);
        rows.fill(Vector3::zeros());
        self.layout.visit_errors(&at, |first, partial, values| {
            let turned = frame.turn * partial;
            values.iter().enumerate().for_each(|(j, value)| rows[first + j] = turned * *value);
        });
        for (index, column) in self.layout.squareness().zip(&at.chain.by_squareness) {
            rows[index] = frame.turn * column;
        }
        for (index, column) in self.layout.ram_turn().zip(&at.by_ram_turn) {
            rows[index] = frame.turn * column;
        }
        let arm_m = at.chain.position_m - frame.middle_m;
        let by_turn = rotation_partials(RotationForm::Exact, &frame.angles_rad, &arm_m);
        let first = self.layout.len() + FRAME * self.plates.pose(k);
        for d in 0..3 {
            rows[first + d] = Vector3::ith(d, 1.0);
            rows[first + 3 + d] = by_turn.column(d).into_owned();
        }
        if self.plates.lacks().is_some() {
            rows.iter_mut().for_each(|row| *row = self.seen(*row));
        }
        self.seen(self.measured_m[k] - frame.apply(&at.chain.position_m))
    }

    fn frame_of(&self, k: usize, unknowns: &[f64]) -> Frame {
        self.frame(unknowns, self.plates.pose(k))
    }

    pub(super) fn frame(&self, unknowns: &[f64], pose: usize) -> Frame {
        let own = &unknowns[self.layout.len() + FRAME * pose..];
        let angles_rad = Vector3::new(own[3], own[4], own[5]);
        Frame {
            shift_m: Vector3::new(own[0], own[1], own[2]),
            turn: rotation(RotationForm::Exact, &angles_rad),
            angles_rad,
            middle_m: self.alignments[pose].to_m,
        }
    }
}

/// Pose of the measuring frame relative to the machine's, after alignment.
pub(super) struct Frame {
    pub(super) shift_m: Vector3<f64>,
    pub(super) turn: Matrix3<f64>,
    angles_rad: Vector3<f64>,
    pub(super) middle_m: Vector3<f64>,
}

impl Frame {
    /// A point of the machine frame in the measuring frame. The tiny turn is applied to the arm alone and added last.
    fn apply(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        let arm_m = point_m - self.middle_m;
        point_m + ((self.turn - Matrix3::identity()) * arm_m + self.shift_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::points::error::tests::{cube, machine};

    #[test]
    fn partials_agree_with_central_differences_away_from_zero() {
        let machine = machine();
        let layout = Layout::new(&machine, [0.01, 0.02, -0.05]).unwrap();
        let points = cube();
        let problem = Problem::new(&machine, &layout, &points).unwrap();
        let unknowns: Vec<f64> = (0..problem.unknowns()).map(|k| 0.01 * (1.3 * k as f64 + 0.4).sin()).collect();
        let mut rows = vec![Vector3::zeros(); unknowns.len()];
        let mut touched = 0;
        for k in [3, 17, 26] {
            let residual_m = problem.rows(k, &unknowns, &mut rows);
            assert!((residual_m - problem.residual_m(k, &unknowns)).norm() < 1e-15);
            for j in 0..unknowns.len() {
                let shifted = |by: f64| {
                    let mut shifted = unknowns.clone();
                    shifted[j] += by;
                    -problem.residual_m(k, &shifted)
                };
                let difference = (shifted(1e-6) - shifted(-1e-6)) / 2e-6;
                // Rounding 1e-16/1e-6, curvature 1e-12.
                assert!((rows[j] - difference).norm() < 2e-9, "{k} {j}: {} {difference}", rows[j]);
                touched += usize::from(rows[j].norm() > 1e-3);
            }
        }
        assert!(touched > unknowns.len());
    }

    /// Noise along an axis that repeats badly weighs as that axis does, in every sum.
    #[test]
    fn regress_each_axis_weighs_as_it_repeats() {
        let machine = Machine { repeatability_m: [0.4e-6, 0.0, 0.0], ..machine() };
        let layout = Layout::new(&machine, [0.0; 3]).unwrap();
        let points = cube();
        let problem = Problem::new(&machine, &layout, &points).unwrap();
        let unknowns: Vec<f64> = (0..problem.unknowns()).map(|k| 1e-6 * (1.3 * k as f64 + 0.4).sin()).collect();
        // u is 0.3 µm: 0.5 µm along X by Pythagoras.
        let weigh = |r: Vector3<f64>| r.x * r.x / 0.25e-12 + (r.y * r.y + r.z * r.z) / 0.09e-12;
        let expected: Vec<f64> = (0..points.len()).map(|k| weigh(problem.residual_m(k, &unknowns))).collect();
        let squares = problem.squares(&unknowns);
        assert!(squares.iter().zip(&expected).all(|(a, b)| (a / b - 1.0).abs() < 1e-9));
        let weights = vec![1.0; points.len()];
        let normal = problem.normal_of_points(&unknowns, &weights);
        assert!((normal.weighted_square / expected.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        // The gradient is half the slope of the squares, downwards.
        for j in (0..unknowns.len()).step_by(7) {
            let at = |by: f64| {
                let mut changed = unknowns.clone();
                changed[j] += by;
                problem.squares(&changed).iter().sum::<f64>()
            };
            let slope = -(at(1e-8) - at(-1e-8)) / 4e-8;
            let scale = normal.matrix[j * normal.size + j].sqrt() * expected.iter().sum::<f64>().sqrt();
            assert!((normal.gradient[j] - slope).abs() < 1e-6 * scale, "{j}: {} {slope}", normal.gradient[j]);
        }
    }
}
