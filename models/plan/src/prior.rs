//! Where a search begins: what is known beforehand, what counts, and the effects that shall be told.
//!
//! Place in the flow: [`crate::plan()`] hands it to the choice of stations and lines. The information is that of the prior of
//! identification (smoothness, turn of the ram, effects), of a campaign already measured, and of a machine that is no worse
//! than [`WORST_M`], so that it can be inverted before anything is measured; what is stated in the end does without the last.

use crate::check::wrong;
use crate::covariates::MOTION;
use crate::design::inverse;
use crate::error::PlanError;
use crate::promise::spread_m;
use crate::request::Request;
use abbe_geometry::ErrorId;
use abbe_geometry::effects::{Observed, Shape, Wish, construct, known};
use abbe_identify::{EffectTerm, IdentifyError, PlannedRows, STATION_PARAMETERS, TIME, U_ABSOLUTE_ZERO_M};
use faer::Mat;

/// A machine with errors of tenths of a millimetre and of milliradians: nobody measures a worse one with a tracer.
const WORST_M: f64 = 1e-4;
const WORST_RAD: f64 = 1e-3;
/// Points of the volume by which lines are judged.
const POINTS: usize = 150;
/// Share of its plausible size to which a parameter of an effect to be told shall be known.
const TOLD: f64 = 0.01;
/// Model uncertainty of a point (m) that counts as much as that.
const AS_MUCH_M: f64 = 0.3e-6;

/// What a search begins with.
pub(crate) struct Prior {
    /// Of the machine's parameters.
    pub(crate) information: Mat<f64>,
    /// W: points of the volume and effects to be told.
    pub(crate) weight: Mat<f64>,
    /// W of the points alone.
    pub(crate) points: Mat<f64>,
}

impl Prior {
    pub(crate) fn new(request: &Request, rows: &PlannedRows, terms: &[EffectTerm]) -> Result<Prior, PlanError> {
        let mut information = rows.precision(request.is_penalised().then_some(&request.belief));
        let layout = rows.layout();
        for id in ErrorId::all() {
            let worst = if id.is_angular() { WORST_RAD } else { WORST_M };
            layout.range(id).for_each(|k| information[(k, k)] += f64::powi(worst, -2));
        }
        layout.squareness().for_each(|k| information[(k, k)] += WORST_RAD.powi(-2));
        if request.measured.is_some() {
            information += measured(request, rows)?;
        }
        let points = of_points(request, rows);
        let mut weight = points.clone();
        let sizes = terms.iter().flat_map(|term| term.effect.parameters()).map(|spec| spec.plausible);
        for (k, size) in (layout.len()..).zip(sizes) {
            weight[(k, k)] += (AS_MUCH_M / (TOLD * size)).powi(2);
        }
        Ok(Prior { information, weight, points })
    }
}

/// Mean of TᵀT over the volume and the tips.
fn of_points(request: &Request, rows: &PlannedRows) -> Mat<f64> {
    let n = rows.machine_parameters();
    let mut sum = Mat::<f64>::zeros(n, n);
    for reading_m in spread_m(&request.volume_m, POINTS) {
        for offset_m in &request.tips_m {
            let tip = rows.tip(reading_m, *offset_m);
            sum += tip.transpose() * &tip;
        }
    }
    faer::Scale(1.0 / (POINTS * request.tips_m.len()) as f64) * sum
}

