//! Networks of a kind, and the model that they make with kriging of a field.
//!
//! Place in the flow: trained members in; the same model for held-out folds (one member, part of the points), for the
//! comparison, and for what runs live. Kriging under networks on the neighbourhood is that of the field itself; over a trend it is
//! fitted anew to what the trend leaves.

use crate::error::TrainingError;
use crate::kriging::kriging_of;
use crate::views::ViewError;
use abbe_field::Samples;
use abbe_field::kriging::Kernel;
use abbe_residual_net::{
    Calibration, Ensemble, Kriging, ModelError, Parts, PositionEnsemble, ResidualMethod, ResidualModel, Trend,
};

/// Covariance of what a trend leaves. A network that bends sharply leaves nothing very smooth.
const LEFT_KERNEL: Kernel = Kernel::Matern52;

/// What a kind has beside kriging.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Networks {
    /// Nothing.
    None,
    /// Networks on the neighbourhood.
    Neighbourhood(Ensemble),
    /// Networks on the inputs.
    Position(PositionEnsemble),
}

impl Networks {
    /// Number of members that were trained; `None` where there is nothing to train.
    pub(crate) fn members(&self) -> Option<usize> {
        match self {
            Networks::None => None,
            Networks::Neighbourhood(ensemble) => Some(ensemble.members.len()),
            Networks::Position(ensemble) => Some(ensemble.members.len()),
        }
    }

    /// A single member.
    pub(crate) fn member(&self, number: usize) -> Networks {
        match self {
            Networks::None => Networks::None,
            Networks::Neighbourhood(all) => {
                Networks::Neighbourhood(Ensemble { members: vec![all.members[number].clone()], ..all.clone() })
            }
            Networks::Position(all) => {
                Networks::Position(PositionEnsemble { members: vec![all.members[number].clone()], ..all.clone() })
            }
        }
    }

    /// The model of a kind on a field, whose own kriging is given, with the scale of each input.
    pub(crate) fn model(
        self,
        kind: ResidualMethod,
        field: &Samples,
        scale: &[f64],
        kriging: &Kriging,
        calibration: Calibration,
    ) -> Result<ResidualModel, TrainingError> {
        let (kriging, ensemble, trend) = match self {
            Networks::None => (kriging.clone(), None, None),
            Networks::Neighbourhood(ensemble) => (kriging.clone(), Some(ensemble), None),
            Networks::Position(trend) => (of_left(&trend, field, kriging)?, None, Some(trend)),
        };
        let parts = Parts { kind, field: field.clone(), scale: scale.to_vec(), kriging, ensemble, trend, calibration };
        Ok(ResidualModel::new(parts)?)
    }
}

/// Kriging of what a trend leaves of a field, with what is seen of the declared uncertainties as in kriging of the field itself.
fn of_left(ensemble: &PositionEnsemble, field: &Samples, kriging: &Kriging) -> Result<Kriging, TrainingError> {
    let trend = Trend::new(ensemble.clone()).map_err(ModelError::from)?;
    let left = trend.left(field).map_err(ViewError::from)?;
    kriging_of(&left, LEFT_KERNEL, &kriging.seen())
}

/// Scale of each input, in its unit: what kriging finds the field to change over, the geometric mean of the components. Positions
/// alone are in one unit already, and have the scale 1.
pub(crate) fn input_scale(field: &Samples, kriging: &Kriging) -> Vec<f64> {
    let mean =
        |d: usize| (kriging.components.iter().map(|component| component.length[d].ln()).sum::<f64>() / 3.0).exp();
    let is_plain = field.is_position_alone();
    (0..field.size()).map(|d| if is_plain { 1.0 } else { mean(d) }).collect()
}
