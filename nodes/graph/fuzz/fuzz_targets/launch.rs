//! Any bytes as a launch file: an error or a checked configuration that reads back the same, never a panic.

#![no_main]

use abbe_graph::launch::Launch;
use libfuzzer_sys::fuzz_target;
use std::path::Path;

fuzz_target!(|data: &[u8]| {
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Ok(launch) = Launch::parse(text, Path::new("fuzz.toml")) {
        let again = launch.to_text().and_then(|text| Launch::parse(&text, Path::new("fuzz.toml")));
        assert!(matches!(again, Ok(again) if again == launch));
    }
});
