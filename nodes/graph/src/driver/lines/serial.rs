//! A serial port: how it is opened, and lines read from it until it is gone.
//!
//! Place in the flow: below [`super::port`], which opens it again after each loss. A port has no beginning and no end: what comes
//! before the first end of a line after opening may be the rest of a line, and what has no end when the port goes is not a whole
//! one; neither is a reading, since half a number is a number, too. Lines end with LF, CR or both. A byte that arrives damaged (parity,
//! framing, break) is read as NUL, and its line refused.

use super::event::{Ended, Event, Gone, Line, MOST_BYTES};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::termios::{
    ControlModes, InputModes, OptionalActions, QueueSelector, SpecialCodeIndex, Termios, ioctl_tiocexcl, tcflush,
    tcgetattr, tcsetattr,
};
use rustix::time::Timespec;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result};
use std::path::PathBuf;
use std::sync::Weak;
use std::sync::mpsc::SyncSender;
use std::time::SystemTime;

/// How often a port on which nothing comes looks whether somebody still listens.
const LOOK_UP: Timespec = Timespec { tv_sec: 0, tv_nsec: 100_000_000 };
/// Fastest port (baud).
const FASTEST: u32 = 20_000_000;

/// A serial port, as launch configurations describe it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SerialConfig {
    /// Its device, best by a name that stays, as in `/dev/serial/by-id`.
    pub port: PathBuf,
    /// Bits a second, of any number that the port takes.
    pub baud: u32,
    /// Bits of a byte, 5 to 8; 8 without it.
    #[serde(default = "eight")]
    pub data_bits: u8,
    /// Parity; none without it.
    #[serde(default)]
    pub parity: Parity,
    /// Stop bits, 1 or 2; 1 without it.
    #[serde(default = "one")]
    pub stop_bits: u8,
    /// Who holds back whom; nobody without it.
    #[serde(default)]
    pub flow: Flow,
}

/// Parity of a byte.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Parity {
    /// No bit for it.
    #[default]
    None,
    /// An even number of ones.
    Even,
    /// An odd number of ones.
    Odd,
}

/// Flow control.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Flow {
    /// None.
    #[default]
    None,
    /// The lines RTS and CTS.
    RtsCts,
    /// The signs XON and XOFF.
    XonXoff,
}

fn eight() -> u8 {
    8
}

fn one() -> u8 {
    1
}

impl fmt::Display for SerialConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parity = match self.parity {
            Parity::None => 'N',
            Parity::Even => 'E',
            Parity::Odd => 'O',
        };
        write!(f, "serial {} {} {}{parity}{}", self.port.display(), self.baud, self.data_bits, self.stop_bits)
    }
}

impl SerialConfig {
    pub(super) fn problem(&self) -> Option<String> {
        let problem = if !self.port.is_absolute() {
            "serial.port must be the whole path of a device, such as \"/dev/ttyUSB0\""
        } else if self.baud == 0 || self.baud > FASTEST {
            "serial.baud must be above 0, and at most 20000000"
        } else if !(5..=8).contains(&self.data_bits) {
            "serial.data_bits must be 5, 6, 7 or 8"
        } else if !(1..=2).contains(&self.stop_bits) {
            "serial.stop_bits must be 1 or 2"
        } else {
            return None;
        };
        Some(problem.to_owned())
    }

    /// What a port is set to.
    fn apply(&self, settings: &mut Termios) -> Result<()> {
        settings.make_raw();
        // CR ends a line as LF does, and a damaged byte is a NUL.
        settings.input_modes = InputModes::ICRNL | InputModes::INPCK;
        if self.flow == Flow::XonXoff {
            settings.input_modes |= InputModes::IXON | InputModes::IXOFF;
        }
        let own = ControlModes::CSIZE
            | ControlModes::PARENB
            | ControlModes::PARODD
            | ControlModes::CSTOPB
            | ControlModes::CRTSCTS
            | ControlModes::HUPCL;
        settings.control_modes.remove(own);
        // Without HUPCL a box that begins anew when the line DTR falls does not do so at each opening.
        settings.control_modes |= self.control_modes() | ControlModes::CREAD | ControlModes::CLOCAL;
        settings.special_codes[SpecialCodeIndex::VMIN] = 1;
        settings.special_codes[SpecialCodeIndex::VTIME] = 0;
        Ok(settings.set_speed(self.baud)?)
    }

