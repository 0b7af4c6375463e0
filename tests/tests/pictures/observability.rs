//! Eigenvalues of the scaled normal matrix of four plans: what one station and one offset leave unseen.

use crate::canvas::{BLUE, Canvas, MUTED, ORANGE, Plot};
use crate::hold;
use abbe_files::read_machine;
use abbe_geometry::chain::{ErrorValues, chain_point};
use abbe_geometry::machine::Machine;
use abbe_geometry::{Axis, ErrorId, Vector3};
use faer::{Mat, Side};
use std::path::Path;

/// Below it a combination is not seen.
const UNSEEN: f64 = 1e-6;
/// Places along each axis.
const PLACES: usize = 5;
/// Where rounding ends and the plot begins.
const FLOOR: f64 = 1e-13;

const STATIONS_M: [[f64; 3]; 5] =
    [[0.2, -0.4, 0.1], [1.1, 0.2, 0.0], [0.4, 1.0, 0.15], [-0.4, 0.5, -0.1], [0.9, 0.9, 0.5]];
const OFFSETS_M: [[f64; 3]; 3] = [[0.0, 0.0, -0.2], [0.12, 0.0, -0.25], [0.0, 0.12, -0.3]];

/// Straight line and parabola of an error over its stroke, as far as the gauge leaves them.
fn shapes(id: ErrorId, t: f64) -> Vec<f64> {
    if id.is_straightness() { vec![t * (t - 1.0)] } else { vec![t, t * t] }
}

/// A row of unknowns: errors, squareness, then position and dead path of each station.
fn row(machine: &Machine, reading_m: [f64; 3], offset_m: [f64; 3], (station, of): (usize, usize)) -> Vec<f64> {
    let point = chain_point(machine, reading_m, offset_m, &ErrorValues::ZERO);
    let direction = (point.position_m - Vector3::from(STATIONS_M[station])).normalize();
    let share = |axis: Axis| {
        let (low, high) = machine.stroke_m[axis.index()];
        (reading_m[axis.index()] - low) / (high - low)
    };
    let mut row = Vec::new();
    for id in ErrorId::all() {
        let along = point.by_error[id.index()].dot(&direction);
        row.extend(shapes(id, share(id.axis())).into_iter().map(|shape| along * shape));
    }
    row.extend(point.by_squareness.iter().map(|moved| moved.dot(&direction)));
    let first = row.len();
    row.resize(first + 4 * of, 0.0);
    (0..3).for_each(|d| row[first + 4 * station + d] = -direction[d]);
    row[first + 4 * station + 3] = -1.0;
    row
}

/// Eigenvalues, ascending, of a plan with so many stations and offsets.
fn spectrum(machine: &Machine, stations: usize, offsets: usize) -> Vec<f64> {
    let mut rows = Vec::new();
    let place = |k: usize, d: usize| {
        let (low, high) = machine.stroke_m[d];
        low + (high - low) * k as f64 / (PLACES - 1) as f64
    };
    for (station, offset_m) in (0..stations).flat_map(|s| OFFSETS_M[..offsets].iter().map(move |offset| (s, *offset))) {
        for k in 0..PLACES.pow(3) {
            let [i, j, l] = [k % PLACES, k / PLACES % PLACES, k / PLACES / PLACES];
            rows.push(row(machine, [place(i, 0), place(j, 1), place(l, 2)], offset_m, (station, stations)));
        }
    }
    let jacobian = Mat::from_fn(rows.len(), rows[0].len(), |i, j| rows[i][j]);
    let normal = jacobian.transpose() * &jacobian;
    let scale = |k: usize| normal[(k, k)].sqrt().max(f64::MIN_POSITIVE).recip();
    let scaled = Mat::from_fn(normal.nrows(), normal.ncols(), |i, j| normal[(i, j)] * scale(i) * scale(j));
    let eigen = scaled.self_adjoint_eigen(Side::Lower).unwrap();
    (0..scaled.nrows()).map(|k| eigen.S()[k]).collect()
}

#[test]
fn stations_and_offsets_let_a_plan_see_everything() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../launch-config/machines");
    let machine = read_machine(&folder.join("bridge_xyz.toml")).unwrap().machine;
    let plans = [(1, 1), (3, 1), (3, 3), (5, 3)];
    let mut canvas = Canvas::new(720.0, 260.0);
    let plot = Plot { left: 70.0, top: 30.0, width: 630.0, height: 170.0, x: (0.0, 4.0), y: (-13.0, 1.0) };
    plot.frame(&mut canvas, (&[], &[-12.0, -9.0, -6.0, -3.0, 0.0]), ("", "log₁₀ of the eigenvalues of N"));
    canvas.path(&[plot.at(0.0, UNSEEN.log10()), plot.at(4.0, UNSEEN.log10())], ORANGE, 1.5, "4 3");
    let mut unseen = Vec::new();
    for (k, (stations, offsets)) in plans.into_iter().enumerate() {
        let values = spectrum(&machine, stations, offsets);
        let below = values.iter().filter(|value| **value < UNSEEN).count();
        unseen.push(below);
        for (place, value) in values.iter().enumerate() {
            let x = k as f64 + 0.1 + 0.8 * place as f64 / values.len() as f64;
            let colour = if *value < UNSEEN { ORANGE } else { BLUE };
            // What is rounding has no size of its own: it lies on the floor.
            let value = if *value < 1e-10 { FLOOR } else { *value };
            canvas.dot(plot.at(x, value.log10()), 2.5, colour);
        }
        let plural = |count: usize, word: &str| format!("{count} {word}{}", if count == 1 { "" } else { "s" });
        let (x, y) = plot.at(k as f64 + 0.5, plot.y.0);
        canvas.text(
            (x, y + 22.0),
            "middle",
            MUTED,
            &format!("{}, {}", plural(stations, "station"), plural(offsets, "offset")),
        );
        let words = if below == 0 { "everything seen".to_owned() } else { format!("{below} not seen") };
        canvas.text((x, y + 42.0), "middle", if below == 0 { BLUE } else { ORANGE }, &words);
    }
    assert!(unseen[0] > unseen[1] && unseen[1] > 0 && unseen[2] == 0 && unseen[3] == 0, "{unseen:?}");
    hold(
        "observability",
        &canvas.finished("Eigenvalues of four plans; below the dashed line a combination is not seen"),
    );
}
