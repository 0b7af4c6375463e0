//! Where the measuring lines of ISO 10360-2 lie in a measuring volume.
//!
//! Place in the flow: lines for [`super::measure()`], and their travel for the 66 % of [`super::evaluate()`]. Machine frame, m.

use crate::error::ConformityError;
use nalgebra::Vector3;

/// The measuring volume: lower and upper end of X, Y, Z (m, machine frame).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuringVolume {
    lower_m: Vector3<f64>,
    upper_m: Vector3<f64>,
}

impl MeasuringVolume {
    /// From lower and upper ends of travel of X, Y, Z (m).
    ///
    /// # Errors
    /// Ends that are not finite or not in order.
    pub fn new(stroke_m: [(f64, f64); 3]) -> Result<MeasuringVolume, ConformityError> {
        for (axis, (lower, upper)) in ["X", "Y", "Z"].iter().zip(stroke_m) {
            if !(lower.is_finite() && upper.is_finite() && upper > lower) {
                let problem = format!("travel from {lower} to {upper} m is none");
                return Err(ConformityError::new(format!("axis {axis}"), problem, "give lower and upper end in order"));
            }
        }
        let ends = |pick: fn(&(f64, f64)) -> f64| Vector3::from(stroke_m.map(|end| pick(&end)));
        Ok(MeasuringVolume { lower_m: ends(|e| e.0), upper_m: ends(|e| e.1) })
    }

    /// Point at these shares (0 … 1) of X, Y and Z.
    pub fn at(&self, share: [f64; 3]) -> Vector3<f64> {
        self.lower_m + (self.upper_m - self.lower_m).component_mul(&Vector3::from(share))
    }
}

/// A measuring line from one face, edge or corner of the volume to another.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuringLine {
    /// Name: `X`, `Y`, `Z`, or signs of the direction along X, Y, Z (`PPP`, `NPP` …; `0` for none).
    pub name: String,
    /// Where it enters the volume (m).
    pub from_m: Vector3<f64>,
    /// Where it leaves it (m).
    pub to_m: Vector3<f64>,
    /// Tip relative to the ram (m, ram frame).
    pub offset_m: Vector3<f64>,
}

impl MeasuringLine {
    /// Travel of the machine along the line (m).
    pub fn travel_m(&self) -> f64 {
        (self.to_m - self.from_m).norm()
    }

    /// The same line for a tip that hangs at `stylus_m` (m, ram frame): the tip's volume lies that far from the ram's.
    pub fn with_stylus(mut self, stylus_m: Vector3<f64>) -> MeasuringLine {
        self.from_m += stylus_m;
        self.to_m += stylus_m;
        self.offset_m += stylus_m;
        self
    }

    /// Unit vector along the line.
    pub fn direction(&self) -> Vector3<f64> {
        (self.to_m - self.from_m) / self.travel_m()
    }
}

/// The seven lines of E0: four body diagonals, and through the middle parallels to X, Y and Z. Tool offset 0.
pub fn e0_lines(volume: &MeasuringVolume) -> Vec<MeasuringLine> {
    let line = |name: &str, from: [f64; 3], to: [f64; 3]| MeasuringLine {
        name: name.to_owned(),
        from_m: volume.at(from),
        to_m: volume.at(to),
        offset_m: Vector3::zeros(),
    };
    vec![
        line("PPP", [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]),
        line("NPP", [1.0, 0.0, 0.0], [0.0, 1.0, 1.0]),
        line("PNP", [0.0, 1.0, 0.0], [1.0, 0.0, 1.0]),
        line("PPN", [0.0, 0.0, 1.0], [1.0, 1.0, 0.0]),
        line("X", [0.0, 0.5, 0.5], [1.0, 0.5, 0.5]),
        line("Y", [0.5, 0.0, 0.5], [0.5, 1.0, 0.5]),
        line("Z", [0.5, 0.5, 0.0], [0.5, 0.5, 1.0]),
    ]
}

/// Plane through the middle of the volume in which the two diagonals of a test with a tool offset lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OffsetPlane {
    /// YZ; the offset points along +X.
    Yz,
    /// XZ; the offset points along +Y.
    Xz,
}

