//! A bridge machine without errors, and normal deviates, for studies of vectors that a test makes up.

use abbe_geometry::Axis;
use abbe_geometry::machine::{Joint, Machine, Side, Squareness, USUAL_RAM_TURN_RAD};
use abbe_geometry::rotation::RotationForm;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

pub(crate) fn machine() -> Machine {
    let tilt = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
    Machine {
        name: "bridge".to_owned(),
        frame_id: "machine".to_owned(),
        joints: Axis::ALL.map(|axis| Joint { axis, side: Side::Tool }),
        stroke_m: [(0.0, 0.8), (0.0, 0.6), (0.0, 0.6)],
        squareness: [tilt("C0Y", Axis::Y, Axis::Z), tilt("B0Z", Axis::Z, Axis::Y), tilt("A0Z", Axis::Z, Axis::X)],
        rotation: RotationForm::Exact,
        kinds: [None; 18],
        repeatability_m: [0.25e-6; 3],
        u_ram_turn_rad: [USUAL_RAM_TURN_RAD; 3],
        default_offset_m: None,
    }
}

pub(crate) fn normal(generator: &mut ChaCha8Rng) -> f64 {
    let (a, b): (f64, f64) = (generator.random(), generator.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
}
