//! Files of acceptance tests, lengths and runs: no bytes make reader or evaluation panic, and what is wrong is named.

use crate::mangled::mangled;
use abbe_conformity::length::{LengthTest, Probing, evaluate};
use abbe_conformity::positioning;
use abbe_files::{FileError, LengthFile, StudyFile, read_lengths, read_runs};
use abbe_measurement::positioning::Run;
use proptest::collection::vec;
use proptest::prelude::*;

const LENGTHS: &str = "line,travel_mm,calibrated_mm,repeat,deviation_um\nX,800,100.0177,1,-0.11\nX,800,100.0177,2,0.05\n\
                       X,800,200.02,1,0.2\nPPP,1166.19,100.0177,1,0.31\nPPP,1166.19,420.01,1,-0.4\n";
const RUNS: &str = "axis,target_mm,direction,cycle,measured_mm,time_s,temp_x_c\nX,0,+,1,0.0001,0,20\nX,100,+,1,100.0003,5,\n\
                    X,100,-,1,100.0001,9,20.1\nX,0,-,1,-0.0002,14,20.1\nX,0,+,2,0.0002,20,20.2\nX,100,+,2,100.0004,25,20.2\n";

/// A refusal names the file, and says what to do after what is wrong.
fn assert_told<T>(read: &Result<T, FileError>) {
    let Err(error) = read else { return };
    let FileError::Content { problem, remedy, .. } = error else { panic!("{error}") };
    assert!(error.to_string().starts_with("fuzz"), "{error}");
    assert!(!problem.is_empty() && !remedy.is_empty(), "{error}");
}

/// Reads lengths; evaluates what is accepted, which may be refused in words.
fn lengths(bytes: &[u8]) -> Result<LengthFile, FileError> {
    let read = read_lengths(bytes, "fuzz");
    assert_told(&read);
    if let Ok(file) = &read {
        assert!(file.measurements.iter().all(|m| m.calibrated_m.is_finite() && m.error.metres().is_finite()));
        assert!(file.measurements.iter().all(|m| m.repeat > 0));
        for probing in [Probing::Bidirectional, Probing::Unidirectional] {
            let test = LengthTest { tool_offset_m: 0.0, probing, travel_m: file.travel_m.clone() };
            if let Ok(errors) = evaluate(test, &file.measurements) {
                let _ = (errors.largest(), errors.repeatability(), errors.frontier());
            }
        }
    }
    read
}

/// The same with runs.
fn runs(bytes: &[u8]) -> Result<StudyFile<Run>, FileError> {
    let read = read_runs(bytes, "fuzz");
    assert_told(&read);
    if let Ok(file) = &read {
        assert!(file.rows.iter().all(|run| run.target_m.is_finite() && run.measured_m.is_finite()));
        let _ = positioning::evaluate("X", &file.rows);
    }
    read
}

/// A text with one cell replaced; the line and the column's name.
fn spoilt(text: &str, row: &prop::sample::Index, column: usize, cell: &str) -> (String, usize, String) {
    let mut table: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
    let row = 1 + row.index(table.len() - 1);
    table[row][column] = cell;
    let name = table[0][column].to_owned();
    let lines: Vec<String> = table.iter().map(|cells| cells.join(",")).collect();
    (lines.join("\n") + "\n", row + 1, name)
}

#[test]
fn both_files_are_accepted_as_they_stand() {
    assert_eq!(lengths(LENGTHS.as_bytes()).unwrap().measurements.len(), 5);
    assert_eq!(runs(RUNS.as_bytes()).unwrap().rows.len(), 6);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn no_bytes_make_a_reader_or_an_evaluation_panic(bytes in vec(any::<u8>(), 0..400), l in mangled(LENGTHS), r in mangled(RUNS)) {
        for bytes in [&bytes, &l, &r] {
            let _ = (lengths(bytes), runs(bytes));
        }
    }

    /// Any numbers at all, as far as the columns hold them.
    #[test]
    fn no_numbers_make_an_evaluation_panic(
        rows in vec((0..3, any::<f64>(), 0u32..4, -1e3f64..1e3, any::<bool>()), 1..30),
    ) {
        let line = |k: i32| ["X", "Y", "PPP"][k as usize];
        let of_lengths = rows.iter().map(|(k, length, repeat, error, _)| format!("{},{length},{repeat},{error}\n", line(*k)));
        let _ = lengths(format!("line,calibrated_mm,repeat,deviation_um\n{}", of_lengths.collect::<String>()).as_bytes());
        let of_runs = rows.iter().map(|(k, target, cycle, error, up)| {
            format!("{},{target},{},{cycle},{}\n", line(*k), if *up { "+" } else { "-" }, target + error)
        });
        let _ = runs(format!("axis,target_mm,direction,cycle,measured_mm\n{}", of_runs.collect::<String>()).as_bytes());
    }

    #[test]
    fn a_cell_that_is_none_is_named_by_line_and_column(
        row in any::<prop::sample::Index>(),
        length_column in 1usize..5,
        run_column in 1usize..7,
        cell in prop::sample::select(vec!["nan", "inf", "12;5", "x", "1e999", "--1"]),
    ) {
        let (text, line, column) = spoilt(LENGTHS, &row, length_column, cell);
        let told = lengths(text.as_bytes()).unwrap_err().to_string();
        prop_assert!(told.contains(&format!("line {line}")) && told.contains(&column), "{}", told);
        let (text, line, column) = spoilt(RUNS, &row, run_column, cell);
        let told = runs(text.as_bytes()).unwrap_err().to_string();
        prop_assert!(told.contains(&format!("line {line}")) && told.contains(&column), "{}", told);
    }
}
