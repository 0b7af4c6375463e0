//! Why a set of points makes no field.
//!
//! Place in the flow: [`crate::MeasuredField`] and [`crate::Samples`] refuse by it what no method could use.

use thiserror::Error;

/// Points fewer than this do not surround anything.
pub(crate) const LEAST_POINTS: usize = 8;
/// Inputs of a point at most: what a prediction works in stands on the stack.
pub const MOST_INPUTS: usize = 16;

/// Points that no field can be made of; the text says what to do. Indices count from 0.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum FieldError {
    /// Too few points.
    #[error("{0} points are too few for a field; measure at least {LEAST_POINTS} that fill a volume")]
    TooFew(usize),
    /// Lists of different lengths.
    #[error("{points} points, but {values} {what}; give one for each point")]
    Lengths {
        /// Points.
        points: usize,
        /// Values.
        values: usize,
        /// What the values are.
        what: &'static str,
    },
    /// A number that is none.
    #[error("point {index}: {what} is not a finite number; correct or remove the point")]
    NotFinite {
        /// Index of the point.
        index: usize,
        /// What is wrong there.
        what: &'static str,
    },
    /// An uncertainty of zero or less.
    #[error("point {0}: a standard uncertainty is not above zero; give the uncertainty of all three components (m)")]
    Uncertainty(usize),
    /// The same point twice.
    #[error(
        "points {first} and {second} are the same within a micrometre; average repeated measurements of one tip to one point first, and give \
         those of another tip (offset, reflector holder) in a file of their own"
    )]
    Duplicate {
        /// Index of one.
        first: usize,
        /// Index of the other.
        second: usize,
    },
    /// No volume.
    #[error("the points lie in a plane or on a line; measure points that fill a volume")]
    Flat,
    /// An input that is the same everywhere.
    #[error("the input {0} has the same value at all points; leave it out, or measure at other values of it")]
    Constant(String),
    /// No input, or too many.
    #[error("{0} inputs; give 1 to {MOST_INPUTS}")]
    InputCount(usize),
    /// An input named twice.
    #[error("the input {0} is named twice; name it once")]
    InputTwice(String),
    /// Not even a plane.
    #[error("the points lie on a line; measure points that fill a plane or a volume")]
    Line,
}
