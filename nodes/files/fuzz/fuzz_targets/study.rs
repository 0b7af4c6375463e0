//! Any bytes as data of calibrations without a tracer: no panic.

#![no_main]

use abbe_files::{read_diagonals, read_positions, read_residual_vectors, read_runs, read_sphere_centres};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let _ = read_residual_vectors(bytes, "fuzz");
    let _ = read_runs(bytes, "fuzz");
    let _ = read_sphere_centres(bytes, "fuzz");
    let _ = read_diagonals(bytes, "fuzz");
    let _ = read_positions(bytes, "fuzz");
});
