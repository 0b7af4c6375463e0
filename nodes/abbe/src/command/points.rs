//! `abbe points`: actual positions of measured points from several stations, without a model of the machine.
//!
//! Place in the flow: a campaign that measured the same points from at least four stations in; stations, and the volumetric
//! error of every point with its uncertainty out, as residual vectors for `abbe interpolate` or `abbe diagnose --residuals`.
//! Source: Chen 2020 eq. 1-11, see `abbe_measurement::multilateration`.

use crate::exit::Ended;
use crate::output;
use crate::pipeline;
use crate::verdict::{self, Accept, shown};
use abbe_files::{ErrorVector, MachineFile, read_machine, write_error_vectors};
use abbe_identify::verdict::{Counted, Verdict};
use abbe_measurement::multilateration::{LIMIT_M, MultiStation, Options, SolvedPoint, solve};
use anyhow::{Context, ensure};
use serde_json::json;
use std::path::PathBuf;

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
    /// Readings of a point from one station that differ by more than this are rejected, and listed
    #[arg(long, default_value_t = LIMIT_M * 1e6)]
    pair_limit_um: f64,
    /// Readings whose scale readings differ by less than this are of one point
    #[arg(long, default_value_t = 0.1)]
    same_point_mm: f64,
    /// Print what was found as JSON on standard output
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    accept: Accept,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    output::check([arguments.out.as_path()], [arguments.machine.as_path(), arguments.campaign.as_path()])?;
    let machine = read_machine(&arguments.machine)?;
    let loaded = pipeline::load_campaign(&arguments.campaign, &machine, &arguments.join)?;
    let options = Options {
        instrument: machine.instrument,
        repeatability_m: line_of_sight_m(&machine),
        pair_limit_m: arguments.pair_limit_um / 1e6,
        same_point_m: arguments.same_point_mm / 1e3,
    };
    let solved = solve(&loaded.campaign, &options).with_context(|| arguments.campaign.display().to_string())?;
    let contradicting = solved.rejected.iter().map(|pair| pair.readings.len()).sum();
    let counted = Counted { what: "readings", rejected: contradicting, all: loaded.campaign.readings.len() };
    // The noise of points is not graded: stations from nominal points make it larger by what the machine's errors are.
    let verdict = verdict::of_fit(None, Some(counted));
    let name = arguments.campaign.display().to_string();
    let found = || json!({ "rejected_readings": contradicting, "pair_limit_um": arguments.pair_limit_um });
    shown(verdict::check(&verdict, arguments.accept, &name, found).map_err(Into::into), arguments.json)?;
    let vectors: Vec<ErrorVector> = solved.points.iter().map(|point| vector(&solved, point)).collect();
    write_error_vectors(&arguments.out, &vectors)?;
    if arguments.json {
        print_json(arguments, &solved, &verdict)?
    } else {
        print_words(arguments, &solved, &verdict)?
    }
    let (missing, all) = (solved.unsolved.len(), solved.unsolved.len() + solved.points.len());
    if missing > 0 {
        eprintln!("abbe: warning: {}: {missing} of {all} points could not be solved", arguments.campaign.display());
    }
    ensure!(
        !solved.points.is_empty(),
        Ended::nothing_inside(format!("{}: no point could be solved", arguments.campaign.display()))
    );
    Ok(())
}

/// Repeatability along a line of sight whose direction is not known: root of the mean of the squares (m).
fn line_of_sight_m(machine: &MachineFile) -> f64 {
    (machine.machine.repeatability_m.iter().map(|r| r * r).sum::<f64>() / 3.0).sqrt()
}

fn vector(solved: &MultiStation, point: &SolvedPoint) -> ErrorVector {
    let variance = point.position.covariance_m2.diagonal();
    ErrorVector {
        position_m: solved.targets[point.target].reading_m.into(),
        error_m: Some(point.position.error_m.into()),
        u_m: Some(variance.map(f64::sqrt).into()),
        status: None,
    }
}

