//! Shipped truths: a moving bridge, an FYXZ machine and one with a moving table, randomised by a seed.
//!
//! Place in the flow: a [`TruthRecipe`] makes the [`MachineTruth`] of a simulated campaign.
//! Typical sizes are a few micrometres and a few to 20 µrad; all are then scaled together until the rms of the
//! volumetric error over the stroke is the one asked for. The turn of the ram is not scaled with them: it comes from
//! mounting, not from guideways.

use std::collections::BTreeMap;

use rand_chacha::ChaCha8Rng;

use super::{Axis, MachineTruth, RamTurn, Squareness, Term, VirtualMachine};
use crate::error::{SimulationError, require_not_negative, require_positive};
use crate::random::{Purpose, normal, stream, uniform};

/// Typical size of a straightness error before scaling (m).
const STRAIGHTNESS_M: f64 = 4e-6;
/// Typical size of a positioning error before scaling (m).
const POSITIONING_M: f64 = 9e-6;
/// Typical size of an angular error before scaling (rad).
const ANGLE_RAD: f64 = 6e-6;
/// Largest squareness before scaling (rad).
const SQUARENESS_RAD: f64 = 18e-6;
/// Largest turn of the ram about each axis (rad): 20 µrad rms.
const RAM_TURN_RAD: f64 = 35e-6;
/// Reflector offset at which the volumetric error is taken, and about which the ram turns (m, ram frame).
const PROBE_M: [f64; 3] = [0.0, 0.0, -0.06];

/// How rough the error functions are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Roughness {
    /// Highest number of half waves and highest Chebyshev degree in a stroke; at least 1.
    pub half_waves: u32,
    /// Size of the k-th half wave relative to the first is k^(−decay).
    pub decay: f64,
    /// Gaussian bumps, a tenth of the stroke wide, in each function.
    pub bumps: u32,
}

impl Roughness {
    /// Slow bows only: what a low-order polynomial follows well.
    pub const SMOOTH: Roughness = Roughness { half_waves: 3, decay: 2.0, bumps: 0 };
    /// A typical machine: some waves and one local flaw.
    pub const TYPICAL: Roughness = Roughness { half_waves: 5, decay: 1.5, bumps: 1 };
    /// A worn guideway.
    pub const ROUGH: Roughness = Roughness { half_waves: 12, decay: 0.9, bumps: 3 };
}

/// What a random machine is made from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruthRecipe {
    /// Seed of the error functions and squareness.
    pub seed: u64,
    /// How rough the error functions are.
    pub roughness: Roughness,
    /// Rms length of the error vector over the stroke, not aligned (m).
    pub volumetric_rms_m: f64,
}

impl Default for TruthRecipe {
    fn default() -> Self {
        Self { seed: 1, roughness: Roughness::TYPICAL, volumetric_rms_m: 20e-6 }
    }
}

impl TruthRecipe {
    /// Moving bridge, bed → X → Y → Z, 800 × 600 × 600 mm; C0Y tilts Y about Z, B0Z and A0Z tilt Z.
    ///
    /// # Errors
    /// Names the key of the recipe that makes no sense.
    pub fn bridge_xyz(&self) -> Result<MachineTruth, SimulationError> {
        self.machine("bridge XYZ", [[0.0, 0.8], [0.0, 0.6], [0.0, 0.6]], [&[Axis::X, Axis::Y, Axis::Z], &[]], Axis::Y)
    }

    /// Bed → Y → X → Z, 700 × 1000 × 600 mm; C0Y tilts X about Z as in the FYXZ paper, B0Z and A0Z tilt Z.
    ///
    /// # Errors
    /// Names the key of the recipe that makes no sense.
    pub fn fyxz(&self) -> Result<MachineTruth, SimulationError> {
        self.machine("FYXZ", [[0.0, 0.7], [0.0, 1.0], [0.0, 0.6]], [&[Axis::Y, Axis::X, Axis::Z], &[]], Axis::X)
    }

    /// Y moves the table, bed → X → Z carries the tool, 500 × 400 × 300 mm; C0Y tilts Y, B0Z and A0Z tilt Z.
    ///
    /// # Errors
    /// Names the key of the recipe that makes no sense.
    pub fn moving_table(&self) -> Result<MachineTruth, SimulationError> {
        self.machine(
            "moving table Y, XZ tool",
            [[0.0, 0.5], [0.0, 0.4], [0.0, 0.3]],
            [&[Axis::X, Axis::Z], &[Axis::Y]],
            Axis::Y,
        )
    }

    /// A machine of any chain (`[tool side, workpiece side]`, both from the bed) with random errors.
    ///
    /// # Errors
    /// Names the key of the recipe or of the machine that makes no sense.
    pub fn machine(
        &self,
        name: &str,
        stroke_m: [[f64; 2]; 3],
        sides: [&[Axis]; 2],
        c0y_tilts: Axis,
    ) -> Result<MachineTruth, SimulationError> {
        self.check().map_err(|e| e.under("recipe"))?;
        let mut generator = stream(self.seed, Purpose::Machine);
        let errors = self.errors(&mut generator);
        let squareness = [("C0Y", c0y_tilts, Axis::Z), ("B0Z", Axis::Z, Axis::Y), ("A0Z", Axis::Z, Axis::X)].map(
            |(name, tilts, about)| Squareness {
                name: name.to_owned(),
                tilts,
                about,
                angle_rad: uniform(&mut generator, -SQUARENESS_RAD, SQUARENESS_RAD),
            },
        );
        let truth = MachineTruth {
            name: name.to_owned(),
            stroke_m,
            tool_side: sides[0].to_vec(),
            workpiece_side: sides[1].to_vec(),
            errors,
            squareness: squareness.to_vec(),
            // Drawn last: errors and squareness of a seed do not depend on it.
            ram_turn: RamTurn {
                angles_rad: [0; 3].map(|_| uniform(&mut generator, -RAM_TURN_RAD, RAM_TURN_RAD)),
                about_m: PROBE_M,
            },
        };
        let rms_m = volumetric_rms_m(&VirtualMachine::new(truth.clone())?, PROBE_M);
        Ok(scaled(truth, self.volumetric_rms_m / rms_m))
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_positive("volumetric_rms_m", self.volumetric_rms_m)?;
        require_not_negative("roughness.decay", self.roughness.decay)?;
        if !(1..=64).contains(&self.roughness.half_waves) {
            return Err(SimulationError::new(
                "roughness.half_waves",
                format!("{} is not in 1..=64", self.roughness.half_waves),
                "give 3 for a smooth machine, 12 for a rough one",
            ));
        }
        Ok(())
    }

