//! The mean of models against the means of what they say.

use super::*;
use crate::correct::correct;
use crate::correct::tests::{By, at, model};
use crate::effects::{CovariateValue, Shape};
use crate::unseen_expansion::UnseenExpansions;
use nalgebra::{Matrix3, Vector3};

/// Range of a test covariate, by which the two models of [`two`] differ.
const NAMES: [&str; 2] = ["temp_scale_x_c", "temp_scale_y_c"];

fn two() -> [MachineModel; 2] {
    NAMES.map(|name| {
        let axis = if name == NAMES[0] { "x" } else { "y" };
        model(&[("scale_expansion", Shape::new().text("axis", axis).text("sensor", name))])
    })
}

fn logged(values: [f64; 2]) -> By<impl Fn(&str) -> CovariateValue> {
    By(move |name: &str| {
        let at = NAMES.iter().position(|known| *known == name);
        at.map_or(CovariateValue::Missing, |k| CovariateValue::Fresh(values[k]))
    })
}

/// Covariance and position are those of the mixture, evaluated with every model apart.
#[test]
fn a_mean_of_models_corrects_to_the_mean_of_what_they_say() {
    let models = two();
    let mean = mixture(&[(3.0, &models[0]), (1.0, &models[1])]).unwrap();
    assert_eq!(mean.parts().effects.len(), 2);
    for values in [[4.0, 4.0], [0.0, 9.0], [8.0, 1.0]] {
        let logged = logged(values);
        let of = |model: &MachineModel| correct(model, &at(&logged));
        let (each, all) = ([of(&models[0]), of(&models[1])], of(&mean));
        let position_m: Vector3<f64> = each[0].position_m * 0.75 + each[1].position_m * 0.25;
        // Products of angles are not linear: some 1e-12 m.
        assert!((all.position_m - position_m).norm() < 1e-11, "{:e}", (all.position_m - position_m).norm());
        let mixed: Matrix3<f64> = [0.75, 0.25]
            .into_iter()
            .zip(each)
            .map(|(weight, one)| {
                let off_m = one.position_m - position_m;
                (one.covariance_m2.unwrap() + off_m * off_m.transpose()) * weight
            })
            .sum();
        let differs = (all.covariance_m2.unwrap() - mixed).norm() / mixed.norm();
        assert!(differs < 1e-6, "{differs:e}");
    }
}

/// What a term moves, and a share of what is not known of it, widen a coordinate where the term acts; the coordinate stays.
#[test]
fn a_term_beside_a_model_widens_and_moves_nothing() {
    let [one, other] = two();
    let without = one.without(|_| true).unwrap();
    let with = other;
    let beside = beside(&one, (&without, &with), 0.5).unwrap();
    // What a coordinate is uncertain by beside the parameters, such as the repeatability of the machine.
    let known = ModelParts { covariance: vec![0.0; with.parts().covariance.len()], ..with.parts().clone() };
    let known = MachineModel::new(known).unwrap();
    assert_eq!(beside.parts().effects.len(), 2);
    for values in [[4.0, 4.0], [0.0, 9.0], [8.0, 1.0]] {
        let logged = logged(values);
        let of = |model: &MachineModel| correct(model, &at(&logged));
        let (own, all) = (of(&one), of(&beside));
        assert!((all.position_m - own.position_m).norm() < 1e-12);
        let moved_m = of(&with).position_m - of(&without).position_m;
        let of_parameters = of(&with).covariance_m2.unwrap() - of(&known).covariance_m2.unwrap();
        let expected = own.covariance_m2.unwrap() + moved_m * moved_m.transpose() + of_parameters * 0.5;
        let differs = (all.covariance_m2.unwrap() - expected).norm() / expected.norm();
        assert!(differs < 1e-6, "{differs:e}");
    }
}

#[test]
fn a_mean_of_one_model_is_that_model() {
    let [one, _] = two();
    let mean = mixture(&[(0.3, &one)]).unwrap();
    let (a, b) = (mean.parts(), one.parts());
    assert_eq!((&a.coefficients, &a.covariance, &a.stations), (&b.coefficients, &b.covariance, &b.stations));
    assert_eq!(a.effects[0].parameters, b.effects[0].parameters);
}

#[test]
fn models_that_do_not_belong_together_have_no_mean() {
    let [one, other] = two();
    let mut parts = other.parts().clone();
    parts.stations[0].name = "another".to_owned();
    let elsewhere = MachineModel::new(parts).unwrap();
    let mut parts = other.parts().clone();
    parts.machine.stroke_m[0].1 *= 2.0;
    let larger = MachineModel::new(parts).unwrap();
    for (models, what) in [
        (vec![], "weights"),
        (vec![(0.0, &one), (0.0, &other)], "weights"),
        (vec![(f64::NAN, &one)], "weights"),
        (vec![(2.0, &one), (-1.0, &other)], "weights"),
        (vec![(1.0, &one), (1.0, &elsewhere)], "campaigns"),
        (vec![(1.0, &one), (1.0, &larger)], "machines"),
    ] {
        assert_eq!(mixture(&models).unwrap_err(), ModelError::Mixture { what });
    }
}

/// What a fit takes of expansions that nobody saw belongs to its parameters, wherever these stand in another model.
#[test]
fn what_a_fit_absorbed_goes_with_its_parameters() {
    let [one, other] = two();
    let total = one.machine_parameters() + 4 * one.parts().stations.len();
    let absorbed: Vec<f64> = (0..total).map(|k| 1e-8 * (k + 1) as f64).collect();
    let unseen = UnseenExpansions { by_sensor: Vec::new(), absorbed: vec![absorbed.clone()] };
    let told = one.with_unseen_expansions(unseen).unwrap();
    let values = By(|_: &str| CovariateValue::Fresh(4.0));
    let widened_m2 =
        correct(&told, &at(&values)).covariance_m2.unwrap() - correct(&one, &at(&values)).covariance_m2.unwrap();
    let partials = crate::correct::partials(&one, &at(&values)).unwrap();
    let moved_m = partials.map(|along| along.into_iter().map(|(place, factor)| factor * absorbed[place]).sum::<f64>());
    let moved_m = Vector3::from(moved_m);
    assert!((widened_m2 - moved_m * moved_m.transpose()).norm() < 1e-9 * moved_m.norm_squared());
    let both = mixture(&[(1.0, &told), (0.0, &other)]).unwrap();
    let left = both.without(|fitted| fitted.shape == other.parts().effects[0].shape).unwrap();
    assert_eq!(left.parts().quality.unseen_expansions, told.parts().quality.unseen_expansions);
    let damaged = UnseenExpansions { by_sensor: Vec::new(), absorbed: vec![vec![0.0; total - 1]] };
    assert!(one.with_unseen_expansions(damaged).unwrap_err().to_string().contains("expansions absorbed"));
}

/// What is taken out of a mean of two, one of which has no share, leaves the other.
#[test]
fn an_effect_taken_out_of_a_model_leaves_all_else_as_it_was() {
    let [one, other] = two();
    let both = mixture(&[(1.0, &one), (0.0, &other)]).unwrap();
    let left = both.without(|fitted| fitted.shape == other.parts().effects[0].shape).unwrap();
    let (a, b) = (left.parts(), one.parts());
    assert_eq!((&a.coefficients, &a.covariance, &a.stations), (&b.coefficients, &b.covariance, &b.stations));
    assert_eq!((a.effects.len(), &a.effects[0].shape), (1, &b.effects[0].shape));
}