/// Root mean square of the residuals of all points (m), and χ² per degree of freedom.
fn residual(solved: &MultiStation) -> (f64, f64) {
    let ranges: usize = solved.points.iter().map(|p| p.stations.len()).sum();
    let square: f64 = solved.points.iter().flat_map(|p| &p.position.residuals_m).map(|r| r * r).sum();
    let chi2: f64 = solved.points.iter().map(|p| p.position.chi2).sum();
    let freedom = ranges - 3 * solved.points.len();
    ((square / ranges as f64).sqrt(), chi2 / freedom as f64)
}

fn print_words(arguments: &Arguments, solved: &MultiStation, verdict: &Verdict) -> anyhow::Result<()> {
    let (residual_m, chi2_per_dof) = residual(solved);
    println!("{}: {} points solved, {} not", arguments.out.display(), solved.points.len(), solved.unsolved.len());
    println!("  range residual    {:.3} um rms, chi2/dof {chi2_per_dof:.3}", residual_m * 1e6);
    println!("  station           x_mm          y_mm          z_mm          dead_path_mm  u_um   scatter_um");
    for (name, station) in solved.names.iter().zip(&solved.stations) {
        let p = station.position_m * 1e3;
        let u_um = station.covariance_m2.diagonal().xyz().sum().sqrt() * 1e6;
        let (dead, scatter) = (station.dead_path_m * 1e3, station.deviation_m * 1e6);
        println!("  {name:<17} {:<13.5} {:<13.5} {:<13.5} {dead:<13.5} {u_um:<6.2} {scatter:.2}", p.x, p.y, p.z);
    }
    print!("{}", verdict::words(&verdict.findings));
    for pair in &solved.rejected {
        let readings: Vec<String> = pair.readings.iter().map(|k| (k + 1).to_string()).collect();
        println!(
            "  rejected          readings {} of station {}: they differ by {:.2} um",
            readings.join(", "),
            solved.names[pair.station],
            pair.difference_m * 1e6
        );
    }
    for missing in &solved.unsolved {
        let at = solved.targets[missing.target].reading_m * 1e3;
        println!("  not solved        ({:.3}, {:.3}, {:.3}) mm: {}", at.x, at.y, at.z, missing.why);
    }
    println!(
        "  note              stations from nominal points take up the part of the machine's errors that looks like a shift of \
         the station; `abbe identify` does not have that"
    );
    Ok(())
}

fn print_json(arguments: &Arguments, solved: &MultiStation, verdict: &Verdict) -> anyhow::Result<()> {
    let (residual_m, chi2_per_dof) = residual(solved);
    let stations = solved.names.iter().zip(&solved.stations).map(|(name, station)| {
        let u_um = station.covariance_m2.diagonal().map(|v| v.sqrt() * 1e6);
        json!({
            "name": name,
            "x_mm": station.position_m.x * 1e3, "y_mm": station.position_m.y * 1e3, "z_mm": station.position_m.z * 1e3,
            "dead_path_mm": station.dead_path_m * 1e3,
            "u_x_um": u_um.x, "u_y_um": u_um.y, "u_z_um": u_um.z, "u_dead_path_um": u_um.w,
            "scatter_um": station.deviation_m * 1e6,
        })
    });
    let rejected: Vec<_> = solved.rejected.iter().map(|pair| {
        let readings: Vec<usize> = pair.readings.iter().map(|k| k + 1).collect();
        json!({ "station": solved.names[pair.station], "readings": readings, "difference_um": pair.difference_m * 1e6 })
    }).collect();
    let unsolved: Vec<_> = solved
        .unsolved
        .iter()
        .map(|missing| {
            let at = solved.targets[missing.target].reading_m * 1e3;
            json!({ "x_mm": at.x, "y_mm": at.y, "z_mm": at.z, "why": missing.why.to_string() })
        })
        .collect();
    let value = json!({
        "points": arguments.out.display().to_string(), "solved": solved.points.len(),
        "residual_rms_um": residual_m * 1e6, "chi2_per_dof": chi2_per_dof,
        "findings": verdict::json(&verdict.findings), "stations": stations.collect::<Vec<_>>(), "rejected": rejected, "unsolved": unsolved,
    });
    println!("{}", serde_json::to_string_pretty(&value)?);
    Ok(())
}
