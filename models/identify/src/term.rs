//! Effects to be fitted beside the geometry, and the covariates of a campaign's readings.
//!
//! Place in the flow: diagnosis hands [`EffectTerm`]s to [`crate::identify_with`]; the model that comes out holds them
//! with their parameters. Covariates in the unit of their names.

use crate::error::IdentifyError;
use abbe_geometry::Vector3;
use abbe_geometry::effects::Ray;
use abbe_geometry::effects::{
    CovariateProblem, CovariateSource, CovariateValue, Effect, EffectError, Shape, Sight, State, TIME,
    add_range_columns, construct,
};
use abbe_geometry::machine::Machine;
use abbe_geometry::model::{FittedEffect, MachineModel};
use abbe_measurement::campaign::{Campaign, Covariate};
use std::sync::Arc;

/// Least share of its plausible size that a term is believed to have: enough to be found.
const LEAST_BELIEVED: f64 = 1e-3;

/// An effect whose parameters are to be fitted.
#[derive(Debug, Clone)]
pub struct EffectTerm {
    /// The effect.
    pub effect: Arc<dyn Effect>,
    /// Its shape.
    pub shape: Shape,
    /// Number of its parameters.
    count: usize,
    /// Standard deviation of the prior of each parameter as a share of its plausible size.
    believed: f64,
}

impl EffectTerm {
    /// A registered effect with that shape.
    ///
    /// # Errors
    /// An unknown name, or a shape that does not fit it.
    pub fn new(name: &str, shape: Shape, machine: &Machine) -> Result<EffectTerm, EffectError> {
        let effect: Arc<dyn Effect> = construct(name, &shape, machine)?.into();
        Ok(EffectTerm { count: effect.parameters().len(), effect, shape, believed: 1.0 })
    }

    /// The term of a fitted effect.
    pub fn of(fitted: &FittedEffect) -> EffectTerm {
        let count = fitted.parameters.len();
        EffectTerm { effect: Arc::clone(&fitted.effect), shape: fitted.shape.clone(), count, believed: 1.0 }
    }

    /// The same, believed to be at most about this share of its plausible size: for directions of its parameters that the
    /// data do not tell, which otherwise could be anything plausible and take what belongs to the machine.
    pub fn believed(mut self, share: f64) -> EffectTerm {
        self.believed = share.clamp(LEAST_BELIEVED, 1.0);
        self
    }

    /// Standard deviation of the prior about zero of each parameter, in its unit.
    pub fn priors(&self) -> impl Iterator<Item = f64> + '_ {
        self.effect.parameters().into_iter().map(|spec| self.believed * spec.plausible)
    }

    /// Number of its parameters.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether it has no parameter.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Covariates of one reading of a campaign, its time among them.
#[derive(Debug, Clone, Copy)]
pub struct CampaignRow<'a> {
    /// The campaign.
    pub campaign: &'a Campaign,
    /// Index of the reading.
    pub reading: usize,
}

impl CovariateSource for CampaignRow<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        if name == TIME {
            return CovariateValue::Fresh(self.campaign.readings[self.reading].time_s);
        }
        self.campaign.covariate(name).map_or(CovariateValue::Missing, |column| logged(column, self.reading))
    }
}

fn logged(column: &Covariate, reading: usize) -> CovariateValue {
    column.values.get(reading).copied().flatten().map_or(CovariateValue::Missing, CovariateValue::Fresh)
}

impl CampaignRow<'_> {
    /// Adds the partials of the length read by an effect's parameters (m per unit) to `columns`, one a parameter, given
    /// the line of sight and the chain's partials by error.
    ///
    /// # Errors
    /// A covariate that this reading lacks.
    pub fn add_columns(
        &self,
        effect: &dyn Effect,
        ray: Ray,
        by_error: &[Vector3<f64>; 18],
        columns: &mut [f64],
    ) -> Result<(), CovariateProblem> {
        self.add_columns_by(self, effect, (ray, by_error), columns)
    }

    /// The same by covariates that were looked up before.
    fn add_columns_by(
        &self,
        covariates: &dyn CovariateSource,
        effect: &dyn Effect,
        (ray, by_error): (Ray, &[Vector3<f64>; 18]),
        columns: &mut [f64],
    ) -> Result<(), CovariateProblem> {
        let reading = &self.campaign.readings[self.reading];
        let state = State { reading_m: reading.reading_m, offset_m: reading.offset_m, covariates };
        let station = &self.campaign.stations[reading.station as usize];
        let line = &self.campaign.lines[reading.line as usize];
        add_range_columns(effect, &state, &Sight { station, line, ray }, by_error, columns)
    }
}

/// An effect beside the covariates that it reads: a diagnosis holds hundreds, and a look among them for each reading takes longer than what
/// the effect computes.
pub(crate) struct Reads<'a> {
    campaign: &'a Campaign,
    effect: &'a dyn Effect,
    columns: Vec<&'a Covariate>,
}

impl<'a> Reads<'a> {
    pub(crate) fn new(campaign: &'a Campaign, effect: &'a dyn Effect) -> Reads<'a> {
        let reads = effect.reads();
        let columns = reads.iter().filter(|name| *name != TIME).filter_map(|name| campaign.covariate(name)).collect();
        Reads { campaign, effect, columns }
    }

    /// [`CampaignRow::add_columns`] at a reading.
    pub(crate) fn add_columns(
        &self,
        reading: usize,
        at: (Ray, &[Vector3<f64>; 18]),
        columns: &mut [f64],
    ) -> Result<(), CovariateProblem> {
        let row = CampaignRow { campaign: self.campaign, reading };
        row.add_columns_by(&ReadRow { row, columns: &self.columns }, self.effect, at, columns)
    }
}

/// The covariates of one reading, those first that are asked for.
struct ReadRow<'a> {
    row: CampaignRow<'a>,
    columns: &'a [&'a Covariate],
}

impl CovariateSource for ReadRow<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        match self.columns.iter().find(|column| column.name == name) {
            Some(column) => logged(column, self.row.reading),
            None => self.row.covariate(name),
        }
    }
}

/// Refuses a campaign whose stations are not those of the model, in its order.
pub(crate) fn check_stations(model: &MachineModel, campaign: &Campaign) -> Result<(), IdentifyError> {
    let stations = &model.parts().stations;
    let known = |k: u32| stations.get(k as usize).map(|s| &s.name) == campaign.stations.get(k as usize);
    match campaign.readings.iter().position(|r| !known(r.station)) {
        None => Ok(()),
        Some(reading) => {
            let index = campaign.readings[reading].station;
            Err(IdentifyError::Dangling { reading: reading + 1, what: "station", index })
        }
    }
}

/// Refuses terms whose covariates some reading lacks.
pub(crate) fn check(terms: &[EffectTerm], campaign: &Campaign) -> Result<(), IdentifyError> {
    for term in terms {
        for name in term.effect.reads() {
            for reading in 0..campaign.readings.len() {
                let row = CampaignRow { campaign, reading };
                match row.covariate(&name) {
                    CovariateValue::Fresh(value) if value.is_finite() => {}
                    _ => {
                        let (effect, covariate) = (term.effect.name(), name);
                        return Err(IdentifyError::NoCovariate { effect, covariate, reading: reading + 1 });
                    }
                }
            }
        }
    }
    Ok(())
}
