//! `abbe simulate`: a campaign, verification points and the truth behind them, from the virtual machine.
//!
//! Place in the flow: trials without hardware. With `--trials`, identifies many such campaigns and compares the
//! achieved error with the uncertainty that the fit reports.

use crate::verification::rms_and_max_m;
use abbe_files::{MachineFile, read_machine, write_atomically};
use abbe_geometry::Vector3;
use abbe_geometry::correct::correct;
use abbe_geometry::effects::{NoCovariates, State};
use abbe_identify::{Options, identify};
use abbe_measurement::campaign::Campaign;
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::instrument::InstrumentConfig;
use abbe_virtual_machine::machine::Roughness;
use abbe_virtual_machine::plan::presets::case_like;
use abbe_virtual_machine::verification::{Frame, VerificationConfig, VerificationPoint};
use abbe_virtual_machine::{
    SimulationConfig, TruthRecipe, simulate_campaign, verification_points, verification_points_with,
};
use anyhow::{Context, ensure};
use std::fmt::Write;
use std::path::PathBuf;

/// Raw volumetric error of the simulated machine (rms, m): a bridge CMM before compensation.
const VOLUMETRIC_RMS_M: f64 = 20e-6;
/// Verification points.
const POINTS: usize = 400;
/// How well the verification points are known (m).
const KNOWN_TO_M: f64 = 0.05e-6;

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
    #[arg(long, required_unless_present = "trials")]
    out: Option<PathBuf>,
    /// Repeat the plan until the campaign has at least this many readings
    #[arg(long)]
    readings: Option<u64>,
    /// Identify this many machines (seeds from --seed on) and print achieved error and coverage
    #[arg(long)]
    trials: Option<u64>,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let machine = read_machine(&arguments.machine)?;
    if let Some(trials) = arguments.trials {
        return run_trials(&machine, arguments.seed, trials);
    }
    let out = arguments.out.as_ref().context("name a folder with --out")?;
    std::fs::create_dir_all(out).with_context(|| format!("{}: cannot be made", out.display()))?;
    let mut config = config(&machine, arguments.seed)?;
    if let Some(readings) = arguments.readings {
        config.plan = config.plan.repeated_to(readings)?;
    }
    let campaign = simulate_campaign(&config)?.campaign;
    let verification =
        VerificationConfig { points: POINTS, seed: arguments.seed, frame: Frame::Unknown, known_to_m: KNOWN_TO_M };
    let points = verification_points_with(&config, &verification)?;
    write_atomically(&out.join("campaign.csv"), campaign_text(&campaign)?.as_bytes())?;
    write_atomically(&out.join("verify.csv"), verification_text(&campaign, &points)?.as_bytes())?;
    println!("{}: {} readings, {} verification points", out.display(), campaign.readings.len(), points.len());
    Ok(())
}

fn config(machine: &MachineFile, seed: u64) -> anyhow::Result<SimulationConfig> {
    let recipe = TruthRecipe { seed, roughness: Roughness::TYPICAL, volumetric_rms_m: VOLUMETRIC_RMS_M };
    let truth = recipe.bridge_xyz()?;
    for (simulated, (lower_m, upper_m)) in truth.stroke_m.iter().zip(machine.machine.stroke_m) {
        ensure!(
            *simulated == [lower_m, upper_m],
            "machine {}: the simulator has a bridge XYZ machine of 800 x 600 x 600 mm; give launch-config/machines/bridge_xyz.toml",
            machine.machine.name
        );
    }
    let plan = case_like(truth.stroke_m, seed).build()?;
    let instrument = InstrumentConfig {
        range: machine.instrument,
        repeatability_m: machine.machine.repeatability_m,
        ..InstrumentConfig::LASER_TRACER
    };
    Ok(SimulationConfig {
        seed,
        machine: truth,
        plan,
        instrument,
        environment: EnvironmentConfig::workshop(),
        effects: Vec::new(),
    })
}

fn run_trials(machine: &MachineFile, first_seed: u64, trials: u64) -> anyhow::Result<()> {
    ensure!(trials > 0, "--trials must be at least 1");
    println!(
        "{:>6} {:>10} {:>10} {:>10} {:>10} {:>12}",
        "seed", "rms_um", "u_rms_um", "rms/u", "chi2/dof", "inside_95_%"
    );
    let (mut errors, mut spreads, mut inside, mut total) = (0.0, 0.0, 0_usize, 0_usize);
    for seed in first_seed..first_seed + trials {
        let config = config(machine, seed)?;
        let campaign = simulate_campaign(&config)?.campaign;
        let found = identify(&machine.machine, machine.instrument, &campaign, &Options::default(), &mut |_| true)?;
        let (mut differences, mut variance, mut within) = (Vec::new(), 0.0, 0_usize);
        for point in verification_points(&config, POINTS, seed)? {
            let state = State { reading_m: point.reading_m, offset_m: point.offset_m, covariates: &NoCovariates };
            let correction = correct(&found.model, &state);
            let covariance = correction.covariance_m2.context("a verification point lies outside the machine")?;
            let difference = Vector3::from(point.actual_in_machine_m) - correction.position_m;
            // The truth carries no repeatability, so it does not belong into this comparison.
            let spread = |d: usize| covariance[(d, d)] - machine.machine.repeatability_m[d].powi(2);
            variance += (0..3).map(spread).sum::<f64>();
            within += (0..3).filter(|d| difference[*d].abs() <= 1.96 * spread(*d).sqrt()).count();
            differences.push(difference);
        }
        let count = differences.len();
        let (rms_m, _) = rms_and_max_m(differences.into_iter());
        let spread_m = (variance / count as f64).sqrt();
        let share = 100.0 * within as f64 / (3 * count) as f64;
        let chi2 = found.evidence.chi2_per_dof;
        println!(
            "{seed:>6} {:>10.3} {:>10.3} {:>10.3} {chi2:>10.3} {share:>12.1}",
            rms_m * 1e6,
            spread_m * 1e6,
            rms_m / spread_m
        );
        errors += rms_m * rms_m;
        spreads += spread_m * spread_m;
        inside += within;
        total += 3 * count;
    }
    let share = 100.0 * inside as f64 / total as f64;
    println!("{:>6} {:>10} {:>10} {:>10.3} {:>10} {share:>12.1}", "all", "", "", (errors / spreads).sqrt(), "");
    Ok(())
}

/// A campaign in the columns that `identify` reads.
fn campaign_text(campaign: &Campaign) -> anyhow::Result<String> {
    let mut text = "station,line,time_s,x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm,length_mm".to_owned();
    campaign.covariates.iter().for_each(|c| text.extend([",", &c.name]));
    text.push('\n');
    for (row, r) in campaign.readings.iter().enumerate() {
        write!(text, "{},{},{:.3}", campaign.stations[r.station as usize], campaign.lines[r.line as usize], r.time_s)?;
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
    campaign.covariates.iter().for_each(|c| text.extend([",", &c.name]));
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
