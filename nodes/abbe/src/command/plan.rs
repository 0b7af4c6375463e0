//! `abbe plan`: stations and lines of a tracer campaign, and what it will reach, before anything is measured.
//!
//! Place in the flow: machine file and request in; path, stations, programs and report out. With `--campaign` the plan adds to
//! what was measured. Ctrl-C keeps the best plan so far.

use crate::exit::Ended;
use crate::identity::{IdentityOptions, Said};
use crate::output;
use crate::pipeline::{self, BagJoin};
use crate::planning::{self, Sources};
use crate::progress::spinner;
use crate::provenance::hashed;
use abbe_files::{
    MachineFile, ModelFile, PlanRequestFile, dme, gcode, path_csv, read_machine, read_plan_request, stations_csv,
    write_atomically,
};
use abbe_geometry::ErrorId;
use abbe_graph::capture::identify_options;
use abbe_identify::{Belief, IdentifyOptions};
use abbe_plan::{Measured, Plan, PlanError, Progress, Request, Stage};
use abbe_report::digits;
use anyhow::{Context, anyhow, ensure};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// What is written into the folder.
const FILES: [&str; 6] = ["path.csv", "stations.csv", "path.nc", "path.dme", "plan.json", "report.html"];

/// Arguments of `plan`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Machine file (launch-config/machines/*.toml)
    #[arg(long)]
    machine: PathBuf,
    /// What there is and what is wanted: stands, holders, speeds, volume, uncertainty or time (TOML)
    #[arg(long)]
    request: PathBuf,
    /// Folder for path.csv, stations.csv, path.nc, path.dme, plan.json and report.html
    #[arg(long)]
    out: PathBuf,
    /// Earlier model of this machine: how much its errors bend, in place of `expected`
    #[arg(long, conflicts_with = "campaign")]
    model: Option<PathBuf>,
    /// Campaign already measured (CSV or bag): the plan adds the stations and lines that help most
    #[arg(long)]
    campaign: Option<PathBuf>,
    #[command(flatten)]
    join: BagJoin,
    /// Print the plan's figures as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    identity: IdentityOptions,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let others = arguments.model.iter().chain(&arguments.campaign);
    let inputs = others.chain([&arguments.machine, &arguments.request]).map(PathBuf::as_path);
    output::check_in_folder(&arguments.out, &FILES, inputs)?;
    let out = &arguments.out;
    ensure!(!out.exists() || out.is_dir(), "--out {}: this is a file; name a folder", out.display());
    // There is nothing to keep before the first line.
    let keeps = Arc::new(AtomicBool::new(false));
    let shutdown = crate::stop::keep_what_there_is(&keeps)?;
    let machine = read_machine(&arguments.machine)?;
    let file = read_plan_request(&arguments.request)?;
    let request = request(arguments, &machine, &file)?;
    let bar = spinner(&format!("planning {}", machine.machine.name));
    let mut observe = |progress: Progress| {
        bar.set_message(progress_words(&progress));
        keeps.store(matches!(progress.stage, Stage::Lines | Stage::Exchange), Ordering::Relaxed);
        !shutdown.requested()
    };
    let found = abbe_plan::plan(&request, &mut observe);
    bar.finish_and_clear();
    let plan = found.map_err(|error| placed(error, &file))?;
    let who = arguments.identity.gather(&Said { machine: Some(&machine), ..Said::default() })?.shown;
    let campaign = arguments.campaign.as_deref();
    let named = [
        ("Machine file", Some(&arguments.machine)),
        ("Request", Some(&arguments.request)),
        ("Measured before", arguments.campaign.as_ref()),
        ("Model", arguments.model.as_ref()),
    ];
    let files = named.into_iter().filter_map(|(label, path)| Some(hashed(label, path?)));
    let files = files.collect::<anyhow::Result<Vec<_>>>()?;
    let sources = Sources { machine: &machine, request: &request, campaign, who: &who, files };
    write(arguments, &machine, (&request, &plan), &sources)?;
    if arguments.json {
        println!("{}", serde_json::to_string_pretty(&planning::json(&sources, &plan))?);
    } else {
        print!("{}", planning::words(&sources, &plan, &arguments.out));
        planning::next().print();
    }
    if plan.stopped {
        return Err(Ended::stopped("stopped on request; the best plan so far was written".to_owned()).into());
    }
    Ok(())
}

/// Request file, machine file and what was measured before, as the planner takes them.
fn request(arguments: &Arguments, machine: &MachineFile, file: &PlanRequestFile) -> anyhow::Result<Request> {
    let options = identify_options(machine);
    let measured = measured(arguments, machine, &options)?;
    let belief = belief(arguments, machine, file, measured.as_ref())?;
    Ok(Request {
        machine: machine.machine.clone(),
        instrument: machine.instrument,
        options,
        volume_m: file.volume_m.unwrap_or(machine.machine.stroke_m),
        tips_m: file.tips_m.clone().unwrap_or_else(|| file.holders.iter().map(|holder| holder.offset_m).collect()),
        tracer: file.tracer,
        stands: file.stands.clone(),
        most_stations: file.most_stations,
        holders: file.holders.clone(),
        motion: file.motion.clone(),
        lines: file.lines,
        goal: file.goal,
        tell: file.tell.clone(),
        sensors: file.sensors.clone(),
        belief,
        seed: file.seed,
        measured,
    })
}

