//! Evidence on simulated machines: what is said of a residual field is true, as sure as it says, and nothing is made up.

#![allow(clippy::unwrap_used)] // helpers of a test

use abbe_geometry::Vector3;
use abbe_identify::{Identified, identify};
use abbe_measurement::alignment::aligned_residuals_m;
use abbe_measurement::instrument::RangeUncertainty;
use abbe_residual_data::{PointResidual, RangeOptions, ResidualError, from_ranges, shared_points};
use abbe_virtual_machine::effects::from_text;
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::instrument::InstrumentConfig;
use abbe_virtual_machine::machine::Roughness;
use abbe_virtual_machine::plan::Plan;
use abbe_virtual_machine::plan::presets::{case_like, plan_b};
use abbe_virtual_machine::{Simulated, SimulationConfig, TruthRecipe, simulate_campaign};

/// Work that a test can wait for; the figures of a full run stand in the book.
const QUICK: RangeOptions = RangeOptions { search_readings: 400, readings: 1200, points: 150 };
/// Largest share of the error's power that may be left at points seen from four stations: their repeatability, four times
/// 0.06 µm² a component, and that of the truth's own stop.
const LEFT: f64 = 0.35;
/// The same where each range tells one component in three.
const LEFT_OF_RANGES: f64 = 0.5;
/// Standardised residuals of a covariance that is right have an rms near 1; a field drawn by cosines is no Gaussian
/// process, and its size is fitted, so a half more is allowed.
const RMS_STANDARDISED: f64 = 1.5;

/// A field of position that no chain of rigid bodies makes: two components, each of another pair of coordinates.
const FIELD: [&str; 2] = [
    "undescribed seed=3 of=x_mm of_from=0 of_to=800 and=y_mm and_from=0 and_to=600 along=z size_um=8",
    "undescribed seed=4 of=y_mm of_from=0 of_to=600 and=z_mm and_from=0 and_to=600 along=x size_um=6",
];

struct Bench {
    simulated: Simulated,
    fit: Identified,
}

fn machine() -> abbe_geometry::machine::Machine {
    use abbe_geometry::Axis;
    use abbe_geometry::error_function::FunctionKind;
    use abbe_geometry::machine::{Joint, Machine, Side, Squareness};
    let joint = |axis| Joint { axis, side: Side::Tool };
    let tilt = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
    Machine {
        name: "bridge".to_owned(),
        frame_id: "machine".to_owned(),
        joints: [joint(Axis::X), joint(Axis::Y), joint(Axis::Z)],
        stroke_m: [(0.0, 0.8), (0.0, 0.6), (0.0, 0.6)],
        squareness: [tilt("C0Y", Axis::Y, Axis::Z), tilt("B0Z", Axis::Z, Axis::Y), tilt("A0Z", Axis::Z, Axis::X)],
        rotation: abbe_geometry::rotation::RotationForm::Exact,
        kinds: std::array::from_fn(|_| Some(FunctionKind::BSpline { intervals: 6 })),
        repeatability_m: [0.25e-6; 3],
        u_ram_turn_rad: [abbe_geometry::machine::USUAL_RAM_TURN_RAD; 3],
        default_offset_m: None,
    }
}

const INSTRUMENT: RangeUncertainty =
    RangeUncertainty { constant_m: 0.025e-6, per_metre: 0.15e-6, common_per_metre: 0.0 };

fn bench(seed: u64, effects: &[&str], plan: impl Fn([[f64; 2]; 3]) -> Plan) -> Bench {
    let recipe = TruthRecipe { seed, roughness: Roughness::SMOOTH, volumetric_rms_m: 20e-6 };
    let truth = recipe.bridge_xyz().unwrap();
    let config = SimulationConfig {
        seed,
        plan: plan(truth.stroke_m),
        machine: truth,
        instrument: InstrumentConfig {
            range: INSTRUMENT,
            repeatability_m: [0.25e-6; 3],
            ..InstrumentConfig::LASER_TRACER
        },
        environment: EnvironmentConfig::workshop(),
        effects: effects.iter().map(|text| from_text(text).unwrap()).collect(),
    };
    let simulated = simulate_campaign(&config).unwrap();
    let options = abbe_identify::IdentifyOptions::default();
    let fit = identify(&machine(), INSTRUMENT, &simulated.campaign, &options, &mut |_| true).unwrap();
    Bench { simulated, fit }
}

