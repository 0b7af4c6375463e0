//! Refuses a request that makes no sense.
//!
//! Place in the flow: before anything is planned. Each refusal names the key of the request file, what is wrong with it, and what to
//! do. SI, machine frame.

use crate::covariates::MOTION;
use crate::error::PlanError;
use crate::request::Request;
use crate::sight::{self, Place};
use abbe_measurement::planned::{Goal, Lines, Motion, Stand, Tracer};

/// Most stations that a plan may have.
const MOST_STATIONS: usize = 12;
/// Fewest and most points of a line.
const POINTS: (u32, u32) = (5, 200);
/// Fastest feed (m/s): no measuring machine is driven faster.
const FASTEST_M_S: f64 = 10.0;
/// Shortest period of a sensor (s): points follow each other no faster.
const SHORTEST_PERIOD_S: f64 = 1.0;
/// Most levels of lines along an axis.
const MOST_LEVELS: usize = 9;

/// Refuses a request that makes no sense.
///
/// # Errors
/// Names the key of the request file, what is wrong with it, and what to do.
pub fn check(request: &Request) -> Result<(), PlanError> {
    check_volume(request)?;
    check_tracer(&request.tracer)?;
    check_holders(request)?;
    check_stands(request)?;
    check_motion(&request.motion)?;
    check_lines(request)?;
    check_goal(request)
}

pub(crate) fn wrong(key: impl Into<String>, problem: impl Into<String>, remedy: impl Into<String>) -> PlanError {
    PlanError::Request { key: key.into(), problem: problem.into(), remedy: remedy.into() }
}

fn check_volume(request: &Request) -> Result<(), PlanError> {
    for (axis, ((low_m, high_m), (lower_m, upper_m))) in
        ['X', 'Y', 'Z'].into_iter().zip(request.volume_m.into_iter().zip(request.machine.stroke_m))
    {
        let key = format!("volume_mm.{axis}");
        let (low_mm, high_mm, lower_mm, upper_mm) = (low_m * 1e3, high_m * 1e3, lower_m * 1e3, upper_m * 1e3);
        if !(low_m.is_finite() && high_m.is_finite() && low_m < high_m) {
            return Err(wrong(
                key,
                format!("{low_mm} ... {high_mm} is no range"),
                "give the lower, then the upper end",
            ));
        }
        if low_m < lower_m || high_m > upper_m {
            return Err(wrong(
                key,
                format!(
                    "{low_mm} ... {high_mm} mm is beyond the stroke {lower_mm} ... {upper_mm} mm: the machine cannot reach it"
                ),
                "keep the volume within stroke_mm of the machine file",
            ));
        }
        if high_m - low_m < 0.05 * (upper_m - lower_m) {
            return Err(wrong(
                key,
                format!("{low_mm} ... {high_mm} mm is less than a twentieth of the stroke"),
                "plan for a larger volume: the errors of an axis cannot be told from so little of it",
            ));
        }
    }
    Ok(())
}

fn check_tracer(tracer: &Tracer) -> Result<(), PlanError> {
    let positive = |value: f64| value.is_finite() && value > 0.0;
    if !positive(tracer.nearest_m) {
        let problem = format!("{} is not above 0", tracer.nearest_m * 1e3);
        return Err(wrong("tracer.nearest_mm", problem, "give the radius of the blind zone from its data sheet"));
    }
    if !positive(tracer.farthest_m) || tracer.farthest_m <= tracer.nearest_m {
        let problem = format!("{} is not beyond nearest_mm", tracer.farthest_m * 1e3);
        return Err(wrong("tracer.farthest_mm", problem, "give the tracer's range from its data sheet"));
    }
    let (low, high) = tracer.elevation_rad;
    let right = std::f64::consts::FRAC_PI_2 + 1e-9;
    if !(low >= -right && high <= right && low < high) {
        let problem = format!("{:.1} ... {:.1} is no range of elevations", low.to_degrees(), high.to_degrees());
        return Err(wrong("tracer.elevation_deg", problem, "give two angles from -90 to 90, the lower one first"));
    }
    Ok(())
}

