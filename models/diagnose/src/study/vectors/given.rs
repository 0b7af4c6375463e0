//! What is wrong with residual vectors before anything is fitted to them: figures that are none, the same row twice.
//!
//! Place in the flow: first step of the study of vectors.

use super::ResidualVector;
use crate::error::DiagnoseError;
use std::collections::BTreeSet;

const FEWEST_VECTORS: usize = 12;
/// Rows named in one sentence.
const NAMED: usize = 8;

/// Vectors that count, in the order given, and what a reader must know.
pub(super) fn given(vectors: &[ResidualVector]) -> Result<(Vec<usize>, Vec<String>), DiagnoseError> {
    for (k, vector) in vectors.iter().enumerate() {
        let own = vector.position_m.iter().chain(&vector.residual_m).chain(&vector.time_s);
        if !own.chain(vector.covariates.values()).all(|value| value.is_finite()) {
            return Err(data(format!("vector {} holds a figure that is not finite", k + 1), "remove or correct it"));
        }
        if vector.u_plate_m.is_some_and(|u| !(u.is_finite() && u > 0.0)) {
            let problem = format!("vector {} has an uncertainty of the plate that is not above zero", k + 1);
            return Err(data(problem, "correct it, or leave its column out"));
        }
        if vector.u_m.is_some_and(|u| u.iter().any(|u| !(u.is_finite() && *u > 0.0))) {
            return Err(data(format!("vector {} has an uncertainty that is not above zero", k + 1), "correct it"));
        }
    }
    let (rows, notes) = once(vectors);
    if rows.len() < FEWEST_VECTORS {
        let problem = format!("there are {} residual vectors, at least {FEWEST_VECTORS} are needed", rows.len());
        return Err(data(problem, "give the residuals of more points"));
    }
    Ok((rows, notes))
}

/// Rows without copies: what was measured cannot come out the same to the last digit in all that was logged.
fn once(vectors: &[ResidualVector]) -> (Vec<usize>, Vec<String>) {
    let mut seen = BTreeSet::new();
    let (mut rows, mut copies) = (Vec::new(), Vec::new());
    for (k, vector) in vectors.iter().enumerate() {
        let figures = vector.position_m.iter().chain(&vector.residual_m).chain(&vector.time_s);
        let figures: Vec<u64> = figures.chain(vector.covariates.values()).map(|value| value.to_bits()).collect();
        if seen.insert((figures, &vector.block, &vector.pose, &vector.point)) {
            rows.push(k)
        } else {
            copies.push(k + 1)
        }
    }
    if copies.is_empty() {
        return (rows, Vec::new());
    }
    let named: Vec<String> = copies.iter().take(NAMED).map(usize::to_string).collect();
    let more = if copies.len() > NAMED { ", …" } else { "" };
    let note =
        format!("{} vectors are copies of others and were counted once: {}{more}.", copies.len(), named.join(", "));
    (rows, vec![note])
}

fn data(problem: String, remedy: &str) -> DiagnoseError {
    DiagnoseError::Data { problem, remedy: remedy.to_owned() }
}
