//! Fanuc stored pitch error compensation: parameters 3620 to 3624, 1851, and the values of each point.
//!
//! Place in the flow: one of [`super::FORMATS`]. Values are increments: what is output on the way from the point before, so that
//! their sum up to a point is the correction there, indicated − actual. Whole multiples of 1 µm (detection unit) within ±7; what
//! rounding leaves at a point never exceeds half a unit, since sums are rounded, not increments. The manuals say that a value is output at the
//! position that belongs to the section before its point, and not whether in a line or at once: with as many points as an axis holds, the
//! increments, by which an output at once is off between points, are as small as they can be. Points of an axis are
//! numbered upwards; the reference position is taken to be the lower end of the stroke. Parameter 1851 is the play.

use super::{
    About, ExportedFile, Format, Writer, check_points, commented, fixed, missed_words, no_table_words, refused,
};
use crate::error::FileError;
use crate::units::millimetres_from_m;
use abbe_geometry::sampled::{SampledAxis, SampledErrors};
use std::fmt::Write as _;

/// Detection unit (m).
const UNIT_M: f64 = 1e-6;
/// Largest increment, in units, that a point holds with magnification 1.
const LARGEST: f64 = 7.0;
/// Points that an axis holds between the ends of its stroke.
const MOST_POINTS: usize = 128;
/// Distance between the first points of two axes.
const APART: usize = 200;

pub(super) const FORMAT: Format = Format {
    name: "fanuc-pitch",
    title: "Fanuc stored pitch error compensation, parameters 3620 to 3624 and 1851, and increments by point number",
    source: "Fanuc parameter manuals (Series 0i B-63980, 21i B-63090: 1851, 3620 to 3624), increments, numbering and their output by sections from there; \
             the sign of increments (+ moves the axis in +) and the reference position could not be tried on a controller: \
             compare one point before use",
    most_points: Some(MOST_POINTS),
    is_stepped: true,
    writer: Writer::Approaches(write),
};

fn write(about: &About, errors: &SampledErrors) -> Result<Vec<ExportedFile>, FileError> {
    let units = "increments in um (detection unit 1 um), the correction, indicated - actual, of approaches in + from the lower \
                 end on, where the reference position is taken to be; positioning errors of each axis by itself, nothing else \
                 of the model";
    let step_um =
        errors.axes.iter().flat_map(|axis| increments(about, axis)).fold(0.0, |most: f64, own| most.max(own.abs()));
    let missed = format!(
        "{}; whole increments of 1 um miss by up to 0.5 um more; a controller that puts out an increment at once, at its point or anywhere on the \
         way to it, is off by up to {} um more there, and by nothing more at the points",
        missed_words(errors),
        fixed(step_um, 0)
    );
    let lines = about.lines(&FORMAT, units, &missed);
    let mut text = commented(&lines, "#");
    let unknown = about.unknown(&FORMAT)?;
    for (number, axis) in errors.axes.iter().enumerate() {
        match unknown.contains(&axis.axis) {
            true => text.push_str(&commented(&[no_table_words(axis.axis)], "#")),
            false => table(about, number, axis, &mut text)?,
        }
    }
    Ok(vec![ExportedFile { name: "pitch.txt".to_owned(), text }])
}

fn table(about: &About, number: usize, axis: &SampledAxis, text: &mut String) -> Result<(), FileError> {
    let (letter, points) = (axis.axis.letter(), axis.positions_m.len());
    check_points(&FORMAT, axis)?;
    let (_, mean_m) = about.approach.reversals_m(axis);
    let first = number * APART;
    let interval_m = (axis.positions_m[points - 1] - axis.positions_m[0]) / (points - 1) as f64;
    // Writing to a string cannot fail.
    let _ = writeln!(text, "axis {letter}");
    for (parameter, value) in [(3620, first), (3621, first), (3622, first + points - 1), (3623, 1)] {
        let _ = writeln!(text, "N{parameter} {letter} {value}");
    }
    let _ = writeln!(text, "N3624 {letter} {} (mm)", millimetres_from_m(interval_m));
    let _ = match about.approach.is_one_sided(axis.axis) {
        true => writeln!(text, "# axis {letter}: N1851 is not known, since one side of approach was not measured"),
        false => writeln!(text, "N1851 {letter} {} (um)", fixed(-mean_m / UNIT_M, 0)),
    };
    let _ = writeln!(text, "point {first} 0");
    for (k, increment) in (1..).zip(increments(about, axis)) {
        if increment.abs() > LARGEST {
            let problem = format!(
                "axis {letter}: {increment} um between {} and {} mm; a point holds {LARGEST}",
                fixed(axis.positions_m[k - 1] * 1e3, 4),
                fixed(axis.positions_m[k] * 1e3, 4)
            );
            return Err(refused(&FORMAT, problem, "ask for a smaller step"));
        }
        let _ = writeln!(text, "point {} {}", first + k, fixed(increment, 0));
    }
    Ok(())
}

/// What is put out on the way to each point but the first, in units: sums are rounded, so that nothing adds up.
fn increments(about: &About, axis: &SampledAxis) -> Vec<f64> {
    let (plays_m, _) = about.approach.reversals_m(axis);
    let forward = |k: usize| axis.errors[k][axis.axis.index()] + plays_m[k] / 2.0;
    let sum = |k: usize| ((forward(0) - forward(k)) / UNIT_M).round();
    (1..axis.positions_m.len()).map(|k| sum(k) - sum(k - 1)).collect()
}
