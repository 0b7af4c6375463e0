//! Fuzz target: any bytes as the CDR of every message.

#![no_main]

#[allow(dead_code)] // each target uses its part
#[path = "../exercise.rs"]
mod exercise;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| exercise::decode_cdr(bytes));
