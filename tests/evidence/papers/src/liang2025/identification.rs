//! Liang 2025, section 2 and 4.1: which parameters the positions determine, and JADE against Levenberg-Marquardt.
//!
//! Place in the flow: called by [`super::figures`]. The paper gives two reasons for JADE: least squares costs too much, and it
//! may end in a local minimum. Both are tested here on simulated measurements with known truth: with the objective of
//! eq. 11, and with gross errors under losses that bear them. Times need a clock, which models do not have: they stand in
//! `docs/src/figures` (`cargo bench -p abbe-identify --bench jade`); here evaluations are counted.

use super::simulated::{Measurement, NOISE_M, Shifted, failed};
use crate::figure::{Figure, PaperError, Settings, Verdict};
use crate::statistics::Interval;
use abbe_geometry::chain::{ErrorValues, chain_point};
use abbe_geometry::correct::correct;
use abbe_geometry::effects::{NoCovariates, State};
use abbe_geometry::{ErrorId, Vector3};
use abbe_identify::points::{FittedPoints, JadeChoices, Loss, Method, PointOptions, PointsError, fit_points};
use abbe_measurement::alignment::aligned_residuals_m;
use nalgebra::DMatrix;

/// Degree of the polynomials whose parameters are counted.
const COUNTED_DEGREE: usize = 4;
/// Degree in the comparison: 33 coefficients and angles, 6 for the frame.
const COMPARED_DEGREE: usize = 2;
/// Seeds at full effort, and at the least.
const SEEDS: (usize, usize) = (10, 1);
/// Shares of shifted lines, and whether all are shifted alike.
const SHIFTS: [(f64, bool); 4] = [(0.1, false), (0.45, false), (0.3, true), (0.45, true)];
/// Shift of a line (m): a hundred times the noise.
const SHIFT_M: f64 = 30e-6;
/// Factor from which an error is clearly larger than another.
const CLEARLY: f64 = 1.5;
/// Eigenvalue of JᵀJ, scaled to a unit diagonal, below which a combination of parameters moves no point.
const UNSEEN_EIGENVALUE: f64 = 1e-11;
/// Points of the volume at which corrected machines are compared, along each axis.
const CHECKS: usize = 4;

/// The figures of the identification.
pub(super) fn figures(settings: &Settings) -> Result<Vec<Figure>, PaperError> {
    let mut of_runs = vec![same_minimum(settings)?];
    for (share, together) in SHIFTS {
        of_runs.push(gross_errors(settings, Shifted { share, by_m: SHIFT_M, together })?);
    }
    of_runs.push(largest_residual(settings)?);
    let mut figures = vec![parameters(settings)?];
    figures.extend(of_runs.into_iter().map(|figure| settings.of_runs(figure)));
    Ok(figures)
}

/// Eq. 9 and 10: how many of the listed parameters the positions determine.
fn parameters(settings: &Settings) -> Result<Figure, PaperError> {
    let measurement = Measurement::new(settings.seed, COUNTED_DEGREE, None)?;
    let (listed, rank) = rank_as_listed(&measurement);
    let found = fit(&measurement, Method::LevenbergMarquardt, Loss::Squares)?;
    let expected = listed - 15;
    Ok(Figure {
        place: "Eq. 9-10",
        what: format!(
            "parameters of 18 polynomials a₀ … a{COUNTED_DEGREE} and 3 squareness angles that are determined"
        ),
        published: Some(format!("{listed}, all")),
        reproduced: format!(
            "{rank} combinations; Abbe fits {}, three of them the turn of the offset, and the pose of the tracer's frame",
            found.evidence.unknowns - 6
        ),
        how: "rank of the Jacobian of eq. 7 on edges and inner lines with three offsets".to_owned(),
        verdict: if rank == listed { Verdict::Reproduced } else { Verdict::DoesNotFollow },
        reason: format!(
            "the constants a₀ of the linear errors only add up, those of the angles and the squareness angles repeat slopes \
             of the linear errors or turn the offset: {} combinations move no point{}; six more are the pose of the frame, three the \
             turn of the offset",
            listed - rank,
            if rank == expected { "" } else { " (15 were expected)" }
        ),
    })
}

/// Parameters as the paper lists them, and their rank.
fn rank_as_listed(measurement: &Measurement) -> (usize, usize) {
    let powers = COUNTED_DEGREE + 1;
    let listed = ErrorId::COUNT * powers + 3;
    let mut jacobian = DMatrix::zeros(3 * measurement.points.len(), listed);
    for (row, point) in measurement.points.iter().enumerate() {
        let at = chain_point(&measurement.machine, point.reading_m, point.offset_m, &ErrorValues::ZERO);
        for id in ErrorId::all() {
            let (lower_m, upper_m) = measurement.machine.stroke_m[id.axis().index()];
            let t = (point.reading_m[id.axis().index()] - lower_m) / (upper_m - lower_m);
            for power in 0..powers {
                let column = at.by_error[id.index()] * t.powi(power as i32);
                (0..3).for_each(|d| jacobian[(3 * row + d, id.index() * powers + power)] = column[d]);
            }
        }
        for (k, column) in at.by_squareness.iter().enumerate() {
            (0..3).for_each(|d| jacobian[(3 * row + d, ErrorId::COUNT * powers + k)] = column[d]);
        }
    }
    let normal = jacobian.tr_mul(&jacobian);
    let scale = |k: usize| normal[(k, k)].max(f64::MIN_POSITIVE).sqrt();
    let scaled = DMatrix::from_fn(listed, listed, |i, j| normal[(i, j)] / (scale(i) * scale(j)));
    let unseen = scaled.symmetric_eigenvalues().iter().filter(|value| **value < UNSEEN_EIGENVALUE).count();
    (listed, listed - unseen)
}

