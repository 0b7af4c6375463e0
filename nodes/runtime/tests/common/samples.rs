//! Samples that would show any change on the way, and how a test takes them.

use std::time::{Duration, Instant};

use abbe_msgs::{Message, ScaleReading, Stamp};
use abbe_runtime::{Publish, Subscribe};

/// Sequence of samples that only find out whether two ends are connected.
const PROBE: u64 = u64::MAX;

/// Far beyond what any step takes; only a test that fails waits for it.
pub(crate) const PATIENCE: Duration = Duration::from_secs(20);

/// A sample that differs from every other in every number, with bit patterns that careless code
/// changes: negative zero, subnormal, NaN with a payload.
pub(crate) fn sample(sequence: u64) -> ScaleReading {
    let mut sample = ScaleReading {
        stamp: Stamp::new(i32::try_from(sequence).unwrap_or(-1), 999_999_999).unwrap(),
        sequence,
        reading_m: [-0.0, f64::MIN_POSITIVE / 8.0, f64::from_bits(0x7ff8_dead_0000_0000 | (sequence & 0xffff))],
        offset_m: [0.1 + sequence as f64 * 1e-9, f64::NEG_INFINITY, 1.0 / 3.0],
        frame_id: "maschine_µm".try_into().unwrap(),
        ..ScaleReading::default()
    };
    for index in 0..6 {
        let name = format!("temp_scale_{index}_c");
        sample.covariates.push(&name, 20.0 + sequence as f64 / 7.0, 0.25).unwrap();
    }
    sample
}

/// The bits of a sample: equal if and only if the samples are identical.
pub(crate) fn bits(sample: &ScaleReading) -> (Vec<u64>, ScaleReading) {
    let numbers = sample.reading_m.iter().chain(&sample.offset_m);
    let numbers = numbers.map(|number| number.to_bits()).collect();
    let mut rest = *sample;
    rest.reading_m = [0.0; 3];
    rest.offset_m = [0.0; 3];
    (numbers, rest)
}

/// Sends probes until one arrives.
pub(crate) fn connect(publisher: &mut dyn Publish<ScaleReading>, subscriber: &mut dyn Subscribe<ScaleReading>) {
    let deadline = Instant::now() + PATIENCE;
    while Instant::now() < deadline {
        publisher.send(&sample(PROBE)).unwrap();
        if subscriber.take_within(Duration::from_millis(10)).unwrap().is_some() {
            return;
        }
    }
    panic!("publisher and subscriber did not find each other within {PATIENCE:?}");
}

/// The next sample that is not a probe; none if none comes within `timeout`.
pub(crate) fn next(subscriber: &mut dyn Subscribe<ScaleReading>, timeout: Duration) -> Option<ScaleReading> {
    let deadline = Instant::now() + timeout;
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        let sample = subscriber.take_within(left).unwrap()?;
        if sample.sequence() != PROBE {
            return Some(sample);
        }
    }
}

/// Sends the samples of these numbers as fast as it goes.
pub(crate) fn send(publisher: &mut dyn Publish<ScaleReading>, numbers: std::ops::Range<u64>) {
    for number in numbers {
        publisher.send(&sample(number)).unwrap();
    }
}

/// Takes as many samples and asserts that they are those of these numbers, in order, to the bit.
pub(crate) fn expect(subscriber: &mut dyn Subscribe<ScaleReading>, numbers: std::ops::Range<u64>) {
    for number in numbers {
        let taken = next(subscriber, PATIENCE);
        let taken = taken.unwrap_or_else(|| panic!("sample {number} did not arrive"));
        assert_eq!(bits(&taken), bits(&sample(number)));
    }
}
