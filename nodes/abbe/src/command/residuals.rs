//! `abbe residuals`: model and measured data in, residual vectors (actual − corrected) with their uncertainty out.
//!
//! Place in the flow: between identification and training. From a tracer campaign: by multilateration where stations
//! measured the same points, else as a vector field estimated from ranges. From points with known actual position: after
//! rigid alignment. What the data do not show is refused or left uncertain, never filled in.

use super::bag_in_place;
use crate::next::Next;
use crate::output;
use crate::pipeline::{BagJoin, LoadedCampaign, load_campaign};
use crate::progress::spinner;
use crate::residual_bag::{self, BagPoint};
use crate::verdict::{self, Accept};
use crate::verification::correct_points;
use abbe_diagnose::study::vectors::ResidualVector;
use abbe_files::{
    ADDED_COLUMNS, MachineFile, ModelFile, PointRow, PointsReader, ResidualOrigin, ResidualOwner, header_names, hex,
    write_residual_vectors,
};
use abbe_geometry::Vector3;
use abbe_geometry::correct::{Status, correct};
use abbe_geometry::effects::{CovariateSource, CovariateValue, State};
use abbe_identify::TIME;
use abbe_identify::verdict::Counted;
use abbe_measurement::campaign::Campaign;
use abbe_report::digits;
use abbe_residual_data::{
    Frame, FromRanges, PointResidual, Progress, RangeOptions, SharedPoints, from_known_points, from_ranges,
    shared_points,
};
use abbe_runtime::Shutdown;
use anyhow::{Context, ensure};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::PathBuf;

/// Share of the readings that must belong to shared points for these to be used alone.
const MOSTLY_SHARED: f64 = 0.5;

/// Vectors that `abbe train` and `abbe interpolate` take at least.
const LEAST_TRAINED: usize = 20;
const LEAST_INTERPOLATED: usize = 8;

/// Arguments of `residuals`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Model file
    #[arg(long)]
    model: PathBuf,
    /// Tracer campaign (CSV, .mcap or rosbag2 folder), or points with actual_x_mm, actual_y_mm, actual_z_mm (CSV)
    #[arg(long)]
    campaign: PathBuf,
    #[command(flatten)]
    join: BagJoin,
    /// CSV to write, or a bag where it does not end in .csv
    #[arg(long)]
    out: PathBuf,
    /// How residuals come out of a tracer campaign; left out, from shared points where most readings belong to one
    #[arg(long, value_enum)]
    from: Option<Source>,
    /// Points to estimate at, at most, where they are estimated from ranges
    #[arg(long, default_value_t = RangeOptions::default().points)]
    points: usize,
    /// Readings that an estimate from ranges uses at most; its time grows with the cube
    #[arg(long, default_value_t = RangeOptions::default().readings)]
    readings: usize,
    /// Standard uncertainty (k = 1) in µm of each coordinate of the known actual positions
    #[arg(long)]
    u_actual_um: Option<f64>,
    #[command(flatten)]
    accept: Accept,
}

/// Where residual vectors of a tracer campaign come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Source {
    /// Points that at least three stations measured.
    SharedPoints,
    /// A vector field estimated from all ranges.
    Ranges,
}

/// Residuals of a kind of data, in words too.
struct Computed {
    points: Vec<PointResidual>,
    /// What else is known of each point.
    rows: Vec<Row>,
    data_sha256: String,
    notes: Vec<String>,
}

/// What a row of the data says beside the residual.
struct Row {
    reading_m: [f64; 3],
    offset_m: [f64; 3],
    time_s: Option<f64>,
    block: Option<String>,
    covariates: BTreeMap<String, f64>,
}

impl CovariateSource for Row {
    fn covariate(&self, name: &str) -> CovariateValue {
        let logged = self.covariates.get(name).copied().or(self.time_s.filter(|_| name == TIME));
        logged.map_or(CovariateValue::Missing, CovariateValue::Fresh)
    }
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    output::check([arguments.out.as_path()], [arguments.model.as_path(), arguments.campaign.as_path()])?;
    let (model, sha256) = ModelFile::load(&arguments.model)?;
    let known = header_names(&arguments.campaign).is_some_and(|names| names.iter().any(|name| name == "actual_x_mm"));
    let computed = if known {
        ensure!(arguments.from.is_none(), "--from is for tracer campaigns; these points know their actual position");
        of_known_points(arguments, &model)?
    } else {
        ensure!(arguments.u_actual_um.is_none(), "--u-actual-um is for points with known actual position");
        of_campaign(arguments, &model)?
    };
    let owner = ResidualOwner { machine: model.model.parts().machine.name.clone(), model_sha256: sha256 };
    write(arguments, &model, &computed, owner)?;
    for (place, note) in computed.notes.iter().enumerate() {
        println!("{}{note}", if place == 0 { "" } else { "  " });
    }
    println!("  vectors           {}", arguments.out.display());
    println!("  of model          sha256 {}", hex(&sha256));
    next(arguments, computed.points.len()).print();
    Ok(())
}

