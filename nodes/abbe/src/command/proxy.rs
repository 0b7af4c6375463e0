//! `abbe proxy`: stands between measuring software and a machine's I++ DME server, and corrects the positions that pass.
//!
//! Place in the flow: live, without ROS 2. Model and residual model as `abbe correct` takes them; the same function corrects.

use crate::residual::{inputs_of, load_residual};
use abbe_files::ModelFile;
use abbe_graph::proxy::{Corrector, ProxyConfig, Summary, listen, serve};
use abbe_ippdme::relay::{Offsets, Settings};
use abbe_msgs::Sha256;
use abbe_runtime::Shutdown;
use anyhow::{Context, anyhow, ensure};
use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

/// Longest offset of a tip (mm).
const LONGEST_OFFSET_MM: f64 = 1e4;

/// Arguments of `proxy`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Address that measuring software connects to, such as 127.0.0.1:1294
    #[arg(long)]
    listen: String,
    /// The machine's own I++ DME server, as HOST:1294
    #[arg(long)]
    to: String,
    /// Model file
    #[arg(long)]
    model: PathBuf,
    /// Residual model that belongs to this model
    #[arg(long)]
    residual: Option<PathBuf>,
    /// Offset of a tool's tip from the ram reference point, as NAME=X,Y,Z in millimetres in the ram frame; once for each tool
    #[arg(long = "tool", value_name = "NAME=X,Y,Z")]
    tools: Vec<String>,
    /// The same of every tool without a --tool of its own, as X,Y,Z
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    offset_mm: Option<String>,
    /// Ask the server for the offset of tools without one (Tool.AvrOffsets)
    #[arg(long)]
    server_offsets: bool,
    /// Turn commanded targets back, so that the tip goes where it is told
    #[arg(long)]
    invert_targets: bool,
    /// The server writes the values of a scan in the order that OnScanReport asked for; scans are refused otherwise
    #[arg(long)]
    scans_as_asked: bool,
    /// Let positions pass as they came that cannot be corrected, and say so on standard error; an error to the software otherwise
    #[arg(long)]
    pass_uncorrected: bool,
    /// Correct with effects whose temperatures nobody tells in the middle of their range; such a model is refused otherwise
    #[arg(long)]
    without_covariates: bool,
    /// A command that is not of the protocol and reports no position; once for each
    #[arg(long, value_name = "COMMAND")]
    harmless: Vec<String>,
    /// Folder of a bag with every reported position, as indicated and as corrected
    #[arg(long, value_name = "FOLDER")]
    record: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let shutdown = Shutdown::on_signals()?;
    let offsets = offsets(arguments)?;
    let (model, sha256) = ModelFile::load(&arguments.model)?;
    let residual = arguments.residual.as_deref().map(|path| load_residual(path, &model, &sha256)).transpose()?;
    let effects = model.model.parts().effects.iter().filter(|fitted| fitted.corrects());
    let of_effects = effects.flat_map(|fitted| fitted.effect.covariates());
    let needed: Vec<String> = of_effects.chain(inputs_of(residual.as_ref())).collect();
    ensure!(
        needed.is_empty() || arguments.without_covariates,
        "{}: the model needs {}, which no measuring software tells; correct with them in the middle of their range with --without-covariates, \
         or run the driver ippdme in a launch file",
        arguments.model.display(),
        needed.join(", ")
    );
    let model = Arc::new(model.model);
    let corrector = Corrector::new(model, Sha256::from_bytes(sha256), residual, arguments.without_covariates);
    let mut corrector = corrector.map_err(|problem| anyhow!("{}: {problem}", arguments.model.display()))?;
    let listener = listen(&arguments.listen)?;
    if let Some(folder) = &arguments.record {
        ensure!(!folder.exists(), "{}: exists already; name a new folder", folder.display());
        corrector.record(folder)?;
    }
    let settings = Settings {
        offsets,
        inverts_targets: arguments.invert_targets,
        scans_as_asked: arguments.scans_as_asked,
        passes_uncorrected: arguments.pass_uncorrected,
        harmless: arguments.harmless.clone(),
    };
    let config = ProxyConfig { to: arguments.to.clone(), settings };
    // Not `eprintln!`: it goes on whether or not somebody reads this.
    let address = listener.local_addr().context("the address that it listens on is not known")?;
    let _ = writeln!(std::io::stderr(), "abbe: listening on {address}, corrects for {}; Ctrl-C ends it", arguments.to);
    let summary = serve(&listener, &config, &mut corrector, &shutdown)?;
    for line in words(&summary, arguments) {
        let _ = writeln!(std::io::stderr(), "abbe: {line}");
    }
    Ok(())
}

fn words(summary: &Summary, arguments: &Arguments) -> Vec<String> {
    let counts = summary.counts;
    let by_status: Vec<String> = summary.by_status.iter().map(|(status, count)| format!("{count} {status}")).collect();
    let mut lines = vec![format!(
        "{} connections; lines with positions: {} corrected, {} refused, {} passed uncorrected; {} commands with targets turned back",
        summary.connections, counts.corrected, counts.refused, counts.uncorrected, counts.targets
    )];
    lines.extend((!by_status.is_empty()).then(|| format!("positions: {}", by_status.join(", "))));
    lines.extend(arguments.record.as_ref().map(|folder| {
        format!("{}: {} messages, {} not recorded", folder.display(), summary.recorded, summary.unrecorded)
    }));
    lines
}

fn offsets(arguments: &Arguments) -> anyhow::Result<Offsets> {
    let mut offsets = Offsets { from_server: arguments.server_offsets, ..Offsets::default() };
    for text in &arguments.tools {
        let (name, offset) = text.rsplit_once('=').with_context(|| format!("--tool {text}: write NAME=X,Y,Z"))?;
        let offset_m = offset_m(offset).with_context(|| format!("--tool {text}"))?;
        let twice = offsets.by_tool_m.insert(name.to_owned(), offset_m).is_some();
        ensure!(!name.is_empty() && !twice, "--tool {text}: name each tool once");
    }
    if let Some(text) = &arguments.offset_mm {
        offsets.of_any_m = Some(offset_m(text).with_context(|| format!("--offset-mm {text}"))?);
    }
    ensure!(
        !offsets.by_tool_m.is_empty() || offsets.of_any_m.is_some() || offsets.from_server,
        "where the tips of the tools stand is not known; name each with --tool NAME=X,Y,Z, give one for all with --offset-mm, \
         or ask the server with --server-offsets"
    );
    Ok(offsets)
}

/// Metres of X,Y,Z in millimetres.
fn offset_m(text: &str) -> anyhow::Result<[f64; 3]> {
    let numbers: Vec<f64> = text.split(',').map(|part| part.trim().parse()).collect::<Result<_, _>>()?;
    let is_plausible = numbers.iter().all(|mm: &f64| mm.abs() <= LONGEST_OFFSET_MM);
    match <[f64; 3]>::try_from(numbers) {
        Ok(offset_mm) if is_plausible => Ok(offset_mm.map(|mm| mm / 1e3)),
        Ok(_) => Err(anyhow!("a tip stands {LONGEST_OFFSET_MM} mm from the ram at most")),
        Err(numbers) => Err(anyhow!("three numbers are needed, and {} stand there", numbers.len())),
    }
}
