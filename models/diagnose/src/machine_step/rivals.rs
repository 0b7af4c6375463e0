//! What else would explain what looks like a step of the machine.
//!
//! Place in the flow: asked by the scan of [`super`] where a step passes by itself. The same motions of the tip, with scales along the
//! axes and a drift of the stations beside them, as a course in time, in cycles, or by anything that was logged or lags behind it:
//! each is priced by its parameters alone, so that a step has to beat the best of them.

use super::{Competing, PLANES, Scan};
use crate::columns::{passed, varies};
use crate::error::DiagnoseError;
use abbe_geometry::Vector3;
use faer::Mat;

/// Share of the campaign after which a warm-up has fallen to 1/e.
const SETTLES: [f64; 4] = [0.02, 0.06, 0.2, 0.6];
/// Half cycles in the campaign up to which one is tried.
const HALF_CYCLES: usize = 20;

/// Whether a rival has more evidence than this. Those that come first are what was found and what is simple; the others are many, and are not
/// looked at once one is enough.
pub(super) fn any_beyond(
    scan: &Scan,
    competing: &Competing,
    limit: f64,
    go_on: &mut dyn FnMut() -> bool,
) -> Result<bool, DiagnoseError> {
    let places = passed(scan.campaign, 0..scan.campaign.readings.len());
    let course = |of: &dyn Fn(f64) -> f64| -> Vec<f64> { places.iter().map(|place| of(*place)).collect() };
    let mut courses: Vec<Vec<Vec<f64>>> = vec![vec![course(&|t| t)], vec![course(&|t| t), course(&|t| t * t)]];
    courses.push((1..=3).map(|power| course(&|t| t.powi(power))).collect());
    courses.extend(SETTLES.map(|share| vec![course(&|t| (-t / share).exp())]));
    courses.extend((1..=HALF_CYCLES).map(|halves| {
        let phase = move |t: f64| std::f64::consts::PI * halves as f64 * t;
        vec![course(&|t| phase(t).cos()), course(&|t| phase(t).sin())]
    }));
    let logged = scan.campaign.covariates.iter().filter(|column| varies(&column.values));
    courses.extend(logged.map(|column| vec![centred(&column.values)]));
    let found =
        competing.found.as_ref().map_or(f64::NEG_INFINITY, |columns| evidence(scan, std::slice::from_ref(columns)));
    if found.max(evidence(scan, &competing.set_aside)) > limit {
        return Ok(true);
    }
    let others = scales(scan);
    for course in &courses {
        if !go_on() {
            return Err(DiagnoseError::Stopped);
        }
        let times = |values: &[Vec<f64>]| -> Vec<Vec<f64>> {
            course.iter().flat_map(|f| values.iter().map(|value| scan.column(value, |k| f[k]))).collect()
        };
        let (turns, scales) = (times(&scan.figures), times(&others));
        let stations = stations(scan, course);
        let groups =
            [&turns[..], &[turns.clone(), scales.clone()].concat(), &scales, &stations].map(|c| scan.matrix(c));
        if evidence(scan, &groups) > limit {
            return Ok(true);
        }
    }
    Ok(false)
}

fn evidence(scan: &Scan, groups: &[Mat<f64>]) -> f64 {
    let projected = scan.round.free.project_all(groups);
    let evidence = projected.iter().map(|group| scan.round.score(group).evidence(scan.round.used, 1));
    evidence.fold(f64::NEG_INFINITY, f64::max)
}

/// Scales along the axes, bends of one axis along another's motion's square, and the range's own.
fn scales(scan: &Scan) -> Vec<Vec<f64>> {
    let rays = &scan.round.rows.rays;
    let reading = |k: usize, d: usize| scan.campaign.readings[k].reading_m[d];
    let along = |moves: usize, value: &dyn Fn(usize) -> f64| -> Vec<f64> {
        (0..rays.len()).map(|k| rays[k].direction.dot(&Vector3::ith(moves, value(k)))).collect()
    };
    let mut all: Vec<Vec<f64>> = (0..3).map(|d| along(d, &|k| reading(k, d))).collect();
    all.extend(PLANES.iter().map(|(moves, by)| along(*moves, &|k| reading(k, *by).powi(2))));
    all.push(rays.iter().map(|ray| ray.range_m).collect());
    all
}

/// Each station's motion and zero by this course.
fn stations(scan: &Scan, course: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let (readings, rays) = (&scan.campaign.readings, &scan.round.rows.rays);
    let mut all = Vec::new();
    for (f, station) in course.iter().flat_map(|f| (0..scan.campaign.stations.len() as u32).map(move |s| (f, s))) {
        let own = |k: usize| if readings[k].station == station { f[k] } else { 0.0 };
        let along = |d: usize| -> Vec<f64> { rays.iter().map(|ray| ray.direction[d]).collect() };
        all.extend((0..3).map(|d| scan.column(&along(d), own)));
        all.push(scan.column(&vec![1.0; readings.len()], own));
    }
    all
}

fn centred(values: &[Option<f64>]) -> Vec<f64> {
    let known: Vec<f64> = values.iter().map(|value| value.unwrap_or(0.0)).collect();
    let mean = known.iter().sum::<f64>() / known.len().max(1) as f64;
    known.iter().map(|value| value - mean).collect()
}
