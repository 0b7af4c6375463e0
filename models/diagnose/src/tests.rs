//! Rules of the search that only show from inside: what is compared with what, and what follows on a failure.
//!
//! Place in the flow: beside `tests/`, which sees whole diagnoses. Simulated campaigns, SI.

use crate::aside;
use crate::candidates::{Candidate, Round, columns_of};
use crate::exchange;
use crate::gate;
use crate::options::DiagnoseOptions;
use crate::order::enriched;
use crate::score::Score;
use crate::search::{Search, State};
use crate::step::Step;
use crate::taken::Taken;
use crate::{paired, tomorrow, worth};
use abbe_geometry::correct::correct;
use abbe_geometry::effects::{Shape, known};
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::{Joint, Machine, Side, Squareness};
use abbe_geometry::model::MachineModel;
use abbe_geometry::rotation::RotationForm;
use abbe_geometry::{Axis, ErrorId};
use abbe_identify::{CampaignRow, EffectTerm};
use abbe_measurement::campaign::Campaign;
use abbe_virtual_machine::effects::from_text;
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::instrument::InstrumentConfig;
use abbe_virtual_machine::plan::presets::case_like;
use abbe_virtual_machine::{SimulationConfig, TruthRecipe, simulate_campaign};
use faer::Mat;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

const INSTRUMENT: InstrumentConfig = InstrumentConfig::LASER_TRACER;

/// A normal number of deviation 1.
pub(crate) fn normal(generator: &mut ChaCha8Rng) -> f64 {
    let (a, b): (f64, f64) = (generator.random(), generator.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

pub(crate) fn machine() -> Machine {
    let tilt = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
    Machine {
        name: "bridge".to_owned(),
        frame_id: "machine".to_owned(),
        joints: Axis::ALL.map(|axis| Joint { axis, side: Side::Tool }),
        stroke_m: [(0.0, 0.8), (0.0, 0.6), (0.0, 0.6)],
        squareness: [tilt("C0Y", Axis::Y, Axis::Z), tilt("B0Z", Axis::Z, Axis::Y), tilt("A0Z", Axis::Z, Axis::X)],
        rotation: RotationForm::Exact,
        kinds: [Some(FunctionKind::BSpline { intervals: 9 }); 18],
        repeatability_m: INSTRUMENT.repeatability_m,
        u_ram_turn_rad: [abbe_geometry::machine::USUAL_RAM_TURN_RAD; 3],
        default_offset_m: None,
    }
}

fn simulated(seed: u64, effects: &[&str]) -> (Machine, Campaign) {
    let truth = TruthRecipe { seed, ..TruthRecipe::default() }.bridge_xyz().unwrap();
    let stroke_m = truth.stroke_m.map(|[lower, upper]| (lower, upper));
    let machine = Machine { stroke_m, ..machine() };
    let config = SimulationConfig {
        seed,
        plan: case_like(truth.stroke_m, seed).build().unwrap(),
        machine: truth,
        instrument: INSTRUMENT,
        environment: EnvironmentConfig::workshop(),
        effects: effects.iter().map(|text| from_text(text).unwrap()).collect(),
    };
    (machine, simulate_campaign(&config).unwrap().campaign)
}

fn state<'a>(search: &Search<'a>, machine: &Machine) -> State<'a> {
    let fit = search.fit(machine, &[], &mut |_| true).unwrap();
    let round = search.round(&fit).unwrap();
    State::new(fit, round, Vec::new())
}

/// A fit that only rejects more of the same readings: every plain mean over what each fit kept falls, nothing is better.
#[test]
fn regress_rejecting_more_readings_is_no_evidence() {
    let (machine, campaign) = simulated(11, &[]);
    let options = DiagnoseOptions::default();
    let search = Search::new(INSTRUMENT.range, &campaign, &options);
    let state = state(&search, &machine);
    let mut strict = state.fit.clone();
    for (weight, (residual_m, u_m)) in strict.weights.iter_mut().zip(strict.residuals_m.iter().zip(&strict.u_m)) {
        if (residual_m / u_m).abs() > 1.5 {
            *weight = 0.0;
        }
    }
    let strict = search.round(&strict).unwrap();
    let lines = &crate::blocks::blocks(&campaign, &state.round)[0].1;
    let plain = |round| crate::judge::blocked_rms(round, lines);
    assert!(plain(&strict.linear) < 0.9 * plain(&state.round.linear), "the trap is there");
    let pairs = paired::pairs(&state.round, &strict, lines, paired::Untold::Judged);
    let sum = |of: fn(&paired::Pair) -> f64| pairs.iter().map(of).sum::<f64>();
    let (before, after) = (sum(|p| p.before), sum(|p| p.after));
    assert!((before / after - 1.0).abs() < 0.05, "{before} {after}");
    let verdict = gate::judge(&state.round, &strict, &campaign, &[]);
    assert!(verdict.judged.iter().all(|judged| judged.deviations < 3.0), "{verdict:?}");
}

