//! `abbe simulate`: a campaign, verification points and the truth behind them, from the virtual machine.
//!
//! Place in the flow: trials without hardware. With `--trials`, identifies many such campaigns and compares the
//! achieved error with the uncertainty that the fit reports.

#[cfg(target_os = "linux")]
mod serve;
#[cfg(not(target_os = "linux"))]
#[path = "simulate/serve_elsewhere.rs"]
mod serve;

use crate::next::Next;
use abbe_files::{MachineFile, PathLine, PathStation, cell_text, read_machine, read_path, write_atomically};
use abbe_geometry::Vector3;
use abbe_geometry::correct::correct;
use abbe_geometry::effects::{NoCovariates, State};
use abbe_geometry::model::MachineModel;
use abbe_identify::{IdentifyOptions, at_cramer_rao_bound, identify};
use abbe_measurement::campaign::Campaign;
use abbe_virtual_machine::effects::from_text;
use abbe_virtual_machine::plan::{LinePlan, Plan, StationPlan};
use abbe_virtual_machine::verification::{Frame, VerificationConfig, VerificationPoint};
use abbe_virtual_machine::{
    Declared, SimulationConfig, VOLUMETRIC_RMS_M, shipped_bridge, simulate_campaign, verification_points,
    verification_points_with,
};
use anyhow::{Context, ensure};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Raw volumetric error of the simulated machine (rms, µm) where nothing is said: a bridge CMM before compensation.
pub(crate) const VOLUMETRIC_RMS_UM: f64 = VOLUMETRIC_RMS_M * 1e6;
/// Verification points.
const POINTS: usize = 400;
/// How well the verification points are known (m).
const KNOWN_TO_M: f64 = 0.05e-6;

/// Where a path does not say: feed, acceleration, path in the instrument that no counter sees.
const USUAL_FEED_M_S: f64 = 0.05;
const USUAL_ACCELERATION_M_S2: f64 = 0.3;
const USUAL_DEAD_PATH_M: f64 = 0.05;

/// Factor of a 95 % interval of a normal distribution.
const BAND_95: f64 = 1.96;

/// Arguments of `simulate`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Machine file of a bridge XYZ machine: its strokes, instrument and repeatability are simulated
    #[arg(long)]
    machine: PathBuf,
    /// Seed of machine, plan and noise
    #[arg(long)]
    seed: u64,
    /// Folder for campaign.csv and verify.csv
    #[arg(long, required_unless_present_any = ["trials", "serve"])]
    out: Option<PathBuf>,
    /// Repeat the plan until the campaign has at least this many readings
    #[arg(long)]
    readings: Option<u64>,
    /// Physics beyond the geometry, such as "backlash axis=y size_um=3"; may be given several times
    #[arg(long = "effect")]
    effects: Vec<String>,
    /// Folder of `abbe plan`: its path.csv and stations.csv are driven instead of the usual plan
    #[arg(long, conflicts_with = "trials")]
    plan: Option<PathBuf>,
    /// Raw volumetric error of the machine (rms)
    #[arg(long, default_value_t = VOLUMETRIC_RMS_UM)]
    volumetric_um: f64,
    /// Identify this many machines (seeds from --seed on); print achieved error, reported uncertainty,
    /// Cramér-Rao bound and coverage
    #[arg(long, conflicts_with = "effects")]
    trials: Option<u64>,
    #[command(flatten)]
    serving: serve::Serving,
}

impl Arguments {
    /// Whether the machine is served until somebody ends it.
    pub(crate) fn is_served(&self) -> bool {
        self.serving.is_wanted()
    }
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let machine = read_machine(&arguments.machine)?;
    if let Some(trials) = arguments.trials {
        return run_trials(&machine, arguments, trials);
    }
    let mut config = config(&machine, arguments.seed, arguments.volumetric_um)?;
    if let Some(folder) = &arguments.plan {
        config.plan = driven(&config.plan, &read_path(folder)?);
        config.machine.ram_turn.about_m = config.plan.mean_offset_m();
    }
    config.effects = arguments.effects.iter().map(|text| from_text(text)).collect::<Result<_, _>>()?;
    if let Some(readings) = arguments.readings {
        config.plan = config.plan.repeated_to(readings)?;
    }
    if let Some(out) = &arguments.out {
        write_files(&config, arguments.seed, (&arguments.machine, out))?;
    }
    match arguments.serving.is_wanted() {
        true => serve::run(&config, machine.machine.stroke_m, &arguments.serving),
        false => Ok(()),
    }
}

