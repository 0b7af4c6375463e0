//! Evidence for maps and lines of volumetric error: hand cases, names of diagonals, uncertainty, refusals.

use abbe_geometry::correct::Status;
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::{Joint, Machine, Side, Squareness};
use abbe_geometry::model::{FitQuality, IdentifiedVolume, MachineModel, ModelParts};
use abbe_geometry::rotation::RotationForm;
use abbe_geometry::volumetric::{Diagonal, VolumetricError, along_line, at_distances, error_map};
use abbe_geometry::{Axis, ErrorId};
use std::collections::BTreeMap;

const STROKE_M: [(f64, f64); 3] = [(0.0, 0.6), (0.0, 0.9), (0.0, 0.4)];
/// Standard uncertainty of each coefficient, not correlated.
const U: f64 = 1e-6;

/// A machine with straight lines for positioning and angles: EXX = a·x/0.6 and so on, and squareness.
fn model(set: &[(&str, f64)], c0y_rad: f64) -> MachineModel {
    let tilt = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
    let joint = |axis| Joint { axis, side: Side::Tool };
    let kinds = ErrorId::all().map(|id| (!id.is_straightness()).then_some(FunctionKind::Polynomial { degree: 1 }));
    let machine = Machine {
        name: "test".to_owned(),
        frame_id: "machine".to_owned(),
        joints: [joint(Axis::Y), joint(Axis::X), joint(Axis::Z)],
        stroke_m: STROKE_M,
        squareness: [tilt("C0Y", Axis::X, Axis::Z), tilt("B0Z", Axis::Z, Axis::Y), tilt("A0Z", Axis::Z, Axis::X)],
        rotation: RotationForm::SmallAngle,
        kinds: kinds.collect::<Vec<_>>().try_into().unwrap(),
        repeatability_m: [0.5e-6; 3],
        u_ram_turn_rad: [abbe_geometry::machine::USUAL_RAM_TURN_RAD; 3],
        default_offset_m: None,
    };
    // Twelve functions of one coefficient, the value at the upper end; then C0Y, B0Z, A0Z; then the turn of the ram, known.
    let names: Vec<String> = ErrorId::all().filter(|id| !id.is_straightness()).map(ErrorId::name).collect();
    let mut coefficients = vec![0.0; 18];
    for (name, value) in set {
        coefficients[names.iter().position(|n| n == name).unwrap()] = *value;
    }
    coefficients[12] = c0y_rad;
    let packed = (0..18).flat_map(|i| (0..=i).map(move |j| if i == j && i < 15 { U * U } else { 0.0 }));
    MachineModel::new(ModelParts {
        machine,
        coefficients,
        offset_centre_m: [0.0; 3],
        effects: Vec::new(),
        stations: Vec::new(),
        covariance: packed.collect(),
        chord_covariance: Vec::new(),
        identified: IdentifiedVolume {
            reading_m: STROKE_M,
            offset_m: [(0.0, 0.0); 3],
            covariates: BTreeMap::new(),
            differences: Vec::new(),
        },
        quality: FitQuality {
            readings: 1,
            rejected: 0,
            chi2_per_dof: 1.0,
            residual_rms_m: 0.0,
            unexplained_m: [0.0; 3],
            wanders: None,
            unseen_expansions: Default::default(),
        },
    })
    .unwrap()
}

#[test]
fn the_map_covers_the_volume_in_order_with_the_errors_of_the_hand_case() {
    let model = model(&[("EXX", 6e-6), ("EZZ", -4e-6)], 0.0);
    let map = error_map(&model, &STROKE_M, [3, 4, 5], [0.0; 3]).unwrap();
    assert_eq!(map.len(), 60);
    assert_eq!(map[0].reading_m, [0.0; 3]);
    assert_eq!((map[1].reading_m[0], map[3].reading_m[1], map[12].reading_m[2]), (0.3, 0.9 / 3.0, 0.1));
    for point in &map {
        let [x, _, z] = point.reading_m;
        assert!((point.error_m.x - 6e-6 * x / 0.6).abs() < 1e-15 && point.error_m.y.abs() < 1e-15);
        assert!((point.error_m.z + 4e-6 * z / 0.4).abs() < 1e-15);
        assert_eq!(point.status, Status::InVolume);
        // At the origin nothing of the fit is uncertain; what is left is the repeatability.
        assert!(point.covariance_m2[(0, 0)] >= 0.25e-12 * (1.0 - 1e-12));
    }
    let outside = error_map(&model, &STROKE_M, [2; 3], [0.1, 0.0, 0.0]).unwrap();
    assert!(outside.iter().all(|p| p.status == Status::Extrapolated));
}

