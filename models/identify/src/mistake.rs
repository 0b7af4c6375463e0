//! Mistakes in a campaign that contradict the rest of a station by more than any machine error, and what undoes each.
//!
//! Place in the flow: [`crate::contradiction`] tries them on single lines and on whole stations. SI, machine frame.

use abbe_measurement::campaign::{Campaign, RangeReading};

/// Factors that bring lengths of another unit to metres, when they were taken for millimetres.
const UNITS: [(f64, &str); 5] = [
    (1e-3, "length_mm is divided by 1000: the lengths are in micrometres"),
    (1e3, "length_mm is multiplied by 1000: the lengths are in metres"),
    (25.4, "length_mm is multiplied by 25.4: the lengths are in inches"),
    (1.0 / 25.4, "length_mm is divided by 25.4: the positions are in inches, the lengths are not"),
    (10.0, "length_mm is multiplied by 10: the lengths are in centimetres"),
];

/// A mistake that would explain a contradiction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Mistake {
    /// The offset has the wrong sign in this direction.
    Sign(usize),
    /// Two columns of axis positions are exchanged.
    Exchanged(usize, usize),
    /// An axis is read the other way round.
    Reversed(usize),
    /// The readings belong to this station.
    OtherStation(usize),
    /// Lengths are in another unit: place in the list of units.
    LengthUnit(usize),
    /// Lengths grow towards the station.
    LengthSign,
}

impl Mistake {
    /// What can be wrong with a line of the station `own`.
    pub(crate) fn all(stations: usize, own: usize) -> Vec<Mistake> {
        let mut all: Vec<Mistake> = (0..3).map(Mistake::Sign).collect();
        all.extend([(0, 1), (0, 2), (1, 2)].map(|(a, b)| Mistake::Exchanged(a, b)));
        all.extend((0..3).map(Mistake::Reversed));
        all.extend((0..stations).filter(|k| *k != own).map(Mistake::OtherStation));
        all.extend((0..UNITS.len()).map(Mistake::LengthUnit));
        all.push(Mistake::LengthSign);
        all
    }

    /// The reading as it would be without the mistake.
    pub(crate) fn mended(self, mut reading: RangeReading) -> RangeReading {
        match self {
            Mistake::Sign(d) => reading.offset_m[d] = -reading.offset_m[d],
            Mistake::Exchanged(a, b) => reading.reading_m.swap(a, b),
            // Where its zero lies is taken up by the station.
            Mistake::Reversed(d) => reading.reading_m[d] = -reading.reading_m[d],
            Mistake::OtherStation(station) => reading.station = station as u32,
            Mistake::LengthUnit(unit) => reading.length_m *= UNITS[unit].0,
            Mistake::LengthSign => reading.length_m = -reading.length_m,
        }
        reading
    }

    /// Whether a part of a station's lines can have it: where an axis' zero lies and where lengths count from is one number a
    /// station.
    pub(crate) fn is_of_single_lines(self) -> bool {
        matches!(self, Mistake::Sign(_) | Mistake::Exchanged(..) | Mistake::OtherStation(_))
    }

    /// Words behind `it agrees`.
    pub(crate) fn text(self, campaign: &Campaign) -> String {
        let letter = |d: usize| ['x', 'y', 'z'][d];
        match self {
            Mistake::Sign(d) => {
                format!("when offset_{0}_mm changes its sign: correct the sign of offset_{0}_mm", letter(d))
            }
            Mistake::Exchanged(a, b) => {
                let (a, b) = (letter(a), letter(b));
                format!("when {a}_mm and {b}_mm are exchanged: correct the order of these columns")
            }
            Mistake::Reversed(d) => {
                format!("when {0}_mm changes its sign: this axis is read the other way round", letter(d))
            }
            Mistake::OtherStation(k) => {
                let name = &campaign.stations[k];
                format!("with station {name}: correct the station's name")
            }
            Mistake::LengthUnit(unit) => format!("when {}", UNITS[unit].1),
            Mistake::LengthSign => {
                "when length_mm changes its sign: lengths must grow away from the station".to_owned()
            }
        }
    }
}
