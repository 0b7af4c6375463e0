//! Plans that cannot see everything are refused by the names of what they hide, with lines that complete them.
//!
//! Place in the flow: the whole of identification on plans of the virtual machine with one thing left out each.

use crate::common::{Case, SPLINE, held_zero, of_low_order};
use abbe_geometry::ErrorId;
use abbe_geometry::error_function::FunctionKind;
use abbe_identify::{IdentifyError, IdentifyOptions, OrderChoice, Unobservable};
use abbe_virtual_machine::plan::{LineKind, LinePlan, LineSelection, Plan, PlanRecipe, presets};
use abbe_virtual_machine::{MachineTruth, TruthRecipe};
use std::collections::BTreeSet;

fn bridge() -> MachineTruth {
    TruthRecipe { seed: 2, ..TruthRecipe::default() }.bridge_xyz().unwrap()
}

fn one_offset(truth: &MachineTruth) -> PlanRecipe {
    PlanRecipe { offsets_m: vec![[0.0, 0.0, -0.06]], ..presets::case_like(truth.stroke_m, 3) }
}

fn refused(case: &Case, options: &IdentifyOptions) -> (Vec<Unobservable>, Vec<String>, String) {
    match case.try_identify(case.campaign(), options) {
        Err(error @ IdentifyError::RankDeficient { .. }) => {
            let text = error.to_string();
            let IdentifyError::RankDeficient { groups, lines, rank, unknowns, .. } = error else { unreachable!() };
            assert!(rank < unknowns);
            (groups, lines, text)
        }
        Err(other) => panic!("{other}"),
        Ok(found) => panic!("accepted with condition {}", found.evidence.condition),
    }
}

/// All errors named, without duplicates.
fn names(groups: &[Unobservable]) -> BTreeSet<&str> {
    groups.iter().flat_map(|group| group.errors.iter().map(String::as_str)).collect()
}

/// The plan with the proposed lines added to their stations, read back from their text.
fn with_lines(mut plan: Plan, proposed: &[String], stroke_m: [[f64; 2]; 3]) -> Plan {
    for (k, text) in proposed.iter().enumerate() {
        let axis = ["along X", "along Y", "along Z"].iter().position(|start| text.starts_with(start)).unwrap();
        let numbers: Vec<f64> =
            text.split(|c: char| !"-.0123456789".contains(c)).filter_map(|word| word.parse().ok()).collect();
        let (mut from_m, mut to_m) = ([0.0; 3], [0.0; 3]);
        (from_m[(axis + 1) % 3], from_m[(axis + 2) % 3]) = (numbers[0] * 1e-3, numbers[1] * 1e-3);
        (to_m[(axis + 1) % 3], to_m[(axis + 2) % 3]) = (numbers[0] * 1e-3, numbers[1] * 1e-3);
        (from_m[axis], to_m[axis]) = (stroke_m[axis][0], stroke_m[axis][1]);
        let station = plan.stations.iter_mut().find(|station| text.ends_with(&format!("station {}", station.name)));
        station.unwrap().lines.push(LinePlan {
            name: format!("proposed-{k}"),
            from_m,
            to_m,
            points: 9,
            jitter: 0.0,
            offset_m: [numbers[2] * 1e-3, numbers[3] * 1e-3, numbers[4] * 1e-3],
            feed_m_s: 0.05,
            acceleration_m_s2: 0.1,
            load_kg: 0.0,
            pause_s: 0.0,
        });
    }
    plan
}

