//! A model with random numbers everywhere, for the tests of files.

use abbe_files::{DataSource, Doubt, ModelFile, ResidualReference, parse_machine};
use abbe_geometry::Vector3;
use abbe_geometry::by_place::{FORMS, VarianceByPlace};
use abbe_geometry::effects::Shape;
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::layout::Layout;
use abbe_geometry::model::{FitQuality, IdentifiedVolume, MachineModel, ModelParts, Station};
use abbe_geometry::unseen_expansion::{UnseenExpansion, UnseenExpansions};
use abbe_measurement::instrument::RangeUncertainty;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A small model whose numbers use all digits of a double.
pub(crate) fn model(seed: u64) -> ModelFile {
    let text = include_str!("../../../../launch-config/machines/bridge_xyz.toml");
    let file = parse_machine(text, "bridge_xyz.toml").unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut machine = file.machine;
    machine.kinds = [Some(FunctionKind::Polynomial { degree: 2 }); 18];
    machine.kinds[5] = None;
    machine.stroke_m[1].1 = 0.1 + 0.2 + rng.random_range(0.0..0.3);
    let mut numbers = |count: usize, scale: f64| -> Vec<f64> {
        (0..count).map(|_| scale * rng.random_range(-1.0..1.0) * 10f64.powi(rng.random_range(-6..3))).collect()
    };
    let coefficients = numbers(Layout::new(&machine, [0.0; 3]).unwrap().len(), 1e-5);
    let axis = Shape::new().text("axis", "y");
    let shapes = [
        ("reversal", axis.clone().text("over", "z").number("terms", 3.0)),
        ("scale_expansion", axis.text("sensor", "temp_y_c")),
    ];
    let effects = shapes.map(|(name, shape)| {
        let count = abbe_geometry::effects::construct(name, &shape, &machine).unwrap().parameters().len();
        MachineModel::fitted_effect(name, shape, &machine, numbers(count, 1e-6)).unwrap()
    });
    let position = numbers(3, 1.0);
    let stations = vec![Station {
        name: "S1 \"north\"".to_owned(),
        position_m: Vector3::new(position[0], position[1], position[2]),
        dead_path_m: numbers(1, 1.0)[0],
    }];
    let offset_centre_m = [0, 1, 2].map(|_| numbers(1, 0.1)[0]);
    let total = coefficients.len() + 5 + 4;
    // Correlations that sum to less than one in every row, so that it is a covariance.
    let mut covariance = |scale: f64| -> Vec<f64> {
        let (sizes, links) = (numbers(total, 1.0), numbers(total * total, 1.0));
        let correlation = |a: usize, b: usize| links[a * total + b] / (1.0 + links[a * total + b].abs()) / total as f64;
        let entry = |(a, b): (usize, usize)| match a == b {
            true => scale * sizes[a] * sizes[a],
            false => scale * correlation(a, b) * (sizes[a] * sizes[b]).abs(),
        };
        (0..total).flat_map(|a| (0..=a).map(move |b| (a, b))).map(entry).collect()
    };
    let parts = ModelParts {
        covariance: covariance(1e-12),
        chord_covariance: covariance(1e-13),
        identified: IdentifiedVolume {
            reading_m: [(0.0, 0.8); 3],
            offset_m: [(-0.1, 0.1); 3],
            covariates: [("temp_y_c", (19.8, 20.0 + 1.0 / 3.0)), ("dir_y", (-1.0, 1.0))]
                .map(|(name, range)| (name.to_owned(), range))
                .into(),
            differences: Vec::new(),
        },
        quality: FitQuality {
            readings: 2817,
            rejected: 3,
            chi2_per_dof: 1.0 / 3.0,
            residual_rms_m: 0.1e-6,
            unexplained_m: [0.07e-6, 0.0, 1e-7 / 3.0],
            wanders: Some(wanders()),
            unseen_expansions: UnseenExpansions {
                by_sensor: vec![UnseenExpansion {
                    sensor: "temp_y_c".to_owned(),
                    per_kelvin: [1e-6 / 3.0, 0.0, 2e-6],
                    at_c: [20.1, 19.9, 20.0],
                    squareness_per_kelvin: [3e-6, 1e-6 / 3.0, 0.0],
                    squareness_at_c: [20.3, 20.0 + 1.0 / 3.0, 20.0],
                }],
                absorbed: vec![(0..total).map(|k| 1e-7 / (k + 3) as f64).collect()],
            },
        },
        machine,
        coefficients,
        offset_centre_m,
        effects: effects.into(),
        stations,
    };
    ModelFile {
        model: MachineModel::new(parts).unwrap(),
        order: file.order,
        instrument: RangeUncertainty { common_per_metre: 1e-7 * (seed % 2) as f64, ..file.instrument },
        absolute_range: file.absolute_range,
        residual_network: Some(ResidualReference { file: "residual.bin".to_owned(), sha256: "00".repeat(32) }),
        data: vec![DataSource { file: "campaign.csv".to_owned(), sha256: "ab".repeat(32) }],
        seed: Some(7),
        options: serde_json::json!({"robust": true}),
        evidence: serde_json::json!({"bic": [0.1, -2.5e-3], "note": "µm"}),
        doubts: vec![Doubt { grade: "warning".to_owned(), text: "the data cover 40.0 % of Y only".to_owned() }],
        software: "abbe 0.1.0".to_owned(),
    }
}

/// Of one motion along each axis that is known but for its size.
fn wanders() -> VarianceByPlace {
    let square = |size_m: f64| {
        let form = |k: usize| size_m / (k + 1) as f64;
        (0..FORMS).flat_map(|row| (0..=row).map(move |column| form(row) * form(column))).collect()
    };
    VarianceByPlace {
        middle_m: [0.1, -0.2, 1.0 / 3.0],
        half_span_m: [0.4, 0.7, 0.3],
        packed_m2: [square(1e-6), square(0.7e-6), square(1e-7 / 3.0)],
    }
}
