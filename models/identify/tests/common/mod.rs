//! Simulated machines and campaigns with their truth, for the evidence tests.
//!
//! Place in the flow: the virtual machine (which shares no code with the models) gives truth and readings; the tests
//! give the readings alone to identification and compare. SI, machine frame.

#![allow(dead_code, clippy::unwrap_used, clippy::panic)] // each test uses its part; a preparation that fails fails its test

use abbe_geometry::correct::{Correction, correct};
use abbe_geometry::effects::{NoCovariates, State};
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::{Joint, Machine, Side, Squareness};
use abbe_geometry::model::MachineModel;
use abbe_geometry::rotation::RotationForm;
use abbe_geometry::{Axis, ErrorId, Vector3};
use abbe_identify::{Identified, IdentifyError, IdentifyOptions, identify};
use abbe_measurement::campaign::Campaign;
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::instrument::InstrumentConfig;
use abbe_virtual_machine::machine::Term;
use abbe_virtual_machine::plan::Plan;
use abbe_virtual_machine::plan::presets;
use abbe_virtual_machine::verification::VerificationPoint;
use abbe_virtual_machine::{MachineTruth, Simulated, SimulationConfig, simulate_campaign, verification_points};

/// Cubic splines of twelve intervals: what the shipped bridge uses.
pub(crate) const SPLINE: FunctionKind = FunctionKind::BSpline { intervals: 12 };
/// The recorded campaigns' instrument.
pub(crate) const INSTRUMENT: InstrumentConfig = InstrumentConfig::LASER_TRACER;

/// A simulated campaign and the machine description that identification is given.
pub(crate) struct Case {
    pub(crate) config: SimulationConfig,
    pub(crate) simulated: Simulated,
    pub(crate) machine: Machine,
}

impl Case {
    /// Drives `truth` along `plan` with the noise of `seed`; its ram turns about the plan's mean offset, so that truth and
    /// model share a frame.
    pub(crate) fn new(mut truth: MachineTruth, plan: Plan, kind: FunctionKind, seed: u64) -> Case {
        truth.ram_turn.about_m = plan.mean_offset_m();
        let machine = description(&truth, kind);
        let config = SimulationConfig {
            seed,
            machine: truth,
            plan,
            instrument: INSTRUMENT,
            environment: EnvironmentConfig::constant(),
            effects: Vec::new(),
        };
        let simulated = simulate_campaign(&config).unwrap();
        Case { config, simulated, machine }
    }

    /// A campaign like the recorded ones.
    pub(crate) fn case_like(truth: MachineTruth, kind: FunctionKind, seed: u64) -> Case {
        let plan = presets::case_like(truth.stroke_m, seed).build().unwrap();
        Case::new(truth, plan, kind, seed)
    }

    pub(crate) fn campaign(&self) -> &Campaign {
        &self.simulated.campaign
    }

    pub(crate) fn identify(&self, options: &IdentifyOptions) -> Identified {
        self.try_identify(self.campaign(), options).unwrap_or_else(|error| panic!("{error}"))
    }

    pub(crate) fn try_identify(
        &self,
        campaign: &Campaign,
        options: &IdentifyOptions,
    ) -> Result<Identified, IdentifyError> {
        identify(&self.machine, INSTRUMENT.range, campaign, options, &mut |_| true)
    }

    /// True error of an axis (m or rad) at a scale reading (m).
    pub(crate) fn true_error(&self, id: ErrorId, reading_m: f64) -> f64 {
        self.simulated.truth.machine.error_value(&id.name(), reading_m).unwrap()
    }

    /// Points of another day with their exact position in the machine frame.
    pub(crate) fn verification(&self, points: usize) -> Vec<VerificationPoint> {
        verification_points(&self.config, points, self.config.seed + 1000).unwrap()
    }

    /// Corrected minus true position (m) and the correction, at each verification point.
    pub(crate) fn verify(&self, model: &MachineModel, points: usize) -> Vec<(Vector3<f64>, Correction)> {
        let error = |point: &VerificationPoint| {
            let correction = correct(model, &state(point));
            (correction.position_m - Vector3::from(point.actual_in_machine_m), correction)
        };
        self.verification(points).iter().map(error).collect()
    }

    /// Rms length (m) of the error left at verification points, in the machine frame without any alignment.
    pub(crate) fn verification_rms_m(&self, model: &MachineModel) -> f64 {
        let errors = self.verify(model, 300);
        (errors.iter().map(|(e, _)| e.norm_squared()).sum::<f64>() / errors.len() as f64).sqrt()
    }
}

pub(crate) fn state(point: &VerificationPoint) -> State<'static> {
    State { reading_m: point.reading_m, offset_m: point.offset_m, covariates: &NoCovariates }
}

/// What the machine's maker would write down of a simulated machine.
pub(crate) fn description(truth: &MachineTruth, kind: FunctionKind) -> Machine {
    let joint = |side| move |axis: &abbe_virtual_machine::Axis| Joint { axis: same(*axis), side };
    let table = truth.workpiece_side.iter().rev().map(joint(Side::Workpiece));
    let joints: Vec<Joint> = table.chain(truth.tool_side.iter().map(joint(Side::Tool))).collect();
    let squareness: Vec<Squareness> = truth
        .squareness
        .iter()
        .map(|s| Squareness { name: s.name.clone(), tilts: same(s.tilts), about: same(s.about) })
        .collect();
    Machine {
        name: truth.name.clone(),
        frame_id: "machine".to_owned(),
        joints: joints.try_into().unwrap(),
        stroke_m: truth.stroke_m.map(|[lower, upper]| (lower, upper)),
        squareness: squareness.try_into().unwrap(),
        rotation: RotationForm::Exact,
        kinds: [Some(kind); ErrorId::COUNT],
        repeatability_m: INSTRUMENT.repeatability_m,
        u_ram_turn_rad: [abbe_geometry::machine::USUAL_RAM_TURN_RAD; 3],
        default_offset_m: None,
    }
}

fn same(axis: abbe_virtual_machine::Axis) -> Axis {
    Axis::ALL[axis.index()]
}

/// Leaves only Chebyshev terms up to `order`, so that polynomials of that degree hold the truth exactly.
pub(crate) fn of_low_order(mut truth: MachineTruth, highest: u32) -> MachineTruth {
    for terms in truth.errors.values_mut() {
        terms.retain(|term| matches!(term, Term::Chebyshev { order, .. } if *order <= highest));
    }
    truth
}

/// Holds errors at zero, in the truth and in the description.
pub(crate) fn held_zero(truth: &mut MachineTruth, kinds: &mut [Option<FunctionKind>; ErrorId::COUNT], names: &[&str]) {
    for name in names {
        truth.errors.remove(*name).unwrap();
        kinds[ErrorId::from_name(name).unwrap().index()] = None;
    }
}
