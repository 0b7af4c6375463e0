//! Tables for controllers, applied as each controller applies them: the error of the machine shrinks to what tables miss.

use crate::common;
use abbe_files::ModelFile;
use abbe_files::export::{About, ExportedFile, Writer, format, geometric_error_m, of_places};
use abbe_geometry::Vector3;
use abbe_geometry::axis::{Axis, ErrorId};
use abbe_geometry::effects::Shape;
use abbe_geometry::layout::Layout;
use abbe_geometry::machine::Machine;
use abbe_geometry::model::{FitQuality, MachineModel, ModelParts};
use abbe_geometry::sampled::SampledErrors;
use abbe_geometry::unseen_expansion::UnseenExpansions;

const STEP_M: f64 = 0.02;
/// Reversal of X: constant; of Y: changing along the stroke (m). Play is negative.
const PLAY_X_M: f64 = -6e-6;
const PLAYS_Y_M: [f64; 3] = [-5e-6, 1.5e-6, 0.7e-6];

/// Positioning, straightness and squareness of some ten micrometres, and reversal of X and Y.
fn model() -> ModelFile {
    let mut file = common::model(7);
    let parts = file.model.parts().clone();
    let coefficients = (0..parts.coefficients.len()).map(|k| 2e-5 * (1.7 * k as f64).sin()).collect();
    let reversal = |axis: &str, parameters: Vec<f64>| {
        let shape = Shape::new().text("axis", axis).text("over", axis).number("terms", parameters.len() as f64);
        MachineModel::fitted_effect("reversal", shape, &parts.machine, parameters).unwrap()
    };
    let effects = vec![reversal("x", vec![PLAY_X_M]), reversal("y", PLAYS_Y_M.to_vec())];
    let total = parts.coefficients.len() + 4 + 4 * parts.stations.len();
    let covariance: Vec<f64> =
        (0..total).flat_map(|a| (0..=a).map(move |b| if a == b { 1e-14 } else { 0.0 })).collect();
    let identified = {
        let mut identified = parts.identified.clone();
        identified.covariates = [("dir_x", (-1.0, 1.0)), ("dir_y", (-1.0, 1.0))].map(|(n, r)| (n.to_owned(), r)).into();
        identified
    };
    let chord_covariance = Vec::new();
    let quality = FitQuality { unseen_expansions: UnseenExpansions::default(), ..parts.quality.clone() };
    let parts = ModelParts { coefficients, effects, covariance, chord_covariance, identified, quality, ..parts };
    file.model = MachineModel::new(parts).unwrap();
    file
}

/// The same machine with other effects, each with a standard deviation of 0.1 µm.
fn with_effects(effects: &[(&str, Shape, Vec<f64>)]) -> ModelFile {
    let mut file = model();
    let parts = file.model.parts().clone();
    let fitted = |(name, shape, parameters): &(&str, Shape, Vec<f64>)| {
        MachineModel::fitted_effect(name, shape.clone(), &parts.machine, parameters.clone()).unwrap()
    };
    let effects: Vec<_> = effects.iter().map(fitted).collect();
    let own: usize = effects.iter().map(|fitted| fitted.parameters.len()).sum();
    let total = parts.coefficients.len() + own + 4 * parts.stations.len();
    let covariance = (0..total).flat_map(|a| (0..=a).map(move |b| if a == b { 1e-14 } else { 0.0 })).collect();
    file.model = MachineModel::new(ModelParts { effects, covariance, ..parts }).unwrap();
    file
}

fn exported(name: &str, file: &ModelFile) -> Vec<ExportedFile> {
    let about = About::new(file, &[0xab; 32], "abbe test");
    let (Writer::Functions(write) | Writer::Approaches(write) | Writer::Positions(write)) =
        format(name).unwrap().writer
    else {
        panic!()
    };
    write(&about, &SampledErrors::of(&file.model, STEP_M).unwrap()).unwrap()
}

/// The machine: error of an axis along itself at a reading, coming from below or above (m).
fn error_m(file: &ModelFile, axis: Axis, reading_m: f64, upwards: bool) -> f64 {
    let (lower_m, upper_m) = file.model.parts().machine.stroke_m[axis.index()];
    let x = 2.0 * (reading_m - lower_m) / (upper_m - lower_m) - 1.0;
    let play_m = match axis {
        Axis::X => PLAY_X_M,
        Axis::Y => PLAYS_Y_M[0] + PLAYS_Y_M[1] * x + PLAYS_Y_M[2] * (1.5 * x * x - 0.5),
        Axis::Z => 0.0,
    };
    file.model.error(ErrorId::linear(axis, axis), reading_m).0 + if upwards { play_m / 2.0 } else { -play_m / 2.0 }
}