    fn errors(&self, generator: &mut ChaCha8Rng) -> BTreeMap<String, Vec<Term>> {
        let mut errors = BTreeMap::new();
        for axis in ['X', 'Y', 'Z'] {
            for direction in ['X', 'Y', 'Z', 'A', 'B', 'C'] {
                let size = match direction {
                    'A' | 'B' | 'C' => ANGLE_RAD,
                    d if d == axis => POSITIONING_M,
                    _ => STRAIGHTNESS_M,
                };
                errors.insert(format!("E{direction}{axis}"), self.terms(generator, size));
            }
        }
        errors
    }

    /// Half of the shape in Chebyshev terms, half in waves, plus the bumps.
    fn terms(&self, generator: &mut ChaCha8Rng, size: f64) -> Vec<Term> {
        let rough = self.roughness;
        let mut terms = Vec::new();
        for k in 1..=rough.half_waves {
            let share = size * 0.7 * f64::from(k).powf(-rough.decay);
            terms.push(Term::Chebyshev { order: k, size: share * normal(generator) });
            terms.push(Term::Wave {
                waves: 0.5 * f64::from(k) * uniform(generator, 0.8, 1.2),
                size: share * normal(generator),
                phase_rad: uniform(generator, 0.0, std::f64::consts::TAU),
            });
        }
        for _ in 0..rough.bumps {
            terms.push(Term::Bump {
                centre: uniform(generator, 0.1, 0.9),
                width: uniform(generator, 0.08, 0.15),
                size: 0.25 * size * normal(generator),
            });
        }
        terms
    }
}

/// Rms length (m) of the error vector on an 8 × 8 × 8 grid over the stroke at one reflector offset.
pub(crate) fn volumetric_rms_m(machine: &VirtualMachine, offset_m: [f64; 3]) -> f64 {
    const STEPS: u32 = 8;
    let stroke = machine.truth().stroke_m;
    let at = |axis: usize, step: u32| {
        let [start, end] = stroke[axis];
        start + (end - start) * f64::from(step) / f64::from(STEPS - 1)
    };
    let mut total = 0.0;
    for i in 0..STEPS {
        for j in 0..STEPS {
            for k in 0..STEPS {
                let reading = [at(0, i), at(1, j), at(2, k)];
                let actual = machine.actual_point_m(reading, offset_m);
                let indicated = VirtualMachine::indicated_point_m(reading, offset_m);
                total += (0..3).map(|d| (actual[d] - indicated[d]).powi(2)).sum::<f64>();
            }
        }
    }
    (total / f64::from(STEPS.pow(3))).sqrt()
}

fn scaled(mut truth: MachineTruth, by: f64) -> MachineTruth {
    for terms in truth.errors.values_mut() {
        for term in terms.iter_mut() {
            *term = term.scaled(by);
        }
    }
    for tilt in &mut truth.squareness {
        tilt.angle_rad *= by;
    }
    truth
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shipped_truth_has_the_volumetric_error_asked_for() {
        for seed in 1..=5 {
            for rough in [Roughness::SMOOTH, Roughness::TYPICAL, Roughness::ROUGH] {
                let recipe = TruthRecipe { seed, roughness: rough, volumetric_rms_m: 20e-6 };
                for truth in [recipe.bridge_xyz(), recipe.fyxz(), recipe.moving_table()] {
                    let machine = VirtualMachine::new(truth.unwrap()).unwrap();
                    let rms_m = volumetric_rms_m(&machine, PROBE_M);
                    // Errors are linear in the scale but for rotation terms of second order: 20 µrad times 20 µm.
                    assert!((rms_m - 20e-6).abs() < 1e-9, "{rms_m}");
                }
            }
        }
    }

    #[test]
    fn a_rough_truth_has_more_waves_than_a_smooth_one() {
        let turns = |roughness| {
            let recipe = TruthRecipe { roughness, ..TruthRecipe::default() };
            let machine = VirtualMachine::new(recipe.bridge_xyz().unwrap()).unwrap();
            let values: Vec<f64> =
                (0..=200).map(|k| machine.error_value("EYX", 0.8 * f64::from(k) / 200.0).unwrap()).collect();
            values.windows(3).filter(|w| (w[1] - w[0]) * (w[2] - w[1]) < 0.0).count()
        };
        assert!(turns(Roughness::ROUGH) > turns(Roughness::SMOOTH));
    }

    #[test]
    fn a_recipe_without_waves_is_refused_by_its_key() {
        let mut recipe = TruthRecipe::default();
        recipe.roughness.half_waves = 0;
        let refused = recipe.bridge_xyz().unwrap_err();
        assert_eq!(refused.key, "recipe.roughness.half_waves");
    }
}
