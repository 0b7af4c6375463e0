//! `abbe train`, `abbe compare`: their arguments, and the handing over to the program that trains.
//!
//! Place in the flow: training needs a framework of networks, most of what there is to compile, and nobody needs it to identify
//! or correct. So it is a program of its own, `abbe-train`, which this process becomes: same arguments, streams and signals. It
//! is looked for beside this program, then on the path, and must be of this very version.

use crate::help::VERSION;
use crate::identity::IdentityOptions;
use anyhow::{Context, bail, ensure};
use std::env::consts::EXE_SUFFIX;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The program that trains.
pub const PROGRAM: &str = "abbe-train";
/// How to get it, said where it is missing or of another version.
const HOW_TO_GET: &str = "`cargo install --path nodes/train` in Abbe's sources installs it, `cargo build --release -p abbe-train` puts \
                          it beside an abbe that was built there, and the Debian package has both";

/// Arguments of `train`.
#[derive(Debug, clap::Args)]
pub struct TrainArguments {
    /// Residual vectors: CSV or bag of abbe residuals, or CSV of any other software
    #[arg(long)]
    pub residuals: PathBuf,
    /// Residual model to write; its report is written beside it, ending in .html
    #[arg(long)]
    pub out: PathBuf,
    /// What the residual depends on: position (x, y and z) and names of further columns, such as position,temp_air_c
    #[arg(long, value_delimiter = ',', default_value = "position")]
    pub inputs: Vec<String>,
    /// Configuration (TOML); left out, the paper's values
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Geometric model that leaves these residuals, where the file does not say
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Where networks are trained
    #[arg(long, value_enum, default_value_t = Processor::Cpu)]
    pub device: Processor,
    /// Go on with a training that was stopped
    #[arg(long)]
    pub resume: bool,
    /// Who measured, when, with which
    #[command(flatten)]
    pub identity: IdentityOptions,
}

/// Where networks are trained.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Processor {
    /// Processor; the same bytes each time
    Cpu,
    /// Graphics card, in programs built with it; as good, but other bytes from card to card
    Wgpu,
}

/// Arguments of `compare`.
#[derive(Debug, clap::Args)]
pub struct CompareArguments {
    /// Residual vectors: CSV or bag of abbe residuals, or CSV of any other software, of a volume or a plane
    #[arg(long)]
    pub residuals: PathBuf,
    /// What the residual may depend on: position (x, y and z) and names of further columns; compared with the position alone
    #[arg(long, value_delimiter = ',', default_value = "position")]
    pub inputs: Vec<String>,
    /// Splits and trainings, each with a seed of its own
    #[arg(long)]
    pub seeds: Option<usize>,
    /// Configuration of the training (TOML); left out, the paper's values
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Page with the figures of each method, as HTML
    #[arg(long, value_name = "FILE")]
    pub html: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
    /// Who measured, when, with which
    #[command(flatten)]
    pub identity: IdentityOptions,
}

/// Becomes the program that trains, which gets the words of this one's command line. Comes back only with an error.
pub(super) fn hand_over() -> anyhow::Result<()> {
    let own = std::env::current_exe().ok();
    let path = std::env::var_os("PATH");
    let Some(program) = find(own.as_deref(), path.as_deref()) else {
        bail!(
            "training is the work of the program {PROGRAM}, which is neither beside this one nor on the path; {HOW_TO_GET}"
        );
    };
    let shown = program.display();
    let asked = Command::new(&program).arg("--version").stdin(Stdio::null()).output();
    let asked = asked.with_context(|| format!("{shown}: cannot be started; {HOW_TO_GET}"))?;
    let said = String::from_utf8_lossy(&asked.stdout);
    let (said, wanted) = (said.lines().next().unwrap_or_default(), format!("{PROGRAM} {VERSION}"));
    ensure!(
        asked.status.success() && said == wanted,
        "{shown}: this is {said:?}, and abbe {VERSION} trains with {wanted:?} only; {HOW_TO_GET}"
    );
    let mut training = Command::new(&program);
    training.args(std::env::args_os().skip(1));
    Err(turn_into(training)).with_context(|| format!("{shown}: cannot be started; {HOW_TO_GET}"))
}

#[cfg(unix)]
fn turn_into(mut program: Command) -> std::io::Error {
    std::os::unix::process::CommandExt::exec(&mut program)
}

/// Where no process becomes another: waits for it, and ends as it ends. Ctrl-C reaches both, and is that program's to heed.
#[cfg(not(unix))]
fn turn_into(mut program: Command) -> std::io::Error {
    if let Err(error) = abbe_runtime::Shutdown::on_signals() {
        tracing::warn!(%error, "Ctrl-C ends this program before the one that trains");
    }
    match program.status() {
        Ok(ended) => std::process::exit(ended.code().unwrap_or(i32::from(crate::exit::REFUSED))),
        Err(error) => error,
    }
}

/// The first of these: beside the running program, then in the folders of the path.
fn find(own: Option<&Path>, path: Option<&OsStr>) -> Option<PathBuf> {
    let beside = own.and_then(Path::parent).map(Path::to_owned);
    let folders = path.into_iter().flat_map(std::env::split_paths);
    // An empty entry of the path would be the current folder.
    let folders = folders.filter(|folder| !folder.as_os_str().is_empty());
    beside
        .into_iter()
        .chain(folders)
        .map(|folder| folder.join(format!("{PROGRAM}{EXE_SUFFIX}")))
        .find(|program| program.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_program_beside_this_one_comes_before_those_on_the_path_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let [beside, first, second] = ["beside", "first", "second"].map(|name| folder.path().join(name));
        let path = std::env::join_paths([&first, &second]).unwrap();
        let found = || find(Some(&beside.join("abbe")), Some(&path));
        assert_eq!(found(), None);
        let name = format!("{PROGRAM}{EXE_SUFFIX}");
        // A folder of that name is no program.
        std::fs::create_dir_all(first.join(&name)).unwrap();
        for place in [&second, &beside] {
            std::fs::create_dir_all(place).unwrap();
            std::fs::write(place.join(&name), "").unwrap();
            assert_eq!(found(), Some(place.join(&name)));
        }
        assert_eq!(find(None, None), None);
    }
}
