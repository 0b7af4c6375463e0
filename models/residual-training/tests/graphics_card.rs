//! A graphics card trains the same networks as the processor.
//!
//! Place in the flow: only in programs built with graphics cards, on a machine that has one or Mesa's software card:
//! `cargo test -p abbe-residual-training --features wgpu --test graphics_card`. Without any card it fails.

#![allow(clippy::unwrap_used)] // A test fails by panicking.

use abbe_residual_training::simulated::{Character, SimulatedField, random_points_m};
use abbe_residual_training::{Config, Device, Go, Method, Optimiser, TrainingError, train};

/// Relative difference of a loss before the first step: single precision, added up in another order.
const ROUNDING: f64 = 1e-4;
/// The same after some epochs, through which differences grow.
const DRIFT: f64 = 0.05;

#[test]
fn networks_of_a_graphics_card_are_as_good_as_those_of_the_processor() {
    let field = SimulatedField::new(Character::Sharp, 1).measured(random_points_m(150, 2), 3).unwrap();
    let card = Device::wgpu().unwrap();
    println!("{}", card.name());
    for method in [Method::Network, Method::PerceptronKriging] {
        let mut config = Config { method, seed: 4, ..Config::default() };
        config.optimiser = Optimiser { epochs: 6, learning_rate: 3e-3, ..Optimiser::default() };
        config.network.width = 16;
        config.split.folds = 3;
        let on = |device: &Device| train(&field, &config, device, None, &mut |_| Go::On).unwrap();
        let (processor, graphics) = (on(&Device::cpu()), on(&card));
        assert_eq!(processor.record.device, "cpu");
        assert!(graphics.record.device.starts_with("wgpu: "), "{}", graphics.record.device);
        for (a, b) in processor.record.curves.iter().zip(&graphics.record.curves) {
            let (a, b) = (&a.validation_loss, &b.validation_loss);
            println!("{method:?}: {:.6} {:.6} → {:.6} {:.6}", a[0], b[0], a[6], b[6]);
            assert!((b[0] / a[0] - 1.0).abs() < ROUNDING, "{a:?} {b:?}");
            assert!((b[6] / a[6] - 1.0).abs() < DRIFT && b[6] != b[0], "{a:?} {b:?}");
        }
        let other_device = train(&field, &config, &Device::cpu(), Some(graphics.state), &mut |_| Go::On);
        assert_eq!(other_device.err(), Some(TrainingError::State("device")));
    }
}
