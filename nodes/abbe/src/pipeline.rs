//! From files to an identified model: what `identify` and the demo have in common.
//!
//! Place in the flow: machine file and campaign in, model file with its evidence out.

use crate::verdict::{self, Accept};
use abbe_diagnose::stated;
use abbe_files::{DataSource, Days, MachineFile, ModelFile, hex, read_campaign_file};
use abbe_graph::bag_campaign::{JoinSettings, campaign_from_bag};
use abbe_graph::capture::identify_options;
use abbe_identify::verdict::{Grade, Verdict, ask_held_functions, of_campaign, stroke};
use abbe_identify::{
    Along, By, CorrelatedNoise, Evidence, IdentifyError, IdentifyOptions, Noise, Progress, RangeCorrelation,
};
use abbe_measurement::campaign::Campaign;
use abbe_msgs::Sha256;
use anyhow::{Context, ensure};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// A campaign and where it came from.
pub(crate) struct LoadedCampaign {
    pub(crate) campaign: Campaign,
    pub(crate) source: DataSource,
    /// When it was measured, as far as the data say.
    pub(crate) days: Option<Days>,
}

/// How a bag is read as a campaign.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct BagJoin {
    /// Of a bag: stamps of scale and tracer this close are the same instant, in seconds, as in the launch file
    #[arg(long, default_value_t = JoinSettings::default().match_within_s)]
    match_within_s: f64,
    /// Of a bag: age in seconds from which a covariate is missing, as in the launch file
    #[arg(long, default_value_t = JoinSettings::default().max_covariate_age_s)]
    max_covariate_age_s: f64,
    /// Of a bag: namespace of the machine's topics, where several machines are in it
    #[arg(long)]
    namespace: Option<String>,
}

impl Default for BagJoin {
    fn default() -> BagJoin {
        let JoinSettings { match_within_s, max_covariate_age_s, namespace } = JoinSettings::default();
        BagJoin { match_within_s, max_covariate_age_s, namespace }
    }
}

impl BagJoin {
    fn settings(&self) -> anyhow::Result<JoinSettings> {
        let BagJoin { match_within_s, max_covariate_age_s, namespace } = self.clone();
        ensure!(
            (0.0..=1e6).contains(&match_within_s),
            "--match-within-s must be 0 to 1e6 seconds, not {match_within_s}"
        );
        check_covariate_age(max_covariate_age_s)?;
        Ok(JoinSettings { match_within_s, max_covariate_age_s, namespace })
    }
}

/// Refuses an age (s) from which every covariate would be stale, or none.
pub(crate) fn check_covariate_age(max_age_s: f64) -> anyhow::Result<()> {
    // What is no number is not above 0 either.
    ensure!(max_age_s > 0.0, "--max-covariate-age-s must be above 0, not {max_age_s}");
    Ok(())
}

/// Reads a campaign from CSV or from a bag (`.mcap`, or a rosbag2 folder). What of a bag is left out is told on standard
/// error.
pub(crate) fn load_campaign(path: &Path, machine: &MachineFile, join: &BagJoin) -> anyhow::Result<LoadedCampaign> {
    let name = path.file_name().map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned());
    if !is_bag(path) {
        let file = read_campaign_file(path, machine.machine.default_offset_m)?;
        let source = DataSource { file: name, sha256: hex(&file.sha256) };
        return Ok(LoadedCampaign { campaign: file.campaign, source, days: Days::of_table(path)? });
    }
    let from_bag = campaign_from_bag(path, &machine.machine.frame_id, &join.settings()?)
        .with_context(|| format!("machine {}", machine.machine.name))?;
    for words in &from_bag.left_out {
        eprintln!("{}: left out: {words}", path.display());
    }
    let source = DataSource { file: name, sha256: hex(&bag_sha256(path)?) };
    let days = Days::of_stamps_ns(from_bag.stamps_ns.into_iter().flatten());
    Ok(LoadedCampaign { campaign: from_bag.campaign, source, days })
}

