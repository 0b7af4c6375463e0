//! Whether yaw from three targets on a tracker can agree with the nine-line method to 0.74″ at every position.
//!
//! Place in the flow: rows of [`super::figures`]. A guideway is simulated, read by a tracker, and solved; the nine-line method
//! is taken as the truth, which favours agreement. The largest difference over the positions is what the paper prints.

use super::PAPER;
use crate::figure::{Figure, PaperError, Settings, Verdict};
use crate::statistics::Interval;
use abbe_measurement::guideway::{
    Guideway, GuidewayAxis, GuidewayFrame, GuidewayOptions, GuidewayRotation, TargetPoint,
};
use abbe_measurement::tracker::{TrackerReading, TrackerUncertainty};
use abbe_virtual_machine::guideway::{GuidewayScene, TrackerNoise};

const PLACE: &str = "fig. 6";
const PUBLISHED_ARCSEC: f64 = 0.74;
const ARC_SECOND: f64 = std::f64::consts::PI / 648_000.0;
const FULL_RUNS: usize = 400;
/// Positions along the stroke; the paper does not give their number.
const POSITIONS: usize = 21;
/// A tracker of the usual class, k = 1: interferometer along the beam, encoders across it. The paper names the instrument
/// only.
pub(super) const DATA_SHEET: TrackerUncertainty = TrackerUncertainty {
    range_constant_m: 0.5e-6,
    range_per_metre: 0.5e-6,
    transverse_constant_m: 5e-6,
    transverse_per_metre: 2e-6,
};

/// The tracker's readings repeat better than they are accurate: this share of the data sheet, of one point against another
/// seconds later, is assumed for the second row.
const REPEATING: f64 = 0.1;

pub(super) fn figures(settings: &Settings) -> Result<Vec<Figure>, PaperError> {
    let runs = settings.runs(FULL_RUNS, 10);
    let largest = |share: f64| -> Result<Vec<f64>, PaperError> {
        (0..runs as u64).map(|k| largest_difference(share, settings.seed.wrapping_add(k))).collect()
    };
    let (full, repeating) = (largest(1.0)?, largest(REPEATING)?);
    let needed = needed_share(settings, runs)?;
    let row = |what: String, values: &[f64], reason: String| {
        let below = values.iter().filter(|v| **v <= PUBLISHED_ARCSEC).count();
        Figure {
            place: PLACE,
            what,
            published: Some(format!("{PUBLISHED_ARCSEC}")),
            reproduced: format!(
                "{}; at most 0.74 in {below} of {} runs",
                Interval::of(values).map_or_else(String::new, |i| i.text(2)),
                values.len()
            ),
            how: format!(
                "simulated: {POSITIONS} positions on 1 m, three targets 300 mm apart, tracker 2 m behind the table, truth in the \
                 place of the nine-line method"
            ),
            verdict: Verdict::NotPublished,
            reason,
        }
    };
    Ok(vec![
        row(
            "largest difference of yaw (arcsec), tracker as accurate as its data sheet at every point".to_owned(),
            &full,
            "the readings are not published; errors of this size, independent from point to point, would not allow 0.74".to_owned(),
        ),
        row(
            "largest difference of yaw (arcsec), a tenth of that from point to point".to_owned(),
            &repeating,
            "what matters is how well neighbouring readings repeat, not how accurate they are".to_owned(),
        ),
        Figure {
            place: PLACE,
            what: "uncertainty at which half of the runs stay within 0.74 arcsec, range and across the beam at 2.5 m (µm, k = 1)"
                .to_owned(),
            published: None,
            reproduced: format!(
                "{:.2} and {:.2}, {:.0} % of the data sheet",
                needed * (DATA_SHEET.range_constant_m + 2.5 * DATA_SHEET.range_per_metre) * 1e6,
                needed * (DATA_SHEET.transverse_constant_m + 2.5 * DATA_SHEET.transverse_per_metre) * 1e6,
                needed * 100.0
            ),
            how: "median of the largest difference is in proportion to the noise".to_owned(),
            verdict: Verdict::NotPublished,
            reason: "0.74 is plausible for readings that are averaged and repeat to tenths of a micrometre along the beam and about \
                     a micrometre across it, with yaw resting on range; not for single readings of the stated class"
                .to_owned(),
        },
    ])
}

