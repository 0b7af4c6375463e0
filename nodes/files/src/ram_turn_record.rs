//! The turn of the ram in a model file, and what a file without one is read as.
//!
//! Place in the flow: part of [`crate::model_record`]. SI, ram frame.
//!
//! Earlier software took the ram to stand exactly as the axes do. How wrong that was, its files do not tell. So their turn
//! is read as zero with the uncertainty of a ram that nobody measured, about the middle of the offsets of the campaign: no
//! coordinate changes; with one offset its uncertainty does not either; with several it says what that fit could not know.
//! Identifying the model again tells the turn.

use abbe_geometry::model::packed;
use serde::{Deserialize, Serialize};

/// How the ram stands in the frame of the axes: it takes the offset o to c + R(turn) (o - c).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RamTurnRecord {
    /// About X, Y and Z.
    pub(crate) angles_rad: [f64; 3],
    /// The offset c that stays where it is (ram frame).
    pub(crate) about_offset_m: [f64; 3],
}

impl RamTurnRecord {
    /// Of a file that knows none: zero, about the middle of the offsets it was identified with.
    pub(crate) fn unknown(offset_m: &[(f64, f64); 3]) -> RamTurnRecord {
        let middle = |(low_m, high_m): (f64, f64)| low_m + 0.5 * (high_m - low_m);
        RamTurnRecord { angles_rad: [0.0; 3], about_offset_m: offset_m.map(middle) }
    }
}

/// A packed lower triangle with three more parameters of these variances, which depend on no other, before the parameter
/// `first`. What is no triangle, or too small, comes back as it is, and is refused where its length is checked.
pub(crate) fn with_three_more(triangle: &[f64], first: usize, variances: [f64; 3]) -> Vec<f64> {
    let size = (0..).take_while(|n| n * (n + 1) / 2 < triangle.len()).count();
    if size * (size + 1) / 2 != triangle.len() || first > size {
        return triangle.to_vec();
    }
    let before = |k: usize| if k < first { Some(k) } else { k.checked_sub(3).filter(|k| *k >= first) };
    let entry = |row: usize, column: usize| match (before(row), before(column)) {
        (Some(i), Some(j)) => triangle[packed(i, j)],
        _ if row == column => variances[row - first],
        _ => 0.0,
    };
    (0..size + 3).flat_map(|row| (0..=row).map(move |column| (row, column))).map(|(i, j)| entry(i, j)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_parameters_go_between_the_others() {
        // Rows 1 | 2 3 | 4 5 6 with three new ones after the second.
        let found = with_three_more(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2, [7.0, 8.0, 9.0]);
        let rows: [&[f64]; 6] = [
            &[1.0],
            &[2.0, 3.0],
            &[0.0, 0.0, 7.0],
            &[0.0, 0.0, 0.0, 8.0],
            &[0.0, 0.0, 0.0, 0.0, 9.0],
            &[4.0, 5.0, 0.0, 0.0, 0.0, 6.0],
        ];
        assert_eq!(found, rows.concat());
        assert_eq!(with_three_more(&[1.0, 2.0], 1, [1.0; 3]), [1.0, 2.0], "no triangle");
        assert_eq!(with_three_more(&[1.0], 2, [1.0; 3]), [1.0], "too small");
    }
}