/// Without the offset at which most readings stand, much of the machine is hardly told. Both fits were held to what they said of that, and
/// a load that is there was set aside by 26 standard deviations.
#[test]
fn regress_what_neither_fit_can_predict_refuses_no_effect() {
    let shapes = [
        (
            4,
            "backlash axis=y size_um=0.5",
            "reversal",
            Shape::new().text("axis", "y").text("over", "y").number("terms", 1.0),
        ),
        (3, "table_load um_per_kg=0.12", "table_load", Shape::new().text("form", "dish")),
    ];
    for (seed, injected, name, shape) in shapes {
        let (machine, campaign) = simulated(seed, &[injected]);
        let options = DiagnoseOptions::default();
        let search = Search::new(INSTRUMENT.range, &campaign, &options);
        let without = state(&search, &machine).round;
        let terms = [EffectTerm::new(name, shape, &machine).unwrap()];
        let fit = search.fit(&machine, &terms, &mut |_| true).unwrap();
        let verdict = gate::judge(&without, &search.round(&fit).unwrap(), &campaign, &terms);
        assert_eq!(verdict.refused, None, "{injected}: {verdict:#?}");
    }
}

/// Rows of a fit whose effects read no log are the same whatever was logged, and what is read of another log is read of that.
#[test]
fn a_fit_reads_another_log_as_if_it_had_been_fitted_beside_it() {
    let (machine, campaign) = simulated(9, &[]);
    let options = DiagnoseOptions::default();
    let search = Search::new(INSTRUMENT.range, &campaign, &options);
    let state = state(&search, &machine);
    let mut other = campaign.clone();
    other.covariates.iter_mut().for_each(|column| column.values.reverse());
    let shape = Shape::new().text("axis", "x").text("sensor", "temp_air_c");
    let term = [&EffectTerm::new("scale_expansion", shape, &machine).unwrap()];
    let told = |round: &Round| round.free.project(columns_of(round, &term).unwrap().as_ref());
    let anew = Round::new(&state.fit, INSTRUMENT.range, &other).unwrap();
    let (anew, known, before) = (told(&anew), told(&state.round.logged_as(&other)), told(&state.round));
    assert_eq!((anew.gradient, anew.left), (known.gradient.clone(), known.left));
    assert_ne!(known.gradient, before.gradient);
}

/// A search that made the error functions finer may take all back, and what its fit says of a slow change is told of the model that it
/// began with: it stood at the places of other parameters.
#[test]
fn regress_what_a_finer_fit_took_finds_its_place_in_a_coarser_one() {
    let (mut machine, campaign) = simulated(9, &[]);
    machine.kinds = [Some(FunctionKind::BSpline { intervals: 5 }); 18];
    let options = DiagnoseOptions::default();
    let search = Search::new(INSTRUMENT.range, &campaign, &options);
    let [coarse, fine] = [machine.clone(), enriched(&machine)].map(|machine| state(&search, &machine));
    let (before, of_fine) = (&coarse.fit.model, &fine.fit.model);
    let eyx = ErrorId::all().find(|id| id.name() == "EYX").unwrap();
    let bend_m = |x_m: f64| 1e-6 * x_m * (x_m - 0.8) * (x_m - 0.3);
    let (squareness_rad, dead_path_m) = (2e-6, 3e-6);
    let rows = &fine.round.rows;
    let mut moved = Mat::zeros(1 + rows.parameters.iter().max().unwrap(), 1);
    for (place, value) in of_fine.layout().range(eyx).zip(of_fine.layout().basis(eyx).unwrap().coefficients_of(bend_m))
    {
        moved[(place, 0)] = value;
    }
    moved[(of_fine.layout().squareness().start + 1, 0)] = squareness_rad;
    moved[(of_fine.machine_parameters() + 7, 0)] = dead_path_m;
    let of_rows = Mat::from_fn(rows.parameters.len(), 1, |k, _| moved[(rows.parameters[k], 0)]);
    let mut parts = before.parts().clone();
    Taken::new(of_fine, rows, &of_rows * of_rows.transpose()).add(before, &mut parts.covariance);
    let after = MachineModel::new(parts).unwrap();
    let grown = |u: (f64, f64)| (u.1.powi(2) - u.0.powi(2)).max(0.0).sqrt();
    for x_m in [0.1, 0.25, 0.5, 0.75] {
        let grown_m = grown((before.error(eyx, x_m).1, after.error(eyx, x_m).1));
        assert!((grown_m - bend_m(x_m).abs()).abs() < 1e-12, "{x_m}: {grown_m} for {}", bend_m(x_m));
    }
    assert!((grown((before.squareness(1).1, after.squareness(1).1)) - squareness_rad).abs() < 1e-12);
    let dead_path = before.machine_parameters() + 7;
    let added = after.covariance(dead_path, dead_path) - before.covariance(dead_path, dead_path);
    assert!((added.sqrt() - dead_path_m).abs() < 1e-12);
    assert_eq!(before.error(ErrorId::all().next().unwrap(), 0.4), after.error(ErrorId::all().next().unwrap(), 0.4));
}

