//! What a correction is worth at points whose actual places are known.
//!
//! The frame of the actual places is another: six small figures (shift and turn) are fitted by least squares, with a
//! solver of its own, before errors are counted.

use super::vector::{Vector, add, cross, minus};

/// A point as corrected: position (m), standard uncertainties (m), actual place (m).
pub(crate) struct Corrected {
    pub(crate) position_m: Vector,
    pub(crate) u_m: Vector,
    pub(crate) actual_m: Vector,
}

/// Error and honesty of a set of points.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Worth {
    /// 3-D error (rms, m).
    pub(crate) rms_m: f64,
    /// Share of coordinates within 1.96 standard uncertainties.
    pub(crate) covered: f64,
    /// The same of the worst axis.
    pub(crate) worst_axis: f64,
    /// Mean of what is stated for a coordinate (k = 2, rms, m).
    pub(crate) stated_m: f64,
}

pub(crate) fn worth(points: &[Corrected]) -> Worth {
    let errors: Vec<Vector> = points.iter().map(|p| minus(p.position_m, p.actual_m)).collect();
    let places: Vec<Vector> = points.iter().map(|p| p.actual_m).collect();
    let motion = rigid(&places, &errors);
    let mut inside = [0_usize; 3];
    let (mut square, mut stated) = (0.0, 0.0);
    for (point, error) in points.iter().zip(&errors) {
        let left = minus(*error, moved(&motion, point.actual_m));
        for d in 0..3 {
            square += left[d] * left[d];
            stated += point.u_m[d] * point.u_m[d];
            inside[d] += usize::from(left[d].abs() <= 1.96 * point.u_m[d]);
        }
    }
    let count = points.len() as f64;
    let shares = inside.map(|n| n as f64 / count);
    Worth {
        rms_m: (square / count).sqrt(),
        covered: shares.iter().sum::<f64>() / 3.0,
        worst_axis: shares.into_iter().fold(1.0, f64::min),
        stated_m: 2.0 * (stated / (3.0 * count)).sqrt(),
    }
}

fn moved(motion: &[f64; 6], place_m: Vector) -> Vector {
    add([motion[0], motion[1], motion[2]], cross([motion[3], motion[4], motion[5]], place_m))
}

/// Shift and turn that follow these errors best.
fn rigid(places: &[Vector], errors: &[Vector]) -> [f64; 6] {
    let mut system = [[0.0; 7]; 6];
    for (place, error) in places.iter().zip(errors) {
        for d in 0..3 {
            let partial = |k: usize| {
                let mut unit = [0.0; 6];
                unit[k] = 1.0;
                moved(&unit, *place)[d]
            };
            let row: [f64; 6] = std::array::from_fn(partial);
            for i in 0..6 {
                (0..6).for_each(|j| system[i][j] += row[i] * row[j]);
                system[i][6] += row[i] * error[d];
            }
        }
    }
    // Gauss and Jordan; the system is positive definite.
    for k in 0..6 {
        let pivot = system[k];
        for i in (0..6).filter(|i| *i != k) {
            let factor = system[i][k] / pivot[k];
            (0..7).for_each(|j| system[i][j] -= factor * pivot[j]);
        }
    }
    std::array::from_fn(|k| system[k][6] / system[k][k])
}
