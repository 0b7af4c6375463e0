//! Plain CSV of all 21 errors with their uncertainty, one value a row: for spreadsheets and other programs.
//!
//! Place in the flow: one of [`super::FORMATS`]. Columns `error,position_mm,value,u,unit`: ISO 230-1 name; reading of its own
//! axis (empty for squareness and the turn of the ram, which have none); value and standard uncertainty (k = 1; empty for what was not identified) in
//! `um` or `urad`. Numbers read back as they were, but for the last bit of some. Order: X, Y, Z, of each E_X E_Y E_Z E_A E_B E_C,
//! positions ascending; squareness, then `ram_turn_x`, `ram_turn_y`, `ram_turn_z`, last.

use super::{About, ExportedFile, Format, Writer, commented, missed_words};
use crate::error::FileError;
use crate::units::{micrometres_from_m, millimetres_from_m};
use abbe_geometry::Axis;
use abbe_geometry::sampled::{SampledErrors, errors_of};
use std::fmt::Write as _;

pub(super) const FORMAT: Format = Format {
    name: "csv",
    title: "all 21 errors with uncertainty, one value a row",
    source: "own; columns error, position_mm, value, u (k = 1), unit",
    most_points: None,
    is_stepped: false,
    writer: Writer::Functions(write),
};

fn write(about: &About, errors: &SampledErrors) -> Result<Vec<ExportedFile>, FileError> {
    let units = format!("position_mm in mm, value and u as the column unit says; {}", about.reference());
    let mut text = commented(&about.lines(&FORMAT, &units, &missed_words(errors)), "#");
    text.push_str("error,position_mm,value,u,unit\n");
    // Writing to a string cannot fail.
    for axis in &errors.axes {
        for (k, id) in errors_of(axis.axis).into_iter().enumerate() {
            let unit = if k < 3 { "um" } else { "urad" };
            for (node, position_m) in axis.positions_m.iter().enumerate() {
                let (name, value) = (id.name(), micrometres_from_m(axis.errors[node][k]));
                let u = u_words(about, &name, axis.u[node][k]);
                let _ = writeln!(text, "{name},{},{value},{u},{unit}", millimetres_from_m(*position_m));
            }
        }
    }
    for (name, value, u) in &errors.squareness {
        let _ = writeln!(text, "{name},,{},{},urad", micrometres_from_m(*value), u_words(about, name, *u));
    }
    for (axis, (value, u)) in Axis::ALL.into_iter().zip(errors.ram_turn) {
        let _ =
            writeln!(text, "ram_turn_{},,{},{},urad", axis.lower(), micrometres_from_m(value), micrometres_from_m(u));
    }
    Ok(vec![ExportedFile { name: "errors.csv".to_owned(), text }])
}

/// A standard uncertainty (µm or µrad); empty for what was not identified.
fn u_words(about: &About, name: &str, u: f64) -> String {
    if about.is_identified(name) { micrometres_from_m(u).to_string() } else { String::new() }
}
