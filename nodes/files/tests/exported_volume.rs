//! What exports say of a whole volume, on machines of every chain: the error rebuilt from tables by the pivots in their head, and factors of
//! skew applied as firmware applies them.

use crate::common;
use abbe_files::export::{About, ExportedFile, Writer, format, geometric_error_m, of_places};
use abbe_files::{ModelFile, parse_machine};
use abbe_geometry::axis::{Axis, ErrorId};
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::layout::Layout;
use abbe_geometry::model::{FitQuality, IdentifiedVolume, MachineModel, ModelParts};
use abbe_geometry::sampled::SampledErrors;
use abbe_geometry::unseen_expansion::UnseenExpansions;
use abbe_geometry::{Matrix3, Vector3};
use std::collections::BTreeMap;

const BRIDGE: &str = include_str!("../../../launch-config/machines/bridge_xyz.toml");
const TABLE: &str = include_str!("../../../launch-config/machines/moving_table.toml");
const FYXZ: &str = include_str!("../../../launch-config/machines/fyxz.toml");
const OFFSET_M: [f64; 3] = [0.02, -0.03, -0.06];
const STEP_M: f64 = 0.05;
/// Nodes of each axis over which errors are looked at.
const NODES: usize = 9;

/// Machines of every kind of chain.
fn machines() -> [String; 4] {
    let both = TABLE.replace("[\"Y\"]", "[\"Y\", \"X\"]").replace("[\"X\", \"Z\"]", "[\"Z\"]");
    [BRIDGE.to_owned(), FYXZ.to_owned(), TABLE.to_owned(), both]
}

/// A model of this machine: curved errors of some ten micrometres and microradians, and a turn of the ram, all measured.
fn model(text: &str, seed: usize) -> ModelFile {
    let mut file = common::model(7);
    let parts = file.model.parts().clone();
    let mut machine = parse_machine(text, "m.toml").unwrap().machine;
    machine.kinds = [Some(FunctionKind::Polynomial { degree: 2 }); ErrorId::COUNT];
    let layout = Layout::new(&machine, OFFSET_M).unwrap();
    let coefficients: Vec<f64> = (0..layout.len()).map(|k| 2e-5 * (1.7 * k as f64 + seed as f64).sin()).collect();
    let total = layout.len() + 4 * parts.stations.len();
    let covariance = (0..total).flat_map(|a| (0..=a).map(move |b| if a == b { 1e-14 } else { 0.0 })).collect();
    let identified = IdentifiedVolume {
        reading_m: machine.stroke_m,
        offset_m: [(-0.1, 0.1); 3],
        covariates: BTreeMap::new(),
        differences: Vec::new(),
    };
    let quality = FitQuality { unseen_expansions: UnseenExpansions::default(), ..parts.quality.clone() };
    let (effects, chord_covariance, offset_centre_m) = (Vec::new(), Vec::new(), OFFSET_M.map(|m| 0.5 * m));
    file.model = MachineModel::new(ModelParts {
        machine,
        coefficients,
        effects,
        covariance,
        chord_covariance,
        identified,
        offset_centre_m,
        quality,
        ..parts
    })
    .unwrap();
    file
}

fn about(file: &ModelFile) -> About {
    About::new(file, &[0xab; 32], "abbe test")
}

fn csv(file: &ModelFile) -> String {
    let Writer::Functions(write) = format("csv").unwrap().writer else { panic!() };
    write(&about(file), &SampledErrors::of(&file.model, STEP_M).unwrap()).unwrap()[0].text.clone()
}

/// The lever of an axis (m) as a head says it: `X turns (ox, oy + y, oz + z)`.
fn lever_m(head: &str, axis: Axis, reading_m: [f64; 3], offset_m: [f64; 3]) -> Vector3<f64> {
    let said = head.split(&format!("{} turns (", axis.letter())).nth(1).unwrap().split(')').next().unwrap();
    let parts: Vec<f64> = said
        .split(", ")
        .map(|part| {
            let value = |name: &str| match name.strip_prefix('o') {
                Some(own) => offset_m["xyz".find(own).unwrap()],
                None => reading_m["xyz".find(name).unwrap()],
            };
            part.split(" + ").map(value).sum()
        })
        .collect();
    Vector3::new(parts[0], parts[1], parts[2])
}

