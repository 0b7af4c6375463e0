//! Evidence for lines from a serial port: half lines, garbage, other line ends, a port that is pulled out and comes back, one
//! that is none. The ports are pseudo-terminals that the test makes, which the driver opens and sets like any other.

use crate::common::bench;
use abbe_graph::driver::{DriverConfig, DriverError, LinesConfig, ScaleDriver, open_scale};
use abbe_graph::link::LinkState;
use abbe_runtime::Shutdown;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{ControlModes, InputModes, LocalModes, tcgetattr};
use std::fs::{self, File};
use std::io::Write;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::{Duration, Instant};

/// Far beyond what anything here takes on a loaded machine.
const LIMIT: Duration = Duration::from_secs(60);

/// A port by a name that stays, as `/dev/serial/by-id` has them.
struct Plug {
    name: PathBuf,
    end: Option<File>,
}

impl Plug {
    fn new(folder: &Path) -> Plug {
        Plug { name: folder.join("tty-box"), end: None }
    }

    fn plug_in(&mut self) {
        let end = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&end).unwrap();
        unlockpt(&end).unwrap();
        symlink(ptsname(&end, Vec::new()).unwrap().to_str().unwrap(), &self.name).unwrap();
        self.end = Some(File::from(end));
    }

    fn pull_out(&mut self) {
        fs::remove_file(&self.name).unwrap();
        self.end = None;
    }

    /// Whether the driver has set the port: lines are not echoed any more.
    fn is_open(&self) -> bool {
        !tcgetattr(self.end.as_ref().unwrap()).unwrap().local_modes.contains(LocalModes::ECHO)
    }

    fn write(&mut self, bytes: &[u8]) {
        self.end.as_mut().unwrap().write_all(bytes).unwrap();
    }
}

fn driver(port: &Path, more: &str, shutdown: &Shutdown) -> Result<Box<dyn ScaleDriver>, DriverError> {
    let text = format!(
        "from = {{ serial = {{ port = {port:?}, baud = 115200{more} }} }}\ncolumns = [\"x_mm\", \"y_mm\", \"z_mm\"]\n\
         offset_mm = [0.0, 0.0, -60.0]\nsilent_after_s = 0.5\n"
    );
    let config: LinesConfig = toml::from_str(&text).unwrap();
    open_scale(&DriverConfig::Lines(config), Path::new(""), &bench().machine, shutdown, None)
}

/// What the driver gives: x in millimetres, or what was refused.
fn given(mut driver: Box<dyn ScaleDriver>) -> Receiver<Result<f64, String>> {
    let (give, given) = channel();
    thread::spawn(move || {
        loop {
            let one = match driver.next_reading() {
                Ok(Some(reading)) => Ok((reading.reading_m[0] * 1e9).round() / 1e6),
                Ok(None) => return,
                Err(error) => Err(error.to_string()),
            };
            if give.send(one).is_err() {
                return;
            }
        }
    });
    given
}

fn wait_until(what: &str, mut is_so: impl FnMut() -> bool) {
    let since = Instant::now();
    while !is_so() {
        assert!(since.elapsed() < LIMIT, "not within {LIMIT:?}: {what}");
        thread::sleep(Duration::from_millis(5));
    }
}

fn connected(state: &LinkState) -> Option<&String> {
    if let LinkState::Connected(whom) = state { Some(whom) } else { None }
}

fn silent(state: &LinkState) -> Option<&String> {
    if let LinkState::Silent(words) = state { Some(words) } else { None }
}

fn lost(state: &LinkState) -> Option<&String> {
    if let LinkState::Lost(words) = state { Some(words) } else { None }
}

