//! Plans that ship: like the recorded campaigns, the FYXZ paper, the alias study and Chen 2020.
//!
//! Place in the flow: a preset makes a [`PlanRecipe`] or a [`Plan`] for a machine's strokes (m).
//! Source: Chen 2020, table 1 (stations) and §3 (183 readings a station); FYXZ paper (12 edges, 4 stations).

use super::recipe::{LineKind, LineSelection, PlanRecipe};
use super::{LinePlan, Plan, StationPlan};
use crate::error::SimulationError;

/// Reflector offsets of the recorded campaigns (m, ram frame).
pub const CASE_OFFSETS_M: [[f64; 3]; 3] = [[0.0, 0.0, -0.06], [0.12, 0.0, -0.06], [0.0, 0.14, -0.09]];

/// Stations around a box, in fractions of its sides; no four of the first five lie in one plane.
const AROUND: [[f64; 3]; 6] = [
    [-0.20, -0.25, -0.25],
    [1.20, -0.20, -0.10],
    [1.15, 1.30, 0.15],
    [-0.15, 1.20, 0.70],
    [0.45, 0.40, -0.50],
    [0.55, -0.30, 0.90],
];

/// Five stations of 36 drawn lines and a closing one, three offsets, both directions, uneven points.
pub fn case_like(stroke_m: [[f64; 2]; 3], seed: u64) -> PlanRecipe {
    PlanRecipe {
        kinds: vec![LineKind::AlongX, LineKind::AlongY, LineKind::AlongZ, LineKind::BodyDiagonal],
        selection: LineSelection::Drawn(36),
        both_directions: true,
        offsets_m: CASE_OFFSETS_M.to_vec(),
        points: [12, 19],
        jitter: 0.9,
        close_station: true,
        ..raster(stroke_m, seed, 5)
    }
}

/// Plan A of the alias study: four stations, one offset, all lines in +X, in order.
pub fn plan_a(stroke_m: [[f64; 2]; 3], seed: u64) -> PlanRecipe {
    raster(stroke_m, seed, 4)
}

/// Plan B: as A with three offsets, each line there and back.
pub fn plan_b(stroke_m: [[f64; 2]; 3], seed: u64) -> PlanRecipe {
    PlanRecipe { both_directions: true, offsets_m: CASE_OFFSETS_M.to_vec(), ..raster(stroke_m, seed, 4) }
}

/// Plan C: as B with six stations and the lines in random order.
pub fn plan_c(stroke_m: [[f64; 2]; 3], seed: u64) -> PlanRecipe {
    PlanRecipe { selection: LineSelection::EveryShuffled, stations_m: around(stroke_m, 6), ..plan_b(stroke_m, seed) }
}

/// The FYXZ paper's plan: the 12 edges, four stations not in one plane, reflector at the ram end (offset zero).
///
/// # Errors
/// Names the key that makes no sense.
pub fn edges_12(stroke_m: [[f64; 2]; 3], points_per_edge: u32, seed: u64) -> Result<Plan, SimulationError> {
    PlanRecipe {
        box_m: stroke_m,
        levels: [2; 3],
        kinds: vec![LineKind::AlongX, LineKind::AlongY, LineKind::AlongZ],
        offsets_m: vec![[0.0; 3]],
        points: [points_per_edge; 2],
        ..raster(stroke_m, seed, 4)
    }
    .build()
}

/// Strokes (m) of a machine on which [`chen2020`] runs: its stations lie around this box.
pub const CHEN_STROKE_M: [[f64; 2]; 3] = [[0.0, 0.5], [0.0, 1.2], [-0.6, -0.3]];

