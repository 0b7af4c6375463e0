//! A recording played over and over: at its end it begins again, at a reading of choice, with sequence and stamps going on.
//!
//! Place in the flow: around the driver of the scale node where the launch file says `repeat_from`, for a graph that has to
//! stay at work longer than its recording lasts. Everything but sequence and stamp comes again bit by bit. What is repeated is
//! kept in memory: let it be short.

use crate::driver::{DriverError, ScaleDriver};
use abbe_msgs::{ScaleReading, Stamp};

/// From the last reading of one pass to the first of the next (ns).
const PAUSE_NS: i64 = 1_000_000_000;

/// Plays a driver once, and then what it gave from some reading on, again and again.
pub(crate) struct Again {
    driver: Box<dyn ScaleDriver>,
    /// Sequence at which a further pass begins.
    from: u64,
    /// What is repeated.
    kept: Vec<ScaleReading>,
    /// Place in it of the next reading; nothing while the driver gives.
    next: Option<usize>,
    /// What was given last, by sequence and stamp (ns).
    given: (u64, i64),
    /// What is added to the stamps of this pass (ns).
    shift_ns: i64,
}

impl Again {
    pub(crate) fn new(driver: Box<dyn ScaleDriver>, from: u64) -> Again {
        Again { driver, from, kept: Vec::new(), next: None, given: (0, 0), shift_ns: 0 }
    }

    /// The reading at this place once more.
    fn repeated(&mut self, place: usize) -> Result<Option<ScaleReading>, DriverError> {
        // Where nothing is kept, there is nothing to begin again with.
        let Some(reading) = self.kept.get(place).copied() else { return Ok(None) };
        let (sequence, last_ns) = self.given;
        let nanos = reading.stamp.to_nanos();
        if place == 0 {
            self.shift_ns = last_ns + PAUSE_NS - nanos;
        }
        let stamp = Stamp::from_nanos(nanos + self.shift_ns).map_err(|_| DriverError::StampsEnd)?;
        self.next = Some((place + 1) % self.kept.len());
        self.given = (sequence + 1, stamp.to_nanos());
        Ok(Some(ScaleReading { sequence: sequence + 1, stamp, ..reading }))
    }
}

impl ScaleDriver for Again {
    fn next_reading(&mut self) -> Result<Option<ScaleReading>, DriverError> {
        if let Some(place) = self.next {
            return self.repeated(place);
        }
        match self.driver.next_reading()? {
            Some(reading) => {
                if reading.sequence >= self.from {
                    self.kept.push(reading);
                }
                self.given = (reading.sequence, reading.stamp.to_nanos());
                Ok(Some(reading))
            }
            None => self.repeated(0),
        }
    }
}