/// Linear between points, held beyond them.
fn interpolated(table: &[(f64, f64)], at: f64) -> f64 {
    let Some(next) = table.iter().position(|(x, _)| *x >= at) else { return table[table.len() - 1].1 };
    if next == 0 {
        return table[0].1;
    }
    let ((x0, y0), (x1, y1)) = (table[next - 1], table[next]);
    y0 + (y1 - y0) * (at - x0) / (x1 - x0)
}

/// Largest positioning error over the stroke, of both approaches, without and with a compensation: what is added to the reading
/// (m) at a target, given the approach. Errors common to all targets are those of the reference position, and do not count.
fn errors_m(file: &ModelFile, axis: Axis, added: impl Fn(f64, bool) -> f64) -> (f64, f64) {
    let (lower_m, upper_m) = file.model.parts().machine.stroke_m[axis.index()];
    let targets = (1..97).map(|k| lower_m + (upper_m - lower_m) * f64::from(k) / 97.0);
    let at: Vec<(f64, bool)> = targets.flat_map(|target| [(target, true), (target, false)]).collect();
    let range = |values: Vec<f64>| {
        let (low, high) = values.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
        (high - low) / 2.0
    };
    let before = at.iter().map(|(target, up)| error_m(file, axis, *target, *up)).collect();
    let after = at.iter().map(|(target, up)| {
        let reading_m = target + added(*target, *up);
        reading_m + error_m(file, axis, reading_m, *up) - target
    });
    (range(before), range(after.collect()))
}

fn numbers(line: &str) -> Vec<f64> {
    line.split_whitespace().map(|cell| cell.parse().unwrap()).collect()
}

/// LinuxCNC reads triplets until the first line that is none; nominal − reached, by direction, is added to the command.
#[test]
fn linuxcnc_screw_compensation_leaves_what_interpolation_misses() {
    let file = model();
    let files = exported("linuxcnc-comp", &file);
    assert!(files[0].text.contains("reversal: contained for axes: XY"), "{}", files[0].text);
    for (axis, exported) in Axis::ALL.into_iter().zip(&files[1..]) {
        let rows: Vec<Vec<f64>> = exported.text.lines().map(numbers).collect();
        assert!(rows.iter().all(|row| row.len() == 3) && rows.len() <= 256);
        let column = |c: usize| rows.iter().map(|row| (row[0] / 1e3, (row[0] - row[c]) / 1e3)).collect::<Vec<_>>();
        let (forward, reverse) = (column(1), column(2));
        let (before_m, after_m) =
            errors_m(&file, axis, |target, up| interpolated(if up { &forward } else { &reverse }, target));
        println!("{axis:?}: {:.3} um -> {:.4} um", before_m * 1e6, after_m * 1e6);
        assert!(before_m > 2e-6 && after_m < 0.03e-6, "{before_m} {after_m}");
    }
}

/// A model of positioning runs: what its table holds is not said to be missing, what follows the time is.
#[test]
fn regress_effects_of_one_name_are_told_apart_by_what_they_follow() {
    let mut file = model();
    let parts = file.model.parts().clone();
    let shape =
        |terms: f64| Shape::new().text("axis", "x").number("terms", terms).number("low_m", 0.0).number("high_m", 0.5);
    let by_time = shape(1.0).text("by", "time_s").number("by_zero", 0.0).number("by_unit", 100.0);
    let term =
        |shape, count| MachineModel::fitted_effect("axis_term", shape, &parts.machine, vec![3e-6; count]).unwrap();
    let effects = parts.effects.iter().cloned().chain([term(shape(3.0), 3), term(by_time, 1)]).collect();
    let count = parts.coefficients.len() + 4 + 3 + 1 + 4 * parts.stations.len();
    let covariance = vec![0.0; count * (count + 1) / 2];
    file.model = MachineModel::new(ModelParts { effects, covariance, ..parts }).unwrap();
    let head = |name: &str| exported(name, &file)[0].text.clone();
    for name in ["linuxcnc-comp", "csv"] {
        let head = head(name);
        let lacking: Vec<&str> =
            head.lines().filter(|line| line.contains("NOT in this") && line.contains("axis_term")).collect();
        assert_eq!(lacking.len(), 1, "{head}");
        assert!(lacking[0].ends_with("(axis_term) by time_s; the table holds at time_s = 0"), "{lacking:?}");
    }
    assert!(head("csv").contains("every error but positioning of X"), "{}", head("csv"));
}

