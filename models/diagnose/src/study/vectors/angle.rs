//! Angular errors of the axes as candidates: what a turn of a carriage does to the point far from it.
//!
//! Place in the flow: candidates of the study of vectors where a machine says how its axes carry each other. What goes smoothly with the
//! reading of one axis and straight with the arm behind it is by its definition an angular error of that axis (ISO 230-1), such as E_BX, and
//! no cause has to stand behind it. The carriage turns about the middle of the positions: what it does there is a linear error, whose straight
//! part has a name of its own. What does the same in more words is tested beside all of them ([`beside`]). SI, first order.

use super::quantities::POSITION;
use super::registered::Nominal;
use super::shape::{HIGHEST, Quantity};
use crate::explanation::Explanation;
use crate::study::candidate::{Candidate, Goes, ModelTerm};
use abbe_geometry::effects::{ParameterSpec, Shape};
use abbe_geometry::{Axis, ErrorId, Vector3};
use faer::{Mat, Scale};

/// Degrees that are tried.
const DEGREES: [usize; 3] = [1, 2, HIGHEST];
/// Largest coefficient believed (rad).
const PLAUSIBLE_RAD: f64 = 1e-3;
/// Share of the largest arm below which all arms are alike: then the error only shifts, as a linear error does.
const ALIKE: f64 = 1e-6;

/// An angular error of an axis, as polynomials of its reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Angle {
    pub(super) axis: Axis,
    about: Axis,
    /// The position of its axis, among the quantities.
    quantity: usize,
    degree: usize,
    /// What a turn does to the tip in the middle of the positions (m/rad).
    middle: Vector3<f64>,
}

impl Angle {
    /// Those that vectors can show of which these components were measured.
    pub(super) fn all(quantities: &[Quantity], nominal: &[Nominal], measured: [bool; 3]) -> Vec<Angle> {
        let of = |angle: Angle| {
            let degrees = DEGREES.into_iter().filter(move |degree| *degree < quantities[angle.quantity].levels);
            degrees.map(move |degree| Angle { degree, ..angle })
        };
        straight(quantities, nominal, measured).into_iter().flat_map(of).collect()
    }

    /// Whether it goes straight with its axis.
    pub(super) fn is_straight(&self) -> bool {
        self.degree == 1
    }

    fn id(&self) -> ErrorId {
        ErrorId::angular(self.about, self.axis)
    }

    /// Motion per unit of each parameter at one vector, where the nominal chain stands so (m/rad).
    pub(super) fn motion(&self, quantities: &[Quantity], nominal: &Nominal, k: usize) -> Vec<Vector3<f64>> {
        let by_turn = nominal.by_error(self.id()) - self.middle;
        let powers = &quantities[self.quantity].powers;
        (1..=self.degree).map(|power| by_turn * powers[power][k]).collect()
    }

    pub(super) fn candidate(&self) -> Candidate {
        let (name, axis, about) = (self.id().name(), self.axis, self.about);
        let parameter = |k: usize| ParameterSpec::new(format!("c_{k}"), "rad", PLAUSIBLE_RAD);
        Candidate {
            name: format!("angular error {name} of {} about {}, degree {}", axis.letter(), about.letter(), self.degree),
            formula: format!("{name} = sum c_k P_k({}), Legendre", axis.lower()),
            kind: Explanation::Attributed,
            family: name.clone(),
            covariates: vec![POSITION[axis.index()].to_owned()],
            parameters: (1..=self.degree).map(parameter).collect(),
            decided_by: format!("measure {name} by itself, with an electronic level or an autocollimator"),
            essential: Vec::new(),
            stands_apart: false,
            goes: Goes::BeforeDescriptions,
        }
    }

    /// As effects of a machine model, where the readings of the axis have this range (m): the turn, less what it does in the middle.
    pub(super) fn terms(&self, (low_m, high_m): (f64, f64)) -> Vec<ModelTerm> {
        let term = |acts: &str, factor: f64| {
            let shape = Shape::new().text("acts", acts).text("p", POSITION[self.axis.index()]);
            let shape = shape.number("p_low", low_m).number("p_high", high_m);
            let shape = shape.number("degree", self.degree as f64).number("whole", 1.0);
            let map = Scale(factor) * Mat::<f64>::identity(self.degree, self.degree);
            ModelTerm { effect: "empirical", shape, map, table: None }
        };
        let moved = Axis::ALL.into_iter().filter(|axis| self.middle[axis.index()] != 0.0);
        let less = moved.map(|axis| term(axis.lower(), -self.middle[axis.index()]));
        std::iter::once(term(&self.id().name(), 1.0)).chain(less).collect()
    }
}

/// Columns of all angular errors that vectors can show of which these components were measured, over the standard uncertainty: three rows a
/// vector, as many polynomials each as so many columns in all allow, and one at least.
pub(super) fn beside(
    (quantities, nominal, measured): (&[Quantity], &[Nominal], [bool; 3]),
    sigma_m: &[[f64; 3]],
    columns: usize,
) -> Mat<f64> {
    let angular = straight(quantities, nominal, measured);
    let degree = (columns / angular.len().max(1)).clamp(1, HIGHEST);
    let mut all = Mat::zeros(3 * sigma_m.len(), angular.len() * degree);
    for (place, angle) in angular.into_iter().enumerate() {
        let angle = Angle { degree, ..angle };
        for (k, (nominal, sigma_m)) in nominal.iter().zip(sigma_m).enumerate() {
            for (j, moved) in angle.motion(quantities, nominal, k).into_iter().enumerate() {
                (0..3).for_each(|d| all[(3 * k + d, place * degree + j)] = moved[d] / sigma_m[d]);
            }
        }
    }
    all
}

