//! Bow of a guideway under a temperature gradient: warm on top it arches, and its carriage pitches along the arc.
//!
//! Formula: the arch of [`super::arch`], in its forms `beam` and `free`, times ΔT = warm − cold (K). Inputs: readings (m), two logged
//! temperatures (°C). κ is about α/height of the guideway (1e-5/(m·K) at one metre), so 1–5 µm/K.

use super::arch::Arch;
use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{CovariateProblem, Effect, Motion, ParameterSpec, State};
use super::{lagged_name, of_lagged};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "gradient_bow",
    title: "bow under a temperature gradient",
    formula: "times dT: height -kappa (r - r0)(r - r1)/2 + ramp (r - m) + heave, pitch angle -slope (r - m) + tilt, \
              along the axis shift + stretch (r - m) + lean (z - z0)",
    typical: "1-5 µm/K",
    source: "bending of a beam under a linear gradient, kappa = alpha dT / height; Schwenke et al. 2008",
    needs: "two temperatures on two sides of one part (temp_bridge_top_c and temp_bridge_bottom_c, or air and granite)",
    decided_by: "repeat lines along the axis, with a vertical part of the sight, at another temperature difference",
    construct,
    propose,
    refine: None,
};

#[derive(Debug)]
struct GradientBow {
    arch: Arch,
    warm: String,
    cold: String,
}

fn construct(shape: &Shape, machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let arch = Arch::of(&mut reader, machine)?;
    let (warm, cold) = reader.warm_and_cold()?;
    reader.finish()?;
    Ok(Box::new(GradientBow { arch, warm, cold }))
}

/// The sensor on the cold side of the one on the warm side, where both are logged; both lag alike.
fn partner(observed: &Observed, warm: &str) -> Option<(String, String)> {
    let (logged, lag_s) = of_lagged(warm).map_or((warm.to_owned(), None), |(logged, lag_s)| (logged, Some(lag_s)));
    let cold = match logged.strip_suffix("_top_c") {
        Some(stem) => format!("{stem}_bottom_c"),
        None if logged == "temp_air_c" => "temp_granite_c".to_owned(),
        None => return None,
    };
    let cold = lag_s.map_or(Some(cold.clone()), |lag_s| lagged_name(&cold, lag_s))?;
    observed.varies(&cold).then(|| (warm.to_owned(), cold))
}

/// Whether two sensors sit on one part: their names differ in the last word alone, and it is no axis (`temp_column_front_c` and
/// `temp_column_back_c`). Numbers tell nothing, so that any two may.
fn on_one_part(warm: &str, cold: &str) -> bool {
    let words = |name: &str| {
        let name = of_lagged(name).map_or_else(|| name.to_owned(), |(logged, _)| logged);
        let middle = name.strip_prefix("temp_")?.strip_suffix("_c")?;
        let (part, side) = middle.rsplit_once('_').unwrap_or(("", middle));
        let is_number = side.chars().all(|c| c.is_ascii_digit());
        let is_side = is_number || !(part.is_empty() || ["x", "y", "z"].contains(&side));
        is_side.then(|| part.to_owned())
    };
    words(warm).is_some_and(|part| words(cold) == Some(part))
}

/// Both level axes with every pair of sensors on two sides of one part, and with air above granite.
fn propose(observed: &Observed) -> Vec<Shape> {
    let mut pairs: Vec<(String, String)> =
        observed.named("temp_", "_c").filter_map(|warm| partner(observed, warm)).collect();
    for (warm, cold) in observed.differences().into_iter().filter(|(warm, cold)| on_one_part(warm, cold)) {
        let turned = (cold.clone(), warm.clone());
        if !pairs.contains(&turned) && !pairs.contains(&(warm.clone(), cold.clone())) {
            pairs.push((warm, cold));
        }
    }
    let of = |(warm, cold): &(String, String)| {
        Arch::shapes(|shape| shape.text("warm", warm.as_str()).text("cold", cold.as_str()))
    };
    pairs.iter().flat_map(of).collect()
}

impl Effect for GradientBow {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn covariates(&self) -> Vec<String> {
        vec![self.warm.clone(), self.cold.clone()]
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        self.arch.parameters(["1/(m K)", "rad/K", "m/K", "1/K"], 1.0)
    }

    fn essential(&self) -> &'static [usize] {
        self.arch.essential()
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        let difference_k = state.covariate(&self.warm)? - state.covariate(&self.cold)?;
        self.arch.motion(state, difference_k, part);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::Acts;
    use super::super::tests::{Each, machine};
    use super::*;
    use crate::axis::ErrorId;
    use crate::machine::Side;

