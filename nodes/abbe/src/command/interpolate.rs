//! `abbe interpolate`: measured error vectors in, the error at any other point out, or scores of all methods.
//!
//! Place in the flow: without a model of the machine, straight from measured points (`abbe points`, or any calibration). The
//! methods are those of `abbe_field`; scores are of points that did not interpolate (Chen 2020 eq. 14-19). Vectors of a plate
//! are interpolated in its plane; a point beside it has no answer. Before any method sees them the vectors are held against each
//! other ([`held`]): single ones that contradict all others are named and left out.

mod held;

use crate::exit::Ended;
use crate::next::Next;
use crate::output;
use crate::plane_field::{PlaneField, plane_field};
use abbe_field::idw::{EXPONENT, Idw, Reference};
use abbe_field::kriging::AveragedKriging;
use abbe_field::rbf::{Radial, Rbf};
use abbe_field::scores::{INTERPOLATING_SHARE, Score, score, split};
use abbe_field::{Interpolator, MeasuredField, OnPlane, Trilinear, Unanswered};
use abbe_files::{ErrorVector, Lacks, is_one_tip, offset_words, read_plane_positions_file, write_plane_errors};
use abbe_geometry::Axis;
use abbe_measurement::correspondence::check_vectors;
use abbe_report::digits;
use abbe_runtime::Shutdown;
use anyhow::{Context, bail, ensure};
use clap::ValueEnum;
use serde_json::json;
use std::path::PathBuf;

/// Micrometres in a metre.
const UM: f64 = 1e6;

/// Arguments of `interpolate`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// CSV with measured error vectors: x_mm, y_mm, z_mm, res_x_um, res_y_um, res_z_um, optionally u_x_um, u_y_um, u_z_um; of a
    /// plate one position and one component may be missing
    #[arg(long)]
    vectors: PathBuf,
    /// CSV with the points to answer: the positions that the vectors have
    #[arg(long, requires = "out", conflicts_with = "splits")]
    at: Option<PathBuf>,
    /// CSV to write: the points with error, uncertainty where the method has one, and status
    #[arg(long, requires = "at")]
    out: Option<PathBuf>,
    /// Method for --at; scores are of all methods
    #[arg(long, value_enum, default_value_t = Method::Kriging)]
    method: Method,
    /// Neighbours of idw-nearest
    #[arg(long, default_value_t = 8)]
    neighbours: usize,
    /// Radius of idw-within
    #[arg(long)]
    radius_mm: Option<f64>,
    /// Score all methods on so many random splits of the measured points
    #[arg(long, required_unless_present = "at")]
    splits: Option<u64>,
    /// Share of the points that interpolates in a split
    #[arg(long, default_value_t = INTERPOLATING_SHARE)]
    share: f64,
    /// Seed of the first split
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Prints what was found as JSON instead of text
    #[arg(long, requires = "at")]
    json: bool,
}

impl Arguments {
    /// Whether methods are scored, split after split, of which those done are kept on Ctrl-C.
    pub(crate) fn is_scored(&self) -> bool {
        self.splits.is_some()
    }
}

/// A method of interpolation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Method {
    /// Inverse square distances over the smallest enclosing hexahedron
    Idw,
    /// Inverse square distances over the nearest points
    IdwNearest,
    /// Inverse square distances over all points within a radius
    IdwWithin,
    /// Trilinear in the smallest enclosing box of measured points; bilinear in a plane
    Trilinear,
    /// Thin plate (r² ln r) with a linear part
    ThinPlate,
    /// Cubic radial functions (r³) with a linear part
    Cubic,
    /// Gaussian process, covariance and noise fitted; gives an uncertainty
    Kriging,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let inputs = arguments.at.iter().chain([&arguments.vectors]).map(PathBuf::as_path);
    output::check(arguments.out.as_deref(), inputs)?;
    let read = read(arguments)?;
    match (&arguments.at, &arguments.out, arguments.splits) {
        (Some(at), Some(out), _) => answer(arguments, &read, at, out),
        (_, _, Some(splits)) => {
            let held = held::hold(&arguments.vectors, &read, false)?;
            held.say();
            score_all(arguments, (&held.field, read.lacks), splits)
        }
        _ => anyhow::bail!("name points with --at and a file with --out, or a number of --splits"),
    }
}

fn read(arguments: &Arguments) -> anyhow::Result<PlaneField> {
    let read = plane_field(&arguments.vectors)?;
    check_vectors(read.field.errors_m(), false).with_context(|| arguments.vectors.display().to_string())?;
    if let Some(plane) = read.field.plane()
        && !arguments.json
    {
        let axis = Axis::ALL[plane.normal];
        let missing = match read.lacks.error {
            Some(axis) => format!("; component {} was not measured", axis.lower()),
            None => String::new(),
        };
        println!("{}: a plane across {}{missing}", arguments.vectors.display(), axis.letter());
    }
    Ok(read)
}

