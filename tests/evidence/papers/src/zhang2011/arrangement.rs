//! Uncertainty of each error by the arrangement of targets: spread, offset from a line, height, number, tracker.
//!
//! Place in the flow: rows of [`super::figures`]; published is only that three targets may not lie on a line (rank 6 of eq. 15).

use super::PAPER;
use super::yaw::DATA_SHEET;
use crate::figure::{Figure, PaperError, Verdict};
use abbe_measurement::guideway::{ArrangedTarget, GuidewayError, arrangement_covariance};
use abbe_measurement::tracker::{TrackerReading, TrackerUncertainty};
use nalgebra::{Matrix3, Vector3};

const PLACE: &str = "eq. 15";
/// Standard uncertainty of each coordinate in the hand cases (m): figures for others are in proportion.
const UNIT_M: f64 = 1e-6;
const ARC_SECOND: f64 = std::f64::consts::PI / 648_000.0;

/// Targets (m) about a table's centre, the x axis along the motion.
fn triangle(along_m: f64, aside_m: f64, height_m: f64) -> Vec<Vector3<f64>> {
    [(-0.5, -0.5), (0.5, -0.5), (0.0, 0.5)]
        .iter()
        .map(|(x, y)| Vector3::new(x * along_m, y * aside_m, height_m))
        .collect()
}

fn square(side_m: f64) -> Vec<Vector3<f64>> {
    [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)]
        .iter()
        .map(|(x, y)| Vector3::new(x * side_m, y * side_m, 0.0))
        .collect()
}

/// u of EXX, EYX, EZX (µm) and EAX, EBX, ECX (″) with the same uncertainty in every direction.
fn alike(points_m: &[Vector3<f64>]) -> Result<[f64; 6], GuidewayError> {
    let covariance_m2 = Matrix3::identity() * UNIT_M * UNIT_M;
    let targets: Vec<ArrangedTarget> =
        points_m.iter().map(|point_m| ArrangedTarget { point_m: *point_m, covariance_m2 }).collect();
    u_of(&targets)
}

/// The same seen by a tracker at a place (m) relative to the reference point.
pub(super) fn seen(
    points_m: &[Vector3<f64>],
    tracker_m: &Vector3<f64>,
    uncertainty: &TrackerUncertainty,
) -> Result<[f64; 6], PaperError> {
    let target = |point_m: &Vector3<f64>| -> Result<ArrangedTarget, PaperError> {
        let reading = TrackerReading::of_point(&(point_m - tracker_m)).map_err(failed)?;
        Ok(ArrangedTarget { point_m: *point_m, covariance_m2: uncertainty.covariance_m2(&reading) })
    };
    let targets: Vec<ArrangedTarget> = points_m.iter().map(target).collect::<Result<_, _>>()?;
    u_of(&targets).map_err(failed)
}

fn u_of(targets: &[ArrangedTarget]) -> Result<[f64; 6], GuidewayError> {
    let covariance = arrangement_covariance(targets, &Vector3::zeros())?;
    Ok(std::array::from_fn(|k| covariance[(k, k)].sqrt() / if k < 3 { 1e-6 } else { ARC_SECOND }))
}

fn failed(error: impl std::fmt::Display) -> PaperError {
    PaperError { paper: PAPER, place: PLACE, problem: error.to_string() }
}

fn text(u: &[f64; 6]) -> String {
    format!("u = {:.2}, {:.2}, {:.2} µm; {:.2}, {:.2}, {:.2} arcsec", u[0], u[1], u[2], u[3], u[4], u[5])
}

