//! Klipper skew correction: a stored profile of `[skew_correction]`.
//!
//! Place in the flow: one of [`super::FORMATS`]. Klipper moves to x − y·xy − z·(xz − xy·yz) and y − z·yz, so its factors are the
//! shear of the errors, actual − indicated, as [`super::skew`] gives them.

use super::skew::{ONLY, Skew, skew};
use super::{About, ExportedFile, Format, Writer, commented, fixed, rounded};
use crate::error::FileError;
use abbe_geometry::Vector3;

const DECIMALS: usize = 9;

pub(super) const FORMAT: Format = Format {
    name: "klipper-skew",
    title: "Klipper, a profile of [skew_correction] for printer.cfg, loaded by SKEW_PROFILE LOAD=abbe",
    source: "Klipper, klippy/extras/skew_correction.py: calc_skew, and the stored profile that it reads",
    most_points: None,
    is_stepped: false,
    writer: Writer::Factors(write),
};

fn write(about: &About, offset_m: [f64; 3]) -> Result<Vec<ExportedFile>, FileError> {
    let (found, words) = skew(&FORMAT, about, offset_m, |shear| rounded(shear, DECIMALS), moved)?;
    let units = format!("mm/mm, error of X by Y, X by Z and Y by Z; {ONLY}");
    let mut text = commented(&about.lines(&FORMAT, &units, &words), "#");
    text.push_str("[skew_correction]\n\n[skew_correction abbe]\n");
    for (name, value) in [("xy_skew", found.xy), ("xz_skew", found.xz), ("yz_skew", found.yz)] {
        text.push_str(&format!("{name} = {}\n", fixed(value, DECIMALS)));
    }
    Ok(vec![ExportedFile { name: "skew.cfg".to_owned(), text }])
}

/// Where Klipper goes for a place.
fn moved(skew: &Skew, place: Vector3<f64>) -> Vector3<f64> {
    let Skew { xy, xz, yz } = skew;
    Vector3::new(place.x - place.y * xy - place.z * (xz - xy * yz), place.y - place.z * yz, place.z)
}
