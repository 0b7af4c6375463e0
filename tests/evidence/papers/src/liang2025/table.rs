//! Liang 2025, section 4.3: the three-dimensional compensation table of the geometric part.
//!
//! Place in the flow: called by [`super::figures`]. The paper puts the geometric correction into the controller as a table and
//! names neither its step nor what interpolation costs. Here the table is made from an identified model, its error against the
//! model is measured between its nodes, and the step is chosen from a wanted error (lengths in m, µm in the text).

use super::simulated::{Measurement, STROKE_M, failed};
use crate::figure::{Figure, PaperError, Settings, Verdict};
use crate::statistics::Interval;
use abbe_field::table::{Grid, Table};
use abbe_field::table_within;
use abbe_geometry::Vector3;
use abbe_geometry::correct::correct;
use abbe_geometry::effects::{NoCovariates, State};
use abbe_geometry::model::MachineModel;
use abbe_identify::points::{PointOptions, fit_points};

/// Wanted interpolation error in each direction (m): a fifth of the paper's constant part of 0.5 µm + L/400.
const WANTED_M: f64 = 0.1e-6;
/// Nodes at most; far beyond what controllers take, so that the row says what the wanted error really costs.
const MOST_NODES: usize = 2_000_000;
/// Steps (mm) that are tried.
const STEPS_MM: [f64; 3] = [100.0, 50.0, 25.0];
/// Degree of the simulated machine's polynomials.
const DEGREE: usize = 4;
/// Tip at which the table is made (m, ram frame): a table in the controller knows one.
const TIP_M: [f64; 3] = [0.0, 0.0, -0.06];

/// The figures of the compensation table.
pub(super) fn figures(settings: &Settings) -> Result<Vec<Figure>, PaperError> {
    let seeds = settings.seed..settings.seed + settings.runs(20, 2) as u64;
    let (mut largest, mut nodes, mut chosen) = (vec![Vec::new(); STEPS_MM.len()], Vec::new(), Vec::new());
    for seed in seeds {
        let measurement = Measurement::new(seed, DEGREE, None)?;
        let options = PointOptions::default();
        let fitted = fit_points(&measurement.machine, &measurement.points, &options, &mut |_| true).map_err(failed)?;
        for (step_mm, values) in STEPS_MM.iter().zip(&mut largest) {
            let steps = STROKE_M.map(|(lower_m, upper_m)| ((upper_m - lower_m) * 1e3 / step_mm).round() as usize);
            let grid = Grid::regular(STROKE_M, steps).map_err(failed)?;
            let table = Table::of(grid, |p| error_m(&fitted.model, p)).map_err(failed)?;
            let missed = table.interpolation_error(|p| error_m(&fitted.model, p)).map_err(failed)?;
            values.push(missed.largest_m.max() * 1e6);
        }
        let (table, missed) =
            table_within(STROKE_M, WANTED_M, MOST_NODES, |p| error_m(&fitted.model, p)).map_err(failed)?;
        nodes.push(table.grid().nodes() as f64);
        chosen.push(missed.largest_m.max() * 1e6);
    }
    let text = |values: &[f64], decimals| Interval::of(values).map_or_else(String::new, |i| i.text(decimals));
    let by_step = STEPS_MM.iter().zip(&largest).map(|(step, values)| format!("{step} mm: {}", text(values, 3)));
    Ok(vec![Figure {
        place: "Section 4.3",
        what: "interpolation error of the compensation table against the model, largest (µm)".to_owned(),
        published: None,
        reproduced: format!(
            "{}; for {:.3} µm {} nodes ({} µm)",
            by_step.collect::<Vec<_>>().join(", "),
            WANTED_M * 1e6,
            text(&nodes, 0),
            text(&chosen, 3)
        ),
        how: format!("{} simulated machines of degree {DEGREE}, trilinear, compared between the nodes", nodes.len()),
        verdict: Verdict::NotPublished,
        reason:
            "the paper names neither step nor error; a table also knows one tip only, while the model takes any offset"
                .to_owned(),
    }])
}

/// Error of the model at a reading (m).
fn error_m(model: &MachineModel, reading_m: &Vector3<f64>) -> Result<Vector3<f64>, PaperError> {
    let state = State { reading_m: (*reading_m).into(), offset_m: TIP_M, covariates: &NoCovariates };
    let correction = correct(model, &state);
    match correction.covariance_m2 {
        Some(_) => Ok(correction.geometric_m + correction.effects_m),
        None => Err(failed("a node of the table lies outside the machine")),
    }
}
