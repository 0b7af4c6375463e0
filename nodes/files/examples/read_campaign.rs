//! Reads a campaign and says how long that took: `cargo run --release --example read_campaign -- FILE`.

use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), abbe_files::FileError> {
    for file in std::env::args().skip(1) {
        let started = Instant::now();
        let read = abbe_files::read_campaign_file(Path::new(&file), None)?;
        let (readings, columns) = (read.campaign.readings.len(), read.campaign.covariates.len());
        println!("{file}: {readings} readings, {columns} covariates in {:.3} s", started.elapsed().as_secs_f64());
    }
    Ok(())
}
