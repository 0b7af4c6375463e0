//! The scatter of identified quantities over repeated campaigns reaches the Cramér-Rao bound.
//!
//! Place in the flow: one machine whose errors polynomials of degree 3 hold exactly, measured again and again with
//! fresh noise. Everything is judged in units of the bound of the plan.

use crate::common::{Case, INSTRUMENT, SPLINE, of_low_order};
use abbe_geometry::ErrorId;
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::model::MachineModel;
use abbe_identify::{IdentifyError, IdentifyOptions, OrderChoice, at_cramer_rao_bound};
use abbe_virtual_machine::TruthRecipe;
use abbe_virtual_machine::plan::{PlanRecipe, presets};
use std::collections::BTreeMap;

/// Campaigns of the same plan.
const CAMPAIGNS: u64 = 60;
/// A group of one to nine functions has at least three independent numbers a campaign: 1/√(2 · 180) = 5 %, thrice.
const TOLERANCE: f64 = 0.15;
/// Largest mean deviation in units of its own standard deviation, over some 150 quantities.
const LARGEST_BIAS: f64 = 4.5;

fn case(seed: u64) -> Case {
    let truth = of_low_order(TruthRecipe { seed: 20, ..TruthRecipe::default() }.bridge_xyz().unwrap(), 3);
    let plan = PlanRecipe { points: [7, 9], ..presets::case_like(truth.stroke_m, 6) }.build().unwrap();
    Case::new(truth, plan, FunctionKind::Polynomial { degree: 3 }, seed)
}

/// Deviations from the truth in units of the bound, by group and quantity.
fn deviations(case: &Case, found: &MachineModel, bound: &MachineModel) -> Vec<(&'static str, String, f64)> {
    let mut all = Vec::new();
    for id in ErrorId::all() {
        let (lower_m, upper_m) = case.machine.stroke_m[id.axis().index()];
        for share in [0.2, 0.5, 0.8] {
            let reading_m = lower_m + share * (upper_m - lower_m);
            let deviation = found.error(id, reading_m).0 - case.true_error(id, reading_m);
            let group = match (id.is_angular(), id.is_straightness()) {
                (true, _) => "angles",
                (_, true) => "straightness",
                _ => "positioning",
            };
            all.push((group, format!("{} {share}", id.name()), deviation / bound.error(id, reading_m).1));
        }
    }
    for (k, entry) in case.machine.squareness.iter().enumerate() {
        let truth = case.simulated.truth.machine.squareness_rad(&entry.name).unwrap();
        let deviation = (found.squareness(k).0 - truth) / bound.squareness(k).1;
        all.push(("squareness", entry.name.clone(), deviation));
    }
    for (k, station) in found.parts().stations.iter().enumerate() {
        let (first, _) = bound.station(&station.name).unwrap();
        let u_m = |d: usize| bound.covariance(first + d, first + d).sqrt();
        for d in 0..3 {
            let deviation_m = station.position_m[d] - case.simulated.truth.stations_m[k][d];
            all.push(("stations", format!("{} {d}", station.name), deviation_m / u_m(d)));
        }
        let deviation_m = station.dead_path_m - case.simulated.truth.first_ranges_m[k];
        all.push(("dead paths", station.name.clone(), deviation_m / u_m(3)));
    }
    all
}

#[test]
fn repeated_campaigns_scatter_as_little_as_the_bound_allows_and_without_bias() {
    let options = IdentifyOptions { order: OrderChoice::Fixed, robust: false, ..IdentifyOptions::default() };
    let mut squares: BTreeMap<&str, (f64, f64)> = BTreeMap::new();
    let mut sums: BTreeMap<String, f64> = BTreeMap::new();
    let first = case(1);
    let bound =
        at_cramer_rao_bound(&first.identify(&options).model, INSTRUMENT.range, first.campaign(), false).unwrap();
    for seed in 1..=CAMPAIGNS {
        let case = case(seed);
        for (group, name, deviation) in deviations(&case, &case.identify(&options).model, &bound) {
            let entry = squares.entry(group).or_default();
            *entry = (entry.0 + deviation * deviation, entry.1 + 1.0);
            *sums.entry(name).or_default() += deviation;
        }
    }
    assert_eq!(squares.len(), 6);
    for (group, (square, count)) in squares {
        let ratio = (square / count).sqrt();
        println!("{group}: {ratio:.3} of the Cramér-Rao bound");
        assert!((ratio - 1.0).abs() < TOLERANCE, "{group}: {ratio:.3}");
    }
    for (name, sum) in sums {
        // Each deviation has unit variance, a sum of n has √n.
        let bias = sum / (CAMPAIGNS as f64).sqrt();
        assert!(bias.abs() < LARGEST_BIAS, "{name}: biased by {bias:.2} standard deviations of the mean");
    }
}

#[test]
fn the_reported_uncertainty_is_the_bound_where_nothing_is_penalised() {
    let case = case(1);
    let options = IdentifyOptions { order: OrderChoice::Fixed, ..IdentifyOptions::default() };
    let found = case.identify(&options);
    let bound = at_cramer_rao_bound(&found.model, INSTRUMENT.range, case.campaign(), false).unwrap();
    // Both are the inverse of the same matrix but for χ²/ν, which only ever widens, and a few robust weights below 1.
    let widened = found.evidence.chi2_per_dof.max(1.0).sqrt();
    for id in ErrorId::all() {
        let (own, least) = (found.model.error(id, 0.3).1, bound.error(id, 0.3).1);
        assert!((own / least / widened - 1.0).abs() < 0.01, "{}: {own:e} {least:e}", id.name());
    }
}

#[test]
fn smoothing_may_beat_the_bound_of_free_splines_but_a_hidden_error_has_none() {
    let truth = TruthRecipe { seed: 20, ..TruthRecipe::default() }.bridge_xyz().unwrap();
    let case = Case::case_like(truth.clone(), SPLINE, 6);
    let found = case.identify(&IdentifyOptions::default());
    let bound = at_cramer_rao_bound(&found.model, INSTRUMENT.range, case.campaign(), false).unwrap();
    // Prior knowledge of smoothness is information that the bound of unbiased methods does not have.
    for id in ErrorId::all() {
        assert!(
            found.model.error(id, 0.3).1 <= 1.01 * found.evidence.chi2_per_dof.max(1.0).sqrt() * bound.error(id, 0.3).1
        );
    }
    let one_offset = PlanRecipe { offsets_m: vec![[0.0, 0.0, -0.06]], ..presets::case_like(truth.stroke_m, 3) };
    let blind = Case::new(truth, one_offset.build().unwrap(), SPLINE, 6);
    let refused = at_cramer_rao_bound(&found.model, INSTRUMENT.range, blind.campaign(), false);
    assert_eq!(refused.err().unwrap(), IdentifyError::Singular);
}