/// A controller that is told a polynomial where nothing was measured is sent anywhere.
#[test]
fn regress_tables_hold_their_effects_beyond_what_was_measured_and_say_so() {
    let mut file = model();
    let parts = file.model.parts().clone();
    let mut identified = parts.identified.clone();
    let nodes_m = SampledErrors::of(&file.model, STEP_M).unwrap().axes[1].positions_m.clone();
    let (first, last) = (5, nodes_m.len() - 6);
    let (lower_m, upper_m) = (nodes_m[first], nodes_m[last]);
    identified.reading_m[1] = (lower_m, upper_m);
    let shape = Shape::new().text("axis", "y").number("terms", 7.0);
    let shape = shape.number("low_m", lower_m).number("high_m", upper_m);
    let term = MachineModel::fitted_effect("axis_term", shape, &parts.machine, vec![3e-6; 7]).unwrap();
    let effects = parts.effects.iter().cloned().chain([term]).collect();
    let count = parts.coefficients.len() + 4 + 7 + 4 * parts.stations.len();
    let covariance = vec![0.0; count * (count + 1) / 2];
    file.model = MachineModel::new(ModelParts { effects, covariance, identified, ..parts }).unwrap();

    let files = exported("linuxcnc-comp", &file);
    let mm = |m: f64| format!("{:.4}", m * 1e3);
    let said = format!("NOT measured: Y below {} and above {} mm", mm(lower_m), mm(upper_m));
    assert!(files[0].text.contains(&said) && !files[0].text.contains("measured: X"), "{}", files[0].text);
    let rows: Vec<Vec<f64>> = files[2].text.lines().map(numbers).collect();
    let own_mm = |reading_mm: f64| file.model.error(ErrorId::linear(Axis::Y, Axis::Y), reading_mm / 1e3).0 * 1e3;
    let held: Vec<[f64; 2]> =
        rows.iter().map(|row| [row[1] - row[0] - own_mm(row[0]), row[2] - row[0] - own_mm(row[0])]).collect();
    for (end, border) in [(0, first), (rows.len() - 1, last)] {
        for approach in 0..2 {
            assert!((held[end][approach] - held[border][approach]).abs() < 1e-6, "{held:?}");
        }
    }
    // Seven terms of 3 um at the upper end of what was measured, where each Legendre polynomial is 1.
    assert!((f64::midpoint(held[rows.len() - 1][0], held[rows.len() - 1][1]) - 0.021).abs() < 1e-6, "{held:?}");
}

/// SINUMERIK adds the value to the actual position; coming from above it takes the backlash away that the encoder leads by.
#[test]
fn siemens_leadscrew_compensation_leaves_the_change_of_the_reversal() {
    let file = model();
    let text = exported("siemens-enc-comp", &file)[0].text.clone();
    for (number, axis) in (1..).zip(Axis::ALL) {
        let value = |name: &str| -> f64 {
            let start = format!("$AA_ENC_COMP{name},AX{number}]=");
            text.lines().find_map(|line| line.strip_prefix(&start)).unwrap().parse().unwrap()
        };
        let (first, last, step) = (value("_MIN[0"), value("_MAX[0"), value("_STEP[0"));
        let count = ((last - first) / step).round() as usize + 1;
        let table: Vec<(f64, f64)> =
            (0..count).map(|k| ((first + step * k as f64) / 1e3, value(&format!("[0,{k}")) / 1e3)).collect();
        let words = text.lines().find(|line| line.starts_with(&format!("; axis {}:", axis.letter()))).unwrap();
        let after = |mark: &str| -> f64 {
            let rest = words.split(mark).nth(1).unwrap();
            rest.split([';', ' ']).next().unwrap().parse().unwrap()
        };
        let (backlash_m, left_m) = (after("BACKLASH[0] = ") / 1e3, after("leaves ") / 1e6);
        let (before_m, after_m) = errors_m(&file, axis, |target, up| {
            // The controller stops where encoder + value (+ backlash on the way down: the part has not come as far) is the target.
            -interpolated(&table, target) - if up { 0.0 } else { backlash_m }
        });
        println!("{axis:?}: {:.3} um -> {:.4} um, said {:.4}", before_m * 1e6, after_m * 1e6, left_m * 1e6);
        assert!(before_m > 2e-6 && after_m < left_m + 0.03e-6, "{before_m} {after_m} {left_m}");
        assert!(axis == Axis::Y || left_m < 1e-12, "only the reversal of Y changes along it");
    }
}

