//! Whether what is found says why, or only what the data depend on.
//!
//! Place in the flow: part of every effect that a diagnosis or a study finds.

/// Whether an effect is explained or only described.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Explanation {
    /// A physical effect with a formula of its own explains it.
    Attributed,
    /// The data show the dependence: which quantities, which shape. Nothing known explains it.
    Empirical,
}

impl Explanation {
    /// As in reports.
    pub fn word(self) -> &'static str {
        match self {
            Explanation::Attributed => "attributed",
            Explanation::Empirical => "empirical",
        }
    }
}