    fn motions(axis: &str, machine: &Machine, reading_m: [f64; 3]) -> Vec<(usize, Acts, f64)> {
        let shape = Shape::new()
            .text("axis", axis)
            .text("warm", "temp_top_c")
            .text("cold", "temp_bottom_c")
            .text("form", "free");
        let effect = construct(&shape, machine).unwrap();
        let source = Each(&[("temp_top_c", 20.5), ("temp_bottom_c", 20.0)]);
        let mut found = Vec::new();
        let state = State { reading_m, offset_m: [0.0; 3], covariates: &source };
        effect.motion(&state, &mut |k, acts, amount| found.push((k, acts, amount))).unwrap();
        found
    }

    fn amount(found: &[(usize, Acts, f64)], parameter: usize, error: &str) -> f64 {
        let acts = Acts::Error(ErrorId::from_name(error).unwrap());
        found.iter().find(|(k, a, _)| *k == parameter && *a == acts).unwrap().2
    }

    /// κL²/8: 10 µm/(m·K) on 0.8 m at half a kelvin arch by 0.4 µm; the ends stay and lie κΔT·L apart in angle.
    #[test]
    fn it_arches_by_an_eighth_of_curvature_times_length_squared() {
        let kappa = 10e-6;
        let at = |x_m: f64| motions("x", &machine(), [x_m, 0.1, 0.1]);
        assert!((amount(&at(0.4), 0, "EZX") * kappa - 0.4e-6).abs() < 1e-18);
        assert_eq!((amount(&at(0.0), 0, "EZX"), amount(&at(0.8), 0, "EZX")), (0.0, 0.0));
        let turned = amount(&at(0.8), 3, "EBX") - amount(&at(0.0), 3, "EBX");
        assert!((turned * kappa - 4e-6).abs() < 1e-18, "climbing along x is a negative turn about y");
    }

    #[test]
    fn on_one_beam_the_carriage_turns_by_the_slope_of_its_guideway() {
        for (axis, height, turn, sign) in [("x", "EZX", "EBX", -1.0), ("y", "EZY", "EAY", 1.0)] {
            for (rising, turning) in [(0, 3), (1, 4)] {
                let at = |r_m: f64| motions(axis, &machine(), [r_m, r_m, 0.1]);
                let slope = amount(&at(0.501), rising, height) - amount(&at(0.499), rising, height);
                let angle = amount(&at(0.5), turning, turn);
                assert!((sign * slope / 0.002 - angle).abs() < 1e-12, "{axis} {rising}");
            }
        }
    }

    #[test]
    fn two_sensors_on_two_sides_of_one_part_are_tried_whatever_the_sides_are_called() {
        let logged = [
            "temp_air_c",
            "temp_granite_c",
            "temp_beam_upper_c",
            "temp_beam_lower_c",
            "temp_scale_x_c",
            "temp_scale_y_c",
        ];
        let varying: Vec<String> = logged.into_iter().chain(["temp_1_c", "temp_2_c"]).map(str::to_owned).collect();
        let machine = machine();
        let observed =
            Observed { machine: &machine, varying: &varying, stations: &[], offsets_m: &[], time_s: (0.0, 1.0) };
        let pairs =
            [("temp_air_c", "temp_granite_c"), ("temp_beam_lower_c", "temp_beam_upper_c"), ("temp_2_c", "temp_1_c")];
        let shapes = propose(&observed);
        assert_eq!(shapes.len(), 4 * pairs.len(), "two level axes in two forms");
        for (warm, cold) in pairs {
            let is = |shape: &&Shape| {
                format!("{:?}", shape.0["warm"]).contains(warm) && format!("{:?}", shape.0["cold"]).contains(cold)
            };
            assert_eq!(shapes.iter().filter(is).count(), 4, "{warm} {cold}");
        }
    }

    #[test]
    fn over_a_table_that_climbs_the_tool_sinks() {
        let mut table = machine();
        table.joints[0].side = Side::Workpiece;
        let [tool, table] = [machine(), table].map(|machine| motions("x", &machine, [0.3, 0.1, 0.1]));
        assert_eq!(amount(&tool, 0, "EZX"), -amount(&table, 0, "EZX"));
        assert_eq!(amount(&tool, 3, "EBX"), amount(&table, 3, "EBX"));
    }
}
