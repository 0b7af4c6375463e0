//! Exports read back: every format holds the numbers of the model, with sign, unit and order as its head says.

use crate::common;
use abbe_field::{Grid, Table};
use abbe_files::ModelFile;
use abbe_files::export::{About, ExportedFile, FORMATS, SampledGrid, Writer, format, geometric_error_m, of_places};
use abbe_geometry::axis::{Axis, ErrorId};
use abbe_geometry::sampled::SampledErrors;
use std::collections::BTreeMap;

const STEP_M: f64 = 0.05;
const OFFSET_M: [f64; 3] = [0.02, -0.03, -0.06];
/// Half of the twelfth decimal in mm (1e-12 mm) or rad, and rounding.
const TWELVE_DECIMALS_M: f64 = 0.6e-15;
const TWELVE_DECIMALS_RAD: f64 = 0.6e-12;
/// Half of the ninth decimal in mm, or in degrees.
const NINE_DECIMALS_M: f64 = 0.6e-12;
const NINE_DECIMALS_RAD: f64 = 1e-11;
/// A last bit of the largest value, which may have no shorter number that reads back exactly.
const LAST_BIT: f64 = 4e-16;

fn model() -> ModelFile {
    common::model(7)
}

fn about(file: &ModelFile) -> About {
    About::new(file, &[0xab; 32], "abbe test")
}

fn grid(file: &ModelFile) -> SampledGrid {
    let ends = file.model.parts().machine.stroke_m;
    let error = |p: &abbe_geometry::Vector3<f64>| {
        Ok::<_, std::convert::Infallible>(geometric_error_m(
            &file.model,
            &of_places(&file.model),
            (*p).into(),
            OFFSET_M,
        ))
    };
    let table = Table::of(Grid::regular(ends, [3, 2, 4]).unwrap(), error).unwrap();
    SampledGrid { table, missed_m: 0.25e-6, offset_m: OFFSET_M }
}

fn written(name: &str, file: &ModelFile) -> Vec<ExportedFile> {
    match format(name).unwrap().writer {
        Writer::Functions(write) | Writer::Approaches(write) | Writer::Positions(write) => {
            write(&about(file), &SampledErrors::of(&file.model, STEP_M).unwrap()).unwrap()
        }
        Writer::Grid(write) => write(&about(file), &grid(file)).unwrap(),
        Writer::Factors(write) => write(&about(file), OFFSET_M).unwrap(),
    }
}

/// Values by error name and position (mm as text), SI.
type Curves = BTreeMap<String, Vec<(f64, f64)>>;

fn number(text: &str) -> f64 {
    text.parse().unwrap_or_else(|_| panic!("{text:?} is no number"))
}

/// Every value that was read is the model's at that place, and every error has all its nodes.
fn assert_holds_the_model(curves: &Curves, file: &ModelFile, linear_m: f64, angular_rad: f64) {
    for id in ErrorId::all() {
        let (lower_m, upper_m) = file.model.parts().machine.stroke_m[id.axis().index()];
        let nodes = ((upper_m - lower_m) / STEP_M - 1e-9).ceil() as usize + 1;
        let curve = &curves[&id.name()];
        assert_eq!(curve.len(), nodes, "{}", id.name());
        assert!((curve[0].0 / 1e3 - lower_m).abs() < 1e-12 && (curve[nodes - 1].0 / 1e3 - upper_m).abs() < 1e-12);
        for (position_mm, value) in curve {
            let expected = file.model.error(id, position_mm / 1e3).0;
            let tolerance =
                if id.is_straightness() || id.name().as_bytes()[1] >= b'X' { linear_m } else { angular_rad };
            assert!((value - expected).abs() <= tolerance, "{} {position_mm}: {value} {expected}", id.name());
        }
    }
    assert!(curves.values().flatten().any(|(_, value)| value.abs() > 1e-9), "the model has errors");
}

