//! Any text as a request of `abbe plan`: no panic.

#![no_main]

use abbe_files::parse_plan_request;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    let _ = parse_plan_request(text, "fuzz");
});
