//! Fuzz target: any bytes as a damaged bag.

#![no_main]

#[allow(dead_code)] // each target uses its part
#[path = "../exercise.rs"]
mod exercise;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| exercise::recover_bag(bytes));
