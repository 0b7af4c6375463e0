//! Laws that hold for every registered effect: a new file is covered by being entered in the registry.

use super::*;
use crate::chain::{ErrorValues, chain_point};
use crate::error_function::FunctionKind;
use crate::logged::LOGGED;
use crate::machine::{Joint, Machine, Side, Squareness};
use crate::rotation::RotationForm;

/// Every covariate has this value.
pub(crate) struct One(pub(crate) f64);
impl CovariateSource for One {
    fn covariate(&self, _name: &str) -> CovariateValue {
        CovariateValue::Fresh(self.0)
    }
}

/// The covariates listed have these values, all others are missing.
pub(super) struct Each<'a>(pub(super) &'a [(&'a str, f64)]);
impl CovariateSource for Each<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        let listed = self.0.iter().find(|(known, _)| *known == name);
        listed.map_or(CovariateValue::Missing, |(_, value)| CovariateValue::Fresh(*value))
    }
}

/// Nothing is logged.
pub(super) const NONE: &[(&str, f64)] = &[];

/// Every covariate has a value of its own, made from its name: differences of two do not vanish.
struct Distinct;
impl CovariateSource for Distinct {
    fn covariate(&self, name: &str) -> CovariateValue {
        CovariateValue::Fresh(name.bytes().zip(1_u32..).map(|(b, k)| 1e-3 * f64::from(u32::from(b) * k)).sum())
    }
}

/// A bridge machine, stroke 0.8 x 0.6 x 0.6 m.
pub(crate) fn machine() -> Machine {
    let tilt = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
    Machine {
        name: "bridge".to_owned(),
        frame_id: "machine".to_owned(),
        joints: Axis::ALL.map(|axis| Joint { axis, side: Side::Tool }),
        stroke_m: [(0.0, 0.8), (0.0, 0.6), (0.0, 0.6)],
        squareness: [tilt("C0Y", Axis::Y, Axis::Z), tilt("B0Z", Axis::Z, Axis::Y), tilt("A0Z", Axis::Z, Axis::X)],
        rotation: RotationForm::Exact,
        kinds: [Some(FunctionKind::Polynomial { degree: 3 }); 18],
        repeatability_m: [0.25e-6; 3],
        u_ram_turn_rad: [crate::machine::USUAL_RAM_TURN_RAD; 3],
        default_offset_m: None,
    }
}

/// Change of the range per unit of each of `count` parameters (m per unit).
fn range_columns(
    effect: &dyn Effect,
    count: usize,
    state: &State,
    sight: &Sight,
    by_error: &[Vector3<f64>; ErrorId::COUNT],
) -> Result<Vec<f64>, CovariateProblem> {
    let mut columns = vec![0.0; count];
    add_range_columns(effect, state, sight, by_error, &mut columns)?;
    Ok(columns)
}

/// Motion of the tip of [`machine`] with these parameters (m, machine frame).
pub(super) fn tip_m(effect: &dyn Effect, state: &State, parameters: &[f64]) -> Vector3<f64> {
    let chain = chain_point(&machine(), state.reading_m, state.offset_m, &ErrorValues::ZERO);
    let columns = tip_columns(effect, parameters.len(), state, &chain.by_error).unwrap();
    columns.iter().zip(parameters).map(|(column, value)| column * *value).sum()
}

/// What these parameters add to the range that a tracer reads off [`machine`] (m).
pub(super) fn range_m(effect: &dyn Effect, state: &State, sight: &Sight, parameters: &[f64]) -> f64 {
    let chain = chain_point(&machine(), state.reading_m, state.offset_m, &ErrorValues::ZERO);
    let columns = range_columns(effect, parameters.len(), state, sight, &chain.by_error).unwrap();
    columns.iter().zip(parameters).map(|(column, value)| column * value).sum()
}