/// A candidate that looks best and cannot be fitted is set aside with its reason, and the next one is tried at once.
#[test]
fn regress_a_candidate_that_cannot_be_fitted_gives_way_to_the_next() {
    let (machine, campaign) = simulated(5, &["backlash axis=x size_um=1.5"]);
    let options = DiagnoseOptions::default();
    let search = Search::new(INSTRUMENT.range, &campaign, &options);
    let mut state = state(&search, &machine);
    let round = state.round.clone();
    let mut named = search.named(&round, &machine).unwrap();
    let shape = Shape::new().text("axis", "y").text("sensor", "temp_nowhere_c");
    let known = known("scale_expansion").unwrap();
    let term = EffectTerm::new(known.name, shape, &machine).unwrap();
    let score = Score {
        reduction: 1e9,
        degrees: term.len(),
        p_value: 0.0,
        gain: 1e9,
        alias_share: 0.0,
        estimate: vec![0.0; term.len()],
    };
    named.insert(0, Candidate { known, term, score, trials: 1, absorbed: 0.0, rest: None });
    assert!(search.advance(&mut state, &round, &named, &mut |_| true).unwrap(), "the round adds something");
    let set_aside = state.set_aside(&[]);
    assert_eq!(set_aside.len(), 1, "{set_aside:?}");
    assert!(set_aside[0].because.contains("cannot be fitted") && set_aside[0].because.contains("temp_nowhere_c"));
    assert!(
        matches!(&state.steps[1], Step::Added { term, .. } if term.effect.name() == "reversal"),
        "{:?}",
        state.steps
    );
}

/// A term of which the data tell nothing moves no point and costs what its prior allows; one that they tell is worth it.
#[test]
fn regress_what_only_a_prior_tells_is_not_worth_its_uncertainty() {
    let (machine, campaign) = simulated(12, &["backlash axis=x size_um=2"]);
    let options = DiagnoseOptions::default();
    let search = Search::new(INSTRUMENT.range, &campaign, &options);
    let without = state(&search, &machine).fit.model;
    let shape = Shape::new().text("axis", "x").text("over", "x").number("terms", 1.0);
    let term = EffectTerm::new("reversal", shape, &machine).unwrap();
    let backlash = search.fit(&machine, std::slice::from_ref(&term), &mut |_| true).unwrap().model;
    assert_eq!(worth::refusal(std::slice::from_ref(&term), &without, &backlash, &campaign), None);
    // The same parameters, with nothing known of them.
    let mut parts = backlash.parts().clone();
    let count = parts.effects[0].parameters.len();
    let first = backlash.layout().len();
    parts.effects[0].parameters.fill(0.0);
    for row in first..first + count {
        for column in 0..=row {
            parts.covariance[row * (row + 1) / 2 + column] = if row == column { 1e-10 } else { 0.0 };
        }
    }
    for row in first + count..(((8 * parts.covariance.len() + 1) as f64).sqrt() as usize - 1) / 2 {
        (first..first + count).for_each(|column| parts.covariance[row * (row + 1) / 2 + column] = 0.0);
    }
    let vague = abbe_geometry::model::MachineModel::new(parts).unwrap();
    let because = worth::refusal(std::slice::from_ref(&term), &without, &vague, &campaign).unwrap();
    assert!(because.contains("hardly tell"), "{because}");
    assert_eq!(worth::refusal(std::slice::from_ref(&term), &without, &without, &campaign), None);
}

