//! Evidence for the shipped plans: counts, directions, offsets, stations, and the refusal of bad ones.

#![allow(clippy::unwrap_used)] // a preparation that fails fails its test

use std::collections::BTreeSet;

use abbe_virtual_machine::TruthRecipe;
use abbe_virtual_machine::plan::{Plan, PlanRecipe, Target, presets};

const STROKE_M: [[f64; 2]; 3] = [[0.0, 0.8], [0.0, 0.6], [0.0, 0.6]];

fn targets(plan: &Plan) -> Vec<Target> {
    plan.check(&STROKE_M).unwrap();
    plan.targets().collect()
}

/// Six times the volume of the tetrahedron of four stations (m³).
fn spanned_m3(p: &[[f64; 3]]) -> f64 {
    let edge = |k: usize| [0, 1, 2].map(|d| p[k][d] - p[0][d]);
    let [a, b, c] = [edge(1), edge(2), edge(3)];
    (a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0])).abs()
}

fn stations_m(plan: &Plan) -> Vec<[f64; 3]> {
    plan.stations.iter().map(|s| s.position_m).collect()
}

#[test]
fn the_case_like_plan_has_the_statistics_of_the_recorded_campaigns() {
    let plan = presets::case_like(STROKE_M, 5).build().unwrap();
    let all = targets(&plan);
    assert_eq!(plan.stations.len(), 5);
    assert!(plan.stations.iter().all(|s| s.lines.len() == 37));
    // 180 lines of 15.5 ± 2.3 points and 5 of two: 2800 ± 31; four deviations.
    assert!((2676..2925).contains(&all.len()), "{}", all.len());
    for offset_m in presets::CASE_OFFSETS_M {
        let share = all.iter().filter(|t| t.offset_m == offset_m).count();
        assert!(share * 4 > all.len() && share * 5 < all.len() * 2);
    }
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let share = all.iter().filter(|t| t.direction[axis] == sign).count();
            assert!(share * 10 > all.len(), "axis {axis} sign {sign}: {share}");
        }
        let acceleration = |t: &Target| t.acceleration_m_s2[axis] * t.direction[axis];
        assert!(all.iter().all(|t| acceleration(t) >= 0.0));
    }
    assert!(all.windows(2).all(|w| w[1].time_s > w[0].time_s));
    // The recorded campaigns took 18 000 s for the same number of readings.
    let end_s = all.last().unwrap().time_s;
    assert!((12_000.0..26_000.0).contains(&end_s), "{end_s}");
    assert!(spanned_m3(&stations_m(&plan)) > 0.05);
}

#[test]
fn each_station_ends_where_it_began() {
    let plan = presets::case_like(STROKE_M, 6).build().unwrap();
    for station in &plan.stations {
        let (first, last) = (&station.lines[0], &station.lines[36]);
        assert_eq!((first.from_m, first.offset_m), (last.from_m, last.offset_m));
        assert_eq!(last.points, 2);
    }
    let firsts = plan.targets().filter(|t| t.first_of_station).count();
    assert_eq!(firsts, 5);
}

#[test]
fn a_load_stays_for_a_station_or_changes_from_line_to_line() {
    let recipe = presets::case_like([[0.0, 0.8], [0.0, 0.6], [0.0, 0.6]], 3);
    let by_line = PlanRecipe { load_by_line: true, ..recipe.clone() };
    for (recipe, alone) in [(recipe, true), (by_line, false)] {
        for station in &recipe.build().unwrap().stations {
            let same = station.lines.iter().all(|line| line.load_kg == station.lines[0].load_kg);
            // 37 lines with the same of three loads by chance: one plan in 3³⁶.
            assert_eq!(same, alone);
        }
    }
}

#[test]
fn the_twelve_edges_are_twelve_different_edges_at_offset_zero() {
    let plan = presets::edges_12(STROKE_M, 11, 1).unwrap();
    assert_eq!(plan.stations.len(), 4);
    assert!(spanned_m3(&stations_m(&plan)) > 0.05);
    assert_eq!(targets(&plan).len(), 4 * 12 * 11);
    assert!(plan.targets().all(|t| t.offset_m == [0.0; 3]));
    for station in &plan.stations {
        let edges: BTreeSet<String> = station.lines.iter().map(|l| format!("{:?} {:?}", l.from_m, l.to_m)).collect();
        assert_eq!(edges.len(), 12);
        for line in &station.lines {
            let moved = (0..3).filter(|d| line.from_m[*d] != line.to_m[*d]);
            assert_eq!(moved.count(), 1);
            let at_an_end = |d: usize| STROKE_M[d].contains(&line.from_m[d]);
            assert!((0..3).all(at_an_end));
        }
    }
}