/// What takes so many vectors.
fn next(arguments: &Arguments, count: usize) -> Next {
    let is_table = arguments.out.extension().is_some_and(|extension| extension == "csv");
    match count {
        LEAST_TRAINED.. => Next::new("to learn them as a field", "train")
            .file("--residuals", &arguments.out)
            .text("--out residual.json"),
        LEAST_INTERPOLATED.. if is_table => {
            println!("  {count} are too few for abbe train, which takes {LEAST_TRAINED} or more");
            Next::new("to have the residuals between the points", "interpolate")
                .file("--vectors", &arguments.out)
                .text("--at POINTS.csv --out errors.csv")
        }
        _ => {
            println!(
                "  {count} are too few for a field: abbe train takes {LEAST_TRAINED} or more; measure more points"
            );
            Next::new("to plan more", "plan --machine MACHINE.toml --request REQUEST.toml --out plan")
        }
    }
}

/// Writes a table or a bag, by the name.
fn write(arguments: &Arguments, model: &ModelFile, computed: &Computed, owner: ResidualOwner) -> anyhow::Result<()> {
    let Computed { points, rows, data_sha256, notes } = computed;
    if arguments.out.extension().is_some_and(|extension| extension == "csv") {
        let origin = ResidualOrigin { owner, data_sha256: data_sha256.clone() };
        let vectors: Vec<ResidualVector> = points.iter().zip(rows).map(|(point, row)| vector(point, row)).collect();
        return Ok(write_residual_vectors(&arguments.out, &vectors, &origin, notes)?);
    }
    let bag_point = |(number, (point, row)): (usize, (&PointResidual, &Row))| {
        let state = State { reading_m: row.reading_m, offset_m: row.offset_m, covariates: row };
        let (point, correction) = (point.clone(), correct(&model.model, &state));
        BagPoint {
            point,
            reading_m: row.reading_m,
            offset_m: row.offset_m,
            correction,
            time_s: row.time_s.unwrap_or(number as f64),
        }
    };
    let points: Vec<BagPoint> = points.iter().zip(rows).enumerate().map(bag_point).collect();
    let frame_id = &model.model.parts().machine.frame_id;
    bag_in_place(&arguments.out, |unfinished| residual_bag::write(unfinished, &points, &owner, frame_id))
}

fn of_known_points(arguments: &Arguments, model: &ModelFile) -> anyhow::Result<Computed> {
    let name = arguments.campaign.display().to_string();
    let open = || File::open(&arguments.campaign).with_context(|| format!("{name}: cannot be opened"));
    let points = correct_points(open()?, &name, model, None)?;
    if !points.tally.is_inside() {
        let words = points.tally.words(&model.model, &name, "line");
        eprintln!("abbe: {words}; what the model does wrongly outside counts as residual");
    }
    ensure!(
        points.tally.count(Status::InVolume) > 0,
        "{name}: no point is inside what the model was identified from; give points of its volume and offsets"
    );
    let actual_m: Vec<Vector3<f64>> = points.rows.iter().filter_map(|row| row.actual_m).map(Vector3::from).collect();
    if let Some(u_um) = arguments.u_actual_um {
        ensure!(u_um.is_finite() && u_um > 0.0, "--u-actual-um {u_um}: must be above 0");
    }
    // A point is measured at one stop: the reference's uncertainty and the machine's repeatability together.
    let repeatability_m = Vector3::from(model.model.parts().machine.repeatability_m);
    let u_m = arguments.u_actual_um.map(|u_um| repeatability_m.map(|r| r.hypot(u_um * 1e-6)));
    let found = from_known_points(&points.corrected_m, &actual_m, u_m).with_context(|| name.clone())?;
    let reader = PointsReader::verification(open()?, &name, model.model.parts().machine.default_offset_m)?;
    let covariates = covariates_of_points(reader, &points.rows)?;
    let row = |(row, mut covariates): (&PointRow, BTreeMap<String, f64>)| {
        let time_s = covariates.remove(TIME);
        Row { reading_m: row.reading_m, offset_m: row.offset_m, time_s, block: None, covariates }
    };
    let rows = points.rows.iter().zip(covariates.0).map(row).collect();
    let notes = vec![
        format!("residuals of {} points with known actual position, aligned rigidly", found.len()),
        rms_note(&found),
    ];
    Ok(Computed { points: found, rows, data_sha256: hex(&covariates.1), notes })
}

