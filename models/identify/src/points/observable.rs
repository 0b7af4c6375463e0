//! Can these points see every unknown? If not, which combinations are hidden?
//!
//! Place in the flow: before anything is fitted, on the normal matrix at a perfect machine, scaled to a unit diagonal as in
//! [`crate::observability`]. The turn of the ram is left out: where the offsets do not tell it, its prior does.

use super::PointsError;
use super::problem::Problem;
use crate::linear::select;
use crate::observability::{Observability, named_rank};
use abbe_geometry::ErrorId;

const FRAME_NAMES: [&str; 6] = ["frame x", "frame y", "frame z", "frame A", "frame B", "frame C"];

/// Rank and condition of the fit, or the combinations that cannot be seen.
pub(super) fn check(problem: &Problem) -> Result<Observability, PointsError> {
    let unknowns = vec![0.0; problem.unknowns()];
    let normal = problem.normal_of_points(&unknowns, &vec![1.0; problem.points.len()]);
    let with_prior = problem.layout.ram_turn();
    let is_judged = |k: &usize| !with_prior.contains(k) && !problem.held().contains(k);
    let judged: Vec<usize> = (0..normal.size).filter(is_judged).collect();
    let matrix = select(&normal.matrix, normal.size, &judged);
    let all = names(problem);
    let names: Vec<String> = judged.iter().map(|k| all[*k].clone()).collect();
    let (mut seen, groups) = named_rank(&matrix, &names).ok_or(PointsError::Singular)?;
    if seen.rank == seen.unknowns {
        (seen.rank, seen.unknowns) = (problem.free(), problem.free());
        return Ok(seen);
    }
    Err(PointsError::RankDeficient { groups, rank: seen.rank, unknowns: seen.unknowns })
}

/// The error, angle or frame coordinate that each unknown belongs to.
fn names(problem: &Problem) -> Vec<String> {
    let mut names = Vec::new();
    for id in ErrorId::all() {
        names.extend(problem.layout.range(id).map(|_| id.name()));
    }
    names.extend(problem.machine.squareness.iter().map(|s| s.name.clone()));
    names.extend(problem.layout.ram_turn().map(|_| "turn of the ram".to_owned()));
    names.extend(problem.alignments.iter().flat_map(|_| FRAME_NAMES.map(str::to_owned)));
    names
}
