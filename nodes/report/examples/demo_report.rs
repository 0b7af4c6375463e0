//! Writes the report of a synthetic campaign, to look at: `cargo run -p abbe-report --example demo_report -- <folder>`.
//!
//! In: a folder. Out: `report.html`, `report.png` and `report.json` in it.

#[path = "../tests/common/mod.rs"]
mod common;

use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).ok_or("name the folder to write to")?);
    let report = common::demo_report(7);
    std::fs::create_dir_all(&folder)?;
    std::fs::write(folder.join("report.html"), report.html()?)?;
    std::fs::write(folder.join("report.png"), report.png()?)?;
    std::fs::write(folder.join("report.json"), report.json()?)?;
    Ok(())
}
