//! An identified machine: everything needed to correct a coordinate, and to say how well.
//!
//! Place in the flow: made by identification, stored by `nodes/files`, evaluated by [`crate::correct`]. SI;
//! error = actual − indicated.

use crate::axis::ErrorId;
use crate::between_nodes::BetweenNodes;
use crate::by_place::VarianceByPlace;
use crate::effects::{CovariateValue, Effect, Shape, State, construct};
use crate::layout::Layout;
use crate::machine::Machine;
use crate::seen::{self, Apart};
use crate::unseen_expansion::{self, UnseenExpansion, UnseenExpansions};
use crate::usual::Usual;
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::sync::Arc;

pub use crate::model_error::ModelError;
pub use crate::packed::packed;
pub use crate::seen::Difference;

/// Standard deviations of χ² per degree of freedom that count as chance where a misfit widens coordinates.
const CHANCE: f64 = 2.0;

/// An effect with its fitted parameters.
#[derive(Debug, Clone)]
pub struct FittedEffect {
    /// The effect.
    pub effect: Arc<dyn Effect>,
    /// Its shape.
    pub shape: Shape,
    /// Parameter values in the unit of their [`crate::effects::ParameterSpec`].
    pub parameters: Vec<f64>,
}

impl FittedEffect {
    /// Whether it corrects anything: one of no size stands in the uncertainty alone ([`crate::mixture::beside`]), and a sample that lacks
    /// what it reads is corrected as ever.
    pub fn corrects(&self) -> bool {
        self.parameters.iter().any(|value| *value != 0.0)
    }
}

/// A tracer station as identified.
#[derive(Debug, Clone, PartialEq)]
pub struct Station {
    /// Name as in the campaign.
    pub name: String,
    /// Centre of the tracer (m, machine frame).
    pub position_m: Vector3<f64>,
    /// Distance at length reading zero (m).
    pub dead_path_m: f64,
}

/// What the measured data covered.
#[derive(Debug, Clone, PartialEq)]
pub struct IdentifiedVolume {
    /// Smallest and largest reading of each axis (m).
    pub reading_m: [(f64, f64); 3],
    /// Smallest and largest offset in each direction (m, ram frame).
    pub offset_m: [(f64, f64); 3],
    /// Smallest and largest value of each covariate that was logged or that the effects read, in the unit of its name.
    pub covariates: BTreeMap<String, (f64, f64)>,
    /// How far temperatures that effects read stood from others.
    pub differences: Vec<Difference>,
}

/// How well the model fits what it was identified from.
#[derive(Debug, Clone, PartialEq)]
pub struct FitQuality {
    /// Readings used.
    pub readings: usize,
    /// Readings rejected as outliers.
    pub rejected: usize,
    /// χ² per degree of freedom with the declared uncertainties.
    pub chi2_per_dof: f64,
    /// Unweighted rms of the range residuals (m).
    pub residual_rms_m: f64,
    /// What neither model nor declared noise explains: standard deviation along X, Y and Z (m). A cause that nobody has found
    /// acts on corrected points as it acts on readings, so each of them carries it.
    pub unexplained_m: [f64; 3],
    /// What the machine does beside that in a course that nobody can name, by place.
    pub wanders: Option<VarianceByPlace>,
    /// Expansions of the scales that the data cannot rule out.
    pub unseen_expansions: UnseenExpansions,
}

impl FitQuality {
    /// What neither model nor declared noise explains of a reading (m), of residuals with this sum of squares (m²): the share of
    /// their variance that exceeds what was declared, and what chance adds to that in all but two campaigns of a hundred.
    pub fn unexplained_of(chi2_per_dof: f64, square_m2: f64, degrees_of_freedom: f64) -> f64 {
        let degrees = degrees_of_freedom.max(1.0);
        let excess = (chi2_per_dof - 1.0 - CHANCE * (2.0 / degrees).sqrt()).max(0.0);
        (excess / chi2_per_dof.max(1.0) * square_m2 / degrees).sqrt()
    }
}

/// Parts of a model, as identification makes them and a file holds them.
#[derive(Debug, Clone)]
pub struct ModelParts {
    /// The machine.
    pub machine: Machine,
    /// Geometric parameters in [`Layout`] order.
    pub coefficients: Vec<f64>,
    /// Offset about which the turn of the ram acts (m, ram frame): the mean of those measured.
    pub offset_centre_m: [f64; 3],
    /// Effects beyond geometry.
    pub effects: Vec<FittedEffect>,
    /// Stations of the campaign.
    pub stations: Vec<Station>,
    /// Covariance of geometric parameters, effect parameters and stations (x, y, z, dead path each), packed lower
    /// triangle row by row, SI. Already scaled by what the fit found of the noise.
    pub covariance: Vec<f64>,
    /// What straight lines between nodes add to it: they do not hold the machine's functions, and what they miss at
    /// readings between nodes moves the fitted parameters. Packed alike; empty where there is nothing to add.
    pub chord_covariance: Vec<f64>,
    /// What the data covered.
    pub identified: IdentifiedVolume,
    /// How well it fits.
    pub quality: FitQuality,
}