fn measured(
    arguments: &Arguments,
    machine: &MachineFile,
    options: &IdentifyOptions,
) -> anyhow::Result<Option<Measured>> {
    let Some(path) = &arguments.campaign else { return Ok(None) };
    let loaded = pipeline::load_campaign(path, machine, &arguments.join)?;
    let fit = abbe_identify::identify(&machine.machine, machine.instrument, &loaded.campaign, options, &mut |_| true);
    let fit = fit.with_context(|| loaded.source.file.clone())?;
    Ok(Some(Measured { campaign: loaded.campaign, fit }))
}

/// How much the errors bend: as the campaign or a model shows, or as the request expects.
fn belief(
    arguments: &Arguments,
    machine: &MachineFile,
    file: &PlanRequestFile,
    measured: Option<&Measured>,
) -> anyhow::Result<Belief> {
    if let Some(measured) = measured {
        return Ok(Belief::of_fit(&measured.fit));
    }
    if let Some(path) = &arguments.model {
        let (model, _) = ModelFile::load(path)?;
        let own = &model.model.parts().machine;
        ensure!(
            own.name == machine.machine.name,
            "{}: this model is of machine {}, not {}; name a model of this machine, or leave --model out and give [expected]",
            path.display(),
            own.name,
            machine.machine.name
        );
        return Ok(Belief::of_model(&model.model));
    }
    let [straightness_m, positioning_m, angle_rad] = file.expected.ok_or_else(|| {
        anyhow!(
            "{}: how much the machine's errors bend is not known, and what a campaign reaches depends on it; give [expected] with \
             straightness_um, positioning_um and angle_urad, or an earlier model with --model",
            file.place("expected")
        )
    })?;
    for (key, value) in [
        ("expected.straightness_um", straightness_m),
        ("expected.positioning_um", positioning_m),
        ("expected.angle_urad", angle_rad),
    ] {
        ensure!(
            value.is_finite() && value > 0.0 && value < 0.01,
            "{}: {} is no bend of an error; give what remains of it about a straight line, rms",
            file.place(key),
            value * 1e6
        );
    }
    let bend = |id: ErrorId| match (id.is_straightness(), id.is_angular()) {
        (true, _) => straightness_m,
        (_, true) => angle_rad,
        _ => positioning_m,
    };
    Ok(Belief::of_bends(&machine.machine, bend)?)
}

/// The error with the place of its key in the request file.
fn placed(error: PlanError, file: &PlanRequestFile) -> anyhow::Error {
    match &error {
        PlanError::Request { key, .. } => anyhow!("{}: {error}", without_key(&file.place(key))),
        PlanError::Budget { .. } => anyhow!("{}: {error}", without_key(&file.place("goal.budget_h"))),
        PlanError::Unreached { .. } => anyhow!("{}: {error}", without_key(&file.place("goal.uncertainty_um"))),
        PlanError::Stopped => Ended::stopped(error.to_string()).into(),
        _ => error.into(),
    }
}

fn without_key(place: &abbe_files::Place) -> abbe_files::Place {
    abbe_files::Place { item: None, ..place.clone() }
}

fn progress_words(progress: &Progress) -> String {
    let what = match progress.stage {
        Stage::Stands => "looking from the stands",
        Stage::Stations => "choosing stations",
        Stage::Lines => "adding lines",
        Stage::Exchange => "exchanging lines",
    };
    let best = progress
        .best_m
        .map_or_else(String::new, |best_m| format!(", {} µm over the volume", digits::result(best_m * 1e6)));
    format!("{what}, step {}{best}", progress.done)
}

fn write(
    arguments: &Arguments,
    machine: &MachineFile,
    (request, plan): (&Request, &Plan),
    sources: &Sources,
) -> anyhow::Result<()> {
    let out = &arguments.out;
    let contents: [Vec<u8>; 6] = [
        path_csv(&plan.nominal)?,
        stations_csv(&plan.stations)?,
        gcode((&plan.stations, &plan.lines), &request.motion, &machine.machine.name).into_bytes(),
        dme((&plan.stations, &plan.lines), &request.motion).into_bytes(),
        serde_json::to_vec_pretty(&planning::json(sources, plan))?,
        planning::report(sources, plan).html()?.into_bytes(),
    ];
    std::fs::create_dir_all(out).with_context(|| format!("{}: cannot be made", out.display()))?;
    FILES.iter().zip(contents).try_for_each(|(name, content)| Ok(write_atomically(&out.join(name), &content)?))
}
