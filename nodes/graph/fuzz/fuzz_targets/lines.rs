//! Any text as column names and a line of a box: a reading or a refusal in words, never a panic.

#![no_main]

use abbe_files::{MachineFile, read_machine};
use abbe_graph::driver::{LinesConfig, LinesFrom, Role};
use libfuzzer_sys::fuzz_target;
use std::path::Path;
use std::sync::OnceLock;

const SIGNS: [&str; 6] = [",", ";", "blank", "|", "\t", "ab"];

fn machine() -> &'static MachineFile {
    static MACHINE: OnceLock<MachineFile> = OnceLock::new();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../launch-config/machines/bridge_xyz.toml");
    MACHINE.get_or_init(|| read_machine(&path).unwrap())
}

fuzz_target!(|data: &[u8]| {
    let Some((choice, rest)) = data.split_first() else { return };
    let Ok(text) = std::str::from_utf8(rest) else { return };
    let Some((names, line)) = text.split_once('\n') else { return };
    let choice = usize::from(*choice);
    let config = LinesConfig {
        from: LinesFrom::Tcp("a:1".to_owned()),
        separator: SIGNS[choice % SIGNS.len()].to_owned(),
        decimal: if choice & 64 == 0 { "." } else { "," }.to_owned(),
        columns: Vec::new(),
        offset_mm: (choice & 128 == 0).then_some([0.0; 3]),
        station: Some("S1".to_owned()),
        u_length_um: Some(1.0),
        silent_after_s: 5.0,
    };
    for role in [Role::Scale, Role::Tracer, Role::Sensor] {
        if let Err(words) = config.try_line(role, machine(), names, line) {
            assert!(!words.is_empty());
        }
    }
});
