//! Exports of an identified model for controllers and other software: one file a format, one line each in [`FORMATS`].
//!
//! Place in the flow: model → sampled error functions or a grid of errors → texts, which `abbe export` writes. Every file
//! says in its head what its numbers mean: sign, unit, reference point, order, by how much interpolation between its nodes
//! misses the model, and what of the model it does not hold. Values are errors, actual − indicated; a controller that
//! wants corrections of its set points needs the other sign.
//!
//! What a table of positions cannot hold (effects beyond geometry, residual networks) is left out and named.

mod approach;
mod csv;
mod eight_corners;
mod etalon_exchange;
mod fanuc_pitch;
mod heidenhain_style;
mod isg_csv;
mod klipper_skew;
mod left_out;
mod linuxcnc_comp;
mod reprap_skew;
mod said;
mod siemens_enc_comp;
mod skew;
mod steps;
mod tip;
mod volume;
mod volumetric_grid;

pub use approach::Approach;
pub use tip::{LARGER, TIP};

use crate::error::{FileError, Place};
use crate::machine::SIGN_CONVENTION;
use crate::model_contents::ModelFile;
use abbe_field::Table;
use abbe_geometry::Vector3;
use abbe_geometry::axis::{Axis, ErrorId};
use abbe_geometry::chain::nominal_point_m;
use abbe_geometry::effects::{Shape, ShapeValue, known};
use abbe_geometry::machine::{Machine, Side};
use abbe_geometry::model::MachineModel;
use abbe_geometry::sampled::{SampledAxis, SampledErrors, beyond_identified, errors_of, of_position, places_effects_m};
use said::{held_at_zero, is_said_along, is_sign};

pub use abbe_geometry::sampled::of_places;

/// A format.
#[derive(Debug)]
pub struct Format {
    /// Name on the command line; that of its file with `-` for `_`.
    pub name: &'static str,
    /// What it is, in a line.
    pub title: &'static str,
    /// Where the format is described, or that it could not be checked against the vendor's description.
    pub source: &'static str,
    /// Nodes that it holds of an axis, where that is limited.
    pub most_points: Option<usize>,
    /// Whether a controller may put out each value at its point in place of on the way to it.
    pub is_stepped: bool,
    /// What it is made from, and how.
    pub writer: Writer,
}

impl Format {
    /// Whether it holds so many nodes of every axis.
    pub fn holds(&self, errors: &SampledErrors) -> bool {
        let is_within = |axis: &SampledAxis| self.most_points.is_none_or(|most| axis.positions_m.len() <= most);
        errors.axes.iter().all(is_within)
    }
}

/// How a format is written.
#[derive(Debug, Clone, Copy)]
pub enum Writer {
    /// From the error functions of each axis.
    Functions(fn(&About, &SampledErrors) -> Result<Vec<ExportedFile>, FileError>),
    /// From the error functions of each axis, and what depends on the side it comes from.
    Approaches(fn(&About, &SampledErrors) -> Result<Vec<ExportedFile>, FileError>),
    /// The same of nothing but the positioning of each axis, which is one at the pivots or for a tip.
    Positions(fn(&About, &SampledErrors) -> Result<Vec<ExportedFile>, FileError>),
    /// From the errors at the nodes of a grid.
    Grid(fn(&About, &SampledGrid) -> Result<Vec<ExportedFile>, FileError>),
    /// A few factors for the whole volume, from the error of a tip at this offset (m, ram frame).
    Factors(fn(&About, [f64; 3]) -> Result<Vec<ExportedFile>, FileError>),
}

impl Writer {
    /// Whether what it writes holds effects of position that no function of one axis holds.
    fn holds_places(self) -> bool {
        matches!(self, Writer::Grid(_) | Writer::Factors(_))
    }

    /// Whether what it writes holds what depends on the side that an axis comes from.
    fn holds_approaches(self) -> bool {
        matches!(self, Writer::Approaches(_) | Writer::Positions(_))
    }
}

/// One file of an export.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExportedFile {
    /// Name, without folder.
    pub name: String,
    /// Content.
    pub text: String,
}

/// All formats.
pub const FORMATS: &[Format] = &[
    csv::FORMAT,
    etalon_exchange::FORMAT,
    isg_csv::FORMAT,
    heidenhain_style::FORMAT,
    volumetric_grid::FORMAT,
    eight_corners::FORMAT,
    siemens_enc_comp::FORMAT,
    fanuc_pitch::FORMAT,
    linuxcnc_comp::FORMAT,
    klipper_skew::FORMAT,
    reprap_skew::FORMAT,
];

