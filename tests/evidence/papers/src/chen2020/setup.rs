//! The set-up of the paper: stations, volume, points, noise.
//!
//! Place in the flow: what [`super::stations`] and [`super::interpolation`] simulate. Metres, machine frame. The paper gives
//! the stations, the size of the volume and the number of points; where volume and points lie stands only in a picture.

use nalgebra::Vector3;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Stations of Table 1 (m).
pub(super) const STATIONS_M: [[f64; 3]; 6] = [
    [-0.05, -0.07, -0.62],
    [0.52, -0.05, -0.47],
    [0.52, 1.3, -0.62],
    [-0.04, 1.25, -0.47],
    [0.07, -0.07, -0.62],
    [-0.06, 0.04, -0.62],
];
/// Points.
pub(super) const POINTS: usize = 92;
/// Steps of the lattice that 65 % of the points fill: 5 x 4 x 3 points, 100 x 100 x 125 mm apart.
const STEPS: [usize; 3] = [4, 3, 2];
/// Deviation of the machine's random error, each coordinate (m).
pub(super) const MACHINE_M: f64 = 3e-6;
/// Deviation of a range (m).
pub(super) const RANGE_M: f64 = 0.5e-6;

/// A box in the machine frame (m).
#[derive(Debug, Clone, Copy)]
pub(super) struct Volume {
    pub(super) lower_m: Vector3<f64>,
    pub(super) size_m: Vector3<f64>,
}

/// 400 x 300 x 250 mm in the middle of the stations, above them.
pub(super) fn published_volume() -> Volume {
    Volume { lower_m: Vector3::new(0.035, 0.455, -0.4), size_m: Vector3::new(0.4, 0.3, 0.25) }
}

/// The space between the stations, in which a machine of that size moves.
pub(super) fn whole_volume() -> Volume {
    Volume { lower_m: Vector3::new(0.0, 0.0, -0.4), size_m: Vector3::new(0.47, 1.2, 0.4) }
}

impl Volume {
    fn at(&self, share: Vector3<f64>) -> Vector3<f64> {
        self.lower_m + self.size_m.component_mul(&share)
    }

    /// The lattice of 60 points, x fastest (m).
    pub(super) fn lattice(&self) -> Vec<Vector3<f64>> {
        let [nx, ny, nz] = STEPS;
        let share = |k: usize, n: usize| k as f64 / n as f64;
        let node = |k: usize| {
            Vector3::new(
                share(k % (nx + 1), nx),
                share(k / (nx + 1) % (ny + 1), ny),
                share(k / (nx + 1) / (ny + 1), nz),
            )
        };
        (0..(nx + 1) * (ny + 1) * (nz + 1)).map(|k| self.at(node(k))).collect()
    }

    /// Points anywhere in it (m).
    pub(super) fn scatter(&self, count: usize, random: &mut ChaCha8Rng) -> Vec<Vector3<f64>> {
        (0..count).map(|_| self.at(Vector3::from_fn(|_, _| random.random_range(0.0..1.0)))).collect()
    }

    /// The lattice, and the rest of the 92 points between its nodes (m).
    pub(super) fn points(&self, random: &mut ChaCha8Rng) -> Vec<Vector3<f64>> {
        let mut points = self.lattice();
        points.extend(self.scatter(POINTS - points.len(), random));
        points
    }
}

/// A standard normal number.
pub(super) fn normal(random: &mut ChaCha8Rng) -> f64 {
    random.sample(StandardNormal)
}

/// A vector of standard normal numbers.
pub(super) fn normal_vector(random: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| normal(random))
}
