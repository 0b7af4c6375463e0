//! Evidence for the kinematic chain: hand-computed signs, the papers' formulas, and derivatives away from zero.

use abbe_geometry::chain::{ChainPoint, ErrorValues, chain_point, nominal_point_m};
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::{Joint, Machine, Side, Squareness};
use abbe_geometry::rotation::RotationForm;
use abbe_geometry::{Axis, ErrorId, Vector3};

fn machine(order: [(Axis, Side); 3], rotation: RotationForm) -> Machine {
    let entry = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
    Machine {
        name: "test".to_owned(),
        frame_id: "machine".to_owned(),
        joints: order.map(|(axis, side)| Joint { axis, side }),
        stroke_m: [(0.0, 0.8), (0.0, 0.6), (0.0, 0.6)],
        squareness: [entry("C0Y", Axis::Y, Axis::Z), entry("B0Z", Axis::Z, Axis::Y), entry("A0Z", Axis::Z, Axis::X)],
        rotation,
        kinds: [Some(FunctionKind::BSpline { intervals: 4 }); 18],
        repeatability_m: [0.0; 3],
        u_ram_turn_rad: [abbe_geometry::machine::USUAL_RAM_TURN_RAD; 3],
        default_offset_m: None,
    }
}

fn bridge(rotation: RotationForm) -> Machine {
    machine([(Axis::X, Side::Tool), (Axis::Y, Side::Tool), (Axis::Z, Side::Tool)], rotation)
}

fn chains() -> Vec<Machine> {
    let table = [(Axis::Y, Side::Workpiece), (Axis::X, Side::Tool), (Axis::Z, Side::Tool)];
    let two_tables = [(Axis::X, Side::Workpiece), (Axis::Y, Side::Workpiece), (Axis::Z, Side::Tool)];
    let fyxz = [(Axis::Y, Side::Tool), (Axis::X, Side::Tool), (Axis::Z, Side::Tool)];
    let forms = [RotationForm::Exact, RotationForm::SmallAngle];
    forms
        .into_iter()
        .flat_map(|form| [machine(table, form), machine(two_tables, form), machine(fyxz, form), bridge(form)])
        .collect()
}

const READING_M: [f64; 3] = [0.31, 0.47, 0.22];
const OFFSET_M: [f64; 3] = [0.12, 0.03, -0.06];

fn with(name: &str, value: f64) -> ErrorValues {
    let mut values = ErrorValues::ZERO;
    values.errors[ErrorId::from_name(name).unwrap().index()] = value;
    values
}

fn error_m(machine: &Machine, values: &ErrorValues) -> Vector3<f64> {
    chain_point(machine, READING_M, OFFSET_M, values).position_m - nominal_point_m(READING_M, OFFSET_M)
}

#[test]
fn a_perfect_machine_is_where_it_says() {
    for machine in chains() {
        assert!(error_m(&machine, &ErrorValues::ZERO).norm() < 1e-16);
    }
}

#[test]
fn signs_of_a_bridge_follow_liang_2025() {
    let machine = bridge(RotationForm::SmallAngle);
    let e = 1e-5;
    let near = |values: &ErrorValues, expected: [f64; 3]| {
        let difference = error_m(&machine, values) - Vector3::from(expected) * e;
        assert!(difference.norm() < 1e-15, "{difference}");
    };
    // Arm of the bridge: (offset x, y + offset y, z + offset z); of the ram: the offset alone.
    near(&with("EXX", e), [1.0, 0.0, 0.0]);
    near(&with("EAX", e), [0.0, -0.16, 0.50]);
    near(&with("EBX", e), [0.16, 0.0, -0.12]);
    near(&with("ECX", e), [-0.50, 0.12, 0.0]);
    near(&with("ECY", e), [-0.03, 0.12, 0.0]);
    near(&with("EBZ", e), [-0.06, 0.0, -0.12]);
    let mut square = ErrorValues::ZERO;
    square.squareness = [e, 0.0, 0.0];
    near(&square, [-0.47, 0.0, 0.0]);
    square.squareness = [0.0, e, 0.0];
    near(&square, [0.22, 0.0, 0.0]);
    square.squareness = [0.0, 0.0, e];
    near(&square, [0.0, -0.22, 0.0]);
}