/// The format of that name.
pub fn format(name: &str) -> Option<&'static Format> {
    FORMATS.iter().find(|format| format.name == name)
}

/// Ends of lines in Unicode that are no control characters.
const LINE_ENDS: [char; 2] = ['\u{2028}', '\u{2029}'];

/// What stands in the head of every file.
#[derive(Debug, Clone)]
pub struct About {
    /// The machine.
    pub machine: Machine,
    /// The model.
    model: MachineModel,
    /// SHA-256 of the model, hexadecimal.
    pub model_sha256: String,
    /// Program that writes.
    pub software: String,
    /// Turn of the ram (rad), and the offset about which it acts (m, ram frame).
    pub ram_turn: ([f64; 3], [f64; 3]),
    /// Reversal of each axis.
    pub approach: Approach,
    /// Axes whose stroke goes beyond what was identified of them, with that (m).
    beyond_m: Vec<(Axis, (f64, f64))>,
    /// Axes whose positioning error holds effects of position beside the error function.
    with_effects: Vec<Axis>,
    /// What of the model does not fit into a table of positions.
    left_out: Vec<String>,
    /// What fits into one that knows the side of approach.
    of_approach: Vec<String>,
    /// What fits into a grid of errors, and into no function of one axis.
    of_places: Vec<String>,
    /// Errors of which the model says nothing: zero, with no uncertainty that means anything.
    held_at_zero: Vec<String>,
    /// Axes of whose positioning an effect says something.
    with_any: Vec<Axis>,
    /// Tip that tables of one axis are judged for (m, ram frame): the machine's, or the middle of those that were measured.
    tip_m: [f64; 3],
    /// Whether they are made for it.
    is_for_tip: bool,
}

/// Errors on a grid of readings.
#[derive(Debug, Clone)]
pub struct SampledGrid {
    /// Errors of tip or reflector at the nodes: readings X, Y, Z (m), actual − indicated (m).
    pub table: Table,
    /// What trilinear interpolation between the nodes misses at most, over all directions (m).
    pub missed_m: f64,
    /// Tip or reflector for which it holds (m, ram frame).
    pub offset_m: [f64; 3],
}

impl About {
    /// Of a model file with this SHA-256.
    pub fn new(file: &ModelFile, sha256: &[u8; 32], software: &str) -> About {
        let (approach, held) = Approach::of(&file.model);
        let (mut left_out, mut of_approach, mut of_grid) = (Vec::new(), Vec::new(), Vec::new());
        let (of_position, with_effects): (Vec<usize>, Vec<Axis>) = of_position(&file.model).into_iter().unzip();
        let of_places = of_places(&file.model);
        let tip_m = file.model.parts().machine.default_offset_m.unwrap_or(file.model.parts().offset_centre_m);
        // What stands in the uncertainty alone is in no correction either.
        let correcting = file.model.parts().effects.iter().enumerate().filter(|(_, fitted)| fitted.corrects());
        for (place, fitted) in correcting {
            let name = fitted.effect.name();
            let title = known(name).map_or_else(|| name.to_owned(), |known| format!("{} ({name})", known.title));
            // Effects of one name differ in what they follow: one of position is in the table, one of time is not.
            let follows = fitted.effect.reads();
            let title = match follows.is_empty() {
                true => title + &shape_words(&fitted.shape),
                false => format!("{title} by {}{}", follows.join(", "), left_out::words(&file.model, fitted, tip_m)),
            };
            match () {
                // It is said of the side itself.
                () if approach.is_untold(place) => {}
                () if held.contains(&place) => of_approach.push(title),
                () if of_position.contains(&place) => {}
                () if of_places.contains(&place) => of_grid.push(title),
                () => left_out.push(title),
            }
        }
        let with_any: Vec<Axis> = Axis::ALL.into_iter().filter(|axis| is_said_along(&file.model, *axis)).collect();
        let network = file.residual_network.iter().map(|network| format!("residual network {}", network.file));
        About {
            machine: file.model.parts().machine.clone(),
            model: file.model.clone(),
            model_sha256: crate::envelope::hex(sha256),
            software: software.to_owned(),
            ram_turn: (file.model.ram_turn().map(|(angle_rad, _)| angle_rad), file.model.parts().offset_centre_m),
            approach,
            beyond_m: beyond_identified(&file.model).collect(),
            held_at_zero: held_at_zero(&file.model, &with_any),
            with_any,
            tip_m,
            is_for_tip: false,
            with_effects,
            left_out: left_out.into_iter().chain(network).collect(),
            of_approach,
            of_places: of_grid,
        }
    }

