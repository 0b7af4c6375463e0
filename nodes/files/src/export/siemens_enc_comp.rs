//! Siemens SINUMERIK leadscrew (encoder) error compensation: `$AA_ENC_COMP` values of each axis, `MD32450` beside.
//!
//! Place in the flow: one of [`super::FORMATS`]. The controller adds the value to the actual position, so that a positive one
//! moves the axis in the negative direction: the value is the error itself, actual − indicated. Linear between points, held beyond
//! them. `MD32450 BACKLASH` is positive where the encoder leads the machine part, which is a negative reversal value B.
//! The table holds approaches in +; in − the controller takes the backlash away. A B that changes along the axis has its mean
//! there, and what is left of it is said.

use super::steps::{Points, millimetres};
use super::{About, ExportedFile, Format, Writer, commented, fixed, missed_words, no_table_words};
use crate::error::FileError;
use abbe_geometry::sampled::{SampledAxis, SampledErrors};
use std::fmt::Write as _;

/// Decimals of mm.
const DECIMALS: usize = 7;
/// Steps are whole multiples of 0.1 um.
const STEPS_PER_METRE: f64 = 1e7;

/// What the controller wants of a table and nobody but the commissioner can see to.
const REFERENCE_POINT: &str = "reference point: K3 wants the value there to be zero; where it is not, the zero of the axis moves by that value \
                               when the table becomes active: subtract it from all values of the axis, or set the reference anew";

pub(super) const FORMAT: Format = Format {
    name: "siemens-enc-comp",
    title: "SINUMERIK $AA_ENC_COMP tables of AX1, AX2, AX3 (X, Y, Z), one part program that fills them",
    source: "Siemens function manual K3, \"Leadscrew error compensation\", and machine data 32450, 32700, 38000; names and signs \
             from there, not tried on a controller: axis numbers, memory (MD38000) and MD32450 are the commissioner's",
    most_points: None,
    is_stepped: false,
    writer: Writer::Positions(write),
};

fn write(about: &About, errors: &SampledErrors) -> Result<Vec<ExportedFile>, FileError> {
    let units = format!(
        "mm; values are actual - indicated of approaches in + (the controller adds them to the actual position, so a positive value moves the \
         axis in the negative direction); {}",
        about.positions_words()
    );
    let unknown = about.unknown(&FORMAT)?;
    let mut lines = about.lines(&FORMAT, &units, &missed_words(errors));
    lines.extend(about.tip_lines(errors, &unknown));
    lines.push(REFERENCE_POINT.to_owned());
    let mut text = commented(&lines, ";");
    for (number, axis) in (1..).zip(&errors.axes) {
        match unknown.contains(&axis.axis) {
            true => text.push_str(&commented(&[no_table_words(axis.axis)], ";")),
            false => table(about, number, axis, &mut text),
        }
    }
    text.push_str("M17\n");
    Ok(vec![ExportedFile { name: "enc_comp.spf".to_owned(), text }])
}

fn table(about: &About, number: usize, axis: &SampledAxis, text: &mut String) {
    let (plays_m, mean_m) = about.approach.reversals_m(axis);
    let left_m = plays_m.iter().map(|play_m| (play_m - mean_m).abs()).fold(0.0, f64::max);
    // Writing to a string cannot fail.
    let letter = axis.axis.letter();
    let _ = match about.approach.is_one_sided(axis.axis) {
        true => writeln!(
            text,
            "; axis {letter}: MD32450 BACKLASH[0] is not known, since one side of approach was not measured"
        ),
        false => writeln!(
            text,
            "; axis {letter}: MD32450 BACKLASH[0] = {}; of the reversal this leaves {:.4} um at most in approaches in -",
            fixed(-mean_m * 1e3, DECIMALS),
            left_m * 1e6
        ),
    };
    let forward_m: Vec<f64> =
        axis.errors.iter().zip(&plays_m).map(|(values, play_m)| values[axis.axis.index()] + play_m / 2.0).collect();
    let points = Points::of(axis, &forward_m, STEPS_PER_METRE);
    for (name, value_m) in [
        ("STEP", points.units / STEPS_PER_METRE),
        ("MIN", points.positions_m[0]),
        ("MAX", points.positions_m[points.positions_m.len() - 1]),
    ] {
        let _ = writeln!(text, "$AA_ENC_COMP_{name}[0,AX{number}]={}", millimetres(value_m, DECIMALS));
    }
    let _ = writeln!(text, "$AA_ENC_COMP_IS_MODULO[0,AX{number}]=0");
    for (k, value_m) in points.values.iter().enumerate() {
        let _ = writeln!(text, "$AA_ENC_COMP[0,{k},AX{number}]={}", fixed(value_m * 1e3, DECIMALS));
    }
}
