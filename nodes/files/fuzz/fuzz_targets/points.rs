//! Any bytes as points to be corrected: no panic, and every accepted row is finite.

#![no_main]

use abbe_files::{PointRow, PointsReader};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(mut reader) = PointsReader::new(bytes, "fuzz", Some([0.0; 3])) else { return };
    let mut row = PointRow::default();
    while let Ok(true) = reader.read(&mut row) {
        assert!(row.reading_m.iter().chain(&row.offset_m).all(|value| value.is_finite()));
    }
});
