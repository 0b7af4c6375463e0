//! What `train` and `compare` have in common: residual vectors as a field, and the configuration.
//!
//! Place in the flow: files in, what the training crate takes out. Points by the inputs that were named ([`crate::inputs`]), residuals
//! in m, machine frame.

use crate::held::{Held, hold};
use crate::inputs::{Inputs, samples};
use abbe::plane_field::{PlaneField, plane_field};
use abbe::{is_bag, residual_bag};
use abbe_field::{MeasuredField, Samples};
use abbe_files::{
    Lacks, ResidualOwner, read_input_vectors_file, read_residual_origin, read_residual_vectors_file,
    refuse_several_tips,
};
use abbe_geometry::Vector3;
use abbe_measurement::correspondence::check_vectors;
use abbe_residual_training::Config;
use anyhow::{Context, ensure};
use std::path::Path;

/// Residual vectors of a file, but for those that contradict all others.
pub(crate) struct Data {
    /// Points by all inputs, residuals and their uncertainty.
    pub(crate) field: Samples,
    /// The same by the position alone, where there are other inputs and it is known.
    pub(crate) alone: Option<Samples>,
    /// The geometric model that leaves them, if the file says so.
    pub(crate) owner: Option<ResidualOwner>,
    /// Name of the file without its folder.
    pub(crate) file: String,
    /// SHA-256 of its bytes.
    pub(crate) sha256: [u8; 32],
    /// What was not measured: nothing of a volume.
    pub(crate) lacks: Lacks,
    /// Vectors that contradict all others, in words.
    pub(crate) left_out: Vec<String>,
}

impl Data {
    /// Reads residual vectors from CSV or a bag.
    pub(crate) fn read(path: &Path, inputs: &Inputs) -> anyhow::Result<Data> {
        if !inputs.is_position_alone() {
            return Data::read_inputs(path, inputs);
        }
        let (rows, owner, sha256) = if is_bag(path) {
            let (rows, owner, sha256) = residual_bag::read(path)?;
            (rows, Some(owner), sha256)
        } else {
            let table = read_residual_vectors_file(path)?;
            (table.rows, read_residual_origin(path)?.map(|origin| origin.owner), table.sha256)
        };
        let points_m = rows.iter().map(|row| Vector3::from(row.position_m)).collect();
        let residual_m: Vec<Vector3<f64>> = rows.iter().map(|row| Vector3::from(row.residual_m)).collect();
        check_vectors(&residual_m, owner.is_some()).with_context(|| path.display().to_string())?;
        let u_m: Option<Vec<Vector3<f64>>> = rows.iter().map(|row| row.u_m.map(Vector3::from)).collect();
        // Points are counted from 0 in messages of the library, rows of a file are not: the row is the point's place in it.
        let field = MeasuredField::new(points_m, residual_m, u_m)
            .with_context(|| format!("{} (points are its rows, from 0)", path.display()))?;
        Data::held(path, (Samples::from(&field), None), owner, sha256, Lacks::default())
    }

    /// Reads residual vectors by named inputs.
    fn read_inputs(path: &Path, inputs: &Inputs) -> anyhow::Result<Data> {
        let name = path.display();
        ensure!(
            !is_bag(path),
            "{name}: a bag of residual vectors has positions alone; write them as CSV (abbe residuals --out NAME.csv)"
        );
        let (table, has_position) = read_input_vectors_file(path)?;
        refuse_several_tips(&name.to_string(), (&table.rows, &table.lines), |column| inputs.is_further(column))?;
        let owner = read_residual_origin(path)?.map(|origin| origin.owner);
        let residual_m: Vec<Vector3<f64>> = table.rows.iter().map(|row| Vector3::from(row.residual_m)).collect();
        check_vectors(&residual_m, owner.is_some()).with_context(|| name.to_string())?;
        let field = samples(&table.rows, inputs, has_position).with_context(|| name.to_string())?;
        let alone = has_position.then(|| samples(&table.rows, &Inputs::position(), true));
        let alone = match alone.transpose() {
            Ok(alone) => alone,
            Err(why) => {
                eprintln!("abbe: {name}: the position alone is no rival of these inputs: {why:#}");
                None
            }
        };
        Data::held(path, (field, alone), owner, table.sha256, Lacks::default())
    }

    /// Reads residual vectors of a volume or a plane.
    pub(crate) fn read_plane(path: &Path, inputs: &Inputs) -> anyhow::Result<Data> {
        if is_bag(path) || !inputs.is_position_alone() {
            return Data::read(path, inputs);
        }
        let PlaneField { field, lacks, sha256, .. } = plane_field(path)?;
        let owner = read_residual_origin(path)?.map(|origin| origin.owner);
        check_vectors(field.errors_m(), owner.is_some()).with_context(|| path.display().to_string())?;
        Data::held(path, (Samples::from(&field), None), owner, sha256, lacks)
    }

    /// Without the vectors that contradict all others.
    fn held(
        path: &Path,
        (field, alone): (Samples, Option<Samples>),
        owner: Option<ResidualOwner>,
        sha256: [u8; 32],
        lacks: Lacks,
    ) -> anyhow::Result<Data> {
        let Held { field, alone, left_out } = hold(&path.display().to_string(), field, alone)?;
        Ok(Data { field, alone, owner, file: file_name(path), sha256, lacks, left_out })
    }

    /// The points by their position (m), where that is known.
    pub(crate) fn places_m(&self) -> Option<Vec<Vector3<f64>>> {
        self.alone.as_ref().or(Some(&self.field).filter(|field| field.has_position())).map(Samples::places)
    }

    /// Number of points.
    pub(crate) fn points(&self) -> usize {
        self.field.count()
    }
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// The configuration of a training; without a file, the defaults.
pub(crate) fn read_config(path: Option<&Path>) -> anyhow::Result<Config> {
    let Some(path) = path else { return Ok(Config::default()) };
    let text = std::fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let config: Config = toml::from_str(&text).with_context(|| path.display().to_string())?;
    config.check().with_context(|| path.display().to_string())?;
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    fn shipped() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch-config/training/defaults.toml")
    }

    #[test]
    fn the_shipped_configuration_shows_every_key_with_its_default() {
        assert_eq!(read_config(Some(&shipped())).unwrap(), Config::default());
        let text = std::fs::read_to_string(shipped()).unwrap();
        let written = toml::to_string(&Config::default()).unwrap();
        for line in written.lines().filter(|line| !line.is_empty()) {
            let key = line.split_once(" =").map_or(line, |(key, _)| key);
            assert!(text.lines().any(|shown| shown.starts_with(key)), "{key} is not shown");
        }
    }

    #[test]
    fn unknown_keys_and_values_out_of_range_are_refused_by_file_and_key() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.toml");
        for (text, says) in
            [("epoch = 3", "epoch"), ("[optimiser]\nepochs = 0", "optimiser.epochs"), ("[network]\nheads = 3", "heads")]
        {
            std::fs::write(&path, text).unwrap();
            let error = format!("{:#}", read_config(Some(&path)).unwrap_err());
            assert!(error.contains("t.toml") && error.contains(says), "{error}");
        }
    }
}