/// Fanuc puts out the increments on the way, from the reference position on, and the backlash when it turns round.
#[test]
fn fanuc_pitch_compensation_leaves_half_a_unit_and_the_change_of_the_reversal() {
    let file = model();
    let text = exported("fanuc-pitch", &file)[0].text.clone();
    for (part, axis) in text.split("\naxis ").skip(1).zip(Axis::ALL) {
        let parameter = |number: u32| -> f64 {
            let start = format!("N{number} {} ", axis.letter());
            let line = part.lines().find_map(|line| line.strip_prefix(&start)).unwrap();
            line.split(' ').next().unwrap().parse().unwrap()
        };
        let increments: Vec<f64> =
            part.lines().filter_map(|line| line.strip_prefix("point ")).map(|line| numbers(line)[1]).collect();
        assert!(increments.iter().all(|increment| increment.abs() <= 7.0));
        assert_eq!(increments.len() as f64, parameter(3622) - parameter(3621) + 1.0);
        let lower_m = file.model.parts().machine.stroke_m[axis.index()].0;
        let mut sum = 0.0;
        let table: Vec<(f64, f64)> = increments
            .iter()
            .enumerate()
            .map(|(k, increment)| {
                sum += increment;
                (lower_m + parameter(3624) / 1e3 * k as f64, sum / 1e6)
            })
            .collect();
        let backlash_m = parameter(1851) / 1e6;
        let (before_m, after_m) =
            errors_m(&file, axis, |target, up| interpolated(&table, target) - if up { 0.0 } else { backlash_m });
        println!("{axis:?}: {:.3} um -> {:.4} um", before_m * 1e6, after_m * 1e6);
        let left_m = if axis == Axis::Y { 2.3e-6 } else { 0.0 };
        assert!(before_m > 2e-6 && after_m < 0.8e-6 + left_m, "{before_m} {after_m}");
    }
}

