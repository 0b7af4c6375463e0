//! The bench on diagnosers whose answers are known: one that finds nothing, one that claims what is not there.
//!
//! Place in the flow: whole trials from the simulator to the record. The diagnosers here fit the rigid model and say
//! what they are told to say, so what the record holds of them can be worked out beforehand.

#![allow(clippy::unwrap_used, clippy::panic)] // a preparation that fails fails its test

use abbe_geometry::machine::Machine;
use abbe_identify::{IdentifyOptions, OrderChoice, identify};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use abbe_trials::attribution::Same;
use abbe_trials::trial::Memory;
use abbe_trials::{Accepted, Diagnoser, Finding, Record, Scenario, Trial, TrialError, Verdict, run, suite, summary};

/// Fits the machine without effects and gives the findings it was made with.
struct Says(Vec<Finding>);

impl Diagnoser for Says {
    fn diagnose(
        &self,
        machine: &Machine,
        instrument: RangeUncertainty,
        campaign: &Campaign,
        order: OrderChoice,
    ) -> Result<Verdict, TrialError> {
        let found = identify(
            machine,
            instrument,
            campaign,
            &IdentifyOptions { order, ..IdentifyOptions::default() },
            &mut |_| true,
        )?;
        let chi2 = found.evidence.chi2_per_dof;
        Ok(Verdict {
            model: found.model,
            consistent_with_noise: self.0.is_empty(),
            findings: self.0.clone(),
            not_identifiable: Vec::new(),
            steps: Vec::new(),
            chi2_per_dof: [chi2, chi2],
        })
    }
}

const TABLE: &[Accepted] = &[Accepted {
    injected: "backlash",
    found: "reversal",
    same: &[Same::Word("axis", "axis")],
    reason: "the same by another name",
}];

fn scenario(name: &str) -> Scenario {
    suite::scenarios().into_iter().find(|scenario| scenario.name == name).unwrap()
}

fn outcome(record: &Record) -> &abbe_trials::record::Outcome {
    record.outcome.as_ref().unwrap_or_else(|problem| panic!("{problem}"))
}

#[test]
fn an_effect_has_the_size_asked_for_and_a_diagnosis_that_does_nothing_removes_nothing() {
    let (scenario, memory) = (scenario("play"), Memory::default());
    for factor in [1.5, 3.0] {
        let trial = Trial { scenario: &scenario, seed: 3, level: Some(factor) };
        let record = run(&trial, &memory, &Says(Vec::new()), TABLE);
        let outcome = outcome(&record);
        let reached = outcome.before_m / outcome.clean_m;
        assert!((reached / factor - 1.0).abs() < 0.05, "{reached} for {factor}");
        assert_eq!(outcome.after_m, outcome.before_m);
        assert_eq!(outcome.excess_removed(), Some(0.0));
        assert!(!outcome.attribution.detected && !outcome.attribution.right);
        assert_eq!(summary::failures(&[record]).len(), 1);
    }
}

#[test]
fn the_same_trial_gives_the_same_record_whatever_was_run_before() {
    let scenario = scenario("bow");
    let trial = |factor| Trial { scenario: &scenario, seed: 5, level: Some(factor) };
    let fresh = run(&trial(2.0), &Memory::default(), &Says(Vec::new()), TABLE);
    let memory = Memory::default();
    run(&trial(1.2), &memory, &Says(Vec::new()), TABLE);
    assert_eq!(run(&trial(2.0), &memory, &Says(Vec::new()), TABLE), fresh);
    outcome(&fresh);
}

#[test]
fn a_claim_on_a_clean_machine_is_a_false_alarm() {
    let scenario = scenario("nothing");
    let claim = Finding {
        effect: "reversal".to_owned(),
        attributed: true,
        shape: [("axis".to_owned(), "x".to_owned())].into(),
        detail: "reversal of x".to_owned(),
    };
    let trial = Trial { scenario: &scenario, seed: 2, level: None };
    let record = run(&trial, &Memory::default(), &Says(vec![claim]), TABLE);
    let attribution = outcome(&record).attribution;
    assert!(attribution.detected && attribution.wrong && !attribution.right);
    assert!(summary::failures(std::slice::from_ref(&record))[0].contains("false alarm"));
    let lines = summary::lines(&[record]);
    assert_eq!(lines.iter().map(|line| line.wrong.hits).collect::<Vec<_>>(), [1, 1]);
    assert!(summary::text(&lines).contains("nothing"));
}

#[test]
fn every_scenario_can_be_identified_without_its_effect() {
    for scenario in suite::scenarios().into_iter().filter(|scenario| scenario.family != abbe_trials::Family::Single) {
        let plain = Scenario { injected: Vec::new(), levels: Vec::new(), ..scenario };
        let trial = Trial { scenario: &plain, seed: 1, level: None };
        let record = run(&trial, &Memory::default(), &Says(Vec::new()), TABLE);
        // Of 20 µm rms the worst description here, cubics on a rough machine, leaves a third.
        assert!(outcome(&record).after_m < 8e-6, "{}: {:e}", plain.name, outcome(&record).after_m);
    }
}
