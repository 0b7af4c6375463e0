//! `abbe identify`: campaign in, model out.
//!
//! Place in the flow: offline, before anything is corrected. Writes the model file and, with `--json`, what was
//! found to standard output; otherwise the same in words.

use crate::output;
use crate::pipeline::{self, LoadedCampaign};
use abbe_files::{ModelFile, hex, read_machine};
use abbe_identify::{Evidence, Progress};
use abbe_runtime::Shutdown;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Arguments of `identify`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Machine file (launch-config/machines/*.toml)
    #[arg(long)]
    machine: PathBuf,
    /// Campaign: CSV, or a bag (.mcap or rosbag2 folder)
    #[arg(long)]
    campaign: PathBuf,
    /// Model file to write
    #[arg(long)]
    out: PathBuf,
    /// Print what was found as JSON on standard output
    #[arg(long)]
    json: bool,
    /// Weigh all readings as declared instead of down-weighting outliers
    #[arg(long)]
    no_robust: bool,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    output::check([arguments.out.as_path()], [arguments.machine.as_path(), arguments.campaign.as_path()])?;
    let shutdown = Shutdown::on_signals()?;
    let machine = read_machine(&arguments.machine)?;
    let since = Instant::now();
    let loaded = pipeline::load_campaign(&arguments.campaign, &machine)?;
    let read_s = since.elapsed().as_secs_f64();
    let bar =
        spinner(&format!("identifying {} from {} readings", machine.machine.name, loaded.campaign.readings.len()));
    let since = Instant::now();
    let mut observe = |progress: Progress| {
        bar.set_message(progress_text(&progress));
        !shutdown.requested()
    };
    let identified = pipeline::identify(&machine, &loaded, !arguments.no_robust, &mut observe);
    bar.finish_and_clear();
    let (file, found) = identified?;
    let identify_s = since.elapsed().as_secs_f64();
    let sha256 = file.save(&arguments.out)?;
    if arguments.json {
        print_json(arguments, &loaded, &file, &sha256, [read_s, identify_s])?;
    } else {
        print_words(arguments, &file, &found.evidence, &sha256, identify_s);
    }
    Ok(())
}

/// A spinner that shows the passes.
pub(crate) fn spinner(what: &str) -> ProgressBar {
    let style =
        ProgressStyle::with_template("{spinner} {prefix}: {msg}").unwrap_or_else(|_| ProgressStyle::default_spinner());
    let bar = ProgressBar::new_spinner().with_style(style).with_prefix(what.to_owned());
    bar.enable_steady_tick(Duration::from_millis(100));
    bar
}

/// One pass in words.
pub(crate) fn progress_text(progress: &Progress) -> String {
    format!(
        "pass {}, largest step {:.1e} of its uncertainty, chi2/dof {:.3}",
        progress.pass, progress.largest_step, progress.chi2_per_dof
    )
}

fn print_json(
    arguments: &Arguments,
    loaded: &LoadedCampaign,
    file: &ModelFile,
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
        "covariates": loaded.campaign.covariates.iter().map(|c| c.name.clone()).collect::<Vec<_>>(),
        "stations": stations,
        "evidence": file.evidence,
        "read_s": read_s,
        "identify_s": identify_s,
        "software": file.software,
    });
    println!("{}", serde_json::to_string_pretty(&value)?);
    Ok(())
}

fn print_words(arguments: &Arguments, file: &ModelFile, evidence: &Evidence, sha256: &[u8; 32], seconds: f64) {
    let quality = &file.model.parts().quality;
    println!("{}", arguments.out.display());
    println!("  model sha256      {}", hex(sha256));
    println!("  readings          {} used, {} rejected", quality.readings, quality.rejected);
    println!(
        "  range residual    {:.3} um rms, chi2/dof {:.3} with the declared uncertainties",
        quality.residual_rms_m * 1e6,
        quality.chi2_per_dof
    );
    println!(
        "  unknowns          {} ({:.1} effective), condition {:.0}",
        evidence.unknowns, evidence.effective_unknowns, evidence.condition
    );
    println!("  time              {:.0} ms in {} passes", seconds * 1e3, evidence.passes);
    for pair in &evidence.correlated {
        println!("  correlated        {} with {}: {:+.3}", pair.first, pair.second, pair.correlation);
    }
    for reading in &evidence.rejected {
        println!(
            "  rejected          reading {} (station {}, line {}): {:+.2} um, {:.1} standard deviations",
            reading.reading,
            reading.station,
            reading.line,
            reading.residual_m * 1e6,
            reading.standardised
        );
    }
    if quality.chi2_per_dof > 1.3 {
        println!(
            "  note              the residual is larger than the declared noise: the model lacks something, or the noise is understated"
        );
    }
}
