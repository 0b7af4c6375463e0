//! Laws of a model, on networks with random parameters.

use super::*;
use crate::neighbourhood::Neighbourhood;
use crate::network::tokens::tokens;
use crate::network::{Layout, PositionConfig};
use abbe_field::kriging::{Kernel, Noise, Options, Trend};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Something done to the parts of a model.
type Change<'a> = &'a dyn Fn(&mut Parts);

/// A smooth field of some micrometres in a box of 0.5 m, with noise.
pub(crate) fn bent_field(count: usize, noise_m: f64, seed: u64) -> MeasuredField {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let points: Vec<_> = (0..count).map(|_| Vector3::from_fn(|_, _| random.random::<f64>() * 0.5)).collect();
    let mut noise = || (random.random::<f64>() - 0.5) * noise_m * 12.0_f64.sqrt();
    let error =
        |p: &Vector3<f64>| Vector3::new((p.x * 9.0).sin(), (p.y * 7.0 + p.x * 5.0).cos(), p.z * p.z * 8.0) * 1e-6;
    let errors = points.iter().map(|p| error(p) + Vector3::from_fn(|_, _| noise())).collect();
    MeasuredField::new(points, errors, None).unwrap()
}

/// Kriging of the field, there and here.
pub(crate) fn fitted(field: &MeasuredField, kernel: Kernel) -> (abbe_field::Kriging, Kriging) {
    let options = Options { kernel, trend: Trend::Constant, noise: Noise::Fitted };
    let reference = abbe_field::Kriging::fit(field, &options).unwrap();
    let kriging = Kriging::from_fit(&reference, kernel, field, &Vector3::repeat(1.0)).unwrap();
    (reference, kriging)
}

/// A model of some kind with three random members.
pub(crate) fn random_model(kind: Kind, seed: u64) -> ResidualModel {
    let field = bent_field(70, 1e-7, seed);
    let (_, kriging) = fitted(&field, Kernel::Matern52);
    let config = NetworkConfig { width: 8, heads: 2, ..NetworkConfig::default() };
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut member = || {
        let values = (0..Layout::new(8).len()).map(|_| random.random::<f32>() * 0.4 - 0.2).collect();
        Parameters::new(&config, values).unwrap()
    };
    let members = (0..3).map(|_| member()).collect();
    let normaliser =
        Normaliser { mean_m: Vector3::new(1e-7, 0.0, 3e-7), scale_m: Vector3::new(1e-6, 7e-7, 6e-7), spacing_m: 0.1 };
    let ensemble = kind.has_attention().then_some(Ensemble { config, normaliser, members });
    let calibration = Calibration { scale: Vector3::new(1.2, 1.0, 0.9) };
    let trend = kind.has_trend().then(|| random_trend(seed));
    ResidualModel::new(Parts { kind, field, kriging, ensemble, trend, calibration }).unwrap()
}

/// Three random networks on the position.
fn random_trend(seed: u64) -> PositionEnsemble {
    let config = PositionConfig { width: 5, blocks: 2 };
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut member = || (0..config.parameters()).map(|_| random.random::<f32>() - 0.5).collect();
    PositionEnsemble {
        members: (0..3).map(|_| member()).collect(),
        config,
        low_m: Vector3::zeros(),
        high_m: Vector3::repeat(0.5),
        mean_m: Vector3::new(1e-7, 0.0, 3e-7),
        scale_m: Vector3::new(1e-6, 7e-7, 6e-7),
    }
}

#[test]
fn each_kind_adds_up_to_what_it_says() {
    let [kriging, network, both, trend] = Kind::ALL.map(|kind| random_model(kind, 1));
    let at = Vector3::new(0.21, 0.33, 0.14);
    let residual = |model: &ResidualModel| model.predict(&at).residual_m;
    assert!((residual(&kriging) - residual(&network)).norm() > 1e-8);
    assert!((residual(&both) - residual(&kriging)).norm() > 1e-9);
    // By hand: the mean of the printed networks on the tokens of this point.
    let ensemble = network.parts.ensemble.as_ref().unwrap();
    let points = network.parts.field.points_m();
    let vertices = Neighbourhood::new(points).vertices(&at).unwrap();
    let normalised: Vec<_> = network.parts.field.errors_m().iter().map(|e| ensemble.normaliser.normalise(e)).collect();
    let tokens = tokens(&ensemble.config, &ensemble.normaliser, &at, &vertices, points, &normalised);
    let forward = |member| crate::network::forward::forward(&ensemble.config, member, &tokens);
    let mean = ensemble.members.iter().map(forward).sum::<Vector3<f64>>() / 3.0;
    assert!((residual(&network) - ensemble.normaliser.restore(&mean)).norm() < 1e-11);
    let below = trend.trend.as_ref().unwrap().at(&at);
    assert!(below.norm() > 1e-8 && (residual(&trend) - residual(&kriging) - below).norm() < 1e-15);
}