pub(super) fn figures() -> Result<Vec<Figure>, PaperError> {
    let cases = [
        ("three targets, 300 mm along, 300 mm aside", triangle(0.3, 0.3, 0.0)),
        ("three targets, 100 mm along, 100 mm aside", triangle(0.1, 0.1, 0.0)),
        ("three targets, 300 mm along, 30 mm aside", triangle(0.3, 0.03, 0.0)),
        ("three targets, 300 mm along, 300 mm aside, 500 mm above the reference", triangle(0.3, 0.3, 0.5)),
        ("four targets, square of 300 mm", square(0.3)),
    ];
    let mut figures = Vec::new();
    for (what, points_m) in cases {
        let u = alike(&points_m).map_err(failed)?;
        figures.push(row(
            what,
            text(&u),
            "1 µm in each coordinate of a point (k = 1), one reading at the lowest position and one here",
            None,
        ));
    }
    let tracker = Vector3::new(-2.0, 0.0, 0.3);
    for (what, tracker_m) in [
        ("square of 300 mm, tracker 2 m behind the table along its motion", tracker),
        ("square of 300 mm, tracker 2 m beside it", Vector3::new(0.0, -2.0, 0.3)),
    ] {
        let u = seen(&square(0.3), &tracker_m, &DATA_SHEET)?;
        figures.push(row(
            what,
            text(&u),
            "tracker of 0.5 µm + 0.5 µm/m along the beam, 5 µm + 2 µm/m across it (k = 1, assumed)",
            None,
        ));
    }
    let refused =
        alike(&triangle(0.3, 0.0, 0.0)).err().map_or_else(|| "accepted".to_owned(), |error| error.to_string());
    figures.push(row(
        "three targets on a line",
        refused,
        "arrangement and fit refuse an extent across the line below a thousandth of that along it",
        Some("rank below 6"),
    ));
    Ok(figures)
}

fn row(what: &str, reproduced: String, how: &str, published: Option<&str>) -> Figure {
    Figure {
        place: PLACE,
        what: format!("uncertainty of EXX, EYX, EZX; EAX, EBX, ECX: {what}"),
        published: published.map(str::to_owned),
        reproduced,
        how: how.to_owned(),
        verdict: if published.is_some() { Verdict::Reproduced } else { Verdict::NotPublished },
        reason:
            "angles fall with the spread across their axis, displacements with the number of targets; height above the \
                 reference turns angles into displacements"
                .to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_third_of_the_spread_makes_angles_three_times_less_certain() {
        let (wide, narrow) = (alike(&triangle(0.3, 0.3, 0.0)).unwrap(), alike(&triangle(0.1, 0.1, 0.0)).unwrap());
        for k in 0..3 {
            assert!((narrow[3 + k] / wide[3 + k] - 3.0).abs() < 1e-9);
        }
        // √2 of two readings over √3 of three targets; the triangle's centroid is not its reference, which adds levers in z.
        assert!(wide[0] >= (2f64 / 3.0).sqrt() - 1e-9);
    }

    #[test]
    fn a_line_has_no_roll_and_a_narrow_triangle_hardly_any() {
        assert!(alike(&triangle(0.3, 0.0, 0.0)).is_err());
        let (narrow, wide) = (alike(&triangle(0.3, 0.03, 0.0)).unwrap(), alike(&triangle(0.3, 0.3, 0.0)).unwrap());
        assert!((narrow[3] / wide[3] - 10.0).abs() < 1e-9, "roll rests on what lies aside");
        assert!(narrow[5] < 2.0 * wide[5], "yaw rests on both directions");
    }

    /// Position along the beam is certain, across it not; from behind and from beside, the two directions exchange their parts,
    /// and yaw rests on range from either side.
    #[test]
    fn the_tracker_is_best_where_the_beam_measures() {
        let behind = seen(&square(0.3), &Vector3::new(-2.0, 0.0, 0.3), &DATA_SHEET).unwrap();
        let beside = seen(&square(0.3), &Vector3::new(0.0, -2.0, 0.3), &DATA_SHEET).unwrap();
        assert!(behind[0] < 0.5 * behind[1] && beside[1] < 0.5 * beside[0]);
        assert!((behind[5] / beside[5] - 1.0).abs() < 1e-6 && behind[5] < 0.5 * behind[4]);
        assert_eq!(figures().unwrap().len(), 8);
    }
}