/// A linear combination of what a model does not know for certain, as index and factor; an index may come more than once.
#[derive(Debug, Clone, Default)]
pub(crate) struct Combination {
    /// Of the whole vector of parameters (geometry, effects, stations).
    pub(crate) parameters: Vec<(usize, f64)>,
    /// Of the departures between nodes.
    pub(crate) between_nodes: Vec<(usize, f64)>,
}

impl Combination {
    /// This less another.
    pub(crate) fn minus(mut self, other: Combination) -> Combination {
        self.parameters.extend(other.parameters.into_iter().map(|(index, factor)| (index, -factor)));
        self.between_nodes.extend(other.between_nodes.into_iter().map(|(index, factor)| (index, -factor)));
        self
    }
}

/// An identified machine, checked and ready to correct.
#[derive(Debug, Clone)]
pub struct MachineModel {
    parts: ModelParts,
    layout: Layout,
    machine_parameters: usize,
    /// Full square of the machine's block of the whole covariance, row-major: correction reads rows of it.
    covariance: Vec<f64>,
    between_nodes: BetweenNodes,
    /// Covariates of each effect: those that it reads for the tip, and those for the range alone.
    usual: Vec<[Vec<Usual>; 2]>,
    /// Covariates that were logged and that no effect reads.
    unread: Vec<Usual>,
    /// Of each effect, how the temperatures that it reads for the tip stood to others.
    apart: Vec<Vec<Apart>>,
    /// Expansions that the data cannot rule out, with the ranges of their sensors.
    unseen_expansions: Vec<unseen_expansion::Ranged>,
}

impl MachineModel {
    /// Checks that the parts fit together.
    pub fn new(parts: ModelParts) -> Result<MachineModel, ModelError> {
        let layout = Layout::new(&parts.machine, parts.offset_centre_m)?;
        let effect_parameters: usize = parts.effects.iter().map(|e| e.effect.parameters().len()).sum();
        let machine_parameters = layout.len() + effect_parameters;
        let total = machine_parameters + 4 * parts.stations.len();
        check("coefficients", &parts.coefficients, layout.len())?;
        check("offset centre", &parts.offset_centre_m, 3)?;
        check("covariance", &parts.covariance, total * (total + 1) / 2)?;
        if !parts.chord_covariance.is_empty() {
            check("covariance of chords", &parts.chord_covariance, total * (total + 1) / 2)?;
        }
        for fitted in &parts.effects {
            check("effect parameters", &fitted.parameters, fitted.effect.parameters().len())?;
        }
        if let Some(wanders) = &parts.quality.wanders {
            wanders.check()?;
        }
        parts.quality.unseen_expansions.by_sensor.iter().try_for_each(UnseenExpansion::check)?;
        for absorbed in &parts.quality.unseen_expansions.absorbed {
            check("expansions absorbed", absorbed, total)?;
        }
        let ordered = |(_, (low, high)): &(&String, &(f64, f64))| low.is_finite() && high.is_finite() && low <= high;
        if let Some((name, (low, high))) = parts.identified.covariates.iter().find(|range| !ordered(range)) {
            return Err(ModelError::Covariate { name: name.clone(), low: *low, high: *high });
        }
        let variances = (0..total).map(|k| (k + 1, whole_covariance(&parts, k, k)));
        if let Some((parameter, variance)) = variances.into_iter().find(|(_, variance)| *variance < 0.0) {
            return Err(ModelError::Variance { parameter, variance });
        }
        let mut covariance = vec![0.0; machine_parameters * machine_parameters];
        for row in 0..machine_parameters {
            for column in 0..=row {
                let value = whole_covariance(&parts, row, column);
                covariance[row * machine_parameters + column] = value;
                covariance[column * machine_parameters + row] = value;
            }
        }
        let between_nodes = BetweenNodes::new(&layout, &parts.coefficients, |a, b| parts.covariance[packed(a, b)]);
        let usual = parts.effects.iter().map(|fitted| usual(fitted, &parts.identified)).collect();
        let unread = unread(&parts);
        let apart = parts.effects.iter().map(|fitted| apart(fitted, &parts.identified)).collect();
        let with_range =
            |unseen: &UnseenExpansion| (unseen.clone(), parts.identified.covariates.get(&unseen.sensor).copied());
        let unseen_expansions = parts.quality.unseen_expansions.by_sensor.iter().map(with_range).collect();
        Ok(MachineModel {
            parts,
            layout,
            machine_parameters,
            covariance,
            between_nodes,
            usual,
            unread,
            apart,
            unseen_expansions,
        })
    }

