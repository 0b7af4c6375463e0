//! Outputs that have a folder, replace no input, and do not replace each other.
//!
//! Place in the flow: the first thing that a command does which reads files and writes files: before work that would be lost, and
//! before a file is gone that was measured. Existing files that are no input of the same command are replaced.

use anyhow::bail;
use std::path::{Path, PathBuf};

/// Refuses outputs that cannot be written to their folder, or that are an input or each other. `-` stands for standard input or
/// output.
pub fn check<'o, 'i>(
    outputs: impl IntoIterator<Item = &'o Path>,
    inputs: impl IntoIterator<Item = &'i Path>,
) -> anyhow::Result<()> {
    let is_file = |path: &&Path| path.as_os_str() != "-";
    let inputs: Vec<PathBuf> = inputs.into_iter().filter(is_file).filter_map(|path| path.canonicalize().ok()).collect();
    let mut before: Vec<PathBuf> = Vec::new();
    for output in outputs.into_iter().filter(is_file) {
        let shown = output.display();
        let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let (true, Ok(whole)) = (folder.is_dir(), folder.canonicalize()) else {
            bail!("{shown}: there is no folder {}; make it, or write elsewhere", folder.display());
        };
        if output.extension().is_some_and(|ending| ending == "gz" || ending == "zst") {
            bail!(
                "{shown}: tables are written as they are; name it without this ending, or pack it (--out - | gzip > FILE)"
            );
        }
        // A link is followed when it is written, so it counts as what it points to.
        let whole = output.canonicalize().unwrap_or_else(|_| whole.join(output.file_name().unwrap_or_default()));
        if inputs.contains(&whole) {
            bail!("{shown}: this file is read here, and would be lost; write to another one");
        }
        if before.contains(&whole) {
            bail!("{shown}: two files would be written here; give --out another name");
        }
        before.push(whole);
    }
    Ok(())
}

/// Refuses a folder in which a file of one of these names is an input; the folder need not be there yet.
pub(crate) fn check_in_folder<'a>(
    folder: &Path,
    names: &[&str],
    inputs: impl IntoIterator<Item = &'a Path>,
) -> anyhow::Result<()> {
    if !folder.is_dir() {
        return Ok(());
    }
    let outputs: Vec<PathBuf> = names.iter().map(|name| folder.join(name)).collect();
    check(outputs.iter().map(PathBuf::as_path), inputs)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // helpers of a test

    use super::*;

    #[test]
    fn inputs_and_missing_folders_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("in.csv"), "x").unwrap();
        #[cfg(unix)]
        std::os::unix::fs::symlink(at("in.csv"), at("link.csv")).unwrap();
        let said = |outputs: &[&Path]| {
            let outcome = check(outputs.iter().copied(), [at("in.csv").as_path(), Path::new("-")]);
            outcome.map_err(|error| error.to_string())
        };
        assert_eq!(said(&[&at("out.csv"), Path::new("-")]), Ok(()));
        let link = cfg!(unix).then(|| at("link.csv"));
        for own in [at("in.csv"), at("./in.csv")].into_iter().chain(link) {
            assert!(said(&[&own]).unwrap_err().contains("would be lost"), "{}", own.display());
        }
        assert!(said(&[&at("none/out.csv")]).unwrap_err().contains("there is no folder"));
        assert!(said(&[&at("a.html"), &at("a.html")]).unwrap_err().contains("two files"));
        assert!(said(&[&at("a.csv.gz")]).unwrap_err().contains("written as they are"));
    }
}
