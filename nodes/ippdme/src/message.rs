//! Commands and responses: a tag, and what it is about.
//!
//! Place in the flow: a line without its end in, its meaning out. `00005 Get(X())` is a command; `00005 &` accepts it,
//! `00005 # X(1.5)` answers, `00005 ! Error(3, 1005, "Home", "Error during home")` tells of an error, `00005 %` completes it.

use crate::item::{Item, NoItems, What, items};
use std::fmt;
use thiserror::Error;

/// What ties responses to commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Tag {
    /// Five digits.
    Command(u32),
    /// `E` and four digits: events and the fast queue.
    Event(u16),
}

impl Tag {
    /// What the server says unasked.
    pub const UNSOLICITED: Tag = Tag::Event(0);

    /// The tag of these five bytes.
    pub fn parse(bytes: &[u8]) -> Option<Tag> {
        let digits = |bytes: &[u8]| -> Option<u32> {
            bytes.iter().try_fold(0, |sum, byte| byte.is_ascii_digit().then(|| sum * 10 + u32::from(byte - b'0')))
        };
        match bytes {
            [b'E', rest @ ..] if rest.len() == 4 => Some(Tag::Event(u16::try_from(digits(rest)?).ok()?)),
            all if all.len() == 5 => Some(Tag::Command(digits(all)?)),
            _ => None,
        }
    }

    /// Whether it belongs to no command: `E0000`, and `00000` where a server writes that.
    pub fn is_unsolicited(self) -> bool {
        matches!(self, Tag::Event(0) | Tag::Command(0))
    }
}

impl fmt::Display for Tag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Tag::Command(number) => write!(f, "{number:05}"),
            Tag::Event(number) => write!(f, "E{number:04}"),
        }
    }
}

/// Why a line is no message.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum NoMessage {
    /// The first five bytes are no tag.
    #[error("it begins with no tag of five digits, or of E and four")]
    Tag,
    /// Column 6.
    #[error("no space at column 6")]
    Space,
    /// Column 7 of a response.
    #[error("column 7 is none of & % # !")]
    Kind,
    /// The command or the data.
    #[error(transparent)]
    Items(#[from] NoItems),
    /// A command is one call.
    #[error("it is no command: one name with brackets")]
    NoCall,
}

/// Bytes before a command, or before the data of a response.
const TO_COMMAND: usize = 6;
const TO_DATA: usize = 8;

fn tagged(text: &[u8]) -> Result<(Tag, &[u8]), NoMessage> {
    let (tag, rest) = text.split_at_checked(TO_COMMAND - 1).ok_or(NoMessage::Tag)?;
    let tag = Tag::parse(tag).ok_or(NoMessage::Tag)?;
    Ok((tag, rest.strip_prefix(b" ").ok_or(NoMessage::Space)?))
}

/// A command.
#[derive(Debug, Clone, PartialEq)]
pub struct Command {
    /// Its tag.
    pub tag: Tag,
    /// Its name.
    pub name: String,
    /// What stands in its brackets; spans count from the beginning of the line.
    pub arguments: Vec<Item>,
    /// Where its closing bracket stands in the line.
    pub end: usize,
}

impl Command {
    /// Reads a line without its end.
    pub fn parse(text: &[u8]) -> Result<Command, NoMessage> {
        let (tag, rest) = tagged(text)?;
        let mut all = items(rest)?;
        let (Some(Item { what: What::Call(name, mut arguments), span }), None) = (all.pop(), all.pop()) else {
            return Err(NoMessage::NoCall);
        };
        arguments.iter_mut().for_each(|item| shift(item, TO_COMMAND));
        Ok(Command { tag, name, arguments, end: span.end - 1 + TO_COMMAND })
    }

    /// The names of the calls among the arguments.
    pub fn asked(&self) -> impl Iterator<Item = &str> {
        self.arguments.iter().filter_map(|item| Some(item.call()?.0))
    }
}

/// Counts the bytes of a part from further back.
fn shift(item: &mut Item, by: usize) {
    item.span = item.span.start + by..item.span.end + by;
    if let What::Call(_, arguments) = &mut item.what {
        arguments.iter_mut().for_each(|item| shift(item, by));
    }
}

/// What a response says of its command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReplyKind {
    /// Accepted.
    Ack,
    /// Data.
    Data,
    /// An error.
    Error,
    /// Completed.
    Done,
}

