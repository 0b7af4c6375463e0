//! Grid steps from a wanted interpolation error.
//!
//! Place in the flow: before a [`Table`] is made. The error of linear interpolation along one axis does not depend on the
//! steps of the others, and a trilinear table misses by at most their sum; so each axis is looked at alone, on lines through
//! the volume, and the axis that gains most for its nodes is refined. The table that comes out is then compared with the
//! function as a whole, and refined on if the lines missed something.

use crate::table::{Grid, InterpolationError, Table, TableError};
use nalgebra::Vector3;

/// Lines along an axis: at so many places of each other axis.
const PLACES: usize = 5;
/// Samples of a line: more than any table that a controller takes has steps, and a multiple of many numbers of steps.
const SAMPLES: usize = 720;
/// Growth of the steps of an axis that is refined.
const GROWTH: f64 = 1.1;

/// A table whose interpolation error is, by every direction and at every quarter step, at most `wanted_m`, with as few nodes
/// as equal steps allow, but not more than `most_nodes`; and the error it has.
pub fn table_within<E>(
    ends_m: [(f64, f64); 3],
    wanted_m: f64,
    most_nodes: usize,
    error_m: impl Fn(&Vector3<f64>) -> Result<Vector3<f64>, E>,
) -> Result<(Table, InterpolationError), TableError<E>> {
    if !(wanted_m.is_finite() && wanted_m > 0.0) {
        return Err(TableError::Wanted { wanted_um: to_um(wanted_m) });
    }
    Grid::regular(ends_m, [1; 3])?; // refuses ends out of order before anything is evaluated
    let mut lines = Vec::new();
    for axis in 0..3 {
        lines.push(sampled_lines(ends_m, axis, &error_m)?);
    }
    let mut steps = [1; 3];
    let mut errors = [0, 1, 2].map(|d| missed_along(&lines[d], steps[d]));
    loop {
        while errors.iter().sum::<f64>() > wanted_m && nodes(steps) <= most_nodes {
            refine(&mut steps, &mut errors, &lines);
        }
        let table = Table::of(Grid::regular(ends_m, steps)?, &error_m)?;
        let missed = table.interpolation_error(&error_m)?;
        if table.grid().nodes() <= most_nodes && missed.largest_m.max() <= wanted_m {
            return Ok((table, missed));
        }
        if table.grid().nodes() > most_nodes {
            let (wanted_um, reached_um) = (to_um(wanted_m), to_um(missed.largest_m.max()));
            return Err(TableError::TooFine { wanted_um, most_nodes, nodes: table.grid().nodes(), reached_um });
        }
        refine(&mut steps, &mut errors, &lines);
    }
}

/// Micrometres to six digits, for people: 0.025 where the metres are 2.4999999999999998e-8.
fn to_um(value_m: f64) -> f64 {
    format!("{:.5e}", value_m * 1e6).parse().unwrap_or(value_m * 1e6)
}

fn nodes(steps: [usize; 3]) -> usize {
    steps.iter().map(|n| n + 1).product()
}

/// Refines the axis that misses most.
fn refine(steps: &mut [usize; 3], errors: &mut [f64; 3], lines: &[Vec<Line>]) {
    let worst = (0..3).fold(0, |worst, d| if errors[d] > errors[worst] { d } else { worst });
    steps[worst] = (steps[worst] + 1).max((steps[worst] as f64 * GROWTH) as usize);
    errors[worst] = missed_along(&lines[worst], steps[worst]);
}

/// Values of the function at equal distances along an axis.
type Line = Vec<Vector3<f64>>;

/// Lines along an axis at places spread over the other two.
fn sampled_lines<E>(
    ends_m: [(f64, f64); 3],
    axis: usize,
    error_m: &impl Fn(&Vector3<f64>) -> Result<Vector3<f64>, E>,
) -> Result<Vec<Line>, TableError<E>> {
    let at = |d: usize, share: f64| ends_m[d].0 + (ends_m[d].1 - ends_m[d].0) * share;
    let (second, third) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut lines = Vec::new();
    for place in 0..PLACES * PLACES {
        let share = |k: usize| k as f64 / (PLACES - 1) as f64;
        let mut line = Vec::with_capacity(SAMPLES + 1);
        for sample in 0..=SAMPLES {
            let mut point = Vector3::zeros();
            point[axis] = at(axis, sample as f64 / SAMPLES as f64);
            point[second] = at(second, share(place % PLACES));
            point[third] = at(third, share(place / PLACES));
            let value = error_m(&point).map_err(TableError::Function)?;
            if !value.iter().all(|v| v.is_finite()) {
                return Err(TableError::NotFinite { at_mm: (point * 1e3).into() });
            }
            line.push(value);
        }
        lines.push(line);
    }
    Ok(lines)
}

/// Largest miss of linear interpolation over so many equal steps, in any direction, on any line (m).
fn missed_along(lines: &[Line], steps: usize) -> f64 {
    let mut largest = 0.0_f64;
    for line in lines {
        let value = |share: f64| {
            let place = share * SAMPLES as f64;
            let lower = (place.floor() as usize).min(SAMPLES - 1);
            line[lower] + (line[lower + 1] - line[lower]) * (place - lower as f64)
        };
        for (sample, truth) in line.iter().enumerate() {
            let place = sample as f64 / SAMPLES as f64 * steps as f64;
            let step = (place.floor() as usize).min(steps - 1);
            let (lower, upper) = (value(step as f64 / steps as f64), value((step + 1) as f64 / steps as f64));
            largest = largest.max((lower + (upper - lower) * (place - step as f64) - truth).amax());
        }
    }
    largest
}
