//! The parts of a line: numbers, strings, words, and calls such as `X(1.5)`, separated by commas.
//!
//! Place in the flow: below [`crate::message`]. Each part knows which bytes it was, so that a number can be replaced and all
//! else stays byte for byte. Spaces may stand around commas and inside brackets, and nowhere else.

use crate::number;
use std::ops::Range;
use thiserror::Error;

/// How deep calls may stand in calls: commands of the specification need three.
const DEEPEST: usize = 8;

/// A part of a line.
#[derive(Debug, Clone, PartialEq)]
pub struct Item {
    /// Its bytes in the text that was parsed.
    pub span: Range<usize>,
    /// What it is.
    pub what: What,
}

/// What a part is.
#[derive(Debug, Clone, PartialEq)]
pub enum What {
    /// A finite number.
    Number(f64),
    /// A string, without its quotes.
    Text(String),
    /// A word without brackets, such as `PartCsy`.
    Word(String),
    /// A name with what stands in its brackets.
    Call(String, Vec<Item>),
}

impl Item {
    /// The number that it is.
    pub fn number(&self) -> Option<f64> {
        match self.what {
            What::Number(value) => Some(value),
            _ => None,
        }
    }

    /// The name and arguments of a call.
    pub fn call(&self) -> Option<(&str, &[Item])> {
        match &self.what {
            What::Call(name, arguments) => Some((name, arguments)),
            _ => None,
        }
    }

    /// The number in a call of this name with one argument, such as `X(1.5)`.
    pub fn number_of(&self, wanted: &str) -> Option<(f64, &Item)> {
        let (name, [argument]) = self.call()? else { return None };
        (name == wanted).then_some((argument.number()?, argument))
    }

    /// A string or a word.
    pub fn text(&self) -> Option<&str> {
        match &self.what {
            What::Text(text) | What::Word(text) => Some(text),
            _ => None,
        }
    }
}

/// Why text is no list of parts.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("column {column}: {problem}")]
pub struct NoItems {
    /// From 1, in the text that was parsed.
    pub column: usize,
    /// What is wrong.
    pub problem: &'static str,
}

/// All parts of a text; none for an empty one.
pub fn items(text: &[u8]) -> Result<Vec<Item>, NoItems> {
    let mut reader = Reader { text, at: 0 };
    let items = reader.list(0)?;
    match reader.at == text.len() {
        true => Ok(items),
        false => Err(reader.problem("nothing but a comma may follow here")),
    }
}

