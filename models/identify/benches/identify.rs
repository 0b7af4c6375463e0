//! Speed of identification (filled in with the benchmark proper).
fn main() {}