fn check_stands(request: &Request) -> Result<(), PlanError> {
    if request.stands.is_empty() {
        return Err(wrong("stands", "there is none", "give [[stand]] entries or a [region]"));
    }
    if !(1..=MOST_STATIONS).contains(&request.most_stations) {
        let problem = format!("{} is not 1 to {MOST_STATIONS}", request.most_stations);
        return Err(wrong("most_stations", problem, "give the number of stations that you would set up at most"));
    }
    for (k, stand) in request.stands.iter().enumerate() {
        if let Some(problem) = no_name(&stand.name) {
            let remedy = "give a name of letters, digits, - and _";
            return Err(wrong(format!("stand[{k}].name"), problem, remedy));
        }
        let key = format!("stand[{k}] {}", stand.name);
        if !stand.position_m.iter().all(|v| v.is_finite()) {
            return Err(wrong(key, "its position is not finite", "give x, y, z in millimetres"));
        }
        if !stand.of_region {
            check_place(request, stand, &key)?;
        }
        if request.stands[..k].iter().any(|other| other.name == stand.name) {
            return Err(wrong(key, "two stands have this name", "give each its own"));
        }
    }
    Ok(())
}

/// Why a text cannot be a name in the files of a campaign.
fn no_name(text: &str) -> Option<String> {
    if text.trim().is_empty() {
        return Some("there is no name".to_owned());
    }
    if text.trim() != text {
        return Some(format!("{text:?} begins or ends with a blank"));
    }
    let is_wrong = |c: char| matches!(c, ',' | ';' | '"' | '\'') || c.is_control();
    text.contains(is_wrong).then(|| format!("{text:?} has a comma, semicolon, quote or line break"))
}

/// A stand that somebody named must be one.
fn check_place(request: &Request, stand: &Stand, key: &str) -> Result<(), PlanError> {
    let nearest_mm = request.tracer.nearest_m * 1e3;
    match sight::place(request, stand.position_m) {
        Place::Free => Ok(()),
        Place::Inside => Err(wrong(
            key,
            "the tracer would stand inside the volume that the reflector moves in",
            "move it out, or plan for a smaller volume",
        )),
        Place::Blind => Err(wrong(
            key,
            format!("the reflector comes nearer than the blind zone of {nearest_mm:.0} mm with every holder"),
            format!("move it {nearest_mm:.0} mm or more away from the volume that the reflector moves in"),
        )),
    }
}

fn check_holders(request: &Request) -> Result<(), PlanError> {
    if request.tips_m.is_empty() || !request.tips_m.iter().flatten().all(|v| v.is_finite()) {
        return Err(wrong(
            "tips_mm",
            "holds no offset",
            "give the offsets of the tips that you measure with, or leave it out",
        ));
    }
    let longest_m = request.machine.stroke_m.iter().map(|(low_m, high_m)| high_m - low_m).fold(0.0, f64::max);
    let too_long = |offset_m: &[f64; 3]| {
        let length_m = offset_m.iter().map(|v| v * v).sum::<f64>().sqrt();
        let (length_mm, longest_mm) = (length_m * 1e3, longest_m * 1e3);
        (length_m > longest_m)
            .then(|| format!("an offset of {length_mm} mm is longer than the largest stroke, {longest_mm:.0} mm"))
    };
    if let Some(problem) = request.tips_m.iter().find_map(too_long) {
        return Err(wrong("tips_mm", problem, "give x, y, z from the ram reference point in millimetres"));
    }
    if request.holders.is_empty() {
        return Err(wrong("holder", "there is none", "give a [[holder]] with the offset_mm of the reflector"));
    }
    for (k, holder) in request.holders.iter().enumerate() {
        let key = format!("holder[{k}]");
        if !holder.offset_m.iter().all(|v| v.is_finite() && v.abs() < 5.0) {
            return Err(wrong(key, "offset_mm is not an offset on a ram", "give x, y, z in millimetres"));
        }
        if let Some(problem) = too_long(&holder.offset_m) {
            let remedy = "give x, y, z from the ram reference point in millimetres";
            return Err(wrong(format!("{key}.offset_mm"), problem, remedy));
        }
        if let Some((faces, angle_rad)) = holder.acceptance {
            let length = faces.iter().map(|v| v * v).sum::<f64>().sqrt();
            if !(length.is_finite() && length > 1e-9) {
                return Err(wrong(format!("{key}.faces"), "is no direction", "give x, y, z of where it looks"));
            }
            if !(angle_rad > 0.0 && angle_rad <= std::f64::consts::PI) {
                let problem = format!("{:.1} is not above 0 and up to 180", angle_rad.to_degrees());
                return Err(wrong(format!("{key}.acceptance_deg"), problem, "give the half angle of its data sheet"));
            }
        }
    }
    Ok(())
}

