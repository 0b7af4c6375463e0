//! Examples for a network: targets that are not among the calibrated points of their own cell.
//!
//! Place in the flow: indices of points to learn from and to validate by in, [`Examples`] out. A measured point becomes a
//! target by taking it out of the lattice together with a part of space around it; what is left stands for the calibrated
//! points. Each target is seen several times, with more and more of its surroundings taken away, so that the
//! network meets dense and sparse cells. For a network on kriging the target is what kriging of the points left misses.
//! Validation targets are seen in the lattice of all points to learn from.

use crate::config::{Split, SplitKind};
use crate::optimise::{Examples, OUTPUTS, View};
use crate::split;
use abbe_field::{FieldError, Samples, place_of};
use abbe_residual_net::network::{NetworkConfig, Normaliser, PositionConfig, token_size};
use abbe_residual_net::{CalibratedPoints, Kriging, PositionEnsemble, ResidualMethod, place, place_box, spacing};
use nalgebra::Vector3;
use thiserror::Error;

/// Parts into which the points are dealt for a view.
const PARTS: usize = 4;
/// Smallest standard deviation, over the largest of the components, that scales a component.
const LEAST_SCALE: f64 = 1e-6;

/// Why there are no examples.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ViewError {
    /// Too few points are left somewhere.
    #[error(
        "of the points left after holding some out: {0}; or hold out less by more folds or more blocks_per_axis in [split]"
    )]
    Field(#[from] FieldError),
    /// Kriging of a part has no solution.
    #[error("kriging of a part of the points is not positive definite; are points measured twice without noise?")]
    NotPositiveDefinite,
}

/// What all networks of a training have in common.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Material<'a> {
    /// Network alone, or on kriging.
    pub(crate) kind: ResidualMethod,
    /// All measured points.
    pub(crate) field: &'a Samples,
    /// Scale of each input.
    pub(crate) scale: &'a [f64],
    /// Kriging whose length scales are used for every part.
    pub(crate) kriging: &'a Kriging,
    /// Sizes and switches.
    pub(crate) config: &'a NetworkConfig,
    /// Units of the network.
    pub(crate) normaliser: &'a Normaliser,
    /// How points are divided.
    pub(crate) split: &'a Split,
}

impl Material<'_> {
    /// Places of these points.
    fn places(&self, points: &[usize]) -> Vec<Vector3<f64>> {
        points.iter().map(|k| place_of(self.field.point(*k))).collect()
    }

    /// Examples from points to learn from and points to validate by.
    pub(crate) fn examples(&self, training: &[usize], validation: &[usize], seed: u64) -> Result<Examples, ViewError> {
        let points = self.places(training);
        let mut views = Vec::new();
        for (number, depth) in depths(self.split).iter().enumerate() {
            let part = split::folds(&points, depth, seed.wrapping_add(number as u64));
            views.push(self.view(training, &part, depth.folds)?);
        }
        let validation = self.seen(training, validation)?;
        Ok(Examples { training: views, validation })
    }

    /// Each target seen in the lattice of all points that are not in its part.
    fn view(&self, training: &[usize], part: &[usize], parts: usize) -> Result<View, ViewError> {
        let input_size = abbe_residual_net::VERTICES * token_size(self.field.size());
        let mut view =
            View { inputs: vec![0.0; training.len() * input_size], outputs: vec![0.0; training.len() * OUTPUTS] };
        for number in 0..parts {
            let (targets, rest): (Vec<usize>, Vec<usize>) = (0..training.len()).partition(|k| part[*k] == number);
            let of = |list: &[usize]| list.iter().map(|k| training[*k]).collect::<Vec<_>>();
            let seen = self.seen(&of(&rest), &of(&targets))?;
            for (place, target) in targets.iter().enumerate() {
                let copy = |from: &[f32], to: &mut [f32], size: usize| {
                    to[target * size..(target + 1) * size].copy_from_slice(&from[place * size..(place + 1) * size]);
                };
                copy(&seen.inputs, &mut view.inputs, input_size);
                copy(&seen.outputs, &mut view.outputs, OUTPUTS);
            }
        }
        Ok(view)
    }

    /// Targets in the lattice of other points.
    fn seen(&self, lattice: &[usize], targets: &[usize]) -> Result<View, ViewError> {
        let part = self.field.part(lattice)?;
        let kriging = if self.kind == ResidualMethod::KrigingNetwork {
            self.kriging.on(&part).ok_or(ViewError::NotPositiveDefinite)?
        } else {
            self.kriging.clone() // not evaluated below a network alone
        };
        let lattice = CalibratedPoints::new(self.kind, &part, self.scale, &kriging, Some(*self.normaliser));
        let mut view = View::default();
        for target in targets {
            let point = self.field.point(*target);
            let Some(vertices) = lattice.vertices(point) else { continue };
            let tokens = lattice.tokens(self.config, self.normaliser, point, &vertices);
            view.inputs.extend(tokens.iter().flat_map(|token| &token[..token_size(self.field.size())]));
            let residual = self.field.errors_m()[*target] - lattice.below_m(point);
            view.outputs.extend(self.normaliser.normalise(&residual).iter().map(|value| *value as f32));
        }
        Ok(view)
    }

    /// What kriging of the points to learn from leaves of each of them when its part of space is taken away (m).
    pub(crate) fn left_by_kriging(&self, training: &[usize], seed: u64) -> Result<Vec<Vector3<f64>>, ViewError> {
        let points = self.places(training);
        let part = split::folds(&points, &Split { folds: PARTS, ..*self.split }, seed);
        let mut left = vec![Vector3::zeros(); training.len()];
        for number in 0..PARTS {
            let (targets, rest): (Vec<usize>, Vec<usize>) = (0..training.len()).partition(|k| part[*k] == number);
            let rest = self.field.part(&rest.iter().map(|k| training[*k]).collect::<Vec<_>>())?;
            let kriging = self.kriging.on(&rest).ok_or(ViewError::NotPositiveDefinite)?;
            let lattice = CalibratedPoints::new(ResidualMethod::Kriging, &rest, self.scale, &kriging, None);
            for target in targets {
                let index = training[target];
                left[target] = self.field.errors_m()[index] - lattice.kriging_m(self.field.point(index));
            }
        }
        Ok(left)
    }
}