#[test]
fn every_format_says_in_its_head_what_its_numbers_mean_and_what_they_lack() {
    let file = model();
    for format in FORMATS {
        let files = written(format.name, &file);
        let head = &files[0].text;
        let machine = &file.model.parts().machine.name;
        for wanted in [
            "error = actual - indicated",
            machine,
            &"ab".repeat(32),
            "units:",
            match format.writer {
                Writer::Factors(_) => "um rms after these factors",
                _ => "misses the model by at most",
            },
            "bed outwards",
            "X turns (ox, oy + y, oz + z)",
        ] {
            assert!(head.contains(wanted), "{}: {wanted}", format.name);
        }
        // Formats of approaches hold a reversal that its own axis alone decides.
        let lacking = match format.writer {
            Writer::Approaches(_) | Writer::Positions(_) => &["scale_expansion", "residual.bin"][..],
            _ => &["reversal", "scale_expansion", "residual.bin"][..],
        };
        for effect in lacking {
            let says = |line: &str| line.contains(effect) && line.contains("NOT in this table");
            assert!(head.lines().any(says), "{}: {effect}", format.name);
        }
    }
}

#[test]
fn names_of_formats_are_one_each() {
    let mut names: Vec<&str> = FORMATS.iter().map(|format| format.name).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), FORMATS.len());
    assert!(format("nothing").is_none());
}

#[test]
fn plain_csv_reads_back() {
    let file = model();
    let text = &written("csv", &file)[0].text;
    let (mut curves, mut squareness) = (Curves::new(), BTreeMap::new());
    let mut rows = text.lines().filter(|line| !line.starts_with('#'));
    assert_eq!(rows.next(), Some("error,position_mm,value,u,unit"));
    for row in rows {
        let cells: Vec<&str> = row.split(',').collect();
        let [name, position, value, u, unit] = cells[..] else { panic!("{row}") };
        assert!(unit == "um" || unit == "urad");
        if position.is_empty() {
            squareness.insert(name.to_owned(), (number(value) / 1e6, number(u) / 1e6));
        } else {
            curves.entry(name.to_owned()).or_default().push((number(position), number(value) / 1e6));
            let id = ErrorId::from_name(name).unwrap();
            let expected = file.model.error(id, number(position) / 1e3).1;
            // What nobody identified has no uncertainty.
            assert_eq!(u.is_empty(), file.model.parts().machine.kinds[id.index()].is_none(), "{row}");
            let u = if u.is_empty() { "0" } else { u };
            assert!((number(u) / 1e6 - expected).abs() <= LAST_BIT * expected.max(1e-9), "{row}");
        }
    }
    assert_holds_the_model(&curves, &file, LAST_BIT, LAST_BIT);
    for (k, entry) in file.model.parts().machine.squareness.iter().enumerate() {
        let (value, u) = file.model.squareness(k);
        assert!(
            (squareness[&entry.name].0 - value).abs() < LAST_BIT && (squareness[&entry.name].1 - u).abs() < LAST_BIT
        );
    }
    for (axis, (value, u)) in Axis::ALL.into_iter().zip(file.model.ram_turn()) {
        let found = squareness[&format!("ram_turn_{}", axis.lower())];
        assert!((found.0 - value).abs() < LAST_BIT && (found.1 - u).abs() < LAST_BIT, "{found:?} {value} {u}");
    }
}

#[test]
fn every_export_says_how_the_ram_stands_and_whether_it_holds_it() {
    let file = model();
    let turn = file.model.ram_turn().map(|(angle_rad, _)| format!("{:.3}", angle_rad * 1e6)).join(" ");
    for format in FORMATS {
        let grid = matches!(format.writer, Writer::Grid(_));
        let headless = |exported: &&ExportedFile| exported.name.ends_with(".CMA") || exported.name.ends_with(".comp");
        for exported in written(format.name, &file).iter().filter(|exported| !headless(exported)) {
            let line = exported.text.lines().find(|line| line.contains("ram: ")).unwrap();
            assert!(line.contains(&format!("turned by {turn} urad")), "{line}");
            assert_eq!(line.contains("contained"), grid, "{line}");
            let of_functions = !grid && !matches!(format.writer, Writer::Factors(_));
            assert_eq!(line.contains("NOT in the error functions"), of_functions, "{line}");
        }
    }
}

