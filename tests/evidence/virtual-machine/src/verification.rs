//! Verification points: random readings on another day with the true tip position, for scoring a model.
//!
//! Place in the flow: made from the same [`SimulationConfig`] as the campaign; no fit may look at them.
//! Lengths in m. The truth carries effects but not repeatability: it is where the machine goes on average.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

use crate::environment::Environment;
use crate::error::{SimulationError, require_not_negative};
use crate::machine::matrix::{Homogeneous, IDENTITY, apply, product, rotation, translation};
use crate::plan::Target;
use crate::random::{Purpose, normal, pick, stream, uniform};
use crate::simulate::{COVARIATES, SimulationConfig, covariates, disturbance, moment_of};

/// Rest between the end of the campaign and the first point, and time from point to point (s).
const REST_S: f64 = 2100.0;
/// Time from point to point (s).
pub const STEP_S: f64 = 20.0;
/// Feed before a stop at a pose that is asked for (m/s).
const SLOW_M_S: f64 = 0.02;
/// Largest turn (rad) and shift (m) of a frame of its own, each component.
const FRAME_TURN_RAD: f64 = 100e-6;
const FRAME_SHIFT_M: f64 = 100e-6;

/// The frame in which the true positions are given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Frame {
    /// The machine frame itself.
    Machine,
    /// A frame turned and shifted by an amount that is drawn: align before comparing.
    Unknown,
}

/// How the verification points are made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VerificationConfig {
    /// Number of points.
    pub points: usize,
    /// Seed of the points.
    pub seed: u64,
    /// Frame of the true positions.
    pub frame: Frame,
    /// Standard deviation with which each true coordinate is known (m).
    pub known_to_m: f64,
}

/// One verification point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VerificationPoint {
    /// Seconds since the campaign began.
    pub time_s: f64,
    /// Axis readings (m).
    pub reading_m: [f64; 3],
    /// Reflector offset (m, ram frame).
    pub offset_m: [f64; 3],
    /// Logged quantities in the order of [`crate::simulate::covariate_names`].
    pub covariates: [f64; COVARIATES],
    /// True position in the machine frame (m), exact.
    pub actual_in_machine_m: [f64; 3],
    /// True position in the frame asked for (m), as well as it is known.
    pub actual_m: [f64; 3],
}

/// Points within the machine frame, known exactly; offsets are those of the plan.
///
/// # Errors
/// Names the key of the first setting that makes no sense.
pub fn verification_points(
    config: &SimulationConfig,
    points: usize,
    seed: u64,
) -> Result<Vec<VerificationPoint>, SimulationError> {
    let verification = VerificationConfig { points, seed, frame: Frame::Machine, known_to_m: 0.0 };
    verification_points_with(config, &verification)
}

/// Points as [`VerificationConfig`] asks for.
///
/// # Errors
/// Names the key of the first setting that makes no sense.
pub fn verification_points_with(
    config: &SimulationConfig,
    verification: &VerificationConfig,
) -> Result<Vec<VerificationPoint>, SimulationError> {
    require_not_negative("verification.known_to_m", verification.known_to_m)?;
    let machine = config.checked_machine()?;
    let mut environment = Environment::new(&config.environment, config.seed);
    let mut path_m = Vec::with_capacity(verification.points);
    let mut generator = stream(verification.seed, Purpose::Verification);
    let frame = drawn_frame(verification.frame, &mut generator);
    let campaign_end_s = config.plan.targets().last().map_or(0.0, |t| t.time_s);
    let mut out = Vec::with_capacity(verification.points);
    let mut time_s = campaign_end_s + REST_S;
    for _ in 0..verification.points {
        let target = random_target(config, time_s, &mut generator)?;
        let state = environment.state(time_s);
        path_m.push(target.reading_m);
        let moment = moment_of(&target, &config.machine, &environment, &path_m);
        let extra = disturbance(&config.effects, &moment);
        let actual_in_machine_m = machine.disturbed_point_m(target.reading_m, target.offset_m, &extra);
        let mut actual_m = apply(&frame, actual_in_machine_m);
        for value in &mut actual_m {
            *value += verification.known_to_m * normal(&mut generator);
        }
        out.push(VerificationPoint {
            time_s,
            reading_m: target.reading_m,
            offset_m: target.offset_m,
            covariates: covariates(&target, environment.logged(&state)),
            actual_in_machine_m,
            actual_m,
        });
        time_s += STEP_S;
    }
    Ok(out)
}

/// True tip positions (m, machine frame) at these poses (axis reading and tip offset, m) on the day of the verification,
/// each axis approached in its + direction without load.
///
/// # Errors
/// Names the key of the first setting that makes no sense.
pub fn actual_points_m(
    config: &SimulationConfig,
    poses: &[([f64; 3], [f64; 3])],
) -> Result<Vec<[f64; 3]>, SimulationError> {
    let machine = config.checked_machine()?;
    let environment = Environment::new(&config.environment, config.seed);
    let time_s = config.plan.targets().last().map_or(0.0, |t| t.time_s) + REST_S;
    let actual = |(reading_m, offset_m): &([f64; 3], [f64; 3])| {
        let target = Target {
            station: 0,
            line: 0,
            first_of_station: false,
            time_s,
            reading_m: *reading_m,
            offset_m: *offset_m,
            direction: [1.0; 3],
            feed_m_s: SLOW_M_S,
            acceleration_m_s2: [0.0; 3],
            load_kg: 0.0,
        };
        let extra = disturbance(&config.effects, &moment_of(&target, &config.machine, &environment, &[*reading_m]));
        machine.disturbed_point_m(*reading_m, *offset_m, &extra)
    };
    Ok(poses.iter().map(actual).collect())
}

/// A random standstill within the strokes, approached and loaded like some line of the plan.
fn random_target(
    config: &SimulationConfig,
    time_s: f64,
    generator: &mut ChaCha8Rng,
) -> Result<Target, SimulationError> {
    let station = pick(generator, &config.plan.stations);
    let line = station.and_then(|s| pick(generator, &s.lines));
    let line = line.ok_or_else(|| SimulationError::new("plan.stations", "no line", "add at least one line"))?;
    let mut reading_m = [0.0; 3];
    let mut direction = [0.0; 3];
    let mut acceleration_m_s2 = [0.0; 3];
    for axis in 0..3 {
        let [low, high] = config.machine.stroke_m[axis];
        let margin = 0.02 * (high - low);
        reading_m[axis] = uniform(generator, low + margin, high - margin);
        direction[axis] = if generator.random::<bool>() { 1.0 } else { -1.0 };
        // A share of the line's acceleration in each axis: the last move came from anywhere.
        acceleration_m_s2[axis] = direction[axis] * line.acceleration_m_s2 * uniform(generator, 0.1, 1.0);
    }
    Ok(Target {
        station: 0,
        line: 0,
        first_of_station: false,
        time_s,
        reading_m,
        offset_m: line.offset_m,
        direction,
        feed_m_s: line.feed_m_s,
        acceleration_m_s2,
        load_kg: line.load_kg,
    })
}

fn drawn_frame(frame: Frame, generator: &mut ChaCha8Rng) -> Homogeneous {
    let mut draw = |size: f64| [0; 3].map(|_| uniform(generator, -size, size));
    match frame {
        Frame::Machine => IDENTITY,
        Frame::Unknown => product(&translation(draw(FRAME_SHIFT_M)), &rotation(draw(FRAME_TURN_RAD))),
    }
}
