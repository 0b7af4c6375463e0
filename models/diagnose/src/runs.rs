//! Lines whose readings are all off by the same amount.
//!
//! Place in the flow: proposes shapes of the outlying run to [`crate::search`]; a run that is found is taken out of the
//! geometry's way by a constant of its own and named in the report.

use crate::candidates::{Candidate, Round};
use crate::error::DiagnoseError;
use abbe_geometry::effects::{Shape, known};
use abbe_geometry::machine::Machine;
use abbe_identify::EffectTerm;
use abbe_measurement::campaign::Campaign;
use faer::Mat;

/// The line that stands out most.
pub(crate) fn candidate(
    round: &Round,
    machine: &Machine,
    campaign: &Campaign,
) -> Result<Option<Candidate>, DiagnoseError> {
    let Some(known) = known("outlying_run") else { return Ok(None) };
    // Asking the effect for each line would look at all readings.
    let mut columns: Vec<Mat<f64>> = vec![Mat::zeros(round.rows.len(), 1); campaign.lines.len()];
    for (k, reading) in campaign.readings.iter().enumerate() {
        columns[reading.line as usize][(k, 0)] = if round.rows.whitening[k] > 0.0 { 1.0 } else { 0.0 };
    }
    columns.iter_mut().for_each(|column| round.rows.whiten(column.col_as_slice_mut(0)));
    let groups = round.free.project_all(&columns).into_iter();
    let scores = groups.map(|group| (round.score(&group), group.absorbed()));
    let best = scores.enumerate().max_by(|a, b| a.1.0.reduction.total_cmp(&b.1.0.reduction));
    let Some((line, (score, absorbed))) = best else { return Ok(None) };
    let term = EffectTerm::new(known.name, Shape::new().text("line", &campaign.lines[line]), machine)?;
    Ok(Some(Candidate { known, term, score, trials: campaign.lines.len(), absorbed, rest: None }))
}
