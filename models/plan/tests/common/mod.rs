//! Simulated machines, what a maker would believe of them, and planned campaigns driven on them.
//!
//! Place in the flow: the virtual machine, which shares no code with the models, gives truth and readings; a plan is made
//! without them. SI, machine frame.

#![allow(dead_code, clippy::unwrap_used, clippy::panic)] // each test uses its part; a preparation that fails fails its test

use abbe_geometry::correct::correct;
use abbe_geometry::effects::{NoCovariates, State};
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::{Joint, Machine, Side, Squareness, USUAL_RAM_TURN_RAD};
use abbe_geometry::model::MachineModel;
use abbe_geometry::rotation::RotationForm;
use abbe_geometry::{Axis, ErrorId, Matrix3, Vector3};
use abbe_identify::station_start::StationStart;
use abbe_identify::{Belief, Identified, IdentifyOptions, identify};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::planned::{Goal, Holder, Lines, Motion, Stand, Tracer};
use abbe_plan::{Plan, Request};
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::instrument::InstrumentConfig;
use abbe_virtual_machine::plan::{LinePlan, Plan as Drive, StationPlan};
use abbe_virtual_machine::verification::VerificationPoint;
use abbe_virtual_machine::{
    MachineTruth, SimulationConfig, TruthRecipe, VirtualMachine, simulate_campaign, verification_points,
};

/// The recorded campaigns' instrument.
pub(crate) const INSTRUMENT: InstrumentConfig = InstrumentConfig::LASER_TRACER;
/// Fine enough for what the simulator makes of a typical machine.
pub(crate) const SPLINE: FunctionKind = FunctionKind::BSpline { intervals: 12 };
/// Offsets of the recorded campaigns (m, ram frame).
pub(crate) const OFFSETS_M: [[f64; 3]; 3] = [[0.0, 0.0, -0.06], [0.12, 0.0, -0.06], [0.0, 0.14, -0.09]];
/// Machines by which the usual bend of an error is known; no test measures one of them.
const OTHERS: std::ops::Range<u64> = 9000..9040;

/// Kinds of machine, by a seed.
pub(crate) type Kinds = fn(u64) -> MachineTruth;

pub(crate) fn bridge(seed: u64) -> MachineTruth {
    recipe(seed).bridge_xyz().unwrap()
}

pub(crate) fn fyxz(seed: u64) -> MachineTruth {
    recipe(seed).fyxz().unwrap()
}

pub(crate) fn moving_table(seed: u64) -> MachineTruth {
    recipe(seed).moving_table().unwrap()
}

/// A long gantry with strokes of its own.
pub(crate) fn gantry(seed: u64) -> MachineTruth {
    use abbe_virtual_machine::Axis::{X, Y, Z};
    recipe(seed).machine("gantry", [[-0.2, 1.4], [0.1, 1.0], [-0.6, -0.1]], [&[X, Y, Z], &[]], Y).unwrap()
}

fn recipe(seed: u64) -> TruthRecipe {
    TruthRecipe { seed, ..TruthRecipe::default() }
}

/// What the maker would write down of a machine.
pub(crate) fn description(truth: &MachineTruth, kind: FunctionKind) -> Machine {
    let axis = |axis: abbe_virtual_machine::Axis| Axis::ALL[axis.index()];
    let joints: Vec<Joint> = truth
        .workpiece_side
        .iter()
        .rev()
        .map(|a| Joint { axis: axis(*a), side: Side::Workpiece })
        .chain(truth.tool_side.iter().map(|a| Joint { axis: axis(*a), side: Side::Tool }))
        .collect();
    let squareness: Vec<Squareness> = truth
        .squareness
        .iter()
        .map(|s| Squareness { name: s.name.clone(), tilts: axis(s.tilts), about: axis(s.about) })
        .collect();
    Machine {
        name: truth.name.replace([' ', ','], "_"),
        frame_id: "machine".to_owned(),
        joints: joints.try_into().unwrap(),
        stroke_m: truth.stroke_m.map(|[lower, upper]| (lower, upper)),
        squareness: squareness.try_into().unwrap(),
        rotation: RotationForm::Exact,
        kinds: [Some(kind); ErrorId::COUNT],
        repeatability_m: INSTRUMENT.repeatability_m,
        u_ram_turn_rad: [USUAL_RAM_TURN_RAD; 3],
        default_offset_m: None,
    }
}

