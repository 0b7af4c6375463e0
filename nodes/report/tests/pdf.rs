//! The PDF of a report: the same bytes from the same data, its text as a reader's program finds it, sound by `qpdf`.
//!
//! Programs of other people read it where they are there: `pdftotext` (Poppler) and `qpdf`. Without them the tests say that they
//! were skipped, and with `ABBE_REQUIRE_PEERS=1` they fail.

use crate::common;
use abbe_report::*;
use std::process::{Command, Output};

/// What a program says of the PDF; `None` without the program.
fn told_by(program: &str, before: &[&str], after: &[&str], pdf: &[u8]) -> Option<Output> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("report.pdf");
    std::fs::write(&file, pdf).unwrap();
    let run = Command::new(program).args(before).arg(&file).args(after).output();
    if run.is_err() {
        let required = std::env::var("ABBE_REQUIRE_PEERS").is_ok_and(|value| value == "1");
        assert!(!required, "ABBE_REQUIRE_PEERS=1, but there is no {program}");
        eprintln!("SKIPPED: there is no {program}");
    }
    run.ok()
}

#[test]
fn the_same_data_give_the_same_bytes_without_a_date() {
    let report = common::demo_report(1).report();
    let pdf = report.pdf().unwrap();
    assert!(pdf.starts_with(b"%PDF-") && pdf == report.pdf().unwrap());
    let text = String::from_utf8_lossy(&pdf);
    assert!(!text.contains("CreationDate") && !text.contains("ModDate"));
}

#[test]
fn val_poppler_every_text_can_be_searched() {
    let report = common::demo_report(1).report();
    let Some(found) = told_by("pdftotext", &["-layout"], &["-"], &report.pdf().unwrap()) else { return };
    assert!(found.status.success(), "{}", String::from_utf8_lossy(&found.stderr));
    let text = String::from_utf8_lossy(&found.stdout).split_whitespace().collect::<Vec<_>>().join(" ");
    for wanted in [
        "Volumetric correction of a bridge machine",
        "A. Person",
        "serial number 4711",
        "µm",
        "χ² per degree of freedom",
        "Error by component",
    ] {
        assert!(text.contains(wanted), "{wanted:?} is not in {text}");
    }
    for section in report.sections.iter().map(Section::title).filter(|title| !title.is_empty()) {
        let known = text.contains(section) || matches!(section, "Key figures" | "fit");
        assert!(known, "the section {section:?} is missing");
    }
    // Titles of panels inside the drawings are text as well.
    assert!(text.contains("Cumulative share, 3-D"));
}

#[test]
fn val_qpdf_the_file_is_sound() {
    let Some(found) = told_by("qpdf", &["--check"], &[], &common::demo_report(1).report().pdf().unwrap()) else {
        return;
    };
    let said = String::from_utf8_lossy(&found.stdout);
    assert!(found.status.success() && said.contains("No syntax or stream encoding errors found"), "{said}");
}

#[test]
fn a_character_that_no_font_has_is_named() {
    let identity = Identity { operator: Some("名".into()), ..Identity::default() };
    let error = Report { title: "T".into(), identity, ..Report::default() }.pdf().unwrap_err().to_string();
    assert!(error.contains('名') && error.contains("other letters"), "{error}");
}

#[test]
fn long_tables_go_on_with_their_head_and_nothing_is_cut() {
    let long = "a verdict that is far longer than a column of any page could ever be ".repeat(3);
    let row = |k: i64| vec![Cell::text(format!("row{k}")), Cell::text(&long), Some(Cell::Integer(k))];
    let table = TableSection {
        title: "Long".into(),
        note: None,
        columns: vec![Column::text("name"), Column::text("verdict"), Column::number("number", "1")],
        rows: (0..80).map(row).collect(),
        total_rows: None,
    };
    let report = Report { title: "T".into(), sections: vec![Section::Table(table)], ..Report::default() };
    let Some(found) = told_by("pdftotext", &["-layout"], &["-"], &report.pdf().unwrap()) else { return };
    let text = String::from_utf8_lossy(&found.stdout).into_owned();
    let pages = text.matches('\u{c}').count();
    assert!(pages > 2 && text.matches("verdict").count() >= 3 * 80 + pages, "{pages} pages");
    assert!((0..80).all(|k| text.contains(&format!("row{k} "))));
    assert!(text.contains(&format!("page {pages} of {pages}")));
}
