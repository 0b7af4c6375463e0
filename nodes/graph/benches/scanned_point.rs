//! Time that the relay adds to a scanned point, beside bare passing of the same lines in the same run, as a ratio.
//!
//! `cargo bench -p abbe-graph --bench scanned_point`: lines of scans of 10 points each, through the relay with the correcting
//! function of a machine, and through what only cuts lines and passes them on. A network is in neither.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A benchmark fails by panicking.

#[path = "../tests/common/mod.rs"]
mod common;

use abbe_graph::proxy::Corrector;
use abbe_ippdme::line::{Lines, Piece};
use abbe_ippdme::relay::{Offsets, Out, Relay, Settings};
use common::{HASH, bench};
use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

const LINES: usize = 2_000;
const POINTS: usize = 10;
const ROUNDS: usize = 15;

/// Lines of one scan all over the volume.
fn scan() -> Vec<u8> {
    let share = |k: usize, factor: f64| (k as f64 * factor).fract();
    let point = |k: usize| {
        let [x, y, z] = [750.0 * share(k, 0.819_172_5), 550.0 * share(k, 0.671_043_6), 500.0 * share(k, 0.549_700_5)];
        format!("{x:.5},{y:.5},{z:.5},0.00000")
    };
    let line = |k: usize| (0..POINTS).map(|j| point(k * POINTS + j)).collect::<Vec<_>>().join(",");
    (0..LINES).map(|k| format!("00016 # {}\r\n", line(k))).collect::<String>().into_bytes()
}

/// Median of the rounds, for one point.
fn a_point(mut round: impl FnMut() -> usize) -> Duration {
    let mut times: Vec<Duration> = (0..ROUNDS)
        .map(|_| {
            let since = Instant::now();
            let bytes = black_box(round());
            assert!(bytes > LINES * POINTS * 8, "every line came out");
            since.elapsed()
        })
        .collect();
    times.sort();
    times[ROUNDS / 2] / u32::try_from(LINES * POINTS).unwrap()
}

fn main() {
    let scan = scan();
    let pieces = |bytes: &[u8]| Lines::default().take(bytes);
    let bare = a_point(|| {
        let mut out = Vec::new();
        for piece in pieces(black_box(&scan)) {
            let Piece::Line(line) = piece else { continue };
            out.extend_from_slice(&line);
        }
        out.len()
    });
    let mut corrector = Corrector::new(Arc::clone(&bench().model), HASH, None, true).unwrap();
    let offsets = Offsets { of_any_m: Some([0.0, 0.0, -0.06]), ..Offsets::default() };
    let mut relay = Relay::new(Settings { offsets, scans_as_asked: true, ..Settings::default() });
    relay.from_client(b"00001 StartSession()\r\n", &mut corrector);
    relay.from_server(b"00001 &\r\n", &mut corrector);
    relay.from_server(b"00001 %\r\n", &mut corrector);
    let mut outs = relay.from_client(b"00016 ScanOnLine(0,0,0,1,1,1,0,0,1,1)\r\n", &mut corrector);
    // What the relay asks by itself.
    while let [Out::ToServer(line)] = outs.as_slice() {
        let asked = String::from_utf8(line.clone()).unwrap();
        let (tag, command) = asked.split_at(5);
        let data = match command.trim().split('(').next().unwrap() {
            "GetMachineClass" => "GetMachineClass(CartCMM)",
            "GetCoordSystem" => "CoordSystem(MachineCsy)",
            "GetProp" => "Tool.Name(\"Probe1\")",
            _ => break,
        };
        outs = [format!("{tag} &\r\n"), format!("{tag} # {data}\r\n"), format!("{tag} %\r\n")]
            .iter()
            .flat_map(|line| relay.from_server(line.as_bytes(), &mut corrector))
            .collect();
    }
    let corrected = a_point(|| {
        let mut out = Vec::new();
        for piece in pieces(black_box(&scan)) {
            let Piece::Line(line) = piece else { continue };
            for passed in relay.from_server(&line, &mut corrector) {
                if let Out::ToClient(line) = passed {
                    out.extend_from_slice(&line);
                }
            }
        }
        out.len()
    });
    assert_eq!(relay.counts().refused, 0);
    println!("bare passing: {bare:?} a point; relay: {corrected:?} a point");
    println!("ratio: {:.1}", corrected.as_secs_f64() / bare.as_secs_f64());
}
