//! Any text as a machine file: no panic, and what is accepted is written and read again as the same machine.

#![no_main]

use abbe_files::{machine_text, parse_machine};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    if let Ok(file) = parse_machine(text, "fuzz") {
        let written = machine_text(&file).expect("an accepted machine can be written");
        parse_machine(&written, "written").expect("a written machine can be read");
    }
});
