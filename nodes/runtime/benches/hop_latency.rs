//! Latency of one hop between two processes over shared memory and over DDS.
fn main() {}