fn check_motion(motion: &Motion) -> Result<(), PlanError> {
    if motion.feeds_m_s.is_empty() || !motion.feeds_m_s.iter().all(|v| v.is_finite() && *v > 0.0) {
        return Err(wrong("motion.feeds_mm_s", "holds no feed above 0", "give at least one feed"));
    }
    if let Some(feed_m_s) = motion.feeds_m_s.iter().find(|v| **v > FASTEST_M_S) {
        let problem = format!("{} mm/s is above {:.0} mm/s", feed_m_s * 1e3, FASTEST_M_S * 1e3);
        return Err(wrong("motion.feeds_mm_s", problem, "give the feeds that the machine is driven at, in mm/s"));
    }
    if !(motion.acceleration_m_s2.is_finite() && motion.acceleration_m_s2 > 0.0) {
        let problem = format!("{} is not above 0", motion.acceleration_m_s2 * 1e3);
        return Err(wrong("motion.acceleration_mm_s2", problem, "give the acceleration of the machine's moves"));
    }
    let times = [
        ("motion.dwell_s", motion.dwell_s),
        ("motion.station_change_s", motion.station_change_s),
        ("motion.holder_change_s", motion.holder_change_s),
    ];
    match times.into_iter().find(|(_, time_s)| !(time_s.is_finite() && *time_s >= 0.0)) {
        Some((key, time_s)) => Err(wrong(key, format!("{time_s} is no time"), "give seconds, 0 or more")),
        None => Ok(()),
    }
}

fn check_lines(request: &Request) -> Result<(), PlanError> {
    let Lines { points: (low, high), levels, .. } = request.lines;
    if low < POINTS.0 || high > POINTS.1 || low > high {
        let problem = format!("{low} ... {high} is not a range within {} ... {}", POINTS.0, POINTS.1);
        return Err(wrong("lines.points", problem, "give the fewest and the most points of a line"));
    }
    if !(2..=MOST_LEVELS).contains(&levels) {
        let problem = format!("{levels} is not 2 to {MOST_LEVELS}");
        return Err(wrong("lines.levels", problem, "3 has lines at both ends and in the middle"));
    }
    for (k, sensor) in request.sensors.iter().enumerate() {
        let (low, high) = sensor.range;
        if !(low.is_finite() && high.is_finite() && low < high && sensor.period_s > 0.0 && sensor.period_s.is_finite())
        {
            let problem = format!("{} goes from {low} to {high} in {} s", sensor.name, sensor.period_s);
            return Err(wrong(format!("sensor[{k}]"), problem, "give the lower, then the upper value, and a period"));
        }
        if sensor.period_s < SHORTEST_PERIOD_S {
            let problem = format!("a period of {} s is shorter than the time between two points", sensor.period_s);
            return Err(wrong(format!("sensor[{k}].period_h"), problem, "give the time from high to high, in hours"));
        }
        check_sensor_name(request, k)?;
    }
    Ok(())
}

/// A sensor is a column of the campaign, beside those that the plan has by itself.
fn check_sensor_name(request: &Request, number: usize) -> Result<(), PlanError> {
    let name = &request.sensors[number].name;
    let key = format!("sensor[{number}].name");
    if let Some(problem) = no_name(name) {
        return Err(wrong(key, problem, "give the name of the column that will be logged, such as t_room_c"));
    }
    if request.sensors[..number].iter().any(|other| other.name == *name) {
        return Err(wrong(key, format!("two sensors have the name {name}"), "give each its own"));
    }
    if MOTION.contains(&name.as_str()) {
        let problem = format!("{name} is a column that the plan fills from the motion");
        return Err(wrong(key, problem, "remove this sensor, or give it another name"));
    }
    Ok(())
}

fn check_goal(request: &Request) -> Result<(), PlanError> {
    let Goal { uncertainty_m, budget_s } = request.goal;
    if uncertainty_m.is_none() && budget_s.is_none() {
        return Err(wrong("goal", "there is none", "give uncertainty_um, budget_h, or both"));
    }
    if let Some(budget_s) = budget_s.filter(|s| !(s.is_finite() && *s > 0.0)) {
        return Err(wrong("goal.budget_h", format!("{} is no time", budget_s / 3600.0), "give hours above 0"));
    }
    let Some(wanted_m) = uncertainty_m else { return Ok(()) };
    if !wanted_m.is_finite() {
        let problem = format!("{} is no uncertainty", wanted_m * 1e6);
        return Err(wrong("goal.uncertainty_um", problem, "give micrometres, or leave it out and give budget_h"));
    }
    let floor_m = request.repeatability_m2().sqrt();
    if wanted_m <= floor_m {
        return Err(wrong(
            "goal.uncertainty_um",
            format!(
                "{:.3} µm is not above the machine's own repeatability, {:.3} µm in space",
                wanted_m * 1e6,
                floor_m * 1e6
            ),
            "no plan reaches it; ask for more, or correct repeatability_um in the machine file",
        ));
    }
    Ok(())
}
