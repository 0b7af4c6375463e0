//! Lengths of one station that do not all count from one zero: where they begin anew.
//!
//! Place in the flow: [`crate::contradiction`] asks where nothing else explains a station whose readings contradict each other. A tracer that
//! is set to zero again, or whose beam was lost and taken up again, stands where it stood: |p − S| = d + l with one S (m, machine frame)
//! and another d in each part of its readings. From two readings of one part, |p|² − l² = 2 p·S + 2 l d − (|S|² − d²) is linear in S, d
//! and |S|² − d² of that part; both of the latter are eliminated part by part, and a few robust Gauss-Newton steps on the ranges follow.
//! Source: as in [`crate::station_start`], with a dead path for each part.

use crate::robust::median;
use crate::station_start::PointAndLength;
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2, Vector3};

/// Disagreement of a line (median, m) up to which zeros explain it: three times what a machine leaves before it is corrected. What has
/// another cause differs along its line.
const EXPLAINED_M: f64 = 3e-4;
/// Steps towards the least sum of absolute residuals, at most.
const STEPS: usize = 60;
/// Step (m) that ends them.
const SETTLED_M: f64 = 1e-7;
/// Residual (m) below which readings have the same weight.
const SMALLEST_M: f64 = 1e-6;
/// Share of its trace below which the parts do not tell a direction of the station.
const UNTOLD: f64 = 1e-9;
/// Readings that a zero must have on either side: a few lost ones are no new zero.
const FEWEST: usize = 5;
/// Instants between lines that are tried, at most: each is a search for the station.
const MOST_TRIED: usize = 200;

/// Readings of one line, in the order of time.
pub(crate) type Line = Vec<PointAndLength>;

/// Where the lengths of a station begin anew.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Zeros {
    /// First reading with each new zero, counted over all lines.
    pub(crate) begin: Vec<usize>,
    /// By how much lengths shift there (m).
    pub(crate) shifts_m: Vec<f64>,
}

/// One change of the zero, between any two readings; `None` where that does not explain the lines.
pub(crate) fn one_change(lines: &[Line]) -> Option<Zeros> {
    let stride = lines.len().div_ceil(MOST_TRIED).max(1);
    let tried = (1..lines.len()).step_by(stride).filter_map(|at| {
        let station_m = place(&[lines[..at].concat(), lines[at..].concat()])?;
        let zeros_m = zeros_m(lines.iter().flatten(), station_m);
        let begin = change(&zeros_m)?;
        Some((left_m(&zeros_m, begin), begin))
    });
    let (_, begin) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let all: Line = lines.concat();
    let station_m = place(&[all[..begin].to_vec(), all[begin..].to_vec()])?;
    let zeros_m = zeros_m(all.iter(), station_m);
    let (before_m, after_m) = (median(zeros_m[..begin].to_vec())?, median(zeros_m[begin..].to_vec())?);
    let mut first = 0;
    let is_explained = lines.iter().all(|line| {
        let own = first..first + line.len();
        first = own.end;
        let off_m = own.map(|k| (zeros_m[k] - if k < begin { before_m } else { after_m }).abs());
        median(off_m.collect()).is_some_and(|off_m| off_m <= EXPLAINED_M)
    });
    let shift_m = before_m - after_m;
    (is_explained && shift_m.abs() > EXPLAINED_M).then(|| Zeros { begin: vec![begin], shifts_m: vec![shift_m] })
}

