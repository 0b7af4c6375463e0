//! Bow of a guide sideways under a temperature difference: a column warm on one side leans and bends away from it.
//!
//! Formula, with ΔT = warm − cold (K), s the reading from the lower end of the stroke, all times ΔT: the carriage moves toward the side
//! by curvature·s²/2 + lean·s and turns by curvature·s + tilt. On one bent beam (form `beam`) tilt = lean: its foot turns rigidly. In form
//! `free` they are separate, since no drawing tells at which height the carriage pivots. Inputs: reading (m), two logged temperatures (°C),
//! both behind the same time constant. Curvature is about α/width of the column: 2e-5/(m·K) at half a metre.
//!
//! Columns bend in either direction, and level guides sideways; how a level guide arches upwards is [`super::gradient_bow`].

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{Acts, CovariateProblem, Effect, Motion, ParameterSpec, State};
use crate::axis::{Axis, ErrorId};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "column_bow",
    title: "sideways thermal bow",
    formula: "times dT: toward the side curvature s^2/2 + lean s, angle curvature s + tilt; s: reading from the lower end",
    typical: "5-50 µm/m² a kelvin",
    source: "bending of a beam under a linear gradient, kappa = alpha dT / width; Mayr et al. 2012, Thermal issues in machine tools",
    needs: "two temperatures between which the column stands (its two sides, or air and floor)",
    decided_by: "repeat lines along the axis at both ends of the volume, with a part of the sight sideways, at another temperature difference",
    construct,
    propose,
    refine: None,
};

#[derive(Debug)]
struct ColumnBow {
    toward: ErrorId,
    turn: ErrorId,
    /// Angle per slope: a lean of the axis towards the side is a turn about the third axis, right-handed or not.
    turn_sign: f64,
    axis: Axis,
    foot_m: f64,
    /// The foot turns rigidly: tilt = lean.
    beam: bool,
    warm: String,
    cold: String,
}

fn construct(shape: &Shape, machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let axis = reader.axis("axis")?;
    let toward = reader.axis("toward")?;
    let Some(about) = third(axis, toward) else {
        return Err(reader.wrong("toward", "must be another axis than the one that bends"));
    };
    if axis != Axis::Z && toward == Axis::Z {
        return Err(reader.wrong("toward", "must be level: a level guide that arches upwards is gradient_bow"));
    }
    let (warm, cold) = reader.warm_and_cold()?;
    let beam = reader.is_beam()?;
    reader.finish()?;
    // about × axis = ± toward.
    let right_handed = (about.index() + 1) % 3 == axis.index();
    Ok(Box::new(ColumnBow {
        toward: ErrorId::linear(toward, axis),
        turn: ErrorId::angular(about, axis),
        turn_sign: if right_handed { 1.0 } else { -1.0 },
        axis,
        foot_m: machine.stroke_m[axis.index()].0,
        beam,
        warm,
        cold,
    }))
}

/// The axis that is neither.
fn third(axis: Axis, toward: Axis) -> Option<Axis> {
    Axis::ALL.into_iter().find(|about| *about != axis && *about != toward).filter(|_| axis != toward)
}

/// Columns in both directions and level axes sideways, with the difference of each two temperatures that are logged, both lagging alike.
fn propose(observed: &Observed) -> Vec<Shape> {
    let differences = observed.differences();
    let sides = [(Axis::Z, Axis::X), (Axis::Z, Axis::Y), (Axis::X, Axis::Y), (Axis::Y, Axis::X)];
    let shapes = |(axis, toward): (Axis, Axis), (warm, cold): &(String, String)| {
        let shape = Shape::new().text("axis", axis.lower()).text("toward", toward.lower());
        let shape = shape.text("warm", warm.as_str()).text("cold", cold.as_str());
        ["beam", "free"].map(|form| shape.clone().text("form", form))
    };
    sides.into_iter().flat_map(|side| differences.iter().flat_map(move |pair| shapes(side, pair))).collect()
}

impl Effect for ColumnBow {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn covariates(&self) -> Vec<String> {
        vec![self.warm.clone(), self.cold.clone()]
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        let mut specs = vec![
            ParameterSpec::new("curvature", "1/(m K)", 200e-6),
            ParameterSpec::new("lean", "rad/K", 100e-6),
            ParameterSpec::new("tilt", "rad/K", 100e-6),
        ];
        specs.truncate(if self.beam { 2 } else { 3 });
        specs
    }