/// Every head named the ram reference point for all axes: who followed it was 8 to 25 µm off.
#[test]
fn regress_the_error_of_the_tip_is_rebuilt_from_a_table_by_the_pivots_in_its_head() {
    for text in machines() {
        let file = model(&text, 1);
        let (machine, table) = (&file.model.parts().machine, csv(&file));
        let mut values: BTreeMap<(String, usize), f64> = BTreeMap::new();
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        for row in table.lines().filter(|line| !line.starts_with(['#', 'e'])) {
            let cells: Vec<&str> = row.split(',').collect();
            let count = counts.entry(cells[0].to_owned()).or_default();
            values.insert((cells[0].to_owned(), *count), cells[2].parse::<f64>().unwrap() / 1e6);
            *count += 1;
        }
        let errors = SampledErrors::of(&file.model, STEP_M).unwrap();
        let effects = of_places(&file.model);
        let (mut largest_m, mut off_m) = (0.0_f64, 0.0_f64);
        for k in 0..40 {
            let nodes = [0, 1, 2].map(|d| (k * (5 + 2 * d) + 3 * d) % errors.axes[d].positions_m.len());
            let reading_m = [0, 1, 2].map(|d| errors.axes[d].positions_m[nodes[d]]);
            let mut rebuilt_m = Vector3::zeros();
            for axis in Axis::ALL {
                let value = |kind: char| values[&(format!("E{kind}{}", axis.letter()), nodes[axis.index()])];
                let angles_rad = Vector3::new(value('A'), value('B'), value('C'));
                rebuilt_m += Vector3::new(value('X'), value('Y'), value('Z'));
                rebuilt_m += angles_rad.cross(&lever_m(&table, axis, reading_m, OFFSET_M));
                for entry in machine.squareness.iter().filter(|entry| entry.tilts == axis) {
                    let way_m = reading_m[axis.index()] - machine.stroke_m[axis.index()].0;
                    let angle_rad = values[&(entry.name.clone(), 0)];
                    rebuilt_m += entry.about.direction().cross(&axis.direction()) * (angle_rad * way_m);
                }
            }
            let turn = Axis::ALL.map(|axis| values[&(format!("ram_turn_{}", axis.lower()), 0)]);
            let from_centre_m = Vector3::from(OFFSET_M) - Vector3::from(file.model.parts().offset_centre_m);
            rebuilt_m += Vector3::from(turn).cross(&from_centre_m);
            let error_m = geometric_error_m(&file.model, &effects, reading_m, OFFSET_M);
            (largest_m, off_m) = (largest_m.max(error_m.norm()), off_m.max((rebuilt_m - error_m).norm()));
        }
        println!("{}: errors up to {largest_m:.2e} m, rebuilt to {off_m:.2e} m", machine.name);
        // Products of two angles of 1e-4 with a lever of a metre.
        assert!(largest_m > 2e-5 && off_m < 3e-8, "{}: {largest_m} {off_m}", machine.name);
    }
}

/// A number in a text, after this.
fn after(text: &str, before: &str) -> f64 {
    text.split(before).nth(1).unwrap().split_whitespace().next().unwrap().parse().unwrap()
}

/// RMS over the stroke of what is left of the error after its best shift and turn, where the firmware goes there for a place (m).
fn rms_m(file: &ModelFile, moved: impl Fn(Vector3<f64>) -> Vector3<f64>) -> f64 {
    let (stroke_m, effects) = (file.model.parts().machine.stroke_m, of_places(&file.model));
    let at = |d: usize, k: usize| stroke_m[d].0 + (stroke_m[d].1 - stroke_m[d].0) * k as f64 / (NODES - 1) as f64;
    let places_m: Vec<Vector3<f64>> = (0..NODES.pow(3))
        .map(|k| Vector3::new(at(0, k % NODES), at(1, k / NODES % NODES), at(2, k / NODES / NODES)))
        .collect();
    let actual_m: Vec<Vector3<f64>> = places_m
        .iter()
        .map(|place_m| {
            let reading_m = moved(*place_m);
            reading_m + geometric_error_m(&file.model, &effects, reading_m.into(), OFFSET_M)
        })
        .collect();
    // Kabsch: the rotation of the singular vectors of the covariance of both.
    let middle = |points: &[Vector3<f64>]| points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let (from_m, to_m) = (middle(&actual_m), middle(&places_m));
    let covariance: Matrix3<f64> =
        actual_m.iter().zip(&places_m).map(|(a, p)| (a - from_m) * (p - to_m).transpose()).sum();
    let svd = covariance.svd(true, true);
    let turn = svd.v_t.unwrap().transpose() * svd.u.unwrap().transpose();
    let left_m2: f64 =
        actual_m.iter().zip(&places_m).map(|(a, p)| (turn * (a - from_m) - (p - to_m)).norm_squared()).sum();
    (left_m2 / places_m.len() as f64).sqrt()
}

