//! Each thing that can be wrong with a machine file is named with file, line, key and remedy.

use abbe_files::{MachineFile, OrderChoice, machine_text, parse_machine};
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::Side;
use abbe_geometry::rotation::RotationForm;
use abbe_geometry::{Axis, ErrorId};

const BRIDGE: &str = include_str!("../../../launch-config/machines/bridge_xyz.toml");
const TABLE: &str = include_str!("../../../launch-config/machines/moving_table.toml");
const FYXZ: &str = include_str!("../../../launch-config/machines/fyxz.toml");

fn bridge() -> MachineFile {
    parse_machine(BRIDGE, "m.toml").unwrap()
}

/// Asserts that the bridge with `from` replaced by `to` is refused in these words, on the line that changed.
#[track_caller]
fn refused(from: &str, to: &str, parts: &[&str]) {
    assert_eq!(BRIDGE.matches(from).count(), 1, "{from:?} must stand once");
    let line = 1 + BRIDGE[..BRIDGE.find(from).unwrap()].matches('\n').count();
    let error = parse_machine(&BRIDGE.replace(from, to), "m.toml").unwrap_err();
    let message = error.to_string();
    assert!(message.starts_with("m.toml"), "{message}");
    for part in parts {
        assert!(message.contains(part), "{message:?} does not say {part:?}");
    }
    if let Some(found) = error.place().unwrap().line
        && !parts.iter().any(|part| part.contains(", line"))
    {
        assert_eq!(found, line as u64, "{message}");
    }
}

#[test]
fn regress_a_misspelt_default_is_named() {
    let text = BRIDGE.replace("\ndefault = {", "\ndefalut = {");
    let message = parse_machine(&text, "m.toml").unwrap_err().to_string();
    assert!(message.contains("missing field `default`; `defalut` is neither"), "{message}");
    assert!(message.contains("correct the spelling"), "{message}");
}

#[test]
fn the_bridge_is_read_in_si_with_standard_uncertainties() {
    let file = bridge();
    assert_eq!(file.machine.stroke_m, [(0.0, 0.8), (0.0, 0.6), (0.0, 0.6)]);
    assert_eq!(file.machine.repeatability_m, [0.25e-6; 3]);
    assert_eq!(file.machine.rotation, RotationForm::Exact);
    assert!(
        (file.instrument.constant_m - 0.025e-6).abs() < 1e-20 && (file.instrument.per_metre - 0.15e-6).abs() < 1e-20
    );
    assert_eq!((file.absolute_range, file.order), (false, OrderChoice::Evidence));
    assert!(file.machine.kinds.iter().all(|kind| *kind == Some(FunctionKind::BSpline { intervals: 9 })));
    assert!(file.machine.joints.iter().all(|joint| joint.side == Side::Tool));
}

#[test]
fn a_scale_common_to_all_lengths_is_read_and_written_and_none_is_none() {
    let none = bridge();
    assert_eq!(none.instrument.common_per_metre, 0.0);
    assert!(!machine_text(&none).unwrap().contains("common"));
    let text = BRIDGE.replace("u_k2_constant_um = 0.05", "u_k2_constant_um = 0.05\nu_k2_common_um_per_m = 0.5");
    let declared = parse_machine(&text, "m.toml").unwrap();
    assert!((declared.instrument.common_per_metre - 0.25e-6).abs() < 1e-20);
    let again = parse_machine(&machine_text(&declared).unwrap(), "m.toml").unwrap();
    assert!((again.instrument.common_per_metre - 0.25e-6).abs() < 1e-20);
}

