//! What leaves the correcting function: a number with a covariance that holds, or a rejection.

use super::*;
use crate::effects::tests::{machine, shapes};
use crate::effects::{CovariateSource, CovariateValue, NoCovariates, REGISTRY, Shape};
use crate::model::{Difference, FitQuality, IdentifiedVolume, ModelParts, Station};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::sync::OnceLock;

/// Range in which every covariate of the test models was identified.
const USUAL: (f64, f64) = (0.0, 10.0);
const READING_M: [f64; 3] = [0.31, 0.22, 0.13];
const OFFSET_M: [f64; 3] = [0.1, 0.0, -0.06];
/// Offset about which the ram turns.
const CENTRE_M: [f64; 3] = [0.04, 0.05, -0.07];

/// A covariate by name.
pub(crate) struct By<F>(pub(crate) F);
impl<F: Fn(&str) -> CovariateValue> CovariateSource for By<F> {
    fn covariate(&self, name: &str) -> CovariateValue {
        (self.0)(name)
    }
}

/// A model with these effects, whose parameters are some thousandths of what is believable.
pub(crate) fn model(effects: &[(&str, Shape)]) -> MachineModel {
    let machine = machine();
    let (mut fitted, mut sizes, mut covariates) = (Vec::new(), Vec::new(), BTreeMap::new());
    for (name, shape) in effects {
        let effect = crate::effects::construct(name, shape, &machine).unwrap();
        let plausible: Vec<f64> = effect.parameters().iter().map(|spec| spec.plausible).collect();
        let parameters = plausible.iter().enumerate().map(|(k, p)| p * 2e-3 * (1.3 * k as f64 + 1.0).sin()).collect();
        sizes.extend(plausible.iter().map(|p| 2e-4 * p));
        covariates.extend(effect.covariates().into_iter().chain(effect.range_covariates()).map(|name| (name, USUAL)));
        fitted.push(MachineModel::fitted_effect(name, shape.clone(), &machine, parameters).unwrap());
    }
    let geometric = crate::layout::Layout::new(&machine, CENTRE_M).unwrap().len();
    let coefficients = (0..geometric).map(|k| 3e-6 * (1.7 * k as f64).sin()).collect();
    let deviations: Vec<f64> = vec![1e-7; geometric].into_iter().chain(sizes).chain([1e-6; 4]).collect();
    let packed = |row: usize| (0..=row).map(move |column| (row, column));
    let entry = |(a, b): (usize, usize)| if a == b { deviations[a].powi(2) } else { 0.0 };
    let parts = ModelParts {
        coefficients,
        offset_centre_m: CENTRE_M,
        effects: fitted,
        stations: vec![Station { name: "S1".to_owned(), position_m: Vector3::new(-0.4, 1.1, 0.2), dead_path_m: 0.3 }],
        covariance: (0..deviations.len()).flat_map(packed).map(entry).collect(),
        chord_covariance: Vec::new(),
        identified: IdentifiedVolume {
            reading_m: machine.stroke_m,
            offset_m: [(-0.15, 0.15); 3],
            covariates,
            differences: Vec::new(),
        },
        quality: FitQuality {
            readings: 1000,
            rejected: 0,
            chi2_per_dof: 1.0,
            residual_rms_m: 1e-7,
            unexplained_m: [0.0; 3],
            wanders: None,
            unseen_expansions: Default::default(),
        },
        machine,
    };
    MachineModel::new(parts).unwrap()
}

/// A model of every shape of every effect, and last one with an effect of each kind.
fn models() -> &'static [MachineModel] {
    static MODELS: OnceLock<Vec<MachineModel>> = OnceLock::new();
    MODELS.get_or_init(|| {
        let machine = machine();
        let all = REGISTRY.iter().map(|entry| (entry.name, shapes(entry, &machine)));
        let all: Vec<(&str, Vec<Shape>)> = all.collect();
        let each = all.iter().flat_map(|(name, shapes)| shapes.iter().map(|shape| model(&[(*name, shape.clone())])));
        let together: Vec<(&str, Shape)> = all.iter().map(|(name, shapes)| (*name, shapes[0].clone())).collect();
        each.chain([model(&together)]).collect()
    })
}

fn warm_up() -> MachineModel {
    model(&[("warm_up", Shape::new().number("tau_s", 2.0).number("stages", 1.0))])
}

pub(crate) fn at<'a>(covariates: &'a dyn CovariateSource) -> State<'a> {
    State { reading_m: READING_M, offset_m: OFFSET_M, covariates }
}

