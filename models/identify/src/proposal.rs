//! Lines that would make a refused plan see everything.
//!
//! Place in the flow: [`crate::observability`] asks when it refuses a plan. Candidates are lines along each axis at
//! the edges and in the middle of the volume, from the first stations, with the campaign's own reflector offsets and
//! a few new ones (m, machine and ram frame). They are added one by one, each time the one that raises the
//! determinant of the equilibrated normal matrix most (D-optimality), until the rank is full.

use crate::design::{Estimate, Row};
use crate::linear::Factor;
use crate::spectrum::{Shape, Spectrum};
use abbe_measurement::campaign::{Campaign, RangeReading};
use faer::Mat;

/// Most lines proposed: more would be another plan.
const MAX_LINES: usize = 6;
/// Points of a proposed line.
const LINE_POINTS: usize = 9;
/// Stations that candidates are measured from, and own offsets tried.
const TRIED: usize = 3;
/// New offsets tried beside the campaign's own: shifts that a reflector on a bar allows (m, ram frame).
const SHIFTS_M: [[f64; 3]; 3] = [[0.12, 0.0, 0.0], [0.0, 0.14, 0.0], [0.0, 0.0, -0.08]];
/// Where lines lie, as shares of the other two strokes.
const PLACES: [(f64, f64); 5] = [(0.05, 0.05), (0.95, 0.05), (0.05, 0.95), (0.95, 0.95), (0.5, 0.5)];
/// Added to the diagonal so that a matrix without full rank has a determinant.
const RIDGE: f64 = 1e-9;

/// A line that could be measured, and what it would add to the normal matrix of the low-order unknowns.
struct Candidate {
    text: String,
    adds: Mat<f64>,
}

/// The fewest lines found that complete the plan; none if no set of up to six lines does.
pub(crate) fn lines(estimate: &Estimate, campaign: &Campaign, shapes: &[Shape], plan: &Mat<f64>) -> Vec<String> {
    let own = own_offsets_m(campaign);
    let base_m = own.first().copied().unwrap_or([0.0; 3]);
    let shifted = SHIFTS_M.map(|shift_m| std::array::from_fn(|d| base_m[d] + shift_m[d]));
    // A reflector that is mounted already is easier than a new offset: try those alone first.
    let with_own = completed(plan, &candidates(estimate, campaign, shapes, &own));
    with_own
        .or_else(|| {
            let all: Vec<[f64; 3]> = own.iter().chain(&shifted).copied().collect();
            completed(plan, &candidates(estimate, campaign, shapes, &all))
        })
        .unwrap_or_default()
}

/// The first few offsets that the campaign was measured with.
fn own_offsets_m(campaign: &Campaign) -> Vec<[f64; 3]> {
    let mut offsets: Vec<[f64; 3]> = Vec::new();
    for reading in &campaign.readings {
        if offsets.len() < TRIED && !offsets.contains(&reading.offset_m) {
            offsets.push(reading.offset_m);
        }
    }
    offsets
}

/// Lines whose sum gives the plan full rank; `None` if they do not within [`MAX_LINES`].
fn completed(plan: &Mat<f64>, candidates: &[Candidate]) -> Option<Vec<String>> {
    let mut chosen: Vec<&Candidate> = Vec::new();
    let scales = scales(plan, candidates);
    while !is_complete(plan, &chosen) {
        let total = sum(plan, &chosen);
        let score = |candidate: &Candidate| log_determinant(&(&total + &candidate.adds), &scales);
        let scored = candidates.iter().map(|candidate| (score(candidate), candidate));
        let (_, best) = scored.max_by(|a, b| a.0.total_cmp(&b.0))?;
        if chosen.len() == MAX_LINES {
            return None;
        }
        chosen.push(best);
    }
    // An early choice may have become superfluous through a later one.
    for k in (0..chosen.len()).rev() {
        let mut without = chosen.clone();
        without.remove(k);
        if is_complete(plan, &without) {
            chosen = without;
        }
    }
    Some(chosen.into_iter().map(|candidate| candidate.text.clone()).collect())
}

fn sum(plan: &Mat<f64>, chosen: &[&Candidate]) -> Mat<f64> {
    chosen.iter().fold(plan.clone(), |total, candidate| total + &candidate.adds)
}

