//! Residual vectors as CSV, with the model that leaves them in the head of the file.
//!
//! Place in the flow: `abbe residuals` writes, `abbe train`, `compare` and `diagnose --residuals` read
//! ([`crate::read_residual_vectors_file`]). Columns `x_mm y_mm z_mm` (corrected point, machine frame), `res_x_um res_y_um
//! res_z_um` (actual − corrected), `u_x_um u_y_um u_z_um` (k = 1) where known, `time_s` and `block` where known, then
//! covariates. The origin stands in a comment, since the table itself may come from any software:
//! `# abbe residuals machine=bridge_xyz model_sha256=… data_sha256=…`.

use crate::atomic::AtomicFile;
use crate::csv_bytes::TableBytes;
use crate::dialect::separator;
use crate::envelope::{hex, sha256_of_hex};
use crate::error::{FileError, Place};
use crate::export::commented;
use crate::points_csv::unwritten;
use crate::residual_file::ResidualOwner;
use crate::units::{micrometres_from_m, millimetres_from_m};
use abbe_measurement::residual_vector::ResidualVector;
use csv::Writer;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;

const MARK: &str = "# abbe residuals ";
/// Decimal places of coordinates in mm (no field changes over 100 nm) and of residuals in µm (0.1 nm).
const DIGITS: usize = 4;

/// Where residual vectors come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ResidualOrigin {
    /// Machine and geometric model that leave them.
    pub owner: ResidualOwner,
    /// SHA-256 of the campaign or points they were computed from, 64 hexadecimal digits.
    pub data_sha256: String,
}

/// Writes residual vectors, the whole file or nothing. All rows have uncertainties or none, likewise time and block.
///
/// # Errors
/// What the system says.
pub fn write_residual_vectors(
    path: &Path,
    rows: &[ResidualVector],
    origin: &ResidualOrigin,
    notes: &[String],
) -> Result<(), FileError> {
    let file = path.display().to_string();
    let mut output = AtomicFile::create(path)?;
    let ResidualOrigin { owner, data_sha256 } = origin;
    let mut head = format!(
        "{MARK}machine={} model_sha256={} data_sha256={data_sha256}\n",
        owner.machine,
        hex(&owner.model_sha256)
    );
    head += &commented(notes, "#");
    output.write_all(head.as_bytes()).map_err(FileError::io(&file, "write"))?;
    let mut writer = Writer::from_writer(&mut output);
    write_rows(&mut writer, rows).map_err(|error| unwritten(&file, error))?;
    drop(writer);
    output.commit()
}

fn write_rows<W: Write>(writer: &mut Writer<W>, rows: &[ResidualVector]) -> csv::Result<()> {
    let has = |part: fn(&ResidualVector) -> bool| !rows.is_empty() && rows.iter().all(part);
    let (u, time, block) = (has(|r| r.u_m.is_some()), has(|r| r.time_s.is_some()), has(|r| r.block.is_some()));
    let mut names: Vec<&str> = rows.iter().flat_map(|row| row.covariates.keys().map(String::as_str)).collect();
    names.sort_unstable();
    names.dedup();
    let mut header = vec!["x_mm", "y_mm", "z_mm", "res_x_um", "res_y_um", "res_z_um"];
    header.extend(["u_x_um", "u_y_um", "u_z_um"].iter().filter(|_| u));
    header.extend(time.then_some("time_s"));
    header.extend(block.then_some("block"));
    header.extend(&names);
    writer.write_record(&header)?;
    for row in rows {
        for value_m in row.position_m {
            writer.write_field(format!("{:.DIGITS$}", millimetres_from_m(value_m)))?;
        }
        for value_m in row.residual_m.iter().chain(row.u_m.iter().flatten().filter(|_| u)) {
            writer.write_field(format!("{:.DIGITS$}", micrometres_from_m(*value_m)))?;
        }
        if let (true, Some(seconds)) = (time, row.time_s) {
            writer.write_field(seconds.to_string())?;
        }
        if let (true, Some(name)) = (block, &row.block) {
            writer.write_field(name)?;
        }
        for name in &names {
            writer.write_field(row.covariates.get(*name).map_or(String::new(), f64::to_string))?;
        }
        writer.write_record(None::<&[u8]>)?;
    }
    writer.flush()?;
    Ok(())
}

/// Where the residual vectors of a file come from; `None` where it does not say.
///
/// # Errors
/// A head that says it wrongly, or what the system says.
pub fn read_residual_origin(path: &Path) -> Result<Option<ResidualOrigin>, FileError> {
    let file = path.display().to_string();
    let input = File::open(path).map_err(FileError::io(&file, "open the data"))?;
    // No head is longer than this; a table is not read to its end for it.
    let bytes = TableBytes::new(input, &file)?;
    let mut lines = BufReader::new(bytes.take(1 << 16));
    let mut bytes = Vec::new();
    for line in 1.. {
        bytes.clear();
        lines.read_until(b'\n', &mut bytes).map_err(|error| lines.get_ref().get_ref().told(error, &file, line))?;
        let text = String::from_utf8_lossy(&bytes);
        // Excel fills comments up with delimiters when it saves.
        let text = text.trim().trim_end_matches([',', ';', '\t']);
        if let Some(words) = text.strip_prefix(MARK.trim_end()) {
            return origin_of(words, &file, line).map(Some);
        }
        if bytes.is_empty() || !(text.is_empty() || text.starts_with('#') || separator(&bytes).is_some()) {
            break;
        }
    }
    Ok(None)
}

fn origin_of(words: &str, file: &str, line: u64) -> Result<ResidualOrigin, FileError> {
    let word = |key: &str| {
        let found = words.split_whitespace().find_map(|word| word.strip_prefix(key)?.strip_prefix('='));
        found.ok_or_else(|| {
            let place = Place::file(file).line(line).key(key);
            FileError::content(
                place,
                "the head of the file lacks it",
                "compute the residuals again, or remove the line",
            )
        })
    };
    let hash = |key: &str| {
        let text = word(key)?;
        sha256_of_hex(text).ok_or_else(|| {
            let place = Place::file(file).line(line).key(key);
            FileError::content(
                place,
                "the hash is not 64 hexadecimal digits",
                "compute the residuals again, or remove the line",
            )
        })
    };
    let owner = ResidualOwner { machine: word("machine")?.to_owned(), model_sha256: hash("model_sha256")? };
    Ok(ResidualOrigin { owner, data_sha256: hex(&hash("data_sha256")?) })
}