fn is_covariance(covariance_m2: &Matrix3<f64>) -> bool {
    let least = covariance_m2.symmetric_eigenvalues().min();
    covariance_m2.iter().all(|v| v.is_finite()) && least >= -1e-8 * covariance_m2.trace()
}

/// Any number at all, or one of the size that the quantity has.
fn figure(low: f64, high: f64) -> impl Strategy<Value = f64> {
    prop_oneof![3 => low..high, 1 => any::<f64>(), 1 => -1e4..1e4]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]

    #[test]
    fn regress_what_is_corrected_is_finite_whatever_the_sample(
        which in any::<prop::sample::Index>(),
        reading_m in [figure(-0.1, 0.9), figure(-0.1, 0.7), figure(-0.1, 0.7)],
        offset_m in [figure(-0.2, 0.2), figure(-0.2, 0.2), figure(-0.2, 0.2)],
        values in prop::collection::vec((0..6_u8, figure(USUAL.0, USUAL.1)), 5),
    ) {
        let model = which.get(models());
        let covariates = By(|name: &str| match values[name.len() % values.len()] {
            (0, _) => CovariateValue::Missing,
            (1, _) => CovariateValue::Stale,
            (_, value) => CovariateValue::Fresh(value),
        });
        let correction = correct(model, &State { reading_m, offset_m, covariates: &covariates });
        match correction.covariance_m2 {
            None => prop_assert_eq!(correction.status, Status::Rejected),
            Some(covariance_m2) => {
                prop_assert!(correction.status != Status::Rejected);
                prop_assert!(correction.position_m.iter().all(|v| v.is_finite()), "{correction:?}");
                prop_assert!(is_covariance(&covariance_m2), "{correction:?}");
            }
        }
    }
}

#[test]
fn regress_a_warm_up_long_before_its_campaign_is_rejected() {
    let model = warm_up();
    let status = |time_s: f64| correct(&model, &at(&By(|_: &str| CovariateValue::Fresh(time_s)))).status;
    assert_eq!([status(5.0), status(10.0)], [Status::InVolume; 2]);
    // Before the campaign the law grows without bound; long after it, it stands still.
    assert_eq!([-3e6, -3e3, -50.0].map(status), [Status::Rejected; 3]);
    assert_eq!([-0.1, 11.0, 3e6].map(status), [Status::Extrapolated; 3]);
}

#[test]
fn regress_offsets_that_no_holder_has_are_rejected() {
    let model = model(&[]);
    let status = |x_m: f64| correct(&model, &State { offset_m: [x_m, 0.0, -0.06], ..at(&NoCovariates) }).status;
    assert_eq!(status(0.15), Status::InVolume);
    assert_eq!([0.16, -0.5, 1.1].map(status), [Status::Extrapolated; 3]);
    // A metre beyond what was identified; 60 mm taken for 60 m; what overflows.
    assert_eq!([1.2, -60.0, 1e308, f64::INFINITY].map(status), [Status::Rejected; 4]);
}

#[test]
fn regress_a_sensor_that_is_broken_does_not_correct() {
    let shape = Shape::new().text("axis", "x").text("sensor", "temp_scale_x_c");
    let model = model(&[("scale_expansion", shape)]);
    let of = |value: f64| correct(&model, &at(&By(|_: &str| CovariateValue::Fresh(value))));
    let u_m = |correction: Correction| correction.covariance_m2.unwrap()[(0, 0)].sqrt();
    let (inside, outside) = (of(10.0), of(20.0));
    assert_eq!((inside.status, outside.status), (Status::InVolume, Status::Extrapolated));
    // One range beyond its end: what the law adds there, and as much again for what it may hide.
    let added_m = (outside.effects_m - inside.effects_m).norm();
    assert!(added_m > 1e-7 && u_m(outside) > 1.3 * added_m, "{added_m} {}", u_m(outside));
    assert_eq!([1e6, -1e6, f64::MAX].map(|value| of(value).status), [Status::Rejected; 3]);
    assert_eq!(of(f64::NAN).status, Status::CovariateMissing);
}

