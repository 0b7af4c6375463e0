//! What an error of the protocol is, and what it asks for.
//!
//! Place in the flow: `! Error(severity, number, who, text)` of a response in. Severity and number say who has to act: nobody,
//! the client, somebody at the machine, or whoever mends the server (section 8 of the specification).

use crate::item::Item;
use std::fmt;

/// How grave an error is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// 0: said, no more.
    Info,
    /// 1: what was asked goes on.
    Warning,
    /// 2: the client can mend it; nothing goes on before `ClearAllErrors()`.
    Error,
    /// 3, and what the specification does not name: somebody at the machine has to act, then `ClearAllErrors()`.
    UserNeeded,
    /// 9: the server cannot go on.
    Fatal,
}

impl Severity {
    fn of_number(number: f64) -> Severity {
        match number {
            0.0 => Severity::Info,
            1.0 => Severity::Warning,
            2.0 => Severity::Error,
            9.0 => Severity::Fatal,
            _ => Severity::UserNeeded,
        }
    }

    /// Whether the server works on only after `ClearAllErrors()`.
    pub fn stops(self) -> bool {
        self >= Severity::Error
    }
}

/// An error as a server tells it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Trouble {
    /// How grave.
    pub severity: Severity,
    /// Its number, where the server gave one.
    pub number: Option<u32>,
    /// The method that it came from.
    pub origin: String,
    /// The server's words.
    pub text: String,
}

impl Trouble {
    /// Reads the data of an error response. What cannot be read is an error in which somebody has to act: no client may go on
    /// because it did not understand.
    pub fn parse(data: &[u8]) -> Trouble {
        let unread = || Trouble {
            severity: Severity::UserNeeded,
            number: None,
            origin: String::new(),
            text: String::from_utf8_lossy(data).into_owned(),
        };
        let read = || {
            let items = crate::item::items(data).ok()?;
            let [("Error", [severity, number, origin, text])] =
                &items.iter().map(Item::call).collect::<Option<Vec<_>>>()?[..]
            else {
                return None;
            };
            let whole = number.number().filter(|n| n.fract() == 0.0 && (0.0..10_000.0).contains(n))?;
            Some(Trouble {
                severity: Severity::of_number(severity.number()?),
                // Whole, and below 10 000.
                number: Some(whole as u32),
                origin: origin.text().unwrap_or_default().to_owned(),
                text: text.text()?.to_owned(),
            })
        };
        read().unwrap_or_else(unread)
    }

    /// What to do about it.
    pub fn remedy(&self) -> &'static str {
        match self.number {
            Some(0) => "the server has more to do than it can take; ask it less often",
            Some(6 | 514) => "what was under way was stopped; the errors are cleared and it is asked again",
            Some(1..=499) => {
                "the two sides do not understand each other; check the version of the protocol at the server"
            }
            Some(500) => "release the emergency stop at the machine, and start it as its manual says",
            Some(501 | 505..=507) => {
                "the server does not know this command or argument; ask for less, or update the server"
            }
            Some(502 | 508..=511) => {
                "the server refuses what was asked as it is now; check the launch file and the state of the machine"
            }
            Some(503) => "the server has lost its controller; check its cable and power",
            Some(512 | 513 | 515) => {
                "the server and this program differ on what is reported; the connection is made again"
            }
            Some(1000) => "clear the error at the machine's panel",
            Some(1009) => "check the air supply of the machine",
            Some(1005) | Some(2500..=2506) => "look at the axes of the machine: limits, collision, reading heads",
            Some(1500..=1503) => "check which tool is in the machine, and that the server knows it",
            Some(2000..=2002) => "qualify the tool",
            Some(1001..=1499) => "check position and state of the machine",
            _ => match self.severity {
                Severity::Info | Severity::Warning => "nothing has to be done",
                Severity::Error | Severity::UserNeeded => "look at the server and the machine",
                Severity::Fatal => "start the server again",
            },
        }
    }
}

impl fmt::Display for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.number {
            Some(number) => write!(f, "error {number:04} of the server ({}): {}", self.text, self.remedy()),
            None => {
                write!(f, "an error of the server that is no line of the protocol ({}): {}", self.text, self.remedy())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn each_class_is_read_and_says_what_to_do() {
        for (text, severity, number, words) in [
            (r#"Error(0, 0000, "StartSession", "Buffer full")"#, Severity::Info, Some(0), "less often"),
            (
                r#"Error(1,0504,SetProp,"Argument out of range")"#,
                Severity::Warning,
                Some(504),
                "nothing has to be done",
            ),
            (r#"Error(2, 0006, GoTo, "Transaction aborted")"#, Severity::Error, Some(6), "cleared"),
            (
                r#"Error(3, 0500, "HealthCheck", "Emergency stop")"#,
                Severity::UserNeeded,
                Some(500),
                "release the emergency stop",
            ),
            (r#"Error(9, 0503, "x", "Controller communications failure")"#, Severity::Fatal, Some(503), "cable"),
            (r#"Error(7, 8123, "x", "of the vendor")"#, Severity::UserNeeded, Some(8123), "look at the server"),
            (r#"Error(2, 0511, "Get", "Error processing method""#, Severity::UserNeeded, None, "look at the server"),
        ] {
            let trouble = Trouble::parse(text.as_bytes());
            assert_eq!((trouble.severity, trouble.number), (severity, number), "{text}");
            assert!(trouble.to_string().contains(words), "{trouble}");
        }
        let stops = [Severity::Info, Severity::Warning, Severity::Error, Severity::UserNeeded, Severity::Fatal]
            .map(Severity::stops);
        assert_eq!(stops, [false, false, true, true, true]);
    }

    proptest! {
        #[test]
        fn no_bytes_end_the_program(bytes in prop::collection::vec(any::<u8>(), 0..80)) {
            prop_assert!(!Trouble::parse(&bytes).to_string().is_empty());
        }
    }
}
