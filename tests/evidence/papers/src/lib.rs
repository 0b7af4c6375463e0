//! Published figures of the source papers, computed again.
//!
//! Place in the flow: `abbe papers` prints and reports what the functions in [`PAPERS`] return. One file a paper; each calls the library
//! functions that everybody else calls, on data of the paper or on a simulation of its set-up, and holds what comes out
//! against what was published. Nothing here fits, tunes or interpolates by itself.

mod chen2020;
mod figure;
mod fyxz;
mod liang2025;
mod statistics;
mod zhang2011;
mod zhang2016;

pub use figure::{Figure, PaperError, Settings, Verdict};

/// A source paper: how it is cited, and what computes its figures.
pub struct Paper {
    /// How it is cited, such as `Chen 2020`.
    pub name: &'static str,
    /// Computes all its figures.
    pub figures: fn(&Settings) -> Result<Vec<Figure>, PaperError>,
}

/// All source papers.
pub const PAPERS: [Paper; 5] = [
    Paper { name: "Chen 2020", figures: chen2020::figures },
    Paper { name: "Zhang 2016", figures: zhang2016::figures },
    Paper { name: "Zhang 2011", figures: zhang2011::figures },
    Paper { name: "FYXZ paper", figures: fyxz::figures },
    Paper { name: "Liang 2025", figures: liang2025::figures },
];