/// Covariates of each row by name, and the hash of their file.
type Covariates = (Vec<BTreeMap<String, f64>>, [u8; 32]);

/// Numeric columns of the points beside readings, offsets and truth, and the hash of the file.
fn covariates_of_points(mut reader: PointsReader<File>, rows: &[PointRow]) -> anyhow::Result<Covariates> {
    // Columns of a corrected file say nothing that the residuals do not.
    let own = |name: &&String| !ADDED_COLUMNS.contains(&name.as_str()) && !name.starts_with("res_");
    let names: Vec<String> = reader.columns().iter().filter(own).cloned().collect();
    let of = |row: &PointRow| {
        let covariates = reader.covariates(row);
        let value = |name: &String| match covariates.covariate(name) {
            CovariateValue::Fresh(value) => Some((name.clone(), value)),
            CovariateValue::Missing | CovariateValue::Stale => None,
        };
        names.iter().filter_map(value).collect()
    };
    let found = rows.iter().map(of).collect();
    let mut row = PointRow::default();
    while reader.read(&mut row)? {}
    Ok((found, reader.sha256()))
}

fn of_campaign(arguments: &Arguments, model: &ModelFile) -> anyhow::Result<Computed> {
    let parts = model.model.parts();
    let machine = MachineFile {
        machine: parts.machine.clone(),
        instrument: model.instrument,
        absolute_range: model.absolute_range,
        order: model.order,
        identity: None,
    };
    let loaded = load_campaign(&arguments.campaign, &machine, &arguments.join)?;
    // The same data pull on the model's parameters only once.
    let own = model.data.iter().any(|source| source.sha256 == loaded.source.sha256);
    let (found, mut notes) = match shared(arguments, model, &loaded, own)? {
        Some(shared) => (shared.points, shared.notes),
        None => ranges(arguments, model, &loaded, own)?,
    };
    notes.push(rms_note(&found));
    let campaign = &loaded.campaign;
    let row = |point: &PointResidual| {
        let reading = &campaign.readings[point.row];
        Row {
            reading_m: reading.reading_m,
            offset_m: reading.offset_m,
            time_s: Some(reading.time_s),
            block: campaign.lines.get(reading.line as usize).cloned(),
            covariates: covariates_of(campaign, point.row),
        }
    };
    let rows = found.iter().map(row).collect();
    Ok(Computed { points: found, rows, data_sha256: loaded.source.sha256.clone(), notes })
}

struct Shared {
    points: Vec<PointResidual>,
    notes: Vec<String>,
}

/// Residuals of shared points, where these are wanted or where most readings belong to one.
fn shared(
    arguments: &Arguments,
    model: &ModelFile,
    loaded: &LoadedCampaign,
    own: bool,
) -> anyhow::Result<Option<Shared>> {
    if arguments.from == Some(Source::Ranges) {
        return Ok(None);
    }
    let SharedPoints { points, readings: (used, all), rejected, chi2_per_dof, frame } =
        shared_points(&model.model, model.instrument, &loaded.campaign, own)
            .with_context(|| loaded.source.file.clone())?;
    if arguments.from.is_none() && (used as f64) < MOSTLY_SHARED * all as f64 {
        return Ok(None);
    }
    ensure!(
        !points.is_empty(),
        "{}: no point was measured from three stations or more; measure the same points from each, or leave --from out",
        loaded.source.file
    );
    let mut notes = vec![format!(
        "residuals of {} points that three stations or more saw, from {used} of {all} readings",
        points.len()
    )];
    let counted = Counted { what: "readings", rejected, all: all + rejected };
    let verdict = verdict::of_fit(chi2_per_dof, Some(counted));
    verdict::check(&verdict, arguments.accept, &loaded.source.file, || serde_json::Value::Null)?;
    if let Some((chi2, _)) = chi2_per_dof {
        notes.push(format!("stations agree to χ² per degree of freedom {chi2:.2} of the declared noise"));
    }
    notes.push(match frame {
        Frame::Network => {
            "stations found together with the points, from ranges alone; residuals hold no common shift or turn"
                .to_owned()
        }
        Frame::Model { why } => {
            format!("stations of the model, which may have taken up a part of what it lacks: {why}")
        }
    });
    notes.extend(verdict.findings.iter().map(|finding| finding.to_string()));
    Ok(Some(Shared { points, notes }))
}

