//! RepRapFirmware axis compensation: one `M556`.
//!
//! Place in the flow: one of [`super::FORMATS`]. The firmware moves to x + y·X/S + z·Z/S and y + z·Y/S: these are corrections,
//! the shear of the errors ([`super::skew`]) with its sign turned. The letters are those of planes, X for XY, Y for YZ, Z for XZ.

use super::skew::{ONLY, skew};
use super::{About, ExportedFile, Format, Writer, commented, fixed, missed_words};
use crate::error::FileError;
use abbe_geometry::sampled::SampledErrors;

/// Length that deviations are given for (mm).
const SPAN_MM: f64 = 1000.0;
const DECIMALS: usize = 6;

pub(super) const FORMAT: Format = Format {
    name: "reprap-skew",
    title: "RepRapFirmware, M556 for config.g",
    source: "RepRapFirmware, Move: SetAxisCompensation and AxisTransform, with P0 (X follows Y) as it is by default",
    most_points: None,
    is_stepped: false,
    writer: Writer::Functions(write),
};

fn write(about: &About, errors: &SampledErrors) -> Result<Vec<ExportedFile>, FileError> {
    let found = skew(&FORMAT, about, errors)?;
    let units = format!(
        "mm over S mm; correction, the error with its sign turned: X of X by Y, Y of Y by Z, Z of X by Z; {ONLY}"
    );
    let mut text = commented(&about.lines(&FORMAT, &units, &missed_words(errors)), ";");
    let over = |shear: f64| fixed(-shear * SPAN_MM, DECIMALS);
    text.push_str(&format!("M556 S{SPAN_MM} X{} Y{} Z{}\n", over(found.xy), over(found.yz), over(found.xz)));
    Ok(vec![ExportedFile { name: "skew.g".to_owned(), text }])
}
