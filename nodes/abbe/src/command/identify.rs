//! `abbe identify`: campaign in, model out.
//!
//! Place in the flow: offline, before anything is corrected. Writes the model file and, with `--json`, what was
//! found to standard output; otherwise the same in words.

mod report;

use crate::identity::IdentityOptions;
use crate::next::{KNOWN_POINTS, Next};
use crate::output;
use crate::pipeline::{self, Choices, Identification, LoadedCampaign};
use crate::progress::spinner;
use crate::verdict::{self, Accept};
use abbe_files::{ModelFile, hex, read_machine, write_atomically};
use abbe_identify::verdict::{Finding, Subject};
use abbe_identify::{Progress, RejectedReading};
use abbe_report::digits;
use abbe_runtime::Shutdown;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Share of what was known before, from which the campaign has told the turn of the ram.
const TOLD: f64 = 0.5;
/// Share of the readings that the independent ones are worth below which a reader is warned.
const LITTLE_LEFT: f64 = 0.3;
/// Rejected readings that are printed one by one.
const MOST_SHOWN: usize = 10;

/// Arguments of `identify`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Machine file (launch-config/machines/*.toml)
    #[arg(long)]
    machine: PathBuf,
    /// Campaign: CSV, or a bag (.mcap or rosbag2 folder)
    #[arg(long)]
    campaign: PathBuf,
    #[command(flatten)]
    join: pipeline::BagJoin,
    /// Model file to write
    #[arg(long)]
    out: PathBuf,
    /// Page with stations, errors, residuals and what is against the model, as HTML
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Print what was found as JSON on standard output
    #[arg(long)]
    json: bool,
    /// Weigh all readings as declared instead of down-weighting outliers
    #[arg(long)]
    no_robust: bool,
    /// Estimate how the noise of ranges is correlated, and weigh readings by it. Only where `abbe diagnose` says that the model
    /// lacks nothing: what it lacks looks like such noise
    #[arg(long)]
    correlated_noise: bool,
    #[command(flatten)]
    accept: Accept,
    #[command(flatten)]
    identity: IdentityOptions,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let outputs = arguments.html.iter().chain([&arguments.out]).map(PathBuf::as_path);
    output::check(outputs, [arguments.machine.as_path(), arguments.campaign.as_path()])?;
    let shutdown = Shutdown::on_signals()?;
    let machine = read_machine(&arguments.machine)?;
    let since = Instant::now();
    let loaded = pipeline::load_campaign(&arguments.campaign, &machine, &arguments.join)?;
    let read_s = since.elapsed().as_secs_f64();
    let bar =
        spinner(&format!("identifying {} from {} readings", machine.machine.name, loaded.campaign.readings.len()));
    let since = Instant::now();
    let mut observe = |progress: Progress| {
        bar.set_message(progress_text(&progress));
        !shutdown.requested()
    };
    let choices = Choices {
        robust: !arguments.no_robust,
        correlated_noise: arguments.correlated_noise,
        accept: arguments.accept,
    };
    let identified = pipeline::identify(&machine, &loaded, choices, &mut observe);
    bar.finish_and_clear();
    let (file, found) = verdict::shown(identified, arguments.json)?;
    let identify_s = since.elapsed().as_secs_f64();
    // Before the model is written: an identity that contradicts the data leaves nothing behind.
    let page =
        arguments.html.as_ref().map(|_| report::report(arguments, &machine, &loaded, (&file, &found))).transpose()?;
    let sha256 = file.save(&arguments.out)?;
    if let (Some(path), Some(page)) = (&arguments.html, page) {
        write_atomically(path, report::with_hash(page, &sha256).html()?.as_bytes())?;
    }
    if arguments.json {
        print_json(arguments, &loaded, (&file, &found), &sha256, [read_s, identify_s])?;
    } else {
        print_words(arguments, &file, &found, &sha256, identify_s);
    }
    Ok(())
}

/// One pass in words.
pub(crate) fn progress_text(progress: &Progress) -> String {
    format!(
        "pass {}, largest step {:.1e} of its uncertainty, χ² per degree of freedom {:.3}",
        progress.pass, progress.largest_step, progress.chi2_per_dof
    )
}

fn print_json(
    arguments: &Arguments,
    loaded: &LoadedCampaign,
    (file, found): (&ModelFile, &Identification),
    sha256: &[u8; 32],
    [read_s, identify_s]: [f64; 2],
) -> anyhow::Result<()> {
    let parts = file.model.parts();
    let stations: Vec<_> = parts
        .stations
        .iter()
        .map(|s| {
            json!({
                "name": s.name, "x_mm": s.position_m.x * 1e3, "y_mm": s.position_m.y * 1e3, "z_mm": s.position_m.z * 1e3,
                "dead_path_mm": s.dead_path_m * 1e3,
            })
        })
        .collect();
    let value = json!({
        "machine": parts.machine.name,
        "campaign": loaded.source.file,
        "campaign_sha256": loaded.source.sha256,
        "model": arguments.out.display().to_string(),
        "model_sha256": hex(sha256),
        "readings": loaded.campaign.readings.len(),
        "used": parts.quality.readings,
        "rejected": parts.quality.rejected,
        "chi2_per_dof": parts.quality.chi2_per_dof,
        "residual_rms_um": parts.quality.residual_rms_m * 1e6,
        "ram_turn_urad": file.model.ram_turn().map(|(angle_rad, _)| angle_rad * 1e6),
        "ram_turn_u_urad": file.model.ram_turn().map(|(_, u_rad)| u_rad * 1e6),
        "ram_turn_about_offset_mm": parts.offset_centre_m.map(|v| v * 1e3),
        "covariates": loaded.campaign.covariates.iter().map(|c| c.name.clone()).collect::<Vec<_>>(),
        "stations": stations,
        "findings": verdict::json(&found.verdict.findings),
        "widening": found.verdict.widening,
        "evidence": file.evidence,
        "read_s": read_s,
        "identify_s": identify_s,
        "software": file.software,
    });
    println!("{}", serde_json::to_string_pretty(&value)?);
    Ok(())
}

