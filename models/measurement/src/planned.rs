//! A planned campaign: what there is to measure with, what is wanted, and the stations and lines to measure.
//!
//! Place in the flow: read from a request file, taken by planning, written as a path and as programs for controls. Pure data, SI, machine frame.

/// A place where the tracer may stand: the centre of its reference sphere.
#[derive(Debug, Clone, PartialEq)]
pub struct Stand {
    /// Name.
    pub name: String,
    /// Centre (m, machine frame: the workpiece side).
    pub position_m: [f64; 3],
    /// One of many in a region: passed over where the reflector would run into it, instead of refused.
    pub of_region: bool,
}

/// A place of the reflector on the ram.
#[derive(Debug, Clone, PartialEq)]
pub struct Holder {
    /// Reflector relative to the ram reference point (m, ram frame).
    pub offset_m: [f64; 3],
    /// Where the reflector looks (any length, ram frame) and up to which angle from there it sends the beam back (rad); `None`
    /// for one that does so all around.
    pub acceptance: Option<([f64; 3], f64)>,
}

/// What the tracer can follow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tracer {
    /// Nearest distance of the reflector, the radius of the blind zone (m).
    pub nearest_m: f64,
    /// Farthest distance (m).
    pub farthest_m: f64,
    /// Lowest and highest elevation of the beam above the horizontal plane (rad), Z being up.
    pub elevation_rad: (f64, f64),
}

/// How the machine is driven, and what else takes time.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// Feeds, taken in turn from line to line (m/s).
    pub feeds_m_s: Vec<f64>,
    /// Acceleration and deceleration of each move (m/s²).
    pub acceleration_m_s2: f64,
    /// Standstill at each point (s).
    pub dwell_s: f64,
    /// Time to place the tracer on a station and make it ready (s).
    pub station_change_s: f64,
    /// Time to put the reflector on another holder (s).
    pub holder_change_s: f64,
}

/// Which lines are candidates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lines {
    /// Fewest and most points of a line; drawn by the seed, since equal steps would hide periodic errors.
    pub points: (u32, u32),
    /// Places along each axis at which lines along the others lie.
    pub levels: usize,
    /// Also the diagonals of the volume and of its faces.
    pub diagonals: bool,
}

/// What a plan must come to. Without a budget lines are added until the uncertainty is reached; without an uncertainty the
/// budget is used up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Goal {
    /// Rms over the volume of the standard uncertainty of a corrected point, as a length in space, repeatability included (m).
    pub uncertainty_m: Option<f64>,
    /// Measuring time (s).
    pub budget_s: Option<f64>,
}

/// A quantity that will be logged during the campaign, as it is expected to go: a sine between two values.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensor {
    /// Name of the column, unit as suffix.
    pub name: String,
    /// Lowest and highest value, in that unit.
    pub range: (f64, f64),
    /// Time from high to high (s).
    pub period_s: f64,
}

/// A station of the plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Station {
    /// Name, unique in plan and campaign.
    pub name: String,
    /// Centre of the tracer (m, machine frame).
    pub position_m: [f64; 3],
}

/// A line of the plan, in the order of measurement.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Name, unique in plan and campaign.
    pub name: String,
    /// Index of its station.
    pub station: usize,
    /// Index of its holder in the request.
    pub holder: usize,
    /// Reflector (m, ram frame).
    pub offset_m: [f64; 3],
    /// Readings to go through before its first point, so that the beam is not lost (m).
    pub via_m: Vec<[f64; 3]>,
    /// Readings of its points (m), first to last.
    pub points_m: Vec<[f64; 3]>,
    /// Time of each point (s since the campaign began).
    pub times_s: Vec<f64>,
    /// Feed on the line (m/s).
    pub feed_m_s: f64,
}