#[test]
fn a_box_at_a_serial_port_is_read_whole_lines_only_and_again_after_it_was_pulled_out() {
    let folder = tempfile::tempdir().unwrap();
    let mut plug = Plug::new(folder.path());
    let shutdown = Shutdown::manual();
    let driver = driver(&plug.name, ", stop_bits = 2, flow = \"xon_xoff\"", &shutdown).unwrap();
    let link = driver.link().unwrap();
    let given = given(driver);
    let stands = |wanted: fn(&LinkState) -> Option<&String>, words: &str| {
        wait_until(words, || wanted(&link.status().state).is_some_and(|said| said.contains(words)));
    };
    stands(lost, "tty-box is not there; see that it is plugged in");

    plug.plug_in();
    wait_until("it is opened", || plug.is_open());
    let set = tcgetattr(plug.end.as_ref().unwrap()).unwrap();
    assert_eq!(set.input_speed(), 115_200);
    assert!(set.control_modes.contains(ControlModes::CSTOPB) && set.input_modes.contains(InputModes::IXON));
    stands(connected, "tty-box");
    // The end of a line that began before would be a reading, and a wrong one: 3.5 of 123.5.
    plug.write(b"3.5,2,3\n1,0,0\r\n");
    let next = || given.recv_timeout(LIMIT).unwrap();
    assert_eq!(next(), Ok(1.0));
    // Half a line, and the rest later; CR alone; nothing between.
    plug.write(b"2.2");
    thread::sleep(Duration::from_millis(50));
    plug.write(b"5,0,0\n3,0,0\r4,0,0\n\n\n");
    assert_eq!([next(), next(), next()], [Ok(2.25), Ok(3.0), Ok(4.0)]);
    // Garbage, a damaged byte, a line that is too long.
    plug.write(b"\xff\xfe\x80,0,0\n1,0\n12\x003,0,0\n");
    plug.write(&[vec![b'7'; 3000], vec![b'7'; 3000], b"\n5,0,0\n".to_vec()].concat());
    let refused: Vec<String> = (0..4).map(|_| next().unwrap_err()).collect();
    for (said, words) in refused.iter().zip(["UTF-8", "2 columns", "it holds a NUL", "longer than 4096"]) {
        assert!(said.contains(words) && said.contains("from serial /"), "{said}");
    }
    assert_eq!(next(), Ok(5.0));
    // A box that says nothing is silent, and its port stays open: nothing that comes then is left out.
    stands(silent, "silent for more than 0.5 s");
    plug.write(b"6,0,0\n");
    assert_eq!(next(), Ok(6.0));

    // Pulled out in the middle of a line: 7 of 7.89 is no reading.
    plug.write(b"7");
    thread::sleep(Duration::from_millis(50));
    plug.pull_out();
    stands(lost, "is not there");
    assert!(link.status().losses >= 2);
    plug.plug_in();
    wait_until("it is opened again", || plug.is_open());
    plug.write(b"\n8,0,0\n");
    assert_eq!(next(), Ok(8.0));
    shutdown.request();
}

#[test]
fn what_is_no_port_or_cannot_be_set_is_told_and_tried_again() {
    let folder = tempfile::tempdir().unwrap();
    let shutdown = Shutdown::manual();
    let said = |port: &Path, more: &str, words: &str| {
        let driver = driver(port, more, &shutdown).unwrap();
        let link = driver.link().unwrap();
        let _given = given(driver);
        wait_until(
            words,
            || matches!(link.status().state, LinkState::Lost(said) if said.contains(words) && said.contains("tried again")),
        );
    };
    said(Path::new("/dev/null"), "", "/dev/null is no serial port");
    said(folder.path(), "", "is no serial port");
    let file = folder.path().join("file");
    fs::write(&file, "1,2,3\n").unwrap();
    said(&file, "", "is no serial port");
    // Pseudo-terminals know bytes of eight bits alone, and say so only when asked.
    let mut plug = Plug::new(folder.path());
    plug.plug_in();
    said(&plug.name, ", data_bits = 7, parity = \"even\"", "does not take these data bits, parity");
    fs::set_permissions(&file, fs::Permissions::from_mode(0o000)).unwrap();
    match rustix::process::geteuid().is_root() {
        true => println!("SKIPPED: root may open every port, so a missing permission was not tried"),
        false => said(&file, "", "may not be opened by this user; add the user to the group"),
    }
    shutdown.request();
}

#[test]
fn settings_that_make_no_port_are_refused_with_what_to_do() {
    let refused = |text: &str| {
        let config: LinesConfig = toml::from_str(text).unwrap();
        let driver = DriverConfig::Lines(config);
        match open_scale(&driver, Path::new(""), &bench().machine, &Shutdown::manual(), None) {
            Err(error) => error.to_string(),
            Ok(_) => panic!("{text} was taken"),
        }
    };
    let columns = "columns = [\"x_mm\", \"y_mm\", \"z_mm\"]\noffset_mm = [0.0, 0.0, 0.0]";
    for (serial, words) in [
        ("port = \"ttyUSB0\", baud = 9600", "whole path of a device"),
        ("port = \"/dev/ttyUSB0\", baud = 0", "serial.baud must be above 0"),
        ("port = \"/dev/ttyUSB0\", baud = 9600, data_bits = 9", "serial.data_bits must be"),
        ("port = \"/dev/ttyUSB0\", baud = 9600, stop_bits = 3", "serial.stop_bits must be"),
    ] {
        let said = refused(&format!("from = {{ serial = {{ {serial} }} }}\n{columns}"));
        assert!(said.starts_with("driver.from: ") && said.contains(words), "{said}");
    }
    let said = refused("from = { serial = { port = \"/dev/ttyUSB0\", baud = 9600 } }\noffset_mm = [0.0, 0.0, 0.0]");
    assert!(said.starts_with("driver.columns: must be named: a serial port"), "{said}");
    for wrong in ["parity = \"mark\"", "flow = \"dtr\"", "bits = 8"] {
        let text = format!("from = {{ serial = {{ port = \"/dev/ttyUSB0\", baud = 9600, {wrong} }} }}");
        let said = toml::from_str::<LinesConfig>(&text).unwrap_err().to_string();
        assert!(said.contains("expected one of"), "{said}");
    }
}