    /// An effect by name and shape, for readers of model files.
    pub fn fitted_effect(
        name: &str,
        shape: Shape,
        machine: &Machine,
        parameters: Vec<f64>,
    ) -> Result<FittedEffect, ModelError> {
        Ok(FittedEffect { effect: construct(name, &shape, machine)?.into(), shape, parameters })
    }

    /// The same without some effects, whatever their parameters are; everything else keeps its covariance.
    ///
    /// # Errors
    /// None of a sound model.
    pub fn without(&self, is_out: impl Fn(&FittedEffect) -> bool) -> Result<MachineModel, ModelError> {
        let mut kept: Vec<usize> = (0..self.layout.len()).collect();
        let mut first = kept.len();
        for fitted in &self.parts.effects {
            if !is_out(fitted) {
                kept.extend(first..first + fitted.parameters.len());
            }
            first += fitted.parameters.len();
        }
        kept.extend(first..first + 4 * self.parts.stations.len());
        let of_kept = |all: &[f64]| -> Vec<f64> {
            let rows = kept.iter().enumerate();
            rows.flat_map(|(row, a)| kept[..=row].iter().map(|b| packed(*a, *b))).map(|place| all[place]).collect()
        };
        let mut parts = self.parts.clone();
        parts.effects.retain(|fitted| !is_out(fitted));
        parts.covariance = of_kept(&self.parts.covariance);
        if !parts.chord_covariance.is_empty() {
            parts.chord_covariance = of_kept(&self.parts.chord_covariance);
        }
        for absorbed in &mut parts.quality.unseen_expansions.absorbed {
            *absorbed = kept.iter().map(|place| absorbed[*place]).collect();
        }
        MachineModel::new(parts)
    }

    /// The same with these expansions of scales that its data cannot rule out.
    ///
    /// # Errors
    /// [`ModelError::UnseenExpansion`] where one is none, [`ModelError::Length`] where they belong to another model.
    pub fn with_unseen_expansions(&self, unseen_expansions: UnseenExpansions) -> Result<MachineModel, ModelError> {
        let quality = FitQuality { unseen_expansions, ..self.parts.quality.clone() };
        MachineModel::new(ModelParts { quality, ..self.parts.clone() })
    }

    /// The same with so much along X, Y and Z that neither it nor the declared noise explains (m).
    ///
    /// # Errors
    /// None of a sound model.
    pub fn with_unexplained(&self, unexplained_m: [f64; 3]) -> Result<MachineModel, ModelError> {
        let quality = FitQuality { unexplained_m, ..self.parts.quality.clone() };
        MachineModel::new(ModelParts { quality, ..self.parts.clone() })
    }

    /// The parts, as stored.
    pub fn parts(&self) -> &ModelParts {
        &self.parts
    }

    /// Positions of the geometric parameters.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Variance along X, Y and Z of what neither the model nor the declared noise explains (m²), for a sample with its covariates: as
    /// it was in the campaign, and more where one of them lies beyond its range.
    pub(crate) fn unexplained_m2(&self, state: &State) -> Vector3<f64> {
        let anywhere = Vector3::from(self.parts.quality.unexplained_m).map(|u_m| u_m * u_m);
        let in_campaign = match &self.parts.quality.wanders {
            Some(wanders) => anywhere + Vector3::from(wanders.at_m2(state.reading_m)),
            None => anywhere,
        };
        if in_campaign == Vector3::zeros() {
            return in_campaign;
        }
        let growth = |(name, range): (&String, &(f64, f64))| match state.covariates.covariate(name) {
            CovariateValue::Fresh(value) => seen::growth(name, *range, value),
            _ => 1.0,
        };
        in_campaign * self.parts.identified.covariates.iter().map(growth).fold(1.0, f64::max).powi(2)
    }

    /// Whether the covariance of a sample depends on its covariates, whatever effects the model has.
    pub fn is_widened_by_covariates(&self) -> bool {
        let quality = &self.parts.quality;
        let is_unexplained = quality.wanders.is_some() || quality.unexplained_m != [0.0; 3];
        !self.unseen_expansions.is_empty() || is_unexplained && !self.parts.identified.covariates.is_empty()
    }

