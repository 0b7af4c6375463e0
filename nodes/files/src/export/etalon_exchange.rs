//! Etalon exchange format: a block a parameter, `[EXX]` with `Gridpoints = { … }`, `[C0Y]` with `VALUE = …`.
//!
//! Place in the flow: one of [`super::FORMATS`]. Position of the axis in mm and value in mm or rad on each line, comments
//! after `//`; units as ISG's kernel documentation gives them for all its formats. What that documentation does not say is
//! the sign: here it is Abbe's, error = actual − indicated. Twelve decimals, as in the documentation's example.

use super::{About, ExportedFile, Format, Writer, commented, fixed, missed_words};
use crate::error::FileError;
use crate::units::millimetres_from_m;
use abbe_geometry::sampled::{SampledErrors, errors_of};
use std::fmt::Write as _;

const DECIMALS: usize = 12;

pub(super) const FORMAT: Format = Format {
    name: "etalon-exchange",
    title: "Etalon exchange format, blocks [EXX] Gridpoints = { position value } and [C0Y] VALUE = angle",
    source: "syntax and units as in ISG kernel documentation, \"Etalon Exchange Format\" and \"Units of measure\" \
             (isg-stuttgart.de, kernel-html/en-GB/296430091.html and 296426379.html); its sign is not stated there, \
             compare one error before use",
    most_points: None,
    is_stepped: false,
    writer: Writer::Functions(write),
};

fn write(about: &About, errors: &SampledErrors) -> Result<Vec<ExportedFile>, FileError> {
    let units = format!("positions mm, linear errors mm, angles rad; {}", about.reference());
    let mut text = commented(&about.lines(&FORMAT, &units, &missed_words(errors)), "//");
    // Writing to a string cannot fail.
    for (name, value, _) in &errors.squareness {
        let _ = write!(text, "\n[{name}]\nVALUE = {}\n", fixed(*value, DECIMALS));
    }
    for axis in &errors.axes {
        for (k, id) in errors_of(axis.axis).into_iter().enumerate() {
            let _ = write!(text, "\n[{}]\nGridpoints = {{\n", id.name());
            for (position_m, values) in axis.positions_m.iter().zip(&axis.errors) {
                let value = if k < 3 { values[k] * 1e3 } else { values[k] };
                let _ = writeln!(text, "    {} {}", millimetres_from_m(*position_m), fixed(value, DECIMALS));
            }
            let _ = writeln!(text, "}}  // end of {}", id.name());
        }
    }
    Ok(vec![ExportedFile { name: "errors.txt".to_owned(), text }])
}
