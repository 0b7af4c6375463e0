//! `abbe points`: actual positions of measured points from several stations, without a model of the machine.
//!
//! Place in the flow: a campaign that measured the same points from at least four stations in; stations, and the volumetric
//! error of every point with its uncertainty out, as residual vectors for `abbe interpolate` or `abbe diagnose --residuals`.
//! Stations, dead paths and points are found together from the ranges alone, see `abbe_measurement::multilateration`.

mod tips;

use crate::exit::Ended;
use crate::next::Next;
use crate::output;
use crate::pipeline;
use crate::progress::spinner;
use crate::verdict::{self, Accept, shown};
use abbe_files::{ErrorVector, MachineFile, read_machine, write_error_vectors};
use abbe_identify::verdict::{Cause, Counted, Verdict};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::multilateration::{MultiStation, MultilaterationOptions, SolvedPoint, solve};
use abbe_measurement::network::PointProblem;
use abbe_report::digits;
use abbe_runtime::Shutdown;
use anyhow::{Context, ensure};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::PathBuf;
use tips::{Tips, asked_m};

/// Arguments of `points`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Machine file: its instrument and repeatability are used
    #[arg(long)]
    machine: PathBuf,
    /// Campaign that measured the same points from at least four stations: CSV, or a bag
    #[arg(long)]
    campaign: PathBuf,
    #[command(flatten)]
    join: pipeline::BagJoin,
    /// CSV to write: points with their error (actual − indicated) and its uncertainty
    #[arg(long)]
    out: PathBuf,
    /// Readings of a point from one station that differ by more than this are rejected, and listed; left out, six deviations of
    /// their difference by the declared uncertainties, and at least 5
    #[arg(long)]
    pair_limit_um: Option<f64>,
    /// Readings whose scale readings differ by less than this are of one point
    #[arg(long, default_value_t = 0.1)]
    same_point_mm: f64,
    /// Write the points of this tip or reflector alone: x,y,z from the ram reference point (mm), one of the offsets of the campaign. All readings
    /// tell where the stations are
    #[arg(long, value_delimiter = ',', num_args = 1, allow_hyphen_values = true, value_name = "X,Y,Z")]
    offset_mm: Option<Vec<f64>>,
    /// Print what was found as JSON on standard output
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    accept: Accept,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    output::check([arguments.out.as_path()], [arguments.machine.as_path(), arguments.campaign.as_path()])?;
    let offset_m = asked_m(arguments.offset_mm.as_deref())?;
    let machine = read_machine(&arguments.machine)?;
    let loaded = pipeline::load_campaign(&arguments.campaign, &machine, &arguments.join)?;
    let name = arguments.campaign.display().to_string();
    let mut solved = solved(arguments, &machine, &loaded.campaign).with_context(|| name.clone())?;
    let left_out = left_out(&solved);
    let counted = Counted { what: "readings", rejected: left_out, all: loaded.campaign.readings.len() };
    // Less noise than declared is no contradiction: what was declared holds parts that all ranges share.
    let noise = Some((solved.chi2_per_dof, solved.degrees)).filter(|(chi2_per_dof, _)| *chi2_per_dof > 1.0);
    let verdict = verdict::of_fit_because(noise, Some(counted), of_rejected(&solved));
    let found = || json!({ "rejected_readings": left_out, "pair_limit_um": arguments.pair_limit_um });
    shown(verdict::check(&verdict, arguments.accept, &name, found).map_err(Into::into), arguments.json)?;
    let tips = Tips::of(&mut solved, arguments.same_point_mm / 1e3, offset_m).with_context(|| name.clone())?;
    let vectors: Vec<ErrorVector> = solved.points.iter().map(|point| vector(&solved, point, &tips)).collect();
    ensure!(!vectors.is_empty(), Ended::nothing_inside(format!("{name}: no point could be solved")));
    write_error_vectors(&arguments.out, &vectors, &tips.notes())?;
    if arguments.json {
        print_json(arguments, &solved, &tips, &verdict)?
    } else {
        print_words(arguments, &solved, &tips, &verdict);
        next(arguments, &tips).print();
    }
    tips.warn(&arguments.out.display().to_string());
    let (missing, all) = (solved.unsolved.len(), solved.unsolved.len() + solved.points.len());
    if missing > 0 {
        eprintln!("abbe: warning: {name}: {missing} of {all} points could not be solved");
    }
    let lost = lost(&solved);
    if lost > 0 {
        eprintln!(
            "abbe: warning: {name}: {lost} of {} points stand without a reading that contradicts the others ({LOST} in the column status); \
             measure them again where they matter",
            solved.points.len()
        );
    }
    let unchecked = unchecked(&solved);
    if unchecked > 0 {
        eprintln!(
            "abbe: warning: {name}: {unchecked} of {} points are seen from three stations only, so that nothing would show a \
             wrong reading there; measure them from a fourth",
            solved.points.len()
        );
    }
    Ok(())
}

