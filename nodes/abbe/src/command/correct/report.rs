//! The page of `abbe correct`: how many rows are worth what, how large the corrections are, and where.
//!
//! Place in the flow: beside the corrected table. Rows are counted as they leave, and of very many an even share is kept for the
//! picture. Correction = corrected − indicated (m here, µm on the page); uncertainties k = 2.

use crate::rows::Moved;
use crate::tally::Tally;
use crate::verification::rms_and_max_aligned_m;
use abbe_geometry::Vector3;
use abbe_geometry::correct::Status;
use abbe_report::{
    Callout, Cell, Column, Identity, KeyFigure, KeyFigures, MetaItem, NextStep, Quantity, Report, Section, State,
    TableSection, Tone, Vector, Vectors,
};

/// Corrections that are kept for the picture at most.
const KEPT: usize = 4000;
/// Coverage factor of uncertainties on the page.
const COVERAGE: f64 = 2.0;
const AXES: [&str; 3] = ["x", "y", "z"];

/// The largest correction and its row.
#[derive(Debug, Clone, Copy)]
struct Largest {
    length_m: f64,
    reading_m: [f64; 3],
    line: u64,
}

/// What was done to all rows that were corrected.
#[derive(Debug, Default)]
pub(super) struct Corrections {
    count: u64,
    squares_m2: [f64; 3],
    most_m: [f64; 3],
    most_u_m: [f64; 3],
    largest: Option<Largest>,
    /// Reading and correction (m) of one row in `step`.
    kept: Vec<([f64; 3], Vector3<f64>)>,
    step: u64,
}

impl Corrections {
    /// Counts a row.
    pub(super) fn add(&mut self, reading_m: [f64; 3], line: u64, moved: Moved) {
        for axis in 0..3 {
            self.squares_m2[axis] += moved.by_m[axis].powi(2);
            self.most_m[axis] = self.most_m[axis].max(moved.by_m[axis].abs());
            self.most_u_m[axis] = self.most_u_m[axis].max(moved.u_m[axis]);
        }
        let length_m = moved.by_m.norm();
        if self.largest.is_none_or(|largest| length_m > largest.length_m) {
            self.largest = Some(Largest { length_m, reading_m, line });
        }
        self.step = self.step.max(1);
        if self.count.is_multiple_of(self.step) {
            self.kept.push((reading_m, moved.by_m));
        }
        self.count += 1;
        if self.kept.len() > KEPT {
            // Every other one goes: what is left is one row in twice as many.
            let mut number = 0;
            self.kept.retain(|_| {
                number += 1;
                number % 2 == 1
            });
            self.step *= 2;
        }
    }

    /// Rms correction without the shift and turn of all rows that were kept (m), which the datum of a part takes out; `None` where they do
    /// not tell these.
    fn aligned_rms_m(&self) -> Option<f64> {
        let kept = self.kept.iter().map(|(reading_m, by_m)| (Vector3::from(*reading_m), *by_m));
        rms_and_max_aligned_m(kept).map(|(rms_m, _)| rms_m)
    }

    fn rms_m(&self, axes: &[usize]) -> Option<f64> {
        let sum: f64 = axes.iter().map(|axis| self.squares_m2[*axis]).sum();
        (self.count > 0).then(|| (sum / self.count as f64).sqrt())
    }
}

/// What the page is made of.
pub(super) struct Page<'a> {
    pub(super) machine: &'a str,
    /// Name of the table.
    pub(super) input: &'a str,
    pub(super) identity: Identity,
    pub(super) meta: Vec<MetaItem>,
    pub(super) tally: &'a Tally,
    /// What rows are that are not inside, in sentences.
    pub(super) outside: Option<String>,
    pub(super) corrections: &'a Corrections,
    pub(super) doubts: Vec<String>,
    pub(super) next: NextStep,
}

/// The report.
pub(super) fn report(page: Page) -> Report {
    let mut sections = vec![figures(&page)];
    sections.extend(limits(&page));
    sections.extend(vectors(page.corrections));
    sections.push(by_axis(page.corrections));
    Report {
        title: format!("Corrected coordinates of {}", page.machine),
        lead: Some(format!("{} rows of {}; correction = corrected − indicated.", page.tally.rows(), page.input)),
        identity: page.identity,
        next: Some(page.next),
        meta: page.meta,
        main_plot: None,
        footer: Some(crate::pipeline::software()),
        sections,
    }
}