#[test]
fn etalon_exchange_reads_back() {
    let file = model();
    let text = written("etalon-exchange", &file)[0].text.clone();
    let (mut curves, mut squareness, mut block, mut inside) = (Curves::new(), BTreeMap::new(), String::new(), false);
    for line in text.lines().map(|line| line.split("//").next().unwrap().trim()).filter(|line| !line.is_empty()) {
        if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
            block = name.to_owned();
        } else if line == "Gridpoints = {" {
            inside = true;
        } else if line == "}" {
            inside = false;
        } else if let Some(value) = line.strip_prefix("VALUE = ") {
            squareness.insert(block.clone(), number(value));
        } else {
            assert!(inside, "{line}");
            let (position, value) = line.split_once(' ').unwrap();
            let linear = block.as_bytes()[1] >= b'X';
            let value = number(value) / if linear { 1e3 } else { 1.0 };
            curves.entry(block.clone()).or_default().push((number(position), value));
        }
    }
    assert!(!inside);
    assert_holds_the_model(&curves, &file, TWELVE_DECIMALS_M, TWELVE_DECIMALS_RAD);
    for (k, entry) in file.model.parts().machine.squareness.iter().enumerate() {
        assert!((squareness[&entry.name] - file.model.squareness(k).0).abs() < TWELVE_DECIMALS_RAD);
    }
}

#[test]
fn isg_csv_reads_back() {
    let file = model();
    let text = written("isg-csv", &file)[0].text.clone();
    let clean: String = text.lines().filter(|line| !line.starts_with("//")).map(|line| format!("{line}\n")).collect();
    let parts: Vec<Vec<Vec<&str>>> =
        clean.split("#\n").map(|part| part.lines().map(|line| line.split_whitespace().collect()).collect()).collect();
    assert_eq!(parts.len(), 4, "squareness and three axes");
    for (k, entry) in file.model.parts().machine.squareness.iter().enumerate() {
        let column = parts[0][0].iter().position(|name| *name == entry.name).unwrap();
        assert!((number(parts[0][1][column]) - file.model.squareness(k).0).abs() < TWELVE_DECIMALS_RAD);
    }
    let mut curves = Curves::new();
    for (part, axis) in parts[1..].iter().zip(["X", "Y", "Z"]) {
        assert_eq!(part[0][0], axis);
        for row in &part[1..] {
            for (name, cell) in part[0][1..].iter().zip(&row[1..]) {
                let linear = name.as_bytes()[1] >= b'X';
                let value = number(cell) / if linear { 1e3 } else { 1.0 };
                curves.entry((*name).to_owned()).or_default().push((number(row[0]), value));
            }
        }
    }
    assert_holds_the_model(&curves, &file, TWELVE_DECIMALS_M, TWELVE_DECIMALS_RAD);
}

/// The straightness columns hold squareness too: taken off again, angle · (about × axis) · distance.
#[test]
fn heidenhain_style_tables_read_back() {
    let file = model();
    let files = written("heidenhain-style", &file);
    let names: Vec<&str> = files.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(names, ["X.COM", "Y.COM", "Z.COM", "config.CMA"]);
    assert_eq!(files[3].text, "NR ACTIVE X Y Z\n0 * X.COM Y.COM Z.COM\n");
    let mut curves = Curves::new();
    for (exported, axis) in files[..3].iter().zip(Axis::ALL) {
        let rows: Vec<Vec<&str>> =
            exported.text.lines().filter(|l| !l.starts_with(';')).map(|l| l.split_whitespace().collect()).collect();
        let letter = axis.letter().to_string();
        assert_eq!(rows[0], ["NR", "AXISPOS", &letter, "C2", "C3", "C4", "C5", "C6"]);
        let units = exported.text.lines().find(|line| line.contains("C2 = ")).unwrap();
        let name =
            |column: &str| units.split(&format!("{column} = ")).nth(1).unwrap().chars().take(3).collect::<String>();
        let steps: Vec<f64> = rows[1..].windows(2).map(|pair| number(pair[1][1]) - number(pair[0][1])).collect();
        assert!(steps.iter().all(|step| (step - steps[0]).abs() < 1e-9), "points lie at equal steps");
        for (number_of_row, row) in rows[1..].iter().enumerate() {
            assert_eq!(row[0], number_of_row.to_string());
            for (column, cell) in rows[0][2..].iter().zip(&row[2..]) {
                let id = ErrorId::from_name(&name(column)).unwrap();
                let linear = id.name().as_bytes()[1] >= b'X';
                let mut value = if linear { number(cell) / 1e3 } else { number(cell).to_radians() };
                for (k, entry) in
                    file.model.parts().machine.squareness.iter().enumerate().filter(|(_, e)| e.tilts == axis)
                {
                    let distance_m = number(row[1]) / 1e3 - file.model.parts().machine.stroke_m[axis.index()].0;
                    let moved =
                        entry.about.direction().cross(&axis.direction()) * (file.model.squareness(k).0 * distance_m);
                    value -= if linear { moved["XYZ".find(&id.name()[1..2]).unwrap()] } else { 0.0 };
                }
                curves.entry(id.name()).or_default().push((number(row[1]), value));
            }
        }
    }
    assert_holds_the_model(&curves, &file, NINE_DECIMALS_M, NINE_DECIMALS_RAD);
}