#[test]
fn chains_run_from_the_workpiece_through_the_bed_to_the_tool() {
    let joints = |text| parse_machine(text, "m").unwrap().machine.joints.map(|joint| (joint.axis, joint.side));
    use Axis::{X, Y, Z};
    assert_eq!(joints(FYXZ), [(Y, Side::Tool), (X, Side::Tool), (Z, Side::Tool)]);
    assert_eq!(joints(TABLE), [(Y, Side::Workpiece), (X, Side::Tool), (Z, Side::Tool)]);
    let both = TABLE.replace("[\"Y\"]", "[\"Y\", \"X\"]").replace("[\"X\", \"Z\"]", "[\"Z\"]");
    assert_eq!(joints(&both), [(X, Side::Workpiece), (Y, Side::Workpiece), (Z, Side::Tool)]);
    let file = parse_machine(&both, "m").unwrap();
    assert_eq!(parse_machine(&machine_text(&file).unwrap(), "m").unwrap(), file);
}

#[test]
fn overrides_by_error_name_and_errors_held_at_zero() {
    let text = BRIDGE.replace(
        "intervals = 9 }\n",
        "intervals = 9 }\nEXX = { kind = \"polynomial\", degree = 4 }\nEYZ = { kind = \"nodes\", count = 9 }\nECX = { kind = \"zero\" }\n",
    );
    let kinds = parse_machine(&text, "m.toml").unwrap().machine.kinds;
    let kind = |name| kinds[ErrorId::from_name(name).unwrap().index()];
    assert_eq!(kind("EXX"), Some(FunctionKind::Polynomial { degree: 4 }));
    assert_eq!(kind("EYZ"), Some(FunctionKind::Nodes { count: 9 }));
    assert_eq!(kind("ECX"), None);
    assert_eq!(kind("EZZ"), Some(FunctionKind::BSpline { intervals: 9 }));
}

#[test]
fn unknown_missing_and_mistyped_keys() {
    refused("frame_id =", "frame = \"a\"\nframe_id =", &["unknown field `frame`", "expected", "correct the spelling"]);
    refused("absolute = false", "absolut = false", &["unknown field `absolut`", "correct the spelling"]);
    refused("rotation = \"exact\"\n", "\n", &["missing field `rotation`", "add the key"]);
    refused("rotation = \"exact\"", "rotation = \"euler\"", &["key rotation", "euler", "small_angle"]);
    refused("tool_side = [\"X\", \"Y\", \"Z\"]", "tool_side = [\"X\", \"Y\", \"A\"]", &["key tool_side", "`A`"]);
    refused("X = [0.0, 800.0]", "X = 800.0", &["key X", "invalid type"]);
    refused("name = \"bridge_xyz\"", "name = bridge", &["m.toml, line"]);
    refused("[stroke_mm]", "[stroke_m]", &["stroke_m"]);
}

#[test]
fn the_sign_convention_is_stated_word_for_word() {
    refused(
        "error = actual - indicated",
        "error = indicated - actual",
        &["key sign_convention", "turn the signs", "actual - indicated"],
    );
}

#[test]
fn chains_strokes_and_squareness_that_make_no_machine() {
    refused(
        "tool_side = [\"X\", \"Y\", \"Z\"]",
        "tool_side = [\"X\", \"Y\"]",
        &["key chain", "each of X, Y and Z once", ", line"],
    );
    refused("tool_side = [\"X\", \"Y\", \"Z\"]", "tool_side = [\"X\", \"Y\", \"Y\"]", &["key chain", "XYY", ", line"]);
    refused("X = [0.0, 800.0]", "X = [800.0, 0.0]", &["key stroke_mm.X", "800 mm to 0 mm", "[lower, upper]"]);
    refused("X = [0.0, 800.0]", "X = [0.0, nan]", &["key stroke_mm.X", "not finite"]);
    refused("name = \"A0Z\"", "name = \"B0Z\"", &["key squareness.2.name", "twice"]);
    refused("about = \"X\"", "about = \"Y\"", &["key squareness", "turn about X, Y and Z", ", line"]);
    refused(
        "[[squareness]]\nname = \"A0Z\"\ntilts = \"Z\"\nabout = \"X\"\n",
        "",
        &["2 squareness errors", "give three", ", line"],
    );
}

