//! Effects that single poses of a plate give in different sizes.
//!
//! Place in the flow: after everything is found. A plate that lies on the table again, or years later, must tell the same of the machine; where
//! it does not, the mean of its poses is that of none, and its u knows nothing of it. Each pose gets a size of its own, beside all else that
//! was found; whether these differ is tested in whatever noise the rows leave possible ([`super::significance`]). What has a name and was
//! not found is tested as well: 15 µrad in one pose and −15 in the other are nothing on average.

use super::candidate::{Goes, PoseRows};
use super::fit::Fit;
use super::significance::{probability, probability_beside};
use super::view::View;
use crate::error::DiagnoseError;
use crate::linear::joined;
use crate::score::LEFT;
use abbe_geometry::effects::ParameterSpec;
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};
use std::collections::BTreeSet;

/// Sizes by pose that differ by more than chance has it, in words.
pub(super) fn contradictions(view: &View, fit: &Fit, significance: f64) -> Result<Vec<String>, DiagnoseError> {
    let poses = view.study.poses();
    if poses.len() < 2 {
        return Ok(Vec::new());
    }
    let found = fit.set();
    let is_name = |k: &usize| view.study.candidates()[*k].goes == Goes::First && !found.contains(k);
    let mut names: Vec<usize> = (0..view.study.candidates().len()).filter(is_name).collect();
    let tested = (found.len() + names.len()) as f64;
    let (mut words, mut beside) = (Vec::new(), Mat::zeros(view.len(), 0));
    for candidate in found {
        let each = of_each_pose(view, fit, candidate, &poses);
        // The first pose has the size of all; the others may depart from it.
        let p_value = probability(view, fit, &joined(&each[1..]))?;
        if p_value * tested <= significance {
            words.push(said(view, fit, (candidate, p_value), &beside, (&each, &poses))?);
            beside = joined(&[beside, joined(&each[1..])]);
        }
    }
    // What was not found lacks a size of all in the fit. The surest goes first: others may only follow from it.
    while !names.is_empty() {
        let mut tried = Vec::with_capacity(names.len());
        for candidate in names.iter().copied() {
            let each = of_each_pose(view, fit, candidate, &poses);
            let further = joined(&[beside.clone(), (*view.columns(&fit.point, candidate)).clone()]);
            tried.push((probability_beside(view, fit, &further, &joined(&each[1..]))?, candidate, each));
        }
        let Some((p_value, candidate, each)) = tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) else { break };
        if p_value * tested > significance {
            break;
        }
        words.push(said(view, fit, (candidate, p_value), &beside, (&each, &poses))?);
        beside = joined(&[beside, joined(&each)]);
        names.retain(|own| *own != candidate);
    }
    Ok(words)
}

/// A contradiction in words.
fn said(
    view: &View,
    fit: &Fit,
    (candidate, p_value): (usize, f64),
    beside: &Mat<f64>,
    (each, poses): (&[Mat<f64>], &[PoseRows]),
) -> Result<String, DiagnoseError> {
    let name = &view.study.candidates()[candidate].name;
    let sizes = sizes(view, fit, candidate, beside, (each, poses))?;
    Ok(format!("{name} is not the same in all poses (p = {p_value:.1e} by chance){sizes}"))
}

/// Columns of a candidate that act in one pose alone, for each pose.
fn of_each_pose(view: &View, fit: &Fit, candidate: usize, poses: &[PoseRows]) -> Vec<Mat<f64>> {
    let columns = view.study.columns(&fit.point, candidate);
    let in_pose = |rows: &BTreeSet<usize>| {
        let at = |i: usize, j: usize| if rows.contains(&i) { columns[(i, j)] } else { 0.0 };
        view.picked(&Mat::from_fn(columns.nrows(), columns.ncols(), at))
    };
    poses.iter().map(|(_, rows)| in_pose(rows)).collect()
}

/// `: 31 µm/m in pose 2003, 20 in pose 2010`, where a candidate has one size; nothing where it has several.
fn sizes(
    view: &View,
    fit: &Fit,
    candidate: usize,
    beside: &Mat<f64>,
    (each, poses): (&[Mat<f64>], &[PoseRows]),
) -> Result<String, DiagnoseError> {
    let [spec] = &view.study.candidates()[candidate].parameters[..] else { return Ok(String::new()) };
    let without = Fit::without(view, &fit.set(), candidate)?;
    let linear = without.with_columns(view.whitened(beside).as_ref())?;
    let group = linear.project(view.whitened(&joined(each)).as_ref());
    // A pose in which nothing is left of it beside its own motion tells no size.
    if (0..each.len()).any(|k| group.left[(k, k)] <= LEFT * group.alone[(k, k)]) {
        return Ok(String::new());
    }
    let Ok(factor) = Llt::new(group.left.as_ref(), Side::Lower) else { return Ok(String::new()) };
    let solved = factor.solve(crate::linear::column(&group.gradient));
    let one = |(k, (name, _)): (usize, &PoseRows)| format!("{} in pose {name}", in_words(spec, solved[(k, 0)]));
    let sizes: Vec<String> = poses.iter().enumerate().map(one).collect();
    Ok(format!(": {}", sizes.join(", ")))
}

/// A size in the unit of reports.
fn in_words(spec: &ParameterSpec, value: f64) -> String {
    let (factor, unit) = match spec.unit {
        "m" => (1e6, "µm"),
        "m/m" | "1" => (1e6, "µm/m"),
        "rad" => (1e6, "µrad"),
        other => (1.0, other),
    };
    format!("{:.1} {unit}", value * factor)
}
