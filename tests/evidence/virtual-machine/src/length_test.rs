//! The length test of ISO 10360-2 on a simulated machine: gauges of known length, probed on another day.
//!
//! Place in the flow: made from the same [`SimulationConfig`] as the campaign, effects and environment included; no fit may
//! look at it. Who asks says where the machine believes its tip to be (indicated, or corrected by some model); what comes
//! out goes into `abbe_conformity::length::evaluate`. Lengths in m, machine frame.
//!
//! To touch a point p the machine is driven to the reading r at which its tip really is at p: r ← r + p − actual(r) until
//! that holds, with repeatability drawn anew for every touch.

use abbe_conformity::length::{End, LengthMeasurement, LengthPlan, MeasuringLine, Touch, measure};
use nalgebra::Vector3;

use crate::environment::Environment;
use crate::error::SimulationError;
use crate::machine::{JointErrors, VirtualMachine};
use crate::plan::Target;
use crate::random::{Purpose, normal, stream};
use crate::simulate::{COVARIATES, SimulationConfig, covariates, disturbance, moment_of};

/// Rest between the end of the campaign and the first touch, and time from touch to touch (s).
const REST_S: f64 = 2100.0;
const STEP_S: f64 = 10.0;
/// The reading is found when the tip is this near to the point (m).
const SETTLED_M: f64 = 1e-12;
/// Errors are a ten-thousandth of the travel, so that each step gains four digits.
const MOST_STEPS: usize = 20;

/// The machine at one touch, as its controller sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MachineAtTouch {
    /// Seconds since the campaign began.
    pub time_s: f64,
    /// Axis readings (m).
    pub reading_m: [f64; 3],
    /// Tip relative to the ram reference point (m, ram frame).
    pub offset_m: [f64; 3],
    /// Logged quantities in the order of [`crate::simulate::covariate_names`].
    pub covariates: [f64; COVARIATES],
    /// Where the tip really is (m, machine frame).
    pub true_point_m: [f64; 3],
    /// Which end of the length.
    pub end: End,
}

impl MachineAtTouch {
    /// Where an uncorrected machine says that its tip is: reading plus offset (m, machine frame).
    pub fn indicated_m(&self) -> [f64; 3] {
        VirtualMachine::indicated_point_m(self.reading_m, self.offset_m)
    }
}

/// Measures the lengths of a plan on these lines. `believed_m` says for each touch where the machine believes its tip to be
/// (m, machine frame): [`MachineAtTouch::indicated_m`], or what a model makes of it. The same seed gives the same touches,
/// so that a machine before and after correction is measured on the same ones.
///
/// # Errors
/// Names the key of the first setting that makes no sense, the line of a plan that does not, or the point that the machine
/// cannot reach.
pub fn length_test(
    config: &SimulationConfig,
    lines: &[MeasuringLine],
    plan: &LengthPlan,
    seed: u64,
    mut believed_m: impl FnMut(&MachineAtTouch) -> [f64; 3],
) -> Result<Vec<LengthMeasurement>, SimulationError> {
    let mut bench = Bench::new(config, seed)?;
    let mut failed = None;
    let measured = measure(lines, plan, |touch| match bench.touch(touch) {
        Ok(at) => Vector3::from(believed_m(&at)) - touch.true_point_m,
        Err(error) => {
            failed.get_or_insert(error);
            Vector3::repeat(f64::NAN)
        }
    });
    match failed {
        Some(error) => Err(error),
        None => measured.map_err(|e| SimulationError::new(format!("length_test: {}", e.place), e.problem, e.remedy)),
    }
}

/// The simulated machine under test.
struct Bench<'a> {
    config: &'a SimulationConfig,
    machine: VirtualMachine,
    environment: Environment,
    path_m: Vec<[f64; 3]>,
    generator: rand_chacha::ChaCha8Rng,
    time_s: f64,
    load_kg: f64,
    feed_m_s: f64,
    acceleration_m_s2: f64,
}