    /// What of the model tables of this format do not hold.
    pub fn left_out(&self, format: &Format) -> impl Iterator<Item = &String> {
        let of_approach = (!format.writer.holds_approaches()).then_some(&self.of_approach);
        let of_places = (!format.writer.holds_places()).then_some(&self.of_places);
        self.left_out.iter().chain(of_approach.into_iter().chain(of_places).flatten())
    }

    /// What must not be taken for measured: errors that were not identified, and sides of approach that nobody measured.
    pub fn not_measured(&self, format: &Format) -> Vec<String> {
        let mut words = Vec::new();
        if !self.held_at_zero.is_empty() {
            let names = self.held_at_zero.join(" ");
            words.push(match format.writer.holds_places() && !self.of_places.is_empty() {
                true => format!(
                    "NOT identified as error functions: {names}; of what they would do, only this is here, and nothing else was measured: {}",
                    self.of_places.join("; ")
                ),
                false => format!(
                    "NOT identified: {names}; they are zero here because the model says nothing of them, and have no uncertainty"
                ),
            });
        }
        words.extend(self.approach.not_measured());
        words
    }

    /// Whether the model says nothing of where an axis stops: a table of zeros would take away what a controller has.
    fn is_unknown(&self, axis: Axis) -> bool {
        !self.is_identified(&ErrorId::linear(axis, axis).name()) && !self.with_any.contains(&axis)
    }

    /// Axes whose table lies wholly outside the readings that were identified, among those of which the model says something.
    pub fn axes_outside(&self) -> Vec<Axis> {
        let is_outside = |axis: &Axis| {
            let (stroke_m, seen_m) =
                (self.machine.stroke_m[axis.index()], self.model.parts().identified.reading_m[axis.index()]);
            self.is_any_known(*axis) && (seen_m.1 < stroke_m.0 || seen_m.0 > stroke_m.1)
        };
        Axis::ALL.into_iter().filter(is_outside).collect()
    }

    /// Whether the model says anything of the motion of an axis.
    pub fn is_any_known(&self, axis: Axis) -> bool {
        let tilts = self.machine.squareness.iter().filter(|entry| entry.tilts == axis);
        let names = errors_of(axis).map(|error| error.name()).into_iter();
        !self.is_unknown(axis)
            || names.chain(tilts.map(|entry| entry.name.clone())).any(|name| self.is_identified(&name))
    }

    /// Axes that the model says nothing of, of which controllers get no table.
    ///
    /// # Errors
    /// A model that says nothing of any.
    fn unknown(&self, format: &Format) -> Result<Vec<Axis>, FileError> {
        self.axes_without(format, |axis| self.is_unknown(axis))
    }

    /// The same for tables of all six errors of an axis, and of the squareness that tilts it.
    fn wholly_unknown(&self, format: &Format) -> Result<Vec<Axis>, FileError> {
        self.axes_without(format, |axis| !self.is_any_known(axis))
    }

    fn axes_without(&self, format: &Format, is_unknown: impl Fn(Axis) -> bool) -> Result<Vec<Axis>, FileError> {
        let unknown: Vec<Axis> = Axis::ALL.into_iter().filter(|axis| is_unknown(*axis)).collect();
        if unknown.len() == Axis::ALL.len() {
            let problem = "the model says nothing of the positioning of any axis along itself".to_owned();
            return Err(refused(
                format,
                problem,
                "measure positioning runs or a tracer campaign, or correct with abbe correct",
            ));
        }
        Ok(unknown)
    }

    /// Whether this error, squareness or motion was identified.
    pub(crate) fn is_identified(&self, name: &str) -> bool {
        !self.held_at_zero.iter().any(|own| own == name)
    }

    /// Of which axes the reversal is in the tables.
    fn approach_words(&self) -> String {
        let known = Axis::ALL.into_iter().filter(|axis| self.approach.has(*axis));
        let letters: String = known.map(Axis::letter).collect();
        let which = if letters.is_empty() { "none; the model has no reversal of any axis".to_owned() } else { letters };
        format!("reversal: contained for axes: {which}")
    }