fn build(arguments: &Arguments, method: Method, field: &MeasuredField) -> anyhow::Result<Box<dyn Interpolator>> {
    let idw = |reference| Idw::new(field, reference, EXPONENT);
    let method: Box<dyn Interpolator> = match method {
        Method::Idw => Box::new(idw(Reference::Hexahedron)?),
        Method::IdwNearest => Box::new(idw(Reference::Nearest(arguments.neighbours))?),
        Method::IdwWithin => {
            let radius_mm = arguments.radius_mm.context("idw-within needs a radius; give --radius-mm")?;
            Box::new(idw(Reference::Within { radius_m: radius_mm / 1e3 })?)
        }
        Method::Trilinear => Box::new(Trilinear::new(field)),
        Method::ThinPlate => Box::new(Rbf::new(field, Radial::ThinPlate, 0.0)?),
        Method::Cubic => Box::new(Rbf::new(field, Radial::Cubic, 0.0)?),
        Method::Kriging => Box::new(AveragedKriging::fit(field, &held::options(field))?),
    };
    Ok(Box::new(OnPlane::new(field, method)))
}

fn answer(arguments: &Arguments, read: &PlaneField, at: &std::path::Path, out: &std::path::Path) -> anyhow::Result<()> {
    let lacks = read.lacks;
    let positions = read_plane_positions_file(at)?;
    if let (given, wanted) = (positions.lacks, lacks.position)
        && given != wanted
    {
        let word = |axis: Option<Axis>| axis.map_or("x, y and z".to_owned(), |axis| format!("no {}", axis.lower()));
        bail!(
            "{}: the points have {}, the vectors {}; give both the same columns",
            at.display(),
            word(given),
            word(wanted)
        );
    }
    check_tip(&at.display().to_string(), &positions.tips_m, read.tip_m)?;
    let named = || arguments.vectors.display().to_string();
    let mut held = held::hold(&arguments.vectors, read, arguments.method == Method::Kriging)?;
    held.say();
    let method: Box<dyn Interpolator> = match held.kriging.take().filter(|_| arguments.method == Method::Kriging) {
        Some(kriging) => Box::new(OnPlane::new(&held.field, Box::new(kriging))),
        None => build(arguments, arguments.method, &held.field).with_context(named)?,
    };
    let vectors: Vec<ErrorVector> =
        positions.rows.into_iter().map(|position_m| one(method.as_ref(), position_m)).collect();
    write_plane_errors(out, &vectors, lacks)?;
    let count = |status: &str| vectors.iter().filter(|v| v.status == Some(status)).count();
    let is_plane = held.field.plane().is_some();
    if arguments.json {
        let statuses = ["interpolated", "extrapolated", "no_answer", "outside"];
        let counts: serde_json::Map<_, _> =
            statuses.map(|name| (name.to_owned(), count(name).into())).into_iter().collect();
        println!("{}", serde_json::to_string_pretty(&json!({ "points": counts, "vectors": held.json() }))?);
    } else {
        println!(
            "{}: {} points among the measured ones, {} beyond them (extrapolated), {} without answer{}",
            out.display(),
            count("interpolated"),
            count("extrapolated"),
            count("no_answer"),
            if is_plane { format!(", {} off the plane (outside)", count("outside")) } else { String::new() }
        );
        if vectors.iter().any(|vector| vector.u_m.is_some()) {
            println!("u (k = 1) is of the field at each point; a single vector measured there scatters beside it");
        }
    }
    if count("interpolated") < vectors.len() {
        let first = |status: &str| vectors.iter().position(|v| v.status == Some(status)).map(|k| k + 1);
        let kind =
            |status: &'static str| first(status).map(|row| format!("{} {status} (first: row {row})", count(status)));
        let kinds: Vec<String> = ["extrapolated", "no_answer", "outside"].into_iter().filter_map(kind).collect();
        eprintln!("abbe: warning: {}: {} of {} points", at.display(), kinds.join(", "), vectors.len());
    }
    if !arguments.json {
        Next::new("to see what each method is worth on points left out", "interpolate")
            .file("--vectors", &arguments.vectors)
            .text("--splits 20")
            .print();
    }
    ensure!(
        count("interpolated") > 0,
        Ended::nothing_inside(format!("{}: no point lies among the measured ones", at.display()))
    );
    Ok(())
}

/// Refuses points of another tip than that of the vectors, and of several: a field of the position is that of one.
fn check_tip(at: &str, asked_m: &[[f64; 3]], measured_m: Option<[f64; 3]>) -> anyhow::Result<()> {
    let words = || asked_m.iter().take(3).map(|tip_m| offset_words(*tip_m)).collect::<Vec<_>>().join(", ");
    ensure!(
        asked_m.len() < 2,
        "{at}: the points are of {} tips, whose offsets from the ram reference point differ ({}{}), and vectors are of one, as axes that turn \
         move each tip by its own lever; ask for one tip at a time, with its vectors (abbe points --offset-mm X,Y,Z), or correct with abbe correct",
        asked_m.len(),
        words(),
        if asked_m.len() > 3 { ", …" } else { "" }
    );
    if let (Some(asked_m), Some(measured_m)) = (asked_m.first(), measured_m) {
        ensure!(
            is_one_tip(*asked_m, measured_m),
            "{at}: the points are of a tip with the offset {} from the ram reference point, the vectors of one with {}, and axes that turn move \
             each by its own lever; give vectors of that tip (abbe points --offset-mm X,Y,Z), or correct with abbe correct",
            words(),
            offset_words(measured_m)
        );
    }
    Ok(())
}