/// What the gate says of a backlash of Y.
fn of_a_backlash(machine: &Machine, campaign: &Campaign) -> gate::Verdict {
    let options = DiagnoseOptions::default();
    let search = Search::new(INSTRUMENT.range, campaign, &options);
    let state = state(&search, machine);
    let shape = Shape::new().text("axis", "y").text("over", "y").number("terms", 1.0);
    let term = EffectTerm::new("reversal", shape, machine).unwrap();
    let after = search.round(&search.fit(machine, std::slice::from_ref(&term), &mut |_| true).unwrap()).unwrap();
    gate::judge(&state.round, &after, campaign, &[term])
}

/// Of two values of a covariate one tells nothing of the other: a term is not refused for what nobody could know.
#[test]
fn regress_a_covariate_of_two_values_is_left_out_of_no_fit() {
    let (machine, mut campaign) = simulated(13, &["backlash axis=y size_um=2"]);
    let sign = campaign.covariates.iter_mut().find(|column| column.name == "dir_y").unwrap();
    sign.values.iter_mut().for_each(|value| *value = value.map(|sign| if sign < 0.0 { -1.0 } else { 1.0 }));
    let verdict = of_a_backlash(&machine, &campaign);
    assert!(verdict.judged.iter().all(|judged| judged.by != "dir_y"), "{verdict:?}");
    assert!(verdict.missing.iter().any(|words| words.contains("dir_y has too few values")), "{verdict:?}");
}

/// What bends between three loads is not told by two of them: terms of a load were refused, since the heaviest was predicted badly.
#[test]
fn regress_the_ends_of_a_covariate_that_was_set_to_few_values_are_left_out_of_no_fit() {
    let (machine, mut campaign) = simulated(13, &["backlash axis=y size_um=2"]);
    let side = campaign.covariates.iter_mut().find(|column| column.name == "dir_y").unwrap();
    side.values.iter_mut().enumerate().for_each(|(k, value)| *value = Some([-1.0, 0.5, 1.0][k % 3]));
    let verdict = of_a_backlash(&machine, &campaign);
    let judged = verdict.judged.iter().find(|judged| judged.by == "dir_y").unwrap();
    assert_eq!(judged.blocks, 1, "of three the one in the middle: {verdict:?}");
}

/// Of three expansions the first took the sensor that imitates the others best; beside it its own sensor had little left to explain.
#[test]
fn regress_a_sensor_that_was_chosen_too_early_is_exchanged() {
    let effects = ["scale_expansion axis=x per_kelvin_um_m=9 fixed_at_mm=0", "backlash axis=y size_um=1.5"];
    let (machine, campaign) = simulated(4, &effects);
    let options = DiagnoseOptions::default();
    let search = Search::new(INSTRUMENT.range, &campaign, &options);
    let expansion = |sensor: &str| {
        let shape = Shape::new().text("axis", "x").text("sensor", sensor);
        EffectTerm::new("scale_expansion", shape, &machine).unwrap()
    };
    let play = Shape::new().text("axis", "y").text("over", "y").number("terms", 1.0);
    let play = EffectTerm::new("reversal", play, &machine).unwrap();
    let with = |terms: Vec<EffectTerm>| {
        let fit = search.fit(&machine, &terms, &mut |_| true).unwrap();
        let mut state = State::new(fit.clone(), search.round(&fit).unwrap(), terms);
        let is_exchanged = exchange::one(&search, &mut state, &[], &mut |_| true).unwrap();
        let sensors: Vec<String> = state.terms[0].effect.reads();
        let fitted = state.fit.model.parts().effects.iter().map(|fitted| fitted.effect.name()).collect::<Vec<_>>();
        assert_eq!(fitted, state.terms.iter().map(|term| term.effect.name()).collect::<Vec<_>>());
        (is_exchanged, sensors, state.steps.len())
    };
    let own = vec!["temp_scale_x_c".to_owned()];
    assert_eq!(with(vec![expansion("temp_scale_y_c"), play.clone()]), (true, own.clone(), 2));
    assert_eq!(with(vec![expansion("temp_scale_x_c"), play]), (false, own, 0), "the right one stays");
    let alone = with(vec![expansion("temp_scale_y_c")]);
    assert_eq!((alone.0, alone.2), (false, 0), "alone it was chosen among all");
}