/// Everything logged, and shapes for those effects that a search proposes.
pub(crate) fn shapes(entry: &Known, machine: &Machine) -> Vec<Shape> {
    let varying = LOGGED.map(str::to_owned);
    let stations = ["S1", "S2"].map(str::to_owned);
    let offsets_m = [[0.0, 0.0, -0.06], [0.1, 0.0, -0.06]];
    let observed =
        Observed { machine, varying: &varying, stations: &stations, offsets_m: &offsets_m, time_s: (0.0, 7200.0) };
    let mut shapes = (entry.propose)(&observed);
    if shapes.is_empty() {
        let axis = Shape::new().text("axis", "x").number("period_m", 0.02);
        let smooth = Shape::new().text("acts", "z").number("degree", 3.0);
        let smooth = smooth.text("p", "temp_air_c").number("p_low", 19.0).number("p_high", 21.0);
        let run = Shape::new().text("line", "S1-00");
        let table = Shape::new().text("axis", "x").numbers("places_m", &[0.1, 0.25, 0.5]);
        let table = table.text("sign", "dir_x").text("by", "time_s").number("by_zero", 0.0).number("by_unit", 60.0);
        let side = Shape::new().text("axis", "x").text("side", "dir_x_over_12000um");
        let jump = Shape::new().text("station", "S1").number("after_s", 0.0);
        let step = Shape::new().text("axis", "x").number("from_m", 0.29).number("to_m", 0.31);
        shapes = vec![axis, smooth, run, table, side, jump, step];
        shapes.retain(|shape| (entry.construct)(shape, machine).is_ok());
    }
    assert!(!shapes.is_empty(), "{}: no shape to test", entry.name);
    shapes
}

#[test]
fn laws_of_every_effect() {
    let machine = machine();
    for entry in REGISTRY {
        for shape in shapes(entry, &machine) {
            laws_of(entry, &shape, &machine);
        }
        let wrong = Shape::new().text("no such key", "x");
        assert!((entry.construct)(&wrong, &machine).is_err(), "{}: unknown keys are refused", entry.name);
    }
}

fn laws_of(entry: &Known, shape: &Shape, machine: &Machine) {
    let name = entry.name;
    let effect = construct(name, shape, machine).unwrap();
    assert_eq!(effect.name(), name);
    let state = State { reading_m: [0.3, 0.2, 0.1], offset_m: [0.1, 0.0, -0.06], covariates: &Distinct };
    let chain = chain_point(machine, state.reading_m, state.offset_m, &ErrorValues::ZERO);
    let ray = Ray { direction: Vector3::new(0.6, 0.48, 0.64), range_m: 0.5 };
    let sight = Sight { station: "S1", line: "S1-00", ray };
    let count = effect.parameters().len();
    let columns = range_columns(effect.as_ref(), count, &state, &sight, &chain.by_error).unwrap();
    assert_eq!(columns.len(), count, "{name}: one column a parameter");
    assert!(columns.iter().any(|c| *c != 0.0), "{name}: does something");
    assert!(columns.iter().all(|c| c.is_finite()), "{name}");
    let specs = effect.parameters();
    assert!(specs.iter().all(|p| p.plausible > 0.0 && !p.unit.is_empty()), "{name}");
    assert!((1..count).all(|k| specs[..k].iter().all(|other| other.name != specs[k].name)), "{name}: names differ");
    let tip = tip_columns(effect.as_ref(), count, &state, &chain.by_error).unwrap();
    let both = tip_and_range_columns(effect.as_ref(), count, &state, &sight, &chain.by_error).unwrap();
    assert_eq!(both, (tip, columns), "{name}: to the bit, together or one by one");
    let blind = State { covariates: &NoCovariates, ..state };
    assert_eq!(
        tip_columns(effect.as_ref(), count, &blind, &chain.by_error).is_err(),
        !effect.covariates().is_empty(),
        "{name}: needs its covariates"
    );
    let all_needed = effect.covariates().is_empty() && effect.range_covariates().is_empty();
    assert_eq!(range_columns(effect.as_ref(), count, &blind, &sight, &chain.by_error).is_err(), !all_needed, "{name}");
}

#[test]
fn unknown_effects_and_shapes_are_refused_by_name() {
    let machine = machine();
    let unknown = construct("scale_expansoin", &Shape::new(), &machine).unwrap_err().to_string();
    assert!(unknown.contains("scale_expansion"));
    let shape = Shape::new().text("axis", "x").text("over", "x").number("terms", 1.0).number("period_m", 0.02);
    assert!(construct("reversal", &shape, &machine).unwrap_err().to_string().contains("period_m"));
    let shape = Shape::new().text("axis", "w").text("over", "x").number("terms", 1.0);
    assert!(construct("reversal", &shape, &machine).unwrap_err().to_string().contains("must be x, y or z"));
}
