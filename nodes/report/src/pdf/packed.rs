//! Streams of a PDF, packed.
//!
//! In: bytes of a page's content or of a font. Out: what `FlateDecode` unpacks.

use std::io::Write as _;

use flate2::Compression;
use flate2::write::ZlibEncoder;

/// Packed bytes; the same from the same.
pub(super) fn packed(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    // Writing to memory cannot fail; what could not be packed would be an empty stream, which the reader of the test refuses.
    let _ = encoder.write_all(bytes);
    encoder.finish().unwrap_or_default()
}
