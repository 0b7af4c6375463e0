//! LinuxCNC screw compensation: a `.comp` file a joint, three columns: nominal, forward, reverse.
//!
//! Place in the flow: one of [`super::FORMATS`]. `COMP_FILE_TYPE = 0`: forward and reverse are the positions that were really
//! reached when `nominal` was commanded, coming from below and from above; LinuxCNC adds nominal − reached to what it commands
//! the motor. Its reader stops at the first line that is no triplet of numbers, a comment too, so the head is a file of its own.

use super::{About, ExportedFile, Format, Writer, check_points, commented, fixed, missed_words};
use crate::error::FileError;
use crate::units::millimetres_from_m;
use abbe_geometry::sampled::{SampledAxis, SampledErrors};

/// Triplets that LinuxCNC keeps of a joint.
const MOST_POINTS: usize = 256;
/// Decimals of mm: below what a motor resolves.
const DECIMALS: usize = 7;

pub(super) const FORMAT: Format = Format {
    name: "linuxcnc-comp",
    title: "one x.comp, y.comp, z.comp a joint for COMP_FILE with COMP_FILE_TYPE = 0, and head.txt",
    source: "LinuxCNC, src/emc/motion: usrmotLoadComp reads the file, compute_screw_comp applies it; BACKLASH of such a joint \
             is not used, the reversal is in the columns; machine units must be mm",
    most_points: Some(MOST_POINTS),
    is_stepped: false,
    writer: Writer::Positions(write),
};

fn write(about: &About, errors: &SampledErrors) -> Result<Vec<ExportedFile>, FileError> {
    let units = format!(
        "mm; columns nominal, forward, reverse: the position commanded, and that reached coming from below and from above; {}",
        about.positions_words()
    );
    // An axis that the model says nothing of has no file: it is among those that were not identified.
    let unknown = about.unknown(&FORMAT)?;
    let mut lines = about.lines(&FORMAT, &units, &missed_words(errors));
    lines.extend(about.tip_lines(errors, &unknown));
    let mut files = vec![ExportedFile { name: "head.txt".to_owned(), text: commented(&lines, "#") }];
    for axis in errors.axes.iter().filter(|axis| !unknown.contains(&axis.axis)) {
        files.push(table(about, axis)?);
    }
    Ok(files)
}

fn table(about: &About, axis: &SampledAxis) -> Result<ExportedFile, FileError> {
    check_points(&FORMAT, axis)?;
    let row = |(position_m, values): (&f64, &[f64; 6])| {
        let own_m = values[axis.axis.index()];
        let half_m = about.approach.reversal_m(axis.axis, *position_m) / 2.0;
        let reached = |error_m: f64| fixed((position_m + error_m) * 1e3, DECIMALS);
        format!("{} {} {}\n", millimetres_from_m(*position_m), reached(own_m + half_m), reached(own_m - half_m))
    };
    let text = axis.positions_m.iter().zip(&axis.errors).map(row).collect();
    Ok(ExportedFile { name: format!("{}.comp", axis.axis.lower()), text })
}
