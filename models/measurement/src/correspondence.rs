//! Whether measured positions are those of the points that the scales say, and what is mixed up where they are not.
//!
//! Place in the flow: before positions are fitted, compared or learnt from; one check for all who take them. Input: readings
//! and offsets (m, machine frame), measured positions (m, any right-handed frame). After the best rigid alignment a machine
//! leaves fractions of a millimetre; exchanged or mirrored columns, another unit and shifted rows leave far more. Each of
//! these mistakes is undone on trial, and those that leave a machine's error are named, all of them.

use crate::alignment::{AlignmentError, RigidAlignment};
use crate::robust::median;
use nalgebra::Vector3;
use std::collections::BTreeMap;
use thiserror::Error;

/// Distance (m) between measured and nominal point after alignment that no machine worth correcting has.
const PLAUSIBLE_M: f64 = 1e-3;
/// Distance (m) within which no machine stands at every point: such positions are a copy.
const COPIED_M: f64 = 1e-9;
/// Alignments without the points that lie far off.
const PASSES: usize = 8;
/// Median length (m) of residual vectors that no corrected machine leaves, and below which nobody could have measured them.
const LEFT_AFTER_CORRECTION_M: f64 = 1e-4;
const MEASURABLE_M: f64 = 5e-9;
/// Times the median distance from which a point takes no part in the alignment.
const FAR: f64 = 5.0;
/// Points named in a message.
const NAMED: usize = 5;
/// Factors that bring another unit to the one of the column.
const UNITS: [(f64, &str); 6] = [
    (1e3, "a thousand times too small: they are in metres, or metres stand for millimetres"),
    (1e-3, "a thousand times too large: they are in micrometres, or micrometres stand for millimetres"),
    (25.4, "25.4 times too small: they are in inches"),
    (1.0 / 25.4, "25.4 times too large: the readings are in inches"),
    (10.0, "ten times too small: they are in centimetres"),
    (0.1, "ten times too large: the readings are in centimetres"),
];

/// A point as the scales say, and where it was measured (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// Indicated axis positions X, Y, Z.
    pub reading_m: [f64; 3],
    /// Offset of tip or reflector from the ram reference point.
    pub offset_m: [f64; 3],
    /// Measured position, any right-handed frame.
    pub actual_m: Vector3<f64>,
}

impl Pair {
    fn nominal_m(&self) -> Vector3<f64> {
        Vector3::from(self.reading_m) + Vector3::from(self.offset_m)
    }
}

/// The first row that is a copy of an earlier one, with that: places in the list, the earlier first. Readings repeated on the machine differ
/// by its noise.
pub fn copied<R: Ord>(rows: impl IntoIterator<Item = R>) -> Option<(usize, usize)> {
    let mut seen = BTreeMap::new();
    rows.into_iter().enumerate().find_map(|(k, row)| seen.insert(row, k).map(|first| (first, k)))
}

/// Why measured positions do not belong to the readings.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum CorrespondenceError {
    /// Points that cannot be aligned.
    #[error(transparent)]
    Alignment(#[from] AlignmentError),
    /// The readings themselves.
    #[error(
        "all {0} measured positions are where the scales say, to a nanometre: no machine stands there, so they are a copy and no \
         measurement; write where another instrument found each point"
    )]
    Copied(usize),
    /// Another shape.
    #[error(
        "half of the measured positions lie {median_mm:.3} mm or more from where the scales say, after the best rigid \
         alignment; no machine error is that large: {}",
        mistakes(.causes)
    )]
    OtherShape {
        /// Median distance (mm).
        median_mm: f64,
        /// Mistakes that would explain it.
        causes: Vec<String>,
    },
    /// Single points far off.
    #[error(
        "{} of {all} measured positions lie more than {limit_mm} mm from where the scales say, after the best rigid alignment of \
         the others, no machine error is that large: {}; look for rows that are mixed up, a wrong offset or a lost beam there, and \
         correct or remove them",
        .far.len(),
        named(.far)
    )]
    FarPoints {
        /// Number of the point, from 1, and its distance (mm), farthest first.
        far: Vec<(usize, f64)>,
        /// Points.
        all: usize,
        /// Distance (mm) from which a point counts as far.
        limit_mm: f64,
    },
}

