//! The SHA-256 that names a model, and its short form for people.
//!
//! Place in the flow: computed by whoever loads a model file, carried by every corrected sample.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;
use sha2::Digest;

/// SHA-256 of a file; all zeros on the wire means that there is none.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, ZeroCopySend)]
#[type_name("abbe/Sha256")]
#[allow(unsafe_code)] // The derive implements the unsafe marker trait ZeroCopySend; plain data.
pub struct Sha256 {
    bytes: [u8; 32],
}

impl Sha256 {
    /// No model: zeros on the wire.
    pub const NONE: Self = Self { bytes: [0; 32] };

    /// The hash of these bytes.
    #[must_use]
    pub fn of(content: &[u8]) -> Self {
        Self { bytes: sha2::Sha256::digest(content).into() }
    }

    /// A hash computed elsewhere.
    #[must_use]
    pub const fn from_bytes(bytes: [u8; 32]) -> Self {
        Self { bytes }
    }

    /// The 32 bytes.
    #[must_use]
    pub const fn to_bytes(self) -> [u8; 32] {
        self.bytes
    }

    /// Whether this stands for no model.
    #[must_use]
    pub fn is_none(self) -> bool {
        self == Self::NONE
    }

    /// All 64 hexadecimal digits.
    #[must_use]
    pub fn to_hex(self) -> String {
        self.bytes.iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

/// The first 12 hexadecimal digits, or `none`.
impl fmt::Display for Sha256 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_none() {
            return f.pad("none");
        }
        let mut hex = self.to_hex();
        hex.truncate(12);
        f.pad(&hex)
    }
}

impl fmt::Debug for Sha256 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}
