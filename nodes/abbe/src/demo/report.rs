//! The demo's figures in the form that the report crate draws.
//!
//! Place in the flow: last step. Verification errors are those of the samples taken from the live topic, not of an
//! offline correction.

use super::live::Live;
use super::recording::Bag;
use crate::pipeline::{Identification, LoadedCampaign};
use crate::verification::{VerificationPoints, Verified, errors, rms_and_max_m};
use abbe_files::{MachineFile, ModelFile, hex};
use abbe_geometry::error_function::Kind;
use abbe_geometry::{ErrorId, Vector3};
use abbe_report::{
    Correlation, DemoReport, ErrorCurve, ErrorCurveSet, ErrorKind, FileEntry, FitSummary, Identifiability, LiveFigures,
    MeasuredLine, MeasuringVolume, OrderChoice, RejectedReading, Residual, RunHeader, SquarenessError, StationEntry,
    StepDuration, VerificationPoint,
};
use anyhow::ensure;
use std::path::Path;

/// Points of an error curve.
const CURVE_POINTS: usize = 81;
/// Factor of a 95 % band of a normal distribution.
const BAND_95: f64 = 1.96;

/// Everything that was found.
pub(super) struct Facts<'a> {
    pub(super) machine: &'a MachineFile,
    pub(super) loaded: &'a LoadedCampaign,
    pub(super) model: &'a ModelFile,
    pub(super) model_sha256: &'a [u8; 32],
    pub(super) found: &'a Identification,
    pub(super) points: &'a VerificationPoints,
    pub(super) bag: &'a Bag,
    pub(super) live: &'a Live,
    pub(super) steps: &'a [(&'static str, f64)],
    pub(super) dds: bool,
}

/// The report's data.
pub(super) fn data(facts: &Facts) -> anyhow::Result<DemoReport> {
    let verified = live_errors(facts)?;
    Ok(DemoReport {
        header: header(facts),
        verification: verified.iter().map(verification_point).collect(),
        verification_note: Some(
            "Points of another day that took no part in the fit, aligned rigidly to their reference before comparison. \
             The corrected positions are the samples received live from the corrected topic."
                .to_owned(),
        ),
        fit: fit(facts),
        steps: facts.steps.iter().map(|(name, s)| StepDuration { name: (*name).to_owned(), duration_s: Some(*s) }).collect(),
        residuals: residuals(facts),
        errors: ErrorCurveSet { curves: curves(facts), squareness: squareness(facts) },
        stations: stations(facts),
        volume: Some(volume(facts)),
        lines: lines(facts),
        order: order(facts),
        identifiability: identifiability(facts),
        rejected: rejected(facts),
        live: Some(live(facts)),
        warnings: warnings(facts),
    })
}

/// A short summary on standard output.
pub(super) fn print(data: &DemoReport, out: &Path) {
    let rms = |of: fn(&VerificationPoint) -> Option<[f64; 3]>| {
        rms_and_max_m(data.verification.iter().filter_map(of).map(|e| Vector3::from(e) * 1e-6))
    };
    let (before_rms_m, before_max_m) = rms(|p| Some(p.before_um));
    let (after_rms_m, after_max_m) = rms(|p| p.after_um);
    println!("3-D error at {} points that took no part in the fit (um):", data.verification.len());
    println!("  before  rms {:7.3}  max {:7.3}", before_rms_m * 1e6, before_max_m * 1e6);
    println!("  after   rms {:7.3}  max {:7.3}", after_rms_m * 1e6, after_max_m * 1e6);
    for warning in &data.warnings {
        println!("  note: {warning}");
    }
    println!("report: {}", out.join("report.html").display());
}

/// Verification errors, once the corrected positions that came over the live topic are those of the file.
fn live_errors(facts: &Facts) -> anyhow::Result<Vec<Verified>> {
    let received: std::collections::BTreeMap<u64, _> = facts.live.corrected.iter().map(|c| (c.sequence, c)).collect();
    for (number, offline_m) in facts.points.corrected_m.iter().enumerate() {
        let sequence = facts.bag.first_point + number as u64;
        let live_m = received.get(&sequence).and_then(|c| c.corrected_point_in_machine_m()).map(Vector3::from);
        ensure!(live_m.is_some(), "verification point {number} did not come back from the live graph");
        let same = live_m == Some(*offline_m);
        ensure!(same, "point {number}: live and offline correction differ; this must never happen");
    }
    errors(facts.points)
}

fn verification_point(verified: &Verified) -> VerificationPoint {
    VerificationPoint {
        position_mm: verified.reading_m.map(|v| v * 1e3),
        before_um: (verified.before_m * 1e6).into(),
        after_um: Some((verified.after_m * 1e6).into()),
    }
}

