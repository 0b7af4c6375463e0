//! Laws of compensation tables and of the choice of their steps.

use super::*;
use crate::step_choice::table_within;
use std::convert::Infallible;

const ENDS_M: [(f64, f64); 3] = [(0.0, 0.8), (-0.1, 0.5), (-0.6, 0.0)];

/// Errors of a bent guideway and a screw (m): strong in x, weak in y, linear in z.
fn bent(p: &Vector3<f64>) -> Result<Vector3<f64>, Infallible> {
    let bow = 40e-6 * p.x * (0.8 - p.x);
    Ok(Vector3::new(0.3e-6 * (25.0 * p.x).sin(), bow + 2e-6 * p.y * p.y, 5e-6 * p.z + bow * p.z))
}

#[test]
fn a_table_of_a_trilinear_function_misses_nothing_and_goes_on_beyond_its_grid() {
    let truth = |p: &Vector3<f64>| Vector3::new(p.x * p.y * p.z, 1.0 + p.x, p.y - p.z) * 1e-6;
    let grid = Grid::regular(ENDS_M, [3, 2, 4]).unwrap();
    assert_eq!((grid.nodes(), grid.points_m().nth(1).unwrap()), (60, Vector3::new(0.8 / 3.0, -0.1, -0.6)));
    let function = |p: &Vector3<f64>| Ok::<_, Infallible>(truth(p));
    let table = Table::of(grid, function).unwrap();
    assert!(table.interpolation_error(function).unwrap().largest_m.max() < 1e-20);
    let beyond = Vector3::new(0.9, 0.0, -0.7);
    let found = table.at(&beyond).unwrap();
    assert!((found.error_m - truth(&beyond)).norm() < 1e-19);
    let Region::Outside { distance_m } = found.region else { panic!("{found:?}") };
    assert!((distance_m - 0.1_f64.hypot(0.1)).abs() < 1e-12);
    assert_eq!(table.at(&Vector3::new(0.8, 0.5, 0.0)).unwrap().region, Region::Inside);
    assert_eq!(table.at(&Vector3::new(f64::NAN, 0.5, 0.0)), Err(Unanswered::NotFinite));
}

#[test]
fn the_stated_error_of_a_parabola_is_its_sagitta() {
    // A line over a step h misses a parabola by h²/8 times its second derivative, in the middle: 0.2²/8 · 2 = 0.01.
    let parabola = |p: &Vector3<f64>| Ok::<_, Infallible>(Vector3::new(0.0, p.x * p.x, 0.0));
    let table = Table::of(Grid::regular(ENDS_M, [4, 1, 1]).unwrap(), parabola).unwrap();
    let missed = table.interpolation_error(parabola).unwrap();
    assert!((missed.largest_m.y - 0.01).abs() < 1e-15, "{missed:?}");
    assert_eq!(missed.largest_m.x, 0.0);
    let half_steps = missed.at_m.x / 0.1;
    assert!((half_steps % 2.0 - 1.0).abs() < 1e-9, "in the middle of a step: {missed:?}");
}

#[test]
fn steps_follow_from_the_wanted_error_and_refine_the_axis_that_needs_it() {
    for wanted_m in [1e-6, 0.1e-6, 0.02e-6] {
        let (table, missed) = table_within(ENDS_M, wanted_m, 100_000, bent).unwrap();
        assert!(missed.largest_m.max() <= wanted_m, "{missed:?}");
        // Off the quarter steps it holds as well, but for the little that lies between them.
        let random = |k: usize| Vector3::from_fn(|d, _| (k as f64 * [0.7548, 0.5698, 0.4301][d]).fract());
        let place = |share: Vector3<f64>| Vector3::from_fn(|d, _| ENDS_M[d].0 + (ENDS_M[d].1 - ENDS_M[d].0) * share[d]);
        for point in (0..3000).map(|k| place(random(k))) {
            let miss = (table.at(&point).unwrap().error_m - bent(&point).unwrap()).amax();
            assert!(miss <= 1.05 * wanted_m, "{miss} {wanted_m}");
        }
        let [x, y, z] = table.grid().counts();
        assert!(x > y && z <= y, "{x} {y} {z}");
        // A tenth fewer steps along x would miss.
        let fewer = Grid::regular(ENDS_M, [(x - 1) * 7 / 10, y - 1, z - 1]).unwrap();
        let coarser = Table::of(fewer, bent).unwrap().interpolation_error(bent).unwrap();
        assert!(coarser.largest_m.max() > wanted_m, "{coarser:?}");
    }
}

#[test]
fn what_makes_no_table_is_refused() {
    let axes = |x: Vec<f64>| Grid::new([x, vec![0.0, 1.0], vec![0.0, 1.0]]);
    assert_eq!(axes(vec![0.0]), Err(GridError::TooFew { axis: "x", count: 1 }));
    assert_eq!(axes(vec![0.0, f64::NAN]), Err(GridError::NotFinite { axis: "x", index: 1 }));
    assert_eq!(axes(vec![0.0, 1.0, 1.0]), Err(GridError::NotAscending { axis: "x", index: 2 }));
    let grid = Grid::regular(ENDS_M, [1; 3]).unwrap();
    assert_eq!(Table::new(grid.clone(), vec![]), Err(GridError::Lengths { nodes: 8, errors: 0 }));
    let mut errors = vec![Vector3::zeros(); 8];
    errors[6].y = f64::NAN;
    assert_eq!(Table::new(grid.clone(), errors), Err(GridError::Error { node: 6 }));
    assert_eq!(Table::of(grid, |_| Err("no")).unwrap_err(), TableError::Function("no"));
    let upside_down = table_within([(0.0, 0.8), (0.5, -0.1), (0.0, 1.0)], 1e-6, 1000, bent).unwrap_err();
    assert_eq!(upside_down, TableError::Grid(GridError::NotAscending { axis: "y", index: 1 }));
    for wanted in [0.0, -1.0, f64::NAN] {
        assert!(matches!(table_within(ENDS_M, wanted, 1000, bent), Err(TableError::Wanted { .. })));
    }
    let too_fine = table_within(ENDS_M, 1e-9, 1000, bent).unwrap_err().to_string();
    assert!(too_fine.contains("more than 1000 nodes"), "{too_fine}");
    // 0.025 µm has no exact double in metres.
    let wanted_m = 0.125e-6 / 5.0;
    let too_fine = table_within(ENDS_M, wanted_m, 8, bent).unwrap_err().to_string();
    assert!(wanted_m * 1e6 != 0.025 && too_fine.contains("of 0.025 µm needs"), "{too_fine}");
    let hole = |p: &Vector3<f64>| Ok::<_, Infallible>(p / (p.x - 0.4));
    assert!(matches!(table_within(ENDS_M, 1e-6, 1000, hole), Err(TableError::NotFinite { .. })));
}
