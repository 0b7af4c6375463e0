//! Columns of candidates, each over the standard uncertainty of the component that it moves.
//!
//! Place in the flow: the study of vectors asks here what a part does at its vectors; what moves several components has three rows a
//! vector. m.

use super::super::drift::{self, Motion};
use super::super::model;
use super::super::plate::RIGID;
use super::super::registered::Logged;
use super::super::shape::Bent;
use super::super::wave::Wave;
use super::{Part, Vectors};
use crate::study::candidate::{Forms, ModelTerm};
use crate::study::step::Step;
use abbe_geometry::{Axis, Vector3};
use faer::Mat;

impl Vectors<'_> {
    /// Columns of a candidate that acts on one component, at these vectors; `None` for any other.
    pub(super) fn component_columns(&self, candidate: usize, vectors: &[usize]) -> Option<(Axis, Mat<f64>)> {
        match &self.parts[candidate] {
            Part::Smooth(axis, bent) => Some((*axis, self.smooth_columns(*axis, bent, vectors))),
            Part::Step(axis, step) => Some((*axis, self.step_columns(*axis, step, vectors))),
            Part::Wave(wave) => Some((wave.axis, self.wave_columns(wave, wave.frequency().0, vectors))),
            Part::Registered(_) | Part::Angle(_) | Part::Named(_) | Part::Drift(_) => None,
        }
    }

    /// Columns of a candidate at all vectors, three rows each.
    pub(super) fn columns_of(&self, candidate: usize) -> Mat<f64> {
        let mut columns = Mat::zeros(3 * self.vectors.len(), self.candidates[candidate].parameters.len());
        if let Some((axis, own)) = self.component_columns(candidate, &(0..self.vectors.len()).collect::<Vec<usize>>()) {
            for j in 0..own.ncols() {
                let rows = columns.col_as_slice_mut(j).chunks_exact_mut(3);
                rows.zip(own.col_as_slice(j)).for_each(|(rows, value)| rows[axis.index()] = *value);
            }
            return columns;
        }
        if let (Part::Drift(drift), Some((_, time_s))) = (&self.parts[candidate], self.time()) {
            return self.drift_columns(&[drift.motion], &drift.course.functions(time_s));
        }
        for (k, sigma_m) in self.sigma_m.iter().enumerate() {
            for (j, moved) in self.motion(candidate, k).iter().enumerate() {
                (0..3).for_each(|d| columns[(3 * k + d, j)] = moved[d] / sigma_m[d]);
            }
        }
        columns
    }

    /// Motion per unit of each parameter of a candidate that may move several components, at one vector (m per unit).
    fn motion(&self, candidate: usize, k: usize) -> Vec<Vector3<f64>> {
        match (&self.parts[candidate], self.nominal.get(k)) {
            (Part::Named(named), _) => vec![named.motion_m(&self.poses.arm_m(self.vectors, k))],
            (Part::Angle(angle), Some(nominal)) => angle.motion(&self.quantities, nominal, k),
            (Part::Registered(registered), Some(nominal)) => {
                let logged = Logged { vector: &self.vectors[k], start_s: self.start_s };
                let count = self.candidates[candidate].parameters.len();
                // Only what is logged at every vector is proposed, so that there is no problem to report here.
                nominal.motion(registered.effect.as_ref(), count, &logged).unwrap_or_default().to_vec()
            }
            // Effects and angular errors are of a machine, and others move one component.
            (Part::Registered(_) | Part::Angle(_), None)
            | (Part::Smooth(..) | Part::Step(..) | Part::Wave(_) | Part::Drift(_), _) => Vec::new(),
        }
    }

    /// Whether a candidate is of the forms that a search is offered.
    pub(super) fn is_of_forms(&self, candidate: usize) -> bool {
        let is_bent = match &self.parts[candidate] {
            Part::Smooth(_, bent) => !bent.shape.is_straight(),
            Part::Angle(angle) => !angle.is_straight(),
            Part::Registered(_) | Part::Wave(_) | Part::Named(_) | Part::Step(..) | Part::Drift(_) => false,
        };
        !(self.forms == Forms::Straight && is_bent)
    }

    /// Whether no wave of the same axis before this one is still to be set: it would be the same.
    pub(super) fn is_next(&self, candidate: usize) -> bool {
        let Part::Wave(own) = &self.parts[candidate] else { return true };
        let is_open = |part: &Part| matches!(part, Part::Wave(wave) if wave.axis == own.axis && !wave.is_set());
        own.is_set() || !self.parts[..candidate].iter().any(is_open)
    }

    /// What a wave may be between the lines of a grid.
    pub(super) fn alias(&self, candidate: usize) -> Option<ModelTerm> {
        let Part::Wave(Wave { axis, .. }) = self.parts[candidate] else { return None };
        let less_m = self.offset_m()[axis.index()];
        let readings_m: Vec<f64> = self.vectors.iter().map(|vector| vector.position_m[axis.index()] - less_m).collect();
        model::alias(axis, &readings_m)
    }

    pub(super) fn wave_columns(&self, wave: &Wave, frequency: f64, vectors: &[usize]) -> Mat<f64> {
        let d = wave.axis.index();
        wave.columns(frequency, vectors.iter().map(|k| (self.vectors[*k].position_m[d], self.sigma_m[*k][d])))
    }

    pub(super) fn step_columns(&self, axis: Axis, step: &Step, vectors: &[usize]) -> Mat<f64> {
        let time_s = |k: &usize| self.vectors[*k].time_s.unwrap_or_default();
        let rows: Vec<(f64, f64)> = vectors.iter().map(|k| (time_s(k), self.sigma_m[*k][axis.index()])).collect();
        step.columns(&rows)
    }

    /// Columns of a shape at these vectors, a row each, over the standard uncertainty of the component.
    pub(super) fn smooth_columns(&self, axis: Axis, bent: &Bent, vectors: &[usize]) -> Mat<f64> {
        let mut columns = bent.columns(&self.quantities, vectors);
        let sigma_m: Vec<f64> = vectors.iter().map(|vector| self.sigma_m[*vector][axis.index()]).collect();
        for j in 0..columns.ncols() {
            columns.col_as_slice_mut(j).iter_mut().zip(&sigma_m).for_each(|(value, sigma_m)| *value /= sigma_m);
        }
        columns
    }

    pub(super) fn drift_columns(&self, motions: &[Motion], functions: &[Vec<f64>]) -> Mat<f64> {
        let arms_m = (0..self.vectors.len()).map(|k| self.poses.arm_m(self.vectors, k));
        drift::columns(motions, functions, arms_m, &self.sigma_m)
    }

    /// Components that a candidate may move.
    pub(super) fn moved(&self, candidate: usize) -> Vec<usize> {
        match &self.parts[candidate] {
            Part::Smooth(axis, _) | Part::Step(axis, _) => vec![axis.index()],
            Part::Wave(wave) => vec![wave.axis.index()],
            Part::Named(_) | Part::Registered(_) | Part::Angle(_) | Part::Drift(_) => {
                (0..3).filter(|d| self.measured[*d]).collect()
            }
        }
    }

    /// Motion of one component by shift and turn of its pose.
    pub(super) fn rigid(&self, k: usize, component: usize) -> [f64; RIGID] {
        let arm_m = self.poses.arm_m(self.vectors, k);
        std::array::from_fn(|j| match j {
            0..3 => f64::from(u8::from(j == component)),
            _ => Vector3::ith(j - 3, 1.0).cross(&arm_m)[component],
        })
    }
}
