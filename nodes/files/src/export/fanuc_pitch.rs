//! Fanuc stored pitch error compensation: parameters 3620 to 3624, 1851, and the values of each point.
//!
//! Place in the flow: one of [`super::FORMATS`]. Values are increments: what is output on the way from the point before, so that
//! their sum up to a point is the correction there, indicated − actual. Whole multiples of 1 µm (detection unit) times the magnification
//! (3623), which is the smallest with which all increments of the axis lie within ±7; what rounding leaves at a point never exceeds half
//! of such a unit, since sums are rounded, not increments. The manuals say that a value is output at the
//! position that belongs to the section before its point, and not whether in a line or at once: with as many points as an axis holds, the
//! increments, by which an output at once is off between points, are as small as they can be. Points of an axis are
//! numbered upwards; the reference position is taken to be the lower end of the stroke. Parameter 1851 is the play.

use super::steps::{Points, millimetres};
use super::{
    About, ExportedFile, Format, Writer, check_points, commented, fixed, missed_words, no_table_words, refused,
};
use crate::error::FileError;
use abbe_geometry::sampled::{SampledAxis, SampledErrors};
use std::fmt::Write as _;

/// Detection unit (m).
const UNIT_M: f64 = 1e-6;
/// Largest increment that a point holds, in units of the magnification.
const LARGEST: f64 = 7.0;
/// Largest magnification (3623).
const LARGEST_MAGNIFICATION: u32 = 100;
/// Intervals between points are whole multiples of 1 um.
const INTERVALS_PER_METRE: f64 = 1e6;
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
    writer: Writer::Positions(write),
};

/// One axis.
struct Axis<'a> {
    sampled: &'a SampledAxis,
    points: Points,
    magnification: u32,
    /// What is put out on the way to each point but the first, in units of the magnification.
    increments: Vec<f64>,
}

fn write(about: &About, errors: &SampledErrors) -> Result<Vec<ExportedFile>, FileError> {
    let unknown = about.unknown(&FORMAT)?;
    let known = errors.axes.iter().filter(|axis| !unknown.contains(&axis.axis));
    let axes = known.map(|axis| Axis::of(about, axis)).collect::<Result<Vec<_>, _>>()?;
    let units = format!(
        "increments in um (detection unit 1 um) over the magnification of the axis (N3623), the correction, indicated - actual, of \
         approaches in + from the lower end on, where the reference position is taken to be; {}",
        about.positions_words()
    );
    let roundings: Vec<String> = axes
        .iter()
        .map(|axis| {
            let unit_um = f64::from(axis.magnification) * UNIT_M * 1e6;
            format!("of {unit_um} um miss by up to {} um more ({})", unit_um / 2.0, axis.sampled.axis.letter())
        })
        .collect();
    let step_um = axes.iter().map(Axis::largest_um).fold(0.0, f64::max);
    let missed = format!(
        "{}; whole increments {}; a controller that puts out an increment at once, at its point or anywhere on the \
         way to it, is off by up to {} um more there, and by nothing more at the points",
        missed_words(errors),
        roundings.join(", "),
        fixed(step_um, 0)
    );
    let mut lines = about.lines(&FORMAT, &units, &missed);
    lines.extend(about.tip_lines(errors, &unknown));
    let mut text = commented(&lines, "#");
    for (number, sampled) in errors.axes.iter().enumerate() {
        match axes.iter().find(|axis| axis.sampled.axis == sampled.axis) {
            None => text.push_str(&commented(&[no_table_words(sampled.axis)], "#")),
            Some(axis) => axis.table(about, number, &mut text),
        }
    }
    Ok(vec![ExportedFile { name: "pitch.txt".to_owned(), text }])
}

impl<'a> Axis<'a> {
    fn of(about: &About, sampled: &'a SampledAxis) -> Result<Axis<'a>, FileError> {
        check_points(&FORMAT, sampled)?;
        let (plays_m, _) = about.approach.reversals_m(sampled);
        let own = sampled.axis.index();
        let forward_m: Vec<f64> =
            sampled.errors.iter().zip(&plays_m).map(|(node, play_m)| node[own] + play_m / 2.0).collect();
        let points = Points::of(sampled, &forward_m, INTERVALS_PER_METRE);
        let fitting = (1..=LARGEST_MAGNIFICATION).find_map(|magnification| {
            let increments = increments(&points.values, f64::from(magnification) * UNIT_M);
            let is_held = increments.iter().all(|increment| increment.abs() <= LARGEST);
            is_held.then_some((magnification, increments))
        });
        let (magnification, increments) = fitting.ok_or_else(|| {
            let problem = format!(
                "axis {}: its error changes between two of {} points by more than {} um, which is what a point holds with the largest \
                 magnification (3623), {LARGEST_MAGNIFICATION}",
                sampled.axis.letter(),
                points.values.len(),
                LARGEST * f64::from(LARGEST_MAGNIFICATION) * UNIT_M * 1e6
            );
            let remedy = match points.values.len() < MOST_POINTS {
                true => "ask for a smaller step",
                false => "no table of this controller holds such errors: correct with abbe correct, or look at the machine",
            };
            refused(&FORMAT, problem, remedy)
        })?;
        Ok(Axis { sampled, points, magnification, increments })
    }

    /// The largest increment (um).
    fn largest_um(&self) -> f64 {
        let largest = self.increments.iter().fold(0.0, |most: f64, own| most.max(own.abs()));
        largest * f64::from(self.magnification) * UNIT_M * 1e6
    }

    fn table(&self, about: &About, number: usize, text: &mut String) {
        let (axis, count) = (self.sampled.axis, self.points.values.len());
        let letter = axis.letter();
        let (_, mean_m) = about.approach.reversals_m(self.sampled);
        let first = number * APART;
        // Writing to a string cannot fail.
        let _ = writeln!(text, "axis {letter}");
        let numbers = [(3620, first), (3621, first), (3622, first + count - 1), (3623, self.magnification as usize)];
        for (parameter, value) in numbers {
            let _ = writeln!(text, "N{parameter} {letter} {value}");
        }
        let _ = writeln!(text, "N3624 {letter} {} (mm)", millimetres(self.points.units / INTERVALS_PER_METRE, 3));
        let _ = match about.approach.is_one_sided(axis) {
            true => writeln!(text, "# axis {letter}: N1851 is not known, since one side of approach was not measured"),
            false => writeln!(text, "N1851 {letter} {} (um)", fixed(-mean_m / UNIT_M, 0)),
        };
        let _ = writeln!(text, "point {first} 0");
        for (k, increment) in (1..).zip(&self.increments) {
            let _ = writeln!(text, "point {} {}", first + k, fixed(*increment, 0));
        }
    }
}

/// What is put out on the way to each point but the first, in units: sums are rounded, so that nothing adds up.
fn increments(forward_m: &[f64], unit_m: f64) -> Vec<f64> {
    let sums: Vec<f64> = forward_m.iter().map(|own_m| ((forward_m[0] - own_m) / unit_m).round()).collect();
    sums.windows(2).map(|pair| pair[1] - pair[0]).collect()
}