/// The turn of the ram, and what follows where the campaign's offsets did not tell it.
pub(crate) fn print_ram_turn(file: &ModelFile) {
    let parts = file.model.parts();
    let turn = file.model.ram_turn();
    let [a, b, c] = turn.map(|(angle_rad, u_rad)| digits::with_uncertainty(angle_rad * 1e6, u_rad * 1e6).join(" ± "));
    let [x, y, z] = parts.offset_centre_m.map(|v| v * 1e3);
    println!("  turn of the ram   A {a}, B {b}, C {c} µrad (k = 1), about offset ({x:.1}, {y:.1}, {z:.1}) mm");
    let told = turn.iter().zip(parts.machine.u_ram_turn_rad).all(|((_, u_rad), before)| *u_rad < TOLD * before);
    if !told {
        println!(
            "  note              the offsets measured do not tell all of the turn of the ram: the uncertainty of points with \
             other offsets holds what is left; measure lines with three offsets that are not on one line from the same station"
        );
    }
}

fn print_words(arguments: &Arguments, file: &ModelFile, found: &Identification, sha256: &[u8; 32], seconds: f64) {
    let evidence = &found.evidence;
    let quality = &file.model.parts().quality;
    println!(
        "range residual {} µm rms, χ² per degree of freedom {} with the declared uncertainties",
        digits::result(quality.residual_rms_m * 1e6),
        digits::result(quality.chi2_per_dof)
    );
    println!("  readings          {} used, {} rejected", quality.readings, quality.rejected);
    println!(
        "  unknowns          {} ({:.1} effective), condition {:.0}",
        evidence.unknowns, evidence.effective_unknowns, evidence.condition
    );
    print_ram_turn(file);
    if file.instrument.common_per_metre > 0.0 {
        let per_metre_um = digits::result(file.instrument.common_per_metre * 1e6);
        println!(
            "  common scale      {per_metre_um} µm/m (k = 1) of all lengths, as declared, is in every uncertainty"
        );
    }
    if let Some(noise) = &evidence.noise {
        println!("  noise             {}", pipeline::noise_words(noise));
        if noise.effective_readings < LITTLE_LEFT * quality.readings as f64 {
            println!(
                "  warning           on what neighbours share, most of the readings tell what the one before told: shield the \
                 beam from moving air, and measure lines in another order or again on another day rather than more points"
            );
        }
    }
    println!("  time              {:.0} ms in {} passes", seconds * 1e3, evidence.passes);
    if let Some(problem) = &evidence.refinement_given_up {
        println!(
            "  note              finer splines were tried and given up, and this is the fit without them: {problem}"
        );
    }
    for pair in &evidence.correlated {
        println!("  correlated        {} with {}: {:+.3}", pair.first, pair.second, pair.correlation);
    }
    print!("{}", verdict::words(&found.verdict.findings));
    if found.verdict.widening > 1.0 {
        println!(
            "  widened           uncertainties by {:.1}, so that they hold for the rejected readings too",
            found.verdict.widening.sqrt()
        );
    }
    print_rejected(&evidence.rejected);
    print_written(&arguments.out, &hex(sha256));
    next(arguments, found).print();
}

/// The model file, after what it holds was said.
pub(super) fn print_written(model: &Path, sha256: &str) {
    println!("  model             {}", model.display());
    println!("  model sha256      {sha256}");
}

/// Where the residual is larger than the declared noise, its cause, as the finding itself says; else a test that the fit has no part in.
fn next(arguments: &Arguments, found: &Identification) -> Next {
    let is_unexplained = |finding: &Finding| matches!(finding.subject, Subject::Noise { ratio, .. } if ratio > 1.0);
    match found.verdict.findings.iter().any(is_unexplained) {
        true => Next::new("to find what the model lacks", "diagnose")
            .file("--model", &arguments.out)
            .file("--campaign", &arguments.campaign)
            .text("--out diagnosis"),
        false => Next::new("to hold it against points that the fit has not seen", "verify")
            .file("--model", &arguments.out)
            .text(KNOWN_POINTS),
    }
}

/// The first of the rejected readings; all of them are in the model file and in the JSON.
fn print_rejected(rejected: &[RejectedReading]) {
    for reading in rejected.iter().take(MOST_SHOWN) {
        println!(
            "  rejected          reading {} (station {}, line {}): {} µm, {:.1} standard deviations",
            reading.reading,
            reading.station,
            reading.line,
            digits::result(reading.residual_m * 1e6),
            reading.standardised
        );
    }
    if rejected.len() > MOST_SHOWN {
        println!(
            "  rejected          and {} more: all of them are in the model file under evidence, and printed by --json",
            rejected.len() - MOST_SHOWN
        );
    }
}