/// Angular errors of the axes whose position varies, straight in it, which vectors can show of which these components were measured.
fn straight(quantities: &[Quantity], nominal: &[Nominal], measured: [bool; 3]) -> Vec<Angle> {
    let position = |axis: Axis| quantities.iter().position(|own| own.name == POSITION[axis.index()]);
    let varying = Axis::ALL.into_iter().filter_map(|axis| Some((axis, position(axis)?)));
    let one = |axis, about, quantity| {
        let by_turn = nominal.iter().map(|nominal| nominal.by_error(ErrorId::angular(about, axis)));
        let middle = by_turn.sum::<Vector3<f64>>() / nominal.len().max(1) as f64;
        Angle { axis, about, quantity, degree: 1, middle }
    };
    let all = varying.flat_map(|(axis, quantity)| Axis::ALL.map(|about| one(axis, about, quantity)));
    all.filter(|angle| has_arms(angle, &quantities[angle.quantity], nominal, measured)).collect()
}

/// Whether a turn moves some points more than others at the same reading of its axis, in a component that was measured. Under a workpiece the
/// arm goes with the reading itself: that alone is a straightness.
fn has_arms(angle: &Angle, position: &Quantity, nominal: &[Nominal], measured: [bool; 3]) -> bool {
    let along = &position.powers[1];
    let mean = along.iter().sum::<f64>() / along.len().max(1) as f64;
    let spread: f64 = along.iter().map(|own| (own - mean).powi(2)).sum();
    (0..3).filter(|d| measured[*d]).any(|d| {
        let arms: Vec<f64> = nominal.iter().map(|own| own.by_error(angle.id())[d] - angle.middle[d]).collect();
        let with_reading = arms.iter().zip(along).map(|(arm, own)| arm * (own - mean)).sum::<f64>() / spread;
        let largest =
            |of: &dyn Fn(f64, f64) -> f64| arms.iter().zip(along).map(|(a, p)| of(*a, *p).abs()).fold(0.0, f64::max);
        let whole = largest(&|arm, _| arm + angle.middle[d]);
        largest(&|arm, own| arm - with_reading * (own - mean)) > ALIKE * whole
    })
}

#[cfg(test)]
mod tests {
    use super::super::ResidualVector;
    use super::super::quantities::quantities;
    use super::super::registered::Logged;
    use super::*;
    use crate::tests::machine;
    use abbe_geometry::effects::construct;
    use abbe_geometry::machine::Side;

    /// What a candidate does at the vectors is what its terms do in a model, about whatever middle.
    #[test]
    fn the_terms_of_an_angular_error_move_the_tip_as_the_candidate_does() {
        let machine = machine();
        let at = |k: usize| [k % 4, k / 4 % 5, k / 20].map(|place| 0.05 + 0.12 * place as f64);
        let vectors: Vec<ResidualVector> =
            (0..60).map(|k| ResidualVector { position_m: at(k), ..ResidualVector::default() }).collect();
        let (quantities, _) = quantities(&vectors);
        let nominal = Nominal::at(&vectors, &machine);
        let all = Angle::all(&quantities, &nominal, [true; 3]);
        assert!(all.iter().any(|angle| angle.middle.norm() > 0.1), "arms have a middle");
        for angle in all {
            let range = quantities[angle.quantity].range;
            for (k, vector) in vectors.iter().enumerate() {
                let mut moved = vec![Vector3::zeros(); angle.degree];
                for term in angle.terms(range) {
                    let effect = construct(term.effect, &term.shape, &machine).unwrap();
                    let own = nominal[k].motion(effect.as_ref(), angle.degree, &Logged { vector, start_s: 0.0 });
                    for (row, own) in own.unwrap().iter().enumerate() {
                        (0..angle.degree).for_each(|j| moved[j] += own * term.map[(row, j)]);
                    }
                }
                for (j, own) in angle.motion(&quantities, &nominal[k], k).iter().enumerate() {
                    assert!((moved[j] - own).norm() < 1e-12, "{angle:?} {k} {j}: {} {own}", moved[j]);
                }
            }
        }
    }

    #[test]
    fn what_no_arm_of_a_plate_tells_is_no_candidate() {
        let vectors: Vec<ResidualVector> = (0..25)
            .map(|k| ResidualVector {
                position_m: [0.1 * f64::from(k % 5), 0.1 * f64::from(k / 5), 0.2],
                ..ResidualVector::default()
            })
            .collect();
        let (quantities, _) = quantities(&vectors);
        let nominal = Nominal::at(&vectors, &machine());
        let names = |measured| -> Vec<String> {
            let all = Angle::all(&quantities, &nominal, measured);
            all.iter().filter(|angle| angle.degree == 1).map(|angle| angle.id().name()).collect()
        };
        // X carries Y carries Z: in the plane only a yaw of X has arms that differ, and across it a roll.
        assert_eq!(names([true, true, false]), ["ECX"]);
        assert_eq!(names([true; 3]), ["EAX", "ECX"]);
    }

    #[test]
    fn an_arm_that_goes_with_the_reading_of_its_own_axis_is_none() {
        let mut machine = machine();
        machine.joints[0].side = Side::Workpiece;
        let along_x = |k: u32| [0.05 * f64::from(k), 0.3, 0.2];
        let vectors: Vec<ResidualVector> =
            (0..12).map(|k| ResidualVector { position_m: along_x(k), ..ResidualVector::default() }).collect();
        let (quantities, _) = quantities(&vectors);
        assert_eq!(Angle::all(&quantities, &Nominal::at(&vectors, &machine), [true; 3]), []);
    }
}