/// A model without effects said `in_volume` at any temperature, then up to as far again as the range was wide: yaw by the square of a
/// temperature was 6 µm off there, at a U of 2. What was not seen over a range of 2 K is not known 2 K beyond it.
#[test]
fn regress_a_logged_covariate_that_no_effect_reads_bounds_what_the_campaign_speaks_for() {
    let mut parts = model(&[]).parts().clone();
    let name = "temp_scale_x_c";
    parts.identified.covariates = BTreeMap::from([(name.to_owned(), (20.0, 22.0))]);
    let model = MachineModel::new(parts.clone()).unwrap();
    let of = |value_c: f64| {
        let logged =
            By(|asked: &str| if asked == name { CovariateValue::Fresh(value_c) } else { CovariateValue::Missing });
        correct(&model, &at(&logged))
    };
    let inside = [19.0, 20.0, 22.0, 23.0].map(|value_c| of(value_c).status);
    let outside = [18.9, 23.1, 40.0].map(|value_c| of(value_c).status);
    assert_eq!((inside, outside), ([Status::InVolume; 4], [Status::Extrapolated; 3]));
    assert_eq!(of(40.0).position_m, of(20.0).position_m);
    // Nothing needs it: a sample without it is corrected as ever.
    assert_eq!(correct(&model, &at(&NoCovariates)).status, Status::InVolume);
    assert_eq!(model.covariate_range(name), Some((19.0, 23.0)));
    // One value all the time speaks for that value.
    parts.identified.covariates.insert(name.to_owned(), (20.0, 20.0));
    // Of the other kinds, an air pressure moves no machine, and a probe's number is no quantity.
    parts.identified.covariates.insert("pressure_hpa".to_owned(), (1010.0, 1010.0));
    parts.identified.covariates.insert("probe_id".to_owned(), (3.0, 3.0));
    let constant = MachineModel::new(parts).unwrap();
    let all = |value: f64| By(move |_: &str| CovariateValue::Fresh(value));
    let statuses = [20.15, 20.25].map(|value_c| correct(&constant, &at(&all(value_c))).status);
    assert_eq!(statuses, [Status::InVolume, Status::Extrapolated]);
}

/// What nobody explained may be a law of a temperature: where it goes on beyond the campaign, so does that, straight on from the middle.
#[test]
fn regress_what_is_unexplained_grows_beyond_the_temperatures_of_the_campaign() {
    let mut parts = model(&[]).parts().clone();
    let name = "temp_air_c";
    parts.quality.unexplained_m = [1e-6, 2e-6, 0.0];
    parts.identified.covariates = BTreeMap::from([(name.to_owned(), (18.0, 22.0))]);
    let of = |parts: &ModelParts, value: CovariateValue| {
        let model = MachineModel::new(parts.clone()).unwrap();
        correct(&model, &at(&By(|asked: &str| if asked == name { value } else { CovariateValue::Missing })))
    };
    let added_m2 = |parts: &ModelParts, value: f64| {
        let covariance_m2 = |value| of(parts, value).covariance_m2.unwrap();
        (covariance_m2(CovariateValue::Fresh(value)) - covariance_m2(CovariateValue::Missing)).diagonal()
    };
    // Half a width beyond, twice as far from the middle as the end is: twice as much.
    for value_c in [16.0, 24.0] {
        let added = added_m2(&parts, value_c) - Vector3::new(3e-12, 12e-12, 0.0);
        assert!(added.norm() < 1e-18, "{added}");
    }
    assert!(added_m2(&parts, 21.9).norm() < 1e-24, "inside it is what it was");
    let (far, farther) = (added_m2(&parts, 26.0), added_m2(&parts, 40.0));
    assert!((far - farther).norm() < 1e-24 && (far.x / 8e-12 - 1.0).abs() < 1e-6, "{far} {farther}");
    let broken = of(&parts, CovariateValue::Fresh(-999.0)).status;
    assert_eq!(broken, Status::Rejected, "a temperature that is none, though no effect reads it");
    // A room that stood still shows no law.
    parts.identified.covariates.insert(name.to_owned(), (20.0, 20.1));
    assert!(added_m2(&parts, 25.0).norm() < 1e-24);
}