/// Campaign and verification points of this machine.
fn write_files(config: &SimulationConfig, seed: u64, (machine, out): (&Path, &Path)) -> anyhow::Result<()> {
    std::fs::create_dir_all(out).with_context(|| format!("{}: cannot be made", out.display()))?;
    let campaign = simulate_campaign(config)?.campaign;
    let verification = VerificationConfig { points: POINTS, seed, frame: Frame::Unknown, known_to_m: KNOWN_TO_M };
    let points = verification_points_with(config, &verification)?;
    write_atomically(&out.join("campaign.csv"), campaign_text(&campaign)?.as_bytes())?;
    write_atomically(&out.join("verify.csv"), verification_text(&campaign, &points)?.as_bytes())?;
    println!("{}: {} readings, {} verification points", out.display(), campaign.readings.len(), points.len());
    let next = Next::new("to identify the machine from it", "identify").file("--machine", machine);
    next.file("--campaign", &out.join("campaign.csv")).text("--out model.json").print();
    Ok(())
}

/// The shipped bridge with errors of this size (rms, µm), measured by a plan like the recorded ones.
pub(crate) fn config(machine: &MachineFile, seed: u64, volumetric_um: f64) -> anyhow::Result<SimulationConfig> {
    ensure!(
        (0.1..=1000.0).contains(&volumetric_um),
        "--volumetric-um {volumetric_um}: give a raw volumetric error of 0.1 to 1000 µm"
    );
    let declared = Declared {
        stroke_m: machine.machine.stroke_m,
        repeatability_m: machine.machine.repeatability_m,
        range: machine.instrument,
    };
    shipped_bridge(seed, volumetric_um * 1e-6, &declared).with_context(|| format!("machine {}", machine.machine.name))
}

/// The usual plan's ways with the stations and lines of a path.
fn driven(usual: &Plan, path: &[PathStation]) -> Plan {
    let line = |line: &PathLine| LinePlan {
        name: line.name.clone(),
        from_m: line.points_m.first().copied().unwrap_or_default(),
        to_m: line.points_m.last().copied().unwrap_or_default(),
        points: line.points_m.len() as u32,
        jitter: 0.0,
        offset_m: line.offset_m,
        feed_m_s: line.feed_m_s.unwrap_or(USUAL_FEED_M_S),
        acceleration_m_s2: USUAL_ACCELERATION_M_S2,
        load_kg: 0.0,
        pause_s: 0.0,
    };
    let station = |station: &PathStation| StationPlan {
        name: station.name.clone(),
        position_m: station.position_m,
        dead_path_m: USUAL_DEAD_PATH_M,
        lines: station.lines.iter().map(line).collect(),
    };
    let home_m = path.first().and_then(|s| s.lines.first()).and_then(|l| l.points_m.first());
    let home_m = home_m.copied().unwrap_or(usual.home_m);
    Plan { home_m, stations: path.iter().map(station).collect(), ..usual.clone() }
}

/// Sums over points and machines (m²), and how many intervals held the truth.
#[derive(Default)]
struct Score {
    error: f64,
    reported: f64,
    bound: f64,
    inside: usize,
    coordinates: usize,
}

impl Score {
    fn add(&mut self, other: &Score) {
        self.error += other.error;
        self.reported += other.reported;
        self.bound += other.bound;
        self.inside += other.inside;
        self.coordinates += other.coordinates;
    }

    fn line(&self, name: &str, chi2_per_dof: Option<f64>) -> String {
        let rms_um = |sum: f64| (3.0 * sum / self.coordinates as f64).sqrt() * 1e6;
        let chi2 = chi2_per_dof.map_or_else(|| "-".to_owned(), |value| format!("{value:.3}"));
        format!(
            "{name:>6} {:>10.3} {:>10.3} {:>10.3} {:>14.3} {:>11.3} {chi2:>12} {:>12.1}",
            rms_um(self.error),
            rms_um(self.reported),
            rms_um(self.bound),
            (self.error / self.reported).sqrt(),
            (self.error / self.bound).sqrt(),
            100.0 * self.inside as f64 / self.coordinates as f64
        )
    }
}

