//! RepRapFirmware axis compensation: one `M556`.
//!
//! Place in the flow: one of [`super::FORMATS`]. The firmware moves to x + y·X/S + z·Z/S and y + z·Y/S: these are corrections,
//! the shear of the errors ([`super::skew`]) with its sign turned. The letters are those of planes, X for XY, Y for YZ, Z for XZ.

use super::skew::{ONLY, Skew, skew};
use super::{About, ExportedFile, Format, Writer, commented, fixed, rounded};
use crate::error::FileError;
use abbe_geometry::Vector3;

/// Length that deviations are given for (mm).
const SPAN_MM: f64 = 1000.0;
const DECIMALS: usize = 6;

pub(super) const FORMAT: Format = Format {
    name: "reprap-skew",
    title: "RepRapFirmware, M556 for config.g",
    source: "RepRapFirmware, Move: SetAxisCompensation and AxisTransform, with P0 (X follows Y) as it is by default",
    most_points: None,
    is_stepped: false,
    writer: Writer::Factors(write),
};

fn write(about: &About, offset_m: [f64; 3]) -> Result<Vec<ExportedFile>, FileError> {
    let written = |shear: f64| rounded(shear * SPAN_MM, DECIMALS) / SPAN_MM;
    let (found, words) = skew(&FORMAT, about, offset_m, written, moved)?;
    let units = format!(
        "mm over S mm; correction, the error with its sign turned: X of X by Y, Y of Y by Z, Z of X by Z; {ONLY}"
    );
    let mut text = commented(&about.lines(&FORMAT, &units, &words), ";");
    let over = |shear: f64| fixed(-shear * SPAN_MM, DECIMALS);
    text.push_str(&format!("M556 S{SPAN_MM} X{} Y{} Z{}\n", over(found.xy), over(found.yz), over(found.xz)));
    Ok(vec![ExportedFile { name: "skew.g".to_owned(), text }])
}

/// Where the firmware goes for a place.
fn moved(skew: &Skew, place: Vector3<f64>) -> Vector3<f64> {
    Vector3::new(place.x - place.y * skew.xy - place.z * skew.xz, place.y - place.z * skew.yz, place.z)
}