/// Typical bend (geometric mean) of straightness, positioning and angles of other machines of a kind (m, m, rad).
pub(crate) fn usual_bends(kind: Kinds) -> [f64; 3] {
    let (mut sums, mut counts) = ([0.0; 3], [0.0; 3]);
    for seed in OTHERS {
        let truth = kind(seed);
        let machine = VirtualMachine::new(truth.clone()).unwrap();
        for id in ErrorId::all() {
            let [low_m, high_m] = truth.stroke_m[id.axis().index()];
            let at = |k: u32| machine.error_value(&id.name(), low_m + (high_m - low_m) * f64::from(k) / 40.0).unwrap();
            let values: Vec<f64> = (0..=40).map(at).collect();
            sums[class(id)] += 0.5 * square_about_line(&values).ln();
            counts[class(id)] += 1.0;
        }
    }
    std::array::from_fn(|k| f64::exp(sums[k] / counts[k]))
}

fn class(id: ErrorId) -> usize {
    if id.is_straightness() { 0 } else { 1 + usize::from(id.is_angular()) }
}

fn square_about_line(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    let (mean, middle) = (values.iter().sum::<f64>() / n, (n - 1.0) / 2.0);
    let square: f64 = (0..values.len()).map(|k| (k as f64 - middle).powi(2)).sum();
    let slope = values.iter().enumerate().map(|(k, v)| (k as f64 - middle) * v).sum::<f64>() / square;
    values.iter().enumerate().map(|(k, v)| (v - mean - slope * (k as f64 - middle)).powi(2)).sum::<f64>() / n
}

/// Stands around a volume, in fractions of the strokes: corners at two heights, sides, and above.
const AROUND: [[f64; 3]; 12] = [
    [-0.30, -0.30, -0.20],
    [1.30, -0.30, -0.10],
    [1.30, 1.30, 0.10],
    [-0.30, 1.30, 0.60],
    [0.50, -0.40, 0.80],
    [-0.35, 0.50, 0.10],
    [1.35, 0.50, 0.50],
    [0.50, 1.40, -0.20],
    [-0.30, -0.30, 0.90],
    [1.30, 1.30, 0.90],
    [1.30, -0.30, 0.70],
    [0.45, 0.40, -0.60],
];

/// A request for this kind of machine with stands around it and what its maker would believe.
pub(crate) fn request(kind: Kinds, goal: Goal) -> Request {
    let truth = kind(1);
    let machine = description(&truth, SPLINE);
    let [straightness_m, positioning_m, angle_rad] = usual_bends(kind);
    let belief = Belief::of_bends(&machine, |id| [straightness_m, positioning_m, angle_rad][class(id)]).unwrap();
    let stand = |(k, share): (usize, &[f64; 3])| Stand {
        name: format!("S{}", k + 1),
        position_m: std::array::from_fn(|d| {
            let [low_m, high_m] = truth.stroke_m[d];
            low_m + share[d] * (high_m - low_m) + if d < 2 { (share[d] - 0.5).signum() * 0.15 } else { 0.0 }
        }),
        of_region: true,
    };
    Request {
        instrument: INSTRUMENT.range,
        options: IdentifyOptions::default(),
        volume_m: machine.stroke_m,
        tips_m: OFFSETS_M.to_vec(),
        tracer: Tracer { nearest_m: 0.1, farthest_m: 10.0, elevation_rad: (-1.5, 1.5) },
        stands: AROUND.iter().enumerate().map(stand).collect(),
        most_stations: 6,
        holders: OFFSETS_M.map(|offset_m| Holder { offset_m, acceptance: None }).to_vec(),
        motion: Motion {
            feeds_m_s: vec![0.05],
            acceleration_m_s2: 0.3,
            dwell_s: 3.0,
            station_change_s: 900.0,
            holder_change_s: 60.0,
        },
        lines: Lines { points: (12, 19), levels: 4, diagonals: true },
        goal,
        tell: Vec::new(),
        sensors: Vec::new(),
        belief,
        seed: 1,
        measured: None,
        machine,
    }
}

