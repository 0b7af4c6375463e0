//! A campaign beside a model as a linear problem: range residuals, lines of sight, and what the model could still move.
//!
//! Place in the flow: under [`crate::ranges`] and [`crate::shared`]. Rows are whitened: divided by the reading's standard
//! uncertainty, times the root of its robust weight. l = J δ + u·r(p) + noise, where δ is what the model's parameters
//! (chain, effects, stations, dead paths) are off, with its prior, and r the residual field (m). A model that was
//! identified from this campaign has already moved its parameters as far as it could, so a field must be found together
//! with them: the part of it that errors or stations swallowed comes back as δ.

use crate::ResidualError;
use abbe_geometry::Vector3;
use abbe_geometry::correct::{Status, correct};
use abbe_geometry::effects::State;
use abbe_geometry::model::{FitQuality, MachineModel, ModelParts, Station};
use abbe_geometry::unseen_expansion::UnseenExpansions;
use abbe_identify::station_start::start;
use abbe_identify::{CampaignRow, IdentifyError, ModelRows, robust, symmetric_eigen, with_lagged};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use abbe_measurement::subset::spread_by_group;
use faer::linalg::solvers::{DenseSolveCore, Llt};
use faer::{Mat, Side};

/// Standard deviation of a station's coordinates and dead path before a new campaign (m): nothing is known of them.
const STATION_PRIOR_M: f64 = 1e-3;
/// Readings without which no field is estimated.
pub(crate) const LEAST_READINGS: usize = 60;

/// Rows that take part, whitened.
#[derive(Debug)]
pub(crate) struct Problem {
    /// Index of each row among the campaign's readings.
    pub(crate) readings: Vec<usize>,
    /// Station of each row.
    pub(crate) stations: Vec<u32>,
    /// Corrected position (m, machine frame).
    pub(crate) points_m: Vec<Vector3<f64>>,
    /// Unit vector from station to reflector.
    pub(crate) directions: Vec<Vector3<f64>>,
    /// Measured − predicted length, whitened.
    pub(crate) residuals: Vec<f64>,
    /// What whitened it (1/m).
    pub(crate) whitening: Vec<f64>,
    /// Rows × parameters, whitened.
    pub(crate) jacobian: Mat<f64>,
    /// Prior precision S of the parameters' change δ.
    pub(crate) precision: Mat<f64>,
    /// S times the prior mean of δ.
    pub(crate) pull: Vec<f64>,
    /// Partials of each row's point by the parameters (3 × parameters, m per unit).
    pub(crate) tips: Vec<Mat<f64>>,
    /// Stations that residuals are relative to.
    pub(crate) placed: Vec<Station>,
    /// Covariance of the stations' coordinates and dead paths, four each (m²).
    pub(crate) station_covariance: Mat<f64>,
    /// Readings left out as outliers.
    pub(crate) rejected: usize,
    /// Scale that all lengths have in common and the model has not (m/m, k = 1): that of its own campaign is in both.
    pub(crate) u_common_scale: f64,
}

impl Problem {
    /// The problem of this campaign; `own` says that the model was identified from it.
    pub(crate) fn new(
        model: &MachineModel,
        instrument: RangeUncertainty,
        campaign: &Campaign,
        own: bool,
    ) -> Result<Problem, ResidualError> {
        let campaign = &with_lagged(campaign.clone(), &model.reads());
        let corrected_m = corrected(model, campaign)?;
        let placed;
        let model = if own {
            model
        } else {
            placed = with_stations_of(model, campaign, &corrected_m)?;
            &placed
        };
        let rows = ModelRows::new(model, instrument, campaign)?;
        let standardised: Vec<f64> = rows.residuals_m.iter().zip(&rows.u_m).map(|(r, u)| r / u).collect();
        let weights = robust::weights(&standardised, robust::scale(&standardised));
        let readings: Vec<usize> = (0..weights.len()).filter(|k| weights[*k] > 0.0).collect();
        if readings.len() < LEAST_READINGS {
            return Err(ResidualError::TooFew(readings.len(), LEAST_READINGS));
        }
        let whitening: Vec<f64> = readings.iter().map(|k| weights[*k].sqrt() / rows.u_m[*k]).collect();
        let jacobian =
            Mat::from_fn(readings.len(), rows.jacobian.ncols(), |i, j| rows.jacobian[(readings[i], j)] * whitening[i]);
        let residuals: Vec<f64> = readings.iter().zip(&whitening).map(|(k, w)| rows.residuals_m[*k] * w).collect();
        let precision = precision(&rows, model.parts().quality.chi2_per_dof, own.then_some(&jacobian))?;
        // At the optimum of the model's own fit the data pull as hard as its prior holds against.
        let pull = match own {
            true => (0..jacobian.ncols())
                .map(|j| -jacobian.col(j).iter().zip(&residuals).map(|(a, l)| a * l).sum::<f64>())
                .collect(),
            false => vec![0.0; jacobian.ncols()],
        };
        Ok(Problem {
            stations: readings.iter().map(|k| campaign.readings[*k].station).collect(),
            points_m: readings.iter().map(|k| corrected_m[*k]).collect(),
            directions: readings.iter().map(|k| rows.rays[*k].direction).collect(),
            tips: readings.iter().map(|k| rows.tip(*k)).collect(),
            placed: model.parts().stations.clone(),
            station_covariance: station_covariance(model),
            rejected: weights.len() - readings.len(),
            u_common_scale: if own { 0.0 } else { instrument.common_per_metre },
            readings,
            residuals,
            whitening,
            jacobian,
            precision,
            pull,
        })
    }

