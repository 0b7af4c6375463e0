//! Tables in the style of Heidenhain's axis-error compensation: a `.COM` table an axis, a `.CMA` table that names them.
//!
//! Place in the flow: one of [`super::FORMATS`]. Columns and limits are those that Heidenhain's technical manuals describe:
//! `AXISPOS` at equal steps, at most 256 points; a column named like the axis for positioning; `C2` to `C6` for straightness,
//! roll, pitch and yaw (KinematicsComp: EYX → C2, EZX → C3, EAX → C4, EBX → C5, ECX → C6); `BACKLASH` for the positioning values that were
//! measured in the negative direction, where the model has them: the column of the axis then holds those of the positive one. The exact syntax of such files and
//! the sign of their values could not be checked, hence "style". Squareness has no column of its own: it is added to the
//! straightness of the axis that it tilts, so that the straightness columns are not zero at their upper end.
//!
//! For axis Y the linear columns are Y, C2 (EXY), C3 (EZY); for Z they are Z, C2 (EXZ), C3 (EYZ); the head of each says so.

use super::{About, ExportedFile, Format, Writer, check_points, commented, fixed, missed_words, tilted_m};
use crate::error::FileError;
use crate::units::millimetres_from_m;
use abbe_geometry::axis::Axis;
use abbe_geometry::sampled::{SampledAxis, SampledErrors, errors_of};
use std::fmt::Write as _;

/// Points that a table holds.
const MOST_POINTS: usize = 256;
/// Decimals of mm and degrees: below what a controller resolves.
const DECIMALS: usize = 9;

pub(super) const FORMAT: Format = Format {
    name: "heidenhain-style",
    title: "one X.COM, Y.COM, Z.COM table an axis and config.CMA, in the style of Heidenhain's compensation tables",
    source: "columns as in Heidenhain's technical manuals (MANUALplus 620, section 6.10; iTNC 530 HSCI, KinematicsComp); \
             syntax and sign could not be checked against a controller: transfer by hand or convert",
    most_points: Some(MOST_POINTS),
    is_stepped: false,
    writer: Writer::Approaches(write),
};

fn write(about: &About, errors: &SampledErrors) -> Result<Vec<ExportedFile>, FileError> {
    let unknown = about.wholly_unknown(&FORMAT)?;
    let known: Vec<&SampledAxis> = errors.axes.iter().filter(|axis| !unknown.contains(&axis.axis)).collect();
    let mut files = known.iter().map(|axis| table(about, errors, axis)).collect::<Result<Vec<_>, _>>()?;
    let letters: Vec<String> = known.iter().map(|axis| axis.axis.letter().to_string()).collect();
    let names: Vec<String> = letters.iter().map(|letter| format!("{letter}.COM")).collect();
    let text = format!("NR ACTIVE {}\n0 * {}\n", letters.join(" "), names.join(" "));
    files.push(ExportedFile { name: "config.CMA".to_owned(), text });
    Ok(files)
}

fn table(about: &About, errors: &SampledErrors, axis: &SampledAxis) -> Result<ExportedFile, FileError> {
    check_points(&FORMAT, axis)?;
    let others = Axis::ALL.into_iter().filter(|other| *other != axis.axis).map(Axis::index);
    // Zeros for a positioning that nobody measured would take away what the controller has.
    let own_column = (!about.is_unknown(axis.axis)).then_some(axis.axis.index());
    let order: Vec<usize> = own_column.into_iter().chain(others).chain(3..6).collect();
    let ids = errors_of(axis.axis);
    let is_one_sided = about.approach.is_one_sided(axis.axis);
    let has_other_side = about.approach.has(axis.axis) && !is_one_sided;
    let letters = own_column.map(|_| axis.axis.letter().to_string());
    let columns: Vec<String> = letters.into_iter().chain(["C2", "C3", "C4", "C5", "C6"].map(str::to_owned)).collect();
    let meaning: Vec<String> = columns.iter().zip(&order).map(|(c, k)| format!("{c} = {}", ids[*k].name())).collect();
    let sides = match (has_other_side, is_one_sided) {
        _ if own_column.is_none() => format!("no column {}, as its positioning was not identified", axis.axis.letter()),
        (true, _) => format!("{} in approaches in +, BACKLASH the same in approaches in -", axis.axis.letter()),
        (false, true) => "BACKLASH is left out, as one side of approach was not measured".to_owned(),
        (false, false) => "BACKLASH is left out, as the model has no reversal of this axis".to_owned(),
    };
    let units = format!(
        "AXISPOS and linear errors mm, angles degrees; {}; {sides}; with squareness added to straightness; every error{} is zero at \
         the lower end of its stroke",
        meaning.join(", "),
        about.but_effects()
    );
    let mut text = commented(&about.lines(&FORMAT, &units, &missed_words(errors)), ";");
    // Writing to a string cannot fail.
    let backlash = if has_other_side { " BACKLASH" } else { "" };
    let _ = writeln!(text, "NR AXISPOS{backlash} {}", columns.join(" "));
    for (number, (position_m, values)) in axis.positions_m.iter().zip(&axis.errors).enumerate() {
        let tilted_m = tilted_m(about, errors, axis.axis, position_m - axis.positions_m[0]);
        let half_m = if has_other_side { about.approach.reversal_m(axis.axis, *position_m) / 2.0 } else { 0.0 };
        let own = axis.axis.index();
        let side_m = |k: usize| if k == own { half_m } else { 0.0 };
        let cell = |k: &usize| {
            let value = if *k < 3 { (values[*k] + tilted_m[*k] + side_m(*k)) * 1e3 } else { values[*k].to_degrees() };
            fixed(value, DECIMALS)
        };
        let other_side = format!(" {}", fixed((values[own] + tilted_m[own] - half_m) * 1e3, DECIMALS));
        let other_side = if has_other_side { other_side.as_str() } else { "" };
        let cells: Vec<String> = order.iter().map(cell).collect();
        let _ = writeln!(text, "{number} {}{other_side} {}", millimetres_from_m(*position_m), cells.join(" "));
    }
    Ok(ExportedFile { name: format!("{}.COM", axis.axis.letter()), text })
}
