//! Warm-up: the head grows, and the tip creeps away, as the machine comes to temperature.
//!
//! Formula: tip = a·(1 − e^(−t/τ)) along x, y and z, t the time since the campaign began (s), τ the time constant (s).
//! With two stages a second growth with four times that constant follows in the same way: a spindle or head warms its
//! neighbours after itself. Input: `time_s`. Typical 1–10 µm within minutes to hours
//! (ISO 230-3, drift tests; Schwenke 2008).

use super::growth::{REFINE, grown, time_constants_s};
use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{Acts, CovariateProblem, Effect, Motion, ParameterSpec, State, TIME};
use crate::axis::Axis;
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "warm_up",
    title: "warm-up growth of the head",
    formula: "tip = a (1 - exp(-t / tau)) [+ b (1 - exp(-t / 4 tau))] along x, y and z, t since the campaign began",
    typical: "1-10 µm",
    source: "ISO 230-3 (thermal drift tests); Schwenke et al. 2008",
    needs: "time_s, and positions that do not follow the time",
    decided_by: "return to the same few points throughout the campaign, or start once more from cold",
    construct,
    propose,
    refine: Some(REFINE),
};
/// Time constants tested, from the whole campaign down to a fortieth of it.
const TESTED: i32 = 6;

/// Ratio of the time constants of two stages.
const SLOWER: f64 = 4.0;

#[derive(Debug)]
struct WarmUp {
    tau_s: f64,
    stages: usize,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let effect = WarmUp { tau_s: reader.positive("tau_s")?, stages: reader.count("stages", 2)? };
    reader.finish()?;
    Ok(Box::new(effect))
}

fn propose(observed: &Observed) -> Vec<Shape> {
    let taus_s = time_constants_s(observed, TESTED);
    let shape = |tau_s: &f64, stages: f64| Shape::new().number("tau_s", *tau_s).number("stages", stages);
    // The slower stage of the longest would be a straight line.
    taus_s.iter().map(|tau_s| shape(tau_s, 1.0)).chain(taus_s.iter().skip(1).map(|tau_s| shape(tau_s, 2.0))).collect()
}

impl Effect for WarmUp {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn covariates(&self) -> Vec<String> {
        vec![TIME.to_owned()]
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        let spec = |stage: &'static str| {
            Axis::ALL.map(move |axis| ParameterSpec::new(format!("{stage}_{}", axis.lower()), "m", 100e-6))
        };
        ["growth", "later_growth"].into_iter().take(self.stages).flat_map(spec).collect()
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        let time_s = state.covariate(TIME)?;
        for (stage, tau_s) in [self.tau_s, SLOWER * self.tau_s].into_iter().enumerate().take(self.stages) {
            let grown = grown(time_s, tau_s);
            Axis::ALL.into_iter().for_each(|axis| part(3 * stage + axis.index(), Acts::Tip(axis), grown));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{One, machine, tip_m};
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn two_thirds_of_the_growth_are_there_after_one_time_constant() {
        let effect = construct(&Shape::new().number("tau_s", 1800.0).number("stages", 1.0), &machine()).unwrap();
        let at = |time_s: f64| {
            let state = State { reading_m: [0.3; 3], offset_m: [0.0; 3], covariates: &One(time_s) };
            tip_m(effect.as_ref(), &state, &[1e-6, 0.0, -5e-6])
        };
        assert_eq!(at(0.0), Vector3::zeros());
        assert!((at(1800.0) - Vector3::new(0.632_120_558_8e-6, 0.0, -3.160_602_794e-6)).norm() < 1e-15);
        assert!((at(1e6) - Vector3::new(1e-6, 0.0, -5e-6)).norm() < 1e-18);
    }

    #[test]
    fn time_constants_cover_the_campaign_in_steps_of_the_ratio_that_refinement_may_go() {
        let (machine, varying) = (machine(), ["time_s".to_owned()]);
        let observed =
            Observed { machine: &machine, varying: &varying, stations: &[], offsets_m: &[], time_s: (0.0, 7200.0) };
        let shapes = propose(&observed);
        assert_eq!(shapes[0], Shape::new().number("tau_s", 7200.0).number("stages", 1.0));
        assert_eq!(shapes[1], Shape::new().number("tau_s", 7200.0 / 2.1).number("stages", 1.0));
        assert_eq!(shapes.len(), 11, "six of one stage, five of two");
        assert!(propose(&Observed { varying: &[], ..observed }).is_empty(), "no time, no warm-up");
    }
}