/// A response; what it holds is read where it is needed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Response<'a> {
    /// Tag of the command that it answers.
    pub tag: Tag,
    /// What it says.
    pub kind: ReplyKind,
    text: &'a [u8],
}

impl<'a> Response<'a> {
    /// Reads a line without its end.
    pub fn parse(text: &'a [u8]) -> Result<Response<'a>, NoMessage> {
        let (tag, rest) = tagged(text)?;
        let kind = match rest.first() {
            Some(b'&') => ReplyKind::Ack,
            Some(b'%') => ReplyKind::Done,
            Some(b'#') => ReplyKind::Data,
            Some(b'!') => ReplyKind::Error,
            _ => return Err(NoMessage::Kind),
        };
        Ok(Response { tag, kind, text })
    }

    /// The parts of its data; spans count from the beginning of the line.
    pub fn items(&self) -> Result<Vec<Item>, NoItems> {
        let mut items = items(self.data())?;
        items.iter_mut().for_each(|item| shift(item, self.text.len() - self.data().len()));
        Ok(items)
    }

    /// What stands after the sign in column 7 and its space.
    pub fn data(&self) -> &'a [u8] {
        let data = self.text.get(TO_DATA - 1..).unwrap_or_default();
        data.strip_prefix(b" ").unwrap_or(data)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn commands_and_responses_of_the_specification_are_read() {
        let command = Command::parse(br#"E0553 OnMoveReportE(Time(1),Dis(20),X(), Y(), Z())"#).unwrap();
        assert_eq!((command.tag, command.name.as_str()), (Tag::Event(553), "OnMoveReportE"));
        assert_eq!(command.asked().collect::<Vec<_>>(), ["Time", "Dis", "X", "Y", "Z"]);
        assert_eq!(command.end, 49);
        let text = b"00004 # X(99.93), Y(17.148)";
        let response = Response::parse(text).unwrap();
        assert_eq!((response.tag, response.kind), (Tag::Command(4), ReplyKind::Data));
        let items = response.items().unwrap();
        assert_eq!(&text[items[1].call().unwrap().1[0].span.clone()], b"17.148");
        for (text, kind) in [
            ("00001 &", ReplyKind::Ack),
            ("E0001 %", ReplyKind::Done),
            ("E0000 ! Error(3, 0500, a, \"b\")", ReplyKind::Error),
        ] {
            assert_eq!(Response::parse(text.as_bytes()).unwrap().kind, kind);
        }
        assert!(Tag::UNSOLICITED.is_unsolicited() && Tag::parse(b"00000").unwrap().is_unsolicited());
    }

    #[test]
    fn what_is_no_message_is_refused_for_its_first_fault() {
        for (text, why) in [
            ("20 Get(X())", NoMessage::Tag),
            ("A4711 Get(X())", NoMessage::Tag),
            ("00001Get(X())", NoMessage::Space),
            ("00001 PartCsy", NoMessage::NoCall),
            ("00001 Get(X()),Get(Y())", NoMessage::NoCall),
            ("00001 ", NoMessage::NoCall),
        ] {
            assert_eq!(Command::parse(text.as_bytes()), Err(why), "{text}");
        }
        assert!(matches!(Command::parse(b"00001 Get(X()"), Err(NoMessage::Items(_))));
        assert_eq!(Response::parse(b"00001 $ X(3)"), Err(NoMessage::Kind));
        assert_eq!(Response::parse(b"00001"), Err(NoMessage::Space));
    }

    proptest! {
        #[test]
        fn no_bytes_end_the_program(bytes in prop::collection::vec(any::<u8>(), 0..60), tag in "E?[0-9]{4,5} ?[#!&%]? ?") {
            for text in [bytes.clone(), [tag.as_bytes(), &bytes].concat()] {
                if let Ok(command) = Command::parse(&text) {
                    prop_assert_eq!(text[command.end], b')');
                }
                if let Ok(response) = Response::parse(&text) {
                    prop_assert!(response.items().is_ok_and(|items| items.iter().all(|item| item.span.end <= text.len())) || !response.data().is_empty());
                }
            }
        }

        #[test]
        fn a_tag_reads_back(number in 0_u32..100_000, event in 0_u16..10_000) {
            for tag in [Tag::Command(number), Tag::Event(event)] {
                prop_assert_eq!(Tag::parse(tag.to_string().as_bytes()), Some(tag));
            }
        }
    }
}