/// Vectors of several tips are no field yet.
fn next(arguments: &Arguments, tips: &Tips) -> Next {
    if tips.are_mixed() {
        let next = Next::new("to have the vectors of one tip", "points").file("--machine", &arguments.machine);
        return next.file("--campaign", &arguments.campaign).text(&tips.option()).text("--out vectors_of_one_tip.csv");
    }
    let next = Next::new("to have the errors between the points", "interpolate").file("--vectors", &arguments.out);
    next.text("--at POINTS.csv --out errors.csv")
}

fn solved(arguments: &Arguments, machine: &MachineFile, campaign: &Campaign) -> anyhow::Result<MultiStation> {
    let options = MultilaterationOptions {
        instrument: machine.instrument,
        repeatability_m: machine.machine.repeatability_m,
        pair_limit_m: arguments.pair_limit_um.map(|um| um / 1e6),
        same_point_m: arguments.same_point_mm / 1e3,
        absolute_range: machine.absolute_range,
    };
    let shutdown = Shutdown::on_signals()?;
    let bar = spinner(&format!("stations and points from {} readings", campaign.readings.len()));
    let found = solve(campaign, &options, &mut |progress| {
        bar.set_message(format!("pass {}, step {}, {} left out", progress.round, progress.step, progress.rejected));
        !shutdown.requested()
    });
    bar.finish_and_clear();
    Ok(found?)
}

/// Readings that contradict others: of pairs, of single sights, and of points whose ranges do not agree.
fn left_out(solved: &MultiStation) -> usize {
    // Of a pair one is wrong, though both were left out.
    let pairs: usize = solved.rejected.iter().map(|pair| pair.gross).sum();
    let sights: usize = solved.contradicted.iter().map(|sight| sight.readings.len()).sum();
    // Of such a point one sight is wrong; which one, nobody knows.
    let points = solved.unsolved.iter().filter(|point| point.why == PointProblem::Contradicting).count();
    pairs + sights + points
}

/// What may be behind them, likeliest first.
fn of_rejected(solved: &MultiStation) -> Vec<Cause> {
    // Gross errors are few; where many pairs differ, it is their noise.
    const NOISE: f64 = 0.05;
    let pairs = solved.left_out.filter(|pairs| pairs.pairs as f64 > NOISE * pairs.repeated as f64);
    let pairs = pairs.map(|pairs| Cause::Pairs { says: pairs.to_string() });
    pairs.into_iter().chain([Cause::Scattered, Cause::Understated]).collect()
}

/// Points that no fourth station checks.
fn unchecked(solved: &MultiStation) -> usize {
    solved.points.iter().filter(|point| point.stations.len() == 3).count()
}

/// Points that lost a sight.
fn lost(solved: &MultiStation) -> usize {
    solved.points.iter().filter(|point| point.lost > 0).count()
}

/// What the column `status` says of a point that a station's reading was left out of.
const LOST: &str = "reading_left_out";

fn vector(solved: &MultiStation, point: &SolvedPoint, tips: &Tips) -> ErrorVector {
    let target = &solved.targets[point.target];
    ErrorVector {
        position_m: target.reading_m.into(),
        offset_m: tips.are_several().then(|| target.offset_m.into()),
        error_m: Some(point.error_m.into()),
        u_m: Some(point.covariance_m2.diagonal().map(f64::sqrt).into()),
        status: (point.lost > 0).then_some(LOST),
    }
}

/// Root mean square of lengths (m).
fn rms(squares: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = squares.len().max(1) as f64;
    (squares.sum::<f64>() / count).sqrt()
}

/// Standard uncertainty of a component (m, k = 1), rms over points and components: in all, the points' own part, what the noise
/// of the frame does.
fn u_parts_m(solved: &MultiStation) -> [f64; 3] {
    let of = |part: fn(&SolvedPoint) -> f64| rms(solved.points.iter().map(|point| part(point) / 3.0));
    [of(|p| p.covariance_m2.trace()), of(|p| p.own_m2.trace()), of(|p| p.frame_m2.trace())]
}

const FRAME: &str = "that in which all points found fit best to where the machine indicated them: errors hold no common shift or turn, \
                     which ranges cannot tell; align before comparing with errors of other points or another frame";

