//! Damaged texts, for the tests that no bytes make a reader panic.

use proptest::collection::vec;
use proptest::prelude::*;

/// A text with some of its bytes replaced, left out or doubled.
pub(crate) fn mangled(text: &'static str) -> impl Strategy<Value = Vec<u8>> {
    vec((any::<prop::sample::Index>(), any::<u8>(), 0..3), 1..6).prop_map(move |changes| {
        let mut bytes = text.as_bytes().to_vec();
        for (position, byte, how) in changes {
            let index = position.index(bytes.len());
            match how {
                0 => bytes[index] = byte,
                1 => drop(bytes.remove(index)),
                _ => bytes.insert(index, bytes[index]),
            }
        }
        bytes
    })
}
