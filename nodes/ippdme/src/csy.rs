//! Coordinate systems of a server, and where each lies.
//!
//! Place in the flow: [`crate::relay`] turns reported points into machine coordinates with it, and corrected ones back. A
//! transformation is six numbers X0, Y0, Z0 (mm), Theta, Psi, Phi (degrees): p' = R p + p0, where p0 is the zero point of the
//! machine in the other system and R turns by Psi about z, by Theta about the new x, by Phi about the newest z (section 6.3.3 and
//! appendix A.4.2 of the specification, version 1.4.3).

use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

/// Systems that positions can be told in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Csy {
    /// The machine's own.
    Machine,
    /// Of movable equipment.
    MoveableMachine,
    /// Common to several arms.
    MultipleArm,
    /// Of the part.
    Part,
}

/// All of them, from the machine to the part.
pub const ALL: [Csy; 4] = [Csy::Machine, Csy::MoveableMachine, Csy::MultipleArm, Csy::Part];

impl Csy {
    /// Its name in the protocol.
    pub fn name(self) -> &'static str {
        match self {
            Csy::Machine => "MachineCsy",
            Csy::MoveableMachine => "MoveableMachineCsy",
            Csy::MultipleArm => "MultipleArmCsy",
            Csy::Part => "PartCsy",
        }
    }

    /// The system of this name.
    pub fn of_name(name: &str) -> Option<Csy> {
        ALL.into_iter().find(|csy| csy.name() == name)
    }
}

/// Why six numbers are no transformation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum NoTransformation {
    /// There are not six.
    #[error("it has not six numbers")]
    Count,
    /// One is no finite number, or of a size that no machine has.
    #[error("a number is not finite, or larger than any machine")]
    Size,
    /// Theta has a range.
    #[error("Theta lies outside 0 to 180 degrees")]
    Theta,
}

/// Farthest that a zero point may lie (mm).
const FARTHEST_MM: f64 = 1e6;

/// From the machine's system to another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transformation {
    turn: Matrix3<f64>,
    zero_mm: Vector3<f64>,
    /// Theta, Psi, Phi.
    angles_deg: [f64; 3],
}

/// Turns nearer than this to each other (cosines) correct alike: a correction of a millimetre differs by a tenth of a micrometre.
const ALIKE: f64 = 1e-4;

impl Transformation {
    /// The one that changes nothing.
    pub fn identity() -> Transformation {
        Transformation { turn: Matrix3::identity(), zero_mm: Vector3::zeros(), angles_deg: [0.0; 3] }
    }

    /// Of X0, Y0, Z0 (mm), Theta, Psi, Phi (degrees).
    pub fn new(numbers: &[f64]) -> Result<Transformation, NoTransformation> {
        let [x, y, z, theta, psi, phi] = numbers else { return Err(NoTransformation::Count) };
        if !numbers.iter().all(|number| number.abs() <= FARTHEST_MM) {
            return Err(NoTransformation::Size);
        }
        if !(0.0..=180.0).contains(theta) {
            return Err(NoTransformation::Theta);
        }
        let angles_deg = [*theta, *psi, *phi];
        Ok(Transformation { turn: turn(angles_deg), zero_mm: Vector3::new(*x, *y, *z), angles_deg })
    }

    /// Whether a server that means another turn by the same numbers (the other way, angles in another order, none at all) would
    /// tell the same point here, to `within_mm`. Then this point does not show what it means.
    pub fn could_be_meant_otherwise(&self, in_machine_mm: [f64; 3], in_other_mm: [f64; 3], within_mm: f64) -> bool {
        let (point, told, zero) = (Vector3::from(in_machine_mm), Vector3::from(in_other_mm), self.zero_mm);
        self.other_turns().iter().any(|turn| {
            let ways = [turn * point + zero, turn * point - zero, turn * (point + zero), turn * (point - zero)];
            ways.iter().any(|way| (way - told).amax() <= within_mm)
        })
    }

    /// What else the three angles may mean.
    fn other_turns(&self) -> Vec<Matrix3<f64>> {
        const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
        let signs = (0..8).map(|bits| [0, 1, 2].map(|k| if bits >> k & 1 == 0 { 1.0 } else { -1.0 }));
        let all =
            signs.flat_map(|sign| ORDERS.map(|order| turn([0, 1, 2].map(|k| sign[k] * self.angles_deg[order[k]]))));
        all.filter(|other| (other - self.turn).amax() > ALIKE).collect()
    }

    /// Whether it changes nothing.
    pub fn is_identity(&self) -> bool {
        *self == Transformation::identity()
    }

    /// A point of the machine's system in the other (mm).
    pub fn from_machine(&self, point_in_machine_mm: [f64; 3]) -> [f64; 3] {
        (self.turn * Vector3::from(point_in_machine_mm) + self.zero_mm).into()
    }

    /// A point of the other system in the machine's (mm).
    pub fn to_machine(&self, point_mm: [f64; 3]) -> [f64; 3] {
        (self.turn.transpose() * (Vector3::from(point_mm) - self.zero_mm)).into()
    }
}