    /// About `most` rows, of each station its share, for figures that need not all of them.
    pub(crate) fn thinned(&self, most: usize) -> Problem {
        let all = self.readings.len().max(1);
        let kept = spread_by_group(self.stations.iter().copied(), |own| (own * most).div_ceil(all));
        Problem {
            readings: kept.iter().map(|k| self.readings[*k]).collect(),
            stations: kept.iter().map(|k| self.stations[*k]).collect(),
            points_m: kept.iter().map(|k| self.points_m[*k]).collect(),
            directions: kept.iter().map(|k| self.directions[*k]).collect(),
            residuals: kept.iter().map(|k| self.residuals[*k]).collect(),
            whitening: kept.iter().map(|k| self.whitening[*k]).collect(),
            jacobian: Mat::from_fn(kept.len(), self.jacobian.ncols(), |i, j| self.jacobian[(kept[i], j)]),
            precision: self.precision.clone(),
            pull: self.pull.clone(),
            tips: kept.iter().map(|k| self.tips[*k].clone()).collect(),
            placed: self.placed.clone(),
            station_covariance: self.station_covariance.clone(),
            rejected: self.rejected,
            u_common_scale: self.u_common_scale,
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.readings.len()
    }
}

/// Corrected position of every reading (m).
fn corrected(model: &MachineModel, campaign: &Campaign) -> Result<Vec<Vector3<f64>>, ResidualError> {
    let of = |(k, reading): (usize, &abbe_measurement::campaign::RangeReading)| {
        let covariates = CampaignRow { campaign, reading: k };
        let state = State { reading_m: reading.reading_m, offset_m: reading.offset_m, covariates: &covariates };
        let correction = correct(model, &state);
        match correction.status {
            Status::InVolume | Status::Extrapolated => Ok(correction.position_m),
            status => Err(ResidualError::Uncorrected { reading: k + 1, status }),
        }
    };
    campaign.readings.iter().enumerate().map(of).collect()
}

/// The same machine with the stations of another campaign, of which only their readings tell.
fn with_stations_of(
    model: &MachineModel,
    campaign: &Campaign,
    corrected_m: &[Vector3<f64>],
) -> Result<MachineModel, ResidualError> {
    let place = |(number, name): (usize, &String)| {
        let own = campaign.readings.iter().zip(corrected_m).filter(|(r, _)| r.station as usize == number);
        let points: Vec<_> = own.map(|(reading, point)| (*point, reading.length_m)).collect();
        let placed =
            start(&points, false).map_err(|problem| ResidualError::Station { station: name.clone(), problem })?;
        Ok(Station { name: name.clone(), position_m: placed.position_m, dead_path_m: placed.dead_path_m })
    };
    let stations: Vec<Station> =
        campaign.stations.iter().enumerate().map(place).collect::<Result<_, ResidualError>>()?;
    let machine = model.machine_parameters();
    let entry = |row: usize, column: usize| match (row < machine, row == column) {
        (true, _) => model.covariance(row, column),
        (false, true) => STATION_PRIOR_M.powi(2),
        (false, false) => 0.0,
    };
    let total = machine + 4 * stations.len();
    let covariance = (0..total).flat_map(|row| (0..=row).map(move |column| (row, column)));
    let covariance = covariance.map(|(row, column)| entry(row, column)).collect();
    // What a fit took of expansions that nobody saw belongs to its own stations.
    let quality = FitQuality { unseen_expansions: UnseenExpansions::default(), ..model.parts().quality.clone() };
    let parts = ModelParts { stations, covariance, chord_covariance: Vec::new(), quality, ..model.parts().clone() };
    Ok(MachineModel::new(parts).map_err(IdentifyError::from)?)
}

/// Precision of the parameters' prior. The model's covariance is that after its campaign: what the campaign told (JᵀJ) is
/// taken out again where these are the same data. What rounding and robust weights leave below zero is no knowledge.
fn precision(rows: &ModelRows, chi2_per_dof: f64, own: Option<&Mat<f64>>) -> Result<Mat<f64>, ResidualError> {
    let llt = Llt::new(rows.covariance.as_ref(), Side::Lower).map_err(|_| ResidualError::Singular)?;
    let after = llt.inverse();
    // Of other data the model knows as little as its own misfit says.
    let Some(jacobian) = own else { return Ok(&after * faer::Scale(1.0 / chi2_per_dof.max(1.0))) };
    let before = &after - jacobian.transpose() * jacobian;
    // Equilibrated by the diagonal, so that metres and radians are cut off alike.
    let scale: Vec<f64> = (0..before.nrows()).map(|k| after[(k, k)].sqrt()).collect();
    let equal = Mat::from_fn(before.nrows(), before.ncols(), |i, j| {
        0.5 * (before[(i, j)] + before[(j, i)]) / (scale[i] * scale[j])
    });
    let (values, vectors) = symmetric_eigen(&equal).ok_or(ResidualError::Singular)?;
    let scaled =
        Mat::from_fn(equal.nrows(), equal.ncols(), |i, k| vectors[(i, k)] * values[k].max(0.0).sqrt() * scale[i]);
    Ok(&scaled * scaled.transpose())
}

fn station_covariance(model: &MachineModel) -> Mat<f64> {
    let (first, count) = (model.machine_parameters(), 4 * model.parts().stations.len());
    Mat::from_fn(count, count, |i, j| model.covariance(first + i, first + j))
}