/// Vectors of error of a size that cannot be.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum VectorSizeError {
    /// Too large.
    #[error(
        "half of the errors are {median_mm:.3} mm or larger; {whose} leaves less than {limit_mm} mm: check the unit of their \
         columns (micrometres, millimetres and metres differ by a thousand), and that they are errors, not positions"
    )]
    TooLarge {
        /// Median length (mm).
        median_mm: f64,
        /// What none of which has it.
        whose: &'static str,
        /// Length that is believed (mm).
        limit_mm: f64,
    },
    /// Too small.
    #[error(
        "half of the errors are below {median_nm:.2e} nm, less than can be measured: check the unit of their columns \
         (micrometres, millimetres and metres differ by a thousand)"
    )]
    TooSmall {
        /// Median length (nm).
        median_nm: f64,
    },
}

/// Refuses vectors of error (m) of a size that no machine has. Those that are left `after_correction` are smaller than those of
/// a machine as it is.
///
/// # Errors
/// Half of them too large or too small.
pub fn check_vectors(vectors_m: &[Vector3<f64>], after_correction: bool) -> Result<(), VectorSizeError> {
    let median_m = typical(&vectors_m.iter().map(Vector3::norm).collect::<Vec<_>>());
    let (whose, limit_m) = match after_correction {
        true => ("a corrected machine", LEFT_AFTER_CORRECTION_M),
        false => ("a machine worth correcting", PLAUSIBLE_M),
    };
    if median_m > limit_m {
        return Err(VectorSizeError::TooLarge { median_mm: median_m * 1e3, whose, limit_mm: limit_m * 1e3 });
    }
    // Vectors of exactly nothing are a statement, not a mistake of unit.
    if median_m > 0.0 && median_m < MEASURABLE_M {
        return Err(VectorSizeError::TooSmall { median_nm: median_m * 1e9 });
    }
    Ok(())
}

fn mistakes(causes: &[String]) -> String {
    match causes.len() {
        0 => "check units, the order of the columns and of the rows, the offsets, and that the measuring frame is right-handed".to_owned(),
        _ => format!("it fits when {}", causes.join("; or when ")),
    }
}

fn named(far: &[(usize, f64)]) -> String {
    let shown: Vec<String> = far.iter().take(NAMED).map(|(point, mm)| format!("point {point} by {mm:.3} mm")).collect();
    let more = if far.len() > NAMED { " …" } else { "" };
    format!("{}{more}", shown.join(", "))
}

/// Refuses positions that are not those of the readings: half of them, with the mistakes that would explain it.
///
/// # Errors
/// What is mixed up.
pub fn check_shape(pairs: &[Pair]) -> Result<(), CorrespondenceError> {
    shape(pairs).map(drop)
}

/// The same, and refuses single points that lie far off: for whoever has no loss that bears gross errors.
///
/// # Errors
/// What is mixed up, or which points.
pub fn check_all(pairs: &[Pair]) -> Result<(), CorrespondenceError> {
    let distances_m = shape(pairs)?;
    let numbered = distances_m.into_iter().enumerate().filter(|(_, m)| *m > PLAUSIBLE_M);
    let mut far: Vec<(usize, f64)> = numbered.map(|(k, m)| (k + 1, m * 1e3)).collect();
    if far.is_empty() {
        return Ok(());
    }
    far.sort_by(|a, b| b.1.total_cmp(&a.1));
    Err(CorrespondenceError::FarPoints { far, all: pairs.len(), limit_mm: PLAUSIBLE_M * 1e3 })
}

/// Distances of all points (m) where half of them are plausible.
fn shape(pairs: &[Pair]) -> Result<Vec<f64>, CorrespondenceError> {
    let distances_m = distances(pairs)?;
    if pairs.iter().all(|pair| (pair.actual_m - pair.nominal_m()).norm() < COPIED_M) {
        return Err(CorrespondenceError::Copied(pairs.len()));
    }
    let median_m = typical(&distances_m);
    if median_m <= PLAUSIBLE_M {
        return Ok(distances_m);
    }
    let explains = |mended: &[Pair]| distances(mended).is_ok_and(|distances_m| typical(&distances_m) <= PLAUSIBLE_M);
    let causes = trials(pairs).into_iter().filter(|(_, mended)| explains(mended)).map(|(cause, _)| cause).collect();
    Err(CorrespondenceError::OtherShape { median_mm: median_m * 1e3, causes })
}

