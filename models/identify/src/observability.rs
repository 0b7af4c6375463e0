//! Can this plan see every error? And if not, which lines would make it?
//!
//! Place in the flow: after the first pass, before anything is fitted in earnest. Each error function is looked at
//! through its first shapes (straight line and parabola), which every sensible plan must determine; a rich spline
//! would hide a hole in the plan behind its penalty. The problem is equilibrated (unit diagonal), so the
//! decision does not depend on units, noise or the number of readings.

use crate::design::{Estimate, Row, Setup};
use crate::error::{IdentifyError, Unobservable};
use crate::linear::symmetric_eigen;
use crate::normal::NormalEquations;
use abbe_geometry::ErrorId;
use abbe_measurement::campaign::{Campaign, RangeReading};
use faer::Mat;

/// Eigenvalue of the equilibrated normal matrix below which a combination is not seen: a signature of less than
/// a thousandth of its own parts.
const RANK_TOLERANCE: f64 = 1e-6;
/// Share of the strongest part from which an error is named as taking part.
const NAMED_SHARE: f64 = 0.25;
/// Most lines proposed.
const MAX_LINES: usize = 4;
/// Points of a proposed line.
const LINE_POINTS: usize = 9;

/// Rank and condition of an accepted plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Observability {
    pub(crate) rank: usize,
    pub(crate) unknowns: usize,
    pub(crate) condition: f64,
}

/// One low-order unknown: its name, and what it means in the full parameters.
struct Shape {
    name: String,
    entries: Vec<(usize, f64)>,
}

/// Refuses a plan that cannot see all low-order unknowns.
pub(crate) fn check(
    estimate: &Estimate,
    campaign: &Campaign,
    normal: &NormalEquations,
    absolute: bool,
) -> Result<Observability, IdentifyError> {
    let shapes = shapes(&estimate.setup, &campaign.stations, absolute);
    let reduced = reduce(normal, &shapes);
    let scales: Vec<f64> = (0..shapes.len()).map(|k| reduced[(k, k)].max(0.0).sqrt()).collect();
    let largest = scales.iter().fold(0.0_f64, |a, b| a.max(*b));
    // A column far below all others is not seen at all; equilibrating it would only magnify rounding.
    let scales: Vec<f64> = scales.iter().map(|s| if *s < 1e-9 * largest { f64::INFINITY } else { *s }).collect();
    let equilibrated = Mat::from_fn(shapes.len(), shapes.len(), |i, j| reduced[(i, j)] / (scales[i] * scales[j]));
    let (values, vectors) = symmetric_eigen(&equilibrated).ok_or(IdentifyError::Singular)?;
    let unseen: Vec<usize> = (0..values.len()).filter(|k| values[*k] < RANK_TOLERANCE).collect();
    if unseen.is_empty() {
        let condition = (values[values.len() - 1] / values[0]).sqrt();
        return Ok(Observability { rank: shapes.len(), unknowns: shapes.len(), condition });
    }
    let null = Mat::from_fn(shapes.len(), unseen.len(), |i, j| vectors[(i, unseen[j])]);
    Err(IdentifyError::RankDeficient {
        groups: groups(&shapes, &null),
        lines: proposed_lines(estimate, campaign, &shapes, &scales, &null),
        rank: shapes.len() - unseen.len(),
        unknowns: shapes.len(),
    })
}

/// Line and parabola of each error, squareness angles, stations.
fn shapes(setup: &Setup, stations: &[String], absolute: bool) -> Vec<Shape> {
    let mut shapes = Vec::new();
    for id in ErrorId::all() {
        let Some(basis) = setup.layout.basis(id) else { continue };
        let powers: &[i32] = if id.is_straightness() { &[2] } else { &[1, 2] };
        for power in powers {
            let coefficients = basis.coefficients_of_power(*power);
            if coefficients.iter().any(|c| c.abs() > 1e-9) {
                let entries = setup.layout.range(id).zip(coefficients).collect();
                shapes.push(Shape { name: id.name(), entries });
            }
        }
    }
    for (entry, index) in setup.machine.squareness.iter().zip(setup.layout.squareness()) {
        shapes.push(Shape { name: entry.name.clone(), entries: vec![(index, 1.0)] });
    }
    for (k, station) in stations.iter().enumerate() {
        let count = if absolute { 3 } else { 4 };
        for (d, what) in ["x", "y", "z", "dead path"].into_iter().enumerate().take(count) {
            let index = setup.layout.len() + 4 * k + d;
            shapes.push(Shape { name: format!("station {station} {what}"), entries: vec![(index, 1.0)] });
        }
    }
    shapes
}