    /// Lines of the head, without marks of comments.
    fn lines(&self, format: &Format, units: &str, missed: &str) -> Vec<String> {
        let side = |wanted: Side| {
            let axes = self.machine.joints.iter().filter(|joint| joint.side == wanted);
            let letters: String = axes.map(|joint| joint.axis.letter()).collect();
            if letters.is_empty() { "none".to_owned() } else { letters }
        };
        let mut lines = vec![
            format!("{}: {}", format.name, format.title),
            format!("machine {}, model sha256 {}, written by {}", self.machine.name, self.model_sha256, self.software),
            format!("sign: {SIGN_CONVENTION}"),
            format!(
                "chain: workpiece side {}, tool side {}, each from the bed outwards",
                side(Side::Workpiece),
                side(Side::Tool)
            ),
            self.lever_words(),
            format!("units: {units}"),
            match format.writer {
                Writer::Factors(_) => format!("fit: {missed}"),
                _ => format!("interpolation: {missed}"),
            },
            format!("ram: {}", self.ram_words(format.writer)),
            format!("format: {}", format.source),
        ];
        if !matches!(format.writer, Writer::Factors(_)) {
            lines.extend(self.beyond_words());
        }
        lines.extend(self.not_measured(format));
        lines.extend(self.left_out(format).map(|what| format!("NOT in this table, and not corrected by it: {what}")));
        if format.writer.holds_approaches() {
            lines.push(self.approach_words());
        }
        lines
    }

    /// What the rotations of each axis turn: the vector from their pivot to the tip. It follows the chain ([`abbe_geometry::chain`]): an axis
    /// on the tool side turns what it carries, one on the workpiece side all that stands between the tool and its table.
    fn lever_words(&self) -> String {
        let joints = &self.machine.joints;
        let place_of = |axis: Axis| joints.iter().position(|joint| joint.axis == axis).unwrap_or_default();
        let levers = Axis::ALL.map(|axis| {
            let place = place_of(axis);
            let is_in = |other: Axis| place_of(other) > place || other == axis && joints[place].side == Side::Workpiece;
            let parts = Axis::ALL.map(|other| {
                let lower = other.lower();
                if is_in(other) { format!("o{lower} + {lower}") } else { format!("o{lower}") }
            });
            format!("{} turns ({})", axis.letter(), parts.join(", "))
        });
        format!(
            "rotations: right-handed, each about a pivot of its own: error of the tip = sum of linear errors + angular errors x lever, where {}; \
             o is the offset of the tip (ram frame), x y z are readings",
            levers.join(", ")
        )
    }

    /// What the ends of the strokes are worth where they were not measured.
    fn beyond_words(&self) -> impl Iterator<Item = String> {
        self.beyond_m.iter().map(|(axis, (lower_m, upper_m))| {
            let [lower, upper] = [lower_m, upper_m].map(|m| fixed(m * 1e3, 4));
            format!(
                "NOT measured: {} below {lower} and above {upper} mm; nodes there rest on no reading: positioning effects and \
                 reversals keep the value of the nearer end, error functions are only continued",
                axis.letter()
            )
        })
    }

    /// How the ram stands, which error functions of positions cannot hold.
    fn ram_words(&self, writer: Writer) -> String {
        let (angles_rad, about_m) = self.ram_turn;
        let turn = angles_rad.map(|angle_rad| format!("{:.3}", angle_rad * 1e6)).join(" ");
        let about = about_m.map(|v| fixed(v * 1e3, 4)).join(" ");
        let how = format!("turned by {turn} urad about X Y Z, acting about the offset {about} mm (ram frame)");
        match writer {
            Writer::Grid(_) => format!("{how}; contained in these errors"),
            Writer::Factors(_) => {
                format!("{how}; it shifts all points of a tip alike, which no such factor takes away")
            }
            Writer::Functions(_) | Writer::Approaches(_) | Writer::Positions(_) => format!(
                "{how}; NOT in the error functions: a tip at another offset stands off by turn x (its offset - that offset), \
                 the same everywhere: correct the offset of each tool by it"
            ),
        }
    }

    /// Zero of the error functions.
    fn reference(&self) -> String {
        let ends = Axis::ALL.map(|axis| {
            format!("{} {}", axis.letter(), crate::units::millimetres_from_m(self.machine.stroke_m[axis.index()].0))
        });
        format!(
            "every error{} is zero at the lower end of its stroke ({} mm), straightness also at the upper end; squareness turns \
             the motion of an axis, not the tool, from there on",
            self.but_effects(),
            ends.join(", ")
        )
    }

    /// Errors that are not zero at the lower end, in words; empty where all are.
    fn but_effects(&self) -> String {
        let own = Axis::ALL.into_iter().filter(|axis| self.with_effects.contains(axis));
        match own.map(Axis::letter).collect::<String>() {
            own if own.is_empty() => own,
            own => format!(" but positioning of {own}, which holds effects of position as well,"),
        }
    }
}

