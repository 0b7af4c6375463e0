//! What a cell holds as a number, and how a file marks its decimals: by a point or by a comma.
//!
//! Place in the flow: below [`crate::columns::Header`], which asks for every number here. Nothing is guessed: `1,5` can only have a
//! decimal comma, but `1,234` is 1.234 or 1234. Such a cell waits until another number of the file shows a decimal comma;
//! if none does, the file is refused. A file that marks decimals in both ways is refused too.

/// How decimals are marked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Mark {
    #[default]
    Point,
    Comma,
}

impl Mark {
    pub(crate) fn sign(self) -> char {
        match self {
            Mark::Point => '.',
            Mark::Comma => ',',
        }
    }

    /// A number that was written with a point, written with this mark.
    pub(crate) fn of(self, text: &mut String) -> &str {
        if self == Mark::Comma
            && let Some(at) = text.find('.')
        {
            text.replace_range(at..=at, ",");
        }
        text
    }
}

/// Magnitude beyond which nothing was measured, in any unit: squares and products of such numbers are still finite.
const LARGEST: f64 = 1e30;

/// A finite number, and what its cell tells of the file's mark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Number {
    /// No mark at all.
    Whole(f64),
    /// A decimal point.
    Point(f64),
    /// What can only be a decimal comma.
    Comma(f64),
    /// A comma before three digits: the value if it is a decimal comma; else it stands between thousands.
    Either(f64),
}

/// Why a cell holds no number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NoNumber {
    Empty,
    Text,
    NotFinite,
    TooLarge,
    /// Digits in groups of three, such as `1 234,5`.
    Thousands,
}

/// The number in a cell, blanks around it aside.
pub(crate) fn number(cell: &[u8]) -> Result<Number, NoNumber> {
    let cell = cell.trim_ascii();
    if cell.is_empty() {
        return Err(NoNumber::Empty);
    }
    let text = std::str::from_utf8(cell).map_err(|_| NoNumber::Text)?;
    let finite = |value: f64| match value.is_finite() {
        false => Err(NoNumber::NotFinite),
        true if value.abs() > LARGEST => Err(NoNumber::TooLarge),
        true => Ok(value),
    };
    if let Ok(value) = text.parse::<f64>() {
        let value = finite(value)?;
        return Ok(if text.contains('.') { Number::Point(value) } else { Number::Whole(value) });
    }
    if let Some((before, after)) = text.split_once(',')
        && !text.contains('.')
        && let Ok(value) = format!("{before}.{after}").parse::<f64>()
    {
        let value = finite(value)?;
        return Ok(if could_be_thousands(before, after) { Number::Either(value) } else { Number::Comma(value) });
    }
    Err(if has_thousands(text) { NoNumber::Thousands } else { NoNumber::Text })
}

fn is_digits(text: &str, least: usize, most: usize) -> bool {
    (least..=most).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_digit())
}

fn unsigned(text: &str) -> &str {
    text.strip_prefix(['+', '-']).unwrap_or(text)
}

/// Whether a comma between these may stand between thousands: one to three digits, no zero first, and three behind.
fn could_be_thousands(before: &str, after: &str) -> bool {
    let before = unsigned(before);
    is_digits(before, 1, 3) && !before.starts_with('0') && is_digits(after, 3, 3)
}

/// Whether a text is digits in groups of three, with a decimal mark of another kind behind them or without.
fn has_thousands(text: &str) -> bool {
    const SEPARATORS: [char; 7] = [',', '.', ' ', '\'', '\u{a0}', '\u{202f}', '\u{2019}'];
    let text = unsigned(text);
    let seen: Vec<char> = text.chars().filter(|c| SEPARATORS.contains(c)).collect();
    let groups: Vec<&str> = text.split(SEPARATORS).collect();
    let (Some((first, rest)), Some((kind, others))) = (groups.split_first(), seen.split_first()) else { return false };
    // The last separator is the decimal mark where it is of another kind than those before it.
    let grouped = match others.split_last() {
        Some((last, between)) if last != kind && between.iter().all(|c| c == kind) => &rest[..rest.len() - 1],
        _ if others.iter().all(|c| c == kind) => rest,
        _ => return false,
    };
    is_digits(first, 1, 3) && grouped.iter().all(|group| is_digits(group, 3, 3))
}

/// A cell that told of the mark.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Seen {
    pub(crate) line: u64,
    pub(crate) column: usize,
    pub(crate) text: String,
}

/// What is known of a file's mark so far.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) enum Decimals {
    /// Whole numbers only.
    #[default]
    Unknown,
    /// This cell has a comma that may stand between thousands; its value was taken for decimals.
    Open(Seen),
    /// This cell showed it.
    Shown(Mark, Seen),
    /// This line of the file says it.
    Declared(Mark, u64),
}

/// Why a number does not fit what the file showed before.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Contradiction {
    /// This cell against an earlier one.
    Mixed(Seen),
    /// This cell has a comma that must stand between thousands, as the earlier one has a decimal point.
    CommaBetweenThousands(Seen),
    /// The earlier cell was open, and this one has a decimal point.
    OpenWasThousands(Seen),
    /// This line says otherwise.
    Declared(Mark, u64),
}

/// What a number did to the knowledge of the mark.
#[derive(Debug, PartialEq)]
pub(crate) struct Taken {
    pub(crate) value: f64,
    /// It is the first that shows the mark.
    pub(crate) is_news: bool,
}

impl Decimals {
    /// The mark as far as it is known.
    pub(crate) fn mark(&self) -> Mark {
        match self {
            Decimals::Unknown => Mark::Point,
            Decimals::Open(_) => Mark::Comma,
            Decimals::Shown(mark, _) | Decimals::Declared(mark, _) => *mark,
        }
    }