fn print_words(arguments: &Arguments, solved: &MultiStation, tips: &Tips, verdict: &Verdict) {
    let residual_um = rms(solved.residuals_m.iter().map(|r| r * r)) * 1e6;
    println!("{}: {} points solved, {} not", arguments.out.display(), solved.points.len(), solved.unsolved.len());
    tips.print();
    println!(
        "  range residual    {} µm rms, χ² per degree of freedom {}, {} degrees of freedom",
        digits::result(residual_um),
        digits::result(solved.chi2_per_dof),
        solved.degrees
    );
    let [all, own, frame] = u_parts_m(solved).map(|u_m| digits::uncertainty(u_m * 1e6));
    println!(
        "  uncertainty       {all} µm (k = 1, rms of a component); {own} a point's own, the rest shared with other points by \
         stations and frame; of it the frame's noise {frame}"
    );
    println!("  frame             {FRAME}");
    println!(
        "  scale             that of the ranges: what all of them share, such as a wrong refractive index, is not in the uncertainty"
    );
    println!("  station           x_mm          y_mm          z_mm          dead_path_mm  u_um");
    for (name, station) in solved.names.iter().zip(&solved.stations) {
        let p = station.placed.position_m * 1e3;
        let u_um = station.covariance_m2.diagonal().xyz().sum().sqrt() * 1e6;
        let dead = station.placed.dead_path_m * 1e3;
        println!("  {name:<17} {:<13.5} {:<13.5} {:<13.5} {dead:<13.5} {}", p.x, p.y, p.z, digits::uncertainty(u_um));
    }
    print!("{}", verdict::words(&verdict.findings));
    for pair in &solved.rejected {
        println!(
            "  rejected          readings {} of station {}: they differ by {} µm, limit {} µm",
            numbers(&pair.readings),
            solved.names[pair.station],
            digits::result(pair.difference_m * 1e6),
            digits::result(pair.limit_m * 1e6)
        );
    }
    for sight in &solved.contradicted {
        println!(
            "  rejected          readings {} of station {}: {} from what other stations say",
            numbers(&sight.readings),
            solved.names[sight.station],
            sight.residual_m.map_or_else(|| "far".to_owned(), |m| format!("{} µm", digits::result(m * 1e6)))
        );
    }
    print_unsolved(solved);
}

/// Points that were not solved, by reason, with the first of each: a campaign of lines has thousands that one station saw.
fn print_unsolved(solved: &MultiStation) {
    let mut by_reason: BTreeMap<String, (usize, usize)> = BTreeMap::new();
    for missing in &solved.unsolved {
        by_reason.entry(missing.why.to_string()).or_insert((0, missing.target)).0 += 1;
    }
    for (why, (count, first)) in by_reason {
        let at = solved.targets[first].reading_m * 1e3;
        println!("  not solved        {count}, the first at ({:.3}, {:.3}, {:.3}) mm: {why}", at.x, at.y, at.z);
    }
}

/// Numbers of readings, from 1.
fn numbers(readings: &[usize]) -> String {
    let numbers: Vec<String> = readings.iter().map(|k| (k + 1).to_string()).collect();
    numbers.join(", ")
}

fn print_json(arguments: &Arguments, solved: &MultiStation, tips: &Tips, verdict: &Verdict) -> anyhow::Result<()> {
    let stations = solved.names.iter().zip(&solved.stations).map(|(name, station)| {
        let (placed, u_um) = (station.placed, station.covariance_m2.diagonal().map(|v| v.sqrt() * 1e6));
        json!({
            "name": name,
            "x_mm": placed.position_m.x * 1e3, "y_mm": placed.position_m.y * 1e3, "z_mm": placed.position_m.z * 1e3,
            "dead_path_mm": placed.dead_path_m * 1e3,
            "u_x_um": u_um.x, "u_y_um": u_um.y, "u_z_um": u_um.z, "u_dead_path_um": u_um.w,
        })
    });
    let from_one = |readings: &[usize]| readings.iter().map(|k| k + 1).collect::<Vec<usize>>();
    let pairs = solved.rejected.iter().map(|pair| {
        json!({
            "station": solved.names[pair.station], "readings": from_one(&pair.readings),
            "difference_um": pair.difference_m * 1e6, "limit_um": pair.limit_m * 1e6,
        })
    });
    let sights = solved.contradicted.iter().map(|sight| {
        json!({
            "station": solved.names[sight.station], "readings": from_one(&sight.readings),
            "residual_um": sight.residual_m.map(|m| m * 1e6),
        })
    });
    let unsolved = solved.unsolved.iter().map(|missing| {
        let at = solved.targets[missing.target].reading_m * 1e3;
        json!({ "x_mm": at.x, "y_mm": at.y, "z_mm": at.z, "why": missing.why.to_string() })
    });
    let [all, own, frame] = u_parts_m(solved).map(|u_m| u_m * 1e6);
    let mut value = json!({
        "points": arguments.out.display().to_string(), "solved": solved.points.len(), "unchecked": unchecked(solved),
        "with_reading_left_out": lost(solved),
        "residual_rms_um": rms(solved.residuals_m.iter().map(|r| r * r)) * 1e6,
        "chi2_per_dof": solved.chi2_per_dof, "degrees_of_freedom": solved.degrees,
        "frame": FRAME, "u_rms_um": all, "u_own_rms_um": own, "u_frame_rms_um": frame,
        "findings": verdict::json(&verdict.findings), "stations": stations.collect::<Vec<_>>(),
        "rejected": pairs.chain(sights).collect::<Vec<_>>(), "unsolved": unsolved.collect::<Vec<_>>(),
    });
    if let Some(tips) = tips.json() {
        value["tips"] = tips;
    }
    println!("{}", serde_json::to_string_pretty(&value)?);
    Ok(())
}
