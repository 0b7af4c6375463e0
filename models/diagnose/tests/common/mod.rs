//! Simulated campaigns with effects in them, for the tests and the benchmark of diagnosis.
//!
//! Place in the flow: the virtual machine, which shares no code with the effects it injects, gives readings; diagnosis
//! sees nothing else. SI, machine frame.

#![allow(dead_code, clippy::unwrap_used, clippy::panic)] // each test uses its part; what fails to prepare fails its test

use abbe_diagnose::{DiagnoseOptions, Diagnosis, diagnose};
use abbe_geometry::Axis;
use abbe_geometry::Vector3;
use abbe_geometry::correct::correct;
use abbe_geometry::effects::{CovariateSource, CovariateValue, State};
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::{Joint, Machine, Side, Squareness};
use abbe_geometry::model::MachineModel;
use abbe_geometry::rotation::RotationForm;
use abbe_measurement::alignment::aligned_residuals_m;
use abbe_virtual_machine::effects::from_text;
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::instrument::InstrumentConfig;
use abbe_virtual_machine::plan::PlanRecipe;
use abbe_virtual_machine::plan::presets::case_like;
use abbe_virtual_machine::simulate::covariate_names;
use abbe_virtual_machine::{Simulated, SimulationConfig, TruthRecipe, simulate_campaign, verification_points};

/// The recorded campaigns' instrument.
pub(crate) const INSTRUMENT: InstrumentConfig = InstrumentConfig::LASER_TRACER;
/// Splines of the shipped bridge.
pub(crate) const SPLINE: FunctionKind = FunctionKind::BSpline { intervals: 9 };

/// A simulated campaign and what diagnosis is told of the machine.
pub(crate) struct Case {
    pub(crate) config: SimulationConfig,
    pub(crate) simulated: Simulated,
    pub(crate) machine: Machine,
}

impl Case {
    /// A campaign like the recorded ones with these effects, as texts.
    pub(crate) fn new(seed: u64, effects: &[&str]) -> Case {
        Case::with(seed, effects, SPLINE, case_like)
    }

    /// The same on another plan and with other error functions.
    pub(crate) fn with(
        seed: u64,
        effects: &[&str],
        kind: FunctionKind,
        plan: fn([[f64; 2]; 3], u64) -> PlanRecipe,
    ) -> Case {
        let truth = TruthRecipe { seed, ..TruthRecipe::default() }.bridge_xyz().unwrap();
        let plan = plan(truth.stroke_m, seed).build().unwrap();
        let machine = description(kind, &truth.stroke_m);
        let config = SimulationConfig {
            seed,
            machine: truth,
            plan,
            instrument: INSTRUMENT,
            environment: EnvironmentConfig::workshop(),
            effects: effects.iter().map(|text| from_text(text).unwrap()).collect(),
        };
        Case { simulated: simulate_campaign(&config).unwrap(), config, machine }
    }

    /// Diagnosis without the repeated searches that judge it.
    pub(crate) fn diagnose(&self) -> Diagnosis {
        self.diagnose_with(&DiagnoseOptions { folds: 0, placebos: 4, ..DiagnoseOptions::default() })
    }

    pub(crate) fn diagnose_with(&self, options: &DiagnoseOptions) -> Diagnosis {
        let campaign = &self.simulated.campaign;
        diagnose(&self.machine, &[], INSTRUMENT.range, campaign, options, &mut |_| true).unwrap()
    }

    /// 3-D error (rms, m) of a model at points on another day, after rigid alignment.
    pub(crate) fn verification_m(&self, model: &MachineModel) -> f64 {
        let errors = self.errors_m(model);
        (errors.iter().map(|point| point.error_m.norm_squared()).sum::<f64>() / errors.len() as f64).sqrt()
    }

    /// The same at each of these points.
    pub(crate) fn errors_m(&self, model: &MachineModel) -> Vec<Erring> {
        let points = verification_points(&self.config, 300, 99).unwrap();
        let (mut corrected, mut actual, mut u_m) = (Vec::new(), Vec::new(), Vec::new());
        for point in &points {
            let logged = Logged { time_s: point.time_s, values: &point.covariates };
            let state = State { reading_m: point.reading_m, offset_m: point.offset_m, covariates: &logged };
            let correction = correct(model, &state);
            corrected.push(correction.position_m);
            u_m.push(correction.covariance_m2.unwrap().diagonal().map(f64::sqrt));
            actual.push(Vector3::from(point.actual_m));
        }
        let errors = aligned_residuals_m(&corrected, &actual).unwrap();
        let all = points.iter().zip(errors).zip(u_m);
        all.map(|((point, error_m), u_m)| Erring { reading_m: point.reading_m, error_m, u_m }).collect()
    }
}

/// Error of a corrected point, and its standard uncertainty (m).
pub(crate) struct Erring {
    pub(crate) reading_m: [f64; 3],
    pub(crate) error_m: Vector3<f64>,
    pub(crate) u_m: Vector3<f64>,
}

struct Logged<'a> {
    time_s: f64,
    values: &'a [f64],
}

impl CovariateSource for Logged<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        if name == "time_s" {
            return CovariateValue::Fresh(self.time_s);
        }
        match covariate_names().position(|known| known == name) {
            Some(place) => CovariateValue::Fresh(self.values[place]),
            None => CovariateValue::Missing,
        }
    }
}

fn description(kind: FunctionKind, stroke_m: &[[f64; 2]; 3]) -> Machine {
    let tilt = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
    Machine {
        name: "bridge".to_owned(),
        frame_id: "machine".to_owned(),
        joints: Axis::ALL.map(|axis| Joint { axis, side: Side::Tool }),
        stroke_m: stroke_m.map(|[lower, upper]| (lower, upper)),
        squareness: [tilt("C0Y", Axis::Y, Axis::Z), tilt("B0Z", Axis::Z, Axis::Y), tilt("A0Z", Axis::Z, Axis::X)],
        rotation: RotationForm::Exact,
        kinds: [Some(kind); 18],
        repeatability_m: INSTRUMENT.repeatability_m,
        u_ram_turn_rad: [abbe_geometry::machine::USUAL_RAM_TURN_RAD; 3],
        default_offset_m: None,
    }
}