impl Bench {
    /// Rms of the error before and after the residuals are added, and rms of each component over its standard uncertainty.
    /// The frame of a model is that in which its own errors are zero at the ends of their strokes, which a field shifts:
    /// points are aligned rigidly before they are compared, as in verification.
    fn score(&self, points: &[PointResidual]) -> (f64, f64, f64) {
        let actual: Vec<Vector3<f64>> =
            points.iter().map(|p| Vector3::from(self.simulated.truth.readings[p.row].actual_m)).collect();
        let corrected: Vec<Vector3<f64>> = points.iter().map(|p| p.point_m).collect();
        let with: Vec<Vector3<f64>> = points.iter().map(|p| p.point_m + p.residual_m).collect();
        let before = aligned_residuals_m(&corrected, &actual).unwrap();
        let after = aligned_residuals_m(&with, &actual).unwrap();
        let rms =
            |list: &[Vector3<f64>]| (list.iter().map(Vector3::norm_squared).sum::<f64>() / list.len() as f64).sqrt();
        let mut standardised = 0.0;
        for (point, error) in points.iter().zip(&after) {
            let covariance = point.covariance_m2.unwrap();
            for d in 0..3 {
                // The truth of a stop holds its own repeatability, which no field predicts.
                standardised += error[d].powi(2) / (covariance[(d, d)] + 0.25e-6_f64.powi(2));
            }
        }
        (rms(&before), rms(&after), (standardised / (3 * points.len()) as f64).sqrt())
    }
}

#[test]
fn a_field_is_found_from_ranges_of_stations_that_saw_different_points() {
    let bench = bench(11, &FIELD, |stroke| case_like(stroke, 11).build().unwrap());
    let campaign = &bench.simulated.campaign;
    let found = from_ranges(&bench.fit.model, INSTRUMENT, campaign, true, &QUICK, &mut |_| true).unwrap();
    let (whole, left, standardised) = bench.score(&found.points);
    println!(
        "{:.2} µm rms, {:.2} left, {standardised:.2} standardised, {:?}, evidence {:.0}, unseen {} + {}",
        whole * 1e6,
        left * 1e6,
        found.prior,
        found.evidence,
        found.unseen_points,
        found.unseen_components
    );
    assert!((left / whole).powi(2) < LEFT_OF_RANGES, "{left} left of {whole}");
    assert!(standardised < RMS_STANDARDISED, "{standardised}");
    let again = from_ranges(&bench.fit.model, INSTRUMENT, campaign, true, &QUICK, &mut |_| true).unwrap();
    assert_eq!(found.points, again.points, "the same input gives the same bits");
}

#[test]
fn a_clean_machine_gives_no_residuals_to_train_on() {
    let bench = bench(12, &[], |stroke| case_like(stroke, 12).build().unwrap());
    let found = from_ranges(&bench.fit.model, INSTRUMENT, &bench.simulated.campaign, true, &QUICK, &mut |_| true);
    assert!(matches!(found, Err(ResidualError::NothingThere { .. })), "{found:?}");
}

#[test]
fn points_that_four_stations_saw_have_residuals_by_multilateration() {
    let bench = bench(13, &FIELD, |stroke| plan_b(stroke, 13).build().unwrap());
    let found = shared_points(&bench.fit.model, INSTRUMENT, &bench.simulated.campaign, true).unwrap();
    let (whole, left, standardised) = bench.score(&found.points);
    println!(
        "{} points, {:.2} µm rms, {:.2} left, {standardised:.2} standardised, chi2 {:?}, {:?}",
        found.points.len(),
        whole * 1e6,
        left * 1e6,
        found.chi2_per_dof,
        found.readings
    );
    assert_eq!(found.readings.0, found.readings.1, "every reading of this plan is shared");
    assert!((left / whole).powi(2) < LEFT, "{left} left of {whole}");
    assert!(standardised < RMS_STANDARDISED, "{standardised}");
}

#[test]
fn stations_that_saw_different_points_share_none_and_a_request_to_stop_is_heard() {
    let bench = bench(11, &FIELD, |stroke| case_like(stroke, 11).build().unwrap());
    let campaign = &bench.simulated.campaign;
    let shared = shared_points(&bench.fit.model, INSTRUMENT, campaign, true).unwrap();
    assert!(shared.readings.0 * 10 < shared.readings.1, "{:?}", shared.readings);
    let stopped = from_ranges(&bench.fit.model, INSTRUMENT, campaign, true, &QUICK, &mut |_| false);
    assert!(matches!(stopped, Err(ResidualError::Stopped)));
}

#[test]
fn another_campaign_has_stations_of_its_own() {
    let first = bench(11, &FIELD, |stroke| case_like(stroke, 11).build().unwrap());
    // The same machine, measured from stations that stand elsewhere, under the same names.
    let again = bench(11, &FIELD, |stroke| {
        let mut recipe = case_like(stroke, 21);
        recipe.stations_m.iter_mut().for_each(|s| s[2] += 0.11);
        recipe.build().unwrap()
    });
    let campaign = &again.simulated.campaign;
    let found = from_ranges(&first.fit.model, INSTRUMENT, campaign, false, &QUICK, &mut |_| true).unwrap();
    let (whole, left, standardised) = again.score(&found.points);
    println!("{:.2} µm rms, {:.2} left, {standardised:.2} standardised", whole * 1e6, left * 1e6);
    assert!((left / whole).powi(2) < LEFT_OF_RANGES, "{left} left of {whole}");
}
