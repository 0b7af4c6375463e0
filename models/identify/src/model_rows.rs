//! A model beside a campaign as linear rows: residuals, partials of the lengths and of the points.
//!
//! Place in the flow: residual fields are estimated here beside the model's own parameters. Unlike [`crate::Rows`] it
//! needs no fit, only a model, from a file or elsewhere; rows are not whitened. Residual = measured − predicted length
//! (m); station names must be those of the model, in its order.

use crate::design::{Estimate, Row, Setup};
use crate::error::IdentifyError;
use crate::normal::residuals;
use crate::rows::parameters_of;
use crate::term::{self, EffectTerm};
use abbe_geometry::Vector3;
use abbe_geometry::effects::{Ray, State, tip_columns};
use abbe_geometry::model::MachineModel;
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use faer::Mat;

/// Rows of a model at a campaign's readings.
#[derive(Debug)]
pub struct ModelRows<'a> {
    model: &'a MachineModel,
    campaign: &'a Campaign,
    /// Measured minus predicted length of each reading (m).
    pub residuals_m: Vec<f64>,
    /// Declared standard uncertainty of each reading (m).
    pub u_m: Vec<f64>,
    /// Line of sight of each reading.
    pub rays: Vec<Ray>,
    /// Partials of the predicted length, readings × free parameters (m per unit).
    pub jacobian: Mat<f64>,
    /// Covariance of the free parameters for noise as declared: that of the model without what χ² scaled it by.
    pub covariance: Mat<f64>,
    /// What each column is: its place among all parameters (geometry, effects, stations).
    pub parameters: Vec<usize>,
}

impl<'a> ModelRows<'a> {
    /// Rows of a model at these readings.
    ///
    /// # Errors
    /// [`IdentifyError::NoCovariate`] where a reading lacks what the model's effects need, [`IdentifyError::Dangling`]
    /// for a station that the model does not know.
    pub fn new(
        model: &'a MachineModel,
        instrument: RangeUncertainty,
        campaign: &'a Campaign,
    ) -> Result<ModelRows<'a>, IdentifyError> {
        let parts = model.parts();
        let terms: Vec<EffectTerm> = parts.effects.iter().map(EffectTerm::of).collect();
        term::check(&terms, campaign)?;
        term::check_stations(model, campaign)?;
        let setup = Setup { machine: &parts.machine, layout: model.layout(), instrument, terms: &terms };
        let values = parameters_of(model);
        let estimate = Estimate { setup, campaign, parameters: &values };
        let parameters: Vec<usize> = (0..values.len()).filter(|k| model.covariance(*k, *k) > 0.0).collect();
        let scale = parts.quality.chi2_per_dof.max(1.0);
        let covariance = |i: usize, j: usize| model.covariance(parameters[i], parameters[j]) / scale;
        let covariance = Mat::from_fn(parameters.len(), parameters.len(), covariance);
        let (residuals_m, u_m) = residuals(&estimate).into_iter().unzip();
        let jacobian = Mat::zeros(campaign.readings.len(), parameters.len());
        let mut rows =
            ModelRows { model, campaign, residuals_m, u_m, rays: Vec::new(), jacobian, covariance, parameters };
        rows.fill(&estimate);
        Ok(rows)
    }

    fn fill(&mut self, estimate: &Estimate) {
        let place = self.places(estimate.parameters.len());
        let mut row = Row::new();
        for k in 0..self.campaign.readings.len() {
            estimate.row(k, &mut row);
            for (first, values) in row.segments() {
                for (offset, value) in values.iter().enumerate() {
                    if let Some(column) = place[first + offset] {
                        self.jacobian[(k, column)] = *value;
                    }
                }
            }
            self.rays.push(row.ray);
        }
    }

    /// Column of each parameter that is free.
    fn places(&self, count: usize) -> Vec<Option<usize>> {
        let mut place = vec![None; count];
        self.parameters.iter().enumerate().for_each(|(k, index)| place[*index] = Some(k));
        place
    }

    /// Partials of the corrected point of a reading by the free parameters (3 × parameters, m per unit): chain, squareness
    /// and effects; stations move no point.
    pub fn tip(&self, reading: usize) -> Mat<f64> {
        let parts = self.model.parts();
        let layout = self.model.layout();
        let total = self.model.machine_parameters() + 4 * parts.stations.len();
        let place = self.places(total);
        let mut tip = Mat::zeros(3, self.parameters.len());
        let mut put = |parameter: usize, column: Vector3<f64>| {
            if let Some(place) = place[parameter] {
                (0..3).for_each(|d| tip[(d, place)] = column[d]);
            }
        };
        let at = &self.campaign.readings[reading];
        let point = layout.point(&parts.machine, &parts.coefficients, at.reading_m, at.offset_m);
        layout.visit_errors(&point, |first, partial, values| {
            values.iter().enumerate().for_each(|(k, value)| put(first + k, partial * *value));
        });
        layout.squareness().zip(&point.chain.by_squareness).for_each(|(k, column)| put(k, *column));
        let covariates = crate::term::CampaignRow { campaign: self.campaign, reading };
        let state = State { reading_m: at.reading_m, offset_m: at.offset_m, covariates: &covariates };
        let mut next = layout.len();
        for fitted in &parts.effects {
            let count = fitted.parameters.len();
            // Covariates were checked when the rows were made.
            if let Ok(columns) = tip_columns(fitted.effect.as_ref(), count, &state, &point.chain.by_error) {
                columns.into_iter().enumerate().for_each(|(k, column)| put(next + k, column));
            }
            next += count;
        }
        tip
    }
}