fn header(facts: &Facts) -> RunHeader {
    let entry = |role: &str, name: &str| FileEntry { role: role.to_owned(), name: name.to_owned() };
    RunHeader {
        title: format!("Live correction of {}", facts.machine.machine.name),
        what: "A tracer campaign identified the machine; the recording was then played through the nodes, and their \
               corrected coordinates were compared with points whose position is known."
            .to_owned(),
        machine: Some(facts.machine.machine.name.clone()),
        files: vec![
            entry("campaign", &facts.loaded.source.file),
            entry("model", "model.json"),
            entry("launch file", "launch.toml"),
            entry("recording played", "recording"),
            entry("recording of all topics", "corrected"),
        ],
        data_hash: Some(facts.loaded.source.sha256.clone()),
        model_hash: Some(hex(facts.model_sha256)),
        software_version: facts.model.software.clone(),
        host: None,
        time: None,
    }
}

fn fit(facts: &Facts) -> FitSummary {
    let quality = &facts.model.model.parts().quality;
    let declared = facts.found.u_m.iter().map(|u| u * u).sum::<f64>() / facts.found.u_m.len().max(1) as f64;
    FitSummary {
        residual_sigma_um: Some(facts.found.evidence.robust_scale * declared.sqrt() * 1e6),
        declared_sigma_um: Some(declared.sqrt() * 1e6),
        chi2_per_dof: Some(quality.chi2_per_dof),
        degrees_of_freedom: Some(quality.readings as f64 - facts.found.evidence.effective_unknowns),
        readings_used: quality.readings,
        readings_rejected: quality.rejected,
        converged: true,
    }
}

fn residuals(facts: &Facts) -> Vec<Residual> {
    let campaign = &facts.loaded.campaign;
    let rejected: std::collections::BTreeSet<usize> =
        facts.found.evidence.rejected.iter().map(|r| r.reading - 1).collect();
    let list = campaign.readings.iter().zip(&facts.found.residuals_m).zip(&facts.found.u_m).enumerate();
    list.filter(|(index, _)| !rejected.contains(index))
        .map(|(_, ((reading, residual_m), u_m))| Residual {
            station: campaign.stations[reading.station as usize].clone(),
            time_s: reading.time_s,
            position_mm: reading.reading_m.map(|v| v * 1e3),
            residual_um: residual_m * 1e6,
            declared_sigma_um: Some(u_m * 1e6),
        })
        .collect()
}

fn curves(facts: &Facts) -> Vec<ErrorCurve> {
    let model = &facts.model.model;
    let identified = &model.parts().identified.reading_m;
    let curve = |id: ErrorId| {
        let (lower_m, upper_m) = identified[id.axis().index()];
        let positions = (0..CURVE_POINTS).map(|k| lower_m + (upper_m - lower_m) * k as f64 / (CURVE_POINTS - 1) as f64);
        let positions: Vec<f64> = positions.collect();
        let (value, half): (Vec<_>, Vec<_>) = positions
            .iter()
            .map(|position_m| model.error(id, *position_m))
            .map(|(value, u)| (Some(value * 1e6), Some(BAND_95 * u * 1e6)))
            .unzip();
        ErrorCurve {
            name: id.name(),
            axis: id.axis().letter().to_lowercase().to_string(),
            kind: if id.is_angular() { ErrorKind::Angular } else { ErrorKind::Linear },
            position_mm: positions.iter().map(|p| p * 1e3).collect(),
            value,
            half_width_95: Some(half),
            truth: None,
        }
    };
    ErrorId::all().filter(|id| model.layout().basis(*id).is_some()).map(curve).collect()
}

fn squareness(facts: &Facts) -> Vec<SquarenessError> {
    let model = &facts.model.model;
    let entry = |(name, (value, u)): (String, (f64, f64))| SquarenessError {
        name,
        value_urad: Some(value * 1e6),
        expanded_95_urad: Some(BAND_95 * u * 1e6),
        truth_urad: None,
    };
    let between_axes = model.parts().machine.squareness.iter().enumerate();
    let between_axes = between_axes.map(|(k, entry)| (entry.name.clone(), model.squareness(k)));
    let of_ram = ["turn of the ram, A", "turn of the ram, B", "turn of the ram, C"].map(str::to_owned);
    between_axes.chain(of_ram.into_iter().zip(model.ram_turn())).map(entry).collect()
}

