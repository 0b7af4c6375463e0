//! Correlated range noise is found, taken into account and said; white noise is left alone.
//!
//! Place in the flow: simulated machines whose tracer has, beside its declared noise, a first-order autoregression in the order
//! of measurement. SI, machine frame.

use crate::common::{Case, INSTRUMENT, SPLINE};
use abbe_geometry::Matrix3;
use abbe_geometry::Vector3;
use abbe_identify::{Along, Identified, IdentifyOptions, Noise, in_parallel};
use abbe_virtual_machine::instrument::Correlated;
use abbe_virtual_machine::{TruthRecipe, simulate_campaign};

/// Machines of each kind of noise: the share covered by one varies by 4 %, so that the mean of 12 is known to 1.2 %.
const MACHINES: u64 = 12;
const POINTS: usize = 100;
/// Quantile of the normal distribution for 95 %.
const QUANTILE: f64 = 1.96;
/// 0.3 µm beside some 0.33 µm of declared noise.
const DEVIATION_M: f64 = 0.3e-6;

/// The data are asked.
fn estimated() -> IdentifyOptions {
    IdentifyOptions { noise: Noise::Estimated, ..IdentifyOptions::default() }
}

fn case(seed: u64, neighbours: f64, by_line: bool) -> Case {
    let truth = TruthRecipe { seed, ..TruthRecipe::default() }.bridge_xyz().unwrap();
    let mut case = Case::case_like(truth, SPLINE, seed + 500);
    case.config.instrument.correlated = Some(Correlated { deviation_m: DEVIATION_M, neighbours, by_line });
    case.simulated = simulate_campaign(&case.config).unwrap();
    case
}

/// Share of the coordinates at other points within the model's own interval, and their mean square error (m²).
fn held(case: &Case, found: &Identified) -> (f64, f64) {
    let repeatability = Vector3::from(INSTRUMENT.repeatability_m);
    let (mut inside, mut square) = (0.0, 0.0);
    for (error_m, correction) in case.verify(&found.model, POINTS) {
        let own =
            correction.covariance_m2.unwrap() - Matrix3::from_diagonal(&repeatability.component_mul(&repeatability));
        for d in 0..3 {
            inside += f64::from(error_m[d].abs() <= QUANTILE * own[(d, d)].sqrt()) / (3 * POINTS) as f64;
            square += error_m[d].powi(2) / POINTS as f64;
        }
    }
    (inside, square)
}

#[test]
fn white_campaigns_give_the_same_bits_as_ever() {
    for seed in 1..=3 {
        let truth = TruthRecipe { seed, ..TruthRecipe::default() }.bridge_xyz().unwrap();
        let case = Case::case_like(truth, SPLINE, seed + 500);
        let found = case.identify(&estimated());
        assert_eq!((found.correlation, found.evidence.noise), (None, None), "seed {seed}");
        let white = case.identify(&IdentifyOptions::default());
        let bits = |found: &Identified| {
            let parts = found.model.parts();
            parts.coefficients.iter().chain(&parts.covariance).map(|v| v.to_bits()).collect::<Vec<_>>()
        };
        assert!(bits(&found) == bits(&white), "seed {seed}");
    }
}

#[test]
fn regress_intervals_hold_under_noise_that_hangs_together_and_points_get_better() {
    for (neighbours, by_line) in [(0.9, false), (0.9, true)] {
        let (mut share, mut square, mut white_share, mut white_square, mut own) = (0.0, 0.0, 0.0, 0.0, 0);
        let machine = |seed: &u64| {
            let case = case(*seed, neighbours, by_line);
            let found = case.identify(&estimated());
            let noise = found.evidence.noise.unwrap();
            assert!(noise.effective_readings < 0.7 * case.campaign().readings.len() as f64, "{noise:?}");
            let is_own = (noise.correlation.along == Along::Line) == by_line;
            (is_own, held(&case, &found), held(&case, &case.identify(&IdentifyOptions::default())))
        };
        for (is_own, (inside, error), (white_inside, white_error)) in
            in_parallel(&(1..=MACHINES).collect::<Vec<_>>(), machine)
        {
            let count = MACHINES as f64;
            own += usize::from(is_own);
            (share, square) = (share + inside / count, square + error / count);
            (white_share, white_square) = (white_share + white_inside / count, white_square + white_error / count);
        }
        println!(
            "{neighbours} {by_line}: {:.1} % within, error {:.3} µm; as white {:.1} %, {:.3} µm; {own} orders of {MACHINES}",
            share * 1e2,
            square.sqrt() * 1e6,
            white_share * 1e2,
            white_square.sqrt() * 1e6
        );
        assert!((share - 0.95).abs() <= 0.04, "{neighbours} {by_line}: {share}");
        // Over 40 machines the squares fall to 0.70 of those of white noise, by line to 0.80.
        assert!(white_share < share && square < 0.95 * white_square, "{white_share}");
        assert!(own as f64 > 0.8 * MACHINES as f64, "{own}");
    }
}