/// Normal matrix of the shapes.
fn reduce(normal: &NormalEquations, shapes: &[Shape]) -> Mat<f64> {
    let entry = |row: usize, column: usize| normal.matrix[row.min(column) * normal.size + row.max(column)];
    Mat::from_fn(shapes.len(), shapes.len(), |i, j| {
        let one = |(a, x): &(usize, f64)| shapes[j].entries.iter().map(|(b, y)| x * y * entry(*a, *b)).sum::<f64>();
        shapes[i].entries.iter().map(one).sum()
    })
}

/// Errors that take part in each unseen combination.
///
/// The null space has no preferred basis, so each shape is ranked by how much of it lies in the null space, and
/// combinations are formed around the strongest shape that is left (a pivoted elimination).
fn groups(shapes: &[Shape], null: &Mat<f64>) -> Vec<Unobservable> {
    let mut basis = null.clone();
    let mut groups: Vec<Unobservable> = Vec::new();
    for _ in 0..null.ncols() {
        let length = |i: usize, basis: &Mat<f64>| basis.row(i).iter().map(|v| v * v).sum::<f64>().sqrt();
        let pivot = (0..shapes.len()).max_by(|a, b| length(*a, &basis).total_cmp(&length(*b, &basis))).unwrap_or(0);
        let norm = length(pivot, &basis);
        if norm < 1e-6 {
            break;
        }
        // The null vector with the largest share of the pivot, and its removal from the null space.
        let direction: Vec<f64> = basis.row(pivot).iter().map(|v| v / norm).collect();
        let vector: Vec<f64> =
            (0..shapes.len()).map(|i| basis.row(i).iter().zip(&direction).map(|(a, b)| a * b).sum()).collect();
        for i in 0..shapes.len() {
            for (j, d) in direction.iter().enumerate() {
                basis[(i, j)] -= vector[i] * d;
            }
        }
        let mut parts: Vec<usize> = (0..shapes.len()).filter(|i| vector[*i].abs() > NAMED_SHARE * norm).collect();
        parts.sort_by(|a, b| vector[*b].abs().total_cmp(&vector[*a].abs()));
        let mut errors: Vec<String> = Vec::new();
        for part in parts {
            if !errors.contains(&shapes[part].name) {
                errors.push(shapes[part].name.clone());
            }
        }
        let group = Unobservable { errors };
        if !groups.contains(&group) {
            groups.push(group);
        }
    }
    groups
}

/// A line that could be measured.
struct Candidate {
    text: String,
    readings: Vec<RangeReading>,
}

/// Greedy choice of lines that make the unseen combinations visible.
fn proposed_lines(
    estimate: &Estimate,
    campaign: &Campaign,
    shapes: &[Shape],
    scales: &[f64],
    null: &Mat<f64>,
) -> Vec<String> {
    let unseen = null.ncols();
    let candidates: Vec<(String, Mat<f64>)> = candidates(estimate, campaign)
        .into_iter()
        .map(|c| (c.text.clone(), information(estimate, &c, shapes, scales, null)))
        .collect();
    let mut total = Mat::<f64>::zeros(unseen, unseen);
    let mut chosen: Vec<String> = Vec::new();
    while chosen.len() < MAX_LINES {
        let score = |extra: &Mat<f64>| log_determinant(&(&total + extra));
        let best = candidates.iter().max_by(|a, b| score(&a.1).total_cmp(&score(&b.1)));
        let Some((text, extra)) = best else { break };
        let gain = score(extra) - log_determinant(&total);
        // A line that at least doubles what is known of some combination is worth measuring.
        if gain < 2.0_f64.ln() || chosen.contains(text) {
            break;
        }
        total = &total + extra;
        chosen.push(text.clone());
    }
    chosen
}