struct Reader<'a> {
    text: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    fn problem(&self, problem: &'static str) -> NoItems {
        NoItems { column: self.at + 1, problem }
    }

    fn peek(&self) -> Option<u8> {
        self.text.get(self.at).copied()
    }

    fn spaces(&mut self) {
        while self.peek() == Some(b' ') {
            self.at += 1;
        }
    }

    /// Parts up to the end or a closing bracket, and the spaces before it.
    fn list(&mut self, depth: usize) -> Result<Vec<Item>, NoItems> {
        let mut items = Vec::new();
        self.spaces();
        if matches!(self.peek(), None | Some(b')')) {
            return Ok(items);
        }
        loop {
            items.push(self.item(depth)?);
            self.spaces();
            if self.peek() != Some(b',') {
                return Ok(items);
            }
            self.at += 1;
            self.spaces();
        }
    }

    fn item(&mut self, depth: usize) -> Result<Item, NoItems> {
        let first = self.at;
        let what = match self.peek() {
            Some(b'"') => self.string()?,
            Some(byte) if byte.is_ascii_alphabetic() => self.word_or_call(depth)?,
            _ => {
                let (length, value) = number::leading(&self.text[first..])
                    .ok_or_else(|| self.problem("a number, a string or a name must stand here"))?;
                self.at += length;
                What::Number(value)
            }
        };
        Ok(Item { span: first..self.at, what })
    }

    fn string(&mut self) -> Result<What, NoItems> {
        let inside = &self.text[self.at + 1..];
        let length = inside.iter().position(|byte| *byte == b'"').ok_or_else(|| self.problem("a string must end"))?;
        if !inside[..length].iter().all(|byte| matches!(byte, b' '..=b'~')) {
            return Err(self.problem("a string holds signs that the protocol has not"));
        }
        self.at += length + 2;
        Ok(What::Text(inside[..length].iter().map(|byte| char::from(*byte)).collect()))
    }

    fn word_or_call(&mut self, depth: usize) -> Result<What, NoItems> {
        let of_name = |byte: &u8| byte.is_ascii_alphanumeric() || *byte == b'.';
        let length = self.text[self.at..].iter().take_while(|byte| of_name(byte)).count();
        let name = self.text[self.at..self.at + length].iter().map(|byte| char::from(*byte)).collect();
        self.at += length;
        let after_name = self.at;
        self.spaces();
        if self.peek() != Some(b'(') {
            self.at = after_name;
            return Ok(What::Word(name));
        }
        if depth == DEEPEST {
            return Err(self.problem("brackets stand too deep"));
        }
        self.at += 1;
        let arguments = self.list(depth + 1)?;
        if self.peek() != Some(b')') {
            return Err(self.problem("a closing bracket must stand here"));
        }
        self.at += 1;
        Ok(What::Call(name, arguments))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn parts_are_read_with_their_bytes() {
        let text = br#"X( 1.50 ), Tool.A(45) ,"a, (b)",PartCsy,E0553,IJK(0,0,-1)"#;
        let read = items(text).unwrap();
        let spans: Vec<&str> = read.iter().map(|item| std::str::from_utf8(&text[item.span.clone()]).unwrap()).collect();
        assert_eq!(spans, ["X( 1.50 )", "Tool.A(45)", "\"a, (b)\"", "PartCsy", "E0553", "IJK(0,0,-1)"]);
        let (value, argument) = read[0].number_of("X").unwrap();
        assert_eq!((value, &text[argument.span.clone()]), (1.5, &b"1.50"[..]));
        assert_eq!((read[2].text(), read[3].text()), (Some("a, (b)"), Some("PartCsy")));
        assert_eq!(read[5].call().unwrap().1.len(), 3);
        assert!(items(b"").unwrap().is_empty() && items(b" ").unwrap().is_empty());
    }

    #[test]
    fn what_is_no_list_is_refused_with_its_column() {
        for (text, column) in [
            ("X(1", 4),
            ("X(1))", 5),
            ("1,,2", 3),
            ("1 2", 3),
            ("\"a", 1),
            ("X(\"a\u{7f}\")", 3),
            ("(1,2)", 1),
            ("1,", 3),
            ("A(A(A(A(A(A(A(A(A(1)))))))))", 18),
        ] {
            assert_eq!(items(text.as_bytes()).unwrap_err().column, column, "{text}");
        }
    }

    fn any_text() -> impl Strategy<Value = Vec<u8>> {
        let sign = prop::sample::select(b"XYZ()(),,.0189 -+E\"QT\x80\r".to_vec());
        prop_oneof![prop::collection::vec(any::<u8>(), 0..80), prop::collection::vec(sign, 0..120)]
    }

    proptest! {
        #[test]
        fn no_bytes_end_the_program_and_parts_lie_in_order_inside(text in any_text()) {
            fn check(items: &[Item], within: Range<usize>) -> bool {
                let mut at = within.start;
                items.iter().all(|item| {
                    let sound = item.span.start >= at && item.span.end <= within.end && !item.span.is_empty();
                    at = item.span.end;
                    sound && item.call().is_none_or(|(_, inner)| check(inner, item.span.clone()))
                })
            }
            if let Ok(items) = items(&text) {
                prop_assert!(check(&items, 0..text.len()));
            }
        }
    }
}