#[test]
fn a_ram_that_is_known_too_well_or_not_at_all() {
    let with = |turn: &str| format!("repeatability_um = [0.25, 0.25, 0.25]\nu_k1_ram_turn_urad = {turn}");
    for turn in ["[200.0, 0.0, 200.0]", "[200.0, -1.0, 200.0]", "[inf, 200.0, 200.0]", "[nan, 1.0, 1.0]"] {
        refused(
            "repeatability_um = [0.25, 0.25, 0.25]",
            &with(turn),
            &["key u_k1_ram_turn_urad", "between 0.001 and 50000 µrad", ", line", "leave the key out"],
        );
    }
    refused("repeatability_um = [0.25, 0.25, 0.25]", &with("200.0"), &["u_k1_ram_turn_urad", ", line"]);
}

#[test]
fn error_functions_that_do_not_exist() {
    let with = |line: &str| format!("intervals = 9 }}\n{line}");
    refused("intervals = 9 }", "intervals = 0 }", &["key error_functions.default", "between 1 and 1000"]);
    for (line, parts) in [
        ("EXW = { kind = \"zero\" }", ["key error_functions.EXW", "no error has this name", "did you mean EX"]),
        ("EXX = { kind = \"polynomial\", degree = 40 }", ["key error_functions.EXX", "degree 1 to 10", ", line"]),
        ("EXX = { kind = \"spline\" }", ["unknown variant `spline`", "bspline", "key EXX"]),
        ("EXX = { kind = \"zero\", degree = 4 }", ["unknown field `degree`", "key EXX", "correct the spelling"]),
    ] {
        let at = BRIDGE[..BRIDGE.find("intervals = 9 }\n").unwrap()].matches('\n').count() as u64;
        let error = parse_machine(&BRIDGE.replace("intervals = 9 }\n", &(with(line) + "\n")), "m.toml").unwrap_err();
        parts.iter().for_each(|part| assert!(error.to_string().contains(part), "{error} does not say {part:?}"));
        assert_eq!(error.place().unwrap().line, Some(at + 2), "{error}");
    }
}

#[test]
fn figures_that_are_no_uncertainty() {
    refused(
        "u_k2_constant_um = 0.05",
        "u_k2_constant_um = -0.05",
        &["key instrument.u_k2_constant_um", "-0.05", "k = 2"],
    );
    refused(
        "u_k2_constant_um = 0.05",
        "u_k2_common_um_per_m = -0.5\nu_k2_constant_um = 0.05",
        &["key instrument.u_k2_common_um_per_m", "-0.5", "k = 2"],
    );
    refused("u_k2_constant_um = 0.05", "u_k2_constant_um = inf", &["key instrument.u_k2_constant_um", "k = 2"]);
    refused(
        "repeatability_um = [0.25, 0.25, 0.25]",
        "repeatability_um = [0.25, -1.0, 0.25]",
        &["key repeatability_um"],
    );
    refused("repeatability_um = [0.25, 0.25, 0.25]", "repeatability_um = [0.25, 0.25]", &["key repeatability_um"]);
    refused("name = \"bridge_xyz\"", "name = \"bridge xyz\"", &["key name", "blanks"]);
}

#[test]
fn regress_a_bad_number_says_that_a_number_is_wanted() {
    let says = |to: &str, written: &str, key: &str| {
        let problem = format!("`{written}` is neither a number nor a text in quotation marks");
        refused("u_k2_constant_um = 0.05", to, &[key, &problem, "write a number", "such as 0.25"]);
    };
    for bad in ["none", "n.a.", "0.05um", "0.0.5", "1e", "about 0.05"] {
        says(&format!("u_k2_constant_um = {bad}  # of its certificate"), bad, "key u_k2_constant_um");
    }
    refused("X = [0.0, 800.0]", "X = [0.0, none]", &["key X", "`none` is neither a number", "write a number"]);
}