/// What a shape says of axes and quantities: `, acts y, p x_m`.
fn shape_words(shape: &Shape) -> String {
    let word = |(key, value): (&String, &ShapeValue)| match value {
        ShapeValue::Text(text) => Some(format!(", {key} {text}")),
        ShapeValue::Number(_) | ShapeValue::Numbers(_) | ShapeValue::Texts(_) => None,
    };
    shape.0.iter().filter_map(word).collect()
}

/// Error of a model at a reading (m): actual − indicated, with these of its effects, which need nothing logged ([`of_places`]), without all
/// others.
pub fn geometric_error_m(
    model: &MachineModel,
    effects: &[usize],
    reading_m: [f64; 3],
    offset_m: [f64; 3],
) -> Vector3<f64> {
    let parts = model.parts();
    let actual_m = model.layout().position_m(&parts.machine, &parts.coefficients, reading_m, offset_m);
    actual_m - nominal_point_m(reading_m, offset_m) + places_effects_m(model, effects, reading_m, offset_m)
}

/// Why an axis has no table.
fn no_table_words(axis: Axis) -> String {
    format!("axis {}: the model says nothing of it, so that it has no table", axis.letter())
}

/// `// line` for every line. What a controller may take for the end of one inside an entry begins another comment.
pub(crate) fn commented(lines: &[String], mark: &str) -> String {
    let lines = lines.iter().flat_map(|line| line.split(|sign: char| sign.is_control() || LINE_ENDS.contains(&sign)));
    lines.map(|line| format!("{mark} {line}\n")).collect()
}

/// What squareness moves at this distance from the lower end (m): angle · (about × axis) · distance.
fn tilted_m(about: &About, errors: &SampledErrors, axis: Axis, distance_m: f64) -> [f64; 3] {
    let own = about.machine.squareness.iter().zip(&errors.squareness).filter(|(entry, _)| entry.tilts == axis);
    let moved =
        own.map(|(entry, (_, angle, _))| entry.about.direction().cross(&axis.direction()) * (angle * distance_m));
    moved.fold([0.0; 3], |sum, m| [sum[0] + m.x, sum[1] + m.y, sum[2] + m.z])
}

/// What linear interpolation misses, in words.
fn missed_words(errors: &SampledErrors) -> String {
    let (linear_m, angular_rad) = errors.missed();
    format!(
        "linear between the nodes misses the model by at most {:.4} um (linear errors) and {:.4} urad (angular errors); steps of \
         {} mm",
        linear_m * 1e6,
        angular_rad * 1e6,
        steps_mm(errors.axes.iter().map(|axis| axis.positions_m.as_slice()))
    )
}

/// Largest step of X, Y and Z in mm.
fn steps_mm<'a>(axes_m: impl Iterator<Item = &'a [f64]>) -> String {
    let step = |nodes: &[f64]| nodes.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
    let steps: Vec<String> = axes_m.map(|nodes| format!("{:.4}", step(nodes) * 1e3)).collect();
    steps.join(", ")
}

/// What trilinear interpolation misses, and for which tip, in words.
fn grid_words(grid: &SampledGrid) -> String {
    let offset = grid.offset_m.map(|v| crate::units::millimetres_from_m(v).to_string());
    format!(
        "trilinear between the nodes misses the model by at most {:.4} um a direction; steps of at most {} mm; holds for a tip \
         or reflector at {} mm (ram frame)",
        grid.missed_m * 1e6,
        steps_mm(grid.table.grid().axes_m().iter().map(Vec::as_slice)),
        offset.join(" ")
    )
}

/// An axis that has more nodes than a format holds is refused.
fn check_points(format: &Format, axis: &SampledAxis) -> Result<(), FileError> {
    let points = axis.positions_m.len();
    match format.most_points {
        Some(most) if points > most => {
            let problem = format!("axis {} would have {points} points; {most} are the most", axis.axis.letter());
            Err(refused(format, problem, "ask for a larger step"))
        }
        _ => Ok(()),
    }
}

fn refused(format: &Format, problem: String, remedy: &str) -> FileError {
    FileError::content(Place::file(format.name), problem, remedy)
}

/// A number as it is with so many decimals.
fn rounded(value: f64, decimals: usize) -> f64 {
    let units = 10.0_f64.powi(decimals as i32);
    (value * units).round() / units
}

/// A number with so many decimals and no negative zero.
fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(rest) if rest.bytes().all(|b| matches!(b, b'0' | b'.')) => rest.to_owned(),
        _ => text,
    }
}
