//! Whether a campaign holds readings twice: a fit takes each for a measurement of its own.
//!
//! Place in the flow: from the campaign alone. Nobody measures the same length to the last digit twice; a logger that repeats a row, or files
//! that were joined, do. Times may differ.

use super::{Finding, Grade, Subject};
use abbe_measurement::campaign::{Campaign, RangeReading};

/// That readings repeat others, and by what covariances grow so that each counts once (1 where none does).
pub(super) fn copies(campaign: &Campaign) -> (Option<Finding>, f64) {
    let all = campaign.readings.len();
    let key = |k: &u32| {
        let RangeReading { station, reading_m, offset_m, length_m, .. } = campaign.readings[*k as usize];
        (station, reading_m.map(f64::to_bits), offset_m.map(f64::to_bits), length_m.to_bits())
    };
    let mut order: Vec<u32> = (0..all as u32).collect();
    order.sort_unstable_by_key(key);
    let copies = order.windows(2).filter(|pair| key(&pair[0]) == key(&pair[1])).count();
    if copies == 0 {
        return (None, 1.0);
    }
    let finding = Finding { grade: Grade::Warning, subject: Subject::Copies { copies, all }, causes: Vec::new() };
    (Some(finding), all as f64 / (all - copies) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reading_that_was_logged_again_later_is_a_copy() {
        let reading = |k: u32, length_m: f64| RangeReading {
            station: 0,
            line: 0,
            time_s: f64::from(k),
            reading_m: [0.1; 3],
            offset_m: [0.0; 3],
            length_m,
        };
        let campaign = |lengths_m: [f64; 3]| Campaign {
            readings: (0..).zip(lengths_m).map(|(k, length_m)| reading(k, length_m)).collect(),
            ..Campaign::default()
        };
        let (finding, widening) = copies(&campaign([1.0, 1.000_000_1, 1.0]));
        assert_eq!(finding.unwrap().subject, Subject::Copies { copies: 1, all: 3 });
        assert_eq!(widening, 1.5);
        assert_eq!(copies(&campaign([1.0, 1.000_000_1, 1.000_000_2])), (None, 1.0));
    }
}