#[test]
fn diagonals_run_where_their_names_say() {
    assert_eq!(Diagonal::ALL.map(Diagonal::name), ["NPP", "NPN", "PPN", "PPP"]);
    let ends = Diagonal::from_name("NPN").unwrap().ends_m(&STROKE_M);
    assert_eq!(ends, [[0.6, 0.0, 0.4], [0.0, 0.9, 0.0]]);
    for name in ["", "PP", "PPPP", "ppp", "XYZ"] {
        assert_eq!(Diagonal::from_name(name), None, "{name}");
    }
}

#[test]
fn squareness_lengthens_one_diagonal_and_shortens_the_other() {
    // C0Y moves Y by c·x. On PPP of 0.6 × 0.9 × 0.4 the end is off by 0.6 c in Y: 0.6·0.9 c/L along the diagonal of
    // length L; on NPP X runs down, so the sign is the other.
    let c = 10e-6;
    let model = model(&[], c);
    let length_m = (0.36_f64 + 0.81 + 0.16).sqrt();
    let expected_m = 0.6 * 0.9 * c / length_m;
    for (name, sign) in [("PPP", 1.0), ("NPP", -1.0), ("PPN", 1.0), ("NPN", -1.0)] {
        let ends = Diagonal::from_name(name).unwrap().ends_m(&STROKE_M);
        let line = along_line(&model, ends, 5, [0.0; 3]).unwrap();
        assert_eq!(line[0].deviation_m, 0.0);
        assert_eq!(line[0].u_m, 0.0);
        let last = line[4];
        assert!((last.distance_m - length_m).abs() < 1e-15);
        // Second order: (6 µm)²/2 L.
        assert!((last.deviation_m - sign * expected_m).abs() < 2e-11, "{name}: {:e}", last.deviation_m);
    }
}

#[test]
fn the_uncertainty_of_a_deviation_is_that_of_the_difference_of_both_ends() {
    // Along X at y = 0.9, z = 0.4 from x = 0.6 down to 0: what Y and Z do is the same at both ends and cancels.
    let model = model(&[("EXX", 6e-6)], 0.0);
    let ends = [[0.6, 0.9, 0.4], [0.0, 0.9, 0.4]];
    let line = along_line(&model, ends, 2, [0.0; 3]).unwrap();
    // X falls by EXX from 6 µm to 0 while it moves back 0.6 m: it moved 6 µm too far, in its own direction.
    assert!((line[1].deviation_m - 6e-6).abs() < 1e-15);
    // EXX has u at 0.6 and none at 0; EBX turns z = 0.4 into X: 0.4 u. Nothing else moves X along X.
    assert!((line[1].u_m - U * (1.0_f64 + 0.16).sqrt()).abs() < 1e-12, "{:e}", line[1].u_m);
    let same = at_distances(&model, ends, &[0.6], [0.0; 3]).unwrap();
    assert_eq!(same[0], line[1]);
}

/// All of a line refers to its first target: where that is outside of what was identified, nothing on it is inside.
#[test]
fn a_line_is_worth_no_more_than_its_first_target() {
    let mut parts = model(&[], 0.0).parts().clone();
    parts.identified.reading_m = [(0.1, 0.6), (0.0, 0.9), (0.0, 0.4)];
    let model = MachineModel::new(parts).unwrap();
    let statuses = |ends| along_line(&model, ends, 3, [0.0; 3]).unwrap().iter().map(|p| p.status).collect::<Vec<_>>();
    let (inside, outside) = ([0.6, 0.0, 0.0], [0.0, 0.0, 0.0]);
    assert_eq!(statuses([outside, inside]), [Status::Extrapolated; 3]);
    assert_eq!(statuses([inside, outside]), [Status::InVolume, Status::InVolume, Status::Extrapolated]);
}

#[test]
fn grids_lines_and_places_that_make_no_sense_are_refused() {
    let model = model(&[], 0.0);
    assert_eq!(error_map(&model, &STROKE_M, [1, 5, 5], [0.0; 3]), Err(VolumetricError::Grid(25)));
    assert!(matches!(error_map(&model, &STROKE_M, [100_000; 3], [0.0; 3]), Err(VolumetricError::Grid(_))));
    let nan = error_map(&model, &STROKE_M, [2; 3], [f64::NAN, 0.0, 0.0]);
    assert!(matches!(nan, Err(VolumetricError::Outside { .. })));
    let point = [0.1, 0.1, 0.1];
    assert_eq!(along_line(&model, [point, point], 5, [0.0; 3]), Err(VolumetricError::Line));
    assert_eq!(along_line(&model, [point, [0.5, 0.1, 0.1]], 1, [0.0; 3]), Err(VolumetricError::Line));
    let beyond = at_distances(&model, [point, [0.5, 0.1, 0.1]], &[3.0], [0.0; 3]);
    assert!(matches!(beyond, Err(VolumetricError::Outside { .. })));
}