#[test]
fn a_moving_table_turns_the_tool_about_the_tables_zero() {
    let table = [(Axis::Y, Side::Workpiece), (Axis::X, Side::Tool), (Axis::Z, Side::Tool)];
    let machine = machine(table, RotationForm::SmallAngle);
    let error = error_m(&machine, &with("ECY", 1e-5));
    let arm = nominal_point_m(READING_M, OFFSET_M);
    assert!((error - Vector3::z().cross(&arm) * 1e-5).norm() < 1e-15);
}

#[test]
fn fyxz_has_the_errors_of_its_paper() {
    let fyxz = [(Axis::Y, Side::Tool), (Axis::X, Side::Tool), (Axis::Z, Side::Tool)];
    let machine = machine(fyxz, RotationForm::SmallAngle);
    let e = 1e-5;
    let at = |name: &str| {
        let values = with(name, e);
        (chain_point(&machine, READING_M, [0.0; 3], &values).position_m - Vector3::from(READING_M)) / e
    };
    let [x, _, z] = READING_M;
    // Equation 1 of the paper: DX += Z·(EBX + EBY), DY += −Z·(EAX + EAY) + X·ECY, DZ += −X·EBY.
    assert!((at("EBX") - Vector3::new(z, 0.0, 0.0)).norm() < 1e-9);
    assert!((at("EBY") - Vector3::new(z, 0.0, -x)).norm() < 1e-9);
    assert!((at("EAX") - Vector3::new(0.0, -z, 0.0)).norm() < 1e-9);
    assert!((at("EAY") - Vector3::new(0.0, -z, 0.0)).norm() < 1e-9);
    assert!((at("ECY") - Vector3::new(0.0, x, 0.0)).norm() < 1e-9);
    for unseen in ["ECX", "EAZ", "EBZ", "ECZ"] {
        assert!(at(unseen).norm() < 1e-9, "{unseen} has no arm at the ram end");
    }
}

/// Large errors on purpose: a Jacobian that is right only near zero fails here.
fn large_values() -> ErrorValues {
    let mut values = ErrorValues::ZERO;
    for (k, error) in values.errors.iter_mut().enumerate() {
        *error = 0.2 * (1.3 * k as f64 + 0.4).sin();
    }
    values.squareness = [0.11, -0.07, 0.05];
    values
}

#[test]
fn partials_agree_with_differences_away_from_zero() {
    let step = 1e-6;
    for machine in chains() {
        let evaluate = |values: &ErrorValues| chain_point(&machine, READING_M, OFFSET_M, values);
        let at: ChainPoint = evaluate(&large_values());
        for k in 0..21 {
            let moved = |sign: f64| {
                let mut values = large_values();
                if k < 18 {
                    values.errors[k] += sign * step;
                } else {
                    values.squareness[k - 18] += sign * step;
                }
                evaluate(&values).position_m
            };
            let difference = (moved(1.0) - moved(-1.0)) / (2.0 * step);
            let analytic = if k < 18 { at.by_error[k] } else { at.by_squareness[k - 18] };
            assert!((analytic - difference).norm() < 1e-8, "{:?} parameter {k}", machine.joints);
        }
    }
}

#[test]
fn exact_and_small_angle_forms_differ_by_the_second_order_only() {
    let scaled = |scale: f64| {
        let mut values = large_values();
        values.errors.iter_mut().for_each(|e| *e *= scale);
        values.squareness.iter_mut().for_each(|s| *s *= scale);
        (error_m(&bridge(RotationForm::Exact), &values) - error_m(&bridge(RotationForm::SmallAngle), &values)).norm()
    };
    let (coarse, fine) = (scaled(1e-2), scaled(1e-3));
    assert!((coarse / fine - 100.0).abs() < 5.0, "second order: {}", coarse / fine);
    // At 20 µrad, typical of a CMM, the forms agree to a nanometre.
    assert!(scaled(1e-4) < 1e-9, "{}", scaled(1e-4));
}
