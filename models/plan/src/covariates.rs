//! A plan as a campaign of nominal readings, with what will be logged beside them.
//!
//! Place in the flow: rows of the search and the statement of the finished plan are made from it; lengths are zero and play no
//! part. Columns as the simulator and machines log them: directions of approach, speed, acceleration, and the sensors that the
//! request expects. Covariates in the unit of their names.

use crate::candidates::Candidate;
use crate::request::Request;
use abbe_measurement::campaign::{Campaign, Covariate, RangeReading};
use abbe_measurement::planned::Sensor;

/// Columns of the motion.
pub(crate) const MOTION: [&str; 7] =
    ["dir_x", "dir_y", "dir_z", "speed_mm_s", "acc_x_mm_s2", "acc_y_mm_s2", "acc_z_mm_s2"];
/// Phase between two sensors of one period (rad): they must not say the same.
const PHASE_RAD: f64 = 1.3;

/// One planned reading.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Planned {
    pub(crate) station: u32,
    pub(crate) line: u32,
    pub(crate) time_s: f64,
    pub(crate) reading_m: [f64; 3],
    pub(crate) offset_m: [f64; 3],
    /// Move by which it is reached (m).
    pub(crate) moved_m: [f64; 3],
    pub(crate) feed_m_s: f64,
}

/// A campaign of planned readings.
pub(crate) fn campaign(
    request: &Request,
    (stations, lines): (Vec<String>, Vec<String>),
    planned: &[Planned],
) -> Campaign {
    let readings = planned.iter().map(|p| RangeReading {
        station: p.station,
        line: p.line,
        time_s: p.time_s,
        reading_m: p.reading_m,
        offset_m: p.offset_m,
        length_m: 0.0,
    });
    let motion = MOTION.iter().enumerate().map(|(k, name)| Covariate {
        name: (*name).to_owned(),
        values: planned.iter().map(|p| Some(of_motion(request, p)[k])).collect(),
    });
    let sensors = request.sensors.iter().enumerate().map(|(k, sensor)| Covariate {
        name: sensor.name.clone(),
        values: planned.iter().map(|p| Some(expected(sensor, k, p.time_s))).collect(),
    });
    Campaign { stations, lines, readings: readings.collect(), covariates: motion.chain(sensors).collect() }
}

/// Directions, speed (mm/s) and accelerations (mm/s²) of a reading.
pub(crate) fn of_motion(request: &Request, planned: &Planned) -> [f64; 7] {
    let distance_m = planned.moved_m.iter().map(|v| v * v).sum::<f64>().sqrt();
    let sign = |v: f64| if v == 0.0 { 0.0 } else { v.signum() };
    let share = |v: f64| if distance_m > 0.0 { v / distance_m } else { 0.0 };
    let mut values = [0.0; 7];
    for d in 0..3 {
        values[d] = sign(planned.moved_m[d]);
        values[4 + d] = request.motion.acceleration_m_s2 * 1e3 * share(planned.moved_m[d]);
    }
    values[3] = planned.feed_m_s * 1e3;
    values
}

fn expected(sensor: &Sensor, number: usize, time_s: f64) -> f64 {
    let (low, high) = sensor.range;
    let turn = std::f64::consts::TAU * time_s / sensor.period_s + PHASE_RAD * number as f64;
    0.5 * (low + high) + 0.5 * (high - low) * turn.cos()
}

/// The readings of one candidate as a campaign of its own, each point reached along the line.
pub(crate) fn of_candidate(request: &Request, candidate: &Candidate) -> Campaign {
    let [from_m, to_m] = candidate.ends_m;
    let planned: Vec<Planned> = candidate
        .readings_m()
        .map(|reading_m| Planned {
            station: 0,
            line: 0,
            time_s: 0.0,
            reading_m,
            offset_m: request.holders[candidate.holder].offset_m,
            moved_m: std::array::from_fn(|d| to_m[d] - from_m[d]),
            feed_m_s: candidate.feed_m_s,
        })
        .collect();
    let station = request.stands[candidate.stand].name.clone();
    campaign(request, (vec![station], vec!["line".to_owned()]), &planned)
}