    /// The cell that nothing explains yet.
    pub(crate) fn open(&self) -> Option<&Seen> {
        match self {
            Decimals::Open(seen) => Some(seen),
            _ => None,
        }
    }

    /// Takes a number, or says what it contradicts; `seen` is its cell.
    pub(crate) fn take(&mut self, number: Number, seen: impl FnOnce() -> Seen) -> Result<Taken, Contradiction> {
        let (value, shows) = match number {
            Number::Whole(value) => return Ok(Taken { value, is_news: false }),
            Number::Point(value) => (value, Mark::Point),
            Number::Comma(value) | Number::Either(value) => (value, Mark::Comma),
        };
        let is_open = matches!(number, Number::Either(_));
        match self {
            Decimals::Shown(mark, _) | Decimals::Declared(mark, _) if *mark == shows => {}
            Decimals::Shown(_, earlier) if is_open => {
                return Err(Contradiction::CommaBetweenThousands(earlier.clone()));
            }
            Decimals::Shown(_, earlier) => return Err(Contradiction::Mixed(earlier.clone())),
            Decimals::Declared(mark, line) => return Err(Contradiction::Declared(*mark, *line)),
            Decimals::Open(earlier) if shows == Mark::Point => {
                return Err(Contradiction::OpenWasThousands(earlier.clone()));
            }
            Decimals::Open(_) if is_open => {}
            Decimals::Unknown if is_open => *self = Decimals::Open(seen()),
            Decimals::Unknown | Decimals::Open(_) => {
                *self = Decimals::Shown(shows, seen());
                return Ok(Taken { value, is_news: true });
            }
        }
        Ok(Taken { value, is_news: false })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_cell_tells_is_told_apart() {
        for (text, expected) in [
            ("12", Ok(Number::Whole(12.0))),
            ("-1e3", Ok(Number::Whole(-1e3))),
            ("1.5", Ok(Number::Point(1.5))),
            ("1.234", Ok(Number::Point(1.234))),
            (" 1,5 ", Ok(Number::Comma(1.5))),
            ("-0,123", Ok(Number::Comma(-0.123))),
            ("1234,567", Ok(Number::Comma(1234.567))),
            ("1,2345", Ok(Number::Comma(1.2345))),
            ("1,234e0", Ok(Number::Comma(1.234))),
            (",5", Ok(Number::Comma(0.5))),
            ("1,234", Ok(Number::Either(1.234))),
            ("-999,999", Ok(Number::Either(-999.999))),
            ("", Err(NoNumber::Empty)),
            ("nan", Err(NoNumber::NotFinite)),
            ("1e999", Err(NoNumber::NotFinite)),
            ("1,2e999", Err(NoNumber::NotFinite)),
            ("1,234,567", Err(NoNumber::Thousands)),
            ("1.234.567", Err(NoNumber::Thousands)),
            ("1,234.5", Err(NoNumber::Thousands)),
            ("-1.234,5", Err(NoNumber::Thousands)),
            ("1 234,5", Err(NoNumber::Thousands)),
            ("1\u{a0}234", Err(NoNumber::Thousands)),
            ("1'234.5", Err(NoNumber::Thousands)),
            ("12.03.2024", Err(NoNumber::Text)),
            ("1;2", Err(NoNumber::Text)),
            ("S1", Err(NoNumber::Text)),
            (",", Err(NoNumber::Text)),
            ("ä", Err(NoNumber::Text)),
        ] {
            assert_eq!(number(text.as_bytes()), expected, "{text:?}");
        }
        assert_eq!(number(b"\xff"), Err(NoNumber::Text));
    }

    fn seen(line: u64) -> Seen {
        Seen { line, column: 0, text: String::new() }
    }

    /// What is left after these cells, or what the last of them contradicts.
    fn after(cells: &[&str]) -> Result<Decimals, Contradiction> {
        let mut decimals = Decimals::Unknown;
        for (line, cell) in (1..).zip(cells) {
            decimals.take(number(cell.as_bytes()).unwrap(), || seen(line))?;
        }
        Ok(decimals)
    }

    #[test]
    fn a_mark_is_known_once_a_cell_shows_it_and_never_changes() {
        assert_eq!(after(&["1", "2"]), Ok(Decimals::Unknown));
        assert_eq!(after(&["1,234", "1,5"]), Ok(Decimals::Shown(Mark::Comma, seen(2))));
        assert_eq!(after(&["1,5", "1,234"]), Ok(Decimals::Shown(Mark::Comma, seen(1))));
        assert_eq!(after(&["7", "1,234", "2,345"]), Ok(Decimals::Open(seen(2))));
        assert_eq!(after(&["1.5", "1,5"]), Err(Contradiction::Mixed(seen(1))));
        assert_eq!(after(&["1,5", "1.5"]), Err(Contradiction::Mixed(seen(1))));
        assert_eq!(after(&["1.5", "1,234"]), Err(Contradiction::CommaBetweenThousands(seen(1))));
        assert_eq!(after(&["1,234", "1.5"]), Err(Contradiction::OpenWasThousands(seen(1))));
        let mut declared = Decimals::Declared(Mark::Comma, 1);
        let either = declared.take(number(b"1,234").unwrap(), || seen(2));
        assert_eq!(either, Ok(Taken { value: 1.234, is_news: false }));
        let point = declared.take(number(b"1.5").unwrap(), || seen(3));
        assert_eq!(point, Err(Contradiction::Declared(Mark::Comma, 1)));
    }
}
