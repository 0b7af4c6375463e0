//! Of which tips residual vectors are.
//!
//! Place in the flow: rows of a file with their lines in; a refusal where they are of several tips out. The error of a machine
//! depends on where tip or reflector stands from the ram reference point, since its axes turn it: a field of the position is that of
//! one tip, and rows of two would be taken for noise of one. Offsets in m, ram frame.

use crate::columns::OFFSET;
use crate::error::{FileError, Place};
use crate::units::millimetres_from_m;
use abbe_measurement::residual_vector::ResidualVector;

/// Offsets that differ by less (mm) are those of one tip: by that, axes that turn by 100 µrad move it 10 nm apart.
const SAME_MM: f64 = 0.1;
/// Offsets that a message shows.
const MOST_SHOWN: usize = 3;

/// Offsets of points (mm) that are those of one tip each, in the order of their first point.
#[derive(Debug, Default)]
pub(crate) struct Tips(Vec<[f64; 3]>);

impl Tips {
    /// Adds that of a point.
    pub(crate) fn push(&mut self, offset_mm: [f64; 3]) {
        let is_near = |known: &[f64; 3]| known.iter().zip(offset_mm).all(|(a, b)| (a - b).abs() < SAME_MM);
        if !self.0.iter().any(is_near) {
            self.0.push(offset_mm);
        }
    }

    /// In m, ram frame.
    pub(crate) fn into_m(self) -> Vec<[f64; 3]> {
        self.0.into_iter().map(|offset_mm| offset_mm.map(|mm| mm / 1e3)).collect()
    }
}

/// Whether two offsets (m) are those of one tip.
pub fn is_one_tip(a_m: [f64; 3], b_m: [f64; 3]) -> bool {
    a_m.iter().zip(b_m).all(|(a, b)| ((a - b) * 1e3).abs() < SAME_MM)
}

/// The tip of vectors that are of one (m, ram frame), where they say it.
pub fn tip_of(rows: &[ResidualVector]) -> Option<[f64; 3]> {
    let first = rows.first()?;
    let of = |k: usize| first.covariates.get(OFFSET[k].name).map(|mm| mm / 1e3);
    Some([of(0)?, of(1)?, of(2)?])
}

/// An offset as words show it: `120 0 -60 mm`.
pub fn offset_words(offset_m: [f64; 3]) -> String {
    let mm = offset_m.map(|v| (millimetres_from_m(v) * 1e4).round() / 1e4 + 0.0);
    format!("{} {} {} mm", mm[0], mm[1], mm[2])
}

/// Refuses vectors of several tips, by the columns of offsets among what they logged; those that `is_input` names are what the field
/// depends on, and may differ.
///
/// # Errors
/// Rows of several offsets, with the first line that has another.
pub fn refuse_several_tips(
    file: &str,
    (rows, lines): (&[ResidualVector], &[u64]),
    is_input: impl Fn(&str) -> bool,
) -> Result<(), FileError> {
    let of_row = |row: &ResidualVector| OFFSET.map(|own| row.covariates.get(own.name).copied());
    let watched = OFFSET.map(|own| !is_input(own.name));
    let differs = |a: &[Option<f64>; 3], b: &[Option<f64>; 3], k: usize| match (a[k], b[k]) {
        (Some(a), Some(b)) => (a - b).abs() >= SAME_MM,
        (a, b) => a.is_some() != b.is_some(),
    };
    let column_of = |a: &[Option<f64>; 3], b: &[Option<f64>; 3]| (0..3).find(|k| watched[*k] && differs(a, b, *k));
    let mut tips: Vec<([Option<f64>; 3], u64)> = Vec::new();
    for (row, line) in rows.iter().zip(lines) {
        let offset_mm = of_row(row);
        if tips.iter().all(|(known, _)| column_of(known, &offset_mm).is_some()) {
            tips.push((offset_mm, *line));
        }
    }
    let [(first, _), (other, line), ..] = tips[..] else { return Ok(()) };
    let column = column_of(&first, &other).unwrap_or_default();
    let cell = |mm: Option<f64>| mm.map_or_else(|| "?".to_owned(), |mm| mm.to_string());
    let shown: Vec<String> = tips.iter().take(MOST_SHOWN).map(|(mm, _)| mm.map(cell).join(" ")).collect();
    let more = if tips.len() > MOST_SHOWN { " …" } else { "" };
    let problem = format!(
        "the vectors are of {} tips, whose offsets from the ram reference point differ ({} mm{more}): each tip has errors of its own",
        tips.len(),
        shown.join(", ")
    );
    let remedy = "take the rows of one tip: abbe points --offset-mm X,Y,Z writes them, or keep those rows of this file; a model of the \
                  machine (abbe identify, fit-points) takes all tips together";
    Err(FileError::content(Place::file(file).line(line).column(OFFSET[column].name), problem, remedy))
}
