//! What a laser does by itself while runs are made: its zero and its wavelength drift.
//!
//! Place in the flow: the study of runs holds every course in time against it. Along one line an instrument that drifts moves the zero of
//! all targets, and their scale; so does an axis that warms up. What differs from target to target, or by the side of approach, it does
//! not do.

use super::Run;
use super::shape::{Ranges, Shape, grown, mean_grown};
use crate::study::smooth::legendre;
use faer::Mat;

pub(super) const RIVAL: &str = "a laser whose zero or wavelength drifts";
pub(super) const STANDS_STILL: &str = "stand at one target again and again: at the beginning, between the cycles and at the end, with the axis cold and warm";

/// Whether a shape is what a laser does by itself.
pub(super) fn does(shape: &Shape) -> bool {
    matches!(shape, Shape::Time(_) | Shape::TimeAndTarget | Shape::Creep(_) | Shape::Growth(_))
}

/// Zero and scale with the course in time of a shape, at one approach; none where it has no such course.
fn beside(shape: &Shape, run: &Run, ranges: &Ranges) -> Vec<f64> {
    let along = legendre(run.target_m, ranges.target_m, 1)[1];
    let over = |value: f64, range: (f64, f64), degree: usize| legendre(value, range, degree).split_off(1);
    let functions = match (shape, run.time_s, ranges.time_s) {
        (Shape::Time(degree), Some(time_s), Some(range)) => over(time_s, range, *degree),
        (Shape::TimeAndTarget, Some(time_s), Some(range)) => over(time_s, range, 1),
        (Shape::Creep(tau_s) | Shape::Growth(tau_s), Some(time_s), Some((first_s, _))) => {
            vec![grown(time_s - first_s, *tau_s)]
        }
        (Shape::Cycle(_) | Shape::DriftTable | Shape::LostWithCycle, ..) => {
            ranges.cycle.map_or_else(Vec::new, |range| over(run.cycle as f64, range, 1))
        }
        _ => Vec::new(),
    };
    functions.into_iter().flat_map(|own| [own, own * along]).collect()
}

/// The same as columns of all runs (m per unit); `rows` are those of the axis.
pub(super) fn columns(shape: &Shape, (runs, rows): (&[Run], &[usize]), ranges: &Ranges) -> Mat<f64> {
    let of_rows: Vec<Vec<f64>> = rows.iter().map(|row| beside(shape, &runs[*row], ranges)).collect();
    let mut columns = Mat::zeros(runs.len(), of_rows.first().map_or(0, Vec::len));
    for (row, own) in rows.iter().zip(of_rows) {
        own.into_iter().enumerate().for_each(|(j, value)| columns[(*row, j)] = value);
    }
    columns
}

/// How far a scale that was found to go with the time goes to either side, in m at the ends of the axis.
fn scale_m(shape: &Shape, values: &[f64], ranges: &Ranges) -> Option<f64> {
    match (shape, values) {
        (Shape::TimeAndTarget, [_, scale_m]) => Some(scale_m.abs()),
        (Shape::Growth(tau_s), [_, scale_m]) => {
            let (first_s, last_s) = ranges.time_s?;
            let (mean, end) = (mean_grown(last_s - first_s, *tau_s), grown(last_s - first_s, *tau_s));
            // It begins farther from its mean than it ends.
            Some(scale_m.abs() * mean.max(end - mean))
        }
        _ => None,
    }
}

/// What that leaves open of the parameters of an error of position.
pub(super) fn changed(of: &Shape, by: &Shape, values: &[f64], ranges: &Ranges) -> Option<Vec<f64>> {
    let scale_m = scale_m(by, values, ranges)?;
    match of {
        Shape::Position(degree) => Some((0..*degree).map(|k| if k == 0 { scale_m } else { 0.0 }).collect()),
        Shape::PositionTable => {
            Some(ranges.places_m().iter().map(|place_m| scale_m * legendre(*place_m, ranges.target_m, 1)[1]).collect())
        }
        _ => None,
    }
}
