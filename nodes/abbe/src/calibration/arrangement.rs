//! What another arrangement of the targets would make of the uncertainties: a picture for whoever places them.
//!
//! Place in the flow: part of the report of `abbe guideway`. The targets as seen at the lowest position are moved away from
//! their centroid or towards it, in all directions or across the motion only; each keeps the certainty that it has
//! (`abbe_measurement::guideway::arrangement_covariance`). µm and µrad, k = 2.

use super::COVERAGE;
use abbe_geometry::{Matrix3, Vector3};
use abbe_measurement::guideway::{ArrangedTarget, Guideway, TargetPoint, arrangement_covariance};
use abbe_report::{Axis, Curve, CurveStyle, LinePanel, LinePlot};
use serde_json::{Value, json};

/// Distances from the centroid that are looked at, over those that the targets have.
const SPREADS: [f64; 12] = [0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0];

/// Colours of the six errors: others than those of before and after.
const SERIES: [u8; 6] = [3, 4, 5, 6, 7, 8];

/// Which distances change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Moved {
    Everywhere,
    Across,
}

/// Expanded uncertainties of the six errors (µm, µrad) at each of [`SPREADS`].
#[derive(Debug)]
pub(super) struct BySpread {
    names: [String; 6],
    everywhere: Vec<Option<[f64; 6]>>,
    across: Vec<Option<[f64; 6]>>,
}

impl BySpread {
    /// Of a solved guideway and the points it was solved from; `None` where nothing is known of their certainty.
    pub(super) fn of(solved: &Guideway, points: &[TargetPoint]) -> Option<BySpread> {
        let lowest = solved.positions.first()?.position_m;
        let turn = solved.machine_from_points;
        // The scatter of undeclared points is that of the difference of two readings.
        let scatter_m2 = Matrix3::identity() * (0.5 * solved.scatter_m * solved.scatter_m);
        // As wide as the uncertainties of the result.
        let widening = solved.claim.variance();
        let declared = |covariance| turn.matrix() * covariance * turn.matrix().transpose();
        let target = |point: &TargetPoint| ArrangedTarget {
            point_m: turn * point.point_m,
            covariance_m2: point.covariance_m2.map_or(scatter_m2, declared) * widening,
        };
        let targets: Vec<ArrangedTarget> =
            points.iter().filter(|point| point.position_m == lowest).map(target).collect();
        let reference_m = turn * solved.reference_m;
        let motion = solved.options.axis.unit();
        let all = |moved: Moved| -> Vec<Option<[f64; 6]>> {
            SPREADS.iter().map(|spread| expanded(&targets, &reference_m, (moved, motion, *spread))).collect()
        };
        let (everywhere, across) = (all(Moved::Everywhere), all(Moved::Across));
        let names = solved.options.axis.error_names();
        everywhere.iter().any(Option::is_some).then_some(BySpread { names, everywhere, across })
    }

    pub(super) fn json(&self) -> Value {
        json!({ "coverage_factor": COVERAGE, "spread": SPREADS, "in_all_directions": self.everywhere, "across_the_motion": self.across })
    }

    pub(super) fn plot(&self) -> LinePlot {
        let panel = |title: &str, first: usize, values: &[Option<[f64; 6]>]| LinePanel {
            title: title.to_owned(),
            x: Axis::new("distances between the targets, over those measured with", ""),
            y: Axis::new("uncertainty", if first == 0 { "µm" } else { "µrad" }),
            curves: self.curves(first, values),
        };
        LinePlot {
            title: "What the arrangement of the targets does".to_owned(),
            note: Some(
                "Uncertainty (k = 2) of each error if the same targets, as certain as they were, stood nearer together or further \
                 apart; 1 is the arrangement measured with. Angles fall with the spread across their axis, displacements with the \
                 number of targets only, unless the reference point lies away from them."
                    .to_owned(),
            ),
            columns: 2,
            band_name: None,
            panels: vec![
                panel("Angles, spread in all directions", 3, &self.everywhere),
                panel("Angles, spread across the motion only", 3, &self.across),
                panel("Displacements, spread in all directions", 0, &self.everywhere),
                panel("Displacements, spread across the motion only", 0, &self.across),
            ],
        }
    }

    /// The curves of three errors from `first` on; those that lie on each other are one, with all their names.
    fn curves(&self, first: usize, values: &[Option<[f64; 6]>]) -> Vec<Curve> {
        let mut curves: Vec<Curve> = Vec::new();
        for curve in (first..first + 3).map(|k| self.curve(k, values)) {
            match curves.iter_mut().find(|other| lie_on_each_other(&other.y, &curve.y)) {
                Some(other) => other.name = format!("{}, {}", other.name, curve.name),
                None => curves.push(curve),
            }
        }
        curves
    }

    fn curve(&self, k: usize, values: &[Option<[f64; 6]>]) -> Curve {
        Curve {
            name: self.names[k].clone(),
            style: CurveStyle::Line(SERIES[k]),
            x: SPREADS.to_vec(),
            y: values.iter().map(|u| u.map(|u| u[k])).collect(),
            also: None,
            half_width: None,
        }
    }
}

/// Whether two curves cannot be told apart by eye.
fn lie_on_each_other(one: &[Option<f64>], other: &[Option<f64>]) -> bool {
    const BY_EYE: f64 = 0.01;
    let close = |a: f64, b: f64| (a - b).abs() <= BY_EYE * a.abs().max(b.abs());
    one.iter().zip(other).all(|pair| match pair {
        (Some(a), Some(b)) => close(*a, *b),
        (None, None) => true,
        _ => false,
    })
}

fn expanded(
    targets: &[ArrangedTarget],
    reference_m: &Vector3<f64>,
    (moved, motion, spread): (Moved, Vector3<f64>, f64),
) -> Option<[f64; 6]> {
    let centroid_m = targets.iter().map(|target| target.point_m).sum::<Vector3<f64>>() / targets.len().max(1) as f64;
    let place = |target: &ArrangedTarget| {
        let from_centre_m = target.point_m - centroid_m;
        let along_m = motion * from_centre_m.dot(&motion);
        let moved_m = match moved {
            Moved::Everywhere => from_centre_m * spread,
            Moved::Across => along_m + (from_centre_m - along_m) * spread,
        };
        ArrangedTarget { point_m: centroid_m + moved_m, ..*target }
    };
    let arranged: Vec<ArrangedTarget> = targets.iter().map(place).collect();
    let covariance = arrangement_covariance(&arranged, reference_m).ok()?;
    Some(std::array::from_fn(|k| COVERAGE * covariance[(k, k)].max(0.0).sqrt() * 1e6))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_that_lie_on_each_other_are_one_with_all_their_names() {
        let names = ["EXX", "EYX", "EZX", "EAX", "EBX", "ECX"].map(str::to_owned);
        let values = vec![Some([1.0, 1.0, 1.001, 3.0, 3.0, 4.0]), None, Some([2.0, 2.0, 2.001, 5.0, 5.0, 6.0])];
        let by_spread = BySpread { names, everywhere: values.clone(), across: values };
        let named = |first| {
            by_spread.curves(first, &by_spread.everywhere).into_iter().map(|curve| curve.name).collect::<Vec<_>>()
        };
        assert_eq!(named(0), ["EXX, EYX, EZX"]);
        assert_eq!(named(3), ["EAX, EBX", "ECX"]);
        assert!(!lie_on_each_other(&[Some(1.0), None], &[Some(1.0), Some(1.0)]));
    }
}