fn stations(facts: &Facts) -> Vec<StationEntry> {
    let list = facts.model.model.parts().stations.iter().zip(&facts.found.evidence.stations);
    list.map(|(station, evidence)| StationEntry {
        name: station.name.clone(),
        position_mm: (station.position_m * 1e3).into(),
        uncertainty_um: Some(std::array::from_fn(|d| evidence.u_m[d] * 1e6)),
        dead_path_mm: Some(station.dead_path_m * 1e3),
        readings: evidence.readings,
        residual_rms_um: Some(evidence.residual_rms_m * 1e6),
    })
    .collect()
}

fn volume(facts: &Facts) -> MeasuringVolume {
    let identified = &facts.model.model.parts().identified.reading_m;
    MeasuringVolume {
        min_mm: identified.map(|(lower, _)| lower * 1e3),
        max_mm: identified.map(|(_, upper)| upper * 1e3),
    }
}

fn lines(facts: &Facts) -> Vec<MeasuredLine> {
    let campaign = &facts.loaded.campaign;
    let runs = campaign.readings.chunk_by(|a, b| a.line == b.line && a.station == b.station);
    runs.filter_map(|run| Some((run.first()?, run.last()?)))
        .map(|(first, last)| MeasuredLine {
            station: campaign.stations[first.station as usize].clone(),
            from_mm: first.reading_m.map(|v| v * 1e3),
            to_mm: last.reading_m.map(|v| v * 1e3),
        })
        .collect()
}

fn order(facts: &Facts) -> Vec<OrderChoice> {
    let machine = &facts.model.model.parts().machine;
    let form = |name: &str| match ErrorId::from_name(name).and_then(|id| machine.kinds[id.index()]) {
        Some(Kind::BSpline { intervals }) => format!("cubic spline, {intervals} intervals, penalised"),
        Some(Kind::Polynomial { degree }) => format!("polynomial, up to degree {degree}"),
        Some(Kind::Nodes { count }) => format!("piecewise linear, {count} nodes"),
        None => "held at zero".to_owned(),
    };
    let choice = |e: &abbe_identify::ErrorEvidence| OrderChoice {
        error: e.name.clone(),
        form: form(&e.name),
        effective_dof: Some(e.effective),
        evidence_gain: None,
    };
    facts.found.evidence.errors.iter().map(choice).collect()
}

fn identifiability(facts: &Facts) -> Identifiability {
    let evidence = &facts.found.evidence;
    let correlations = evidence.correlated.iter().map(|c| Correlation {
        first: c.first.clone(),
        second: c.second.clone(),
        coefficient: c.correlation,
    });
    Identifiability {
        unknowns: evidence.low_order_unknowns,
        rank: Some(evidence.rank),
        condition: Some(evidence.condition),
        cramer_rao_ratio: None,
        correlations: correlations.collect(),
    }
}

fn rejected(facts: &Facts) -> Vec<RejectedReading> {
    let entry = |r: &abbe_identify::RejectedReading| {
        let reading = &facts.loaded.campaign.readings[r.reading - 1];
        RejectedReading {
            row: r.reading,
            station: r.station.clone(),
            time_s: Some(reading.time_s),
            position_mm: reading.reading_m.map(|v| v * 1e3),
            residual_um: Some(r.residual_m * 1e6),
            normalised: Some(r.residual_m / facts.found.u_m[r.reading - 1]),
            reason: format!("{:.1} robust standard deviations from the fit", r.standardised.abs()),
        }
    };
    facts.found.evidence.rejected.iter().map(entry).collect()
}

fn live(facts: &Facts) -> LiveFigures {
    let sorted = &facts.live.latencies_us;
    let quantile = |share: f64| sorted.get((sorted.len() as f64 * share) as usize).copied();
    let transport = if facts.dds { "shared memory between the nodes, DDS for everyone else" } else { "shared memory" };
    LiveFigures {
        samples_sent: Some(facts.bag.scale_readings as u64),
        samples_received: Some(facts.live.corrected.len() as u64),
        samples_lost: Some(facts.live.lost + facts.live.summaries.iter().map(|s| s.lost).sum::<u64>()),
        latency_p50_us: quantile(0.5),
        latency_p99_us: quantile(0.99),
        latency_p999_us: quantile(0.999),
        transport: Some(format!("{transport}; timed from the instant a sample was due at the scale node")),
    }
}

fn warnings(facts: &Facts) -> Vec<String> {
    let mut warnings: Vec<String> = facts.found.verdict.findings.iter().map(ToString::to_string).collect();
    let extrapolated = facts.points.extrapolated();
    if extrapolated > 0 {
        warnings.push(format!("{extrapolated} verification points lie outside the identified volume or offsets."));
    }
    warnings
}
