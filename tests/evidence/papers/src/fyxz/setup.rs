//! The paper's experiment, simulated: an FYXZ machine on the 12 edges, an absolute tracker on four stations.
//!
//! Place in the flow: every figure of the paper starts here; the truth stays with the simulator. SI, machine frame. The
//! paper's tables of parameters are pictures that did not survive, so strokes, instrument and sizes of errors are ours:
//! 700 × 1000 × 600 mm, U(L) = 0.2 µm + 0.3 µm/m (k = 2), repeatability 0.5 µm.

use crate::figure::PaperError;
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::{Joint, Machine, Side, Squareness};
use abbe_geometry::rotation::RotationForm;
use abbe_geometry::{Axis, ErrorId, Vector3};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::instrument::InstrumentConfig;
use abbe_virtual_machine::machine::Roughness;
use abbe_virtual_machine::plan::presets::edges_12;
use abbe_virtual_machine::{SimulationConfig, TruthRecipe, VirtualMachine, simulate_campaign};

/// Points on each edge, and nodes of each error function: one at every point.
pub(super) const NODES: u32 = 9;
/// Errors that move nothing when the reflector sits at the ram's end.
pub(super) const UNSEEN: [&str; 4] = ["ECX", "EAZ", "EBZ", "ECZ"];
/// Uncertainty of the tracer's range, k = 1.
pub(super) const RANGE: RangeUncertainty =
    RangeUncertainty { constant_m: 0.1e-6, per_metre: 0.15e-6, common_per_metre: 0.0 };
/// Repeatability of each axis (m, k = 1).
const REPEATABILITY_M: f64 = 0.5e-6;

/// A simulated experiment.
pub(super) struct Experiment {
    /// What the maker would write down of the machine.
    pub(super) machine: Machine,
    /// Absolute distances.
    pub(super) campaign: Campaign,
    /// The truth.
    pub(super) truth: VirtualMachine,
    /// True stations (m).
    pub(super) stations_m: Vec<Vector3<f64>>,
}

impl Experiment {
    /// A machine of that seed and volumetric error (rms, m).
    pub(super) fn new(seed: u64, volumetric_rms_m: f64) -> Result<Experiment, PaperError> {
        Experiment::with_stations(seed, volumetric_rms_m, |position_m| position_m)
    }

    /// The same with the stations moved.
    pub(super) fn with_stations(
        seed: u64,
        volumetric_rms_m: f64,
        place_m: fn([f64; 3]) -> [f64; 3],
    ) -> Result<Experiment, PaperError> {
        let recipe = TruthRecipe { seed, roughness: Roughness::TYPICAL, volumetric_rms_m };
        let mut truth = recipe.fyxz().map_err(failed)?;
        // The reflector sits at the ram's end, and so does the frame: how the ram is turned moves nothing.
        truth.ram_turn.about_m = [0.0; 3];
        let mut plan = edges_12(truth.stroke_m, NODES, seed).map_err(failed)?;
        plan.stations.iter_mut().for_each(|station| station.position_m = place_m(station.position_m));
        let machine = described(&truth)?;
        let repeatability_m = [REPEATABILITY_M; 3];
        let instrument = InstrumentConfig { range: RANGE, repeatability_m, ..InstrumentConfig::LASER_TRACER };
        let environment = EnvironmentConfig::constant();
        let config = SimulationConfig { seed, machine: truth, plan, instrument, environment, effects: Vec::new() };
        let simulated = simulate_campaign(&config).map_err(failed)?;
        let mut campaign = simulated.campaign;
        // An absolute tracker: the length is the distance itself.
        for reading in &mut campaign.readings {
            reading.length_m += simulated.truth.first_ranges_m[reading.station as usize];
        }
        let stations_m = simulated.truth.stations_m.iter().copied().map(Vector3::from).collect();
        Ok(Experiment { machine, campaign, truth: simulated.truth.machine, stations_m })
    }

    /// Distinct targets of the path in the order in which they come, and the target of each reading.
    pub(super) fn targets(&self) -> (Vec<[f64; 3]>, Vec<usize>) {
        let mut targets: Vec<[f64; 3]> = Vec::new();
        let place = |reading_m: [f64; 3]| {
            targets.iter().position(|t| *t == reading_m).unwrap_or_else(|| {
                targets.push(reading_m);
                targets.len() - 1
            })
        };
        let of_readings = self.campaign.readings.iter().map(|r| r.reading_m).map(place).collect();
        (targets, of_readings)
    }

    /// True position at a reading, without repeatability (m).
    pub(super) fn actual_m(&self, reading_m: [f64; 3]) -> Vector3<f64> {
        Vector3::from(self.truth.actual_point_m(reading_m, [0.0; 3]))
    }
}

/// Error functions of the paper: nodes with straight lines between, 17 errors.
fn described(truth: &abbe_virtual_machine::MachineTruth) -> Result<Machine, PaperError> {
    let axis = |axis: abbe_virtual_machine::Axis| Axis::ALL[axis.index()];
    let joints: Vec<Joint> = truth.tool_side.iter().map(|a| Joint { axis: axis(*a), side: Side::Tool }).collect();
    let squareness: Vec<Squareness> = truth
        .squareness
        .iter()
        .map(|s| Squareness { name: s.name.clone(), tilts: axis(s.tilts), about: axis(s.about) })
        .collect();
    let kind =
        |id: ErrorId| (!UNSEEN.contains(&id.name().as_str())).then_some(FunctionKind::Nodes { count: NODES as usize });
    let kinds: Vec<Option<FunctionKind>> = ErrorId::all().map(kind).collect();
    let three = |what: &str| failed(format!("the simulated machine has no three {what}"));
    Ok(Machine {
        name: truth.name.clone(),
        frame_id: "machine".to_owned(),
        joints: joints.try_into().map_err(|_| three("tool-side axes"))?,
        stroke_m: truth.stroke_m.map(|[lower, upper]| (lower, upper)),
        squareness: squareness.try_into().map_err(|_| three("squareness angles"))?,
        rotation: RotationForm::SmallAngle,
        kinds: kinds.try_into().map_err(|_| failed("eighteen kinds were expected"))?,
        repeatability_m: [REPEATABILITY_M; 3],
        u_ram_turn_rad: [abbe_geometry::machine::USUAL_RAM_TURN_RAD; 3],
        default_offset_m: Some([0.0; 3]),
    })
}

/// A failure of the simulation or of a fit.
pub(super) fn failed(problem: impl ToString) -> PaperError {
    PaperError { paper: "FYXZ paper", place: "simulated experiment", problem: problem.to_string() }
}