/// Chen 2020: six stations, 92 points in 400 × 300 × 250 mm, offset zero.
///
/// The paper does not list the points; these are a 5 × 5 × 4 grid without its eight corners. `both_ways` adds
/// the reverse pass without its first point: 183 readings a station, as in the paper's experiment.
pub fn chen2020(both_ways: bool) -> Plan {
    let stations_mm = [
        [-50.0, -70.0, -620.0],
        [520.0, -50.0, -470.0],
        [520.0, 1300.0, -620.0],
        [-40.0, 1250.0, -470.0],
        [70.0, -70.0, -620.0],
        [-60.0, 40.0, -620.0],
    ];
    let stations = stations_mm.iter().enumerate().map(|(place, position_mm)| {
        let name = format!("S{}", place + 1);
        StationPlan {
            position_m: position_mm.map(|v| v * 1e-3),
            dead_path_m: 0.05,
            lines: chen_lines(&name, both_ways),
            name,
        }
    });
    Plan { seed: 0, home_m: [0.05, 0.45, -0.575], dwell_s: 3.0, station_change_s: 900.0, stations: stations.collect() }
}

/// Rows of the corner-less grid, driven to and fro.
fn chen_lines(station: &str, both_ways: bool) -> Vec<LinePlan> {
    let mut rows: Vec<([f64; 3], [f64; 3], u32)> = Vec::new();
    for layer in 0..4_u32 {
        for row in 0..5_u32 {
            let cut = (layer == 0 || layer == 3) && (row == 0 || row == 4);
            let y = 0.45 + 0.075 * f64::from(row);
            let z = -0.575 + 0.25 * f64::from(layer) / 3.0;
            let (low, high, points) = if cut { (0.15, 0.35, 3) } else { (0.05, 0.45, 5) };
            let (from, to) = ([low, y, z], [high, y, z]);
            rows.push(if row % 2 == 0 { (from, to, points) } else { (to, from, points) });
        }
    }
    if both_ways {
        let mut back: Vec<_> = rows.iter().rev().map(|(f, t, n)| (*t, *f, *n)).collect();
        if let Some((from, _, points)) = back.first_mut() {
            // The turning point is measured once; its row goes on from the next point.
            from[0] += if from[0] > 0.25 { -0.1 } else { 0.1 };
            *points -= 1;
        }
        rows.extend(back);
    }
    let lines = rows.into_iter().enumerate();
    lines
        .map(|(place, (from_m, to_m, points))| LinePlan {
            name: format!("{station}-{place:02}"),
            from_m,
            to_m,
            points,
            jitter: 0.0,
            offset_m: [0.0; 3],
            feed_m_s: 0.05,
            acceleration_m_s2: 0.3,
            load_kg: 0.0,
            pause_s: 0.0,
        })
        .collect()
}

/// A 5 × 5 raster of lines in +X, one offset, evenly spaced: the ground the other plans stand on.
fn raster(stroke_m: [[f64; 2]; 3], seed: u64, stations: usize) -> PlanRecipe {
    PlanRecipe {
        seed,
        box_m: stroke_m.map(|[low, high]| {
            let margin = 0.02 * (high - low);
            [low + margin, high - margin]
        }),
        levels: [5; 3],
        stations_m: around(stroke_m, stations),
        dead_path_m: 0.05,
        kinds: vec![LineKind::AlongX],
        selection: LineSelection::Every,
        both_directions: false,
        offsets_m: vec![CASE_OFFSETS_M[0]],
        points: [15, 15],
        jitter: 0.0,
        feeds_m_s: vec![0.02, 0.06, 0.12],
        acceleration_m_s2: [0.1, 0.9],
        loads_kg: vec![0.0, 5.0, 10.0],
        load_by_line: false,
        pause_s: [3.0, 15.0],
        close_station: false,
    }
}

fn around(stroke_m: [[f64; 2]; 3], count: usize) -> Vec<[f64; 3]> {
    let places = AROUND.iter().take(count);
    places
        .map(|fraction| {
            let mut out = [0.0; 3];
            for axis in 0..3 {
                let [low, high] = stroke_m[axis];
                out[axis] = low + fraction[axis] * (high - low);
            }
            out
        })
        .collect()
}
