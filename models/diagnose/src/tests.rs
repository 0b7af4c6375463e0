//! Rules of the search that only show from inside: what is compared with what, and what follows on a failure.
//!
//! Place in the flow: beside `tests/`, which sees whole diagnoses. Simulated campaigns, SI.

use crate::gate;
use crate::options::Options;
use crate::score::Score;
use crate::search::{Search, State, Step};
use crate::{candidates::Candidate, paired};
use abbe_geometry::Axis;
use abbe_geometry::effects::{Shape, known};
use abbe_geometry::error_function::Kind;
use abbe_geometry::machine::{Joint, Machine, Side, Squareness};
use abbe_geometry::rotation::RotationForm;
use abbe_identify::EffectTerm;
use abbe_measurement::campaign::Campaign;
use abbe_virtual_machine::effects::from_text;
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::instrument::InstrumentConfig;
use abbe_virtual_machine::plan::presets::case_like;
use abbe_virtual_machine::{SimulationConfig, TruthRecipe, simulate_campaign};

const INSTRUMENT: InstrumentConfig = InstrumentConfig::LASER_TRACER;

fn simulated(seed: u64, effects: &[&str]) -> (Machine, Campaign) {
    let truth = TruthRecipe { seed, ..TruthRecipe::default() }.bridge_xyz().unwrap();
    let tilt = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
    let machine = Machine {
        name: "bridge".to_owned(),
        frame_id: "machine".to_owned(),
        joints: Axis::ALL.map(|axis| Joint { axis, side: Side::Tool }),
        stroke_m: truth.stroke_m.map(|[lower, upper]| (lower, upper)),
        squareness: [tilt("C0Y", Axis::Y, Axis::Z), tilt("B0Z", Axis::Z, Axis::Y), tilt("A0Z", Axis::Z, Axis::X)],
        rotation: RotationForm::Exact,
        kinds: [Some(Kind::BSpline { intervals: 9 }); 18],
        repeatability_m: INSTRUMENT.repeatability_m,
        u_ram_turn_rad: [abbe_geometry::machine::USUAL_RAM_TURN_RAD; 3],
        default_offset_m: None,
    };
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
    let options = Options::default();
    let search = Search::new(INSTRUMENT.range, &campaign, &options);
    let state = state(&search, &machine);
    let mut strict = state.fit.clone();
    for (weight, (residual_m, u_m)) in strict.weights.iter_mut().zip(strict.residuals_m.iter().zip(&strict.u_m)) {
        if (residual_m / u_m).abs() > 1.5 {
            *weight = 0.0;
        }
    }
    let strict = search.round(&strict).unwrap();
    let lines = &crate::judge::blocks(&campaign, &state.round)[0].1;
    let plain = |round| crate::judge::blocked_rms(round, lines);
    assert!(plain(&strict.linear) < 0.9 * plain(&state.round.linear), "the trap is there");
    let pairs = paired::pairs(&state.round, &strict, lines, paired::Untold::Judged);
    let sum = |of: fn(&paired::Pair) -> f64| pairs.iter().map(of).sum::<f64>();
    let (before, after) = (sum(|p| p.before), sum(|p| p.after));
    assert!((before / after - 1.0).abs() < 0.05, "{before} {after}");
    let verdict = gate::judge(&state.round, &strict, &campaign, &[]);
    assert!(verdict.judged.iter().all(|judged| judged.deviations < 3.0), "{verdict:?}");
}

/// A candidate that looks best and cannot be fitted is set aside with its reason, and the next one is tried at once.
#[test]
fn regress_a_candidate_that_cannot_be_fitted_gives_way_to_the_next() {
    let (machine, campaign) = simulated(5, &["backlash axis=x size_um=1.5"]);
    let options = Options::default();
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
    named.insert(0, Candidate { known, term, score, trials: 1, absorbed: 0.0 });
    assert!(search.advance(&mut state, &round, &named, &mut |_| true).unwrap(), "the round adds something");
    let set_aside = state.set_aside();
    assert_eq!(set_aside.len(), 1, "{set_aside:?}");
    assert!(set_aside[0].because.contains("cannot be fitted") && set_aside[0].because.contains("temp_nowhere_c"));
    assert!(
        matches!(&state.steps[1], Step::Added { term, .. } if term.effect.name() == "reversal"),
        "{:?}",
        state.steps
    );
}