/// Share of the data sheet at which the median of the largest difference is the published one: errors of yaw are linear in
/// the noise, so one scale is enough.
fn needed_share(settings: &Settings, runs: usize) -> Result<f64, PaperError> {
    let mut values: Vec<f64> = (0..runs as u64)
        .map(|k| largest_difference(REPEATING, settings.seed.wrapping_add(k)))
        .collect::<Result<_, _>>()?;
    values.sort_by(f64::total_cmp);
    let median = values.get(values.len() / 2).copied().unwrap_or(f64::NAN);
    Ok(REPEATING * PUBLISHED_ARCSEC / median)
}

fn scene(share: f64) -> GuidewayScene {
    GuidewayScene {
        axis: 0,
        positions_m: (0..POSITIONS).map(|k| k as f64 / (POSITIONS - 1) as f64).collect(),
        targets_m: vec![[2.0, -0.15, 0.0], [2.3, 0.0, 0.02], [2.0, 0.15, 0.0]],
        tracker_m: [0.0, 0.05, 0.3],
        azimuth_rad: 0.0,
        noise: TrackerNoise {
            range_constant_m: DATA_SHEET.range_constant_m * share,
            range_per_metre: DATA_SHEET.range_per_metre * share,
            transverse_constant_m: DATA_SHEET.transverse_constant_m * share,
            transverse_per_metre: DATA_SHEET.transverse_per_metre * share,
        },
        displacement_m: 10e-6,
        rotation_rad: 5.0 * ARC_SECOND,
    }
}

fn largest_difference(share: f64, seed: u64) -> Result<f64, PaperError> {
    let failed = |error: &dyn std::fmt::Display| PaperError { paper: PAPER, place: PLACE, problem: error.to_string() };
    let scene = scene(share);
    let made = scene.measure(seed).map_err(|error| failed(&error))?;
    let tracker_m = nalgebra::Vector3::from(scene.tracker_m);
    let point = |r: &abbe_virtual_machine::guideway::TargetReading| {
        let reading = TrackerReading { range_m: r.range_m, azimuth_rad: r.azimuth_rad, elevation_rad: r.elevation_rad };
        TargetPoint {
            position_m: scene.positions_m[r.position],
            target: format!("T{}", r.target),
            point_m: reading.point_m() + tracker_m,
            covariance_m2: Some(DATA_SHEET.covariance_m2(&reading)),
        }
    };
    let points: Vec<TargetPoint> = made.readings.iter().map(point).collect();
    let options = GuidewayOptions {
        axis: GuidewayAxis::X,
        frame: GuidewayFrame::Given,
        rotation: GuidewayRotation::SmallAngle,
        reference_m: None,
    };
    let solved = Guideway::new(&points, options).map_err(|error| failed(&error))?;
    let off: Vec<f64> =
        solved.positions.iter().zip(&made.truth).map(|(found, truth)| found.errors[5] - truth[5]).collect();
    // Two curves of yaw are compared about a common level: their first position is no better than the others.
    let level = off.iter().sum::<f64>() / off.len().max(1) as f64;
    Ok(off.iter().map(|o| (o - level).abs() / ARC_SECOND).fold(0.0, f64::max))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Small-angle yaw of an exact table with 5″ errors differs from the truth by products of angles only: 5″ is 24 µrad,
    /// its square 1e-4″.
    #[test]
    fn without_noise_the_yaw_of_the_simulated_table_is_found() {
        assert!(largest_difference(0.0, 3).unwrap() < 1e-3);
    }

    #[test]
    fn differences_are_in_proportion_to_the_noise_and_match_the_planned_uncertainty() {
        let (one, tenth) = (largest_difference(1.0, 8).unwrap(), largest_difference(0.1, 8).unwrap());
        assert!((one / tenth / 10.0 - 1.0).abs() < 1e-2, "{one} {tenth}");
        let targets: Vec<_> = scene(1.0).targets_m.iter().map(|t| nalgebra::Vector3::from(*t)).collect();
        let u = super::super::arrangement::seen(&targets, &scene(1.0).tracker_m.into(), &DATA_SHEET).unwrap();
        // The largest of 21 normal deviates is 1 to 4 of their standard deviations, each √½ of a difference's; the table
        // moves away by 1 m meanwhile.
        assert!((0.5 * u[5]..5.0 * u[5]).contains(&one), "{one} {u:?}");
    }

    #[test]
    fn regress_the_published_agreement_is_out_of_reach_of_single_readings() {
        let figures = figures(&Settings { seed: 1, effort: 0.0 }).unwrap();
        assert_eq!(figures.len(), 3);
        assert!(figures[0].reproduced.contains("at most 0.74 in 0 of 10 runs"), "{}", figures[0].reproduced);
    }
}