fn is_complete(plan: &Mat<f64>, chosen: &[&Candidate]) -> bool {
    Spectrum::new(&sum(plan, chosen)).is_some_and(|spectrum| spectrum.unseen() == 0)
}

/// What the plan and all candidates together tell of each unknown: the common scale of all comparisons.
fn scales(plan: &Mat<f64>, candidates: &[Candidate]) -> Vec<f64> {
    let information = |k: usize| plan[(k, k)] + candidates.iter().map(|c| c.adds[(k, k)]).sum::<f64>();
    (0..plan.nrows()).map(|k| information(k).max(f64::MIN_POSITIVE).sqrt()).collect()
}

fn log_determinant(matrix: &Mat<f64>, scales: &[f64]) -> f64 {
    let ridge = |i: usize, j: usize| if i == j { RIDGE } else { 0.0 };
    let n = matrix.nrows();
    let scaled = Mat::from_fn(n, n, |i, j| matrix[(i, j)] / (scales[i] * scales[j]) + ridge(i, j));
    Factor::new(&scaled).map_or(f64::NEG_INFINITY, |factor| factor.log_determinant())
}

fn candidates(estimate: &Estimate, campaign: &Campaign, shapes: &[Shape], offsets_m: &[[f64; 3]]) -> Vec<Candidate> {
    let mut candidates = Vec::new();
    for axis in 0..3 {
        for place in PLACES {
            for offset_m in offsets_m {
                for (station, name) in campaign.stations.iter().enumerate().take(TRIED) {
                    let line = Line { axis, place, offset_m: *offset_m, station: station as u32 };
                    let text = line.text(estimate, name);
                    candidates.push(Candidate { text, adds: line.information(estimate, shapes) });
                }
            }
        }
    }
    candidates
}

/// A straight line along one axis.
struct Line {
    axis: usize,
    /// Shares of the strokes of the next two axes.
    place: (f64, f64),
    offset_m: [f64; 3],
    station: u32,
}

impl Line {
    /// Axis readings at a share of the line (m).
    fn reading_m(&self, estimate: &Estimate, share: f64) -> [f64; 3] {
        let mut shares = [share; 3];
        (shares[(self.axis + 1) % 3], shares[(self.axis + 2) % 3]) = self.place;
        std::array::from_fn(|axis| {
            let (lower_m, upper_m) = estimate.setup.machine.stroke_m[axis];
            lower_m + shares[axis] * (upper_m - lower_m)
        })
    }

    /// What the line would add to the normal matrix of the shapes.
    fn information(&self, estimate: &Estimate, shapes: &[Shape]) -> Mat<f64> {
        let mut row = Row::new();
        let mut rows = Mat::zeros(LINE_POINTS, shapes.len());
        for k in 0..LINE_POINTS {
            let share = 0.02 + 0.96 * k as f64 / (LINE_POINTS - 1) as f64;
            let reading_m = self.reading_m(estimate, share);
            let (station, offset_m) = (self.station, self.offset_m);
            let reading = RangeReading { station, line: 0, time_s: 0.0, reading_m, offset_m, length_m: 0.0 };
            estimate.row_without_effects(&reading, &mut row);
            let mut full = vec![0.0; estimate.parameters.len()];
            row.segments().for_each(|(first, values)| full[first..first + values.len()].copy_from_slice(values));
            let u_m = estimate.setup.u_m(&row.ray);
            shapes.iter().enumerate().for_each(|(j, shape)| rows[(k, j)] = shape.of_row(&full) / u_m);
        }
        rows.transpose() * &rows
    }

    fn text(&self, estimate: &Estimate, station: &str) -> String {
        let letters = ['X', 'Y', 'Z'];
        let (a, b) = ((self.axis + 1) % 3, (self.axis + 2) % 3);
        let at_mm = self.reading_m(estimate, 0.5).map(|v| v * 1e3);
        let [x_mm, y_mm, z_mm] = self.offset_m.map(|v| v * 1e3);
        format!(
            "along {} at {} = {:.0} mm, {} = {:.0} mm, reflector offset ({x_mm:.0}, {y_mm:.0}, {z_mm:.0}) mm, station \
             {station}",
            letters[self.axis], letters[a], at_mm[a], letters[b], at_mm[b]
        )
    }
}
