//! Errors that the relay tells the software in the name of the server.
//!
//! Place in the flow: below [`super::Relay`]. Numbers 8000 to 8999 are a server's own (section 8 of the specification).

use crate::message::Tag;

/// Letters of an error's text at most.
const MOST_LETTERS: usize = 300;

/// What the relay refuses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Refusal {
    /// This point, report or target.
    Point,
    /// Everything, until machine or settings are others.
    AsItIs,
    /// A report that comes unasked: what is under way goes on.
    Event,
    /// A command while an error stands.
    InError,
}

impl Refusal {
    fn severity_and_number(self) -> (u8, u16) {
        match self {
            Refusal::Point => (2, 8501),
            Refusal::AsItIs => (3, 8502),
            Refusal::Event => (1, 8503),
            Refusal::InError => (2, 514),
        }
    }

    /// Whether the software has to clear it.
    pub(super) fn stops(self) -> bool {
        self != Refusal::Event
    }

    /// The line that tells it.
    pub(super) fn line(self, tag: Tag, method: &str, words: &str) -> Vec<u8> {
        let (severity, number) = self.severity_and_number();
        let text: String = match self {
            Refusal::InError => "Use ClearAllErrors to continue".to_owned(),
            _ => format!("Not corrected: {words}"),
        };
        let plain = |sign: char| match sign {
            '"' => '\'',
            ' '..='~' => sign,
            _ => '?',
        };
        let text: String = text.chars().map(plain).take(MOST_LETTERS).collect();
        let method: String = method.chars().map(plain).take(MOST_LETTERS).collect();
        format!("{tag} ! Error({severity}, {number:04}, \"{method}\", \"{text}\")\r\n").into_bytes()
    }
}

/// A line of a tag and a sign.
pub(super) fn sign(tag: Tag, sign: char) -> Vec<u8> {
    format!("{tag} {sign}\r\n").into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::{ReplyKind, Response};
    use crate::trouble::Trouble;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_told_is_a_line_of_the_protocol(method in "\\PC{0,40}", words in "\\PC{0,400}") {
            for refusal in [Refusal::Point, Refusal::AsItIs, Refusal::Event, Refusal::InError] {
                let line = refusal.line(Tag::Command(16), &method, &words);
                let response = Response::parse(crate::line::text(&line)).unwrap();
                prop_assert_eq!(response.kind, ReplyKind::Error);
                let trouble = Trouble::parse(response.data());
                prop_assert!(trouble.number.is_some());
                prop_assert_eq!(trouble.severity.stops(), refusal.stops());
            }
        }
    }
}
