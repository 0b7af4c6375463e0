//! Any bytes as a table of any dialect, plain or packed: no panic in any reader, and points that are handed through read back as
//! the same points.

#![no_main]

#[path = "../exercise.rs"]
mod exercise;

use abbe_files::{
    PointRow, PointsReader, read_campaign, read_diagonals, read_guideway, read_lengths,
    read_positions, read_probed_points, read_residual_vectors, read_runs, read_sphere_centres,
};
use exercise::handed_through;
use libfuzzer_sys::fuzz_target;

fn read_all(bytes: &[u8]) {
    let _ = read_campaign(bytes, "fuzz", Some([0.0; 3]));
    let _ = read_diagonals(bytes, "fuzz");
    let _ = read_guideway(bytes, "fuzz");
    let _ = read_lengths(bytes, "fuzz");
    let _ = read_positions(bytes, "fuzz");
    let _ = read_probed_points(bytes, "fuzz");
    let _ = read_residual_vectors(bytes, "fuzz");
    let _ = read_runs(bytes, "fuzz");
    let _ = read_sphere_centres(bytes, "fuzz");
    if let Ok(mut reader) = PointsReader::verification(bytes, "fuzz", None) {
        let mut row = PointRow::default();
        while let Ok(true) = reader.read(&mut row) {
            assert!(row.reading_m.iter().chain(row.actual_m.iter().flatten()).all(|value| value.is_finite()));
        }
    }
}

fuzz_target!(|bytes: &[u8]| {
    let packed;
    let bytes = match bytes.split_first() {
        Some((b'z', rest)) => {
            packed = zstd::encode_all(rest, 1).expect("memory can be written to");
            packed.as_slice()
        }
        _ => bytes,
    };
    read_all(bytes);
    if let Some((points, through)) = handed_through(bytes)
        && !points.is_empty()
    {
        let again = read_positions(through.as_slice(), "through").expect("what was written can be read");
        assert_eq!(again, points);
    }
});