/// The plan as the simulator drives it.
pub(crate) fn drive(request: &Request, plan: &Plan) -> Drive {
    let station = |(k, station): (usize, &abbe_measurement::planned::Station)| StationPlan {
        name: station.name.clone(),
        position_m: station.position_m,
        dead_path_m: 0.05,
        lines: plan.lines.iter().filter(|line| line.station == k).map(|line| line_plan(request, line)).collect(),
    };
    Drive {
        seed: 1,
        home_m: plan.lines[0].points_m[0],
        dwell_s: request.motion.dwell_s,
        station_change_s: request.motion.station_change_s,
        stations: plan.stations.iter().enumerate().map(station).collect(),
    }
}

fn line_plan(request: &Request, line: &abbe_measurement::planned::Line) -> LinePlan {
    LinePlan {
        name: line.name.clone(),
        from_m: line.points_m[0],
        to_m: *line.points_m.last().unwrap(),
        points: line.points_m.len() as u32,
        jitter: 0.0,
        offset_m: line.offset_m,
        feed_m_s: line.feed_m_s,
        acceleration_m_s2: request.motion.acceleration_m_s2,
        load_kg: 0.0,
        pause_s: 0.0,
    }
}

/// A machine measured along a plan.
pub(crate) fn simulated(mut truth: MachineTruth, plan: Drive, seed: u64) -> SimulationConfig {
    truth.ram_turn.about_m = plan.mean_offset_m();
    SimulationConfig {
        seed,
        machine: truth,
        plan,
        instrument: INSTRUMENT,
        environment: EnvironmentConfig::constant(),
        effects: Vec::new(),
    }
}

/// The campaign and its fit.
pub(crate) fn measured(machine: &Machine, config: &SimulationConfig) -> (Campaign, Identified) {
    let campaign = simulate_campaign(config).unwrap().campaign;
    let fit = identify(machine, INSTRUMENT.range, &campaign, &IdentifyOptions::default(), &mut |_| true).unwrap();
    (campaign, fit)
}

/// Mean square of the error of corrected points as a length in space, and of what the model states of it without
/// repeatability (m²), at random readings of the whole stroke with each of the tips.
pub(crate) fn verified(config: &SimulationConfig, model: &MachineModel, points: usize) -> (f64, f64) {
    verified_at(config, model, points, inner)
}

/// The same without the outer 2 % of each stroke.
pub(crate) fn verified_inside(config: &SimulationConfig, model: &MachineModel, points: usize) -> (f64, f64) {
    verified_at(config, model, points, |_, point| point.reading_m)
}

fn verified_at(
    config: &SimulationConfig,
    model: &MachineModel,
    points: usize,
    place: impl Fn(&SimulationConfig, &VerificationPoint) -> [f64; 3],
) -> (f64, f64) {
    let all: Vec<VerificationPoint> = verification_points(config, points, config.seed + 77).unwrap();
    let truth = VirtualMachine::new(config.machine.clone()).unwrap();
    let repeatability = Vector3::from(INSTRUMENT.repeatability_m);
    let (mut error, mut stated) = (0.0, 0.0);
    for (reading_m, offset_m) in all.iter().flat_map(|point| OFFSETS_M.map(|offset_m| (place(config, point), offset_m)))
    {
        let correction = correct(model, &State { reading_m, offset_m, covariates: &NoCovariates });
        let of_model =
            correction.covariance_m2.unwrap() - Matrix3::from_diagonal(&repeatability.component_mul(&repeatability));
        error += (correction.position_m - Vector3::from(truth.actual_point_m(reading_m, offset_m))).norm_squared();
        stated += of_model.trace();
    }
    let count = (all.len() * OFFSETS_M.len()) as f64;
    (error / count, stated / count)
}

/// The reading of a point, drawn without the simulator's margin of 2 % at either end.
fn inner(config: &SimulationConfig, point: &VerificationPoint) -> [f64; 3] {
    std::array::from_fn(|d| {
        let [low_m, high_m] = config.machine.stroke_m[d];
        let middle_m = 0.5 * (low_m + high_m);
        (middle_m + (point.reading_m[d] - middle_m) / 0.96).clamp(low_m, high_m)
    })
}

/// Stations of a drive, for statements about it.
pub(crate) fn starts(drive: &Drive) -> Vec<StationStart> {
    let of = |s: &StationPlan| StationStart { position_m: Vector3::from(s.position_m), dead_path_m: s.dead_path_m };
    drive.stations.iter().map(of).collect()
}