fn figures(page: &Page) -> Section {
    let (tally, corrections) = (page.tally, page.corrections);
    let inside = tally.count(Status::InVolume);
    let tone = match inside {
        all if all == tally.rows() => Tone::Good,
        0 => Tone::Bad,
        _ => Tone::Warning,
    };
    let um = |label: &str, value: Option<Quantity>, detail: String| KeyFigure {
        label: label.to_owned(),
        value,
        unit: "µm".to_owned(),
        detail: Some(detail),
        ..KeyFigure::default()
    };
    let rows = KeyFigure {
        label: "rows in volume".to_owned(),
        value: Some(Quantity::new(inside as f64, 0)),
        detail: Some(format!("of {}; {} rejected", tally.rows(), tally.count(Status::Rejected))),
        tone,
        ..KeyFigure::default()
    };
    let mut figures = vec![rows];
    if let Some(largest) = corrections.largest {
        let [x, y, z] = largest.reading_m.map(|v| v * 1e3);
        let place = format!("line {}, at X {x:.0}, Y {y:.0}, Z {z:.0} mm", largest.line);
        let most_u_um = corrections.most_u_m.into_iter().reduce(f64::max).map(|u_m| COVERAGE * u_m * 1e6);
        let shown = |length_m: f64| Quantity::with(length_m * 1e6, most_u_um);
        let aligned = corrections
            .aligned_rms_m()
            .map(|rms_m| format!("; {} µm without the shift and turn of all rows", shown(rms_m).text()));
        let of_vectors = format!("length of the vectors{}", aligned.unwrap_or_default());
        figures.extend([
            um("correction, rms", corrections.rms_m(&[0, 1, 2]).map(shown), of_vectors),
            um("correction, largest", Some(shown(largest.length_m)), place),
            um("uncertainty, largest", most_u_um.map(Quantity::uncertainty), "of a coordinate, k = 2".to_owned()),
        ]);
    }
    Section::KeyFigures(KeyFigures { title: "At a glance".to_owned(), figures })
}

fn limits(page: &Page) -> Vec<Section> {
    let callout = |tone, title: &str, text: String| Section::Callout(Callout { tone, title: title.to_owned(), text });
    let tone = if page.tally.count(Status::InVolume) == 0 { Tone::Bad } else { Tone::Warning };
    let outside =
        page.outside.iter().map(|text| callout(tone, "Not all rows are inside what was measured", text.clone()));
    let doubts = page.doubts.iter();
    let doubts = doubts.map(|doubt| callout(Tone::Warning, "What speaks against this model", doubt.clone()));
    outside.chain(doubts).collect()
}

fn by_axis(corrections: &Corrections) -> Section {
    let row = |axis: usize| {
        let u_um = COVERAGE * corrections.most_u_m[axis] * 1e6;
        let (rms_um, most_um) = (corrections.rms_m(&[axis]).map(|m| m * 1e6), corrections.most_m[axis] * 1e6);
        vec![
            Cell::text(AXES[axis]),
            Cell::with(rms_um, Some(u_um)),
            Cell::with(Some(most_um), Some(u_um)),
            Cell::uncertainty(Some(u_um)),
        ]
    };
    let columns = ["correction, rms", "correction, largest", "uncertainty (k = 2), largest"];
    let columns = columns.map(|name| Column::number(name, "µm"));
    Section::Table(TableSection {
        title: "By axis".to_owned(),
        note: Some("Of the rows that were corrected; magnitudes.".to_owned()),
        columns: std::iter::once(Column::text("axis")).chain(columns).collect(),
        rows: if corrections.count > 0 { (0..3).map(row).collect() } else { Vec::new() },
        total_rows: None,
    })
}

/// The corrections as vectors; none where the readings lie in a plane.
fn vectors(corrections: &Corrections) -> Option<Section> {
    let end = |pick: fn(f64, f64) -> f64, axis: usize| corrections.kept.iter().map(|(r, _)| r[axis] * 1e3).reduce(pick);
    let corner = |pick: fn(f64, f64) -> f64| Some([end(pick, 0)?, end(pick, 1)?, end(pick, 2)?]);
    let (volume_min, volume_max) = (corner(f64::min)?, corner(f64::max)?);
    let note = match corrections.step {
        0 | 1 => "Each line runs from a reading along its correction.".to_owned(),
        step => format!("Each line runs from a reading along its correction; one row in {step} is shown."),
    };
    let point = |(reading_m, by_m): &([f64; 3], Vector3<f64>)| Vector {
        at: reading_m.map(|v| v * 1e3),
        states: [Some((by_m * 1e6).into()), None],
    };
    (0..3).all(|axis| volume_min[axis] < volume_max[axis]).then(|| {
        Section::Vectors(Vectors {
            title: "Corrections in the volume".to_owned(),
            note: Some(note),
            position_unit: "mm".to_owned(),
            vector_unit: "µm".to_owned(),
            vector_in_position: 1e-3,
            volume_min,
            volume_max,
            states: vec![("correction".to_owned(), State::After)],
            points: corrections.kept.iter().map(point).collect(),
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_very_many_rows_an_even_share_is_kept_and_all_are_counted() {
        let mut corrections = Corrections::default();
        for k in 0..3 * KEPT as u64 {
            let by_m = Vector3::new(if k == 7 { 3e-6 } else { 1e-6 }, 0.0, 0.0);
            corrections.add([k as f64, 0.0, 0.0], k + 2, Moved { by_m, u_m: Vector3::repeat(1e-7) });
        }
        assert_eq!((corrections.count, corrections.step), (12_000, 4));
        assert!(
            corrections.kept.len() == 3000 && corrections.kept.iter().all(|(at, _)| (at[0] as u64).is_multiple_of(4))
        );
        assert_eq!(corrections.largest.map(|l| (l.line, l.length_m)), Some((9, 3e-6)));
        // 11 999 rows of 1 µm and one of 3 µm.
        let expected_m = ((11_999.0 + 9.0) / 12_000_f64).sqrt() * 1e-6;
        assert!((corrections.rms_m(&[0, 1, 2]).unwrap_or_default() - expected_m).abs() < 1e-15);
    }
}
