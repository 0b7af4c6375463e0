//! Any lines from both sides through the relay: no panic, and what it is told never comes out as it was.

#![no_main]

use abbe_ippdme::relay::{Correct, Offsets, Out, Purpose, Relay, Settings};
use libfuzzer_sys::fuzz_target;

struct Moved;

impl Correct for Moved {
    fn corrected_m(&mut self, indicated_m: [f64; 3], _offset_m: [f64; 3], _purpose: Purpose) -> Result<[f64; 3], String> {
        Ok(indicated_m.map(|m| m + 1e-5))
    }
}

fuzz_target!(|data: &[u8]| {
    let offsets = Offsets { of_any_m: Some([0.0; 3]), ..Offsets::default() };
    let inverts_targets = data.first().is_some_and(|byte| byte % 2 == 1);
    let mut relay = Relay::new(Settings { offsets, inverts_targets, scans_as_asked: true, ..Settings::default() });
    let mut to_server = 0_usize;
    for line in data.split_inclusive(|byte| *byte == b'\n') {
        let outs = match line.first() {
            Some(b'>') => relay.from_client(&line[1..], &mut Moved),
            _ => relay.from_server(line, &mut Moved),
        };
        to_server += outs.iter().filter(|out| matches!(out, Out::ToServer(_))).count();
    }
    // The relay asks by itself only after it was asked something.
    assert!(to_server <= data.len());
    let _ = relay.abandon();
});