    fn control_modes(&self) -> ControlModes {
        let mut modes = match self.data_bits {
            5 => ControlModes::CS5,
            6 => ControlModes::CS6,
            7 => ControlModes::CS7,
            _ => ControlModes::CS8,
        };
        modes |= match self.parity {
            Parity::None => ControlModes::empty(),
            Parity::Even => ControlModes::PARENB,
            Parity::Odd => ControlModes::PARENB | ControlModes::PARODD,
        };
        modes.set(ControlModes::CSTOPB, self.stop_bits == 2);
        modes.set(ControlModes::CRTSCTS, self.flow == Flow::RtsCts);
        modes
    }

    /// Opens the port for this program alone.
    fn open(&self) -> Result<File> {
        // Not waiting: without a carrier, opening alone may take for ever.
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let port = rustix::fs::open(&self.port, flags, Mode::empty()).map_err(|errno| self.no_port(errno))?;
        let mut wanted = tcgetattr(&port).map_err(|errno| self.no_port(errno))?;
        ioctl_tiocexcl(&port)?;
        self.apply(&mut wanted)?;
        let unfit = |what: &str| {
            Error::new(ErrorKind::Unsupported, format!("the port does not take {what}; name what it can do"))
        };
        tcsetattr(&port, OptionalActions::Now, &wanted).map_err(|_| unfit("these settings"))?;
        // It is no error of the system where only some of them are taken.
        let own = ControlModes::CSIZE
            | ControlModes::PARENB
            | ControlModes::PARODD
            | ControlModes::CSTOPB
            | ControlModes::CRTSCTS;
        let taken = tcgetattr(&port)?;
        if taken.control_modes & own != wanted.control_modes & own {
            return Err(unfit("these data bits, parity, stop bits or flow control"));
        }
        if taken.input_speed().abs_diff(self.baud) > self.baud / 50 {
            return Err(unfit(&format!("{} baud (it has {})", self.baud, taken.input_speed())));
        }
        // What waits there is from before.
        tcflush(&port, QueueSelector::IFlush)?;
        Ok(File::from(port))
    }

    /// Why there is no port, and what to do.
    fn no_port(&self, errno: Errno) -> Error {
        let why = match errno {
            Errno::NOENT | Errno::NODEV | Errno::NXIO => {
                "is not there; see that it is plugged in, and that the name is right"
            }
            Errno::ACCESS | Errno::PERM => {
                "may not be opened by this user; add the user to the group of the device (often dialout), and log in anew"
            }
            Errno::BUSY => "is held by another program; end that",
            Errno::NOTTY | Errno::INVAL | Errno::ISDIR => "is no serial port; name the device of one",
            other => return Error::new(Error::from(other).kind(), format!("{}: {other}", self.port.display())),
        };
        Error::new(Error::from(errno).kind(), format!("{} {why}", self.port.display()))
    }
}

/// Reads a port until it is gone, or nobody listens any more.
pub(super) fn read_serial(config: &SerialConfig, give: &SyncSender<Event>, listener: &Weak<()>) -> Ended {
    let mut port = config.open()?;
    if give.send(Event::Connected(config.port.display().to_string())).is_err() {
        return Ok(Err(Gone));
    }
    let mut lines = Cut::default();
    let mut bytes = [0; 4096];
    loop {
        if listener.strong_count() == 0 {
            return Ok(Err(Gone));
        }
        let mut wait = [PollFd::new(&port, PollFlags::IN)];
        match poll(&mut wait, Some(&LOOK_UP)) {
            Ok(0) | Err(Errno::INTR) => continue,
            other => other.map_err(Error::from)?,
        };
        let count = match port.read(&mut bytes) {
            Err(error) if matches!(error.kind(), ErrorKind::Interrupted | ErrorKind::WouldBlock) => continue,
            Ok(0) => return Err(Error::new(ErrorKind::UnexpectedEof, "the port is gone; it was unplugged")),
            // What a port that was pulled out gives.
            Err(error) if error.raw_os_error() == Some(Errno::IO.raw_os_error()) => {
                return Err(Error::new(ErrorKind::UnexpectedEof, "the port is gone; it was unplugged"));
            }
            other => other?,
        };
        for event in lines.take(&bytes[..count], SystemTime::now()) {
            if give.send(event).is_err() {
                return Ok(Err(Gone));
            }
        }
    }
}

/// Cuts bytes into lines.
#[derive(Debug, Default)]
struct Cut {
    line: Vec<u8>,
    /// An end of a line has been seen: what follows begins one.
    is_whole: bool,
    is_too_long: bool,
}

