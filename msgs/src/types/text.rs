//! Text of fixed capacity, so that names travel inside samples of fixed size.
//!
//! Place in the flow: `frame_id`, station, line and covariate names of the samples.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;

use crate::TextError;

/// UTF-8 text of at most `N` bytes (`N` at most 255). Longer text is refused, never cut off.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, ZeroCopySend)]
#[type_name("abbe/Text")]
#[allow(unsafe_code)] // The derive implements the unsafe marker trait ZeroCopySend; plain data.
pub struct Text<const N: usize> {
    // Zeros after the text, so that comparing the array compares the text.
    bytes: [u8; N],
    length: u8,
}

impl<const N: usize> Text<N> {
    const EMPTY: Self = {
        assert!(N <= u8::MAX as usize, "the length of a Text is one byte");
        Self { bytes: [0; N], length: 0 }
    };

    /// The text, if it fits.
    ///
    /// # Errors
    /// When it is longer than `N` bytes or contains a NUL.
    pub fn new(text: &str) -> Result<Self, TextError> {
        if let Some(at) = text.bytes().position(|byte| byte == 0) {
            return Err(TextError::ContainsNul { at });
        }
        let mut fixed = Self::EMPTY;
        let too_long = TextError::TooLong { bytes: text.len(), capacity: N };
        match (fixed.bytes.get_mut(..text.len()), u8::try_from(text.len())) {
            (Some(room), Ok(length)) => {
                room.copy_from_slice(text.as_bytes());
                fixed.length = length;
                Ok(fixed)
            }
            _ => Err(too_long),
        }
    }

    /// The text. Of memory that is not a text (see [`Text::check`]) the part that still is one.
    #[must_use]
    pub fn as_str(&self) -> &str {
        let used = &self.bytes[..usize::from(self.length).min(N)];
        match used.utf8_chunks().next() {
            Some(chunk) => chunk.valid(),
            None => "",
        }
    }

    /// Whether there is no text.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// Checks memory that another program wrote.
    ///
    /// # Errors
    /// When the bytes are not a text as [`Text::new`] makes it.
    pub fn check(&self) -> Result<(), TextError> {
        match Self::new(self.as_str()) {
            Ok(same) if same == *self => Ok(()),
            _ => Err(TextError::Malformed),
        }
    }
}

impl<const N: usize> Default for Text<N> {
    fn default() -> Self {
        Self::EMPTY
    }
}

impl<const N: usize> fmt::Display for Text<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl<const N: usize> fmt::Debug for Text<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.as_str(), f)
    }
}

impl<const N: usize> PartialEq<str> for Text<N> {
    fn eq(&self, other: &str) -> bool {
        self.as_str() == other
    }
}

impl<const N: usize> PartialEq<&str> for Text<N> {
    fn eq(&self, other: &&str) -> bool {
        self.as_str() == *other
    }
}

impl<const N: usize> TryFrom<&str> for Text<N> {
    type Error = TextError;

    fn try_from(text: &str) -> Result<Self, TextError> {
        Self::new(text)
    }
}