/// Between the readings that bound a step, half of it is corrected, and U (k = 2) is the whole: it holds 0 and the step alike.
#[test]
fn a_coordinate_between_the_readings_that_bound_a_step_is_as_uncertain_as_the_step() {
    let shape = Shape::new().text("axis", "x").number("from_m", 0.3).number("to_m", 0.4);
    let mut parts = model(&[("scale_step", shape)]).parts().clone();
    parts.effects[0].parameters = vec![6e-6];
    let model = MachineModel::new(parts).unwrap();
    let of = |x_m: f64| correct(&model, &State { reading_m: [x_m, 0.2, 0.1], ..at(&NoCovariates) });
    for (x_m, passed) in [(0.2, 0.0), (0.3, 0.0), (0.35, 0.5), (0.39, 0.9), (0.4, 1.0), (0.7, 1.0)] {
        let here = of(x_m);
        assert!((here.effects_m.x - 6e-6 * passed).abs() < 1e-10, "{x_m}: {}", here.effects_m.x);
        let parameter_m2 = (2e-4 * 200e-6_f64).powi(2);
        let open_m2 = (36e-12 + parameter_m2) * passed * (1.0 - passed);
        // Beside it stand what the parameter and the geometry leave open; the latter as without a step.
        let beside_m2 = here.covariance_m2.unwrap()[(0, 0)] - open_m2 - parameter_m2 * passed * passed;
        assert!(beside_m2 > 0.0 && beside_m2 < 1e-12, "{x_m}: {beside_m2:e}");
        assert_eq!(here.status, Status::InVolume);
    }
    let u_m = |x_m: f64| 2.0 * of(x_m).covariance_m2.unwrap()[(0, 0)].sqrt();
    assert!(u_m(0.35) > 6e-6 && u_m(0.35) < 7e-6 && u_m(0.29) < 2e-6, "{} {}", u_m(0.35), u_m(0.29));
}

/// Two sensors agreed in the campaign: which of them the effect follows nobody knows, and it shows where they part.
#[test]
fn regress_sensors_that_part_as_never_in_the_campaign_widen_the_covariance() {
    let (own, other) = ("temp_scale_x_c", "temp_air_c");
    let mut parts = model(&[("scale_expansion", Shape::new().text("axis", "x").text("sensor", own))]).parts().clone();
    let (expands, shift) = (parts.effects[0].parameters[0], parts.effects[0].parameters[1]);
    parts.identified.covariates = [own, other].into_iter().map(|name| (name.to_owned(), (18.0, 24.0))).collect();
    let difference = Difference { name: own.to_owned(), less: other.to_owned(), range: (-0.1, 0.1) };
    parts.identified.differences = vec![difference];
    let model = MachineModel::new(parts).unwrap();
    let of = |own_c: f64, other_c: f64| {
        let logged = By(|name: &str| CovariateValue::Fresh(if name == own { own_c } else { other_c }));
        correct(&model, &at(&logged))
    };
    let (together, near, parted, broken) = (of(22.0, 22.0), of(22.0, 21.75), of(22.0, 20.0), of(22.0, -999.0));
    let statuses = [together, near, parted, broken].map(|correction| correction.status);
    assert_eq!(statuses, [Status::InVolume, Status::InVolume, Status::Extrapolated, Status::Rejected]);
    let variance_m2 = |correction: &Correction| correction.covariance_m2.unwrap()[(0, 0)];
    // All but 0.1 K of the difference was never seen.
    let unseen_m = |unseen_k: f64| (expands * READING_M[0] + shift) * unseen_k;
    for (correction, unseen_k) in [(near, 0.15), (parted, 1.9)] {
        let added_m2 = variance_m2(&correction) - variance_m2(&together);
        assert!((added_m2 / unseen_m(unseen_k).powi(2) - 1.0).abs() < 1e-6, "{added_m2:e}");
        assert_eq!(correction.position_m, together.position_m);
    }
}

/// -999 of a broken sensor was corrected by, with an error of 0.9 mm.
#[test]
fn regress_a_temperature_that_is_none_is_rejected() {
    let shape = Shape::new().text("axis", "x").text("sensor", "temp_scale_x_c");
    let mut parts = model(&[("scale_expansion", shape)]).parts().clone();
    parts.effects[0].parameters = vec![8e-6, 0.0];
    parts.identified.covariates = BTreeMap::from([("temp_scale_x_c".to_owned(), (19.0, 21.0))]);
    let model = MachineModel::new(parts).unwrap();
    let near_zero = |value_c: f64| {
        let logged = By(|_: &str| CovariateValue::Fresh(value_c));
        correct(&model, &State { reading_m: [0.01, 0.2, 0.1], ..at(&logged) }).status
    };
    assert_eq!([-999.0, 293.15, 35.0].map(near_zero), [Status::Rejected, Status::Rejected, Status::Extrapolated]);
}