/// Distances (m) after the rigid alignment of those points that agree with each other.
fn distances(pairs: &[Pair]) -> Result<Vec<f64>, AlignmentError> {
    let (nominal_m, actual_m): (Vec<_>, Vec<_>) = pairs.iter().map(|pair| (pair.nominal_m(), pair.actual_m)).unzip();
    let mut alignment = RigidAlignment::between(&nominal_m, &actual_m)?;
    let of = |alignment: &RigidAlignment| -> Vec<f64> {
        nominal_m.iter().zip(&actual_m).map(|(nominal, actual)| (actual - alignment.apply(nominal)).norm()).collect()
    };
    let mut distances_m = of(&alignment);
    for _ in 0..PASSES {
        let limit_m = (FAR * typical(&distances_m)).max(f64::MIN_POSITIVE);
        let near: Vec<usize> = (0..pairs.len()).filter(|k| distances_m[*k] <= limit_m).collect();
        let pick = |all: &[Vector3<f64>]| -> Vec<Vector3<f64>> { near.iter().map(|k| all[*k]).collect() };
        // With fewer than three near points the alignment of all is the best there is.
        let Ok(next) = RigidAlignment::between(&pick(&nominal_m), &pick(&actual_m)) else { break };
        if next == alignment {
            break;
        }
        alignment = next;
        distances_m = of(&alignment);
    }
    Ok(distances_m)
}

/// Median; 0 for none.
fn typical(values: &[f64]) -> f64 {
    median(values.to_vec()).unwrap_or(0.0)
}

/// Mistakes undone, each with its words.
fn trials(pairs: &[Pair]) -> Vec<(String, Vec<Pair>)> {
    let letters = ['x', 'y', 'z'];
    let with = |change: &dyn Fn(&mut Pair)| -> Vec<Pair> {
        let mut all = pairs.to_vec();
        all.iter_mut().for_each(change);
        all
    };
    let mut list = Vec::new();
    for (factor, what) in UNITS {
        list.push((format!("the measured positions are taken as {what}"), with(&|pair| pair.actual_m *= factor)));
    }
    // Any mirror image of the positions is a rotation of any other.
    let mirrored = "the measured positions are mirrored: two of actual_x_mm, actual_y_mm, actual_z_mm are exchanged, or one has the \
                    wrong sign";
    list.push((mirrored.to_owned(), with(&|pair| pair.actual_m.x = -pair.actual_m.x)));
    for (factor, what) in UNITS.into_iter().take(4) {
        let change = |pair: &mut Pair| {
            pair.actual_m = pair.actual_m.map(|v| v * factor).component_mul(&Vector3::new(-1.0, 1.0, 1.0))
        };
        list.push((format!("the measured positions are mirrored and taken as {what}"), with(&change)));
    }
    for (d, letter) in letters.into_iter().enumerate() {
        let reversed = format!("{letter}_mm changes its sign: this axis is read the other way round");
        list.push((reversed, with(&|pair| pair.reading_m[d] = -pair.reading_m[d])));
        if pairs.iter().any(|pair| pair.offset_m[d] != 0.0) {
            let opposite = format!("offset_{letter}_mm changes its sign");
            list.push((opposite, with(&|pair| pair.offset_m[d] = -pair.offset_m[d])));
        }
    }
    for (a, b) in [(0, 1), (0, 2), (1, 2)] {
        let swapped = format!("{}_mm and {}_mm are exchanged", letters[a], letters[b]);
        list.push((swapped, with(&|pair| pair.reading_m.swap(a, b))));
    }
    list.push((
        "the offsets are left out: the measured positions are those of the ram".to_owned(),
        with(&|pair| pair.offset_m = [0.0; 3]),
    ));
    list.extend(orders(pairs));
    list
}

