//! Laws of kriging as it runs, against the kriging that was fitted.

use super::*;
use crate::model::tests::{bent_field, fitted};
use crate::neighbourhood::Neighbourhood;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Relative to the field; both solve the same equations, in other units.
const MEAN_TOLERANCE: f64 = 1e-7;
/// Rounding of the variances.
const ROUNDING: f64 = 1e-6;

#[test]
fn val_abbe_field_mean_is_the_same_and_the_deviation_never_smaller() {
    for (noise_m, kernel) in [(2e-8, Kernel::Matern52), (4e-7, Kernel::SquaredExponential)] {
        let field = bent_field(150, noise_m, 3);
        let (reference, kriging) = fitted(&field, kernel);
        let (mean, variance) = (KrigingMean::new(&kriging, &field), KrigingVariance::new(&kriging, &field).unwrap());
        let search = Neighbourhood::new(field.size(), field.points());
        let mut random = ChaCha8Rng::seed_from_u64(1);
        for _ in 0..200 {
            let at = Vector3::from_fn(|_, _| random.random::<f64>() * 0.7 - 0.1);
            let nearest = search.vertices(at.as_slice()).unwrap().nearest;
            let expected = reference.predict(&at);
            let error = (mean.at(at.as_slice()) - expected.error_m).norm();
            assert!(error < MEAN_TOLERANCE * 1e-6, "{at}: {error}");
            let deviation = variance.at(at.as_slice(), nearest).map(f64::sqrt);
            for axis in 0..3 {
                let ratio = deviation[axis] / expected.u_m[axis];
                assert!(ratio > 1.0 - ROUNDING, "{at}: {ratio}");
            }
        }
    }
}

#[test]
fn wide_registers_give_the_bits_of_the_plain_loops() {
    for kernel in [Kernel::Matern52, Kernel::SquaredExponential] {
        let field = bent_field(90, 1e-7, 5);
        let (_, kriging) = fitted(&field, kernel);
        let (mean, variance) = (KrigingMean::new(&kriging, &field), KrigingVariance::new(&kriging, &field).unwrap());
        for k in 0..50 {
            let at = Vector3::new(0.01, 0.004, 0.007) * f64::from(k);
            assert_eq!(mean.at(at.as_slice()), (&mean, at.as_slice()).run());
            assert_eq!(variance.at(at.as_slice(), k as usize), (&variance, at.as_slice(), k as usize).run());
        }
    }
}

#[test]
fn far_from_all_points_the_variance_is_that_of_the_signal_and_its_trend() {
    let field = bent_field(100, 1e-7, 4);
    let (_, kriging) = fitted(&field, Kernel::Matern52);
    let variance = KrigingVariance::new(&kriging, &field).unwrap().at(&[1e4; 3], 0);
    for axis in 0..3 {
        assert!(variance[axis] > kriging.components[axis].signal_m.powi(2));
    }
}