#[test]
fn heidenhain_style_tables_refuse_more_points_than_a_table_holds() {
    let file = model();
    let Writer::Approaches(write) = format("heidenhain-style").unwrap().writer else { panic!() };
    let told = write(&about(&file), &SampledErrors::of(&file.model, 0.003).unwrap()).unwrap_err().to_string();
    assert!(told.contains("axis X would have 268 points") && told.contains("larger step"), "{told}");
}

fn csv_rows(text: &str) -> (Vec<String>, Vec<Vec<f64>>) {
    let mut rows = text.lines().filter(|line| !line.starts_with('#'));
    let header = rows.next().unwrap().split(',').map(str::to_owned).collect();
    (header, rows.map(|row| row.split(',').map(number).collect()).collect())
}

#[test]
fn a_volumetric_grid_reads_back_in_its_order() {
    let file = model();
    let (header, rows) = csv_rows(&written("volumetric-grid", &file)[0].text);
    assert_eq!(header, ["x_mm", "y_mm", "z_mm", "error_x_um", "error_y_um", "error_z_um"]);
    assert_eq!(rows.len(), 4 * 3 * 5);
    assert!(rows[1][0] > rows[0][0] && rows[1][1..3] == rows[0][1..3] && rows[4][1] > rows[0][1], "X is fastest");
    for row in &rows {
        let reading_m = [row[0] / 1e3, row[1] / 1e3, row[2] / 1e3];
        let expected = geometric_error_m(&file.model, &of_places(&file.model), reading_m, OFFSET_M);
        for d in 0..3 {
            assert!((row[3 + d] / 1e6 - expected[d]).abs() < 1e-15, "{row:?} {expected}");
        }
    }
}

#[test]
fn eight_corners_read_back_at_every_corner_of_every_cell() {
    let file = model();
    let (header, rows) = csv_rows(&written("eight-corners", &file)[0].text);
    assert_eq!((header.len(), rows.len()), (30, 3 * 2 * 4));
    for row in &rows {
        for corner in 0..8 {
            let bits = [0, 1, 2].map(|d| corner >> d & 1);
            let column = 6 + 3 * corner;
            assert_eq!(header[column], format!("e{}{}{}_x_um", bits[0], bits[1], bits[2]));
            let reading_m = [0, 1, 2].map(|d| row[2 * d + bits[d]] / 1e3);
            let expected = geometric_error_m(&file.model, &of_places(&file.model), reading_m, OFFSET_M);
            for d in 0..3 {
                assert!((row[column + d] / 1e6 - expected[d]).abs() < 1e-15, "{row:?} {expected}");
            }
        }
    }
}

/// The stated interpolation error is that of the coarse table against the model at places between its nodes.
#[test]
fn what_interpolation_misses_is_stated_and_true() {
    let file = model();
    let errors = SampledErrors::of(&file.model, 0.4).unwrap();
    let axis = &errors.axes[0];
    assert_eq!(axis.positions_m.len(), 3);
    // Polynomials of the second degree: the chord misses most in the middle of a step, which is one of the checks.
    let middle = |id| {
        let at = |x: f64| file.model.error(id, x).0;
        ((at(0.0) + at(0.4)) / 2.0 - at(0.2)).abs().max(((at(0.4) + at(0.8)) / 2.0 - at(0.6)).abs())
    };
    let expected = middle(ErrorId::linear(Axis::X, Axis::X));
    assert!((axis.missed[0] - expected).abs() <= 1e-15 + 1e-9 * expected, "{} {expected}", axis.missed[0]);
    assert!(SampledErrors::of(&file.model, 0.05).unwrap().missed().0 < errors.missed().0);
    for step_m in [0.0, -0.1, f64::NAN, 1e-9] {
        assert!(SampledErrors::of(&file.model, step_m).is_err(), "{step_m}");
    }
}