#[test]
fn kriging_of_what_a_trend_leaves_brings_the_whole_back_to_the_measured_points() {
    let model = random_model(Kind::PerceptronKriging, 6);
    let mut parts = model.parts().clone();
    let left = crate::trend::Trend::new(random_trend(6)).unwrap().left(&parts.field).unwrap();
    parts.kriging = fitted(&left, Kernel::Matern52).1;
    let model = ResidualModel::new(parts.clone()).unwrap();
    for (point, error) in parts.field.points_m().iter().zip(parts.field.errors_m()) {
        // Noise of 0.1 µm is smoothed, the trend of some tenths of a micrometre does not show.
        assert!((model.predict(point).residual_m - error).norm() < 3e-7);
    }
}

#[test]
fn outside_the_calibrated_points_the_flag_falls_and_the_uncertainty_grows() {
    for kind in Kind::ALL {
        let model = random_model(kind, 2);
        let inside = model.predict(&Vector3::repeat(0.25));
        let outside = model.predict(&Vector3::repeat(0.7));
        assert!(inside.inside && !outside.inside, "{kind:?}");
        for axis in 0..3 {
            assert!(outside.covariance_m2[(axis, axis)] > 4.0 * inside.covariance_m2[(axis, axis)], "{kind:?} {axis}");
        }
        // Just beyond one face.
        assert!(!model.predict(&Vector3::new(0.25, 0.25, -0.02)).inside, "{kind:?}");
    }
}

#[test]
fn the_calibration_scales_the_deviation_and_nothing_else() {
    let model = random_model(Kind::KrigingNetwork, 3);
    let mut parts = model.parts().clone();
    parts.calibration = Calibration { scale: parts.calibration.scale * 2.0 };
    let at = Vector3::new(0.1, 0.2, 0.3);
    let (before, after) = (model.predict(&at), ResidualModel::new(parts).unwrap().predict(&at));
    assert_eq!(before.residual_m, after.residual_m);
    assert!((after.covariance_m2 - before.covariance_m2 * 4.0).norm() < 1e-24);
}

#[test]
fn a_point_that_is_no_number_or_has_none_has_no_residual() {
    let all = Kind::ALL.map(|kind| random_model(kind, 4));
    for (model, bad) in all.iter().flat_map(|model| [f64::NAN, f64::INFINITY, 1e305].map(|bad| (model, bad))) {
        let found = model.predict(&Vector3::new(0.1, bad, 0.1));
        assert!(!found.inside && found.residual_m == Vector3::zeros() && found.covariance_m2[(1, 1)].is_infinite());
    }
}

#[test]
fn parts_that_do_not_fit_are_refused_by_name() {
    let parts = random_model(Kind::KrigingNetwork, 5).parts().clone();
    let refused = |change: &dyn Fn(&mut Parts)| {
        let mut changed = parts.clone();
        change(&mut changed);
        ResidualModel::new(changed).map(|_| ()).unwrap_err().to_string()
    };
    fn with_trend(change: fn(&mut PositionEnsemble)) -> Parts {
        let mut parts = random_model(Kind::PerceptronKriging, 5).parts().clone();
        parts.trend.iter_mut().for_each(change);
        parts
    }
    let scaled = |factor: f64| {
        let errors = parts.field.errors_m().iter().map(|e| e * factor).collect();
        MeasuredField::new(parts.field.points_m().to_vec(), errors, None).unwrap()
    };
    let in_mm = parts.field.points_m().iter().map(|p| p * 1000.0).collect();
    let in_mm = MeasuredField::new(in_mm, parts.field.errors_m().to_vec(), None).unwrap();
    let cases: [(Change, &str); 15] = [
        (&|p| p.kind = Kind::Kriging, "has no use for networks on the neighbourhood"),
        (&|p| p.ensemble = None, "needs networks on the neighbourhood"),
        (&|p| p.trend = Some(random_trend(1)), "has no use for networks on the position"),
        (&|p| (p.kind, p.ensemble) = (Kind::PerceptronKriging, None), "needs networks on the position"),
        (&|p| *p = with_trend(|t| t.members[1][3] = f32::NAN), "member 1: parameter 3 is not a finite number"),
        (&|p| *p = with_trend(|t| t.members[2].truncate(9)), "another layout"),
        (&|p| *p = with_trend(|t| t.high_m.y = 0.0), "no extent"),
        (&|p| *p = with_trend(|t| t.scale_m.z = 0.0), "scale"),
        (&|p| p.kriging.components[1].weights_per_m.truncate(5), "5 kriging weights for 70"),
        (&|p| p.kriging.components[0].length_m.y = -1.0, "length scale"),
        (&|p| p.kriging.components[2].trend_m = f64::NAN, "not a finite number"),
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