/// Of a time constant as long as the campaign little but a straight line is seen; of a quarter of it, how it comes to rest.
#[test]
fn regress_a_growth_that_nobody_saw_come_to_rest_is_no_cause() {
    let (machine, campaign) = simulated(3, &[]);
    let last_s = campaign.readings.iter().map(|reading| reading.time_s).fold(0.0, f64::max);
    let because = |share: f64| {
        let shape = Shape::new().text("axis", "x").number("tau_s", share * last_s);
        let fitted = MachineModel::fitted_effect("scale_growth", shape, &machine, vec![18e-6, 0.0]).unwrap();
        tomorrow::still_growing(&fitted, &campaign)
    };
    assert!(because(0.94).is_some_and(|because| because.contains("35 % of it were still to come")));
    assert_eq!(because(0.25), None);
    let by_temperature = Shape::new().text("axis", "x").text("sensor", "temp_air_c");
    let fitted = MachineModel::fitted_effect("scale_expansion", by_temperature, &machine, vec![1e-6, 0.0]).unwrap();
    assert_eq!(tomorrow::still_growing(&fitted, &campaign), None);
}

/// A load at one station was found, set aside as its size is not told, and U of points at that load held half of them.
#[test]
fn regress_what_is_there_and_not_told_stands_in_u_where_it_acts() {
    let (machine, campaign) = simulated(12, &["table_load um_per_kg=1"]);
    let options = DiagnoseOptions::default();
    let search = Search::new(INSTRUMENT.range, &campaign, &options);
    let mut state = state(&search, &machine);
    let own = state.fit.model.clone();
    let told = |state: &State, is_out: bool| {
        aside::told(&search, state, (own.clone(), &[]), &|_| is_out, &mut |_| true).unwrap()
    };
    assert_eq!(told(&state, false).model.parts().effects.len(), 0, "nothing was set aside");
    let named = search.named(&state.round, &machine).unwrap();
    let term = named.into_iter().find(|candidate| candidate.known.name == "table_load").unwrap().term;
    let with = search.fit(&machine, std::slice::from_ref(&term), &mut |_| true).unwrap().model;
    // Another form of it says the same again.
    for why in ["its size is not told", "nor is it in another form"] {
        state.steps.push(Step::set_aside_for(term.clone(), (why.to_owned(), true)));
    }
    // Of a course in time the size alone is taken: the time of a campaign is not that of a coordinate.
    let everywhere = told(&state, true).model;
    assert!(
        everywhere.parts().effects.is_empty() && everywhere.parts().quality.unexplained_m.iter().all(|m| *m > 1e-7)
    );
    let aside::Aside { model: told, terms } = told(&state, false);
    assert_eq!(terms.len(), 1);
    assert!(!told.parts().effects[0].corrects());
    assert!(state.set_aside(&terms)[0].because.ends_with("it corrects nothing, and stands in U"));
    assert!(!state.set_aside(&[])[0].because.contains("stands in U"));
    let at = |model: &MachineModel, load_kg: f64| {
        let mut campaign = campaign.clone();
        let column = campaign.covariates.iter_mut().find(|column| column.name == "load_kg").unwrap();
        column.values.fill(Some(load_kg));
        let row = CampaignRow { campaign: &campaign, reading: 0 };
        let state = abbe_geometry::effects::State { reading_m: [0.4, 0.3, 0.3], offset_m: [0.0; 3], covariates: &row };
        let corrected = correct(model, &state);
        (corrected.position_m, corrected.covariance_m2.unwrap()[(2, 2)].sqrt())
    };
    for load_kg in [0.0, 10.0] {
        assert!((at(&told, load_kg).0 - at(&own, load_kg).0).norm() < 1e-12, "it corrects nothing");
    }
    let moved_m = (at(&with, 10.0).0 - at(&own, 10.0).0).z.abs();
    assert!(moved_m > 1e-6, "{moved_m:e}");
    assert!(at(&told, 10.0).1 > moved_m, "{:e} beside {moved_m:e}", at(&told, 10.0).1);
    // What the fit took for the machine's own is off as well: these stations saw all loads, and none alone.
    assert!(at(&told, 0.0).1 > 2.0 * at(&own, 0.0).1 && at(&told, 100.0).1 > 4.0 * at(&told, 10.0).1);
}