fn ranges(
    arguments: &Arguments,
    model: &ModelFile,
    loaded: &LoadedCampaign,
    own: bool,
) -> anyhow::Result<(Vec<PointResidual>, Vec<String>)> {
    ensure!(arguments.points > 0 && arguments.readings > 0, "--points and --readings must be above 0");
    let shutdown = Shutdown::on_signals()?;
    let bar = spinner("residual field from ranges");
    let mut observe = |progress: Progress| {
        bar.set_message(match progress {
            Progress::Searching(count) => format!("how smooth it is, trial {count}"),
            Progress::Estimating => "estimating the vectors".to_owned(),
        });
        !shutdown.requested()
    };
    let options = RangeOptions { points: arguments.points, readings: arguments.readings, ..RangeOptions::default() };
    let found = from_ranges(&model.model, model.instrument, &loaded.campaign, own, &options, &mut observe);
    bar.finish_and_clear();
    let FromRanges { points, unseen_points, unseen_components, prior, evidence, noise_without, readings } =
        found.with_context(|| loaded.source.file.clone())?;
    let counted = Counted { what: "readings", rejected: readings.1, all: readings.0 + readings.1 };
    let degrees = readings.0;
    let verdict = verdict::of_fit(Some((prior.noise.powi(2), degrees)), Some(counted));
    verdict::check(&verdict, arguments.accept, &loaded.source.file, || serde_json::Value::Null)?;
    let um = |m: [f64; 3]| {
        let decimals = digits::of_group(m.map(|v| v * 1e6));
        m.map(|v| digits::plain(v * 1e6, decimals)).join(" ")
    };
    let mm = |m: [f64; 3]| m.map(|v| format!("{:.0}", v * 1e3)).join(" ");
    let notes = vec![
        format!(
            "residuals of {} points, a vector field estimated from {} ranges ({} rejected); neighbouring rows share their error",
            points.len(),
            readings.0,
            readings.1
        ),
        format!(
            "field of {} µm (x y z) that changes over {} mm; evidence {evidence:.0}, noise {noise_without:.2} → {:.2} of the declared",
            um(prior.amplitude_m),
            mm(prior.length_m),
            prior.noise
        ),
        format!(
            "{unseen_points} points left out and {unseen_components} components uncertain: beside the noise the ranges tell no more of them than the size of the field"
        ),
    ];
    let findings = verdict.findings.iter().map(|finding| finding.to_string());
    Ok((points, notes.into_iter().chain(findings).collect()))
}

fn covariates_of(campaign: &Campaign, reading: usize) -> BTreeMap<String, f64> {
    let value = |column: &abbe_measurement::campaign::Covariate| {
        Some((column.name.clone(), column.values.get(reading).copied().flatten()?))
    };
    campaign.covariates.iter().filter_map(value).collect()
}

fn vector(point: &PointResidual, row: &Row) -> ResidualVector {
    ResidualVector {
        position_m: point.point_m.into(),
        residual_m: point.residual_m.into(),
        u_m: point.covariance_m2.map(|covariance_m2| std::array::from_fn(|d| covariance_m2[(d, d)].max(0.0).sqrt())),
        time_s: row.time_s,
        block: row.block.clone(),
        covariates: row.covariates.clone(),
        ..ResidualVector::default()
    }
}

fn rms_note(points: &[PointResidual]) -> String {
    let square = points.iter().map(|p| p.residual_m.norm_squared()).sum::<f64>() / points.len().max(1) as f64;
    let most = points.iter().map(|p| p.residual_m.norm()).fold(0.0, f64::max);
    format!("residual {} µm rms, {} µm at most", digits::result(square.sqrt() * 1e6), digits::result(most * 1e6))
}
