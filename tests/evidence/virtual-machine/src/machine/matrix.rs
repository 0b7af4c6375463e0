//! 4 × 4 homogeneous transforms of this crate's own kinematics: lengths in m, angles in rad.
//!
//! Place in the flow: the virtual machine multiplies one of these per joint. Written out plainly and apart
//! from any other kinematics of the project, because it is the truth those are tested against.

/// A rigid transform as a row-major homogeneous matrix.
pub(crate) type Homogeneous = [[f64; 4]; 4];

/// The transform that changes nothing.
pub(crate) const IDENTITY: Homogeneous =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

/// `a` after `b`: the product a·b.
pub(crate) fn product(a: &Homogeneous, b: &Homogeneous) -> Homogeneous {
    let mut out = [[0.0; 4]; 4];
    for row in 0..4 {
        for column in 0..4 {
            out[row][column] = (0..4).map(|k| a[row][k] * b[k][column]).sum();
        }
    }
    out
}

/// Translation by a vector (m).
pub(crate) fn translation(by_m: [f64; 3]) -> Homogeneous {
    let mut out = IDENTITY;
    for row in 0..3 {
        out[row][3] = by_m[row];
    }
    out
}

/// Exact rotation by a rotation vector (rad): exp(\[v\]×), by Rodrigues' formula.
pub(crate) fn rotation(vector_rad: [f64; 3]) -> Homogeneous {
    let [a, b, c] = vector_rad;
    let angle = (a * a + b * b + c * c).sqrt();
    // 2 sin²(θ/2)/θ² instead of (1 − cos θ)/θ²: the latter cancels to nothing at a few microradians.
    let (first, second) = if angle > 0.0 {
        let half = (0.5 * angle).sin();
        (angle.sin() / angle, 2.0 * half * half / (angle * angle))
    } else {
        (1.0, 0.5)
    };
    let skew = [[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]];
    let mut out = IDENTITY;
    for row in 0..3 {
        for column in 0..3 {
            let squared: f64 = (0..3).map(|k| skew[row][k] * skew[k][column]).sum();
            out[row][column] += first * skew[row][column] + second * squared;
        }
    }
    out
}

/// The point (m) moved by the transform.
pub(crate) fn apply(transform: &Homogeneous, point_m: [f64; 3]) -> [f64; 3] {
    let mut out = [0.0; 3];
    for row in 0..3 {
        let turned: f64 = (0..3).map(|k| transform[row][k] * point_m[k]).sum();
        out[row] = turned + transform[row][3];
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_quarter_turn_about_z_takes_x_to_y() {
        let quarter = rotation([0.0, 0.0, std::f64::consts::FRAC_PI_2]);
        let turned = apply(&quarter, [1.0, 0.0, 0.0]);
        for (found, wanted) in turned.iter().zip([0.0, 1.0, 0.0]) {
            assert!((found - wanted).abs() < 1e-15, "{turned:?}");
        }
    }

    #[test]
    fn a_rotation_of_microradians_is_orthogonal_to_rounding() {
        let r = rotation([11e-6, -7e-6, 19e-6]);
        for i in 0..3 {
            for j in 0..3 {
                let dot: f64 = (0..3).map(|k| r[k][i] * r[k][j]).sum();
                let wanted = if i == j { 1.0 } else { 0.0 };
                // Three products of numbers near 1: a few units in the last place.
                assert!((dot - wanted).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn turning_about_a_shifted_pivot_is_a_product_of_three() {
        let pivot = [0.3, -0.2, 0.5];
        let back = [-0.3, 0.2, -0.5];
        let about = product(&product(&translation(pivot), &rotation([0.1, 0.2, -0.3])), &translation(back));
        let kept = apply(&about, pivot);
        for axis in 0..3 {
            assert!((kept[axis] - pivot[axis]).abs() < 1e-15);
        }
    }
}
