//! Evidence for the signs and the gauge of the virtual machine: cases computed by hand.
//!
//! Place in the flow: if one of these fails, nothing that is tested against the simulator means anything.

#![allow(clippy::unwrap_used)] // a preparation that fails fails its test

use std::collections::BTreeMap;

use abbe_virtual_machine::machine::{Axis, MachineTruth, RamTurn, Roughness, Squareness, Term};
use abbe_virtual_machine::{TruthRecipe, VirtualMachine};

/// Coordinates near 1 m carry rounding of 2e-16 an operation; a few dozen operations stay below this.
const ROUNDING_M: f64 = 5e-15;

const STROKE_M: [[f64; 2]; 3] = [[0.0, 0.8], [0.0, 0.6], [0.0, 0.6]];

/// A machine with one straight error function that reaches `at_end` at the upper end of its stroke.
fn machine(sides: [&[Axis]; 2], error: Option<(&str, f64)>) -> MachineTruth {
    let mut errors = BTreeMap::new();
    if let Some((name, at_end)) = error {
        let slope = Term::Chebyshev { order: 1, size: 0.5 * at_end };
        errors.insert(name.to_owned(), vec![slope]);
    }
    MachineTruth {
        name: "by hand".to_owned(),
        stroke_m: STROKE_M,
        tool_side: sides[0].to_vec(),
        workpiece_side: sides[1].to_vec(),
        errors,
        squareness: Vec::new(),
        ram_turn: RamTurn::default(),
    }
}

const BRIDGE: [&[Axis]; 2] = [&[Axis::X, Axis::Y, Axis::Z], &[]];
const FYXZ: [&[Axis]; 2] = [&[Axis::Y, Axis::X, Axis::Z], &[]];
const TABLE_Y: [&[Axis]; 2] = [&[Axis::X, Axis::Z], &[Axis::Y]];

fn actual(truth: MachineTruth, reading_m: [f64; 3], offset_m: [f64; 3]) -> [f64; 3] {
    VirtualMachine::new(truth).unwrap().actual_point_m(reading_m, offset_m)
}

fn assert_close(found: [f64; 3], wanted: [f64; 3]) {
    for d in 0..3 {
        assert!((found[d] - wanted[d]).abs() < ROUNDING_M, "{found:?} is not {wanted:?}");
    }
}

#[test]
fn a_perfect_machine_is_where_it_says_in_every_chain() {
    for sides in [BRIDGE, FYXZ, TABLE_Y] {
        let found = actual(machine(sides, None), [0.3, 0.2, 0.1], [0.05, -0.02, -0.06]);
        assert_close(found, [0.35, 0.18, 0.04]);
    }
}

#[test]
fn a_turn_of_the_ram_moves_a_reflector_by_its_arm_from_the_fixed_offset_wherever_the_axes_stand() {
    for sides in [BRIDGE, FYXZ, TABLE_Y] {
        let mut turned = machine(sides, None);
        turned.ram_turn = RamTurn { angles_rad: [0.0, 0.0, 10e-6], about_m: [0.1, 0.0, -0.06] };
        // 10 µrad about Z: an arm of 0.1 m along Y goes to -X by 1 µm, one of -0.1 m along X to -Y.
        for reading_m in [[0.3, 0.2, 0.1], [0.0, 0.5, 0.4]] {
            let at = |shift: [f64; 3]| [0, 1, 2].map(|d| reading_m[d] + shift[d]);
            // The second order of 10 µrad is 5e-12 m.
            let near = |found: [f64; 3], wanted: [f64; 3]| {
                (0..3).for_each(|d| assert!((found[d] - wanted[d]).abs() < 2e-11, "{found:?} is not {wanted:?}"));
            };
            near(actual(turned.clone(), reading_m, [0.1, 0.1, -0.06]), at([0.1 - 1e-6, 0.1, -0.06]));
            near(actual(turned.clone(), reading_m, [0.0, 0.0, -0.06]), at([0.0, -1e-6, -0.06]));
            near(actual(turned.clone(), reading_m, [0.1, 0.0, 0.3]), at([0.1, 0.0, 0.3]));
        }
    }
}