impl Cut {
    fn take(&mut self, bytes: &[u8], arrived: SystemTime) -> Vec<Event> {
        let mut events = Vec::new();
        for byte in bytes {
            match byte {
                // What was sent as CR and LF is an empty line more, which is passed over.
                b'\n' if self.line.is_empty() && !self.is_too_long => self.is_whole = true,
                b'\n' => {
                    let text = std::mem::take(&mut self.line);
                    let (is_whole, is_too_long) = (self.is_whole, self.is_too_long);
                    (self.is_whole, self.is_too_long) = (true, false);
                    events.push(match (is_whole, is_too_long) {
                        (false, _) => Event::NotWhole,
                        (true, true) => Event::TooLong,
                        (true, false) => Event::Line(Line { text, arrived }),
                    });
                }
                _ if self.line.len() >= MOST_BYTES => {
                    self.line.clear();
                    self.is_too_long = true;
                }
                _ if self.is_too_long => {}
                _ => self.line.push(*byte),
            }
        }
        events
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::pty::{OpenptFlags, grantpt, openpt, unlockpt};

    fn texts(cut: &mut Cut, bytes: &[u8]) -> Vec<String> {
        let word = |event| match event {
            Event::Line(line) => String::from_utf8(line.text).unwrap(),
            Event::NotWhole => "(not whole)".to_owned(),
            Event::TooLong => "(too long)".to_owned(),
            other => panic!("{other:?}"),
        };
        cut.take(bytes, SystemTime::UNIX_EPOCH).into_iter().map(word).collect()
    }

    #[test]
    fn what_may_have_begun_before_and_what_has_no_end_is_no_line() {
        let mut cut = Cut::default();
        assert_eq!(texts(&mut cut, b"23.4,1"), [""; 0]);
        assert_eq!(texts(&mut cut, b".5\n\n1,2\n3,"), ["(not whole)", "1,2"]);
        assert_eq!(texts(&mut cut, b"4\n"), ["3,4"]);
        let long = [vec![b'7'; 3 * MOST_BYTES], b"\n5,6\n".to_vec()].concat();
        assert_eq!(texts(&mut cut, &long), ["(too long)", "5,6"]);
        // A port that happens to be opened between two lines.
        assert_eq!(texts(&mut Cut::default(), b"\n1,2\n"), ["1,2"]);
    }

    #[test]
    fn bits_parity_and_flow_become_what_the_port_is_set_to() {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let mut settings = tcgetattr(&master).unwrap();
        let text =
            "port = \"/dev/x\"\nbaud = 19200\ndata_bits = 7\nparity = \"even\"\nstop_bits = 2\nflow = \"xon_xoff\"";
        let config: SerialConfig = toml::from_str(text).unwrap();
        assert_eq!((config.problem(), config.to_string().as_str()), (None, "serial /dev/x 19200 7E2"));
        config.apply(&mut settings).unwrap();
        let modes = settings.control_modes;
        assert_eq!(modes & ControlModes::CSIZE, ControlModes::CS7);
        assert!(modes.contains(ControlModes::PARENB | ControlModes::CSTOPB) && !modes.contains(ControlModes::PARODD));
        assert!(!modes.intersects(ControlModes::CRTSCTS | ControlModes::HUPCL));
        assert!(settings.input_modes.contains(InputModes::IXON | InputModes::INPCK | InputModes::ICRNL));
        assert_eq!(settings.input_speed(), 19200);
        let odd: SerialConfig =
            toml::from_str("port = \"/dev/x\"\nbaud = 250000\nparity = \"odd\"\nflow = \"rts_cts\"").unwrap();
        odd.apply(&mut settings).unwrap();
        let modes = settings.control_modes;
        assert!(
            modes.contains(ControlModes::CS8 | ControlModes::PARENB | ControlModes::PARODD | ControlModes::CRTSCTS)
        );
        assert!(!modes.contains(ControlModes::CSTOPB) && !settings.input_modes.contains(InputModes::IXON));
        assert_eq!(settings.input_speed(), 250_000);
    }

    #[test]
    fn why_there_is_no_port_is_said_with_what_to_do() {
        let config: SerialConfig = toml::from_str("port = \"/dev/ttyUSB7\"\nbaud = 9600").unwrap();
        for (errno, words) in [
            (Errno::NOENT, "/dev/ttyUSB7 is not there; see that it is plugged in"),
            (Errno::ACCESS, "add the user to the group of the device (often dialout)"),
            (Errno::BUSY, "held by another program"),
            (Errno::NOTTY, "is no serial port"),
            (Errno::NOMEM, "/dev/ttyUSB7: "),
        ] {
            let said = config.no_port(errno).to_string();
            assert!(said.contains(words), "{said}");
        }
    }
}
