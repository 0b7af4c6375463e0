//! ISG CSV: tables separated by blanks, one a file part, `#` between the parts, comments after `//`.
//!
//! Place in the flow: one of [`super::FORMATS`]. First the squareness errors, then a table an axis headed by the axis and its
//! six component errors. Arguments and offsets in mm, angles in rad, as ISG's kernel documentation asks for. Its sign is not
//! stated there beyond a switch `negate`; here it is Abbe's, error = actual − indicated.

use super::{About, ExportedFile, Format, Writer, commented, fixed, missed_words};
use crate::error::FileError;
use crate::units::millimetres_from_m;
use abbe_geometry::sampled::{SampledErrors, errors_of};
use std::fmt::Write as _;

const DECIMALS: usize = 12;

pub(super) const FORMAT: Format = Format {
    name: "isg-csv",
    title: "ISG kernel and TwinCAT volumetric compensation, ISG_CSV",
    source: "syntax, names and units as in ISG kernel documentation, \"ISG CSV format\", \"List of parameters supported\" and \
             \"Units of measure\" (isg-stuttgart.de, kernel-html/en-GB/296429067.html, 296423819.html, 296426379.html); its \
             sign is not stated there, compare one error before use, and see the parameter negate",
    most_points: None,
    is_stepped: false,
    writer: Writer::Functions(write),
};

fn write(about: &About, errors: &SampledErrors) -> Result<Vec<ExportedFile>, FileError> {
    let units = format!("arguments mm, linear errors mm, angles rad; {}", about.reference());
    let mut text = commented(&about.lines(&FORMAT, &units, &missed_words(errors)), "//");
    let names: Vec<&str> = errors.squareness.iter().map(|(name, _, _)| name.as_str()).collect();
    let values: Vec<String> = errors.squareness.iter().map(|(_, value, _)| fixed(*value, DECIMALS)).collect();
    // Writing to a string cannot fail.
    let _ = write!(text, "{}\n{}\n", names.join(" "), values.join(" "));
    for axis in &errors.axes {
        let ids = errors_of(axis.axis).map(|id| id.name());
        let _ = write!(text, "#\n{} {}\n", axis.axis.letter(), ids.join(" "));
        for (position_m, values) in axis.positions_m.iter().zip(&axis.errors) {
            let cells = [0, 1, 2, 3, 4, 5].map(|k| fixed(if k < 3 { values[k] * 1e3 } else { values[k] }, DECIMALS));
            let _ = writeln!(text, "{} {}", millimetres_from_m(*position_m), cells.join(" "));
        }
    }
    Ok(vec![ExportedFile { name: "errors.csv".to_owned(), text }])
}
