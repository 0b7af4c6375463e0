//! Predictions of points that a model did not learn from.
//!
//! Place in the flow: a method and the folds in; for each point its error (predicted − measured, m) and stated deviation (m) out.
//! Each fold is predicted by a model of the other folds' points, with the very function that runs live. The deviation is
//! that of the difference to a measurement: what the machine does about the prediction, and what the measurement scatters by. What
//! all measurements have in common does not show in a difference between them.

use crate::error::TrainingError;
use crate::networks::Networks;
use crate::recommend::{Candidate, ZERO, named};
use abbe_field::Samples;
use abbe_residual_net::{Calibration, Kriging, NORMAL_95, ResidualMethod};
use nalgebra::Vector3;

/// Prediction of a point that was held out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeldOutPoint {
    /// Index of the point in the data.
    pub index: usize,
    /// Predicted residual (m).
    pub predicted_m: Vector3<f64>,
    /// Standard uncertainty of predicted − measured (m), calibrated: of field and measurement.
    pub u_m: Vector3<f64>,
}

/// Predictions of one method.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Predicted {
    /// What predicted.
    pub(crate) kind: ResidualMethod,
    /// Whether it had the position alone, beside methods that have further inputs.
    pub(crate) position_alone: bool,
    /// Fold of each point.
    pub(crate) fold: Vec<usize>,
    /// Predicted − measured (m); none where nothing was trained for the fold.
    pub(crate) errors_m: Vec<Option<Vector3<f64>>>,
    /// Stated standard deviation of the error (m), before calibration.
    pub(crate) deviations_m: Vec<Option<Vector3<f64>>>,
}

/// Predicts each fold from the others, with kriging `without` it. Member k of the networks predicts fold k.
pub(crate) fn predict(
    field: &Samples,
    scale: &[f64],
    without: &[Kriging],
    fold: &[usize],
    kind: ResidualMethod,
    networks: &Networks,
) -> Result<Predicted, TrainingError> {
    let trained = networks.members().unwrap_or(without.len());
    let mut predicted = Predicted {
        kind,
        position_alone: false,
        fold: fold.to_vec(),
        errors_m: vec![None; fold.len()],
        deviations_m: vec![None; fold.len()],
    };
    for (held, kriging) in without.iter().enumerate().take(trained) {
        let rest: Vec<usize> = (0..fold.len()).filter(|k| fold[*k] != held).collect();
        let part = field.part(&rest).map_err(crate::views::ViewError::from)?;
        let model = networks.member(held).model(kind, &part, scale, kriging, Calibration::none())?;
        for index in (0..fold.len()).filter(|k| fold[*k] == held) {
            let Some(found) = model.predict_apart(field.point(index)) else { continue };
            let variance_m2 = found.own_m2 + model.parts().kriging.scatter_m2(field, index);
            predicted.errors_m[index] = Some(found.residual_m - field.errors_m()[index]);
            predicted.deviations_m[index] = Some(variance_m2.map(f64::sqrt));
        }
    }
    Ok(predicted)
}

impl Predicted {
    /// Name in tables.
    pub(crate) fn method(&self) -> String {
        named(self.kind.name(), self.position_alone)
    }

    /// Errors with their deviations (m).
    pub(crate) fn pairs(&self) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        self.errors_m.iter().zip(&self.deviations_m).filter_map(|(e, u)| Some(((*e)?, (*u)?))).collect()
    }

    /// Predictions with their calibrated uncertainty.
    pub(crate) fn points(&self, field: &Samples, calibration: &Calibration) -> Vec<HeldOutPoint> {
        let one = |index: usize| {
            Some(HeldOutPoint {
                index,
                predicted_m: self.errors_m[index]? + field.errors_m()[index],
                u_m: self.deviations_m[index]?.component_mul(&calibration.scale),
            })
        };
        (0..self.fold.len()).filter_map(one).collect()
    }

    /// Share of components within their 95 % interval when each fold is scaled by factors found on the others.
    pub(crate) fn coverage_95(&self) -> Option<f64> {
        let folds = self.fold.iter().max()? + 1;
        let (mut held, mut within) = (0_usize, 0_usize);
        for fold in 0..folds {
            let of = |wanted: &dyn Fn(usize) -> bool| -> Vec<(Vector3<f64>, Vector3<f64>)> {
                let all = self.fold.iter().zip(self.errors_m.iter().zip(&self.deviations_m));
                all.filter(|(f, _)| wanted(**f)).filter_map(|(_, (e, u))| Some(((*e)?, (*u)?))).collect()
            };
            let (own, others) = (of(&|f| f == fold), of(&|f| f != fold));
            let Some(calibration) = Calibration::from_held_out(&others) else { continue };
            for (error, deviation) in own {
                let half = deviation.component_mul(&calibration.scale) * NORMAL_95;
                within += (0..3).filter(|axis| error[*axis].abs() <= half[*axis]).count();
                held += 3;
            }
        }
        (held > 0).then(|| within as f64 / held as f64)
    }
}

/// Methods with their errors at some points, "zero" first; each must have predicted these points.
pub(crate) fn candidates(field: &Samples, predicted: &[Predicted], points: &[usize]) -> Vec<Candidate> {
    let zero = points.iter().map(|k| -field.errors_m()[*k]).collect();
    let of = |p: &Predicted| Candidate {
        method: p.method(),
        is_plainer: p.position_alone,
        errors_m: points.iter().filter_map(|k| p.errors_m[*k]).collect(),
    };
    let zero = Candidate { method: ZERO.to_owned(), is_plainer: true, errors_m: zero };
    std::iter::once(zero).chain(predicted.iter().map(of)).collect()
}
