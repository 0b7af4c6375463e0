//! Lines whose readings are all off by the same amount.
//!
//! Place in the flow: proposes shapes of the outlying run to [`crate::search`]; a run that is found is taken out of the
//! geometry's way by a constant of its own and named in the report.

use crate::candidates::{Candidate, Round, best_constant};
use crate::error::DiagnoseError;
use abbe_geometry::effects::Shape;
use abbe_geometry::machine::Machine;
use abbe_measurement::campaign::Campaign;
use faer::Mat;

/// The line that stands out most.
pub(crate) fn candidate(
    round: &Round,
    machine: &Machine,
    campaign: &Campaign,
) -> Result<Option<Candidate>, DiagnoseError> {
    // Asking the effect for each line would look at all readings.
    let mut columns: Vec<Mat<f64>> = vec![Mat::zeros(round.rows.len(), 1); campaign.lines.len()];
    for (k, reading) in campaign.readings.iter().enumerate() {
        columns[reading.line as usize][(k, 0)] = if round.rows.whitening[k] > 0.0 { 1.0 } else { 0.0 };
    }
    let best = best_constant(round, ("outlying_run", machine), columns, |line| {
        Shape::new().text("line", &campaign.lines[line])
    })?;
    Ok(best.map(|(_, candidate)| candidate))
}