/// Eq. 11 to 14: JADE and Levenberg-Marquardt on the paper's objective.
fn same_minimum(settings: &Settings) -> Result<Figure, PaperError> {
    let (mut apart, mut evaluations, mut steps) = (Vec::new(), Vec::new(), Vec::new());
    let mut better = 0;
    for seed in seeds(settings) {
        let measurement = Measurement::new(seed, COMPARED_DEGREE, None)?;
        let direct = fit(&measurement, Method::LevenbergMarquardt, Loss::Squares)?;
        let jade = fit(&measurement, jade(seed), Loss::Squares)?;
        apart.push(jade.evidence.largest_step);
        evaluations.push(jade.evidence.evaluations.unwrap_or(0) as f64);
        steps.push(direct.evidence.steps as f64);
        better += usize::from(jade.evidence.objective < direct.evidence.objective * (1.0 - 1e-9));
    }
    let worst = apart.iter().fold(0.0, |most: f64, value| most.max(*value));
    Ok(Figure {
        place: "Eq. 11-14",
        what: "JADE finds better parameters than least squares".to_owned(),
        published: Some("claimed, without a figure".to_owned()),
        reproduced: format!(
            "better in {better} of {}; the same point within {worst:.3} standard uncertainties; {} evaluations against {} \
             steps of Levenberg-Marquardt",
            apart.len(),
            text(&evaluations, 0),
            text(&steps, 1)
        ),
        how: format!("eq. 11 on {} simulated machines, degree {COMPARED_DEGREE}, normal noise", apart.len()),
        verdict: if better == 0 { Verdict::DoesNotFollow } else { Verdict::Reproduced },
        reason: "eq. 11 is quadratic but for products of angles of 1e-5: it has one minimum, which least squares reaches in a \
                 few steps"
            .to_owned(),
    })
}

/// Gross errors: what each loss and each way leave in the volume.
fn gross_errors(settings: &Settings, shifted: Shifted) -> Result<Figure, PaperError> {
    let ways = [
        ("squares", false, Loss::Squares),
        ("Huber", false, Loss::Huber),
        ("trimmed squares", false, Loss::Trimmed),
        ("trimmed squares by JADE", true, Loss::Trimmed),
    ];
    // One row a machine, one entry a way; missing where the points within the cut do not determine all unknowns.
    let mut left: Vec<Vec<Option<f64>>> = Vec::new();
    for seed in seeds(settings) {
        let measurement = Measurement::new(seed, COMPARED_DEGREE, Some(shifted))?;
        let of = |(_, by_jade, loss): &(&str, bool, Loss)| {
            let method = if *by_jade { jade(seed) } else { Method::LevenbergMarquardt };
            match fit_or_refusal(&measurement, method, *loss) {
                Ok(found) => left_um(&measurement, &found).map(Some),
                Err(PointsError::Singular | PointsError::TooFew { .. }) => Ok(None),
                Err(other) => Err(failed(other)),
            }
        };
        left.push(ways.iter().map(of).collect::<Result<_, _>>()?);
    }
    let words = ways.iter().enumerate().map(|(k, (name, _, _))| {
        let values: Vec<f64> = left.iter().filter_map(|row| row[k]).collect();
        let refused = left.len() - values.len();
        let refused = if refused > 0 { format!(" ({refused} refused)") } else { String::new() };
        format!("{name} {}{refused}", text(&values, 2))
    });
    let both = || left.iter().filter_map(|row| row[2].zip(row[3]));
    let ratios: Vec<f64> = both().map(|(direct, jade)| jade / direct).collect();
    let wins = ratios.iter().filter(|ratio| **ratio < 1.0 / CLEARLY).count();
    let losses = ratios.iter().filter(|ratio| **ratio > CLEARLY).count();
    let (mean, low, high) = Interval::of_ratios(&ratios).unwrap_or((1.0, 0.0, f64::INFINITY));
    Ok(Figure {
        place: "Section 2",
        what: format!(
            "{:.0} % of the lines shifted by {:.0} µm: error left in the volume, rms (µm)",
            shifted.share * 100.0,
            SHIFT_M * 1e6
        ),
        published: None,
        reproduced: words.collect::<Vec<_>>().join("; "),
        how: format!("{} simulated machines, degree {COMPARED_DEGREE}; mean with 95 % interval", left.len()),
        verdict: Verdict::NotPublished,
        reason: format!(
            "with the same loss JADE left {mean:.2} (95 %: {low:.2} to {high:.2}) times what Levenberg-Marquardt left, clearly \
             less on {wins} and clearly more on {losses} of {} machines",
            ratios.len()
        ),
    })
}

