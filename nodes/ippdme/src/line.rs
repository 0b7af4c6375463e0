//! Bytes to lines. A line ends with carriage return and line feed; a line feed alone is taken, too.
//!
//! Place in the flow: between a socket and [`crate::message`]. A line keeps the bytes that end it, so that it can be passed on as
//! it came. What is longer than the protocol allows is passed over, and said.

/// Bytes of a line at most, without what ends it.
pub const MOST_BYTES: usize = 65_536;

/// What bytes were.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Piece {
    /// A line with what ends it.
    Line(Vec<u8>),
    /// A line of more than [`MOST_BYTES`], passed over to its end.
    TooLong,
}

/// Cuts bytes into lines.
#[derive(Debug, Clone, Default)]
pub struct Lines {
    begun: Vec<u8>,
    /// The line that has begun is too long already.
    passes_over: bool,
}

impl Lines {
    /// Takes bytes as they came, and gives the lines that they complete.
    pub fn take(&mut self, mut bytes: &[u8]) -> Vec<Piece> {
        let mut pieces = Vec::new();
        while let Some(at) = bytes.iter().position(|byte| *byte == b'\n') {
            let (end, rest) = bytes.split_at(at + 1);
            bytes = rest;
            self.begin(end);
            let line = std::mem::take(&mut self.begun);
            let passed_over = std::mem::take(&mut self.passes_over);
            pieces.push(if passed_over { Piece::TooLong } else { Piece::Line(line) });
        }
        self.begin(bytes);
        pieces
    }

    /// Bytes of a line that has not ended.
    pub fn begun(&self) -> usize {
        self.begun.len()
    }

    fn begin(&mut self, bytes: &[u8]) {
        let room = MOST_BYTES + 2;
        if self.passes_over || self.begun.len() + bytes.len() > room {
            self.passes_over = true;
            self.begun = Vec::new();
        } else {
            self.begun.extend_from_slice(bytes);
        }
    }
}

/// A line without what ends it.
pub fn text(line: &[u8]) -> &[u8] {
    let line = line.strip_suffix(b"\n").unwrap_or(line);
    line.strip_suffix(b"\r").unwrap_or(line)
}

/// What ends a line.
pub fn ending(line: &[u8]) -> &[u8] {
    &line[text(line).len()..]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn lines_are_the_same_however_bytes_are_cut_and_nothing_is_lost(
            bytes in prop::collection::vec(prop_oneof![any::<u8>(), Just(b'\n'), Just(b'\r')], 0..400),
            cuts in prop::collection::vec(0_usize..40, 0..40),
        ) {
            let mut whole = Lines::default();
            let at_once = whole.take(&bytes);
            let mut parts = Lines::default();
            let (mut rest, mut taken) = (bytes.as_slice(), Vec::new());
            for cut in cuts {
                let (now, later) = rest.split_at(cut.min(rest.len()));
                taken.extend(parts.take(now));
                rest = later;
            }
            taken.extend(parts.take(rest));
            prop_assert_eq!(&taken, &at_once);
            let length: usize = taken.iter().map(|piece| match piece { Piece::Line(line) => line.len(), Piece::TooLong => 0 }).sum();
            prop_assert_eq!(length + parts.begun(), bytes.len());
        }
    }

    #[test]
    fn a_line_that_is_too_long_is_passed_over_and_takes_no_memory() {
        let mut lines = Lines::default();
        for _ in 0..100 {
            assert!(lines.take(&[b'7'; 10_000]).is_empty());
            assert!(lines.begun() <= MOST_BYTES + 2);
        }
        assert_eq!(lines.take(b"\r\n00001 &\r\n"), [Piece::TooLong, Piece::Line(b"00001 &\r\n".to_vec())]);
        let longest = [vec![b'7'; MOST_BYTES], b"\r\n".to_vec()].concat();
        assert_eq!(lines.take(&longest), [Piece::Line(longest.clone())]);
        assert_eq!(
            (text(b"a\r\n"), ending(b"a\r\n"), ending(b"a\n"), ending(b"a")),
            (&b"a"[..], &b"\r\n"[..], &b"\n"[..], &b""[..])
        );
    }
}