#[test]
fn one_reflector_offset_hides_rotations_and_exactly_the_proposed_lines_show_them() {
    let truth = bridge();
    let plan = one_offset(&truth).build().unwrap();
    let case = Case::new(truth.clone(), plan.clone(), SPLINE, 5);
    let (groups, lines, text) = refused(&case, &IdentifyOptions::default());
    println!("{text}");
    // With the reflector below the ram, turning about Z moves nothing that hangs on Y and Z (ECY, ECZ); EAZ and EBZ move
    // it sideways like straightness and squareness of Z.
    let names = names(&groups);
    for name in ["ECY", "ECZ", "EAZ", "EBZ"] {
        assert!(names.contains(name), "{name} is missing: {text}");
    }
    let allowed = ["ECY", "ECZ", "EAZ", "EBZ", "EYZ", "EXZ", "A0Z", "B0Z"];
    assert!(names.iter().all(|name| allowed.contains(name)), "{names:?}");
    assert!(!lines.is_empty() && text.contains("these lines") && text.contains("ECZ"));
    assert!(
        text.ends_with("(ECY, EAZ, EBZ, ECZ would be enough) at zero in the machine file (kind = \"zero\")"),
        "{text}"
    );

    let completed = with_lines(plan.clone(), &lines, truth.stroke_m);
    let case = Case::new(truth.clone(), completed, SPLINE, 5);
    assert!(case.try_identify(case.campaign(), &IdentifyOptions::default()).is_ok());
    // None of them is superfluous.
    for k in 0..lines.len() {
        let mut without = lines.clone();
        without.remove(k);
        let case = Case::new(truth.clone(), with_lines(plan.clone(), &without, truth.stroke_m), SPLINE, 5);
        refused(&case, &IdentifyOptions::default());
    }
}

#[test]
fn holding_the_hidden_errors_at_zero_also_completes_the_plan() {
    let mut truth = bridge();
    let plan = one_offset(&truth).build().unwrap();
    let mut kinds = [Some(SPLINE); ErrorId::COUNT];
    held_zero(&mut truth, &mut kinds, &["ECY", "ECZ", "EAZ", "EBZ"]);
    let mut case = Case::new(truth, plan, SPLINE, 5);
    case.machine.kinds = kinds;
    let found = case.identify(&IdentifyOptions::default());
    assert_eq!(found.evidence.rank, found.evidence.low_order_unknowns);
    assert!(case.verification_rms_m(&found.model) < 0.6e-6);
}

#[test]
fn one_station_is_refused_whatever_it_measured() {
    let truth = bridge();
    let mut plan = presets::case_like(truth.stroke_m, 3).build().unwrap();
    plan.stations.truncate(1);
    let case = Case::new(truth, plan, SPLINE, 5);
    let error = case.try_identify(case.campaign(), &IdentifyOptions::default()).unwrap_err();
    assert_eq!(error, IdentifyError::TooFewStations { found: 1 });
    assert!(error.to_string().contains("1 station;") && error.to_string().contains("at least 3 stations"));
}

#[test]
fn a_plan_at_two_heights_only_hides_what_lies_between_them() {
    let truth = bridge();
    // X and Y lines at the lower and upper Z only: no parabola of Z can be seen, but all its ends.
    let recipe = PlanRecipe {
        levels: [5, 5, 2],
        kinds: vec![LineKind::AlongX, LineKind::AlongY],
        selection: LineSelection::Every,
        ..presets::case_like(truth.stroke_m, 3)
    };
    let plan = recipe.build().unwrap();
    let case = Case::new(truth.clone(), plan.clone(), SPLINE, 5);
    let (groups, lines, text) = refused(&case, &IdentifyOptions::default());
    println!("{text}");
    let hidden = names(&groups);
    // Both heights show EZZ's ends and the rotations; in between nothing is seen of EZZ, and a bow of Z looks like
    // stations that stand elsewhere.
    assert_eq!(hidden, BTreeSet::from(["EZZ", "EXZ", "EYZ", "the stations' x", "the stations' y"]), "{text}");
    assert!(lines.len() <= 3, "{lines:?}");
    // The campaign's own offsets suffice; no new one is asked for.
    let own = ["(0, 0, -60)", "(120, 0, -60)", "(0, 140, -90)"];
    assert!(lines.iter().all(|line| own.iter().any(|offset| line.contains(offset))), "{lines:?}");
    let completed = Case::new(truth.clone(), with_lines(plan, &lines, truth.stroke_m), SPLINE, 5);
    assert!(completed.try_identify(completed.campaign(), &IdentifyOptions::default()).is_ok());
}