/// Whether a path names a bag; a file of one in SQLite is for the reader of bags as well, which says how to convert it.
pub fn is_bag(path: &Path) -> bool {
    path.is_dir() || path.extension().is_some_and(|extension| extension == "mcap" || extension == "db3")
}

/// SHA-256 of the recordings of a bag.
pub(crate) fn bag_sha256(path: &Path) -> anyhow::Result<[u8; 32]> {
    let mut bytes = Vec::new();
    for file in bag_files(path)? {
        bytes.extend(std::fs::read(&file).with_context(|| format!("{}: cannot be read", file.display()))?);
    }
    Ok(Sha256::of(&bytes).to_bytes())
}

fn bag_files(path: &Path) -> anyhow::Result<Vec<PathBuf>> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let mut files = Vec::new();
    for entry in std::fs::read_dir(path).with_context(|| format!("{}: cannot be listed", path.display()))? {
        let file = entry?.path();
        if file.extension().is_some_and(|extension| extension == "mcap") {
            files.push(file);
        }
    }
    files.sort();
    Ok(files)
}

/// What the user may choose of an identification.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Choices {
    /// Down-weight outliers.
    pub(crate) robust: bool,
    /// Estimate how the noise of ranges is correlated, instead of taking it to be white.
    pub(crate) correlated_noise: bool,
    /// Make a model although the fit contradicts itself.
    pub(crate) accept: Accept,
}

/// Identifies a model and puts it into its file form.
///
/// # Errors
/// Data that no model can be identified from; [`verdict::Refused`] where the fit speaks against itself and that is not accepted.
pub(crate) fn identify(
    machine: &MachineFile,
    loaded: &LoadedCampaign,
    choices: Choices,
    observe: &mut dyn FnMut(Progress) -> bool,
) -> anyhow::Result<(ModelFile, Identification)> {
    let Choices { robust, correlated_noise, accept } = choices;
    let noise = if correlated_noise { Noise::Estimated } else { Noise::Given(None) };
    let options = IdentifyOptions { robust, noise, ..identify_options(machine) };
    let fit = abbe_identify::identify(&machine.machine, machine.instrument, &loaded.campaign, &options, observe)
        .map_err(|error| with_stroke(error, machine, &loaded.campaign))
        .with_context(|| loaded.source.file.clone())?;
    let mut verdict = of_campaign(&loaded.campaign, &fit);
    ask_held_functions(&mut verdict, &machine.machine, machine.instrument, &loaded.campaign, &options, observe)?;
    verdict::check(&verdict, accept, &loaded.source.file, || evidence_json(&fit.evidence))?;
    let (model, verdict) =
        stated(&fit, machine.instrument, &loaded.campaign, verdict).with_context(|| loaded.source.file.clone())?;
    let abbe_identify::Identified { evidence, residuals_m, u_m, .. } = fit;
    let file = ModelFile {
        model,
        order: machine.order,
        instrument: machine.instrument,
        absolute_range: machine.absolute_range,
        residual_network: None,
        data: vec![loaded.source.clone()],
        seed: None,
        options: json!({
            "robust": robust,
            "correlated_noise": correlated_noise,
            "accept_misfit": accept.accept_misfit,
            "max_passes": options.max_passes
        }),
        evidence: evidence_json(&evidence),
        doubts: verdict::doubts(&verdict),
        software: software(),
    };
    Ok((file, Identification { evidence, residuals_m, u_m, verdict }))
}

/// Why nothing was identified, with a stroke that was hardly driven: a unit or a machine file that is behind both.
fn with_stroke(error: IdentifyError, machine: &MachineFile, campaign: &Campaign) -> anyhow::Error {
    let driven = stroke(&machine.machine, campaign.readings.iter().map(|reading| reading.reading_m));
    match driven.filter(|finding| finding.grade == Grade::Refusal && error != IdentifyError::Stopped) {
        Some(finding) => anyhow::anyhow!("{error}; and {finding}"),
        None => error.into(),
    }
}

