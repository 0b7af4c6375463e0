//! What smooth errors and waves leave of the means of the targets: as much may lie between them, too.
//!
//! Place in the flow: part of the study of runs, for the uncertainty of its models. A bow too small to be found, or a wave that few targets do not tell, is
//! in how the means of the targets depart from what was found. Its variance is the mean of what these departures leave possible, all sizes
//! being as likely beforehand, beside the scatter of the repeats. A table of errors has no such departures, and knows what it does between its places
//! by itself.

use super::super::model::{axis_of, lack};
use super::super::shape::Shape;
use super::{AxisRuns, Runs, UNIT_M, key};
use crate::linear::column;
use crate::study::candidate::{Open, Untold};
use crate::study::series::{independent, left_by};
use faer::Mat;

/// Steps of the sum over sizes, and the largest as a multiple of the departures.
const STEPS: u32 = 400;
const LARGEST: f64 = 6.0;
/// The lowest target, where a model is zero, is off as well.
const OF_TWO: f64 = 2.0;

impl Runs {
    /// What lies at and between the targets of axes of which no table of position was found.
    pub(super) fn between_targets(&self, open: &Open) -> Vec<Untold> {
        let one = |(k, axis): (usize, &AxisRuns)| {
            let own = || open.found.iter().copied().filter(move |candidate| self.shapes[*candidate].0 == k);
            if own().next().is_none() || own().any(|candidate| self.shapes[candidate].1 == Shape::PositionTable) {
                return None;
            }
            let (variance, degrees, noise) = self.departures(axis, own(), open)?;
            let (u_m, count) =
                (UNIT_M * (OF_TWO * beyond_noise(variance, degrees, noise)).sqrt(), axis.ranges.targets.len());
            // Halfway, what both targets may be off by is half as much; the rest lies between.
            let between_m = u_m * 0.5f64.sqrt();
            let u = [vec![u_m; count], vec![between_m; count - 1], vec![u_m; 2]].concat();
            let letter = axis_of(&axis.name)?;
            let what = format!("what the targets of {} leave open beyond what was found", letter.letter());
            Some(Untold { what, is_usual: false, term: lack(letter, &axis.ranges), u, reads: None })
        };
        self.axes.iter().enumerate().filter_map(one).collect()
    }

    /// Mean square by which the means of targets depart from what was found, its degrees of freedom, and what scatter makes of it; in
    /// units of the study.
    fn departures(&self, axis: &AxisRuns, found: impl Iterator<Item = usize>, open: &Open) -> Option<(f64, f64, f64)> {
        let rows: Vec<usize> = axis.rows.iter().copied().filter(|row| (open.is_kept)(*row)).collect();
        let shapes = found.map(|candidate| self.shape_at(self.shapes[candidate].0, &self.shapes[candidate].1, &rows));
        let offset = Mat::from_fn(rows.len(), 1, |_, _| 1.0);
        let columns = crate::linear::joined(&std::iter::once(offset).chain(shapes).collect::<Vec<_>>());
        let error = |row: usize| self.runs[row].error_m() / UNIT_M;
        let left = left_by(&columns, &column(&rows.iter().map(|row| error(*row)).collect::<Vec<f64>>()));
        let place = |row: &usize| axis.ranges.targets.binary_search(&key(self.runs[*row].target_m)).ok();
        let of_row: Vec<usize> = rows.iter().map(place).collect::<Option<_>>()?;
        let mut counts = vec![0.0; axis.ranges.targets.len()];
        of_row.iter().for_each(|place| counts[*place] += 1.0);
        let means = |matrix: &Mat<f64>| {
            let mut means = Mat::zeros(counts.len(), matrix.ncols());
            for (i, place) in of_row.iter().enumerate() {
                (0..matrix.ncols()).for_each(|j| means[(*place, j)] += matrix[(i, j)] / f64::max(counts[*place], 1.0));
            }
            means
        };
        let degrees = counts.len() as f64 - independent(&means(&columns)).ncols() as f64;
        let mean = means(&left);
        let square = |(i, place): (usize, &usize)| (left[(i, 0)] - mean[(*place, 0)]).powi(2);
        let scatter =
            of_row.iter().enumerate().map(square).sum::<f64>() / (rows.len() as f64 - counts.len() as f64).max(1.0);
        let noise =
            scatter * counts.iter().map(|count| f64::max(*count, 1.0).recip()).sum::<f64>() / counts.len() as f64;
        (degrees >= 1.0).then(|| (mean.squared_norm_l2() / degrees, degrees, noise))
    }
}

/// Mean of a variance beside that of noise, by a mean square of so many degrees of freedom, all deviations being as likely beforehand.
fn beyond_noise(square: f64, degrees: f64, noise: f64) -> f64 {
    let step = LARGEST * square.max(noise).sqrt() / f64::from(STEPS);
    let each = (0..STEPS).map(|k| ((f64::from(k) + 0.5) * step).powi(2)).map(|variance| {
        let all = (noise + variance).max(f64::MIN_POSITIVE);
        (variance, -0.5 * degrees * (all.ln() + square / all))
    });
    let most = each.clone().map(|(_, likelihood)| likelihood).fold(f64::NEG_INFINITY, f64::max);
    let weighed = each.map(|(variance, likelihood)| (variance, (likelihood - most).exp()));
    let (sum, total) =
        weighed.fold((0.0, 0.0), |(sum, total), (variance, weight)| (sum + variance * weight, total + weight));
    sum / f64::max(total, f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::beyond_noise;

    #[test]
    fn departures_far_beyond_noise_are_what_they_are_and_those_of_noise_leave_a_part_of_it() {
        // Many degrees of freedom: the difference, 25 − 1.
        assert!((beyond_noise(25.0, 400.0, 1.0) - 24.0).abs() < 0.5);
        let open = beyond_noise(1.0, 8.0, 1.0);
        assert!((0.2..1.0).contains(&open), "{open}");
        assert!(beyond_noise(1.0, 400.0, 1.0) < 0.15);
    }
}