fn one(method: &dyn Interpolator, position_m: [f64; 3]) -> ErrorVector {
    match method.at(&position_m.into()) {
        Ok(found) => ErrorVector {
            position_m,
            offset_m: None,
            error_m: Some(found.error_m.into()),
            u_m: found.u_m.map(Into::into),
            status: Some(if found.region.is_inside() { "interpolated" } else { "extrapolated" }),
        },
        // Nothing was measured across a plane.
        Err(Unanswered::OffPlane { .. }) => {
            ErrorVector { position_m, offset_m: None, error_m: None, u_m: None, status: Some("outside") }
        }
        // A position that was read from a file is finite; what is left are methods without an answer there.
        Err(Unanswered::NotFinite | Unanswered::NoPointWithin { .. } | Unanswered::NoHexahedron) => {
            ErrorVector { position_m, offset_m: None, error_m: None, u_m: None, status: Some("no_answer") }
        }
    }
}

/// Sums of scores over the splits.
#[derive(Default)]
struct Total {
    scores: Vec<Score>,
    answered: usize,
    unanswered: usize,
}

fn score_all(arguments: &Arguments, (field, lacks): (&MeasuredField, Lacks), splits: u64) -> anyhow::Result<()> {
    ensure!(splits > 0, "--splits must be at least 1");
    let shutdown = Shutdown::on_signals()?;
    let methods: Vec<Method> = Method::value_variants()
        .iter()
        .copied()
        .filter(|m| *m != Method::IdwWithin || arguments.radius_mm.is_some())
        .collect();
    let mut totals: Vec<Total> = methods.iter().map(|_| Total::default()).collect();
    let mut done = 0;
    for seed in (0..splits).map(|k| arguments.seed.wrapping_add(k)) {
        if shutdown.requested() {
            break;
        }
        let dealt = split(field.points_m().len(), arguments.share, seed)?;
        let (known, unseen) = (field.part(&dealt.interpolating)?, field.pairs(&dealt.scoring));
        for (method, total) in methods.iter().zip(&mut totals) {
            let scored = score(build(arguments, *method, &known)?.as_ref(), &unseen);
            total.answered += scored.all.map_or(0, |score| score.points);
            total.unanswered += scored.unanswered;
            total.scores.extend(scored.all);
        }
        done += 1;
    }
    println!(
        "{} points, {done} splits, {:.0} % interpolate; mean over the splits, ± its 95 % interval",
        field.points_m().len(),
        arguments.share * 100.0
    );
    println!(
        "{:<12} {:>24} {:>24} {:>24} {:>22} {:>9}",
        "method", "rmse_x_um", "rmse_y_um", "rmse_z_um", "R² x/y/z", "answered"
    );
    for (method, total) in methods.iter().zip(&totals) {
        println!("{}", line(*method, total, lacks));
    }
    if totals.iter().any(|total| (0..3).any(|d| r2(total, d).is_some_and(|r2| r2 < 0.0))) {
        println!("R² below 0: the method answers worse than the mean of all vectors would: do not use it");
    }
    let next =
        Next::new("to have the errors at points of your own", "interpolate").file("--vectors", &arguments.vectors);
    next.text("--at POINTS.csv --out errors.csv").print();
    ensure!(done == splits, Ended::stopped(format!("stopped on request after {done} of {splits} splits")));
    Ok(())
}

fn line(method: Method, total: &Total, lacks: Lacks) -> String {
    let name = method.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned());
    let share = 100.0 * total.answered as f64 / (total.answered + total.unanswered).max(1) as f64;
    let is_missing = |d: usize| lacks.error.is_some_and(|axis| axis.index() == d);
    let direction = |d: usize| {
        if is_missing(d) {
            return "-".to_owned();
        }
        let values: Vec<f64> = total.scores.iter().map(|score| score.rmse_m[d] * UM).collect();
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
        digits::with_uncertainty(mean, 1.96 * (square / count).sqrt()).join(" ± ")
    };
    let agreement = |d: usize| match r2(total, d).filter(|_| !is_missing(d)) {
        None => "-".to_owned(),
        // How far below is of no meaning.
        Some(r2) if r2 < 0.0 => "<0".to_owned(),
        Some(r2) => format!("{r2:.3}"),
    };
    if total.scores.is_empty() {
        return format!("{name:<12} {:>24} {:>24} {:>24} {:>22} {share:>7.1} %", "-", "-", "-", "-");
    }
    let agreement = format!("{}/{}/{}", agreement(0), agreement(1), agreement(2));
    format!("{name:<12} {:>24} {:>24} {:>24} {agreement:>22} {share:>7.1} %", direction(0), direction(1), direction(2))
}

/// Mean over the splits of the share of a component's variance that a method explains.
fn r2(total: &Total, d: usize) -> Option<f64> {
    let values: Vec<f64> = total.scores.iter().filter_map(|score| score.r2[d]).collect();
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}
