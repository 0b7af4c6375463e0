//! Exit codes, one meaning each; the table in `docs/src/reference/exit-codes.md` says the same.
//!
//! Place in the flow: a command that ends otherwise than with "done" or "wrong input" returns [`Ended`]; `main` turns it into the
//! exit code, so that a script can tell a machine that fails its test from a file that cannot be read.

use std::fmt;

/// Wrong input, or something the system refused.
pub const REFUSED: u8 = 1;
/// The figures are there, and a limit is not kept.
pub(crate) const NOT_CONFORMING: u8 = 3;
/// The output is there, and no row of it is inside what the model knows.
pub(crate) const NOTHING_INSIDE: u8 = 4;
/// The figures are there, and do not prove whether a limit is kept.
pub(crate) const UNDECIDED: u8 = 5;
/// Ctrl-C, SIGTERM or SIGHUP ended it before it was done.
pub(crate) const STOPPED: u8 = 130;

/// An end with an exit code of its own.
#[derive(Debug)]
pub struct Ended {
    code: u8,
    why: String,
}

impl Ended {
    /// The end of a command whose figures say no.
    pub(crate) fn not_conforming(why: String) -> Ended {
        Ended { code: NOT_CONFORMING, why }
    }

    /// The end of a command whose figures prove nothing.
    pub(crate) fn undecided(why: String) -> Ended {
        Ended { code: UNDECIDED, why }
    }

    /// The end of a command whose output is worth nothing.
    pub(crate) fn nothing_inside(why: String) -> Ended {
        Ended { code: NOTHING_INSIDE, why }
    }

    /// The end on request.
    pub fn stopped(why: String) -> Ended {
        Ended { code: STOPPED, why }
    }
}

impl fmt::Display for Ended {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.why)
    }
}

impl std::error::Error for Ended {}

/// The exit code of an error.
pub fn code(error: &anyhow::Error) -> u8 {
    error.downcast_ref::<Ended>().map_or(REFUSED, |ended| ended.code)
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context;

    #[test]
    fn an_end_keeps_its_code_under_further_words() {
        let ended: anyhow::Result<()> = Err(Ended::not_conforming("too long".to_owned()).into());
        assert_eq!(code(&ended.context("lengths.csv").unwrap_err()), NOT_CONFORMING);
        assert_eq!(code(&anyhow::anyhow!("no such file")), REFUSED);
    }
}
