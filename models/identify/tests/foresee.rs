//! A fit foreseen from nominal readings states what the fit of the measured campaign states.
//!
//! Place in the flow: simulated campaigns are identified; their readings without their lengths, and the smoothness that the fit
//! found, must give the same covariance. What a model file tells of that smoothness must come to the same.

use crate::common::{Case, INSTRUMENT, SPLINE};
use abbe_geometry::ErrorId;
use abbe_identify::station_start::StationStart;
use abbe_identify::{Belief, Identified, IdentifyError, IdentifyOptions, foresee};
use abbe_virtual_machine::TruthRecipe;

fn foreseen(case: &Case, fit: &Identified, belief: &Belief) -> Result<Identified, IdentifyError> {
    let of = |s: &abbe_geometry::model::Station| StationStart { position_m: s.position_m, dead_path_m: s.dead_path_m };
    let stations: Vec<StationStart> = fit.model.parts().stations.iter().map(of).collect();
    let mut nominal = case.campaign().clone();
    nominal.readings.iter_mut().for_each(|reading| reading.length_m = 0.0);
    foresee(&case.machine, INSTRUMENT.range, (&nominal, &stations), &[], belief, &IdentifyOptions::default())
}

/// Largest ratio of stated uncertainties of an error, off by more than one of them.
fn largest_ratio(case: &Case, a: &Identified, b: &Identified) -> f64 {
    let mut largest: f64 = 1.0;
    for id in ErrorId::all() {
        let (lower_m, upper_m) = case.machine.stroke_m[id.axis().index()];
        for share in [0.1, 0.3, 0.5, 0.7, 0.9] {
            let at_m = lower_m + share * (upper_m - lower_m);
            let ratio = a.model.error(id, at_m).1 / b.model.error(id, at_m).1;
            largest = largest.max(ratio.max(1.0 / ratio));
        }
    }
    largest
}

#[test]
fn what_is_foreseen_with_the_smoothness_of_a_fit_is_what_the_fit_states() {
    for seed in [3, 4] {
        let truth = TruthRecipe { seed, ..TruthRecipe::default() }.bridge_xyz().unwrap();
        let case = Case::case_like(truth, SPLINE, seed);
        let fit = case.identify(&IdentifyOptions::default());
        let own = foreseen(&case, &fit, &Belief::of_fit(&fit)).unwrap();
        assert_eq!(own.evidence.unknowns, fit.evidence.unknowns);
        // χ² may widen by a percent, robust weights take as much, and the rows are those of a machine without errors.
        assert!(largest_ratio(&case, &own, &fit) < 1.05, "{}", largest_ratio(&case, &own, &fit));
        let told = foreseen(&case, &fit, &Belief::of_model(&fit.model)).unwrap();
        println!(
            "{:.1} effective unknowns, from the model {:.1}",
            fit.evidence.effective_unknowns, told.evidence.effective_unknowns
        );
        // The exponent, which a model file does not hold, is found anew, in steps of a quarter: near the ends of a stroke that
        // tells by some percent, elsewhere by less.
        assert!((told.evidence.effective_unknowns / fit.evidence.effective_unknowns - 1.0).abs() < 0.03);
        assert!(largest_ratio(&case, &told, &fit) < 1.25, "{}", largest_ratio(&case, &told, &fit));
    }
}

#[test]
fn what_bends_more_is_known_less_and_a_bend_is_read_back() {
    let truth = TruthRecipe::default().bridge_xyz().unwrap();
    let case = Case::case_like(truth, SPLINE, 1);
    let fit = case.identify(&IdentifyOptions::default());
    let belief = Belief::of_bends(&case.machine, |id| if id.is_angular() { 3e-6 } else { 2e-6 }).unwrap();
    let bend = |id: &str| belief.bend(&case.machine, ErrorId::from_name(id).unwrap()).unwrap();
    assert!((bend("EBX") / 3e-6 - 1.0).abs() < 1e-9 && (bend("EYX") / 2e-6 - 1.0).abs() < 1e-9);
    let degrees = |belief: &Belief| foreseen(&case, &fit, belief).unwrap().evidence.effective_unknowns;
    let (less, own, more) = (degrees(&belief.bending(0.5)), degrees(&belief), degrees(&belief.bending(2.0)));
    assert!(less < own && own < more, "{less} {own} {more}");
}

#[test]
fn what_identification_would_refuse_is_refused_beforehand() {
    let truth = TruthRecipe::default().bridge_xyz().unwrap();
    let mut case = Case::case_like(truth, SPLINE, 1);
    let fit = case.identify(&IdentifyOptions::default());
    let belief = Belief::of_fit(&fit);
    // Lines along X alone.
    case.simulated.campaign.readings.retain(|reading| reading.station == 0);
    case.simulated.campaign.readings.truncate(120);
    let refused = foreseen(&case, &fit, &belief).unwrap_err();
    assert!(!matches!(refused, IdentifyError::NotConverged { .. }), "{refused}");
}
