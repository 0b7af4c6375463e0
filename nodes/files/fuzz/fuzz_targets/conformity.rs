//! Any bytes as measured lengths, probed points and runs: no panic, and every accepted row is finite.

#![no_main]

use abbe_files::{read_lengths, read_probed_points, read_runs};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(file) = read_lengths(bytes, "fuzz") {
        assert!(file.measurements.iter().all(|m| m.calibrated_m.is_finite() && m.error.metres().is_finite()));
    }
    if let Ok(file) = read_probed_points(bytes, "fuzz") {
        assert!(file.points_m.iter().flat_map(|point| point.iter()).all(|value| value.is_finite()));
    }
    if let Ok(file) = read_runs(bytes, "fuzz") {
        assert!(file.rows.iter().all(|run| run.target_m.is_finite() && run.measured_m.is_finite()));
    }
});