/// Whatever the covariates are over their range: what was left out stays within the covariance stated without them.
#[test]
fn regress_an_effect_that_is_left_out_widens_the_covariance_by_all_that_it_does() {
    for model in models() {
        let asked: Vec<String> = model.parts().effects.iter().flat_map(|fitted| fitted.effect.covariates()).collect();
        let without = correct(model, &at(&NoCovariates));
        if asked.is_empty() {
            assert_eq!(without.status, Status::InVolume);
            continue;
        }
        assert_eq!(without.status, Status::CovariateMissing);
        let inverse = without.covariance_m2.unwrap().try_inverse().unwrap();
        let mut most = 0.0_f64;
        for k in 0..50_usize {
            let value = |name: &str| USUAL.1 * (k as f64 * 0.37 * (1.0 + 0.1 * name.len() as f64)).fract();
            let with = correct(model, &at(&By(|name: &str| CovariateValue::Fresh(value(name)))));
            assert_eq!(with.status, Status::InVolume);
            let moved_m = with.position_m - without.position_m;
            most = most.max(moved_m.dot(&(inverse * moved_m)));
        }
        // Between the places of the grid a curved law may stand a little higher than at them. Several effects left out add
        // up as independent ones.
        let count = model.parts().effects.len() as f64;
        assert!(most < 1.1 * count, "{asked:?}: {most}");
    }
}

/// What one sensor lacks takes nothing from what is known of another: a broken one is refused, and beyond its range it counts.
#[test]
fn regress_a_missing_covariate_hides_no_broken_one_beside_it() {
    let shape = Shape::new().text("axis", "x").text("toward", "y").text("form", "beam");
    let mut parts =
        model(&[("column_bow", shape.text("warm", "temp_warm_c").text("cold", "temp_cold_c"))]).parts().clone();
    parts.effects[0].parameters.fill(3e-6);
    parts.identified.covariates = ["temp_warm_c", "temp_cold_c"].map(|name| (name.to_owned(), (20.0, 21.0))).into();
    let model = MachineModel::new(parts).unwrap();
    let with_warm = |warm_c: f64| {
        let of = move |name: &str| match name {
            "temp_warm_c" => CovariateValue::Fresh(warm_c),
            _ => CovariateValue::Missing,
        };
        correct(&model, &State { reading_m: [0.5, 0.2, 0.1], ..at(&By(of)) })
    };
    assert_eq!(with_warm(-999.0).status, Status::Rejected);
    let (inside, outside) = (with_warm(20.5), with_warm(24.0));
    assert_eq!((inside.status, outside.status), (Status::CovariateMissing, Status::CovariateMissing));
    let added_m = outside.effects_m - inside.effects_m;
    let widened_m2 = outside.covariance_m2.unwrap().trace() - inside.covariance_m2.unwrap().trace();
    assert!(added_m.norm() > 1e-7 && widened_m2 > 0.5 * added_m.norm_squared(), "{added_m} {widened_m2:e}");
}

#[test]
fn regress_an_effect_beyond_the_identified_readings_counts_as_uncertain_by_what_it_adds() {
    let shape = Shape::new().text("axis", "x").text("over", "x").number("terms", 5.0);
    let mut parts = model(&[("reversal", shape)]).parts().clone();
    parts.covariance.fill(0.0);
    let certain = MachineModel::new(parts).unwrap();
    let played = By(|_: &str| CovariateValue::Fresh(1.0));
    let of = |x_m: f64| correct(&certain, &State { reading_m: [x_m, 0.2, 0.1], ..at(&played) });
    let (end, beyond) = (of(0.8), of(0.95));
    assert_eq!((end.status, beyond.status), (Status::InVolume, Status::Extrapolated));
    let added_m = (beyond.effects_m - end.effects_m).norm();
    let variance_m2 = |correction: Correction| correction.covariance_m2.unwrap().trace();
    let widened_m2 = variance_m2(beyond) - variance_m2(end);
    assert!(added_m > 1e-7 && (widened_m2 / added_m.powi(2) - 1.0).abs() < 1e-3, "{added_m} {widened_m2}");
}

