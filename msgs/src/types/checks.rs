//! Small checks that the samples share.

use super::{Stamp, Text};
use crate::MessageError;

/// Refuses the first number that is NaN or infinite.
pub(super) fn finite(field: &'static str, numbers: &[f64]) -> Result<(), MessageError> {
    match numbers.iter().find(|number| !number.is_finite()) {
        Some(&number) => Err(MessageError::NotFinite { field, number }),
        None => Ok(()),
    }
}

/// Refuses a standard uncertainty that is not finite or below zero.
pub(super) fn uncertainty(field: &'static str, number: f64) -> Result<(), MessageError> {
    finite(field, &[number])?;
    if number < 0.0 {
        return Err(MessageError::NegativeUncertainty { field, number });
    }
    Ok(())
}

/// Refuses a text whose memory is not a text.
pub(super) fn text<const N: usize>(field: &'static str, text: &Text<N>) -> Result<(), MessageError> {
    text.check().map_err(|source| MessageError::Text { field, source })
}

/// Puts a text that arrived into a sample.
pub(super) fn to_text<const N: usize>(field: &'static str, text: &str) -> Result<Text<N>, MessageError> {
    Text::new(text).map_err(|source| MessageError::Text { field, source })
}

/// Refuses a stamp with a second or more of nanoseconds.
pub(super) fn stamp(stamp: Stamp) -> Result<(), MessageError> {
    Stamp::new(stamp.sec(), stamp.nanosec()).map(|_| ())
}
