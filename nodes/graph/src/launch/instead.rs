//! Files that a launch uses instead of those that its launch file names.
//!
//! Place in the flow: given to `abbe launch`, which hands them to every node it starts, so that one launch file serves several
//! machines and models.

use super::{Launch, LaunchError};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Files in place of those of a launch file; `None` leaves the launch file's own. Relative paths are relative to the launch
/// file, as those in it are.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Instead {
    /// Machine file.
    pub machine: Option<PathBuf>,
    /// Model file.
    pub model: Option<PathBuf>,
    /// Residual model file.
    pub residual_model: Option<PathBuf>,
}

impl Instead {
    /// Each file with the option of `abbe node` that names it.
    fn named(&self) -> [(&'static str, &Option<PathBuf>); 3] {
        [("--machine", &self.machine), ("--model", &self.model), ("--residual", &self.residual_model)]
    }

    /// The options that give a node the same files.
    pub fn options(&self) -> Vec<OsString> {
        let given = self.named().into_iter().filter_map(|(option, file)| Some((option, file.as_ref()?)));
        given.flat_map(|(option, file)| [OsString::from(option), file.clone().into_os_string()]).collect()
    }

    /// The option and the path of the first file that is not there.
    pub fn missing(&self) -> Option<(&'static str, &Path)> {
        let given = self.named().into_iter().filter_map(|(option, file)| Some((option, file.as_deref()?)));
        given.into_iter().find(|(_, file)| !file.is_file())
    }

    /// Puts the files where the launch file had its own.
    fn put_into(&self, launch: &mut Launch) {
        if let Some(machine) = &self.machine {
            launch.machine.clone_from(machine);
        }
        if self.model.is_some() {
            launch.model.clone_from(&self.model);
        }
        if self.residual_model.is_some() {
            launch.residual_model.clone_from(&self.residual_model);
        }
    }
}

impl Launch {
    /// Reads and checks a launch file with other files instead of its own.
    pub fn read_with(path: &Path, instead: &Instead) -> Result<Launch, LaunchError> {
        let mut launch = Launch::read(path)?;
        instead.put_into(&mut launch);
        launch.check(path)?;
        Ok(launch)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_files_that_are_given_take_the_place_of_others() {
        let text = include_str!("../../../../launch-config/bridge_xyz_virtual.toml");
        let own = Launch::parse(text, Path::new("launch.toml")).unwrap();
        let mut launch = own.clone();
        Instead::default().put_into(&mut launch);
        assert_eq!(launch, own);

        let instead = Instead { model: Some("other.json".into()), ..Instead::default() };
        instead.put_into(&mut launch);
        assert_eq!(launch.model.as_deref(), Some(Path::new("other.json")));
        assert_eq!(Launch { model: own.model.clone(), ..launch }, own);
    }

    #[test]
    fn a_node_is_given_what_the_launch_was_given() {
        assert_eq!(Instead::default().options(), Vec::<OsString>::new());
        let all = Instead {
            machine: Some("m.toml".into()),
            model: Some("model.json".into()),
            residual_model: Some("r.json".into()),
        };
        let words = ["--machine", "m.toml", "--model", "model.json", "--residual", "r.json"];
        assert_eq!(all.options(), words.map(OsString::from));
    }

    #[test]
    fn the_first_file_that_is_not_there_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let there = folder.path().join("machine.toml");
        std::fs::write(&there, "").unwrap();
        let instead =
            Instead { machine: Some(there), model: Some(folder.path().join("none.json")), ..Instead::default() };
        assert_eq!(instead.missing().unwrap().0, "--model");
        assert_eq!(Instead { model: None, ..instead }.missing(), None);
    }
}
