//! Laws of a model, on networks with random parameters.

use super::*;
use crate::neighbourhood::Neighbourhood;
use crate::network::tokens::tokens;
use crate::network::{Layout, PositionConfig};
use abbe_field::kriging::{Kernel, KrigingOptions, Noise, Trend, fitted as fit};
use abbe_field::{MeasuredField, POSITION};
use abbe_geometry::effects::{CovariateValue, NoCovariates};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Something done to the parts of a model.
type Change<'a> = &'a dyn Fn(&mut Parts);

/// A smooth field of some micrometres in a box of 0.5 m, with noise.
pub(crate) fn bent_field(count: usize, noise_m: f64, seed: u64) -> Samples {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let points: Vec<_> = (0..count).map(|_| Vector3::from_fn(|_, _| random.random::<f64>() * 0.5)).collect();
    let mut noise = || (random.random::<f64>() - 0.5) * noise_m * 12.0_f64.sqrt();
    let error =
        |p: &Vector3<f64>| Vector3::new((p.x * 9.0).sin(), (p.y * 7.0 + p.x * 5.0).cos(), p.z * p.z * 8.0) * 1e-6;
    let errors = points.iter().map(|p| error(p) + Vector3::from_fn(|_, _| noise())).collect();
    Samples::from(&MeasuredField::new(points, errors, None).unwrap())
}

/// The same with the temperature as a further input, on which the field depends.
fn warm_field(count: usize, seed: u64) -> Samples {
    let field = bent_field(count, 1e-7, seed);
    let temp_c = |k: usize| 18.0 + (k * 7 % 11) as f64 * 0.4;
    let names = POSITION.into_iter().chain(["temp_air_c"]).map(str::to_owned).collect();
    let at = (0..count).flat_map(|k| field.point(k).iter().copied().chain([temp_c(k)]).collect::<Vec<_>>()).collect();
    let errors_m = field.errors_m().iter().enumerate().map(|(k, e)| e * (temp_c(k) - 20.0)).collect();
    Samples::new(names, at, errors_m, None).unwrap()
}

/// Kriging of the field, there and here.
pub(crate) fn fitted(field: &Samples, kernel: Kernel) -> (abbe_field::Kriging, Kriging) {
    let options = KrigingOptions { kernel, trend: Trend::Constant, noise: Noise::Fitted };
    let reference = abbe_field::Kriging::fit(&field.field().unwrap().unwrap(), &options).unwrap();
    (reference, solved(field, kernel))
}

fn solved(field: &Samples, kernel: Kernel) -> Kriging {
    let fit = fit(field, &KrigingOptions { kernel, trend: Trend::Constant, noise: Noise::Fitted }).unwrap();
    Kriging::from_fit(&fit, kernel, field, &Vector3::repeat(1.0)).unwrap()
}

/// A model of some kind with three random members.
pub(crate) fn random_model(kind: ResidualMethod, seed: u64) -> ResidualModel {
    model_of(kind, seed, bent_field(70, 1e-7, seed), vec![1.0; 3])
}

/// The same with the temperature beside the position.
pub(crate) fn warm_model(kind: ResidualMethod, seed: u64) -> ResidualModel {
    model_of(kind, seed, warm_field(90, seed), vec![0.3, 0.3, 0.4, 6.0])
}

fn model_of(kind: ResidualMethod, seed: u64, field: Samples, scale: Vec<f64>) -> ResidualModel {
    let kriging = solved(&field, Kernel::Matern52);
    let config = NetworkConfig { width: 8, heads: 2, ..NetworkConfig::default() };
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let inputs = field.size();
    let mut member = || {
        let values = (0..Layout::new(8, inputs).len()).map(|_| random.random::<f32>() * 0.4 - 0.2).collect();
        Parameters::new(&config, inputs, values).unwrap()
    };
    let members = (0..3).map(|_| member()).collect();
    let normaliser =
        Normaliser { mean_m: Vector3::new(1e-7, 0.0, 3e-7), scale_m: Vector3::new(1e-6, 7e-7, 6e-7), spacing_m: 0.1 };
    let ensemble = kind.has_attention().then_some(Ensemble { config, normaliser, members });
    let calibration = Calibration { scale: Vector3::new(1.2, 1.0, 0.9) };
    let trend = kind.has_trend().then(|| random_trend(inputs, seed));
    ResidualModel::new(Parts { kind, field, scale, kriging, ensemble, trend, calibration }).unwrap()
}

/// Three random networks on the inputs.
fn random_trend(inputs: usize, seed: u64) -> PositionEnsemble {
    let config = PositionConfig { width: 5, blocks: 2 };
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut member = || (0..config.parameters(inputs)).map(|_| random.random::<f32>() - 0.5).collect();
    PositionEnsemble {
        members: (0..3).map(|_| member()).collect(),
        config,
        low: [0.0, 0.0, 0.0, 18.0][..inputs].to_vec(),
        high: [0.5, 0.5, 0.5, 22.0][..inputs].to_vec(),
        mean_m: Vector3::new(1e-7, 0.0, 3e-7),
        scale_m: Vector3::new(1e-6, 7e-7, 6e-7),
    }
}

