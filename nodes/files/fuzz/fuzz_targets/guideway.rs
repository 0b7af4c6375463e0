//! Any bytes as targets of a guideway: no panic, and every accepted reading is one that a tracker can make.

#![no_main]

use abbe_files::{SeenTarget, read_guideway};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(file) = read_guideway(bytes, "fuzz") else { return };
    for row in &file.rows {
        assert!(row.position_m.is_finite());
        match row.seen {
            SeenTarget::Reading(reading) => assert!(reading.check().is_ok()),
            SeenTarget::Point { point_m, .. } => assert!(point_m.iter().all(|value| value.is_finite())),
        }
    }
});
