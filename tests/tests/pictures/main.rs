//! The pictures of "How it works", drawn from figures that are computed here by the page's own equations.
//!
//! Place in the flow: beside the book. A picture that no longer is what it is drawn from fails; with `ABBE_WRITE_DOCS=1` all are written
//! anew. Each has a file of its own, and says in its last test what the reader is told to see.

#![allow(clippy::unwrap_used)] // a preparation that fails fails its test

mod canvas;
mod chain;
mod evidence;
mod gauge;
mod observability;
mod smoothing;

use std::fs;
use std::path::Path;

/// Set, pictures are written instead of compared.
const WRITE: &str = "ABBE_WRITE_DOCS";

/// Compares a picture with the book's, or writes it.
fn hold(name: &str, drawn: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/src/images").join(format!("{name}.svg"));
    if std::env::var_os(WRITE).is_some() {
        fs::write(&path, drawn).unwrap();
    }
    let there = fs::read_to_string(&path).unwrap_or_default();
    assert!(there == drawn, "{} is not what is drawn now; with {WRITE}=1 it is written anew", path.display());
}