/// A zero for each line; `None` where that does not explain them. Lines that go on from the one before begin nothing.
pub(crate) fn each_line(lines: &[Line]) -> Option<Zeros> {
    let station_m = place(lines)?;
    let mut zeros = Zeros { begin: Vec::new(), shifts_m: Vec::new() };
    let (mut first, mut last_m) = (0, None);
    for line in lines {
        let own_m = zeros_m(line.iter(), station_m);
        let zero_m = median(own_m.clone())?;
        if median(own_m.iter().map(|own| (own - zero_m).abs()).collect())? > EXPLAINED_M {
            return None;
        }
        let shift_m = last_m.map_or(0.0, |last_m: f64| last_m - zero_m);
        if shift_m.abs() > EXPLAINED_M {
            zeros.begin.push(first);
            zeros.shifts_m.push(shift_m);
        }
        (first, last_m) = (first + line.len(), Some(zero_m));
    }
    // A line that alone is off begins anew twice, and has other causes.
    (zeros.begin.len() > 2).then_some(zeros)
}

/// The distance at length zero, as each reading has it (m).
fn zeros_m<'l>(readings: impl Iterator<Item = &'l PointAndLength>, station_m: Vector3<f64>) -> Vec<f64> {
    readings.map(|(point_m, length_m)| (point_m - station_m).norm() - length_m).collect()
}

/// The first reading after the change that leaves least of these zeros (least squares).
fn change(zeros_m: &[f64]) -> Option<usize> {
    let (count, sum) = (zeros_m.len(), zeros_m.iter().sum::<f64>());
    let mut before = 0.0;
    let mut best: Option<(f64, usize)> = None;
    for (at, zero_m) in zeros_m.iter().enumerate() {
        if (FEWEST..=count.saturating_sub(FEWEST)).contains(&at) {
            let (one, other) = (before / at as f64, (sum - before) / (count - at) as f64);
            // What the means of both sides take of the squares grows with their distance.
            let taken = (at * (count - at)) as f64 * (one - other).powi(2);
            best = best.filter(|(most, _)| *most >= taken).or(Some((taken, at)));
        }
        before += zero_m;
    }
    best.map(|(_, at)| at)
}

/// Sum of what a change leaves of these zeros (m), from their medians.
fn left_m(zeros_m: &[f64], begin: usize) -> f64 {
    let (before, after) = zeros_m.split_at(begin);
    let of = |side: &[f64]| -> f64 {
        let middle_m = median(side.to_vec()).unwrap_or(0.0);
        side.iter().map(|zero_m| (zero_m - middle_m).abs()).sum()
    };
    of(before) + of(after)
}

/// The station (m) of parts with a dead path each; `None` where they do not tell it.
fn place(parts: &[Line]) -> Option<Vector3<f64>> {
    let mut station_m = linear(parts)?;
    for _ in 0..STEPS {
        let step = step(parts, station_m)?;
        station_m += step;
        if step.norm() < SETTLED_M {
            break;
        }
    }
    station_m.iter().all(|value| value.is_finite()).then_some(station_m)
}