/// The turn of Theta, Psi, Phi (degrees).
fn turn([theta, psi, phi]: [f64; 3]) -> Matrix3<f64> {
    let ((s1, c1), (s2, c2), (s3, c3)) = (sin_cos(theta), sin_cos(psi), sin_cos(phi));
    Matrix3::new(
        c2 * c3 - c1 * s2 * s3,
        s2 * c3 + c1 * c2 * s3,
        s1 * s3,
        -c2 * s3 - c1 * s2 * c3,
        -s2 * s3 + c1 * c2 * c3,
        s1 * c3,
        s1 * s2,
        -s1 * c2,
        c1,
    )
}

/// Sine and cosine of degrees; quarter turns are exact.
fn sin_cos(degrees: f64) -> (f64, f64) {
    match degrees.rem_euclid(360.0) {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        turned => turned.to_radians().sin_cos(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MACHINE: [f64; 3] = [2.0, 3.0, 4.0];

    /// What a server of the NIST test suite, version 3.0, answers at machine position (2, 3, 4).
    #[test]
    fn val_nist_points_of_the_test_suite() {
        for (numbers, there) in [
            ([0.0, 0.0, 0.0, 0.0, 180.0, 0.0], [-2.0, -3.0, 4.0]),
            ([0.0, 0.0, 0.0, 0.0, 0.0, 180.0], [-2.0, -3.0, 4.0]),
            ([0.0, 0.0, 0.0, 0.0, 29.0, 151.0], [-2.0, -3.0, 4.0]),
            ([0.0, 0.0, 0.0, 180.0, 0.0, 0.0], [2.0, -3.0, -4.0]),
            ([5.0, 6.0, 7.0, 0.0, 0.0, 0.0], [7.0, 9.0, 11.0]),
            ([1.0, 0.0, 0.0, 90.0, 0.0, 0.0], [3.0, 4.0, -3.0]),
        ] {
            let point = Transformation::new(&numbers).unwrap().from_machine(MACHINE);
            assert!(point.iter().zip(there).all(|(a, b)| (a - b).abs() < 1e-12), "{numbers:?}: {point:?}");
        }
    }

    /// Psi 90° about z takes x to −y' : x' = y, y' = −x. Theta 90° then about x': y'' = z, z'' = −y'. By hand for (2, 3, 4).
    #[test]
    fn turns_follow_in_the_order_of_the_specification() {
        let turn = Transformation::new(&[0.0, 0.0, 0.0, 90.0, 90.0, 0.0]).unwrap();
        assert_eq!(turn.from_machine(MACHINE), [3.0, 4.0, 2.0]);
        // Phi 90° about the newest z: x''' = y'', y''' = −x''.
        let turn = Transformation::new(&[0.0, 0.0, 0.0, 90.0, 90.0, 90.0]).unwrap();
        assert_eq!(turn.from_machine(MACHINE), [4.0, -3.0, 2.0]);
    }

    #[test]
    fn regress_a_point_on_the_axis_of_a_turn_does_not_show_its_sense() {
        let turned = Transformation::new(&[10.0, 20.0, 30.0, 0.0, 10.0, 0.0]).unwrap();
        let says = |point| turned.could_be_meant_otherwise(point, turned.from_machine(point), 0.01);
        assert!(says([0.0, 0.0, -60.0]) && !says([400.0, 300.0, 180.0]));
        let shifted = Transformation::new(&[10.0, 20.0, 30.0, 0.0, 0.0, 0.0]).unwrap();
        assert!(
            !shifted.could_be_meant_otherwise([0.0; 3], [10.0, 20.0, 30.0], 0.01),
            "no turn, nothing to mean otherwise"
        );
    }

    #[test]
    fn numbers_that_place_nothing_are_refused() {
        assert_eq!(Transformation::new(&[0.0; 5]), Err(NoTransformation::Count));
        assert_eq!(Transformation::new(&[f64::NAN, 0.0, 0.0, 0.0, 0.0, 0.0]), Err(NoTransformation::Size));
        assert_eq!(Transformation::new(&[0.0, 0.0, 0.0, 181.0, 0.0, 0.0]), Err(NoTransformation::Theta));
        assert!(Transformation::new(&[0.0; 6]).unwrap().is_identity());
        assert!(!Transformation::new(&[0.0, 0.0, 1e-9, 0.0, 0.0, 0.0]).unwrap().is_identity());
        assert_eq!((Csy::of_name("PartCsy"), Csy::of_name("Part")), (Some(Csy::Part), None));
    }

    proptest! {
        /// To 1e-11 mm on metres: what double precision leaves.
        #[test]
        fn there_and_back_is_the_same_point_and_distances_stay(
            point in prop::array::uniform3(-2e3..2e3_f64),
            other in prop::array::uniform3(-2e3..2e3_f64),
            zero in prop::array::uniform3(-2e3..2e3_f64),
            theta in 0.0..180.0_f64, psi in -360.0..360.0_f64, phi in -360.0..360.0_f64,
        ) {
            let there = Transformation::new(&[zero[0], zero[1], zero[2], theta, psi, phi]).unwrap();
            let back = there.to_machine(there.from_machine(point));
            prop_assert!(back.iter().zip(point).all(|(a, b)| (a - b).abs() < 1e-11));
            let apart = |a: [f64; 3], b: [f64; 3]| (Vector3::from(a) - Vector3::from(b)).norm();
            let moved = apart(there.from_machine(point), there.from_machine(other));
            prop_assert!((moved - apart(point, other)).abs() < 1e-11);
        }
    }
}
