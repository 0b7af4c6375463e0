//! What the program writes on a terminal: colours, and no escape sequence where `NO_COLOR` says so (no-color.org).

use std::fs::File;
use std::io::Read;

use crate::common::assert_says;
use crate::common::files::Bench;
use crate::common::program::abbe;
use rustix::fs::{Mode, OFlags, open};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

/// What a command writes on a terminal of its own.
fn on_terminal(arguments: &[&str], no_color: Option<&str>) -> String {
    let screen = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&screen).unwrap();
    unlockpt(&screen).unwrap();
    let line = open(ptsname(&screen, Vec::new()).unwrap(), OFlags::RDWR | OFlags::NOCTTY, Mode::empty()).unwrap();
    let mut command = abbe(arguments);
    command.env("TERM", "xterm-256color").env_remove("NO_COLOR").env_remove("CLICOLOR").env_remove("CLICOLOR_FORCE");
    if let Some(value) = no_color {
        command.env("NO_COLOR", value);
    }
    let mut child = command.stdout(line.try_clone().unwrap()).stderr(line).spawn().unwrap();
    // With it goes this side's hold on the line: what is read ends with the command.
    drop(command);
    let (mut said, mut part, mut screen) = (Vec::new(), [0; 4096], File::from(screen));
    while let Ok(count @ 1..) = screen.read(&mut part) {
        said.extend_from_slice(&part[..count]);
    }
    child.wait().unwrap();
    String::from_utf8_lossy(&said).into_owned()
}

#[test]
fn regress_no_color_leaves_no_escape_sequences() {
    const ESCAPE: char = '\x1b';
    let bench = Bench::empty();
    // A table that is not plain CSV is told in the log.
    let rows: String = (0..12).map(|k| format!("{};{};{}\n", k % 3, (k * k) % 5, (k * k * k) % 7)).collect();
    let points = bench.write("points.csv", format!("x_mm;y_mm;z_mm\n{rows}"));
    let logs = ["sphere", "--points", &points];
    let refused = ["sphere", "--nonsense"];
    for (arguments, says) in [(&logs[..], "points.csv"), (&refused[..], "--nonsense")] {
        for (no_color, is_coloured) in [(None, true), (Some(""), true), (Some("1"), false)] {
            let said = on_terminal(arguments, no_color);
            assert_says(&said, &[says]);
            assert_eq!(said.contains(ESCAPE), is_coloured, "NO_COLOR={no_color:?}: {said:?}");
        }
    }
}