#[test]
fn stations_in_one_plane_are_accepted_and_worse_conditioned() {
    let truth = bridge();
    let spatial = presets::case_like(truth.stroke_m, 3);
    let mut flat = spatial.clone();
    flat.stations_m.iter_mut().for_each(|station| station[2] = -0.3);
    let condition = |recipe: &PlanRecipe| {
        let case = Case::new(truth.clone(), recipe.build().unwrap(), SPLINE, 5);
        let found = case.identify(&IdentifyOptions::default());
        (found.evidence.condition, case.verification_rms_m(&found.model))
    };
    let ((spatial, spatial_m), (flat, flat_m)) = (condition(&spatial), condition(&flat));
    println!(
        "condition {spatial:.0} ({:.2} µm) in space, {flat:.0} ({:.2} µm) in a plane",
        spatial_m * 1e6,
        flat_m * 1e6
    );
    assert!(flat > spatial && flat_m < 3e-6);
}

#[test]
fn the_12_edges_of_fyxz_need_four_errors_held_at_zero() {
    let kind = FunctionKind::Nodes { count: 9 };
    let mut truth = of_low_order(TruthRecipe { seed: 5, ..TruthRecipe::default() }.fyxz().unwrap(), 2);
    let plan = presets::edges_12(truth.stroke_m, 17, 5).unwrap();
    let options = IdentifyOptions { order: OrderChoice::Fixed, ..IdentifyOptions::default() };
    let all = Case::new(truth.clone(), plan.clone(), kind, 31);
    let (groups, _, text) = refused(&all, &options);
    println!("{text}");
    assert_eq!(names(&groups), BTreeSet::from(["EAZ", "EBZ", "ECX", "ECZ"]), "{text}");
    let mut kinds = [Some(kind); ErrorId::COUNT];
    held_zero(&mut truth, &mut kinds, &["ECX", "EAZ", "EBZ", "ECZ"]);
    let mut case = Case::new(truth, plan, kind, 31);
    case.machine.kinds = kinds;
    let found = case.identify(&options);
    assert_eq!(found.evidence.rank, found.evidence.low_order_unknowns);
}

#[test]
fn functions_too_poor_for_a_parabola_are_not_called_unobservable() {
    let truth = of_low_order(bridge(), 1);
    for kind in [FunctionKind::Polynomial { degree: 1 }, FunctionKind::Nodes { count: 2 }] {
        let case = Case::case_like(truth.clone(), kind, 5);
        let found = case.identify(&IdentifyOptions::default());
        assert_eq!(found.evidence.rank, found.evidence.low_order_unknowns, "{kind:?}");
    }
}

#[test]
fn offsets_that_hardly_differ_are_accepted_but_reported_as_correlated() {
    let truth = bridge();
    let offsets_m = vec![[0.0, 0.0, -0.06], [0.003, 0.0, -0.06], [0.0, 0.003, -0.06]];
    let recipe = PlanRecipe { offsets_m, ..presets::case_like(truth.stroke_m, 3) };
    let case = Case::new(truth.clone(), recipe.build().unwrap(), SPLINE, 5);
    let weak = case.identify(&IdentifyOptions::default());
    let strong = Case::case_like(truth, SPLINE, 5).identify(&IdentifyOptions::default());
    println!("{:?}", weak.evidence.correlated);
    for pair in &weak.evidence.correlated {
        assert!(pair.correlation.abs() > 0.9 && pair.correlation.abs() <= 1.0 + 1e-9);
        assert_ne!(pair.first, pair.second);
    }
    let tied = |a: &str, b: &str| {
        weak.evidence
            .correlated
            .iter()
            .any(|pair| pair.first == a && pair.second == b || pair.first == b && pair.second == a)
    };
    // Tilting the ram moves the reflector by 60 mm times the angle, which is what squareness of Z does.
    assert!(tied("EAZ", "A0Z") || tied("EAZ", "EYZ"));
    assert!(tied("EBZ", "B0Z") || tied("EBZ", "EXZ"));
    assert!(weak.evidence.condition > 3.0 * strong.evidence.condition);
}
