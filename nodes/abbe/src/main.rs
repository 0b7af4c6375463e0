//! The program `abbe`.
//!
//! Place in the flow: nothing but the beginning; all of it is in the library beside it.

use std::process::ExitCode;

fn main() -> ExitCode {
    abbe::main()
}
