//! A settled fit as a linear problem: whitened rows of its Jacobian, residuals, and columns of effects not in it.
//!
//! Place in the flow: diagnosis asks here what the model already has (the Jacobian's columns) and what a candidate
//! effect would add. Each row is divided by the reading's standard uncertainty and multiplied by the root of its robust
//! weight; rejected readings are rows of zeros, so that rows and readings keep the same numbers. Where the noise hangs
//! together, each row is what is new in it beside the rows before ([`crate::correlation`]). Range partials in m per unit
//! before whitening.

use crate::correlation::Whitener;
use crate::design::{Estimate, Row, Setup, places};
use crate::error::IdentifyError;
use crate::identified::Identified;
use crate::normal::residuals;
use crate::range_correlation::RangeCorrelation;
use crate::term::{EffectTerm, Reads};
use abbe_geometry::effects::{CovariateProblem, Effect, Ray};
use abbe_geometry::model::MachineModel;
use abbe_geometry::{ErrorId, Vector3};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use faer::Mat;

/// Whitened rows of a settled fit.
#[derive(Debug, Clone)]
pub struct Rows<'a> {
    campaign: &'a Campaign,
    /// Readings × free parameters, whitened.
    pub jacobian: Mat<f64>,
    /// Residuals (measured minus predicted), whitened.
    pub residuals: Vec<f64>,
    /// (JᵀJ + prior)⁻¹ of the fit: the posterior covariance for unit noise.
    pub covariance: Mat<f64>,
    /// What each column is: its place among all parameters (geometry, effects, stations).
    pub parameters: Vec<usize>,
    /// 1/u times the root of the robust weight, of each reading (1/m).
    pub whitening: Vec<f64>,
    /// Residuals (measured minus predicted, m) of all readings.
    pub residuals_m: Vec<f64>,
    /// How the noise is correlated.
    pub correlation: Option<RangeCorrelation>,
    /// Takes out the correlation of the noise.
    whitener: Option<Whitener>,
    /// What rows are multiplied by before that (1/m).
    factors: Vec<f64>,
    /// Line of sight of each reading.
    pub rays: Vec<Ray>,
    /// Partials of the point by error of each reading.
    by_error: Vec<[Vector3<f64>; 18]>,
}

impl<'a> Rows<'a> {
    /// Rows of a fit of this campaign.
    pub fn new(fit: &Identified, instrument: RangeUncertainty, campaign: &'a Campaign) -> Rows<'a> {
        let model = &fit.model;
        let parts = model.parts();
        let terms: Vec<EffectTerm> = parts.effects.iter().map(EffectTerm::of).collect();
        let setup = Setup { machine: &parts.machine, layout: model.layout(), instrument, terms: &terms };
        let parameters = parameters_of(model);
        let estimate = Estimate::new(setup, campaign, &parameters);
        let free: Vec<usize> = (0..parameters.len()).filter(|k| model.covariance(*k, *k) > 0.0).collect();
        let scale = fit.evidence.chi2_per_dof.max(1.0);
        // That of the solve alone: what a fit takes of expansions and scales that nobody saw is no knowledge of these rows.
        let covariance = Mat::from_fn(free.len(), free.len(), |i, j| model.covariance(free[i], free[j]) / scale);
        let count = campaign.readings.len();
        let whitening: Vec<f64> = fit.u_m.iter().zip(&fit.weights).map(|(u_m, weight)| weight.sqrt() / u_m).collect();
        let whitener = fit.correlation.map(|correlation| correlation.whitener(campaign, &fit.weights));
        // The whitener knows the weights.
        let factors = match &whitener {
            Some(_) => fit.u_m.iter().map(|u_m| 1.0 / u_m).collect(),
            None => whitening.clone(),
        };
        let mut rows = Rows {
            campaign,
            jacobian: Mat::zeros(count, free.len()),
            residuals: vec![0.0; count],
            covariance,
            parameters: free,
            whitening,
            residuals_m: Vec::with_capacity(count),
            correlation: fit.correlation,
            whitener,
            factors,
            rays: Vec::with_capacity(count),
            by_error: Vec::with_capacity(count),
        };
        rows.fill(&estimate);
        rows
    }

    fn fill(&mut self, estimate: &Estimate) {
        let place = places(&self.parameters, estimate.parameters.len());
        let mut row = Row::new();
        for k in 0..self.campaign.readings.len() {
            let point = estimate.row(k, &mut row);
            let factor = self.factors[k];
            self.residuals[k] = row.residual_m * factor;
            self.residuals_m.push(row.residual_m);
            row.entries(&place).for_each(|(column, value)| self.jacobian[(k, column)] = value * factor);
            self.rays.push(row.ray);
            self.by_error.push(point.chain.by_error);
        }
        if let Some(whitener) = &self.whitener {
            whitener.apply(&mut self.residuals);
            (0..self.jacobian.ncols()).for_each(|j| whitener.apply(self.jacobian.col_as_slice_mut(j)));
        }
    }

    /// The same rows, where effects read what this campaign logged: the same readings with covariates of which none is read by an effect of
    /// the fit.
    pub fn logged_as<'b>(&self, campaign: &'b Campaign) -> Rows<'b>
    where
        'a: 'b,
    {
        Rows { campaign, ..self.clone() }
    }