#[test]
fn plans_a_b_and_c_differ_as_the_alias_study_says() {
    let plan_a = presets::plan_a(STROKE_M, 1).build().unwrap();
    let plan_b = presets::plan_b(STROKE_M, 1).build().unwrap();
    let plan_c = presets::plan_c(STROKE_M, 1).build().unwrap();
    let offsets = |plan: &Plan| {
        let all: BTreeSet<String> = plan.targets().map(|t| format!("{:?}", t.offset_m)).collect();
        all.len()
    };
    let count = |p: &Plan| (p.stations.len(), offsets(p));
    assert_eq!([&plan_a, &plan_b, &plan_c].map(count), [(4, 1), (4, 3), (6, 3)]);
    let lines = |p: &Plan| p.stations[0].lines.clone();
    assert!(lines(&plan_a).iter().all(|l| l.to_m[0] > l.from_m[0]));
    let backward = lines(&plan_b).iter().filter(|l| l.to_m[0] < l.from_m[0]).count();
    assert_eq!(2 * backward, lines(&plan_b).len());
    let ordered =
        |lines: &[abbe_virtual_machine::plan::LinePlan]| lines.windows(2).all(|w| w[1].from_m[1] >= w[0].from_m[1]);
    assert!(ordered(&lines(&plan_b)) && !ordered(&lines(&plan_c)));
}

#[test]
fn val_chen_2020_has_six_stations_92_points_and_183_readings_both_ways() {
    let once = presets::chen2020(false);
    once.check(&presets::CHEN_STROKE_M).unwrap();
    assert_eq!((once.stations.len(), once.readings()), (6, 6 * 92));
    let place = |t: &Target| format!("{:.6?}", t.reading_m);
    let distinct: BTreeSet<String> = once.targets().take(92).map(|t| place(&t)).collect();
    assert_eq!(distinct.len(), 92);
    let both = presets::chen2020(true);
    both.check(&presets::CHEN_STROKE_M).unwrap();
    assert_eq!(both.readings(), 6 * 183);
    let station: Vec<String> = both.targets().take(183).map(|t| place(&t)).collect();
    for k in 0..92 {
        assert_eq!(station[k], station[182 - k], "point {k} is not met again");
    }
}

#[test]
fn a_repeated_plan_goes_to_a_million_readings_and_alternates() {
    let plan = presets::case_like(STROKE_M, 2).build().unwrap();
    let long = plan.repeated_to(1_000_000).unwrap();
    assert!(long.readings() >= 1_000_000 && long.readings() < 1_000_000 + plan.readings());
    long.check(&STROKE_M).unwrap();
    let lines = &long.stations[0].lines;
    assert_eq!(lines[37].from_m, lines[0].to_m);
    assert_eq!(lines[74].from_m, lines[0].from_m);
    let counted = long.targets().take(50_000).filter(|t| t.line > 0).count();
    assert!(counted > 49_900);
}

#[test]
fn the_same_seed_draws_the_same_plan_and_another_seed_another() {
    let plan = |seed| presets::case_like(STROKE_M, seed).build().unwrap();
    assert_eq!(plan(9), plan(9));
    assert_ne!(plan(9), plan(10));
    assert!(plan(9).targets().eq(plan(9).targets()));
}

#[test]
fn presets_fit_every_shipped_machine() {
    let recipe = TruthRecipe::default();
    for truth in [recipe.bridge_xyz(), recipe.fyxz(), recipe.moving_table()] {
        let stroke_m = truth.unwrap().stroke_m;
        let plan = presets::case_like(stroke_m, 1).build().unwrap();
        plan.check(&stroke_m).unwrap();
        let edges = presets::edges_12(stroke_m, 9, 1).unwrap();
        edges.check(&stroke_m).unwrap();
    }
}

#[test]
fn a_plan_that_cannot_be_driven_is_refused_by_its_key() {
    let key = |change: &dyn Fn(&mut Plan)| {
        let mut plan = presets::case_like(STROKE_M, 1).build().unwrap();
        change(&mut plan);
        plan.check(&STROKE_M).unwrap_err().key
    };
    assert_eq!(key(&|p| p.stations.clear()), "plan.stations");
    assert_eq!(key(&|p| p.stations[2].lines[4].to_m[0] = 0.9), "plan.stations[2].lines[4].to_m");
    assert_eq!(key(&|p| p.stations[1].lines[0].points = 0), "plan.stations[1].lines[0].points");
    assert_eq!(key(&|p| p.stations[0].lines[0].feed_m_s = 0.0), "plan.stations[0].lines[0].feed_m_s");
    assert_eq!(key(&|p| p.stations[3].name = "S1".to_owned()), "plan.stations[3].name");
    assert_eq!(key(&|p| p.stations[0].lines[1].name = "S1-00".to_owned()), "plan.stations[0].lines[1].name");
    let mut recipe = presets::case_like(STROKE_M, 1);
    recipe.offsets_m.clear();
    assert_eq!(recipe.build().unwrap_err().key, "recipe.offsets_m");
    let mut recipe = presets::case_like(STROKE_M, 1);
    recipe.points = [9, 3];
    assert_eq!(recipe.build().unwrap_err().key, "recipe.points");
}