    /// Without a curvature it is a squareness that changes, which follows whatever goes along with the time.
    fn essential(&self) -> &'static [usize] {
        &[0]
    }

    fn motion(&self, state: &State, part: &mut Motion) -> Result<(), CovariateProblem> {
        let difference_k = state.covariate(&self.warm)? - state.covariate(&self.cold)?;
        let s_m = state.reading_m[self.axis.index()] - self.foot_m;
        let (toward, turn) = (Acts::Error(self.toward), Acts::Error(self.turn));
        let turned = difference_k * self.turn_sign;
        part(0, toward, difference_k * 0.5 * s_m * s_m);
        part(0, turn, turned * s_m);
        part(1, toward, difference_k * s_m);
        part(if self.beam { 1 } else { 2 }, turn, turned);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::lagged_name;
    use super::super::tests::{Each, machine, tip_m};
    use super::*;
    use nalgebra::Vector3;

    const WARM: [(&str, f64); 2] = [("temp_air_c", 21.0), ("temp_floor_c", 20.5)];

    fn bow(axis: &str, toward: &str, form: &str) -> Box<dyn Effect> {
        let shape = Shape::new().text("axis", axis).text("toward", toward).text("form", form);
        construct(&shape.text("warm", "temp_air_c").text("cold", "temp_floor_c"), &machine()).unwrap()
    }

    /// A beam bent to the radius 1/(κΔT): κΔT·s²/2 at 10 µm/(m²·K), half a kelvin and 0.6 m is 0.9 µm.
    #[test]
    fn it_leaves_the_straight_line_with_the_square_of_the_height() {
        let state = State { reading_m: [0.1, 0.2, 0.6], offset_m: [0.0; 3], covariates: &Each(&WARM) };
        for (toward, along) in [("x", Vector3::x()), ("y", Vector3::y())] {
            let tip_m = tip_m(bow("z", toward, "beam").as_ref(), &state, &[10e-6, 0.0]);
            assert!((tip_m - along * 0.9e-6).norm() < 1e-18, "{toward}: {tip_m}");
        }
    }

    /// A rigid lean about the foot: whatever hangs below the reference point moves by its height above the foot, too.
    #[test]
    fn a_rigid_lean_moves_each_point_by_its_height() {
        for (axis, toward) in [("z", "x"), ("z", "y"), ("x", "y"), ("y", "x")] {
            let index = |name: &str| Axis::ALL.into_iter().find(|axis| axis.lower() == name).unwrap().index();
            let (mut reading_m, mut offset_m) = ([0.3; 3], [0.0; 3]);
            reading_m[index(axis)] = 0.5;
            offset_m[index(axis)] = -0.2;
            let state = State { reading_m, offset_m, covariates: &Each(&WARM) };
            for (form, parameters) in [("beam", [0.0, 20e-6].as_slice()), ("free", &[0.0, 20e-6, 20e-6])] {
                let moved_m = tip_m(bow(axis, toward, form).as_ref(), &state, parameters)[index(toward)];
                assert!((moved_m - 20e-6 * 0.5 * 0.3).abs() < 1e-12, "{axis} toward {toward}: {moved_m}");
            }
        }
    }

    #[test]
    fn what_is_no_side_is_refused() {
        let refused = |axis: &str, toward: &str, cold: &str| {
            let shape = Shape::new().text("axis", axis).text("toward", toward).text("warm", "temp_air_c");
            construct(&shape.text("cold", cold).text("form", "beam"), &machine()).unwrap_err().to_string()
        };
        assert!(refused("z", "z", "temp_floor_c").contains("another axis"));
        assert!(refused("x", "z", "temp_floor_c").contains("gradient_bow"));
        assert!(refused("z", "x", "temp_air_c").contains("another sensor"));
    }

    #[test]
    fn each_two_temperatures_are_proposed_once_and_lag_alike() {
        let logged = ["temp_a_c", "temp_b_c"];
        let behind = logged.map(|name| lagged_name(name, 600).unwrap());
        let varying: Vec<String> = logged.map(str::to_owned).into_iter().chain(behind).collect();
        let machine = machine();
        let observed =
            Observed { machine: &machine, varying: &varying, stations: &[], offsets_m: &[], time_s: (0.0, 1.0) };
        let shapes = propose(&observed);
        assert_eq!(shapes.len(), 4 * 2 * 2, "four sides, as logged and behind 600 s, in two forms");
        let text = |key: &str, shape: &Shape| format!("{:?}", shape.0[key]);
        assert!(shapes.iter().all(|s| text("warm", s).contains("temp_b") && text("cold", s).contains("temp_a")));
    }
}