/// A sample with one covariate.
struct Warm(CovariateValue);

impl CovariateSource for Warm {
    fn covariate(&self, name: &str) -> CovariateValue {
        if name == "temp_air_c" { self.0 } else { CovariateValue::Missing }
    }
}

#[test]
fn an_input_is_taken_by_its_name_and_never_made_up() {
    let at = Vector3::new(0.2, 0.3, 0.2);
    for kind in ResidualMethod::ALL {
        let model = warm_model(kind, 3);
        assert_eq!(model.covariates(), ["temp_air_c"]);
        let of = |value| model.at(&at, &Warm(value));
        let residual = |temp_c| model.predict(of(CovariateValue::Fresh(temp_c)).unwrap().as_slice()).residual_m;
        assert!((residual(19.0) - residual(21.0)).norm() > 1e-8, "{kind:?}");
        assert!(matches!(of(CovariateValue::Stale), Err(CovariateProblem::Stale(name)) if name == "temp_air_c"));
        for missing in [of(CovariateValue::Fresh(f64::NAN)), model.at(&at, &NoCovariates)] {
            assert!(matches!(missing, Err(CovariateProblem::Missing(name)) if name == "temp_air_c"));
        }
        assert!(model.unknown_m2().trace() > 1e-13);
        // As many numbers as inputs, or none.
        assert!(model.predict_apart(at.as_slice()).is_none());
    }
    assert!(random_model(ResidualMethod::Kriging, 1).covariates().is_empty());
}

#[test]
fn beyond_the_range_of_an_input_is_outside_as_beyond_the_points() {
    for kind in ResidualMethod::ALL {
        let model = warm_model(kind, 4);
        let at = |x: f64, temp_c: f64| model.predict(&[x, 0.25, 0.25, temp_c]);
        let inside = at(0.25, 20.0);
        assert!(inside.inside && at(0.25, 18.0).inside && at(0.25, 22.0).inside, "{kind:?}");
        for outside in [at(0.25, 17.9), at(0.25, 22.1), at(0.8, 20.0), at(0.25, 40.0)] {
            assert!(!outside.inside, "{kind:?}");
        }
        assert!(at(0.25, 40.0).covariance_m2.trace() > 2.0 * inside.covariance_m2.trace(), "{kind:?}");
    }
}

#[test]
fn each_kind_adds_up_to_what_it_says() {
    let [kriging, network, both, trend] = ResidualMethod::ALL.map(|kind| random_model(kind, 1));
    let at = Vector3::new(0.21, 0.33, 0.14);
    let residual = |model: &ResidualModel| model.predict(at.as_slice()).residual_m;
    assert!((residual(&kriging) - residual(&network)).norm() > 1e-8);
    assert!((residual(&both) - residual(&kriging)).norm() > 1e-9);
    // By hand: the mean of the printed networks on the tokens of this point.
    let ensemble = network.parts.ensemble.as_ref().unwrap();
    let field = &network.parts.field;
    let points: Vec<f64> = field.points().flatten().copied().collect();
    let vertices = Neighbourhood::new(3, field.points()).vertices(at.as_slice()).unwrap();
    let normalised: Vec<_> = network.parts.field.errors_m().iter().map(|e| ensemble.normaliser.normalise(e)).collect();
    let tokens = tokens(&ensemble.config, &ensemble.normaliser, at.as_slice(), &vertices, &points, &normalised);
    let forward = |member| crate::network::forward::forward(&ensemble.config, member, &tokens);
    let mean = ensemble.members.iter().map(forward).sum::<Vector3<f64>>() / 3.0;
    assert!((residual(&network) - ensemble.normaliser.restore(&mean)).norm() < 1e-11);
    let below = trend.trend.as_ref().unwrap().at(at.as_slice());
    assert!(below.norm() > 1e-8 && (residual(&trend) - residual(&kriging) - below).norm() < 1e-15);
}

#[test]
fn kriging_of_what_a_trend_leaves_brings_the_whole_back_to_the_measured_points() {
    let model = random_model(ResidualMethod::PerceptronKriging, 6);
    let mut parts = model.parts().clone();
    let left = crate::trend::Trend::new(random_trend(3, 6)).unwrap().left(&parts.field).unwrap();
    parts.kriging = fitted(&left, Kernel::Matern52).1;
    let model = ResidualModel::new(parts.clone()).unwrap();
    for (point, error) in parts.field.points().zip(parts.field.errors_m()) {
        // Noise of 0.1 µm is smoothed, the trend of some tenths of a micrometre does not show.
        assert!((model.predict(point).residual_m - error).norm() < 3e-7);
    }
}