impl<'a> Bench<'a> {
    fn new(config: &'a SimulationConfig, seed: u64) -> Result<Bench<'a>, SimulationError> {
        let machine = config.checked_machine()?;
        let line = config.plan.stations.first().and_then(|station| station.lines.first());
        let line = line.ok_or_else(|| SimulationError::new("plan.stations", "no line", "add at least one line"))?;
        Ok(Bench {
            machine,
            environment: Environment::new(&config.environment, config.seed),
            path_m: Vec::new(),
            generator: stream(seed, Purpose::LengthTest),
            time_s: config.plan.targets().last().map_or(0.0, |target| target.time_s) + REST_S,
            load_kg: line.load_kg,
            feed_m_s: line.feed_m_s,
            acceleration_m_s2: line.acceleration_m_s2,
            config,
        })
    }

    fn touch(&mut self, touch: &Touch) -> Result<MachineAtTouch, SimulationError> {
        self.time_s += STEP_S;
        let direction = [0, 1, 2].map(|d| moving(touch.approach[d]));
        let mut target = Target {
            station: 0,
            line: 0,
            first_of_station: false,
            time_s: self.time_s,
            reading_m: (touch.true_point_m - touch.line.offset_m).into(),
            offset_m: touch.line.offset_m.into(),
            direction,
            feed_m_s: self.feed_m_s,
            acceleration_m_s2: [0, 1, 2].map(|d| touch.approach[d] * self.acceleration_m_s2),
            load_kg: self.load_kg,
        };
        let state = self.environment.state(self.time_s);
        self.path_m.push(target.reading_m);
        let repeatability_m = self.config.instrument.repeatability_m;
        let stops_m = [0, 1, 2].map(|axis| repeatability_m[axis] * normal(&mut self.generator));
        for _ in 0..MOST_STEPS {
            if let Some(last_m) = self.path_m.last_mut() {
                *last_m = target.reading_m;
            }
            let moment = moment_of(&target, &self.config.machine, &self.environment, &self.path_m);
            let mut extra: JointErrors = disturbance(&self.config.effects, &moment);
            for axis in 0..3 {
                extra.linear_m[axis][axis] += stops_m[axis];
            }
            let actual_m = self.machine.disturbed_point_m(target.reading_m, target.offset_m, &extra);
            let away_m = touch.true_point_m - Vector3::from(actual_m);
            if away_m.amax() <= SETTLED_M {
                return Ok(MachineAtTouch {
                    time_s: self.time_s,
                    reading_m: target.reading_m,
                    offset_m: target.offset_m,
                    covariates: covariates(&target, self.environment.logged(&state)),
                    true_point_m: touch.true_point_m.into(),
                    end: touch.end,
                });
            }
            for d in 0..3 {
                target.reading_m[d] += away_m[d];
            }
        }
        let point_mm = touch.true_point_m * 1e3;
        let problem = format!("no reading brings the tip to {:.3} {:.3} {:.3} mm", point_mm.x, point_mm.y, point_mm.z);
        Err(SimulationError::new("length_test", problem, "check the machine's errors and effects"))
    }
}

/// Direction of the last motion of an axis; an axis that the approach leaves alone came in positive direction.
fn moving(component: f64) -> f64 {
    if component < -1e-12 { -1.0 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::from_text;
    use crate::environment::EnvironmentConfig;
    use crate::instrument::InstrumentConfig;
    use crate::machine::{Roughness, TruthRecipe};
    use crate::plan::presets::case_like;
    use abbe_conformity::length::{MeasuringVolume, e0_lines};

    /// What the search for a reading leaves, twice, of two touches.
    const SETTLED_TWICE_M: f64 = 4e-12;

    fn config(repeatability_m: [f64; 3]) -> SimulationConfig {
        let recipe = TruthRecipe { seed: 5, roughness: Roughness::TYPICAL, volumetric_rms_m: 20e-6 };
        let machine = recipe.bridge_xyz().unwrap();
        let plan = case_like(machine.stroke_m, 5).build().unwrap();
        let instrument = InstrumentConfig { repeatability_m, ..InstrumentConfig::LASER_TRACER };
        let environment = EnvironmentConfig::constant();
        SimulationConfig { seed: 5, machine, plan, instrument, environment, effects: Vec::new() }
    }

    fn lines(config: &SimulationConfig) -> Vec<MeasuringLine> {
        let volume = MeasuringVolume::new(config.machine.stroke_m.map(|[lower, upper]| (lower, upper))).unwrap();
        e0_lines(&volume).into_iter().map(|line| line.with_stylus(Vector3::new(0.0, 0.0, -0.06))).collect()
    }

    fn run(config: &SimulationConfig, seed: u64, believed: impl FnMut(&MachineAtTouch) -> [f64; 3]) -> Vec<f64> {
        let measured = length_test(config, &lines(config), &LengthPlan::default(), seed, believed).unwrap();
        measured.iter().map(|m| m.error.metres()).collect()
    }

    #[test]
    fn the_tip_stands_where_the_gauge_is() {
        let config = config([0.0; 3]);
        let machine = VirtualMachine::new(config.machine.clone()).unwrap();
        run(&config, 1, |at| {
            let actual_m = machine.actual_point_m(at.reading_m, at.offset_m);
            assert!((0..3).all(|d| (actual_m[d] - at.true_point_m[d]).abs() < 2.0 * SETTLED_M), "{at:?}");
            at.indicated_m()
        });
    }

    #[test]
    fn a_machine_that_knows_its_tip_has_no_error_and_one_that_does_not_has() {
        let config = config([0.0; 3]);
        let machine = VirtualMachine::new(config.machine.clone()).unwrap();
        let known = run(&config, 1, |at| machine.actual_point_m(at.reading_m, at.offset_m));
        assert!(known.iter().all(|e| e.abs() < SETTLED_TWICE_M), "{known:?}");
        let indicated = run(&config, 1, |at| at.indicated_m());
        assert!(indicated.iter().any(|e| e.abs() > 5e-6), "{indicated:?}");
    }

    #[test]
    fn repeats_scatter_by_the_repeatability_and_repeat_by_the_seed() {
        let config = config([0.2e-6; 3]);
        let (one, again, other) = (
            run(&config, 1, |at| at.indicated_m()),
            run(&config, 1, |at| at.indicated_m()),
            run(&config, 2, |at| at.indicated_m()),
        );
        assert_eq!(one, again);
        assert_ne!(one, other);
        // Two ends of a length, each off by 0.2 µm: standard deviation of repeats 0.2·√2 = 0.283 µm; 70 degrees of freedom.
        let sum: f64 = one
            .chunks(3)
            .map(|set| {
                let mean = set.iter().sum::<f64>() / 3.0;
                set.iter().map(|e| (e - mean).powi(2)).sum::<f64>()
            })
            .sum();
        let deviation_m = (sum / 70.0).sqrt();
        assert!((deviation_m / 0.283e-6 - 1.0).abs() < 0.25, "{deviation_m}");
    }

    #[test]
    fn effects_take_part() {
        let clean = config([0.0; 3]);
        let effects = vec![from_text("backlash axis=x size_um=3").unwrap()];
        let lost = run(&SimulationConfig { effects, ..config([0.0; 3]) }, 1, |at| at.indicated_m());
        let difference = |k: usize| (lost[k] - run(&clean, 1, |at| at.indicated_m())[k]).abs();
        // Line X is the fifth: both ends are approached from outside, so that play of 3 µm shows whole.
        assert!((difference(4 * 15) - 3e-6).abs() < 0.1e-6, "{}", difference(4 * 15));
        // Line Y never moves in −X.
        assert!(difference(5 * 15) < 1e-9);
    }
}
