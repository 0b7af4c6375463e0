//! Spoilt readings are found, named and left out; without robust weights they ruin the result.
//!
//! Place in the flow: the whole of identification on a campaign of the virtual machine with outliers put in.

use crate::common::{Case, SPLINE};
use abbe_identify::IdentifyOptions;
use abbe_measurement::campaign::Campaign;
use abbe_virtual_machine::TruthRecipe;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeSet;

/// Share of the readings that are spoilt by 5 to 50 µm.
const SPOILT: f64 = 0.02;
/// Readings spoilt by millimetres.
const GROSS: usize = 4;

fn case() -> Case {
    Case::case_like(TruthRecipe { seed: 12, ..TruthRecipe::default() }.bridge_xyz().unwrap(), SPLINE, 81)
}

/// The campaign with outliers, and their reading numbers from 1.
fn spoil(campaign: &Campaign) -> (Campaign, BTreeSet<usize>) {
    let mut generator = ChaCha8Rng::seed_from_u64(4);
    let (mut spoilt, mut numbers) = (campaign.clone(), BTreeSet::new());
    for (k, reading) in spoilt.readings.iter_mut().enumerate() {
        if generator.random::<f64>() < SPOILT {
            let sign = if generator.random::<bool>() { 1.0 } else { -1.0 };
            reading.length_m += sign * generator.random_range(5e-6..50e-6);
            numbers.insert(k + 1);
        }
    }
    for gross in 1..=GROSS {
        let k = gross * spoilt.readings.len() / (GROSS + 1);
        spoilt.readings[k].length_m += 1.7e-3 * gross as f64;
        numbers.insert(k + 1);
    }
    (spoilt, numbers)
}

#[test]
fn two_per_cent_of_outliers_and_a_few_gross_ones_are_listed_and_change_nothing() {
    let case = case();
    let clean = case.identify(&IdentifyOptions::default());
    let (spoilt, numbers) = spoil(case.campaign());
    let found = case.try_identify(&spoilt, &IdentifyOptions::default()).unwrap();
    let listed: BTreeSet<usize> = found.evidence.rejected.iter().map(|r| r.reading).collect();
    let missed: Vec<_> = numbers.difference(&listed).collect();
    assert!(missed.is_empty(), "spoilt by more than 14 u but not listed: {missed:?}");
    // Six robust deviations reject one normal reading in 500 million.
    assert!(listed.len() <= numbers.len() + 1, "{} listed, {} spoilt", listed.len(), numbers.len());
    for rejected in &found.evidence.rejected {
        let reading = &spoilt.readings[rejected.reading - 1];
        assert_eq!(rejected.station, spoilt.stations[reading.station as usize]);
        assert_eq!(rejected.line, spoilt.lines[reading.line as usize]);
        assert_eq!(rejected.residual_m, found.residuals_m[rejected.reading - 1]);
    }
    let (with_m, without_m) = (case.verification_rms_m(&found.model), case.verification_rms_m(&clean.model));
    println!("clean {:.3} µm, spoilt {:.3} µm", without_m * 1e6, with_m * 1e6);
    // Two per cent fewer readings: the two models differ by about √0.02 of their uncertainty.
    let moved: Vec<f64> = (case.verify(&found.model, 300).iter().zip(case.verify(&clean.model, 300)))
        .map(|((a, correction), (b, _))| (a - b).norm() / correction.covariance_m2.unwrap().trace().sqrt())
        .collect();
    let moved_rms = (moved.iter().map(|m| m * m).sum::<f64>() / moved.len() as f64).sqrt();
    assert!(moved_rms < 0.3, "moved by {moved_rms:.2} u");
    assert!((found.evidence.chi2_per_dof / clean.evidence.chi2_per_dof - 1.0).abs() < 0.03);
}

#[test]
fn without_robust_weights_the_same_outliers_ruin_the_result() {
    let case = case();
    let (spoilt, _) = spoil(case.campaign());
    let robust = case.try_identify(&spoilt, &IdentifyOptions::default()).unwrap();
    let plain = case.try_identify(&spoilt, &IdentifyOptions { robust: false, ..IdentifyOptions::default() }).unwrap();
    let (robust_m, plain_m) = (case.verification_rms_m(&robust.model), case.verification_rms_m(&plain.model));
    println!("robust {:.3} µm, plain {:.3} µm", robust_m * 1e6, plain_m * 1e6);
    assert!(plain_m > 5.0 * robust_m);
    assert!(plain.evidence.rejected.is_empty() && plain.evidence.chi2_per_dof > 100.0);
}

#[test]
fn robust_and_plain_weights_agree_on_clean_readings() {
    let case = case();
    let robust = case.identify(&IdentifyOptions::default());
    let plain = case.identify(&IdentifyOptions { robust: false, ..IdentifyOptions::default() });
    let ratio = robust.evidence.chi2_per_dof / plain.evidence.chi2_per_dof;
    // Weights below one begin at 3.5 deviations, where 0.05 % of a normal sample and 0.6 % of its χ² lie.
    assert!((0.98..=1.001).contains(&ratio), "{ratio}");
}