/// Factors from the squareness parameters alone left out what levers shear: the yz of a moving table went from −4 to 51 µrad.
#[test]
fn regress_factors_of_skew_never_make_the_error_over_the_volume_larger() {
    let (mut written, mut refused) = (0, 0);
    for (seed, text) in (0..6).flat_map(|seed| machines().map(|text| (seed, text))) {
        let file = model(&text, seed);
        for name in ["klipper-skew", "reprap-skew"] {
            let Writer::Factors(write) = format(name).unwrap().writer else { panic!() };
            let Ok(files) = write(&about(&file), OFFSET_M) else {
                refused += 1;
                continue;
            };
            let [ExportedFile { text, .. }] = files.as_slice() else { panic!() };
            let before_m = rms_m(&file, |place_m| place_m);
            let after_m = match name {
                "klipper-skew" => {
                    let [xy, xz, yz] = ["xy_skew = ", "xz_skew = ", "yz_skew = "].map(|key| after(text, key));
                    rms_m(&file, |p| Vector3::new(p.x - p.y * xy - p.z * (xz - xy * yz), p.y - p.z * yz, p.z))
                }
                _ => {
                    let command = text.lines().find(|line| line.starts_with("M556")).unwrap();
                    let [xy, yz, xz] = [" X", " Y", " Z"].map(|letter| after(command, letter) / after(command, " S"));
                    rms_m(&file, |p| Vector3::new(p.x + xy * p.y + xz * p.z, p.y + yz * p.z, p.z))
                }
            };
            written += 1;
            assert!(after_m < before_m, "{name} {seed}: {before_m} {after_m}");
            for (said_um, own_m) in [(after(text, "everything: "), before_m), (after(text, "rms before, "), after_m)] {
                assert!((said_um * 1e-6 - own_m).abs() < 2e-9, "{name} {seed}: said {said_um} um, is {own_m} m");
            }
        }
    }
    println!("{written} written, {refused} refused");
    assert!(written > 3 * refused, "{written} {refused}");
}

/// Runs from −780 to −20 mm on a stroke from 0 to 800 mm: the table was constant, and nothing said that it is worth nothing.
#[test]
fn regress_an_axis_whose_table_is_wholly_outside_is_named() {
    let mut file = model(BRIDGE, 1);
    assert_eq!(about(&file).axes_outside(), []);
    let mut parts = file.model.parts().clone();
    parts.identified.reading_m[0] = (-0.78, -0.02);
    file.model = MachineModel::new(parts).unwrap();
    assert_eq!(about(&file).axes_outside(), [Axis::X]);
}

/// A bridge whose X pitches: its positioning is made so that a tip in the middle of the volume stands right, and its pivot does not.
fn pitching() -> ModelFile {
    let mut file = model(BRIDGE, 1);
    let mut parts = file.model.parts().clone();
    let layout = Layout::new(&parts.machine, OFFSET_M).unwrap();
    let (lower_m, upper_m) = parts.machine.stroke_m[2];
    let lever_m = 0.5 * (lower_m + upper_m) + OFFSET_M[2];
    parts.coefficients.iter_mut().for_each(|value| *value = 0.0);
    let [pitch, own] =
        [ErrorId::angular(Axis::Y, Axis::X), ErrorId::linear(Axis::X, Axis::X)].map(|id| layout.range(id));
    for (k, (angle, along)) in pitch.zip(own).enumerate() {
        parts.coefficients[angle] = 6e-5 / (k + 1) as f64;
        parts.coefficients[along] = -lever_m * parts.coefficients[angle];
    }
    file.model = MachineModel::new(parts).unwrap();
    file
}

/// Error of the tip along X over the volume, free of its mean, rms (m): as it is, and less what a table of Siemens says.
fn along_x_m(file: &ModelFile, table: &str) -> (f64, f64) {
    let value = |key: &str| after(table, &format!("$AA_ENC_COMP{key},AX1]=")) / 1e3;
    let (step_m, first_m) = (value("_STEP[0"), value("_MIN[0"));
    let nodes = table.lines().filter(|line| line.contains("COMP[0,") && line.contains(",AX1]=")).count();
    let said_m = |x_m: f64| {
        let at = (x_m - first_m) / step_m;
        let cell = (at.floor() as usize).min(nodes - 2);
        let [left_m, right_m] = [cell, cell + 1].map(|k| value(&format!("[0,{k}")));
        left_m + (right_m - left_m) * (at - cell as f64)
    };
    let stroke_m = file.model.parts().machine.stroke_m;
    let at = |d: usize, k: usize| stroke_m[d].0 + (stroke_m[d].1 - stroke_m[d].0) * k as f64 / (NODES - 1) as f64;
    let (mut before_m, mut after_m) = (Vec::new(), Vec::new());
    for k in 0..NODES.pow(3) {
        let place_m = [at(0, k % NODES), at(1, k / NODES % NODES), at(2, k / NODES / NODES)];
        let error_m = geometric_error_m(&file.model, &[], place_m, OFFSET_M).x;
        before_m.push(error_m);
        after_m.push(error_m - said_m(place_m[0]));
    }
    let rms_m = |all: &[f64]| {
        let mean_m = all.iter().sum::<f64>() / all.len() as f64;
        (all.iter().map(|m| (m - mean_m).powi(2)).sum::<f64>() / all.len() as f64).sqrt()
    };
    (rms_m(&before_m), rms_m(&after_m))
}