/// The same controller where it puts out each increment at once, at its point coming from below: never further off than the head says, and
/// rounding adds up nowhere.
#[test]
fn fanuc_pitch_compensation_in_steps_is_off_by_no_more_than_its_head_says() {
    let file = model();
    let text = exported("fanuc-pitch", &file)[0].text.clone();
    let said = text.split("is off by up to ").nth(1).unwrap();
    let said_um: f64 = said.split(' ').next().unwrap().parse().unwrap();
    assert!((1.0..=7.0).contains(&said_um), "{said_um}");
    let part = text.split("\naxis ").nth(1).unwrap();
    let lower_m = file.model.parts().machine.stroke_m[0].0;
    let interval_mm: f64 = part.split("N3624 X ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    let increments: Vec<f64> = part
        .lines()
        .map_while(|line| if line.starts_with("axis") { None } else { Some(line) })
        .filter_map(|line| line.strip_prefix("point "))
        .map(|line| numbers(line)[1])
        .collect();
    let sums: Vec<f64> = increments
        .iter()
        .scan(0.0, |sum, own| {
            *sum += own;
            Some(*sum * 1e-6)
        })
        .collect();
    let at = |target_m: f64| ((target_m - lower_m) / (interval_mm * 1e-3) + 1e-9).floor() as usize;
    let stepped = |target: f64, _: bool| sums[at(target).min(sums.len() - 1)];
    let points = (0..sums.len()).map(|k| (lower_m + interval_mm * 1e-3 * k as f64, sums[k])).collect::<Vec<_>>();
    for (position_m, sum_m) in &points {
        let wanted_m = error_m(&file, Axis::X, lower_m, true) - error_m(&file, Axis::X, *position_m, true);
        assert!((sum_m - wanted_m).abs() < 0.501e-6, "at {position_m}: {sum_m} for {wanted_m}");
    }
    let backlash_m = |up: bool| if up { 0.0 } else { PLAY_X_M };
    let (_, line_m) = errors_m(&file, Axis::X, |target, up| interpolated(&points, target) + backlash_m(up));
    let (_, step_m) = errors_m(&file, Axis::X, |target, up| stepped(target, up) + backlash_m(up));
    println!("in a line {:.3} um, in steps {:.3} um, said {said_um} um more", line_m * 1e6, step_m * 1e6);
    assert!(step_m > line_m && step_m <= line_m + said_um * 1e-6, "{line_m} {step_m}");
}

/// Heidenhain's manuals: the column of the axis is measured in the positive direction, `BACKLASH` in the negative.
#[test]
fn heidenhain_tables_hold_both_sides_of_approach_where_the_model_has_them() {
    let file = model();
    for exported in &exported("heidenhain-style", &file)[..3] {
        let letter = exported.name.chars().next().unwrap();
        let axis = Axis::ALL.into_iter().find(|axis| axis.letter() == letter).unwrap();
        let header: Vec<&str> =
            exported.text.lines().find(|line| line.starts_with("NR ")).unwrap().split(' ').collect();
        let rows: Vec<Vec<f64>> =
            exported.text.lines().filter(|line| !line.starts_with([';', 'N'])).map(numbers).collect();
        let column = |name: &str| header.iter().position(|own| *own == name);
        assert_eq!(column("BACKLASH").is_some(), axis != Axis::Z, "{header:?}: no reversal of Z is known");
        let own = column(&letter.to_string()).unwrap();
        for row in &rows {
            let at = |upwards: bool| error_m(&file, axis, row[1] / 1e3, upwards) * 1e3;
            assert!((row[own] - at(true)).abs() < 1e-8, "{row:?}");
            assert!(column("BACKLASH").is_none_or(|k| (row[k] - at(false)).abs() < 1e-8), "{row:?}");
        }
    }
    let z = &exported("heidenhain-style", &file)[2].text;
    assert!(z.contains("BACKLASH is left out, as the model has no reversal"), "{z}");
}

/// A machine with errors so large that a point holds them with a magnification alone: every point is right to half of its unit, and each
/// interval can be entered. Both a smaller and a larger step were refused.
#[test]
fn regress_fanuc_points_hold_large_errors_by_their_magnification() {
    let mut file = model();
    let parts = file.model.parts().clone();
    let coefficients = parts.coefficients.iter().map(|value| 120.0 * value).collect();
    let mut machine = parts.machine.clone();
    machine.stroke_m[0].1 = 0.8123;
    file.model = MachineModel::new(ModelParts { machine, coefficients, ..parts }).unwrap();
    let errors = SampledErrors::of(&file.model, 0.8123 / 127.0).unwrap();
    let Writer::Positions(write) = format("fanuc-pitch").unwrap().writer else { panic!() };
    let text = write(&About::new(&file, &[0xab; 32], "abbe test"), &errors).unwrap()[0].text.clone();
    let part = text.split("\naxis ").nth(1).unwrap();
    let entered = |number: u32| part.split(&format!("N{number} X ")).nth(1).unwrap().split_whitespace().next().unwrap();
    let (unit_m, interval) = (entered(3623).parse::<f64>().unwrap() * 1e-6, entered(3624));
    assert!(unit_m > 1e-6 && text.contains(&format!("of {} um miss by up to", unit_m * 1e6)), "{text}");
    assert!(interval.split_once('.').unwrap().1.len() <= 3, "{interval}");
    let points: Vec<f64> = part
        .lines()
        .map_while(|line| if line.starts_with("axis") { None } else { Some(line) })
        .filter_map(|line| line.strip_prefix("point "))
        .map(|line| numbers(line)[1])
        .collect();
    let lower_m = file.model.parts().machine.stroke_m[0].0;
    let (mut sum, mut sums) = (0.0, Vec::new());
    for (k, increment) in points.iter().enumerate() {
        assert!(increment.abs() <= 7.0);
        sum += increment;
        let at_m = lower_m + interval.parse::<f64>().unwrap() / 1e3 * k as f64;
        let wanted_m = error_m(&file, Axis::X, lower_m, true) - error_m(&file, Axis::X, at_m, true);
        sums.push(wanted_m);
        // Half a unit, and what the line between nodes misses.
        assert!(
            (sum * unit_m - wanted_m).abs() < 0.5 * unit_m + errors.axes[0].missed[0] + 1e-9,
            "{at_m}: {sum} {wanted_m}"
        );
    }
    // The smallest that holds them.
    let smaller_m = unit_m - 1e-6;
    let rounded: Vec<f64> = sums.iter().map(|sum_m| (sum_m / smaller_m).round()).collect();
    assert!(rounded.windows(2).any(|pair| (pair[1] - pair[0]).abs() > 7.0));
}

/// An axis measured in approaches in − only: tables said "in +", and a reversal of zero.
#[test]
fn regress_a_side_that_nobody_measured_is_said_and_has_no_reversal() {
    let constant = Shape::new().text("axis", "x").number("terms", 1.0).number("low_m", 0.0).number("high_m", 1.0);
    let other_side = constant.text("by", "dir_x").number("by_zero", -1.0).number("by_unit", 2.0);
    let file = with_effects(&[("axis_term", other_side, vec![0.0])]);
    for name in ["siemens-enc-comp", "linuxcnc-comp", "fanuc-pitch", "csv"] {
        let text = &exported(name, &file)[0].text;
        assert!(text.contains("NOT measured: X in approaches in +"), "{name}: {text}");
        assert!(text.contains("those of approaches in -"), "{name}: {text}");
        assert!(!text.contains("by dir_x"), "{name}: {text}");
    }
    let text = &exported("siemens-enc-comp", &file)[0].text;
    assert!(
        text.contains("axis X: MD32450 BACKLASH[0] is not known") && !text.contains("axis X: MD32450 BACKLASH[0] =")
    );
    assert!(text.contains("axis Y: MD32450 BACKLASH[0] = "), "{text}");
}

/// What residual vectors show of squareness is an effect of position: every table wrote zero for it, with an uncertainty of zero.
#[test]
fn regress_effects_of_position_are_in_grids_and_named_elsewhere_and_zeros_that_nobody_knows_are_said() {
    let shape = Shape::new()
        .text("acts", "y")
        .text("p", "x_m")
        .number("p_low", 0.0)
        .number("p_high", 0.5)
        .number("degree", 1.0)
        .number("whole", 1.0);
    let mut file = with_effects(&[("empirical", shape, vec![8e-6])]);
    let (reading_m, offset_m) = ([0.3, 0.2, 0.1], [0.0; 3]);
    let expected = |file: &ModelFile| geometric_error_m(&file.model, &of_places(&file.model), reading_m, offset_m);
    let plain = expected(&with_effects(&[]));
    // P1 of the share of the range: 2·0.3/0.5 − 1.
    assert!((expected(&file) - plain - Vector3::new(0.0, 0.2 * 8e-6, 0.0)).norm() < 1e-12);
    let about = |file: &ModelFile| About::new(file, &[0xab; 32], "abbe test");
    let left_out =
        |file: &ModelFile, name: &str| about(file).left_out(format(name).unwrap()).cloned().collect::<Vec<_>>();
    assert_eq!(left_out(&file, "volumetric-grid"), left_out(&with_effects(&[]), "volumetric-grid"));
    let named = left_out(&file, "csv");
    assert!(named.iter().any(|what| what.contains("acts y, p x_m")), "{named:?}");
    // A model in which nobody identified geometry.
    let parts = file.model.parts().clone();
    let machine = Machine { kinds: [None; ErrorId::COUNT], ..parts.machine.clone() };
    let layout = Layout::new(&machine, parts.offset_centre_m).unwrap();
    let total = layout.len() + 1;
    let covariance = vec![0.0; total * (total + 1) / 2];
    let coefficients = vec![0.0; layout.len()];
    let stations = Vec::new();
    file.model = MachineModel::new(ModelParts { machine, coefficients, covariance, stations, ..parts }).unwrap();
    let text = &exported("csv", &file)[0].text;
    assert!(
        text.contains("# NOT identified: EXX EYX EZX")
            && text.contains("EYX,0,0,,um\n")
            && text.contains("C0Y,,0,,urad\n"),
        "{text}"
    );
    // It moves Y with the reading of X, which is no positioning of Y: tables of zeros stood there.
    let refused = |name: &str| {
        let (Writer::Functions(write) | Writer::Approaches(write) | Writer::Positions(write)) =
            format(name).unwrap().writer
        else {
            panic!()
        };
        write(&about(&file), &SampledErrors::of(&file.model, STEP_M).unwrap()).unwrap_err().to_string()
    };
    for name in ["linuxcnc-comp", "siemens-enc-comp", "heidenhain-style", "fanuc-pitch"] {
        assert!(refused(name).contains("says nothing of the positioning of any axis"), "{name}");
    }
    assert!(text.contains(" EYY "), "{text}");
    // A grid holds it, and does not say that the straightness or squareness that it is were nothing.
    let told = about(&file).not_measured(format("volumetric-grid").unwrap()).join(" ");
    assert!(told.contains("only this is here") && told.contains("acts y, p x_m"), "{told}");
    // An effect acts along Y by the reading of Y; the model says nothing of the others, and of none without it.
    let own = Shape::new().text("axis", "y").number("terms", 1.0).number("low_m", 0.0).number("high_m", 1.0);
    let parts = file.model.parts().clone();
    let effects = vec![MachineModel::fitted_effect("axis_term", own, &parts.machine, vec![3e-6]).unwrap()];
    file.model = MachineModel::new(ModelParts { effects, ..parts }).unwrap();
    let Writer::Factors(write) = format("klipper-skew").unwrap().writer else { panic!() };
    let told = write(&about(&file), [0.0; 3]).unwrap_err().to_string();
    assert!(told.contains("no squareness of its axes that was identified"), "{told}");
    let names: Vec<String> = exported("linuxcnc-comp", &file).into_iter().map(|file| file.name).collect();
    assert_eq!(names, ["head.txt", "y.comp"]);
    let files = exported("heidenhain-style", &file);
    assert_eq!(files.iter().map(|file| file.name.as_str()).collect::<Vec<_>>(), ["Y.COM", "config.CMA"]);
    assert_eq!(files[1].text, "NR ACTIVE Y\n0 * Y.COM\n");
    let siemens = &exported("siemens-enc-comp", &file)[0].text;
    assert!(
        siemens.contains("axis X: the model says nothing of it") && siemens.contains("$AA_ENC_COMP_STEP[0,AX2]"),
        "{siemens}"
    );
    let (mut empty, parts) = (model(), file.model.parts().clone());
    let covariance = vec![0.0; layout.len() * (layout.len() + 1) / 2];
    empty.model = MachineModel::new(ModelParts { effects: Vec::new(), covariance, ..parts }).unwrap();
    let Writer::Positions(write) = format("linuxcnc-comp").unwrap().writer else { panic!() };
    let nothing = write(&about(&empty), &SampledErrors::of(&empty.model, STEP_M).unwrap()).unwrap_err().to_string();
    assert!(nothing.contains("says nothing of the positioning of any axis"), "{nothing}");
}

/// A step in a scale is an error of position: tables of functions and grids hold it, say between which nodes they miss it, and are as uncertain
/// between its readings as it is.
#[test]
fn a_step_in_a_scale_is_in_tables_and_grids_with_what_they_miss() {
    let (from_m, to_m, step_m) = (0.201, 0.209, 6e-6);
    let shape = Shape::new().text("axis", "x").number("from_m", from_m).number("to_m", to_m);
    let (file, plain) = (with_effects(&[("scale_step", shape, vec![step_m])]), with_effects(&[]));
    let sampled = |file: &ModelFile, every_m: f64| SampledErrors::of(&file.model, every_m).unwrap().axes[0].clone();
    let (own, without) = (sampled(&file, 1e-3), sampled(&plain, 1e-3));
    for (k, reading_m) in own.positions_m.iter().enumerate() {
        let passed = ((reading_m - from_m) / (to_m - from_m)).clamp(0.0, 1.0);
        let added_m = own.errors[k][0] - without.errors[k][0];
        assert!((added_m - step_m * passed).abs() < 1e-12, "{reading_m}: {added_m}");
        let open_m = (own.u[k][0].powi(2) - without.u[k][0].powi(2)).max(0.0).sqrt();
        // The step itself is known to 0.1 um.
        let expected_m = (passed * (1.0 - passed)).sqrt() * step_m;
        assert!((open_m - expected_m).abs() < 0.12e-6, "{reading_m}: {open_m} {expected_m}");
    }
    // Nodes every 20 mm go from 0.2 to 0.22 m: the line between them is off by some of the step, and the head says so.
    assert!(sampled(&file, STEP_M).missed[0] > 0.4 * step_m);
    let about = |name: &str| {
        let about = About::new(&file, &[0xab; 32], "abbe test");
        about.left_out(format(name).unwrap()).cloned().collect::<Vec<_>>()
    };
    for name in ["csv", "volumetric-grid", "linuxcnc-comp", "siemens-enc-comp", "fanuc-pitch"] {
        assert!(about(name).iter().all(|what| !what.contains("scale_step")), "{name}: {:?}", about(name));
    }
    let (at_m, offset_m) = ([0.3, 0.2, 0.1], [0.0; 3]);
    let of = |file: &ModelFile| geometric_error_m(&file.model, &of_places(&file.model), at_m, offset_m);
    assert!((of(&file) - of(&plain) - Vector3::new(step_m, 0.0, 0.0)).norm() < 1e-9);
}

/// The same with the ranges in which quantities were logged.
fn with_logged(effects: &[(&str, Shape, Vec<f64>)], logged: &[(&str, (f64, f64))]) -> ModelFile {
    let mut file = with_effects(effects);
    let mut parts = file.model.parts().clone();
    parts.identified.covariates = logged.iter().map(|(name, range)| ((*name).to_owned(), *range)).collect();
    parts.identified.reading_m = [(0.0, 0.5); 3];
    file.model = MachineModel::new(parts).unwrap();
    file
}

/// Models of residual vectors: an expansion is zero at 20 °C, also where the room was warmer; a smooth term where its straight part is zero,
/// or nowhere.
#[test]
fn regress_what_a_table_leaves_out_is_said_with_where_it_is_zero_and_how_large_it_is() {
    let smooth = |degree: f64| {
        let shape = Shape::new().text("acts", "x").number("degree", degree).number("whole", 1.0);
        let shape = shape.text("p", "x_m").number("p_low", 0.0).number("p_high", 0.5);
        shape.text("q", "temp_x_c").number("q_low", 18.0).number("q_high", 22.0)
    };
    let expansion = Shape::new().text("axis", "y").text("sensor", "temp_y_c");
    let logged = [("temp_x_c", (18.0, 22.0)), ("temp_y_c", (21.0, 23.0))];
    let said = |effects: &[(&str, Shape, Vec<f64>)]| {
        let file = with_logged(effects, &logged);
        let head = exported("siemens-enc-comp", &file)[0].text.clone();
        let about = About::new(&file, &[0xab; 32], "abbe");
        let told: Vec<String> = about.left_out(format("siemens-enc-comp").unwrap()).cloned().collect();
        assert!(told.iter().all(|what| head.contains(what)), "{head}");
        told[0].clone()
    };
    // 10 µm/(m K) over 0.5 m: 5 to 15 µm at the end from 21 to 23 °C.
    let told = said(&[("scale_expansion", expansion, vec![1e-5, 0.0])]);
    let wanted = "by temp_y_c; the table holds at temp_y_c = 20; over temp_y_c 21 to 23 it is 5.00 to 15.00 um along Y at Y 500.0 against 0.0 mm";
    assert!(told.ends_with(wanted), "{told}");
    // Coefficients in the order of the term: p, q, p², p q, q². Straight in x by −2 + 6 t µm to each side, t = (T − 20)/2: zero at t = 1/3.
    let straight = vec![-2e-6, 5e-6, 0.0, 6e-6, 0.0];
    let told = said(&[("empirical", smooth(2.0), straight.clone())]);
    let wanted = "the table holds at temp_x_c = 20.667, but for a shift of all points alike; over temp_x_c 18 to 22 it is -16.00 to 8.00 um \
                  along X at X 500.0 against 0.0 mm";
    assert!(told.ends_with(wanted), "{told}");
    // A bow beside it is there at any temperature: P2 goes from 1 over -1/2 to 1, its mean over five places is 1/4.
    let bowed = vec![-2e-6, 5e-6, 1e-6, 6e-6, 0.0];
    let told = said(&[("empirical", smooth(2.0), bowed)]);
    let wanted = "zero at no temp_x_c: the table holds best at temp_x_c = 20.667, within 0.75 um, and moves by 6.00 um per K at 20; over \
                  temp_x_c 18 to 22 it is -16.00 to 8.00 um";
    assert!(told.contains(wanted), "{told}");
    // What was not logged says nothing more than its name.
    let file = with_logged(&[("empirical", smooth(2.0), straight)], &[]);
    let about = About::new(&file, &[0xab; 32], "abbe");
    let told: Vec<&String> = about.left_out(format("csv").unwrap()).collect();
    assert!(told[0].ends_with("(empirical) by temp_x_c"), "{told:?}");
}
