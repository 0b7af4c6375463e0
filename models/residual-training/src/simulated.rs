//! Residual fields of several characters, from a seed: the ground that methods are compared on.
//!
//! Place in the flow: seed in, residual at any point (m, machine frame) and measured sets out. What is left after a geometric
//! model is at most a few micrometres; no published data of such fields exist, so the characters are chosen to be each
//! method's friend in turn.
//!
//! | character | residual |
//! |---|---|
//! | smooth | waves of half to twice the volume, in all directions |
//! | sharp | the same, a step across an oblique plane, and a bump the size of a fixture |
//! | anisotropic | waves of 60 to 150 mm along x (a scale, a ball screw), slow across |
//! | noisy | smooth, under noise as large as the signal |

use abbe_field::{FieldError, MeasuredField, POSITION, Samples};
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Volume of Liang 2025 (m).
pub const VOLUME_M: [f64; 3] = [0.8, 0.6, 0.6];
/// Deviation of the smooth part (m).
const SIGNAL_M: f64 = 1e-6;
/// Noise of a measured residual (m), and that of the noisy character.
const NOISE_M: f64 = 0.1e-6;
const LARGE_NOISE_M: f64 = 1e-6;
/// Waves a component.
const WAVES: usize = 6;

/// Character of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Character {
    /// Long waves.
    Smooth,
    /// Long waves, a step and a bump.
    Sharp,
    /// Short waves along one axis.
    Anisotropic,
    /// Long waves under large noise.
    Noisy,
}

impl Character {
    /// All of them.
    pub const ALL: [Character; 4] = [Character::Smooth, Character::Sharp, Character::Anisotropic, Character::Noisy];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Character::Smooth => "smooth",
            Character::Sharp => "sharp",
            Character::Anisotropic => "anisotropic",
            Character::Noisy => "noisy",
        }
    }
}

/// One field.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedField {
    waves: Vec<Wave>,
    step: Option<Step>,
    noise_m: f64,
}

#[derive(Debug, Clone, PartialEq)]
struct Wave {
    amplitude_m: Vector3<f64>,
    per_m: Vector3<f64>,
    phase: f64,
}

/// A step across a plane, and a bump.
#[derive(Debug, Clone, PartialEq)]
struct Step {
    height_m: Vector3<f64>,
    normal: Vector3<f64>,
    bump_m: Vector3<f64>,
    centre_m: Vector3<f64>,
}

/// Width of a step, and of a bump (m).
const STEP_WIDTH_M: f64 = 0.005;
const BUMP_WIDTH_M: f64 = 0.06;

impl SimulatedField {
    /// A field of this character.
    pub fn new(character: Character, seed: u64) -> SimulatedField {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = |size: f64| Vector3::from_fn(|_, _| draw(&mut random) * size);
        let mut waves = Vec::new();
        for _ in 0..WAVES {
            let direction = normal(1.0).normalize();
            let amplitude_m = normal(SIGNAL_M * (2.0 / WAVES as f64).sqrt());
            let [length, phase] = [0.4 + 1.2 * normal(1.0).x.abs().min(1.0), normal(1.0).x * TAU];
            waves.push(Wave { amplitude_m, per_m: direction / length, phase });
        }
        if character == Character::Anisotropic {
            for wave in &mut waves {
                let length_m = 0.06 + 0.09 * normal(1.0).x.abs().min(1.0);
                wave.per_m = Vector3::new(1.0 / length_m, wave.per_m.y * 0.3, wave.per_m.z * 0.3);
            }
        }
        let step = (character == Character::Sharp).then(|| Step {
            height_m: normal(SIGNAL_M),
            normal: normal(1.0).normalize(),
            bump_m: normal(2.0 * SIGNAL_M),
            centre_m: Vector3::from(VOLUME_M) / 2.0 + normal(0.12),
        });
        let noise_m = if character == Character::Noisy { LARGE_NOISE_M } else { NOISE_M };
        SimulatedField { waves, step, noise_m }
    }

    /// The residual itself at a point (m, machine frame), without noise (m).
    pub fn residual_m(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        let wave = |w: &Wave| w.amplitude_m * (TAU * w.per_m.dot(point_m) + w.phase).sin();
        let smooth = self.waves.iter().map(wave).sum::<Vector3<f64>>();
        let Some(step) = &self.step else { return smooth };
        let across = (point_m - Vector3::from(VOLUME_M) / 2.0).dot(&step.normal);
        let away = (point_m - step.centre_m).norm_squared() / (2.0 * BUMP_WIDTH_M * BUMP_WIDTH_M);
        smooth + step.height_m * (across / STEP_WIDTH_M).tanh() + step.bump_m * (-away).exp()
    }

    /// The residual measured at points (m), with noise.
    pub fn measured(&self, points_m: Vec<Vector3<f64>>, seed: u64) -> Result<Samples, FieldError> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut noise = || Vector3::from_fn(|_, _| draw(&mut random) * self.noise_m);
        let residuals = points_m.iter().map(|p| self.residual_m(p) + noise()).collect();
        Ok(Samples::from(&MeasuredField::new(points_m, residuals, None)?))
    }

    /// The residual measured at points (m) where a further input of this name has these values; it is multiplied by `factor` of the
    /// value.
    pub fn measured_with(
        &self,
        points_m: &[Vector3<f64>],
        (name, values): (&str, &[f64]),
        factor: impl Fn(f64) -> f64,
        seed: u64,
    ) -> Result<Samples, FieldError> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut noise = || Vector3::from_fn(|_, _| draw(&mut random) * self.noise_m);
        let residuals =
            points_m.iter().zip(values).map(|(p, value)| self.residual_m(p) * factor(*value) + noise()).collect();
        let names = POSITION.into_iter().chain([name]).map(str::to_owned).collect();
        let at = points_m.iter().zip(values).flat_map(|(p, value)| [p.x, p.y, p.z, *value]).collect();
        Samples::new(names, at, residuals, None)
    }
}

/// Points at random in the volume (m).
pub fn random_points_m(count: usize, seed: u64) -> Vec<Vector3<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..count).map(|_| Vector3::from_fn(|axis, _| random.random::<f64>() * VOLUME_M[axis])).collect()
}

fn draw(random: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(random)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn characters_differ_as_their_names_say() {
        let points = random_points_m(400, 1);
        let roughness = |character, direction: Vector3<f64>| {
            let field = SimulatedField::new(character, 3);
            let change = |p: &Vector3<f64>| (field.residual_m(&(p + direction * 0.02)) - field.residual_m(p)).norm();
            points.iter().map(change).fold(0.0, f64::max)
        };
        let x = Vector3::x();
        assert!(roughness(Character::Sharp, x) > 2.0 * roughness(Character::Smooth, x));
        assert!(roughness(Character::Anisotropic, x) > 3.0 * roughness(Character::Anisotropic, Vector3::y()));
        let noise = |character| {
            let field = SimulatedField::new(character, 3);
            let measured = field.measured(points.clone(), 5).unwrap();
            let differences =
                points.iter().zip(measured.errors_m()).map(|(p, r)| (field.residual_m(p) - r).norm_squared());
            (differences.sum::<f64>() / 1200.0).sqrt()
        };
        assert!((noise(Character::Smooth) / NOISE_M - 1.0).abs() < 0.1);
        assert!((noise(Character::Noisy) / LARGE_NOISE_M - 1.0).abs() < 0.1);
    }
}