    /// The same of expansions and turns that the data cannot rule out, for a sample with its temperatures (m²).
    pub(crate) fn unseen_m2(&self, state: &State) -> Vector3<f64> {
        match self.unseen_expansions.is_empty() {
            true => Vector3::zeros(),
            false => {
                let squareness = &self.parts.machine.squareness;
                unseen_expansion::variance_m2(&self.unseen_expansions, squareness, self.middle_m(), state)
            }
        }
    }

    /// What expansions that the data cannot rule out do to a metre of X, Y and Z at the coldest or warmest that was logged (m/m, k = 1).
    pub fn unseen_expansion_at_the_ends(&self) -> [f64; 3] {
        unseen_expansion::at_the_ends(&self.unseen_expansions)
    }

    /// What turns that the data cannot rule out do there to each squareness error, in the order of [`Machine::squareness`] (rad, k = 1).
    pub fn unseen_turn_at_the_ends(&self) -> [f64; 3] {
        unseen_expansion::turned_at_the_ends(&self.unseen_expansions)
    }

    /// Readings in the middle of those identified (m).
    pub fn middle_m(&self) -> [f64; 3] {
        self.parts.identified.reading_m.map(|(low, high)| 0.5 * (low + high))
    }

    /// Number of geometric and effect parameters.
    pub fn machine_parameters(&self) -> usize {
        self.machine_parameters
    }

    /// Covariance between two parameters of the whole vector (geometry, effects, stations), as the fit has it: without
    /// what straight lines between nodes do to them.
    pub fn covariance(&self, a: usize, b: usize) -> f64 {
        self.parts.covariance[packed(a, b)]
    }

    /// What straight lines between nodes miss.
    pub(crate) fn between_nodes(&self) -> &BetweenNodes {
        &self.between_nodes
    }

    /// Covariates that an effect reads for the tip, with the ranges in which it was identified.
    pub(crate) fn usual_on_tip(&self, effect: usize) -> &[Usual] {
        &self.usual[effect][0]
    }

    /// Covariates that an effect reads for the range alone, likewise.
    pub(crate) fn usual_on_range(&self, effect: usize) -> &[Usual] {
        &self.usual[effect][1]
    }

    /// Variance of a linear combination of parameters and of departures between nodes.
    pub(crate) fn variance(&self, combination: &Combination) -> f64 {
        let Combination { parameters, between_nodes } = combination;
        let row = |(a, x): &(usize, f64)| {
            parameters.iter().map(|(b, y)| x * y * whole_covariance(&self.parts, *a, *b)).sum::<f64>()
        };
        let mut departures: BTreeMap<usize, f64> = BTreeMap::new();
        between_nodes.iter().for_each(|(index, factor)| *departures.entry(*index).or_default() += factor);
        let missed = departures.iter().map(|(index, factor)| factor * factor * self.between_nodes.variance(*index));
        parameters.iter().map(row).sum::<f64>() + missed.sum::<f64>()
    }

    /// The part of that variance by what the fit takes of expansions that it could not show.
    pub(crate) fn absorbed_m2(&self, combination: &Combination) -> f64 {
        let of = |absorbed: &Vec<f64>| {
            combination.parameters.iter().map(|(index, factor)| factor * absorbed[*index]).sum::<f64>()
        };
        self.parts.quality.unseen_expansions.absorbed.iter().map(|absorbed| of(absorbed).powi(2)).sum()
    }

    /// Row of the covariance of the machine parameters.
    pub(crate) fn machine_covariance_row(&self, row: usize) -> &[f64] {
        &self.covariance[row * self.machine_parameters..(row + 1) * self.machine_parameters]
    }

    /// Value of one error (m or rad) and its standard uncertainty at an axis position.
    pub fn error(&self, id: ErrorId, position_m: f64) -> (f64, f64) {
        let Some(basis) = self.layout.basis(id) else { return (0.0, 0.0) };
        let local = basis.at(position_m);
        let first = self.layout.range(id).start + local.first;
        let mut variance = 0.0;
        for (i, a) in local.values().iter().enumerate() {
            for (j, b) in local.values().iter().enumerate() {
                variance += a * b * whole_covariance(&self.parts, first + i, first + j);
            }
        }
        if let Some((index, shape)) = self.between_nodes.at(id, position_m) {
            variance += shape * shape * self.between_nodes.variance(index);
        }
        (local.dot(&self.parts.coefficients[self.layout.range(id)]), variance.max(0.0).sqrt())
    }

