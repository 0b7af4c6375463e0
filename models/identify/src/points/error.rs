//! Why measured positions could not be fitted, in words that name the point and the remedy.
//!
//! Place in the flow: the failure type of [`super::fit_points`]; also the checks that need no fit. Points are numbered from
//! 1 in the order in which they were given.

use super::{Loss, MeasuredPoint};
use crate::error::{Unobservable, group_text};
use crate::jade::JadeError;
use crate::plausibility::{BeyondStroke, beyond_stroke};
use abbe_geometry::machine::{Machine, MachineError};
use abbe_geometry::model::ModelError;
use abbe_measurement::alignment::AlignmentError;
use abbe_measurement::correspondence::{CorrespondenceError, Pair, check_shape, copied};
use thiserror::Error;

/// Why a fit was refused or failed.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PointsError {
    /// Fewer equations than unknowns.
    #[error(
        "{points} points give {equations} equations for {unknowns} unknowns; measure more points, or use polynomials of \
         lower degree"
    )]
    TooFew {
        /// Points.
        points: usize,
        /// Three a point, those that the loss leaves out not counted.
        equations: usize,
        /// Coefficients, angles and the pose of the measuring frame.
        unknowns: usize,
    },
    /// A number is not finite.
    #[error("point {point}: {what} is not a finite number; correct or remove that row")]
    NotFinite {
        /// Number of the point, from 1.
        point: usize,
        /// Which quantity.
        what: &'static str,
    },
    /// An uncertainty is not above zero.
    #[error(
        "point {point}: the standard uncertainty {u_m} m is not a finite number above 0; state what the instrument can do"
    )]
    Uncertainty {
        /// Number of the point, from 1.
        point: usize,
        /// The uncertainty (m).
        u_m: f64,
    },
    /// The same row twice.
    #[error(
        "point {second} repeats point {first} to the last digit; a copy is no second measurement: remove it (readings \
         repeated on the machine differ by its noise)"
    )]
    Duplicate {
        /// Number of the first, from 1.
        first: usize,
        /// Number of its copy, from 1.
        second: usize,
    },
    /// A reading is outside the machine.
    #[error(
        "point {point}: {axis} = {position_mm:.4} mm lies outside the stroke {lower_mm} … {upper_mm} mm of machine \
         {machine}; these points are of another machine, columns are exchanged, or the unit is wrong"
    )]
    OutsideStroke {
        /// Number of the point, from 1.
        point: usize,
        /// Axis letter.
        axis: char,
        /// Where it is (mm).
        position_mm: f64,
        /// Lower end of the stroke (mm).
        lower_mm: f64,
        /// Upper end of the stroke (mm).
        upper_mm: f64,
        /// Name of the machine.
        machine: String,
    },
    /// The points cannot be laid over the nominal ones.
    #[error("the measured positions cannot be compared with the readings: {0}")]
    Alignment(#[from] AlignmentError),
    /// Measured and nominal points have different shapes.
    #[error(transparent)]
    Mixed(#[from] CorrespondenceError),
    /// The points cannot determine all unknowns.
    #[error("{}", undetermined_text(.groups, *.rank, *.unknowns))]
    RankDeficient {
        /// Combinations that cannot be seen.
        groups: Vec<Unobservable>,
        /// Rank of the points for the unknowns.
        rank: usize,
        /// Number of unknowns.
        unknowns: usize,
    },
    /// The normal equations could not be factored.
    #[error("the unknowns cannot be told apart numerically; use polynomials of lower degree, or more points")]
    Singular,
    /// The search ended before a minimum.
    #[error(
        "not converged after {steps} steps of {method}: the best point found is still {largest_step:.2} standard \
         uncertainties of an unknown from the minimum; {remedy}"
    )]
    NotConverged {
        /// The way.
        method: &'static str,
        /// Its steps or generations.
        steps: usize,
        /// Distance to the minimum by a Newton step, in units of the uncertainty.
        largest_step: f64,
        /// What to do.
        remedy: &'static str,
    },
    /// JADE was given something it cannot work with.
    #[error("JADE: {0}")]
    Jade(#[from] JadeError),
    /// A choice of the fit makes no sense.
    #[error("{0}")]
    Choice(&'static str),
    /// The machine description is wrong.
    #[error(transparent)]
    Machine(#[from] MachineError),
    /// The model could not be put together.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The observer asked to stop.
    #[error("stopped on request; nothing was identified")]
    Stopped,
}

fn undetermined_text(groups: &[Unobservable], rank: usize, unknowns: usize) -> String {
    let groups: Vec<String> = groups.iter().map(group_text).collect();
    format!(
        "the points determine only {rank} of {unknowns} unknowns; they cannot see {}; measure points that fill the volume \
         (not only a line or a plane), with a second offset for the angles of the last axis, or hold what cannot be seen \
         at zero in the machine file (kind = \"zero\")",
        groups.join("; ")
    )
}

/// Refuses points that are no measurement inside this machine.
pub(super) fn check(machine: &Machine, points: &[MeasuredPoint]) -> Result<(), PointsError> {
    for (k, point) in points.iter().enumerate() {
        let finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
        let checks = [
            (finite(&point.reading_m), "the axis position"),
            (finite(&point.offset_m), "the offset"),
            (finite(point.actual_m.as_slice()), "the measured position"),
        ];
        if let Some((_, what)) = checks.into_iter().find(|(ok, _)| !ok) {
            return Err(PointsError::NotFinite { point: k + 1, what });
        }
        if !(point.u_m.is_finite() && point.u_m > 0.0) {
            return Err(PointsError::Uncertainty { point: k + 1, u_m: point.u_m });
        }
        check_stroke(machine, k, point)?;
    }
    let numbers = |p: &MeasuredPoint| -> Vec<u64> {
        let numbers = p.reading_m.iter().chain(&p.offset_m).chain(p.actual_m.iter());
        numbers.map(|value| value.to_bits()).collect()
    };
    match copied(points.iter().map(numbers)) {
        Some((first, second)) => Err(PointsError::Duplicate { first: first + 1, second: second + 1 }),
        None => Ok(()),
    }
}

fn check_stroke(machine: &Machine, k: usize, point: &MeasuredPoint) -> Result<(), PointsError> {
    match beyond_stroke(machine, point.reading_m) {
        None => Ok(()),
        Some(BeyondStroke { axis, position_mm, lower_mm, upper_mm }) => Err(PointsError::OutsideStroke {
            point: k + 1,
            axis,
            position_mm,
            lower_mm,
            upper_mm,
            machine: machine.name.clone(),
        }),
    }
}

/// Refuses positions whose shape is not that of the nominal points.
pub(super) fn check_positions(points: &[MeasuredPoint]) -> Result<(), PointsError> {
    let pair = |p: &MeasuredPoint| Pair { reading_m: p.reading_m, offset_m: p.offset_m, actual_m: p.actual_m };
    Ok(check_shape(&points.iter().map(pair).collect::<Vec<_>>())?)
}

/// Refuses fewer equations than unknowns.
pub(super) fn check_count(points: usize, loss: Loss, unknowns: usize) -> Result<(), PointsError> {
    let used = match loss {
        Loss::Squares | Loss::Huber => points,
        Loss::Trimmed => super::loss::kept_points(points.max(1), unknowns).min(points),
    };
    if 3 * used <= unknowns {
        return Err(PointsError::TooFew { points, equations: 3 * used, unknowns });
    }
    Ok(())
}

/// Refuses a fit of which the outliers left too little.
pub(super) fn check_used(weights: &[f64], unknowns: usize) -> Result<(), PointsError> {
    let used = weights.iter().filter(|weight| **weight > 0.0).count();
    if 3 * used <= unknowns {
        return Err(PointsError::TooFew { points: weights.len(), equations: 3 * used, unknowns });
    }
    Ok(())
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use abbe_geometry::error_function::FunctionKind;
    use abbe_geometry::machine::{Joint, Side, Squareness};
    use abbe_geometry::rotation::RotationForm;
    use abbe_geometry::{Axis, Vector3};

    /// A bridge with polynomials of degree 3.
    pub(crate) fn machine() -> Machine {
        let tilt = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
        let joint = |axis| Joint { axis, side: Side::Tool };
        Machine {
            name: "bridge".to_owned(),
            frame_id: "machine".to_owned(),
            joints: [joint(Axis::X), joint(Axis::Y), joint(Axis::Z)],
            stroke_m: [(0.0, 0.8), (0.0, 0.6), (0.0, 0.6)],
            squareness: [tilt("C0Y", Axis::Y, Axis::Z), tilt("B0Z", Axis::Z, Axis::Y), tilt("A0Z", Axis::Z, Axis::X)],
            rotation: RotationForm::SmallAngle,
            kinds: [Some(FunctionKind::Polynomial { degree: 3 }); 18],
            repeatability_m: [0.2e-6; 3],
            u_ram_turn_rad: [abbe_geometry::machine::USUAL_RAM_TURN_RAD; 3],
            default_offset_m: None,
        }
    }

    /// A perfect machine on a grid with three offsets, seen from a turned frame.
    pub(in crate::points) fn cube() -> Vec<MeasuredPoint> {
        let turn = nalgebra::Rotation3::new(Vector3::new(0.3, -0.2, 1.1));
        let offsets = [[0.0, 0.0, -0.1], [0.15, 0.0, -0.1], [0.0, 0.12, -0.05]];
        let mut points = Vec::new();
        for i in 0..27_usize {
            let at = |step: usize, stroke: f64| stroke * (0.05 + 0.45 * step as f64);
            let reading_m = [at(i % 3, 0.8), at(i / 3 % 3, 0.6), at(i / 9, 0.6)];
            let offset_m = offsets[(i + i / 3) % 3];
            let actual_m = turn * (Vector3::from(reading_m) + Vector3::from(offset_m)) + Vector3::new(1.0, -2.0, 0.5);
            points.push(MeasuredPoint { reading_m, offset_m, actual_m, u_m: 0.3e-6 });
        }
        points
    }

    #[test]
    fn each_bad_point_is_named() {
        let machine = machine();
        let with = |change: fn(&mut MeasuredPoint)| {
            let mut points = cube();
            change(&mut points[4]);
            check(&machine, &points).unwrap_err()
        };
        assert_eq!(check(&machine, &cube()), Ok(()));
        assert_eq!(with(|p| p.reading_m[1] = f64::NAN), PointsError::NotFinite { point: 5, what: "the axis position" });
        assert_eq!(with(|p| p.offset_m[1] = f64::INFINITY), PointsError::NotFinite { point: 5, what: "the offset" });
        let measured = PointsError::NotFinite { point: 5, what: "the measured position" };
        assert_eq!(with(|p| p.actual_m.z = f64::NAN), measured);
        assert_eq!(with(|p| p.u_m = 0.0), PointsError::Uncertainty { point: 5, u_m: 0.0 });
        assert!(matches!(with(|p| p.reading_m[0] *= 1e3), PointsError::OutsideStroke { point: 5, axis: 'X', .. }));
        let mut twice = cube();
        twice.push(twice[2]);
        assert_eq!(check(&machine, &twice), Err(PointsError::Duplicate { first: 3, second: 28 }));
    }

    #[test]
    fn positions_of_another_shape_are_refused_with_the_likely_mistake() {
        assert_eq!(check_positions(&cube()), Ok(()));
        let mirrored: Vec<MeasuredPoint> =
            cube().into_iter().map(|p| MeasuredPoint { actual_m: p.actual_m.yxz(), ..p }).collect();
        let refusal = check_positions(&mirrored).unwrap_err().to_string();
        assert!(refusal.contains("mirrored"), "{refusal}");
    }
}