#[test]
fn a_positive_exx_means_the_machine_went_further_than_it_says() {
    let found = actual(machine(BRIDGE, Some(("EXX", 10e-6))), [0.4, 0.2, 0.1], [0.0; 3]);
    assert_close(found, [0.4 + 5e-6, 0.2, 0.1]);
}

#[test]
fn a_positive_ebx_moves_a_reflector_hanging_below_toward_minus_x() {
    let beta = 20e-6_f64;
    let found = actual(machine(BRIDGE, Some(("EBX", beta))), [0.8, 0.0, 0.0], [0.0, 0.0, -0.1]);
    assert_close(found, [0.8 - 0.1 * beta.sin(), 0.0, -0.1 * beta.cos()]);
}

#[test]
fn an_angle_of_x_also_turns_the_travel_of_the_axes_it_carries() {
    let gamma = 30e-6_f64;
    let bridge = actual(machine(BRIDGE, Some(("ECX", gamma))), [0.8, 0.5, 0.0], [0.0; 3]);
    assert_close(bridge, [0.8 - 0.5 * gamma.sin(), 0.5 * gamma.cos(), 0.0]);
    // On FYXZ the Y axis carries X, so the travel of Y is not turned.
    let fyxz = actual(machine(FYXZ, Some(("ECX", gamma))), [0.8, 0.5, 0.0], [0.0; 3]);
    assert_close(fyxz, [0.8, 0.5, 0.0]);
}

#[test]
fn a_table_turns_about_its_own_zero_and_a_carriage_about_itself() {
    let alpha = 15e-6_f64;
    let reading = [0.3, 0.6, 0.2];
    let table = actual(machine(TABLE_Y, Some(("EAY", alpha))), reading, [0.0; 3]);
    // Lever: the whole point (y = 0.6, z = 0.2) seen from the table's zero.
    assert_close(table, [0.3, 0.6 * alpha.cos() - 0.2 * alpha.sin(), 0.6 * alpha.sin() + 0.2 * alpha.cos()]);
    let carriage = actual(machine(BRIDGE, Some(("EAY", alpha))), reading, [0.0; 3]);
    // Lever: only what the carriage carries (z = 0.2).
    assert_close(carriage, [0.3, 0.6 - 0.2 * alpha.sin(), 0.2 * alpha.cos()]);
}

#[test]
fn a_table_error_is_that_of_the_tool_relative_to_the_table() {
    let found = actual(machine(TABLE_Y, Some(("EYY", 12e-6))), [0.1, 0.6, 0.1], [0.0; 3]);
    assert_close(found, [0.1, 0.6 + 12e-6, 0.1]);
}

#[test]
fn squareness_tilts_the_axis_it_names() {
    let with = |sides, name: &str, tilts, about| {
        let mut truth = machine(sides, None);
        truth.stroke_m = [[0.1, 0.8], [0.1, 0.6], [0.1, 0.6]];
        truth.squareness.push(Squareness { name: name.to_owned(), tilts, about, angle_rad: 20e-6 });
        actual(truth, [0.6, 0.5, 0.4], [0.0; 3])
    };
    // Counted from the stroke's start at 0.1: 0.4 m of Y, 0.3 m of Z, 0.5 m of X.
    assert_close(with(BRIDGE, "C0Y", Axis::Y, Axis::Z), [0.6 - 8e-6, 0.5, 0.4]);
    assert_close(with(BRIDGE, "B0Z", Axis::Z, Axis::Y), [0.6 + 6e-6, 0.5, 0.4]);
    assert_close(with(BRIDGE, "A0Z", Axis::Z, Axis::X), [0.6, 0.5 - 6e-6, 0.4]);
    assert_close(with(FYXZ, "C0Y", Axis::X, Axis::Z), [0.6, 0.5 + 10e-6, 0.4]);
    assert_close(with(TABLE_Y, "C0Y", Axis::Y, Axis::Z), [0.6 - 8e-6, 0.5, 0.4]);
}