/// Nobody knows what a misfit does elsewhere; it was left out of every stated uncertainty.
#[test]
fn regress_what_the_fit_could_not_explain_stands_in_every_corrected_coordinate() {
    let mut parts = model(&[]).parts().clone();
    let covariance = |parts: &ModelParts| {
        let model = MachineModel::new(parts.clone()).unwrap();
        correct(&model, &at(&NoCovariates)).covariance_m2.unwrap()
    };
    let plain = covariance(&parts);
    // Residuals of 1 µm, four times the variance declared, from 1000 readings: chance explains 0.09 of the excess of 3.
    let unexplained_m = FitQuality::unexplained_of(4.0, 1000.0 * 1e-12, 1000.0);
    parts.quality.unexplained_m = [unexplained_m, 0.0, 2.0 * unexplained_m];
    let widened = covariance(&parts) - plain;
    let expected_m2 = (3.0 - 2.0 * 0.002_f64.sqrt()) / 4.0 * 1e-12;
    let expected_m2 = Matrix3::from_diagonal(&Vector3::new(expected_m2, 0.0, 4.0 * expected_m2));
    assert!((widened - expected_m2).norm() < 1e-6 * expected_m2.norm(), "{widened}");
    assert_eq!(FitQuality::unexplained_of(1.08, 1e-9, 1000.0), 0.0, "chance");
    assert_eq!(FitQuality::unexplained_of(0.3, 1e-9, 1000.0), 0.0, "luck narrows nothing");
}

#[test]
fn what_no_range_bounds_is_not_left_out_in_silence() {
    let mut parts = warm_up().parts().clone();
    parts.identified.covariates.clear();
    let unbounded = MachineModel::new(parts.clone()).unwrap();
    assert_eq!(correct(&unbounded, &at(&NoCovariates)).status, Status::Rejected);
    let fresh = By(|_: &str| CovariateValue::Fresh(5.0));
    assert_eq!(correct(&unbounded, &at(&fresh)).status, Status::Extrapolated);
    for range in [(1.0, 0.0), (0.0, f64::NAN), (f64::INFINITY, f64::NEG_INFINITY)] {
        parts.identified.covariates.insert("time_s".to_owned(), range);
        assert!(MachineModel::new(parts.clone()).is_err(), "{range:?}");
    }
}

#[test]
fn regress_a_model_without_a_covariance_is_refused_and_one_that_overflows_rejects() {
    let mut parts = model(&[]).parts().clone();
    parts.covariance[0] = -1e-18;
    assert!(MachineModel::new(parts.clone()).unwrap_err().to_string().contains("variance"));
    parts.covariance[0] = f64::MAX;
    parts.coefficients[0] = f64::MAX;
    let overflowing = MachineModel::new(parts).unwrap();
    assert_eq!(correct(&overflowing, &at(&NoCovariates)).status, Status::Rejected);
}

#[test]
fn a_correction_takes_no_memory() {
    let (all, each) = models().split_last().unwrap();
    let inside = By(|_: &str| CovariateValue::Fresh(5.0));
    for model in each.iter().chain([&model(&[])]) {
        let counted = allocation_counter::measure(|| {
            std::hint::black_box(correct(model, &at(&inside)));
        });
        let effects: Vec<_> = model.parts().effects.iter().map(|fitted| &fitted.shape).collect();
        assert_eq!(correct(model, &at(&inside)).status, Status::InVolume, "{effects:?}");
        assert_eq!(counted.count_total, 0, "{effects:?}");
    }
    // With one effect of each kind at once there is more to hold than a sample has room for.
    assert!(all.parts().effects.len() > 10);
}

#[test]
fn the_covariance_is_that_of_the_plain_sum_over_all_pairs_of_parameters() {
    for model in models() {
        let (plain, count) = (model.clone(), model.parts().covariance.len());
        let mut parts = plain.parts().clone();
        // Full, and diagonally dominant.
        let order = ((8 * count + 1) as f64).sqrt() as usize / 2;
        let largest = |k: usize| parts.covariance[k * (k + 3) / 2].sqrt();
        let cell = |row: usize, column: usize| match row == column {
            true => largest(row).powi(2),
            false => {
                0.5 / order as f64 * largest(row) * largest(column) * (1.9 * row as f64 + 0.7 * column as f64).sin()
            }
        };
        let covariance = (0..order).flat_map(|row| (0..=row).map(move |column| (row, column)));
        parts.covariance = covariance.map(|(row, column)| cell(row, column)).collect();
        let model = MachineModel::new(parts).unwrap();
        let inside = By(|_: &str| CovariateValue::Fresh(5.0));
        let mut sensitivity = Sensitivity::default();
        corrected(&model, &at(&inside), &mut sensitivity).unwrap();
        let covariance_m2 = sensitivity.covariance_m2(&model);
        for direction in [Vector3::x(), Vector3::y(), Vector3::z(), Vector3::new(0.6, -0.48, 0.64)] {
            let plain_m2 = model.variance(&sensitivity.along(&direction));
            let found_m2 = direction.dot(&(covariance_m2 * direction));
            assert!((found_m2 - plain_m2).abs() < 1e-12 * plain_m2, "{found_m2} {plain_m2}");
        }
    }
}