    /// Covariates that its effects read, for the tip or for the range.
    pub fn reads(&self) -> Vec<String> {
        self.parts.effects.iter().flat_map(|fitted| fitted.effect.reads()).collect()
    }

    /// How the temperatures that an effect reads for the tip stood to others.
    pub(crate) fn apart(&self, effect: usize) -> &[Apart] {
        &self.apart[effect]
    }

    /// Temperatures that an effect reads for the tip, each with one that it stands further from than the campaign saw, and by chance.
    pub fn parted<'a>(&'a self, state: &State) -> Vec<(&'a str, &'a str)> {
        let all = self.apart.iter().flatten();
        let beyond = all.filter(|apart| apart.beyond(state).is_some_and(|(_, is_beyond)| is_beyond));
        beyond.map(Apart::names).collect()
    }

    /// Covariates that no effect reads, with the ranges in which the campaign speaks for them.
    pub(crate) fn unread(&self) -> &[Usual] {
        &self.unread
    }

    /// Range of a covariate outside which a sample is extrapolated, in the unit of its name; `None` where none is known.
    pub fn covariate_range(&self, name: &str) -> Option<(f64, f64)> {
        let unread = self.unread.iter().find(|covariate| covariate.name == name);
        unread.map_or_else(|| self.parts.identified.covariates.get(name).copied(), |covariate| covariate.range)
    }

    /// Value and standard uncertainty (rad) of a squareness, in the order of [`Machine::squareness`].
    pub fn squareness(&self, k: usize) -> (f64, f64) {
        self.angle(self.layout.squareness().start + k)
    }

    /// Value and standard uncertainty (rad) of the turn of the ram about X, Y and Z.
    pub fn ram_turn(&self) -> [(f64, f64); 3] {
        let first = self.layout.ram_turn().start;
        std::array::from_fn(|d| self.angle(first + d))
    }

    fn angle(&self, index: usize) -> (f64, f64) {
        (self.parts.coefficients[index], whole_covariance(&self.parts, index, index).max(0.0).sqrt())
    }

    /// Index of a station's first parameter in the covariance, and the station.
    pub fn station(&self, name: &str) -> Option<(usize, &Station)> {
        let k = self.parts.stations.iter().position(|s| s.name == name)?;
        Some((self.machine_parameters + 4 * k, &self.parts.stations[k]))
    }
}

fn usual(fitted: &FittedEffect, identified: &IdentifiedVolume) -> [Vec<Usual>; 2] {
    let with_range = |name: String| Usual { range: identified.covariates.get(&name).copied(), name };
    [fitted.effect.covariates(), fitted.effect.range_covariates()]
        .map(|names| names.into_iter().map(with_range).collect())
}

/// Covariates that were logged and that no effect reads. What such a quantity does was too little to be seen over its range, and so it is
/// a little beyond.
fn unread(parts: &ModelParts) -> Vec<Usual> {
    let read: Vec<String> = parts.effects.iter().flat_map(|fitted| fitted.effect.reads()).collect();
    let own = parts.identified.covariates.iter().filter(|(name, _)| !read.contains(name));
    let wider = |(name, (low, high)): (&String, &(f64, f64))| {
        let beyond = seen::as_seen_beyond(name, (*low, *high))?;
        Some(Usual { name: name.clone(), range: Some((low - beyond, high + beyond)) })
    };
    own.filter_map(wider).collect()
}

fn apart(fitted: &FittedEffect, identified: &IdentifiedVolume) -> Vec<Apart> {
    let read = fitted.effect.covariates();
    let own = identified.differences.iter().filter(|difference| read.contains(&difference.name));
    own.map(|difference| Apart::new(difference, &identified.covariates)).collect()
}

/// Covariance of two parameters with what straight lines between nodes and expansions that nobody saw add.
fn whole_covariance(parts: &ModelParts, a: usize, b: usize) -> f64 {
    let place = packed(a, b);
    let expansions = parts.quality.unseen_expansions.absorbed.iter().map(|absorbed| absorbed[a] * absorbed[b]);
    parts.covariance[place] + parts.chord_covariance.get(place).copied().unwrap_or(0.0) + expansions.sum::<f64>()
}

fn check(what: &'static str, values: &[f64], expected: usize) -> Result<(), ModelError> {
    if values.len() != expected {
        return Err(ModelError::Length { what, found: values.len(), expected });
    }
    if values.iter().any(|v| !v.is_finite()) {
        return Err(ModelError::NotFinite { what });
    }
    Ok(())
}
