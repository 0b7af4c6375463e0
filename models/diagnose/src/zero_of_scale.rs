//! At which air the ranges are right: what an effect that stretches them takes for granted.
//!
//! Place in the flow: near the end of [`crate::diagnose()`], on the fit that is adopted. Uncompensated refraction follows a logged quantity from a
//! zero that its formula names, standard air. The instrument may have another: its own sensor stands elsewhere, or somebody typed another
//! value. A stretch that all readings have in common is the scale of the machine, to any campaign. So the zero is taken to lie as far off as
//! the readings lie from it:
//!
//! ```text
//! u(s)² = mean (Δl/l)²,   C += u(s)² g gᵀ,   g = V Jᵀ l
//! ```
//!
//! l is the range (m), Δl what the effect does to it, g what a common stretch moves the parameters by.

use crate::candidates::Round;
use crate::error::DiagnoseError;
use crate::taken::Taken;
use abbe_geometry::effects::known;
use abbe_geometry::model::{FittedEffect, MachineModel, ModelError};
use faer::{Mat, Scale};

/// A scale of all ranges that nobody measured.
#[derive(Debug, Clone)]
pub(crate) struct ZeroOfScale {
    /// Effect that takes it for granted.
    effect: &'static str,
    /// Standard uncertainty of the scale.
    u: f64,
    taken: Taken,
}

impl ZeroOfScale {
    /// Of the effects of a model that was fitted to these rows.
    pub(crate) fn all(model: &MachineModel, round: &Round) -> Result<Vec<ZeroOfScale>, DiagnoseError> {
        let open = model.parts().effects.iter().filter(|fitted| fitted.effect.has_open_zero());
        open.map(|fitted| ZeroOfScale::of(fitted, model, round)).collect()
    }

    fn of(fitted: &FittedEffect, model: &MachineModel, round: &Round) -> Result<ZeroOfScale, DiagnoseError> {
        let rows = &round.rows;
        let range_m = |k: usize| rows.rays[k].range_m;
        let added_m = round.on_ranges_m(fitted)?;
        let squares: f64 = added_m.iter().map(|(k, added)| (added / range_m(*k).max(f64::MIN_POSITIVE)).powi(2)).sum();
        let u = (squares / added_m.len().max(1) as f64).sqrt();
        let mut stretched: Vec<f64> =
            (0..rows.len()).map(|k| if rows.whitening[k] > 0.0 { range_m(k) } else { 0.0 }).collect();
        rows.whiten(&mut stretched);
        let reach = round.linear.reach(Mat::from_fn(rows.len(), 1, |k, _| stretched[k]).as_ref());
        let taken = Scale(u * u) * (&reach * reach.transpose());
        Ok(ZeroOfScale { effect: fitted.effect.name(), u, taken: Taken::new(model, rows, taken) })
    }

    /// What is taken for granted, for readers.
    pub(crate) fn words(&self) -> String {
        let title = known(self.effect).map_or(self.effect, |known| known.title);
        format!(
            "{title}: no reading tells at which air the ranges are right. Standard air is taken; the scale of the machine is uncertain by \
             {:.2} µm/m more for it, which stands in U. Measure a calibrated length to know it.",
            self.u * 1e6
        )
    }

    /// A model with it in its uncertainty, where it has that effect.
    pub(crate) fn told(&self, model: MachineModel) -> Result<MachineModel, ModelError> {
        if !model.parts().effects.iter().any(|fitted| fitted.effect.name() == self.effect) {
            return Ok(model);
        }
        let mut parts = model.parts().clone();
        self.taken.add(&model, &mut parts.covariance);
        MachineModel::new(parts)
    }
}