/// log det (I·tiny + M): grows with every combination that becomes visible.
fn log_determinant(matrix: &Mat<f64>) -> f64 {
    let scaled = matrix.clone();
    symmetric_eigen(&scaled)
        .map_or(f64::NEG_INFINITY, |(values, _)| values.iter().map(|v| (v.max(0.0) + 1e-6).ln()).sum())
}

/// What a line would tell about the unseen combinations, with a new dead path allowed for.
fn information(estimate: &Estimate, line: &Candidate, shapes: &[Shape], scales: &[f64], null: &Mat<f64>) -> Mat<f64> {
    let mut row = Row::new();
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for reading in &line.readings {
        estimate.row(reading, &mut row);
        let mut full = vec![0.0; estimate.parameters.len()];
        row.segments().for_each(|(first, values)| full[first..first + values.len()].copy_from_slice(values));
        let by_shape: Vec<f64> = shapes.iter().map(|s| s.entries.iter().map(|(k, v)| full[*k] * v).sum()).collect();
        let seen = |j: usize| {
            (0..shapes.len())
                .map(|i| null[(i, j)] * if scales[i].is_finite() { by_shape[i] / scales[i] } else { by_shape[i] })
                .sum()
        };
        rows.push((0..null.ncols()).map(seen).collect());
    }
    let mean: Vec<f64> =
        (0..null.ncols()).map(|j| rows.iter().map(|r| r[j]).sum::<f64>() / rows.len().max(1) as f64).collect();
    let largest = rows.iter().flatten().fold(0.0_f64, |a, b| a.max(b.abs())).max(f64::MIN_POSITIVE);
    let _ = largest;
    Mat::from_fn(null.ncols(), null.ncols(), |i, j| rows.iter().map(|r| (r[i] - mean[i]) * (r[j] - mean[j])).sum())
}

/// Lines along each axis at low, middle and high places with the offsets of the campaign and a few new ones.
fn candidates(estimate: &Estimate, campaign: &Campaign) -> Vec<Candidate> {
    let machine = estimate.setup.machine;
    let base = campaign.readings.first().map_or([0.0; 3], |r| r.offset_m);
    let mut offsets = vec![base];
    for (d, shift_m) in [(0, 0.12), (1, 0.14), (2, -0.08)] {
        let mut offset = base;
        offset[d] += shift_m;
        offsets.push(offset);
    }
    let at = |axis: usize, share: f64| {
        let (lower, upper) = machine.stroke_m[axis];
        lower + share * (upper - lower)
    };
    let mut candidates = Vec::new();
    for axis in 0..3 {
        let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
        for (place_a, place_b) in [(0.05, 0.05), (0.95, 0.05), (0.05, 0.95), (0.95, 0.95), (0.5, 0.5)] {
            for offset_m in &offsets {
                for station in 0..campaign.stations.len().min(3) {
                    let mut start = [0.0; 3];
                    (start[a], start[b]) = (at(a, place_a), at(b, place_b));
                    let reading = |k: usize| {
                        let mut reading_m = start;
                        reading_m[axis] = at(axis, 0.02 + 0.96 * k as f64 / (LINE_POINTS - 1) as f64);
                        RangeReading {
                            station: station as u32,
                            line: 0,
                            time_s: 0.0,
                            reading_m,
                            offset_m: *offset_m,
                            length_m: 0.0,
                        }
                    };
                    let text = line_text(axis, a, b, &start, offset_m, &campaign.stations[station]);
                    candidates.push(Candidate { text, readings: (0..LINE_POINTS).map(reading).collect() });
                }
            }
        }
    }
    candidates
}

fn line_text(axis: usize, a: usize, b: usize, start: &[f64; 3], offset_m: &[f64; 3], station: &str) -> String {
    let letter = ["X", "Y", "Z"];
    format!(
        "a line along {} at {} = {:.0} mm, {} = {:.0} mm with reflector offset ({:.0}, {:.0}, {:.0}) mm from station {station}",
        letter[axis],
        letter[a],
        start[a] * 1e3,
        letter[b],
        start[b] * 1e3,
        offset_m[0] * 1e3,
        offset_m[1] * 1e3,
        offset_m[2] * 1e3,
    )
}