/// Achieved error against reported uncertainty and Cramér-Rao bound, 3-D rms, machine by machine.
fn run_trials(machine: &MachineFile, arguments: &Arguments, trials: u64) -> anyhow::Result<()> {
    let first_seed = arguments.seed;
    ensure!(trials > 0, "--trials must be at least 1");
    println!(
        "{:>6} {:>10} {:>10} {:>10} {:>14} {:>11} {:>12} {:>12}",
        "seed", "error_um", "u_um", "bound_um", "error/u", "error/bound", "chi2_per_dof", "inside_95_%"
    );
    let mut total = Score::default();
    for seed in first_seed..first_seed + trials {
        let config = config(machine, seed, arguments.volumetric_um)?;
        let campaign = simulate_campaign(&config)?.campaign;
        let found =
            identify(&machine.machine, machine.instrument, &campaign, &IdentifyOptions::default(), &mut |_| true)?;
        let bound = at_cramer_rao_bound(&found.model, machine.instrument, &campaign, machine.absolute_range)?;
        let score = score(machine, &found.model, &bound, &verification_points(&config, POINTS, seed)?)?;
        println!("{}", score.line(&seed.to_string(), Some(found.evidence.chi2_per_dof)));
        total.add(&score);
    }
    println!("{}", total.line("all", None));
    let next = Next::new("to have a campaign of this machine", "simulate").file("--machine", &arguments.machine);
    next.text(&format!("--seed {first_seed} --out practice")).print();
    Ok(())
}

fn score(
    machine: &MachineFile,
    model: &MachineModel,
    bound: &MachineModel,
    points: &[VerificationPoint],
) -> anyhow::Result<Score> {
    let mut score = Score::default();
    // The truth carries no repeatability, so it does not belong into this comparison.
    let repeatability = machine.machine.repeatability_m.map(|r| r * r);
    for point in points {
        let state = State { reading_m: point.reading_m, offset_m: point.offset_m, covariates: &NoCovariates };
        let (correction, best) = (correct(model, &state), correct(bound, &state));
        let outside = "a verification point lies outside the machine";
        let (reported, least) = (correction.covariance_m2.context(outside)?, best.covariance_m2.context(outside)?);
        let difference = Vector3::from(point.actual_in_machine_m) - correction.position_m;
        for d in 0..3 {
            let variance = reported[(d, d)] - repeatability[d];
            score.error += difference[d].powi(2);
            score.reported += variance;
            score.bound += least[(d, d)] - repeatability[d];
            score.inside += usize::from(difference[d].abs() <= BAND_95 * variance.sqrt());
        }
        score.coordinates += 3;
    }
    Ok(score)
}

/// A campaign in the columns that `identify` reads.
fn campaign_text(campaign: &Campaign) -> anyhow::Result<String> {
    let mut text = "station,line,time_s,x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm,length_mm".to_owned();
    campaign.covariates.iter().for_each(|c| text.extend([",", &cell_text(&c.name)]));
    text.push('\n');
    for (row, r) in campaign.readings.iter().enumerate() {
        let names = [&campaign.stations[r.station as usize], &campaign.lines[r.line as usize]];
        let [station, line] = names.map(|name| cell_text(name));
        write!(text, "{station},{line},{:.3}", r.time_s)?;
        write_mm(&mut text, r.reading_m.iter().chain(&r.offset_m).chain([&r.length_m]))?;
        for covariate in &campaign.covariates {
            match covariate.values[row] {
                Some(value) => write!(text, ",{value}")?,
                None => text.push(','),
            }
        }
        text.push('\n');
    }
    Ok(text)
}

/// Verification points with the same covariates and the actual position.
fn verification_text(campaign: &Campaign, points: &[VerificationPoint]) -> anyhow::Result<String> {
    let mut text = "point,time_s,x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm".to_owned();
    campaign.covariates.iter().for_each(|c| text.extend([",", &cell_text(&c.name)]));
    text.push_str(",actual_x_mm,actual_y_mm,actual_z_mm\n");
    for (number, point) in points.iter().enumerate() {
        write!(text, "{number},{:.3}", point.time_s)?;
        write_mm(&mut text, point.reading_m.iter().chain(&point.offset_m))?;
        point.covariates.iter().try_for_each(|value| write!(text, ",{value}"))?;
        write_mm(&mut text, point.actual_m.iter())?;
        text.push('\n');
    }
    Ok(text)
}

fn write_mm<'a>(text: &mut String, metres: impl Iterator<Item = &'a f64>) -> std::fmt::Result {
    metres.into_iter().try_for_each(|metre| write!(text, ",{:.7}", metre * 1e3))
}