/// Tables of one axis held the error at the pivots without a word, and made that of the tip half as large again.
#[test]
fn regress_tables_of_one_axis_say_what_they_do_to_the_tip_and_are_made_for_one() {
    let mut file = pitching();
    let mut parts = file.model.parts().clone();
    parts.machine.default_offset_m = Some(OFFSET_M);
    file.model = MachineModel::new(parts).unwrap();
    for name in ["siemens-enc-comp", "fanuc-pitch", "linuxcnc-comp"] {
        let Writer::Positions(write) = format(name).unwrap().writer else { panic!() };
        let head = |about: &About| {
            let errors = about.at_tip(SampledErrors::of(&file.model, STEP_M).unwrap());
            write(about, &errors).unwrap()[0].text.clone()
        };
        let (pivot, tip) = (head(&about(&file)), head(&about(&file).for_tip(OFFSET_M)));
        assert!(pivot.contains("LARGER: ") && pivot.contains("--offset-mm 20.0000,-30.0000,-60.0000"), "{pivot}");
        assert!(pivot.contains("positioning errors of each axis by itself"), "{pivot}");
        assert!(
            tip.contains("tip: ") && !tip.contains("LARGER") && tip.contains("of a tip at 20.0000 -30.0000"),
            "{tip}"
        );
        if name == "siemens-enc-comp" {
            for text in [&pivot, &tip] {
                let said = text.split("with this table: X ").nth(1).unwrap();
                let (before_m, after_m) = along_x_m(&file, text);
                println!("{before_m:.3e} -> {after_m:.3e} m");
                let mut words = said.split([' ', ',', '\n']);
                let before_um: f64 = words.next().unwrap().parse().unwrap();
                let after_um: f64 = words.nth(1).unwrap().parse().unwrap();
                assert!((before_um * 1e-6 - before_m).abs() < 2e-9, "{before_um} {before_m}");
                assert!((after_um * 1e-6 - after_m).abs() < 2e-9, "{after_um} {after_m}");
            }
            let ((before_m, pivot_m), (_, tip_m)) = (along_x_m(&file, &pivot), along_x_m(&file, &tip));
            assert!(pivot_m > 1.1 * before_m && tip_m <= before_m, "{before_m} {pivot_m} {tip_m}");
        }
    }
}

/// Least squares by all nodes of a grid, one X at a time, leave no less than the table of a tip.
#[test]
fn a_table_for_a_tip_is_that_of_least_squares_on_every_chain() {
    for (seed, text) in (0..3).flat_map(|seed| machines().map(|text| (seed, text))) {
        let file = model(&text, seed);
        let about = about(&file).for_tip(OFFSET_M);
        let Writer::Positions(write) = format("siemens-enc-comp").unwrap().writer else { panic!() };
        let errors = about.at_tip(SampledErrors::of(&file.model, 0.005).unwrap());
        let (before_m, after_m) = along_x_m(&file, &write(&about, &errors).unwrap()[0].text);
        let stroke_m = file.model.parts().machine.stroke_m;
        let at = |d: usize, k: usize| stroke_m[d].0 + (stroke_m[d].1 - stroke_m[d].0) * k as f64 / (NODES - 1) as f64;
        let mut least_m2 = 0.0;
        for i in 0..NODES {
            let there = (0..NODES * NODES).map(|k| [at(0, i), at(1, k % NODES), at(2, k / NODES)]);
            let there: Vec<f64> = there.map(|p| geometric_error_m(&file.model, &[], p, OFFSET_M).x).collect();
            let mean_m = there.iter().sum::<f64>() / there.len() as f64;
            least_m2 += there.iter().map(|m| (m - mean_m).powi(2)).sum::<f64>() / (there.len() * NODES) as f64;
        }
        println!("{seed}: {before_m:.3e} -> {after_m:.3e} m, least {:.3e} m", least_m2.sqrt());
        // Steps of the table and products of two errors are left.
        assert!(after_m < least_m2.sqrt() + 3e-8 && after_m <= before_m + 3e-8, "{seed}");
    }
}