#[test]
fn val_fyxz_paper_equation_1_to_first_order() {
    // DX = EXX+EXY+EXZ + Z(B0Z+EBX+EBY); DY = EYX+EYY+EYZ − Z(A0Z+EAX+EAY) + X(C0Y+ECY);
    // DZ = EZX+EZY+EZZ − X·EBY (its misprinted third line as corrected in the digest).
    let mut truth = TruthRecipe::default().fyxz().unwrap();
    // The paper's point is the ram's end; its frame sits there.
    truth.ram_turn.about_m = [0.0; 3];
    let machine = VirtualMachine::new(truth).unwrap();
    let reading = [0.53, 0.71, 0.37];
    let [x, y, z] = reading;
    let e = |name: &str| {
        let at = match name.as_bytes()[2] {
            b'X' => x,
            b'Y' => y,
            _ => z,
        };
        machine.error_value(name, at).unwrap()
    };
    let s = |name: &str| machine.squareness_rad(name).unwrap();
    let wanted = [
        e("EXX") + e("EXY") + e("EXZ") + z * (s("B0Z") + e("EBX") + e("EBY")),
        e("EYX") + e("EYY") + e("EYZ") - z * (s("A0Z") + e("EAX") + e("EAY")) + x * (s("C0Y") + e("ECY")),
        e("EZX") + e("EZY") + e("EZZ") - x * e("EBY"),
    ];
    let found = machine.actual_point_m(reading, [0.0; 3]);
    for d in 0..3 {
        // Second order: products of two angles of some 10 µrad over a metre, about 1 nm.
        assert!((found[d] - reading[d] - wanted[d]).abs() < 2e-9);
    }
}

#[test]
fn every_error_is_zero_at_the_lower_end_and_straightness_at_both() {
    for seed in 0..4 {
        let recipe = TruthRecipe { seed, roughness: Roughness::ROUGH, ..TruthRecipe::default() };
        for truth in [recipe.bridge_xyz(), recipe.fyxz(), recipe.moving_table()] {
            let truth = truth.unwrap();
            let stroke = truth.stroke_m;
            let machine = VirtualMachine::new(truth).unwrap();
            for (place, axis) in ['X', 'Y', 'Z'].into_iter().enumerate() {
                for direction in ['X', 'Y', 'Z', 'A', 'B', 'C'] {
                    let name = format!("E{direction}{axis}");
                    assert_eq!(machine.error_value(&name, stroke[place][0]).unwrap(), 0.0);
                    let end = machine.error_value(&name, stroke[place][1]).unwrap();
                    let straightness = "XYZ".contains(direction) && direction != axis;
                    assert_eq!(end == 0.0, straightness, "{name}: {end}");
                }
            }
        }
    }
}

#[test]
fn the_machine_is_exact_at_the_lower_end_of_all_strokes() {
    for truth in [TruthRecipe::default().bridge_xyz(), TruthRecipe::default().moving_table()] {
        // Exact for every offset on a ram that stands as the axes do.
        let truth = MachineTruth { ram_turn: RamTurn::default(), ..truth.unwrap() };
        let found = actual(truth, [0.0; 3], [0.01, 0.02, -0.06]);
        assert_eq!(found, [0.01, 0.02, -0.06]);
    }
}

#[test]
fn a_machine_that_cannot_exist_is_refused_by_its_key() {
    let key = |change: &dyn Fn(&mut MachineTruth)| {
        let mut truth = machine(BRIDGE, Some(("EXX", 1e-6)));
        change(&mut truth);
        VirtualMachine::new(truth).unwrap_err().key
    };
    assert_eq!(key(&|t| t.stroke_m[1] = [0.6, 0.6]), "machine.stroke_m.Y");
    assert_eq!(key(&|t| t.workpiece_side.push(Axis::Y)), "machine.tool_side, workpiece_side");
    assert_eq!(
        key(&|t| {
            t.errors.insert("EXW".to_owned(), Vec::new());
        }),
        "machine.errors.EXW"
    );
    assert_eq!(
        key(&|t| {
            let nan = Term::Chebyshev { order: 2, size: f64::NAN };
            t.errors.insert("EYX".to_owned(), vec![nan]);
        }),
        "machine.errors.EYX[0].size"
    );
    let tilt = |tilts, about| Squareness { name: "C0Y".to_owned(), tilts, about, angle_rad: 0.0 };
    assert_eq!(key(&|t| t.squareness.push(tilt(Axis::Z, Axis::Z))), "machine.squareness[0]");
    assert_eq!(key(&|t| t.squareness = vec![tilt(Axis::Y, Axis::Z); 2]), "machine.squareness[1]");
}
