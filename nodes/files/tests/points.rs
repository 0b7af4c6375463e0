//! Points go through with their cells as they were and the corrected coordinates beside them.

use crate::common;
use abbe_files::{ADDED_COLUMNS, FileError, PointRow, PointsReader, PointsWriter};
use abbe_geometry::correct::{Status, correct};
use abbe_geometry::effects::{CovariateSource, CovariateValue, State};
use std::io::Read;

const HEAD: &str = "point,x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm,temp_air_c,note";
const ROW: &str = "007,316.5469976,84.2584672,442.2081844,0,0,-60,20.70,\"slow, twice\"";

fn open(text: &str) -> Result<PointsReader<&[u8]>, FileError> {
    PointsReader::new(text.as_bytes(), "p.csv", None)
}

#[track_caller]
fn refused<R: Read>(result: Result<PointsReader<R>, FileError>, parts: &[&str]) {
    let Err(error) = result else { panic!("it was accepted") };
    parts.iter().for_each(|part| assert!(error.to_string().contains(part), "{error} does not say {part:?}"));
}

#[test]
fn rows_are_read_in_si_with_their_covariates() {
    let text = format!("{HEAD}\n{ROW}\n");
    let mut reader = open(&text).unwrap();
    let mut row = PointRow::default();
    assert!(reader.read(&mut row).unwrap());
    assert_eq!((row.line(), row.actual_m), (2, None));
    assert_eq!(row.reading_m, [316.5469976, 84.2584672, 442.2081844].map(|mm| mm / 1e3));
    assert_eq!(row.offset_m, [0.0, 0.0, -0.06]);
    let covariates = reader.covariates(&row);
    assert_eq!(covariates.covariate("temp_air_c"), CovariateValue::Fresh(20.70));
    for name in ["note", "load_kg", "x_mm"] {
        assert_eq!(covariates.covariate(name), CovariateValue::Missing, "{name}");
    }
    assert!(!reader.read(&mut row).unwrap());
}

#[test]
fn the_output_is_the_input_and_seven_columns() {
    let file = common::model(3);
    let far = ROW.replace("316.5469976", "5000");
    let text = format!("{HEAD}\n{ROW}\n{far}\n");
    let mut reader = open(&text).unwrap();
    let mut writer = PointsWriter::new(Vec::new(), "out.csv", &reader).unwrap();
    let (mut row, mut corrections) = (PointRow::default(), Vec::new());
    while reader.read(&mut row).unwrap() {
        let covariates = reader.covariates(&row);
        let state = State { reading_m: row.reading_m, offset_m: row.offset_m, covariates: &covariates };
        let correction = correct(&file.model, &state);
        writer.write(&row, &correction).unwrap();
        corrections.push(correction);
    }
    let output = String::from_utf8(writer.finish().unwrap()).unwrap();
    let lines: Vec<&str> = output.lines().collect();
    assert_eq!(lines[0], format!("{HEAD},{}", ADDED_COLUMNS.join(",")));
    let p = corrections[0].position_m * 1e3;
    let u = (0..3).map(|k| 2e6 * corrections[0].covariance_m2.unwrap()[(k, k)].max(0.0).sqrt()).collect::<Vec<_>>();
    assert_eq!(corrections[0].status, Status::CovariateMissing, "the rows carry no scale temperatures");
    let expected =
        format!("{ROW},{:.7},{:.7},{:.7},{:.4},{:.4},{:.4},covariate_missing", p.x, p.y, p.z, u[0], u[1], u[2]);
    assert_eq!(lines[1], expected);
    assert_eq!(lines[2], format!("{far},,,,,,,rejected"));
    refused(open(&output), &["p.csv, line 1, column corrected_x_mm", "already holds", "before correction"]);
}

/// What comes out where these points go in, corrected by a model.
fn handed_through(text: &str) -> Result<String, FileError> {
    let file = common::model(3);
    let mut reader = PointsReader::new(text.as_bytes(), "p.csv", Some([0.0; 3]))?;
    let mut writer = PointsWriter::new(Vec::new(), "out.csv", &reader)?;
    let mut row = PointRow::default();
    while reader.read(&mut row)? {
        let state = State { reading_m: row.reading_m, offset_m: row.offset_m, covariates: &reader.covariates(&row) };
        writer.write(&row, &correct(&file.model, &state))?;
    }
    Ok(String::from_utf8(writer.finish()?).unwrap())
}

#[test]
fn regress_points_come_out_in_the_dialect_in_which_they_came_in() {
    let plain = format!("{HEAD}\n{ROW}\n").replace("\"slow, twice\"", "slow");
    let of_plain = handed_through(&plain).unwrap();
    let european = |text: &str| text.replace(',', ";").replace('.', ",").replace('\n', "\r\n");
    for (head, text) in [("", plain.clone()), ("\u{feff}", plain.clone()), ("# decimal=.\n", plain.clone())] {
        assert_eq!(handed_through(&format!("{head}{text}")).unwrap(), format!("{head}{of_plain}"));
    }
    for head in ["", "\u{feff}", "sep=;\r\n", "\u{feff}sep=;\r\n# decimal=,\r\n"] {
        let through = handed_through(&format!("{head}{}", european(&plain))).unwrap();
        assert_eq!(through, format!("{head}{}", european(&of_plain)), "{head:?}");
    }
    let tabs = |text: &str| text.replace(',', "\t");
    assert_eq!(handed_through(&tabs(&plain)).unwrap(), tabs(&of_plain));
    // Reading it back gives the numbers of the plain one.
    let again = handed_through(&european(&plain)).unwrap();
    refused(open(&again), &["column corrected_x_mm", "already holds"]);
}