/// What a campaign already measured tells of the machine, its stations eliminated.
fn measured(request: &Request, rows: &PlannedRows) -> Result<Mat<f64>, PlanError> {
    let n = rows.machine_parameters();
    let mut information = Mat::<f64>::zeros(n, n);
    let Some(measured) = &request.measured else { return Ok(information) };
    let scale = 1.0 / measured.fit.model.parts().quality.chi2_per_dof.max(1.0);
    for (station, start) in measured.stations().iter().enumerate() {
        let used =
            |k: &usize| measured.campaign.readings[*k].station as usize == station && measured.fit.weights[*k] > 0.0;
        let own: Vec<usize> = (0..measured.campaign.readings.len()).filter(used).collect();
        let rows = rows.rows(&measured.campaign.part(&own), start.position_m.into())?;
        let of_station = &rows.station;
        let mut own = of_station.transpose() * of_station;
        if request.options.absolute_range {
            own[(STATION_PARAMETERS - 1, STATION_PARAMETERS - 1)] += U_ABSOLUTE_ZERO_M.powi(-2);
        }
        let known = inverse(&own).ok_or(IdentifyError::Singular)?;
        let cross = of_station.transpose() * &rows.machine;
        let whole = rows.machine.transpose() * &rows.machine - cross.transpose() * known * &cross;
        information += faer::Scale(scale) * whole;
    }
    Ok(information)
}

/// Effects that a campaign shall tell.
#[derive(Debug, Default)]
pub(crate) struct Wishes {
    /// Those that the choice of lines decides: they depend on where and how the machine moves.
    pub(crate) searched: Vec<EffectTerm>,
}

/// The terms of all wishes, in the shape that the effect proposes first for such a campaign.
pub(crate) fn terms(request: &Request) -> Result<Wishes, PlanError> {
    let mut wishes = Wishes::default();
    for (k, wish) in request.tell.iter().enumerate() {
        let shape = shape(request, wish, k)?;
        let term = EffectTerm::new(&wish.name, shape, &request.machine)?;
        if term.effect.reads().iter().all(|name| MOTION.contains(&name.as_str())) {
            wishes.searched.push(term);
        }
    }
    Ok(wishes)
}

fn shape(request: &Request, wish: &Wish, number: usize) -> Result<Shape, PlanError> {
    let Some(entry) = known(&wish.name) else {
        // The registry's own words name all that there are.
        construct(&wish.name, &wish.shape, &request.machine)?;
        return Err(wrong(format!("tell[{number}]"), "is no effect", "see the names in the handbook"));
    };
    let (varying, stations, offsets_m) = offered(request);
    let observed = Observed {
        machine: &request.machine,
        varying: &varying,
        stations: &stations,
        offsets_m: &offsets_m,
        time_s: (0.0, request.goal.budget_s.unwrap_or(4.0 * 3600.0)),
    };
    let shapes = (entry.propose)(&observed);
    let fits = |shape: &&Shape| wish.shape.0.iter().all(|(key, value)| shape.0.get(key) == Some(value));
    let key = format!("tell[{number}] {}", wish.name);
    match shapes.iter().find(fits) {
        Some(shape) => Ok(shape.clone()),
        None if shapes.is_empty() => {
            let remedy = "add the [[sensor]] that will be logged, several feeds or several holders, or leave it out";
            Err(wrong(key, format!("cannot be told by such a campaign: it needs {}", entry.needs), remedy))
        }
        None => {
            let keys: Vec<String> = shapes[0].0.keys().cloned().collect();
            Err(wrong(key, "has no such shape here", format!("name only {}, or leave them out", keys.join(", "))))
        }
    }
}

/// What a planned campaign will offer: covariates that vary, station names, offsets.
fn offered(request: &Request) -> (Vec<String>, Vec<String>, Vec<[f64; 3]>) {
    let mut varying = vec![TIME.to_owned()];
    let moves = |name: &&&str| **name != "speed_mm_s" || several_feeds(request);
    varying.extend(MOTION.iter().filter(moves).map(|name| (*name).to_owned()));
    varying.extend(request.sensors.iter().map(|sensor| sensor.name.clone()));
    let stations = request.stands.iter().map(|stand| stand.name.clone()).take(request.most_stations).collect();
    let mut offsets_m: Vec<[f64; 3]> = Vec::new();
    for holder in &request.holders {
        if !offsets_m.contains(&holder.offset_m) {
            offsets_m.push(holder.offset_m);
        }
    }
    (varying, stations, offsets_m)
}

fn several_feeds(request: &Request) -> bool {
    request.motion.feeds_m_s.iter().any(|feed| *feed != request.motion.feeds_m_s[0])
}
