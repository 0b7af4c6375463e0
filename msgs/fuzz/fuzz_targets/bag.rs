//! Fuzz target: any bytes as a bag.

#![no_main]

#[allow(dead_code)] // each target uses its part
#[path = "../exercise.rs"]
mod exercise;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| exercise::read_bag(bytes));
