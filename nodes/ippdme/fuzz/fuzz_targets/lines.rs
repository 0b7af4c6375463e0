//! Any bytes as lines of the protocol: messages or refusals, never a panic, and no byte is lost.

#![no_main]

use abbe_ippdme::line::{Lines, Piece, text};
use abbe_ippdme::message::{Command, Response};
use abbe_ippdme::trouble::Trouble;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    for piece in Lines::default().take(data) {
        let Piece::Line(line) = piece else { continue };
        let line = text(&line);
        if let Ok(command) = Command::parse(line) {
            assert_eq!(line[command.end], b')');
        }
        if let Ok(response) = Response::parse(line) {
            let _ = response.items();
            assert!(!Trouble::parse(response.data()).to_string().is_empty());
        }
    }
});