/// Measured positions against the rows before and after, and in the opposite order.
fn orders(pairs: &[Pair]) -> Vec<(String, Vec<Pair>)> {
    let joined = |rows: &[Pair], actual: &mut dyn Iterator<Item = &Pair>| -> Vec<Pair> {
        rows.iter().zip(actual).map(|(row, other)| Pair { actual_m: other.actual_m, ..*row }).collect()
    };
    let one_down = joined(pairs, &mut pairs.iter().skip(1));
    let one_up = joined(pairs.get(1..).unwrap_or_default(), &mut pairs.iter());
    let reversed = joined(pairs, &mut pairs.iter().rev());
    vec![
        ("the measured positions are moved up by one row".to_owned(), one_down),
        ("the measured positions are moved down by one row".to_owned(), one_up),
        ("the measured positions are taken in the opposite order".to_owned(), reversed),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a machine with errors of some 20 µm, two offsets, measured in a turned frame.
    fn pairs() -> Vec<Pair> {
        let turn = nalgebra::Rotation3::new(Vector3::new(0.3, -0.2, 1.1));
        let of = |k: usize| {
            let at = k as f64;
            let reading_m = [0.4 + 0.4 * (1.3 * at).sin(), 0.3 + 0.3 * (2.1 * at).cos(), 0.3 + 0.3 * (0.7 * at).sin()];
            let offset_m = if k.is_multiple_of(2) { [0.0, 0.0, -0.06] } else { [0.14, 0.0, -0.06] };
            let error_m = Vector3::new((3.0 * at).sin(), (5.0 * at).cos(), (7.0 * at).sin()) * 20e-6;
            let point_m = Vector3::from(reading_m) + Vector3::from(offset_m) + error_m;
            Pair { reading_m, offset_m, actual_m: turn * point_m + Vector3::new(1.0, -2.0, 0.5) }
        };
        (0..60).map(of).collect()
    }

    #[track_caller]
    fn says(change: impl Fn(&mut Vec<Pair>), words: &[&str]) {
        let mut all = pairs();
        change(&mut all);
        let text = check_all(&all).unwrap_err().to_string();
        for word in words {
            assert!(text.contains(word), "{word} in {text}");
        }
    }

    #[test]
    fn positions_of_a_machine_pass() {
        assert_eq!(check_all(&pairs()), Ok(()));
    }

    #[test]
    fn each_mistake_is_named() {
        let actual = |change: fn(Vector3<f64>) -> Vector3<f64>| {
            move |all: &mut Vec<Pair>| all.iter_mut().for_each(|pair| pair.actual_m = change(pair.actual_m))
        };
        says(actual(|p| p * 1e-3), &["metres"]);
        says(actual(|p| p * 1e3), &["micrometres"]);
        says(actual(|p| p / 25.4), &["inches"]);
        says(actual(|p| p.xzy()), &["mirrored", "exchanged"]);
        says(actual(|p| Vector3::new(p.x, -p.y, p.z)), &["mirrored", "wrong sign"]);
        says(|all| all.iter_mut().for_each(|pair| pair.reading_m.swap(0, 1)), &["x_mm and y_mm are exchanged"]);
        says(|all| all.iter_mut().for_each(|pair| pair.offset_m[0] *= -1.0), &["offset_x_mm changes its sign"]);
        says(|all| all.iter_mut().for_each(|pair| pair.offset_m = [0.0; 3]), &["check units"]);
        let shifted = |all: &mut Vec<Pair>| {
            let first = all[0].actual_m;
            (1..all.len()).for_each(|k| all[k - 1].actual_m = all[k].actual_m);
            all[59].actual_m = first;
        };
        says(shifted, &["moved down by one row"]);
        let backwards = |all: &mut Vec<Pair>| {
            let actual_m: Vec<Vector3<f64>> = all.iter().rev().map(|pair| pair.actual_m).collect();
            all.iter_mut().zip(actual_m).for_each(|(pair, actual_m)| pair.actual_m = actual_m);
        };
        says(backwards, &["opposite order"]);
    }

    #[test]
    fn rows_far_off_are_named_and_do_not_drag_the_others() {
        let spoil = |all: &mut Vec<Pair>| {
            all[6].actual_m.x += 0.3;
            all[40].actual_m.z -= 0.002;
        };
        says(spoil, &["2 of 60", "point 7 by 299.9", "point 41 by 2.0"]);
        let mut all = pairs();
        spoil(&mut all);
        assert_eq!(check_shape(&all), Ok(()), "a loss that bears gross errors may have them");
    }

    #[test]
    fn vectors_in_another_unit_are_refused() {
        let of =
            |size_m: f64, after| check_vectors(&[Vector3::x() * size_m, Vector3::y() * size_m, Vector3::z()], after);
        assert_eq!((of(2e-6, true), of(2e-4, false), of(0.0, true)), (Ok(()), Ok(()), Ok(())));
        assert!(matches!(of(0.5e-3, true), Err(VectorSizeError::TooLarge { .. })));
        assert!(matches!(of(2e-3, false), Err(VectorSizeError::TooLarge { .. })));
        assert!(matches!(of(2e-9, false), Err(VectorSizeError::TooSmall { .. })));
    }

    #[test]
    fn what_cannot_be_aligned_is_refused() {
        assert_eq!(check_all(&pairs()[..2]), Err(AlignmentError::TooFew(2).into()));
    }
}
