//! Error fields to interpolate.
//!
//! Place in the flow: the truth of [`super::interpolation`]. Two kinds, so that no method is judged on its own assumptions
//! only: fields of a virtual machine (18 error functions and squareness), and random fields of a given correlation length
//! (sums of waves with normal wave vectors: squared exponential covariance). Points in m, errors in µm.

use super::setup::{normal_vector, published_volume};
use abbe_virtual_machine::machine::Roughness;
use abbe_virtual_machine::{SimulationError, TruthRecipe, VirtualMachine};
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// Waves of a random field, each direction.
const WAVES: usize = 100;
/// Where the published volume begins in the stroke of the virtual machine (m).
const IN_STROKE_M: Vector3<f64> = Vector3::new(0.2, 0.15, 0.175);
/// Reflector on a vertical ram (m).
const OFFSET_M: [f64; 3] = [0.0, 0.0, -0.06];

/// A true error field.
pub(super) enum Field {
    /// Of a machine.
    Machine(Box<VirtualMachine>),
    /// Waves: vector (rad/m), phase (rad), amplitude by direction.
    Waves(Vec<(Vector3<f64>, f64, Vector3<f64>)>),
}

impl Field {
    /// Field of a random machine.
    pub(super) fn machine(seed: u64, roughness: Roughness) -> Result<Field, SimulationError> {
        let recipe = TruthRecipe { seed, roughness, ..TruthRecipe::default() };
        Ok(Field::Machine(Box::new(VirtualMachine::new(recipe.bridge_xyz()?)?)))
    }

    /// Random field of that correlation length (m).
    pub(super) fn waves(seed: u64, length_m: f64) -> Field {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut wave = || {
            let vector = normal_vector(&mut random) / length_m;
            (vector, random.random_range(0.0..TAU), normal_vector(&mut random))
        };
        Field::Waves((0..WAVES).map(|_| wave()).collect())
    }

    /// Error at a point of the published volume (µm, in a scale of its own).
    pub(super) fn error_um(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Field::Machine(machine) => {
                let reading_m: [f64; 3] = (point_m - published_volume().lower_m + IN_STROKE_M).into();
                let actual = Vector3::from(machine.actual_point_m(reading_m, OFFSET_M));
                (actual - Vector3::from(VirtualMachine::indicated_point_m(reading_m, OFFSET_M))) * 1e6
            }
            Field::Waves(waves) => {
                let of = |(vector, phase, amplitude): &(Vector3<f64>, f64, Vector3<f64>)| {
                    amplitude * (vector.dot(point_m) + phase).cos()
                };
                waves.iter().map(of).sum()
            }
        }
    }
}