#[test]
fn outside_the_calibrated_points_the_flag_falls_and_the_uncertainty_grows() {
    for kind in ResidualMethod::ALL {
        let model = random_model(kind, 2);
        let inside = model.predict(&[0.25; 3]);
        let outside = model.predict(&[0.7; 3]);
        assert!(inside.inside && !outside.inside, "{kind:?}");
        for axis in 0..3 {
            assert!(outside.covariance_m2[(axis, axis)] > 4.0 * inside.covariance_m2[(axis, axis)], "{kind:?} {axis}");
        }
        // Just beyond one face.
        assert!(!model.predict(&[0.25, 0.25, -0.02]).inside, "{kind:?}");
    }
}

#[test]
fn the_calibration_scales_the_deviation_and_nothing_else() {
    let model = random_model(ResidualMethod::KrigingNetwork, 3);
    let mut parts = model.parts().clone();
    parts.calibration = Calibration { scale: parts.calibration.scale * 2.0 };
    let at = [0.1, 0.2, 0.3];
    let (before, after) = (model.predict(&at), ResidualModel::new(parts).unwrap().predict(&at));
    assert_eq!(before.residual_m, after.residual_m);
    assert!((after.covariance_m2 - before.covariance_m2 * 4.0).norm() < 1e-24);
}

#[test]
fn a_point_that_is_no_number_or_has_none_has_no_residual() {
    let all = ResidualMethod::ALL.map(|kind| random_model(kind, 4));
    for (model, bad) in all.iter().flat_map(|model| [f64::NAN, f64::INFINITY, 1e305].map(|bad| (model, bad))) {
        let found = model.predict(&[0.1, bad, 0.1]);
        assert!(!found.inside && found.residual_m == Vector3::zeros() && found.covariance_m2[(1, 1)].is_infinite());
    }
}

#[test]
fn parts_that_do_not_fit_are_refused_by_name() {
    let parts = random_model(ResidualMethod::KrigingNetwork, 5).parts().clone();
    let refused = |change: &dyn Fn(&mut Parts)| {
        let mut changed = parts.clone();
        change(&mut changed);
        ResidualModel::new(changed).map(|_| ()).unwrap_err().to_string()
    };
    fn with_trend(change: fn(&mut PositionEnsemble)) -> Parts {
        let mut parts = random_model(ResidualMethod::PerceptronKriging, 5).parts().clone();
        parts.trend.iter_mut().for_each(change);
        parts
    }
    let scaled =
        |factor: f64| parts.field.with_errors(parts.field.errors_m().iter().map(|e| e * factor).collect()).unwrap();
    let in_mm = parts.field.places().iter().map(|p| p * 1000.0).collect();
    let in_mm = Samples::from(&MeasuredField::new(in_mm, parts.field.errors_m().to_vec(), None).unwrap());
    let cases: [(Change, &str); 17] = [
        (&|p| p.kind = ResidualMethod::Kriging, "has no use for networks on the neighbourhood"),
        (&|p| p.ensemble = None, "needs networks on the neighbourhood"),
        (&|p| p.trend = Some(random_trend(3, 1)), "has no use for networks on the position"),
        (&|p| (p.kind, p.ensemble) = (ResidualMethod::PerceptronKriging, None), "needs networks on the position"),
        (&|p| *p = with_trend(|t| t.members[1][3] = f32::NAN), "member 1: parameter 3 is not a finite number"),
        (&|p| *p = with_trend(|t| t.members[2].truncate(9)), "another layout"),
        (&|p| *p = with_trend(|t| t.high[1] = 0.0), "no extent"),
        (&|p| *p = with_trend(|t| t.scale_m.z = 0.0), "scale"),
        (&|p| p.kriging.components[1].weights_per_m.truncate(5), "5 kriging weights for 70"),
        (&|p| p.kriging.components[0].length[1] = -1.0, "length scale"),
        (&|p| p.kriging.components[2].trend_m = f64::NAN, "not a finite number"),
        (&|p| p.kriging.components[0].length.truncate(2), "2 scales for 3 inputs"),
        (&|p| p.scale[1] = 0.0, "scale of an input"),
        (&|p| p.calibration.scale.z = 0.0, "calibration"),
        (&|p| p.ensemble.iter_mut().for_each(|e| e.config.width = 12), "another layout"),
        (&|p| p.field = scaled(1e6), "residuals are in metres"),
        (&|p| p.field = in_mm.clone(), "points are in metres"),
    ];
    for (change, expected) in cases {
        let text = refused(change);
        assert!(text.contains(expected), "{text}");
    }
    assert!(refused(&|p| p.kriging.components[0].signal_m = 0.0).contains("signal"));
}
