//! An instant as ROS 2 stamps it: 32-bit seconds and nanoseconds.
//!
//! Place in the flow: set by the driver at the instant of latching, carried unchanged to the
//! corrected coordinates. Input and output: seconds (s) or nanoseconds (ns) since the epoch of the
//! recording or of the clock.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;

use crate::MessageError;

const NANOS_PER_SECOND: i64 = 1_000_000_000;

/// Below this many nanoseconds every count is exact as f64 (2^53).
const EXACT_NANOS: u64 = 1 << 53;

/// Seconds and nanoseconds, as `builtin_interfaces/Time`: the instant is `sec + nanosec / 1e9`,
/// also for negative `sec`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash, ZeroCopySend)]
#[type_name("abbe/Stamp")]
#[allow(unsafe_code)] // The derive implements the unsafe marker trait ZeroCopySend; plain data.
pub struct Stamp {
    sec: i32,
    nanosec: u32,
}

impl Stamp {
    /// The stamp of these seconds and nanoseconds.
    ///
    /// # Errors
    /// When `nanosec` is a second or more.
    pub fn new(sec: i32, nanosec: u32) -> Result<Self, MessageError> {
        if i64::from(nanosec) >= NANOS_PER_SECOND {
            return Err(MessageError::StampNanoseconds { nanosec });
        }
        Ok(Self { sec, nanosec })
    }

    /// The stamp nearest to `seconds`, to the nanosecond.
    ///
    /// # Errors
    /// When `seconds` is not finite or outside 32-bit seconds.
    pub fn from_seconds(seconds: f64) -> Result<Self, MessageError> {
        let out_of_range = MessageError::StampRange { seconds };
        // The bound keeps the casts below exact; the exact limits are from_nanos' to judge.
        if !seconds.is_finite() || seconds.abs() > 4.0e9 {
            return Err(out_of_range);
        }
        let whole = seconds.floor();
        let nanos = ((seconds - whole) * NANOS_PER_SECOND as f64).round();
        Self::from_nanos(whole as i64 * NANOS_PER_SECOND + nanos as i64).map_err(|_| out_of_range)
    }

    /// The stamp of this count of nanoseconds.
    ///
    /// # Errors
    /// When the instant is outside 32-bit seconds.
    pub fn from_nanos(nanos: i64) -> Result<Self, MessageError> {
        let sec = i32::try_from(nanos.div_euclid(NANOS_PER_SECOND));
        let nanosec = u32::try_from(nanos.rem_euclid(NANOS_PER_SECOND));
        match (sec, nanosec) {
            (Ok(sec), Ok(nanosec)) => Ok(Self { sec, nanosec }),
            _ => Err(MessageError::StampRange { seconds: nanos as f64 / NANOS_PER_SECOND as f64 }),
        }
    }

    /// Seconds, the f64 nearest to the stamp within 2^53 ns (104 days) of zero; further away f64
    /// itself is coarser than a nanosecond.
    #[must_use]
    pub fn to_seconds(self) -> f64 {
        let nanos = self.to_nanos();
        if nanos.unsigned_abs() <= EXACT_NANOS {
            nanos as f64 / NANOS_PER_SECOND as f64
        } else {
            f64::from(self.sec) + f64::from(self.nanosec) / NANOS_PER_SECOND as f64
        }
    }

    /// Nanoseconds, exact.
    #[must_use]
    pub fn to_nanos(self) -> i64 {
        i64::from(self.sec) * NANOS_PER_SECOND + i64::from(self.nanosec)
    }

    /// Whole seconds, rounded down.
    #[must_use]
    pub fn sec(self) -> i32 {
        self.sec
    }

    /// Nanoseconds after [`Stamp::sec`], below one second.
    #[must_use]
    pub fn nanosec(self) -> u32 {
        self.nanosec
    }
}

impl fmt::Display for Stamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let nanos = self.to_nanos();
        let sign = if nanos < 0 { "-" } else { "" };
        let size = nanos.unsigned_abs();
        let per_second = NANOS_PER_SECOND.unsigned_abs();
        write!(f, "{sign}{}.{:09}", size / per_second, size % per_second)
    }
}
