//! A model beside a campaign as linear rows: residuals, partials of the lengths and of the points.
//!
//! Place in the flow: residual fields are estimated here beside the model's own parameters. Unlike [`crate::Rows`] it
//! needs no fit, only a model, from a file or elsewhere; rows are not whitened. Residual = measured − predicted length
//! (m); station names must be those of the model, in its order.

use crate::design::{Estimate, Row, Setup, places};
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
        let estimate = Estimate::new(setup, campaign, &values);
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
        let place = places(&self.parameters, estimate.parameters.len());
        let mut row = Row::new();
        for k in 0..self.campaign.readings.len() {
            estimate.row(k, &mut row);
            row.entries(&place).for_each(|(column, value)| self.jacobian[(k, column)] = value);
            self.rays.push(row.ray);
        }
    }

    /// Partials of the corrected point of a reading by the free parameters (3 × parameters, m per unit): chain, squareness
    /// and effects; stations move no point.
    pub fn tip(&self, reading: usize) -> Mat<f64> {
        let parts = self.model.parts();
        let layout = self.model.layout();
        let total = self.model.machine_parameters() + 4 * parts.stations.len();
        let place = places(&self.parameters, total);
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
        layout.ram_turn().zip(&point.by_ram_turn).for_each(|(k, column)| put(k, *column));
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

#[cfg(test)]
#[path = "../../geometry/src/logged.rs"]
mod logged;

#[cfg(test)]
mod tests {
    use super::logged::LOGGED;
    use super::*;
    use abbe_geometry::correct::correct;
    use abbe_geometry::effects::{Known, Observed, REGISTRY, Shape};
    use abbe_geometry::error_function::FunctionKind;
    use abbe_geometry::layout::Layout;
    use abbe_geometry::machine::{Joint, Machine, Side, Squareness};
    use abbe_geometry::model::{FitQuality, IdentifiedVolume, ModelParts, Station};
    use abbe_geometry::predict::{Sighted, predicted_length};
    use abbe_geometry::rotation::RotationForm;
    use abbe_geometry::{Axis, Matrix3};
    use abbe_measurement::campaign::{Covariate, RangeReading};

    /// Range of every covariate, which holds all values below.
    const USUAL: (f64, f64) = (-2000.0, 8000.0);
    const STATIONS: [[f64; 4]; 2] = [[-0.4, 1.1, 0.2, 0.31], [1.2, -0.3, -0.1, 0.17]];
    const OFFSETS_M: [[f64; 3]; 2] = [[0.0, 0.0, -0.06], [0.1, -0.02, -0.06]];
    const CENTRE_M: [f64; 3] = [0.02, 0.03, -0.04];
    const INSTRUMENT: RangeUncertainty = RangeUncertainty { constant_m: 1e-7, per_metre: 1e-7, common_per_metre: 0.0 };

    fn machine() -> Machine {
        let tilt = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
        let kinds = [
            FunctionKind::Polynomial { degree: 3 },
            FunctionKind::Nodes { count: 4 },
            FunctionKind::BSpline { intervals: 3 },
        ];
        Machine {
            name: "bridge".to_owned(),
            frame_id: "machine".to_owned(),
            joints: [(Axis::Y, Side::Workpiece), (Axis::X, Side::Tool), (Axis::Z, Side::Tool)]
                .map(|(axis, side)| Joint { axis, side }),
            stroke_m: [(0.0, 0.8), (0.0, 0.6), (0.0, 0.6)],
            squareness: [tilt("C0Y", Axis::Y, Axis::Z), tilt("B0Z", Axis::Z, Axis::Y), tilt("A0Z", Axis::Z, Axis::X)],
            rotation: RotationForm::Exact,
            kinds: std::array::from_fn(|k| Some(kinds[k % 3])),
            repeatability_m: [0.2e-6, 0.3e-6, 0.4e-6],
            u_ram_turn_rad: [abbe_geometry::machine::USUAL_RAM_TURN_RAD; 3],
            default_offset_m: None,
        }
    }

    fn names(names: &[&str]) -> Vec<String> {
        names.iter().map(|name| (*name).to_owned()).collect()
    }

    /// Shapes that the effect proposes where everything is logged, or those that only a search finds.
    fn shapes(entry: &Known, machine: &Machine) -> Vec<Shape> {
        let (varying, stations) = (names(&LOGGED), names(&["S1", "S2"]));
        let observed =
            Observed { machine, varying: &varying, stations: &stations, offsets_m: &OFFSETS_M, time_s: (0.0, 7200.0) };
        let proposed = (entry.propose)(&observed);
        if !proposed.is_empty() {
            return proposed;
        }
        let smooth = |acts: &str| {
            let shape = Shape::new().text("acts", acts).number("degree", 3.0);
            shape.text("p", "temp_air_c").number("p_low", 0.0).number("p_high", 90.0)
        };
        let found = [
            Shape::new().text("axis", "x").number("period_m", 0.02),
            Shape::new().text("line", "L3"),
            smooth("z"),
            smooth("EBX"),
            smooth("range").text("q", "x_m").number("q_low", 0.0).number("q_high", 0.8),
            smooth("range").number("cycles", 2.0),
            Shape::new().text("axis", "x").numbers("places_m", &[0.0, 0.3, 0.7]).text("sign", "dir_x"),
            Shape::new().text("axis", "x").text("side", "dir_x_over_12000um"),
            Shape::new().text("station", "S1").number("after_s", 600.0),
            // Between two of the readings: where the place is open, U holds the step as well, which no row does.
            Shape::new().text("axis", "x").number("from_m", 0.3).number("to_m", 0.301),
        ];
        let mut found = found.to_vec();
        found[5].0.remove("degree");
        found.retain(|shape| (entry.construct)(shape, machine).is_ok());
        assert!(!found.is_empty(), "{}: no shape to test", entry.name);
        found
    }

    fn campaign() -> Campaign {
        let reading = |k: u32| {
            let at = |stroke: f64, phase: f64| stroke * (0.5 + 0.49 * (1.9 * f64::from(k) + phase).sin());
            RangeReading {
                station: k % 2,
                line: k % 4,
                time_s: 700.0 * f64::from(k),
                reading_m: [at(0.8, 0.1), at(0.6, 1.3), at(0.6, 2.2)],
                offset_m: OFFSETS_M[k as usize / 2 % 2],
                length_m: 0.1 * f64::from(k),
            }
        };
        let logged = |(j, name): (usize, &&str)| Covariate {
            name: (*name).to_owned(),
            values: (0..8).map(|k| Some(20.0 + 30.0 * ((k + 1) as f64 * (j + 1) as f64 * 0.7).sin())).collect(),
        };
        Campaign {
            stations: names(&["S1", "S2"]),
            lines: names(&["L1", "L2", "L3", "L4"]),
            readings: (0..8).map(reading).collect(),
            covariates: LOGGED[1..].iter().enumerate().map(logged).collect(),
        }
    }

    /// A model with these effects, in which everything correlates with everything.
    fn model(effects: &[(&str, Shape)]) -> MachineModel {
        let machine = machine();
        let geometric = Layout::new(&machine, CENTRE_M).unwrap().len();
        let mut deviations = vec![1e-7; geometric];
        let mut fitted = Vec::new();
        for (name, shape) in effects {
            let specs = EffectTerm::new(name, shape.clone(), &machine).unwrap().effect.parameters();
            let values = specs.iter().enumerate().map(|(k, spec)| 1e-2 * spec.plausible * (k as f64 + 1.0).sin());
            fitted.push(MachineModel::fitted_effect(name, shape.clone(), &machine, values.collect()).unwrap());
            deviations.extend(specs.iter().map(|spec| 1e-3 * spec.plausible));
        }
        deviations.extend([2e-7; 8]);
        let entry = |(a, b): (usize, usize)| 0.9_f64.powi((a - b) as i32) * deviations[a] * deviations[b];
        let station = |(name, [x, y, z, dead_path_m]): (String, [f64; 4])| Station {
            name,
            position_m: Vector3::new(x, y, z),
            dead_path_m,
        };
        let parts = ModelParts {
            coefficients: (0..geometric).map(|k| 3e-6 * (1.7 * k as f64).sin()).collect(),
            offset_centre_m: CENTRE_M,
            effects: fitted,
            stations: names(&["S1", "S2"]).into_iter().zip(STATIONS).map(station).collect(),
            covariance: (0..deviations.len()).flat_map(|a| (0..=a).map(move |b| (a, b))).map(entry).collect(),
            chord_covariance: Vec::new(),
            identified: IdentifiedVolume {
                reading_m: machine.stroke_m,
                offset_m: [(-0.15, 0.15); 3],
                covariates: LOGGED.iter().map(|name| ((*name).to_owned(), USUAL)).collect(),
                differences: Vec::new(),
            },
            quality: FitQuality {
                readings: 100,
                rejected: 0,
                chi2_per_dof: 1.0,
                residual_rms_m: 1e-7,
                unexplained_m: [0.0; 3],
                wanders: None,
                unseen_expansions: Default::default(),
            },
            machine,
        };
        MachineModel::new(parts).unwrap()
    }

    fn agree(model: &MachineModel, what: &str) {
        let campaign = crate::with_lagged(campaign(), &model.reads());
        let rows = ModelRows::new(model, INSTRUMENT, &campaign).unwrap();
        for (k, reading) in campaign.readings.iter().enumerate() {
            let covariates = crate::term::CampaignRow { campaign: &campaign, reading: k };
            let state = State { reading_m: reading.reading_m, offset_m: reading.offset_m, covariates: &covariates };
            // An effect that runs away in this model of exaggerated sizes is not corrected, but its range is predicted.
            let sound = correct(model, &state).covariance_m2;
            let sighted = Sighted {
                station: &campaign.stations[reading.station as usize],
                line: &campaign.lines[reading.line as usize],
                residual_m: Vector3::zeros(),
                covariance_m2: sound.unwrap_or_else(Matrix3::zeros),
            };
            let predicted = predicted_length(model, &state, &sighted).unwrap();
            let expected_m = reading.length_m - rows.residuals_m[k];
            // Rounding of a metre.
            assert!((predicted.length_m - expected_m).abs() < 1e-15, "{what} {k}: {} {expected_m}", predicted.length_m);
            let count = rows.parameters.len();
            let row = |i: usize| (0..count).map(|j| rows.covariance[(i, j)] * rows.jacobian[(k, j)]).sum::<f64>();
            let fitted_m2: f64 = (0..count).map(|i| rows.jacobian[(k, i)] * row(i)).sum();
            let repeatability = Vector3::from(model.parts().machine.repeatability_m);
            let repeated_m2 = repeatability.component_mul(&rows.rays[k].direction).norm_squared();
            let missed_m2 = missed_m2(model, reading, &rows.rays[k].direction);
            let expected_m2 = fitted_m2 + missed_m2 + if sound.is_some() { repeated_m2 } else { 0.0 };
            assert!((predicted.u_m.powi(2) / expected_m2 - 1.0).abs() < 1e-9, "{what} {k}: {}", predicted.u_m);
        }
    }

    /// What straight lines between nodes miss along the sight (m²).
    fn missed_m2(model: &MachineModel, reading: &RangeReading, direction: &Vector3<f64>) -> f64 {
        let parts = model.parts();
        let of = |a: usize, b: usize| model.covariance(a, b);
        let between = abbe_geometry::between_nodes::BetweenNodes::new(model.layout(), &parts.coefficients, of);
        let point =
            model.layout().point(&parts.machine, &parts.coefficients, reading.reading_m, reading.offset_m).chain;
        let square = |id: abbe_geometry::ErrorId| {
            let (index, shape) = between.at(id, reading.reading_m[id.axis().index()])?;
            Some((shape * direction.dot(&point.by_error[id.index()])).powi(2) * between.variance(index))
        };
        abbe_geometry::ErrorId::all().filter_map(square).sum()
    }

    #[test]
    fn regress_a_predicted_length_is_what_identification_fits_for_every_effect_and_shape() {
        agree(&model(&[]), "no effect");
        let machine = machine();
        let mut together = Vec::new();
        for entry in REGISTRY {
            for shape in shapes(entry, &machine) {
                agree(&model(&[(entry.name, shape.clone())]), &format!("{} {shape:?}", entry.name));
            }
            together.push((entry.name, shapes(entry, &machine).remove(0)));
        }
        agree(&model(&together), "all effects");
    }

    #[test]
    fn the_simulator_logs_all_that_an_effect_may_ask_for() {
        assert!(abbe_virtual_machine::simulate::covariate_names().eq(LOGGED[1..].iter().copied()));
    }
}