/// The two lines of a test with a tool offset such as E150: the diagonals of a plane, the offset across it.
///
/// The tip stays in the volume that the machine measures without an offset; what the ram then lacks of its travel is the
/// user's to know.
///
/// # Errors
/// An offset that is not above zero.
pub fn offset_lines(
    volume: &MeasuringVolume,
    plane: OffsetPlane,
    offset_m: f64,
) -> Result<Vec<MeasuringLine>, ConformityError> {
    if !(offset_m.is_finite() && offset_m > 0.0) {
        let problem = format!("a tool offset of {offset_m} m is none");
        return Err(ConformityError::new(
            "tool offset",
            problem,
            "give the distance of the tip from the ram axis, or test E0",
        ));
    }
    let line = |name: &str, from: [f64; 3], to: [f64; 3], across: Vector3<f64>| MeasuringLine {
        name: name.to_owned(),
        from_m: volume.at(from),
        to_m: volume.at(to),
        offset_m: across * offset_m,
    };
    Ok(match plane {
        OffsetPlane::Yz => vec![
            line("0PP", [0.5, 0.0, 0.0], [0.5, 1.0, 1.0], Vector3::x()),
            line("0PN", [0.5, 0.0, 1.0], [0.5, 1.0, 0.0], Vector3::x()),
        ],
        OffsetPlane::Xz => vec![
            line("P0P", [0.0, 0.5, 0.0], [1.0, 0.5, 1.0], Vector3::y()),
            line("P0N", [0.0, 0.5, 1.0], [1.0, 0.5, 0.0], Vector3::y()),
        ],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume() -> MeasuringVolume {
        MeasuringVolume::new([(0.0, 0.8), (0.0, 0.6), (-0.6, 0.0)]).unwrap()
    }

    #[test]
    fn seven_lines_cross_in_the_middle_with_the_travel_of_edges_and_diagonals() {
        let lines = e0_lines(&volume());
        assert_eq!(lines.len(), super::super::LINES_E0);
        let middle = Vector3::new(0.4, 0.3, -0.3);
        // √(0.64 + 0.36 + 0.36) m = √1.36 m for the diagonals.
        let travel_m = [1.36_f64.sqrt(), 1.36_f64.sqrt(), 1.36_f64.sqrt(), 1.36_f64.sqrt(), 0.8, 0.6, 0.6];
        for (line, travel_m) in lines.iter().zip(travel_m) {
            assert!(((line.from_m + line.to_m) / 2.0 - middle).norm() < 1e-15, "{line:?}");
            assert!((line.travel_m() - travel_m).abs() < 1e-15, "{line:?}");
        }
    }

    #[test]
    fn names_of_diagonals_tell_their_direction() {
        let offset = offset_lines(&volume(), OffsetPlane::Yz, 0.15).unwrap().into_iter();
        let other = offset_lines(&volume(), OffsetPlane::Xz, 0.15).unwrap();
        for line in e0_lines(&volume()).into_iter().chain(offset).chain(other).filter(|l| l.name.len() == 3) {
            let sign = |v: f64| {
                if v > 0.0 {
                    'P'
                } else if v < 0.0 {
                    'N'
                } else {
                    '0'
                }
            };
            assert_eq!(line.direction().iter().map(|v| sign(*v)).collect::<String>(), line.name);
        }
    }

    #[test]
    fn an_offset_is_across_its_plane() {
        for plane in [OffsetPlane::Yz, OffsetPlane::Xz] {
            for line in offset_lines(&volume(), plane, 0.15).unwrap() {
                assert!(
                    (line.offset_m.norm() - 0.15).abs() < 1e-15 && line.offset_m.dot(&line.direction()).abs() < 1e-15
                );
            }
        }
        assert!(offset_lines(&volume(), OffsetPlane::Yz, 0.0).is_err());
    }

    #[test]
    fn a_volume_without_travel_is_refused() {
        for end in [(0.0, 0.0), (1.0, 0.0), (0.0, f64::NAN)] {
            assert!(MeasuringVolume::new([(0.0, 0.8), end, (0.0, 0.6)]).is_err());
        }
    }
}
