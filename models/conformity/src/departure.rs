//! Where data fall short of the test that a standard describes.
//!
//! Place in the flow: beside every set of figures. Figures of an incomplete test are still figures, but nobody may say
//! with them that a machine was verified after the standard.

use std::fmt;

/// One thing that the standard asks for and the data do not have.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Departure {
    /// What it is about: a line, an axis, the whole test.
    pub place: String,
    /// What is asked for and what is there.
    pub text: String,
}

impl Departure {
    /// A departure at a place.
    pub fn new(place: impl Into<String>, text: impl Into<String>) -> Departure {
        Departure { place: place.into(), text: text.into() }
    }
}

impl fmt::Display for Departure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.place, self.text)
    }
}