/// Linear solution, about the first point, with the two figures of each part eliminated.
fn linear(parts: &[Line]) -> Option<Vector3<f64>> {
    let origin_m = parts.iter().flatten().next()?.0;
    let (mut normal, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
    for part in parts {
        let length_m = part.iter().map(|(_, length_m)| length_m).sum::<f64>() / part.len().max(1) as f64;
        let (mut own, mut beside) = (Matrix2::zeros(), Matrix2x3::zeros());
        let mut own_right = Vector2::zeros();
        for (point_m, l_m) in part {
            // About the mean length, so that the two figures are told apart; that changes what they stand for, not the station.
            let (p, l) = (point_m - origin_m, l_m - length_m);
            let (figures, right) = (Vector2::new(2.0 * l, -1.0), p.norm_squared() - l * l);
            own += figures * figures.transpose();
            beside += figures * (2.0 * p).transpose();
            own_right += figures * right;
            normal += 4.0 * p * p.transpose();
            gradient += 2.0 * p * right;
        }
        // A part without two lengths tells nothing of its figures: it is left as it is by the inverse of the rest.
        let inverse = own.pseudo_inverse(own.trace() * UNTOLD).ok()?;
        normal -= beside.transpose() * inverse * beside;
        gradient -= beside.transpose() * inverse * own_right;
    }
    Some(origin_m + solved(normal, gradient)?)
}

/// One step towards the least sum of absolute residuals, the dead paths being the medians of their parts.
fn step(parts: &[Line], station_m: Vector3<f64>) -> Option<Vector3<f64>> {
    let (mut normal, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
    for part in parts {
        let zeros_m = zeros_m(part.iter(), station_m);
        let zero_m = median(zeros_m.clone())?;
        let weights: Vec<f64> = zeros_m.iter().map(|own| 1.0 / (own - zero_m).abs().max(SMALLEST_M)).collect();
        let whole: f64 = weights.iter().sum();
        let sight = |k: usize| (part[k].0 - station_m).normalize();
        let mean = |of: &dyn Fn(usize) -> Vector3<f64>| {
            (0..part.len()).map(|k| of(k) * weights[k]).sum::<Vector3<f64>>() / whole
        };
        let mean_sight = mean(&sight);
        let mean_zero_m = zeros_m.iter().zip(&weights).map(|(zero_m, weight)| zero_m * weight).sum::<f64>() / whole;
        for k in 0..part.len() {
            let across = sight(k) - mean_sight;
            normal += across * across.transpose() * weights[k];
            gradient += across * ((zeros_m[k] - mean_zero_m) * weights[k]);
        }
    }
    solved(normal, gradient)
}

/// Solution of normal equations that tell all three directions.
fn solved(normal: Matrix3<f64>, gradient: Vector3<f64>) -> Option<Vector3<f64>> {
    let least = normal.symmetric_eigenvalues().min();
    (least > UNTOLD * normal.trace()).then(|| normal.cholesky().map(|factor| factor.solve(&gradient)))?
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATION_M: Vector3<f64> = Vector3::new(-0.3, 1.1, -0.4);

    /// Twelve lines of eleven points along X, Y and Z, with errors of a machine of some 30 µm and the zeros given (m).
    fn lines(zero_m: impl Fn(usize, usize) -> f64) -> Vec<Line> {
        let of = |line: usize| {
            let point = |k: usize| {
                let (along, level) = (k as f64 * 0.08, 0.15 * (line / 3) as f64);
                let point_m = [
                    Vector3::new(along, level, 0.6 - level),
                    Vector3::new(level, along, 0.2 + 0.5 * level),
                    Vector3::new(0.7 - level, 0.4 + level, along),
                ][line % 3];
                let bent_m = 30e-6 * (3.0 * along + line as f64).sin();
                (point_m, (point_m - STATION_M).norm() + bent_m - zero_m(line, k))
            };
            (0..11).map(point).collect()
        };
        (0..12).map(of).collect()
    }

    fn find(lines: &[Line]) -> Option<Zeros> {
        one_change(lines).or_else(|| each_line(lines))
    }

    #[test]
    fn one_new_zero_is_found_at_its_reading_within_a_line_too() {
        for begin in [40, 66, 71] {
            let found = find(&lines(|line, k| if 11 * line + k < begin { 0.9 } else { 1.2 })).unwrap();
            assert_eq!(found.begin, [begin]);
            assert!((found.shifts_m[0] + 0.3).abs() < EXPLAINED_M, "{found:?}");
        }
    }

    #[test]
    fn a_zero_for_each_line_is_found() {
        let found = find(&lines(|line, _| 0.8 + 0.07 * (5 * line % 12) as f64)).unwrap();
        assert_eq!(found.begin, (1..12).map(|line| 11 * line).collect::<Vec<_>>());
    }

    #[test]
    fn one_zero_and_one_line_alone_are_none() {
        assert_eq!(find(&lines(|_, _| 0.8)), None);
        assert_eq!(find(&lines(|line, _| if line == 5 { 0.83 } else { 0.8 })), None);
    }

    #[test]
    fn what_grows_along_a_line_is_no_zero() {
        assert_eq!(find(&lines(|line, k| if line % 2 == 0 { 0.8 } else { 0.8 + 0.01 * k as f64 })), None);
    }
}
