//! Bow of a guideway by moisture: granite that is damp on one side swells there, and arches or sags.
//!
//! Formula: the arch of [`super::arch`], in its forms `beam` and `free`, times h − 50 % (relative humidity). Inputs: readings (m),
//! `humidity_pct` (%), or what is behind it (`by`): stone takes hours to get damp. Plates of granite were seen to bend by 1 to 3 µm a
//! metre between a dry and a damp room.

use super::arch::Arch;
use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{CovariateProblem, Effect, Motion, ParameterSpec, State};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "moisture_bow",
    title: "bow under moisture",
    formula: "times (h - 50 %): height -kappa (r - r0)(r - r1)/2 + ramp (r - m) + heave, pitch angle -slope (r - m) + tilt, \
              along the axis shift + stretch (r - m) + lean (z - z0)",
    typical: "0.05-0.5 µm/m a percent",
    source: "swelling of granite on its damp side; bending of a beam under a linear gradient",
    needs: "humidity_pct, changing within the campaign by some percent",
    decided_by: "repeat lines along the axis, with a vertical part of the sight, at another humidity and the same temperatures",
    construct,
    propose,
    refine: None,
};
/// What it reads where its shape does not say `by`, and how such names begin and end.
const HUMIDITY: &str = "humidity_pct";
const NAMED: (&str, &str) = ("humidity_", "pct");
/// What the straightness of the machine holds (%).
const STANDARD_PCT: f64 = 50.0;
/// Humidity that bends granite as a kelvin does (%).
const AS_A_KELVIN_PCT: f64 = 10.0;

#[derive(Debug)]
struct MoistureBow {
    arch: Arch,
    by: String,
}

fn construct(shape: &Shape, machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let arch = Arch::of(&mut reader, machine)?;
    let by = if shape.0.contains_key("by") { reader.text("by")?.to_owned() } else { HUMIDITY.to_owned() };
    reader.finish()?;
    Ok(Box::new(MoistureBow { arch, by }))
}

/// Both level axes, where the humidity changed, by it and by what is behind it.
fn propose(observed: &Observed) -> Vec<Shape> {
    let by = |name: &str| {
        let of = |shape: Shape| if name == HUMIDITY { shape } else { shape.text("by", name) };
        Arch::shapes(of)
    };
    observed.named(NAMED.0, NAMED.1).flat_map(by).collect()
}

impl Effect for MoistureBow {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn covariates(&self) -> Vec<String> {
        vec![self.by.clone()]
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        self.arch.parameters(["1/(m %)", "rad/%", "m/%", "1/%"], AS_A_KELVIN_PCT)
    }

    fn essential(&self) -> &'static [usize] {
        self.arch.essential()
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        self.arch.motion(state, state.covariate(&self.by)? - STANDARD_PCT, part);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Each, machine, tip_m};
    use super::*;

    /// κL²/8: 0.5 µm/(m·%) on 0.8 m, four percent above standard, arch by 0.16 µm.
    #[test]
    fn it_arches_by_an_eighth_of_curvature_times_length_squared() {
        let effect = construct(&Shape::new().text("axis", "x").text("form", "beam"), &machine()).unwrap();
        let at = |humidity_pct: f64| {
            let logged = [("humidity_pct", humidity_pct)];
            let state = State { reading_m: [0.4, 0.1, 0.1], offset_m: [0.0; 3], covariates: &Each(&logged) };
            tip_m(effect.as_ref(), &state, &[0.5e-6, 0.0, 0.0]).z
        };
        assert!((at(54.0) - 0.16e-6).abs() < 1e-18, "{}", at(54.0));
        assert_eq!(at(50.0), 0.0);
    }

    /// Stone follows the humidity of its air: what is behind it is tried, and read by its name.
    #[test]
    fn what_is_behind_the_humidity_bends_as_the_humidity_does() {
        let machine = machine();
        let varying = ["temp_air_c", "humidity_pct", "humidity_lag_3600s_pct"].map(str::to_owned);
        let observed =
            Observed { machine: &machine, varying: &varying, stations: &[], offsets_m: &[], time_s: (0.0, 1.0) };
        let shapes = propose(&observed);
        let reads = |shape: &Shape| construct(shape, &machine).unwrap().covariates();
        let behind: Vec<&Shape> = shapes.iter().filter(|own| reads(own) == ["humidity_lag_3600s_pct"]).collect();
        assert_eq!((shapes.len(), behind.len()), (8, 4));
        let effect = construct(behind[0], &machine).unwrap();
        let logged = [("humidity_pct", 50.0), ("humidity_lag_3600s_pct", 54.0)];
        let state = State { reading_m: [0.4, 0.1, 0.1], offset_m: [0.0; 3], covariates: &Each(&logged) };
        assert!((tip_m(effect.as_ref(), &state, &[0.5e-6, 0.0, 0.0]).z - 0.16e-6).abs() < 1e-18);
    }
}
