//! Steps of a component: in a pause, between two blocks, or anywhere in the record.
//!
//! Place in the flow: places from the times of the vectors and their blocks; the study of vectors makes a candidate of each for every
//! component. Without times there is none: vectors are often written in another order than they were measured in. A step between
//! poses of a plate is part of their motions.

use super::ResidualVector;
use super::plate::Poses;
use super::quantities::PLAUSIBLE_M;
use super::quantities::TIME;
use crate::explanation::Explanation;
use crate::study::candidate::{Candidate, Goes};
use crate::study::step::{At, DECIDED_BY, Places, Step};
use abbe_geometry::Axis;
use abbe_geometry::effects::ParameterSpec;

/// All steps that a component may have.
pub(super) struct Steps {
    pub(super) places: Places,
    /// Vectors in order, and the pose of each.
    order: Vec<usize>,
    poses: Vec<usize>,
}

impl Steps {
    /// Of vectors that all have times; else none.
    pub(super) fn new(vectors: &[ResidualVector], poses: &Poses) -> Steps {
        let times: Option<Vec<f64>> = vectors.iter().map(|vector| vector.time_s).collect();
        let times = times.unwrap_or_default();
        let mut order: Vec<usize> = (0..times.len()).collect();
        order.sort_by(|a, b| times[*a].total_cmp(&times[*b]));
        let blocks: Vec<Option<&String>> = order.iter().map(|k| vectors[*k].block.as_ref()).collect();
        let places = Places::new(order.iter().map(|k| times[*k]).collect(), &blocks);
        Steps { places, poses: order.iter().map(|k| poses.of[*k]).collect(), order }
    }

    /// All candidates of one component.
    pub(super) fn all(&self) -> Vec<Step> {
        self.places.candidates().into_iter().filter(|step| step.at.iter().all(|at| self.splits_a_pose(at))).collect()
    }

    /// Whether a pose has vectors on both sides: else the motions of the poses hold the step.
    fn splits_a_pose(&self, at: &At) -> bool {
        let (before, after) = self.poses.split_at(at.before);
        before.iter().any(|pose| after.contains(pose))
    }

    /// As a candidate; `rows` are the rows of the file.
    pub(super) fn candidate(&self, step: &Step, axis: Axis, rows: &[usize]) -> Candidate {
        let component = axis.lower();
        let (names, formulas): (Vec<String>, Vec<String>) = step.at.iter().map(|at| self.words(at, rows)).unzip();
        let spec = |name: String| ParameterSpec::new(name, "m", PLAUSIBLE_M);
        Candidate {
            name: format!("{}, component {component}", names.join(" with ")),
            formula: format!("e = {}", formulas.join("; ")),
            kind: Explanation::Empirical,
            family: format!("step, component {component}"),
            covariates: vec![TIME.to_owned()],
            parameters: step.parameters().into_iter().map(spec).collect(),
            decided_by: DECIDED_BY.to_owned(),
            essential: Vec::new(),
            stands_apart: false,
            goes: Goes::ByEvidence,
        }
    }

    /// Name and formula of one step.
    fn words(&self, at: &At, rows: &[usize]) -> (String, String) {
        let [last, first] = [at.before - 1, at.before].map(|place| rows[self.order[place]] + 1);
        let (last_s, first_s) = self.places.around(at);
        let name = format!("step between {last_s} s and {first_s} s");
        (name, format!("step from vector {first} ({first_s} s) on; the last before it is vector {last} ({last_s} s)"))
    }
}
