//! What a plan says of effects is what a diagnosis of the measured campaign says and finds; and what is refused, and how.
//!
//! Place in the flow: as `promise.rs`, with physics beyond the geometry.

use crate::common::{INSTRUMENT, bridge, drive, request, simulated};
use abbe_diagnose::{DiagnoseOptions, diagnose};
use abbe_geometry::effects::{Shape, Wish};
use abbe_measurement::planned::{Goal, Sensor};
use abbe_plan::{PlanError, Request, Stage, check, plan};
use abbe_virtual_machine::effects::from_text;
use abbe_virtual_machine::simulate_campaign;

const SHORT: Goal = Goal { uncertainty_m: None, budget_s: Some(2.5 * 3600.0) };

fn names(entries: impl Iterator<Item = &'static str>) -> Vec<&'static str> {
    let mut names: Vec<&str> = entries.collect();
    names.sort_unstable();
    names.dedup();
    names
}

#[test]
fn what_a_plan_calls_not_identifiable_a_diagnosis_of_its_campaign_cannot_find() {
    let request = request(bridge, SHORT);
    let plan = plan(&request, &mut |_| true).unwrap();
    let foreseen = names(plan.promise.effects.as_ref().unwrap().not_identifiable.iter().map(|n| n.name));
    assert!(foreseen.contains(&"reflector_incidence") && !foreseen.contains(&"reversal"), "{foreseen:?}");
    let mut config = simulated(bridge(900), drive(&request, &plan), 9);
    // A reflector whose reading falls off with the angle, ten times what would be seen if nothing else took it; and play.
    config.effects = ["backlash axis=y size_um=1.5"].map(|text| from_text(text).unwrap()).to_vec();
    let campaign = simulate_campaign(&config).unwrap().campaign;
    let options = DiagnoseOptions { folds: 0, ..DiagnoseOptions::default() };
    let found = diagnose(&request.machine, &[], INSTRUMENT.range, &campaign, &options, &mut |_| true).unwrap();
    let said = names(found.not_identifiable.iter().map(|n| n.name));
    println!(
        "foreseen {foreseen:?}, said {said:?}, found {:?}",
        found.found.iter().map(|f| f.name).collect::<Vec<_>>()
    );
    // The simulated sensors vary as well, so that more can be asked; what depends on the path alone is the same.
    assert!(foreseen.iter().all(|name| said.contains(name)), "{foreseen:?} {said:?}");
    let reversal = found.found.iter().find(|f| f.name == "reversal").unwrap();
    let told =
        plan.promise.effects.as_ref().unwrap().told.iter().find(|t| t.name == "reversal" && t.shape == reversal.shape);
    if let Some(told) = told {
        let (foreseen_u, stated_u) = (told.parameters[0].u, reversal.parameters[0].u);
        assert!((stated_u / foreseen_u - 1.0).abs() < 0.15, "{stated_u} {foreseen_u}");
        assert!(told.parameters[0].found_from < 1.5e-6);
    }
}

#[test]
fn a_wish_turns_lines_round_until_both_directions_are_driven() {
    let mut request = request(bridge, SHORT);
    request.tell = vec![Wish { name: "reversal".to_owned(), shape: Shape::new().text("axis", "x") }];
    let plan = plan(&request, &mut |_| true).unwrap();
    let along = |sign: f64| {
        let of = |line: &&abbe_measurement::planned::Line| {
            (line.points_m.last().unwrap()[0] - line.points_m[0][0]) * sign > 0.1
        };
        plan.lines.iter().filter(of).count()
    };
    let (up, down) = (along(1.0), along(-1.0));
    assert!(up > 3 && down > 3, "{up} {down}");
    let told = plan
        .promise
        .effects
        .as_ref()
        .unwrap()
        .told
        .iter()
        .find(|t| t.name == "reversal" && t.shape.0 == request_axis(&t.shape));
    assert!(told.unwrap().parameters[0].u < 0.1e-6);
}

/// The shape itself where its axis is X.
fn request_axis(shape: &Shape) -> std::collections::BTreeMap<String, abbe_geometry::effects::ShapeValue> {
    let is_x = shape.0.get("axis") == Some(&abbe_geometry::effects::ShapeValue::Text("x".to_owned()));
    if is_x { shape.0.clone() } else { std::collections::BTreeMap::new() }
}

fn refused(change: impl FnOnce(&mut Request)) -> String {
    let mut request = request(bridge, SHORT);
    change(&mut request);
    plan(&request, &mut |_| true).unwrap_err().to_string()
}

#[test]
fn what_cannot_be_planned_is_refused_by_its_key_with_a_remedy() {
    let said = refused(|r| r.volume_m[0].1 = 0.9);
    assert!(said.contains("volume_mm.X") && said.contains("beyond the stroke"), "{said}");
    let said = refused(|r| (r.stands[0].position_m, r.stands[0].of_region) = ([0.4, 0.3, 0.3], false));
    assert!(said.contains("stand[0]") && said.contains("inside the volume"), "{said}");
    let said = refused(|r| {
        (r.stands[0].position_m, r.stands[0].of_region) = ([-0.25, 0.3, 0.3], false);
        r.tracer.nearest_m = 0.5;
    });
    assert!(said.contains("blind zone of 500 mm"), "{said}");
    let said = refused(|r| r.tracer.farthest_m = 0.4);
    assert!(said.contains("volume_mm") && said.contains("no stand sees the corner"), "{said}");
    let said = refused(|r| r.stands.truncate(1));
    assert!(said.contains("too few"), "{said}");
    let said = refused(|r| r.goal.uncertainty_m = Some(0.4e-6));
    assert!(said.contains("goal.uncertainty_um") && said.contains("repeatability"), "{said}");
    let said = refused(|r| r.tell = vec![Wish { name: "speed_lag".to_owned(), shape: Shape::new() }]);
    assert!(said.contains("tell[0] speed_lag") && said.contains("needs"), "{said}");
    let said = refused(|r| r.tell = vec![Wish { name: "bcklash".to_owned(), shape: Shape::new() }]);
    assert!(said.contains("reversal"), "the names that there are: {said}");
}

#[test]
fn a_budget_too_short_is_answered_with_the_shortest_that_there_is() {
    let mut request = request(bridge, Goal { uncertainty_m: None, budget_s: Some(0.7 * 3600.0) });
    let PlanError::Budget { shortest_s, stations, lines, .. } = plan(&request, &mut |_| true).unwrap_err() else {
        panic!("a budget that is too short was not refused as such")
    };
    println!("shortest {:.2} h with {stations} stations and {lines} lines", shortest_s / 3600.0);
    assert!(shortest_s > 0.7 * 3600.0 && stations >= 2 && lines >= 8);
    // What is named as possible is possible.
    request.goal.budget_s = Some(1.15 * shortest_s);
    request.most_stations = stations;
    let found = plan(&request, &mut |_| true).unwrap();
    assert!(found.time_s <= 1.15 * shortest_s);
}

#[test]
fn an_uncertainty_is_reached_in_less_time_than_its_half_or_the_best_is_named() {
    let mut request = request(bridge, Goal { uncertainty_m: Some(0.56e-6), budget_s: None });
    let found = plan(&request, &mut |_| true).unwrap();
    println!("0.56 µm: {:.3} µm in {:.2} h", found.promise.u_m * 1e6, found.time_s / 3600.0);
    assert!(found.promise.u_m <= 0.56e-6 && found.promise.u_m > 0.5e-6, "{}", found.promise.u_m);
    request.goal = Goal { uncertainty_m: Some(0.44e-6), budget_s: Some(2.0 * 3600.0) };
    match plan(&request, &mut |_| true).unwrap_err() {
        PlanError::Unreached { best_m, time_s, .. } => assert!(best_m > 0.44e-6 && time_s <= 2.0 * 3600.0),
        other => panic!("{other}"),
    }
}

/// More time and more stands were advised where the scale that all lengths have in common was more than what was wanted.
#[test]
fn regress_a_goal_below_the_common_scale_of_the_instrument_names_the_scale() {
    let mut request = request(bridge, Goal { uncertainty_m: Some(0.56e-6), budget_s: Some(3.0 * 3600.0) });
    request.instrument.common_per_metre = 3e-6;
    request.lines.levels = 3;
    let error = plan(&request, &mut |_| true).unwrap_err();
    let said = error.to_string();
    let PlanError::Unreached { wanted_m, best_m, common_m, .. } = error else { panic!("{said}") };
    assert!(common_m > wanted_m && common_m < best_m, "{said}");
    assert!(said.contains("u_k2_common_um_per_m, which no plan makes smaller"), "{said}");
    assert!(said.contains("whose scale is known better") && !said.contains("more time"), "{said}");
}

#[test]
fn the_same_request_gives_the_same_plan_and_a_stop_keeps_the_best_so_far() {
    let mut request = request(bridge, SHORT);
    request.lines.levels = 3;
    let (a, b) = (plan(&request, &mut |_| true).unwrap(), plan(&request, &mut |_| true).unwrap());
    assert_eq!((&a.lines, &a.stations, a.promise.u_m.to_bits()), (&b.lines, &b.stations, b.promise.u_m.to_bits()));
    let stopped = plan(&request, &mut |p| p.stage != Stage::Exchange).unwrap();
    assert!(stopped.stopped && stopped.promise.u_m >= a.promise.u_m && stopped.time_s <= 2.5 * 3600.0);
    assert!(matches!(plan(&request, &mut |_| false), Err(PlanError::Stopped)));
}

#[test]
fn regress_a_plan_whose_effects_cannot_be_foreseen_stands_without_them() {
    let mut request = request(bridge, Goal { uncertainty_m: None, budget_s: Some(1e300) });
    request.lines.levels = 3;
    let mut unsaid = 0;
    for most in [12, 24, 34] {
        let mut lines = 0;
        let mut observe = |progress: abbe_plan::Progress| {
            lines += usize::from(progress.stage == Stage::Lines);
            lines < most
        };
        match plan(&request, &mut observe) {
            Ok(plan) => {
                assert!(plan.stopped && !plan.lines.is_empty());
                println!("{most} lines: {:?}", plan.promise.effects.as_ref().err());
                unsaid += usize::from(plan.promise.effects.is_err());
            }
            Err(PlanError::Stopped) => println!("{most} lines: no plan"),
            Err(other) => panic!("{most} lines: {other}"),
        }
    }
    assert!(unsaid > 0, "no plan was stopped where effects cannot be foreseen");
}

#[test]
fn regress_an_easy_goal_gets_the_shortest_plan_that_tells_everything() {
    let mut request = request(bridge, SHORT);
    request.lines.levels = 3;
    let mut last = 0;
    for wanted_m in [2e-6, 1e-3] {
        request.goal = Goal { uncertainty_m: Some(wanted_m), budget_s: None };
        let mut steps = 0;
        let mut count = |_: abbe_plan::Progress| {
            steps += 1;
            true
        };
        let found = plan(&request, &mut count).unwrap();
        println!("{} µm: {:.3} µm, {:.2} h", wanted_m * 1e6, found.promise.u_m * 1e6, found.time_s / 3600.0);
        assert!(found.promise.u_m <= wanted_m && found.time_s < 2.5 * 3600.0 && !found.stopped);
        last = steps;
    }
    // Stopped while the shortest plan is sought.
    let mut steps = 0;
    let stopped = plan(&request, &mut |_| {
        steps += 1;
        steps < last
    });
    assert!(matches!(&stopped, Ok(plan) if plan.stopped), "the last step was not looked at: {:?}", stopped.err());
    assert_eq!(steps, last);
}

#[test]
fn regress_goals_names_feeds_and_offsets_that_cannot_be_are_refused_with_their_key() {
    let said = |change: &dyn Fn(&mut Request)| {
        let mut request = request(bridge, SHORT);
        change(&mut request);
        check(&request).unwrap_err().to_string()
    };
    let sensor = |name: &str, period_s: f64| Sensor { name: name.to_owned(), range: (19.0, 21.0), period_s };
    for wanted_m in [f64::INFINITY, f64::NAN] {
        assert!(said(&|r| r.goal.uncertainty_m = Some(wanted_m)).starts_with("goal.uncertainty_um: "));
    }
    for name in ["", " ", "t\nroom", "a,b", "dir_x"] {
        assert!(said(&|r| r.sensors = vec![sensor(name, 3600.0)]).starts_with("sensor[0].name: "), "{name:?}");
    }
    let twice = said(&|r| r.sensors = vec![sensor("t_c", 3600.0), sensor("t_c", 7200.0)]);
    assert!(twice.starts_with("sensor[1].name: two sensors"), "{twice}");
    assert!(said(&|r| r.sensors = vec![sensor("t_c", 1e-300)]).starts_with("sensor[0].period_h: "));
    for name in ["", "a,b", "a\"b", "a\nb"] {
        assert!(said(&|r| r.stands[0].name = name.to_owned()).starts_with("stand[0].name: "), "{name:?}");
    }
    assert!(said(&|r| r.motion.feeds_m_s = vec![1e297]).starts_with("motion.feeds_mm_s: "));
    assert!(said(&|r| r.tips_m = vec![[1e6, 0.0, 0.0]]).starts_with("tips_mm: an offset"));
    assert!(said(&|r| r.holders[1].offset_m = [3.0, 0.0, 0.0]).starts_with("holder[1].offset_mm: an offset"));
}
