//! Effects that 21 error functions lack, to be injected into a simulated campaign: one effect, one file.
//!
//! Place in the flow: [`crate::simulate`] hands every effect the [`Moment`] of a reading; the effect moves a
//! joint, the tip, the station or the range. Each has its own formula and its own size, in SI. None of them
//! shares a line with the project's models of the same effects: they are the truth those are tested against.
//! Adding one: a file here with a type that implements [`Effect`], and an entry in the list of [`from_text`].

mod acceleration;
mod backlash;
mod beam_gradient;
mod bow;
mod carriage_twist;
mod column_bow;
mod dead_path;
mod gimbal;
mod hysteresis;
mod incidence;
mod lagged_expansion;
mod moisture_bow;
mod onset;
mod outlying_run;
mod periodic;
mod reflector_offset;
mod refraction;
mod registry;
mod sag;
mod scale_expansion;
mod screw;
mod speed_lag;
mod splice;
mod stand_jump;
mod station_drift;
mod table_load;
mod text;
mod undescribed;
mod warm_up;
mod wear;
mod zero_jump;

use std::fmt::Debug;

pub use acceleration::Acceleration;
pub use backlash::Backlash;
pub use beam_gradient::BeamGradient;
pub use bow::GradientBow;
pub use carriage_twist::CarriageTwist;
pub use column_bow::ColumnBow;
pub use dead_path::DeadPath;
pub use gimbal::Gimbal;
pub use hysteresis::Hysteresis;
pub use incidence::ReflectorIncidence;
pub use lagged_expansion::LaggedExpansion;
pub use moisture_bow::MoistureBow;
pub use onset::Onset;
pub use outlying_run::OutlyingRun;
pub use periodic::PeriodicScale;
pub use reflector_offset::ReflectorOffset;
pub use refraction::Refraction;
pub use registry::{examples, from_text};
pub use sag::CarriageSag;
pub use scale_expansion::ScaleExpansion;
pub use screw::Screw;
pub use speed_lag::SpeedLag;
pub use splice::Splice;
pub use stand_jump::StandJump;
pub use station_drift::StationDrift;
pub use table_load::TableLoad;
pub use undescribed::Undescribed;
pub use warm_up::WarmUp;
pub use wear::Wear;
pub use zero_jump::ZeroJump;

use crate::environment::{Environment, EnvironmentState, SENSOR_NAMES};
use crate::error::SimulationError;
use crate::logged::covariate_names;
use crate::machine::JointErrors;
use crate::plan::Plan;

/// What an effect knows about one standstill of the machine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment<'a> {
    /// Seconds since the campaign began.
    pub time_s: f64,
    /// Axis readings (m).
    pub reading_m: [f64; 3],
    /// Strokes (m).
    pub stroke_m: [[f64; 2]; 3],
    /// Reflector offset (m, ram frame).
    pub offset_m: [f64; 3],
    /// Sign of the last move of each axis.
    pub direction: [f64; 3],
    /// Feed of the last move (m/s).
    pub feed_m_s: f64,
    /// Last acceleration of each axis (m/s²).
    pub acceleration_m_s2: [f64; 3],
    /// Load on the table (kg).
    pub load_kg: f64,
    /// True state of the environment, not what the sensors show.
    pub environment: EnvironmentState,
    /// The room, for what follows it slowly.
    pub room: &'a Environment,
    /// Readings of all standstills so far, this one last (m), for what remembers the way.
    pub path_m: &'a [[f64; 3]],
}

impl Moment<'_> {
    /// Reading of an axis as a fraction of its stroke.
    pub fn stroke_fraction(&self, axis: usize) -> f64 {
        let [start, end] = self.stroke_m[axis];
        (self.reading_m[axis] - start) / (end - start)
    }

    /// A quantity by the name of its campaign column (in that column's unit), `None` for an unknown name.
    pub fn quantity(&self, name: &str) -> Option<f64> {
        if let Some(place) = SENSOR_NAMES.iter().position(|n| *n == name) {
            return Some(self.environment.values[place]);
        }
        Some(match name {
            "time_s" => self.time_s,
            "x_mm" => self.reading_m[0] * 1e3,
            "y_mm" => self.reading_m[1] * 1e3,
            "z_mm" => self.reading_m[2] * 1e3,
            "dir_x" => self.direction[0],
            "dir_y" => self.direction[1],
            "dir_z" => self.direction[2],
            "speed_mm_s" => self.feed_m_s * 1e3,
            "acc_x_mm_s2" => self.acceleration_m_s2[0] * 1e3,
            "acc_y_mm_s2" => self.acceleration_m_s2[1] * 1e3,
            "acc_z_mm_s2" => self.acceleration_m_s2[2] * 1e3,
            "load_kg" => self.load_kg,
            _ => return None,
        })
    }
}

/// Whether [`Moment::quantity`] knows a name.
fn known_quantity(name: &str) -> bool {
    const OTHERS: [&str; 4] = ["time_s", "x_mm", "y_mm", "z_mm"];
    OTHERS.contains(&name) || covariate_names().any(|known| known == name)
}

/// The tracer and its beam at one reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beam {
    /// Index of the station.
    pub station: u32,
    /// Index of the line, counted through the whole plan.
    pub line: u32,
    /// Seconds since the station's first reading.
    pub time_on_station_s: f64,
    /// Distance from station to reflector (m).
    pub range_m: f64,
    /// Path in the instrument that the counter does not see (m).
    pub dead_path_m: f64,
    /// Unit vector from the station to the reflector (machine frame).
    pub toward_reflector: [f64; 3],
}

/// Physics that the 21 errors do not describe. Every contribution is actual − indicated.
pub trait Effect: Debug + Send + Sync {
    /// Short name for reports and error keys.
    fn name(&self) -> &'static str;

    /// Refuses settings that make no sense.
    ///
    /// # Errors
    /// Names the key of the first one.
    fn check(&self) -> Result<(), SimulationError>;

    /// Refuses settings that do not fit the plan.
    ///
    /// # Errors
    /// Names the key of the first one.
    fn check_plan(&self, _plan: &Plan) -> Result<(), SimulationError> {
        Ok(())
    }

    /// Adds what moves joints or the tip.
    fn disturb_machine(&self, _moment: &Moment, _errors: &mut JointErrors) {}

    /// Displacement of the station from its place at its first reading (m, machine frame).
    fn station_shift_m(&self, _moment: &Moment, _station: u32, _time_on_station_s: f64) -> [f64; 3] {
        [0.0; 3]
    }

    /// What the counter shows beyond the distance between station and reflector (m).
    fn range_shift_m(&self, _moment: &Moment, _beam: &Beam) -> f64 {
        0.0
    }
}