/// What identification found besides the model.
pub(crate) struct Identification {
    pub(crate) evidence: Evidence,
    pub(crate) residuals_m: Vec<f64>,
    pub(crate) u_m: Vec<f64>,
    pub(crate) verdict: Verdict,
}

/// Name and version of this program.
pub fn software() -> String {
    format!("abbe {}", env!("CARGO_PKG_VERSION"))
}

/// How the noise of ranges is correlated.
fn noise_json(noise: &CorrelatedNoise) -> Value {
    let RangeCorrelation { noise: found, along, by, gain } = noise.correlation;
    let (length_readings, length_s) = match by {
        By::Order => (Some(found.length), None),
        By::Time => (None, Some(found.length)),
    };
    json!({
        "along": match along { Along::Line => "line", Along::Station => "station" },
        "share_of_variance": found.share,
        "length_readings": length_readings,
        "length_s": length_s,
        "share_of_lines": found.group_share,
        "neighbours": noise.neighbours,
        "effective_readings": noise.effective_readings,
        "twice_log_likelihood_gain": gain,
    })
}

/// The same in words.
pub(crate) fn noise_words(noise: &CorrelatedNoise) -> String {
    let RangeCorrelation { noise: found, along, by, .. } = noise.correlation;
    let along = match along {
        Along::Line => "along lines",
        Along::Station => "from line to line of a station",
    };
    let unit = match by {
        By::Order => "readings",
        By::Time => "s",
    };
    let offsets = match found.group_share {
        share if share > 0.0 => format!(", {:.0} % common to each line", share * 1e2),
        _ => String::new(),
    };
    format!(
        "is correlated {along}: neighbours {:+.2}, {:.0} % of the variance over {:.1} {unit}{offsets}; as much information \
         on what neighbours share as {:.0} independent readings",
        noise.neighbours,
        found.share * 1e2,
        found.length,
        noise.effective_readings
    )
}

/// The evidence in the units people read.
pub(crate) fn evidence_json(evidence: &Evidence) -> Value {
    let errors: Vec<Value> = evidence
        .errors
        .iter()
        .map(|e| json!({ "name": e.name, "coefficients": e.coefficients, "effective": e.effective, "penalty": e.penalty }))
        .collect();
    let stations: Vec<Value> = evidence
        .stations
        .iter()
        .map(|s| json!({ "name": s.name, "readings": s.readings, "residual_rms_um": s.residual_rms_m * 1e6, "u_um": s.u_m.map(|u| u * 1e6) }))
        .collect();
    let correlated: Vec<Value> = evidence
        .correlated
        .iter()
        .map(|c| json!({ "first": c.first, "second": c.second, "correlation": c.correlation }))
        .collect();
    let rejected: Vec<Value> = evidence
        .rejected
        .iter()
        .map(|r| {
            json!({
                "reading": r.reading, "station": r.station, "line": r.line,
                "residual_um": r.residual_m * 1e6, "standardised": r.standardised,
            })
        })
        .collect();
    json!({
        "converged": true,
        "passes": evidence.passes,
        "largest_step_in_u": evidence.largest_step,
        "unknowns": evidence.unknowns,
        "effective_unknowns": evidence.effective_unknowns,
        "chi2_per_dof": evidence.chi2_per_dof,
        "sigma_over_declared": evidence.robust_scale,
        "minus_two_log_likelihood": evidence.minus_two_log_likelihood,
        "rank": evidence.rank,
        "low_order_unknowns": evidence.low_order_unknowns,
        "condition": evidence.condition,
        "errors": errors,
        "stations": stations,
        "correlations_above_0_9": correlated,
        "rejected": rejected,
        "correlated_noise": evidence.noise.as_ref().map(noise_json),
        "refinement_given_up": evidence.refinement_given_up,
    })
}
