//! Any text as lines of LinuxCNC's sampler: samples with instants, or a refusal in words, never a panic.

#![no_main]

use abbe_graph::driver::{LinesFrom, LinuxcncConfig, MachineUnits};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let config = LinuxcncConfig {
        from: LinesFrom::Tcp("a:1".to_owned()),
        units: if data.len() % 2 == 0 { MachineUnits::Mm } else { MachineUnits::Inch },
        period_s: 0.001,
        every_s: 0.001,
        late_s: 0.03,
        offset_mm: None,
        silent_after_s: 5.0,
    };
    if let Err(words) = config.try_lines(text) {
        assert!(!words.is_empty());
    }
});