    /// Whitens a column of range partials (m per unit), one a reading, in place.
    pub fn whiten(&self, column: &mut [f64]) {
        column.iter_mut().zip(&self.factors).for_each(|(value, factor)| *value *= factor);
        if let Some(whitener) = &self.whitener {
            whitener.apply(column);
        }
    }

    /// What range partials (m per unit) are multiplied by to give the product of their whitened column with these whitened
    /// residuals.
    pub fn weighted(&self, residuals: &[f64]) -> Vec<f64> {
        let mut weighted = residuals.to_vec();
        if let Some(whitener) = &self.whitener {
            whitener.apply_transposed(&mut weighted);
        }
        weighted.iter_mut().zip(&self.factors).for_each(|(value, factor)| *value *= factor);
        weighted
    }

    /// Number of readings.
    pub fn len(&self) -> usize {
        self.residuals.len()
    }

    /// Whether there is no reading.
    pub fn is_empty(&self) -> bool {
        self.residuals.is_empty()
    }

    /// Whitened columns of an effect, one a parameter.
    ///
    /// # Errors
    /// A covariate that some reading lacks.
    pub fn columns(&self, effect: &dyn Effect) -> Result<Mat<f64>, CovariateProblem> {
        let mut columns = self.partials(effect)?;
        (0..columns.ncols()).for_each(|j| self.whiten(columns.col_as_slice_mut(j)));
        Ok(columns)
    }

    /// Partial of the range of a reading by one of the machine's errors at it.
    pub(crate) fn along(&self, reading: usize, id: ErrorId) -> f64 {
        self.rays[reading].direction.dot(&self.by_error[reading][id.index()])
    }

    /// Partials of the ranges used by an effect's parameters (m per unit), one column a parameter.
    ///
    /// # Errors
    /// A covariate that some reading lacks.
    pub fn partials(&self, effect: &dyn Effect) -> Result<Mat<f64>, CovariateProblem> {
        let count = effect.parameters().len();
        let mut columns = Mat::zeros(self.len(), count);
        let (mut partials, reads) = (vec![0.0; count], Reads::new(self.campaign, effect));
        for k in (0..self.len()).filter(|k| self.whitening[*k] > 0.0) {
            partials.fill(0.0);
            reads.add_columns(k, (self.rays[k], &self.by_error[k]), &mut partials)?;
            partials.iter().enumerate().for_each(|(j, value)| columns[(k, j)] = *value);
        }
        Ok(columns)
    }
}

/// Geometry, effects, then x, y, z, dead path of each station.
pub(crate) fn parameters_of(model: &MachineModel) -> Vec<f64> {
    let parts = model.parts();
    let effects = parts.effects.iter().flat_map(|fitted| &fitted.parameters);
    let mut parameters: Vec<f64> = parts.coefficients.iter().chain(effects).copied().collect();
    for station in &parts.stations {
        parameters.extend(station.position_m.iter().chain([&station.dead_path_m]));
    }
    parameters
}

/// Residual (measured minus predicted, m) and declared standard uncertainty (m) of readings that a model was not
/// identified from; station names must be those of the model, in its order.
///
/// # Errors
/// [`IdentifyError::NoCovariate`] where a reading lacks what the model's effects need, [`IdentifyError::Dangling`] for
/// a station that the model does not know.
pub fn residuals_of(
    model: &MachineModel,
    instrument: RangeUncertainty,
    campaign: &Campaign,
) -> Result<Vec<(f64, f64)>, IdentifyError> {
    let parts = model.parts();
    let terms: Vec<EffectTerm> = parts.effects.iter().map(EffectTerm::of).collect();
    crate::term::check(&terms, campaign)?;
    crate::term::check_stations(model, campaign)?;
    let setup = Setup { machine: &parts.machine, layout: model.layout(), instrument, terms: &terms };
    Ok(residuals(&Estimate::new(setup, campaign, &parameters_of(model))))
}
