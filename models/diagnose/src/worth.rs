//! Whether what was found is worth its uncertainty: a term may explain the readings and yet be told from the machine's errors by
//! little but its prior. Then every corrected point would carry what nobody knows of it.
//!
//! Place in the flow: beside the gate, whenever [`crate::search`] wants to adopt something. To leave a term out makes corrected points
//! wrong by what it does to them (d); to take it in makes their variance grow. Taken in, the squares of the errors are
//! smaller where d² is more than the growth. The difference that is seen holds the new uncertainty as well as the truth, and in few
//! directions, so that four times the growth is asked for: what one direction exceeds by chance in one case of twenty. Growth up to
//! twice the standard uncertainty is let pass: only what the data do not tell costs more. A rigid motion of all points is no error of theirs. Lengths in m.

use crate::paired::{add, square, without};
use abbe_geometry::Vector3;
use abbe_geometry::chain::nominal_point_m;
use abbe_geometry::correct::{correct, partials};
use abbe_geometry::effects::State;
use abbe_geometry::model::MachineModel;
use abbe_identify::{CampaignRow, EffectTerm};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::subset::spread;
use faer::Mat;

/// Readings at which corrected points are compared.
const POINTS: usize = 150;
/// Growth of the variance that needs no reason.
const FREE_GROWTH: f64 = 4.0;
/// Squared difference over the growth of the variance from which a term is worth it.
const WORTH: f64 = 4.0;

/// Why the second model, which has these terms, is not worth its uncertainty beside the first; `None` where it is. What reads nothing
/// that changes (a holder, a sag), or happens once, is there or is not, and has to be found; what the plan leaves open of it stands in u.
pub(crate) fn refusal(
    terms: &[EffectTerm],
    before: &MachineModel,
    after: &MachineModel,
    campaign: &Campaign,
) -> Option<String> {
    if terms.iter().all(|term| term.effect.reads().is_empty() || term.effect.happens_once()) {
        return None;
    }
    let cost = Cost::of(before, after, campaign)?;
    cost.is_too_much().then(|| cost.words())
}

/// What a term does to corrected points, and what they lose by it (m², mean square in space, but for a rigid motion of all).
pub(crate) struct Cost {
    /// How far they move.
    pub(crate) moved_m2: f64,
    /// Variance without the term and with it.
    variance_m2: [f64; 2],
}

impl Cost {
    /// Of a model with a term beside one without it; `None` where points cannot be corrected.
    pub(crate) fn of(before: &MachineModel, after: &MachineModel, campaign: &Campaign) -> Option<Cost> {
        let readings = spread(campaign.readings.len(), POINTS);
        let rigid = rigid(&readings, campaign);
        let (first, second) = (points(before, &readings, campaign)?, points(after, &readings, campaign)?);
        let difference: Vec<f64> = second.positions_m.iter().zip(&first.positions_m).map(|(b, a)| b - a).collect();
        Some(Cost {
            moved_m2: square(&without(difference, &rigid)) / readings.len() as f64,
            variance_m2: [variance_m2(before, &first, &rigid), variance_m2(after, &second, &rigid)],
        })
    }

    fn is_too_much(&self) -> bool {
        let [before, after] = self.variance_m2;
        after > FREE_GROWTH * before && self.moved_m2 < WORTH * (after - before)
    }

    /// Share of the variance with the term that is as much as the points move: the rest is what its prior allows, and no reading asks for.
    pub(crate) fn told_share(&self) -> f64 {
        (self.moved_m2 / self.variance_m2[1].max(f64::MIN_POSITIVE)).min(1.0)
    }

    fn words(&self) -> String {
        let um = |square_m2: f64| square_m2.sqrt() * 1e6;
        format!(
            "these data hardly tell it from the machine's own errors: corrected points would move by {:.2} µm, and be uncertain \
             by {:.2} instead of {:.2} µm (rms in space, k = 1)",
            um(self.moved_m2),
            um(self.variance_m2[1]),
            um(self.variance_m2[0])
        )
    }
}

/// Corrected points one after the other, and what they depend on.
struct Points {
    positions_m: Vec<f64>,
    /// Rows: coordinates; columns: parameters.
    partials: Mat<f64>,
}

fn points(model: &MachineModel, readings: &[usize], campaign: &Campaign) -> Option<Points> {
    let count =
        model.layout().len() + model.parts().effects.iter().map(|fitted| fitted.parameters.len()).sum::<usize>();
    let mut points = Points { positions_m: Vec::new(), partials: Mat::zeros(3 * readings.len(), count) };
    for (place, reading) in readings.iter().enumerate() {
        let r = &campaign.readings[*reading];
        let row = CampaignRow { campaign, reading: *reading };
        let state = State { reading_m: r.reading_m, offset_m: r.offset_m, covariates: &row };
        points.positions_m.extend(correct(model, &state).position_m.iter());
        for (axis, partials) in partials(model, &state)?.into_iter().enumerate() {
            partials.into_iter().for_each(|(index, value)| points.partials[(3 * place + axis, index)] += value);
        }
    }
    Some(points)
}

/// Mean variance in space of the points, without a rigid motion of all, and with what the fit leaves unexplained.
fn variance_m2(model: &MachineModel, points: &Points, rigid: &[Vec<f64>]) -> f64 {
    let (rows, count) = (points.partials.nrows(), points.partials.ncols());
    let covariance = Mat::from_fn(count, count, |i, j| model.covariance(i, j));
    let spread = &points.partials * &covariance;
    let mut trace =
        (0..rows).map(|k| (0..count).map(|j| spread[(k, j)] * points.partials[(k, j)]).sum::<f64>()).sum::<f64>();
    for direction in rigid {
        let of = |j: usize| (0..rows).map(|k| direction[k] * points.partials[(k, j)]).sum::<f64>();
        let along: Vec<f64> = (0..count).map(of).collect();
        let turned = |i: usize| (0..count).map(|j| covariance[(i, j)] * along[j]).sum::<f64>();
        trace -= (0..count).map(|i| along[i] * turned(i)).sum::<f64>();
    }
    3.0 * trace.max(0.0) / rows as f64 + model.parts().quality.unexplained_m.iter().map(|u_m| u_m * u_m).sum::<f64>()
}

/// Rigid motions of the points: six orthonormal directions, fewer where the points lie on a line.
fn rigid(readings: &[usize], campaign: &Campaign) -> Vec<Vec<f64>> {
    let nominal = |k: &usize| nominal_point_m(campaign.readings[*k].reading_m, campaign.readings[*k].offset_m);
    let points_m: Vec<Vector3<f64>> = readings.iter().map(nominal).collect();
    let centre_m = points_m.iter().sum::<Vector3<f64>>() / points_m.len().max(1) as f64;
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    let all = |of: &dyn Fn(&Vector3<f64>) -> Vector3<f64>| -> Vec<f64> {
        points_m.iter().flat_map(|point_m| of(point_m).iter().copied().collect::<Vec<f64>>()).collect()
    };
    let moves = axes.iter().map(|axis| all(&|_| *axis));
    let turns = axes.iter().map(|axis| all(&|point_m| axis.cross(&(point_m - centre_m))));
    let mut basis: Vec<Vec<f64>> = Vec::new();
    moves.chain(turns).for_each(|direction| add(&mut basis, direction));
    basis
}