/// Fig. 8: the largest residual after correction.
fn largest_residual(settings: &Settings) -> Result<Figure, PaperError> {
    let (mut residuals, mut before) = (Vec::new(), Vec::new());
    for seed in settings.seed..settings.seed + settings.runs(100, 5) as u64 {
        let measurement = Measurement::new(seed, COUNTED_DEGREE, None)?;
        let found = fit(&measurement, Method::LevenbergMarquardt, Loss::Squares)?;
        residuals.push(found.evidence.largest_residual_m * 1e6);
        let error_m = |p: &abbe_identify::points::MeasuredPoint| {
            let indicated_m = Vector3::from(p.reading_m) + Vector3::from(p.offset_m);
            (Vector3::from(measurement.truth.actual_point_m(p.reading_m, p.offset_m)) - indicated_m).norm()
        };
        before.push(measurement.points.iter().map(error_m).fold(0.0, f64::max) * 1e6);
    }
    Ok(Figure {
        place: "Fig. 8",
        what: "largest distance between measured and corrected position (µm)".to_owned(),
        published: Some("2.2943".to_owned()),
        reproduced: format!("{}; {} before correction", text(&residuals, 2), text(&before, 1)),
        how: format!("{} simulated machines, {:.1} µm noise in each coordinate", residuals.len(), NOISE_M * 1e6),
        verdict: Verdict::NotPublished,
        reason: "a rigid machine with polynomial errors leaves the noise; what is more in the paper is what its network is for".to_owned(),
    })
}

fn seeds(settings: &Settings) -> std::ops::Range<u64> {
    settings.seed..settings.seed + settings.runs(SEEDS.0, SEEDS.1) as u64
}

fn jade(seed: u64) -> Method {
    Method::Jade(JadeChoices { seed, ..JadeChoices::default() })
}

fn fit(measurement: &Measurement, method: Method, loss: Loss) -> Result<FittedPoints, PaperError> {
    fit_or_refusal(measurement, method, loss).map_err(failed)
}

fn fit_or_refusal(measurement: &Measurement, method: Method, loss: Loss) -> Result<FittedPoints, PointsError> {
    let options = PointOptions { method, loss };
    fit_points(&measurement.machine, &measurement.points, &options, &mut |_| true)
}

/// Rms length (µm) of true minus corrected position over the volume, aligned rigidly.
fn left_um(measurement: &Measurement, found: &FittedPoints) -> Result<f64, PaperError> {
    let (mut corrected_m, mut actual_m) = (Vec::new(), Vec::new());
    for k in 0..CHECKS.pow(3) {
        let at = |d: usize| {
            let (lower_m, upper_m) = measurement.machine.stroke_m[d];
            lower_m + (upper_m - lower_m) * ((k / CHECKS.pow(d as u32) % CHECKS) as f64 + 0.5) / CHECKS as f64
        };
        let (reading_m, offset_m) = ([at(0), at(1), at(2)], [0.06, 0.05, -0.06]);
        let state = State { reading_m, offset_m, covariates: &NoCovariates };
        corrected_m.push(correct(&found.model, &state).position_m);
        actual_m.push(Vector3::from(measurement.truth.actual_point_m(reading_m, offset_m)));
    }
    let left = aligned_residuals_m(&corrected_m, &actual_m).map_err(failed)?;
    Ok((left.iter().map(Vector3::norm_squared).sum::<f64>() / left.len() as f64).sqrt() * 1e6)
}

fn text(values: &[f64], decimals: usize) -> String {
    Interval::of(values).map_or_else(|| "no run".to_owned(), |interval| interval.text(decimals))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fifteen_combinations_of_the_listed_parameters_move_no_point() {
        let measurement = Measurement::new(1, COUNTED_DEGREE, None).unwrap();
        assert_eq!(rank_as_listed(&measurement), (93, 78));
        let figure = parameters(&Settings { seed: 1, effort: 0.01 }).unwrap();
        assert_eq!(figure.verdict, Verdict::DoesNotFollow);
        assert!(figure.reproduced.starts_with("78 combinations; Abbe fits 72, three"), "{}", figure.reproduced);
    }

    #[test]
    fn without_gross_errors_the_noise_is_left() {
        let measurement = Measurement::new(4, COMPARED_DEGREE, None).unwrap();
        let found = fit(&measurement, Method::LevenbergMarquardt, Loss::Squares).unwrap();
        // 0.3 µm noise, five equations an unknown.
        assert!(left_um(&measurement, &found).unwrap() < 0.3);
        let shifted = Some(Shifted { share: 0.3, by_m: SHIFT_M, together: false });
        let spoilt = Measurement::new(4, COMPARED_DEGREE, shifted).unwrap();
        let found = fit(&spoilt, Method::LevenbergMarquardt, Loss::Squares).unwrap();
        assert!(left_um(&spoilt, &found).unwrap() > 3.0);
    }
}