#[test]
fn regress_whole_numbers_do_not_make_an_output_of_two_dialects() {
    let rows = "x_mm;y_mm;z_mm\n1;2;3\n1,5;2;3\n";
    let lines = handed_through(rows).unwrap();
    assert!(lines.lines().nth(1).unwrap().starts_with("1;2;3;0,"), "the second row tells for the first: {lines}");
    // More whole numbers than come at a time: then nobody can know.
    let many = format!("x_mm;y_mm;z_mm\n{}1,5;2;3\n", "1;2;3\n".repeat(20_000));
    let message = handed_through(&many).unwrap_err().to_string();
    assert!(message.starts_with("p.csv, line 20002: decimal commas begin here"), "{message}");
    assert!(handed_through(&format!("# decimal=,\n{many}")).is_ok());
    // A column that nobody reads tells, too: its commas and new points would be two dialects.
    let aside = handed_through("x_mm;y_mm;z_mm;note\n1;2;3;20,5\n").unwrap();
    assert!(aside.lines().nth(1).unwrap().starts_with("1;2;3;20,5;0,"), "{aside}");
    let read = handed_through("x_mm;y_mm;z_mm;note\n1.5;2;3;20,5\n").unwrap();
    assert_eq!(read.matches(',').count(), 1, "what is read comes first: {read}");
    let listed = handed_through("x_mm,y_mm,z_mm,note\n1,2,3,\"4,5\"\n").unwrap();
    assert!(listed.contains(",\"4,5\",0."), "between commas it is a list: {listed}");
}

#[test]
fn regress_covariates_with_decimal_commas_are_read_and_open_ones_refused() {
    let text = "x_mm;y_mm;z_mm;temp_air_c;note\n100,5;2;3;20,125;about 1,5\n";
    let mut reader = PointsReader::new(text.as_bytes(), "p.csv", Some([0.0; 3])).unwrap();
    let mut row = PointRow::default();
    assert!(reader.read(&mut row).unwrap());
    assert_eq!(reader.covariates(&row).covariate("temp_air_c"), CovariateValue::Fresh(20.125));
    assert_eq!(reader.covariates(&row).covariate("note"), CovariateValue::Missing);
    let open = "x_mm;y_mm;z_mm;temp_air_c\n100;2;3;20,125\n";
    let mut reader = PointsReader::new(open.as_bytes(), "p.csv", Some([0.0; 3])).unwrap();
    assert!(reader.read(&mut row).unwrap());
    assert!(reader.refuse_open_numbers().is_ok());
    reader.covariates(&row).covariate("temp_air_c");
    let told = reader.refuse_open_numbers().unwrap_err().to_string();
    assert!(told.starts_with("p.csv, line 2, column temp_air_c: \"20,125\" is 20.125 with"), "{told}");
}

#[test]
fn what_is_wrong_with_points_is_named() {
    refused(open(""), &["p.csv: the file is empty"]);
    refused(open(&HEAD.replace(",z_mm", ",z_m")), &["column z_m", "millimetres"]);
    refused(open(&HEAD.replace(",z_mm", "")), &["column z_mm", "missing"]);
    refused(open("x_mm,y_mm,z_mm\n1,2,3"), &["default_offset_mm", "offset_x_mm"]);
    assert!(PointsReader::new("x_mm,y_mm,z_mm\n1,2,3".as_bytes(), "p.csv", Some([0.0; 3])).is_ok());
    // The machine's own offset is not taken in silence where columns look like one.
    let like = "x_mm,y_mm,z_mm,Offset X (mm),Offset Y (mm),Offset Z (mm)\n1,2,3,4,5,6\n";
    let told =
        PointsReader::new(like.as_bytes(), "p.csv", Some([0.0, 0.0, -0.06])).map(|_| ()).unwrap_err().to_string();
    for part in ["p.csv, line 1, column Offset X (mm)", "0, 0, -60 mm, would be taken", "offset_x_mm"] {
        assert!(told.contains(part), "{told}");
    }
    for (cell, says) in [("NaN", "not a finite number"), ("", "empty"), ("1;2", "not a number")] {
        let text = format!("{HEAD}\n{}", ROW.replace("84.2584672", cell));
        let error = open(&text).unwrap().read(&mut PointRow::default()).unwrap_err().to_string();
        assert!(error.starts_with("p.csv, line 2, column y_mm") && error.contains(says), "{error}");
    }
    let error = open(&format!("{HEAD}\n1,2")).unwrap().read(&mut PointRow::default()).unwrap_err().to_string();
    assert!(error.contains("line 2") && error.contains("2 cells"), "{error}");
}

#[test]
fn verification_files_carry_the_truth() {
    let text = format!("{HEAD},actual_x_mm,actual_y_mm,actual_z_mm\n{ROW},316.5,84.2,382.3\n");
    let mut reader = PointsReader::verification(text.as_bytes(), "v.csv", None).unwrap();
    let mut row = PointRow::default();
    assert!(reader.read(&mut row).unwrap());
    assert_eq!(row.actual_m, Some([316.5, 84.2, 382.3].map(|mm| mm / 1e3)));
    refused(PointsReader::verification(HEAD.as_bytes(), "v.csv", None), &["column actual_x_mm", "missing"]);
}