/// Examples for a network on the inputs: places in ±1 over the box of the known points, and normalised residuals.
#[derive(Debug, Clone)]
pub(crate) struct Positions<'a> {
    field: &'a Samples,
    normaliser: &'a Normaliser,
    low: Vec<f64>,
    high: Vec<f64>,
}

impl<'a> Positions<'a> {
    /// Of the points of a field, over the box of what is known of it.
    pub(crate) fn new(field: &'a Samples, known: &Samples, normaliser: &'a Normaliser) -> Positions<'a> {
        let (low, high) = place_box(known);
        Positions { field, normaliser, low, high }
    }

    /// Examples of these points.
    pub(crate) fn view(&self, points: &[usize]) -> View {
        let mut view = View::default();
        for k in points {
            view.inputs.extend(&place(self.field.point(*k), &self.low, &self.high)[..self.field.size()]);
            let residual = self.normaliser.normalise(&self.field.errors_m()[*k]);
            view.outputs.extend(residual.iter().map(|r| *r as f32));
        }
        view
    }

    /// Points to learn from and points to validate by.
    pub(crate) fn examples(&self, training: &[usize], validation: &[usize]) -> Examples {
        Examples { training: vec![self.view(training)], validation: self.view(validation) }
    }

    /// What was trained on these examples.
    pub(crate) fn ensemble(&self, config: PositionConfig, members: Vec<Vec<f32>>) -> PositionEnsemble {
        let Normaliser { mean_m, scale_m, .. } = *self.normaliser;
        PositionEnsemble { config, low: self.low.clone(), high: self.high.clone(), mean_m, scale_m, members }
    }
}

/// How much is taken away around a target, from single points to blocks as large as those of the split.
fn depths(split: &Split) -> Vec<Split> {
    let random = Split { kind: SplitKind::Random, folds: PARTS, ..*split };
    match split.kind {
        SplitKind::Random => vec![random],
        SplitKind::Blocks => vec![
            random,
            Split { folds: PARTS, blocks_per_axis: 2 * split.blocks_per_axis, ..*split },
            Split { folds: PARTS, ..*split },
        ],
    }
}

/// Units of a network for these residuals (m) at the points of a field, whose inputs have these scales.
pub(crate) fn normaliser(field: &Samples, scale: &[f64], residual_m: &[Vector3<f64>]) -> Normaliser {
    let count = residual_m.len().max(1) as f64;
    let mean_m = residual_m.iter().sum::<Vector3<f64>>() / count;
    let square = residual_m.iter().map(|r| (r - mean_m).map(|d| d * d)).sum::<Vector3<f64>>() / count;
    let deviation = square.map(f64::sqrt);
    // A component without any variation is scaled like the others, so that it stays zero.
    let least = deviation.max() * LEAST_SCALE;
    let scale_m = deviation.map(|d| if d > least { d } else { deviation.max().max(f64::MIN_POSITIVE) });
    let scaled: Vec<f64> =
        field.points().flat_map(|point| point.iter().zip(scale).map(|(at, scale)| at / scale)).collect();
    Normaliser { mean_m, scale_m, spacing_m: spacing(field.size(), scaled.chunks_exact(field.size())) }
}
