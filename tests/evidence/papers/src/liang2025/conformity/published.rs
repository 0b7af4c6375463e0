//! Liang 2025, Table 2: the deviations as published.
//!
//! Place in the flow: data of [`super`]; the same figures are shipped in `launch-config/data/liang2025_lengths.csv` and
//! `liang2025_sphere.csv`, and a test holds the two against each other. The labels of the table are out of order in the text
//! at hand. By their values seven blocks are gauge lengths, three of them labelled X, Y, Z, so that the others are the four
//! diagonals; which of the paper's diagonals 1 to 4 each is cannot be told.

/// Lengths of the gauge blocks (mm).
pub(super) const GAUGES_MM: [f64; 6] = [19.9932, 100.0177, 179.9895, 260.0388, 340.0179, 420.0];

/// Measuring lines: name, travel along it of a machine of 800 x 600 x 600 mm (mm), and for each gauge the three deviations,
/// measured − calibrated (µm).
pub(super) const LINES: [(&str, f64, [[f64; 3]; 6]); 7] = [
    (
        "X",
        800.0,
        [
            [0.19, 0.04, 0.03],
            [0.02, 0.04, -0.11],
            [0.19, 0.03, 0.09],
            [0.01, 0.01, -0.05],
            [0.1, 0.04, 0.19],
            [0.24, 0.2, 0.16],
        ],
    ),
    (
        "Y",
        600.0,
        [
            [-0.18, -0.16, -0.07],
            [-0.19, -0.18, -0.15],
            [-0.32, -0.22, -0.28],
            [-0.31, -0.24, -0.27],
            [-0.45, -0.38, -0.3],
            [-0.37, -0.48, -0.44],
        ],
    ),
    (
        "Z",
        600.0,
        [
            [0.08, 0.03, 0.03],
            [-0.19, -0.18, -0.19],
            [-0.1, -0.07, -0.15],
            [-0.38, -0.25, -0.25],
            [-0.32, -0.2, -0.31],
            [-0.38, -0.19, -0.2],
        ],
    ),
    (
        "diagonal_a",
        1166.19,
        [
            [-0.08, -0.2, -0.15],
            [-0.16, -0.1, -0.06],
            [-0.39, -0.45, -0.33],
            [-0.27, -0.25, -0.27],
            [-0.21, -0.29, -0.25],
            [-0.22, -0.23, -0.22],
        ],
    ),
    (
        "diagonal_b",
        1166.19,
        [
            [-0.17, -0.12, -0.02],
            [-0.03, -0.05, -0.14],
            [-0.22, -0.21, -0.35],
            [-0.17, -0.19, -0.25],
            [-0.3, -0.2, -0.08],
            [-0.21, -0.28, -0.35],
        ],
    ),
    (
        "diagonal_c",
        1166.19,
        [
            [-0.15, -0.08, -0.04],
            [-0.12, -0.11, -0.18],
            [-0.35, -0.39, -0.31],
            [-0.36, -0.29, -0.35],
            [-0.34, -0.36, -0.36],
            [-0.45, -0.44, -0.42],
        ],
    ),
    (
        "diagonal_d",
        1166.19,
        [
            [-0.03, -0.09, 0.02],
            [-0.19, -0.15, -0.18],
            [-0.26, -0.18, -0.15],
            [-0.35, -0.19, -0.49],
            [-0.57, -0.45, -0.44],
            [-0.57, -0.48, -0.58],
        ],
    ),
];

/// Rows labelled reference sphere: what the paper calls nominal (mm), and three deviations (µm).
pub(super) const SPHERE: [(f64, [f64; 3]); 4] = [
    (29.9736, [0.19, 0.19, 0.15]),
    (29.97374, [0.27, 0.2, 0.12]),
    (29.97369, [0.24, 0.17, 0.15]),
    (29.97377, [0.26, 0.35, 0.24]),
];

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of a shipped file, cells as text.
    fn rows(text: &'static str) -> Vec<Vec<&'static str>> {
        let rows = text.lines().filter(|line| !line.starts_with('#')).skip(1);
        rows.map(|line| line.split(',').collect()).collect()
    }

    fn number(cell: &str) -> f64 {
        cell.parse().unwrap()
    }

    #[test]
    fn lengths_are_those_of_the_shipped_file() {
        let shipped = rows(include_str!("../../../../../../launch-config/data/liang2025_lengths.csv"));
        assert_eq!(shipped.len(), 126);
        for (k, row) in shipped.iter().enumerate() {
            let (line, gauge, repeat) = (k / 18, k / 3 % 6, k % 3);
            let (name, travel_mm, deviations_um) = &LINES[line];
            assert_eq!((row[0], number(row[1]), number(row[2])), (*name, *travel_mm, GAUGES_MM[gauge]), "{row:?}");
            assert_eq!(
                (number(row[3]), number(row[4])),
                (repeat as f64 + 1.0, deviations_um[gauge][repeat]),
                "{row:?}"
            );
        }
    }

    #[test]
    fn sphere_rows_are_those_of_the_shipped_file() {
        let shipped = rows(include_str!("../../../../../../launch-config/data/liang2025_sphere.csv"));
        assert_eq!(shipped.len(), 12);
        for (k, row) in shipped.iter().enumerate() {
            let (diameter_mm, deviations_um) = SPHERE[k / 3];
            assert_eq!((number(row[1]), number(row[3])), (diameter_mm, deviations_um[k % 3]), "{row:?}");
        }
    }
}
