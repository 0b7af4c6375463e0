//! Eq. 11 and 12: how the point moves when both angles of the head are off by the same small amount.
//!
//! Place in the flow: rows of [`super::figures`]. The printed columns are held against differences of R_C·R_A itself (eq. 1).

use crate::figure::{Figure, Verdict};
use abbe_measurement::probe_pose::head_in_machine;
use nalgebra::Vector3;

/// Step of the differences (rad) and how far they may be from a right formula: their error is of the order of its square.
const STEP_RAD: f64 = 1e-5;
const EXACT: f64 = 1e-9;
/// A pose in which no two formulas agree by chance (rad).
const POSE_RAD: [f64; 2] = [0.7, 0.4];

type Formula = fn(f64, f64) -> [f64; 3];

/// Columns of eq. 11 by component of d·R_p + T_p, as printed; eq. 12 repeats the last with another sign of y.
const PRINTED: [(&str, usize, Formula); 4] = [
    ("eq. 11, column of dl + x_p", 0, |_, c| [-c.sin(), c.cos(), 0.0]),
    ("eq. 11, column of dm + y_p", 1, |a, c| [(c + a).sin(), (c + a).sin(), a.cos()]),
    ("eq. 11, column of dn + z_p", 2, |a, c| [(c + a).sin(), (c + a).cos(), a.sin()]),
    ("eq. 12", 2, |a, c| [(c + a).sin(), -(c + a).cos(), a.sin()]),
];
/// What differences give.
const FOUND: [(&str, Formula); 3] = [
    ("(-sin C, cos C, 0)", |_, c| [-c.sin(), c.cos(), 0.0]),
    ("(-cos(C + A), -sin(C + A), cos A)", |a, c| [-(c + a).cos(), -(c + a).sin(), a.cos()]),
    ("(sin(C + A), -cos(C + A), -sin A)", |a, c| [(c + a).sin(), -(c + a).cos(), -a.sin()]),
];

/// Column of the derivative of R_C·R_A by a common angle.
fn column(k: usize) -> Vector3<f64> {
    let [a, c] = POSE_RAD;
    let (above, below) = (head_in_machine(a + STEP_RAD, c + STEP_RAD), head_in_machine(a - STEP_RAD, c - STEP_RAD));
    ((above - below) / (2.0 * STEP_RAD)).column(k).into_owned()
}

fn agrees(formula: Formula, k: usize) -> bool {
    let [a, c] = POSE_RAD;
    (Vector3::from(formula(a, c)) - column(k)).norm() < EXACT
}

pub(super) fn figures() -> Vec<Figure> {
    let row = |(place, k, printed): &(&'static str, usize, Formula)| {
        let is_right = agrees(*printed, *k);
        let (words, found) = FOUND[*k];
        Figure {
            place,
            what: "motion of the point by a common error of A and C (m/rad, per metre)".to_owned(),
            published: Some(
                ["(-sin C, cos C, 0)", "(sin(C + A), sin(C + A), cos A)", "(sin(C + A), cos(C + A), sin A)"]
                    .get(*k)
                    .filter(|_| *place != "eq. 12")
                    .map_or_else(|| "(sin(C + A), -cos(C + A), sin A)".to_owned(), |text| (*text).to_owned()),
            ),
            reproduced: if agrees(found, *k) { words.to_owned() } else { "another form".to_owned() },
            how: format!("differences of the matrix of eq. 1 at A = {} and C = {} rad", POSE_RAD[0], POSE_RAD[1]),
            verdict: if is_right { Verdict::Reproduced } else { Verdict::DoesNotFollow },
            reason: if is_right {
                "derivative of eq. 1".to_owned()
            } else {
                "not the derivative of eq. 1: signs or functions are misprinted; the compensation of eq. 13 does not use it".to_owned()
            },
        }
    };
    PRINTED.iter().map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_zhang_2016_three_columns_of_the_error_model_are_misprinted() {
        let verdicts: Vec<Verdict> = figures().iter().map(|figure| figure.verdict).collect();
        use Verdict::{DoesNotFollow, Reproduced};
        assert_eq!(verdicts, [Reproduced, DoesNotFollow, DoesNotFollow, DoesNotFollow]);
        assert!((0..3).all(|k| agrees(FOUND[k].1, k)));
    }
}
