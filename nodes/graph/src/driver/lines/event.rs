//! What is read at a port: lines, and what happens instead of one.
//!
//! Place in the flow: from the thread of [`super::port`], whatever it reads from, to the node's loop.

use std::time::SystemTime;

/// Bytes of a line at most.
pub(super) const MOST_BYTES: usize = 4096;

/// A line, without what ends it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::driver) struct Line {
    pub(in crate::driver) text: Vec<u8>,
    /// When it was complete.
    pub(in crate::driver) arrived: SystemTime,
}

/// What happens at a port.
#[derive(Debug)]
pub(in crate::driver) enum Event {
    Connected(String),
    Line(Line),
    /// A line of more than [`MOST_BYTES`] was passed over.
    TooLong,
    /// The first line of a serial port, which may have begun before it was opened, was passed over.
    NotWhole,
    /// A line that was under way when its connection ended, or its packet: half a number is a number, too.
    Half,
    /// Said each time; who listens says the same only once.
    Lost(String),
}

/// The loop is gone.
pub(super) struct Gone;

/// How reading ended: well, with a problem, or with the loop.
pub(super) type Ended = std::io::Result<Result<(), Gone>>;
