//! Request files of `abbe plan`: what there is and what is wanted, TOML to SI.
//!
//! Place in the flow: `abbe plan --request` → here → the request of planning, together with the machine file. Millimetres,
//! micrometres, microradians, degrees and hours with the unit in the key; unknown keys are refused with their line. What makes
//! no sense is refused by planning under the key of the file, which [`PlanRequestFile::place`] finds.

use crate::campaign_csv::KNOWN;
use crate::error::{FileError, Place};
use crate::toml_place::{line_of, syntax};
use abbe_geometry::effects::{Shape, ShapeValue, Wish};
use abbe_measurement::planned::{Goal, Holder, Lines, Motion, Sensor, Stand, Tracer};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Stations at most where the file does not say.
const USUAL_STATIONS: usize = 6;
/// Most stands of a region.
const MOST_STANDS: usize = 400;
const SEE: &str = "the page on planning in the handbook has a whole request";

/// What a request file says, in SI.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanRequestFile {
    /// Scale readings of the volume (m); `None` for all of the stroke.
    pub volume_m: Option<[(f64, f64); 3]>,
    /// Offsets of the tips that matter (m, ram frame); `None` for those of the holders.
    pub tips_m: Option<Vec<[f64; 3]>>,
    /// What the tracer can follow.
    pub tracer: Tracer,
    /// Where it may stand.
    pub stands: Vec<Stand>,
    /// Most stations.
    pub most_stations: usize,
    /// Where the reflector may sit.
    pub holders: Vec<Holder>,
    /// Speeds and times.
    pub motion: Motion,
    /// Candidate lines.
    pub lines: Lines,
    /// What is wanted.
    pub goal: Goal,
    /// Effects to be told.
    pub tell: Vec<Wish>,
    /// What will be logged.
    pub sensors: Vec<Sensor>,
    /// Bend of straightness (m), positioning (m) and angles (rad) that is expected, rms about a straight line.
    pub expected: Option<[f64; 3]>,
    /// Seed.
    pub seed: u64,
    text: String,
    file: String,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    seed: Option<u64>,
    most_stations: Option<usize>,
    tips_mm: Option<Vec<[f64; 3]>>,
    volume_mm: Option<Box3>,
    goal: GoalText,
    tracer: TracerText,
    #[serde(default)]
    stand: Vec<StandText>,
    region: Option<RegionText>,
    holder: Vec<HolderText>,
    motion: MotionText,
    lines: Option<LinesText>,
    expected: Option<ExpectedText>,
    #[serde(default)]
    tell: Vec<TellText>,
    #[serde(default)]
    sensor: Vec<SensorText>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case)] // the keys of the file
struct Box3 {
    X: [f64; 2],
    Y: [f64; 2],
    Z: [f64; 2],
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct GoalText {
    uncertainty_um: Option<f64>,
    budget_h: Option<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TracerText {
    nearest_mm: f64,
    farthest_mm: f64,
    elevation_deg: [f64; 2],
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct StandText {
    name: String,
    position_mm: [f64; 3],
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case)] // the keys of the file
struct RegionText {
    X: [f64; 2],
    Y: [f64; 2],
    Z: [f64; 2],
    steps: [usize; 3],
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct HolderText {
    offset_mm: [f64; 3],
    faces: Option<[f64; 3]>,
    acceptance_deg: Option<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct MotionText {
    feeds_mm_s: Vec<f64>,
    acceleration_mm_s2: f64,
    dwell_s: f64,
    station_change_s: f64,
    holder_change_s: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LinesText {
    points: [u32; 2],
    levels: usize,
    diagonals: bool,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ExpectedText {
    straightness_um: f64,
    positioning_um: f64,
    angle_urad: f64,
}

#[derive(Debug, Deserialize)]
struct TellText {
    effect: String,
    #[serde(flatten)]
    shape: BTreeMap<String, toml::Value>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorText {
    name: String,
    range: [f64; 2],
    period_h: f64,
}

/// Reads a request file.
///
/// # Errors
/// A file that cannot be read, a key that is unknown or missing, a value of another kind: with line and key.
pub fn read_plan_request(path: &Path) -> Result<PlanRequestFile, FileError> {
    let file = path.display().to_string();
    let bytes = std::fs::read(path).map_err(FileError::io(&file, "read the request file"))?;
    let text = String::from_utf8(bytes)
        .map_err(|_| FileError::content(Place::file(&file), "the text is not UTF-8", "save the file as UTF-8"))?;
    parse_plan_request(&text, &file)
}

/// Checks the text of a request file; `file` is its name in messages.
///
/// # Errors
/// As [`read_plan_request`].
pub fn parse_plan_request(text: &str, file: &str) -> Result<PlanRequestFile, FileError> {
    let text = text.trim_start_matches('\u{feff}');
    let document: Document = toml::from_str(text).map_err(|error| syntax(text, file, &error, SEE))?;
    let wrong = |path: &[&str], problem: &str, remedy: &str| {
        let mut place = Place::file(file).key(&path.join("."));
        place.line = line_of(text, path);
        FileError::content(place, problem, remedy)
    };
    let mut stands: Vec<Stand> = document.stand.into_iter().map(stand).collect();
    if let Some(region) = document.region {
        let count: usize = region.steps.iter().fold(1, |all, steps| all.saturating_mul(*steps));
        if count == 0 || count > MOST_STANDS {
            let problem = format!("{count} places are none, or more than {MOST_STANDS}");
            return Err(wrong(&["region", "steps"], &problem, "give the number of places along X, Y and Z"));
        }
        stands.extend(places(&region));
    }
    let mut holders = Vec::new();
    for (k, holder) in document.holder.into_iter().enumerate() {
        let acceptance = match (holder.faces, holder.acceptance_deg) {
            (Some(faces), Some(angle_deg)) => Some((faces, angle_deg.to_radians())),
            (None, None) => None,
            _ => {
                let path = ["holder", &k.to_string(), "offset_mm"];
                return Err(wrong(&path, "faces and acceptance_deg belong together", "give both, or neither"));
            }
        };
        holders.push(Holder { offset_m: metres(holder.offset_mm), acceptance });
    }
    let mut tell = Vec::new();
    for (k, wish) in document.tell.into_iter().enumerate() {
        let mut shape = Shape::new();
        for (key, value) in wish.shape {
            let path = ["tell", &k.to_string(), &key];
            let value = value_of(value).ok_or_else(|| wrong(&path, "is no number or text", "see `abbe diagnose`"))?;
            shape.0.insert(key.clone(), value);
        }
        tell.push(Wish { name: wish.effect, shape });
    }
    for (k, sensor) in document.sensor.iter().enumerate() {
        if KNOWN.iter().any(|known| known.name == sensor.name) {
            let problem = format!("{} is a column that every campaign has by itself", sensor.name);
            return Err(wrong(&["sensor", &k.to_string(), "name"], &problem, "give the sensor another name"));
        }
    }
    let lines = document.lines.unwrap_or(LinesText { points: [12, 19], levels: 3, diagonals: true });
    let [low, high] = document.tracer.elevation_deg;
    Ok(PlanRequestFile {
        volume_m: document.volume_mm.map(|v| [v.X, v.Y, v.Z].map(|[low, high]| (low / 1e3, high / 1e3))),
        tips_m: document.tips_mm.map(|tips| tips.into_iter().map(metres).collect()),
        tracer: Tracer {
            nearest_m: document.tracer.nearest_mm / 1e3,
            farthest_m: document.tracer.farthest_mm / 1e3,
            elevation_rad: (low.to_radians(), high.to_radians()),
        },
        stands,
        most_stations: document.most_stations.unwrap_or(USUAL_STATIONS),
        holders,
        motion: motion(document.motion),
        lines: Lines { points: (lines.points[0], lines.points[1]), levels: lines.levels, diagonals: lines.diagonals },
        goal: Goal {
            uncertainty_m: document.goal.uncertainty_um.map(|um| um / 1e6),
            budget_s: document.goal.budget_h.map(|h| h * 3600.0),
        },
        tell,
        sensors: document.sensor.into_iter().map(sensor).collect(),
        expected: document.expected.map(|e| [e.straightness_um / 1e6, e.positioning_um / 1e6, e.angle_urad / 1e6]),
        seed: document.seed.unwrap_or(1),
        text: text.to_owned(),
        file: file.to_owned(),
    })
}

impl PlanRequestFile {
    /// Where the file has a key as planning names it in what it refuses, such as `goal.budget_h` or `stand[2] S3`.
    pub fn place(&self, key: &str) -> Place {
        let path: Vec<String> = key
            .split('.')
            .flat_map(|part| {
                let part = part.split(' ').next().unwrap_or_default();
                let (name, index) = part.split_once('[').unwrap_or((part, ""));
                [name.to_owned(), index.trim_end_matches(']').to_owned()]
            })
            .filter(|part| !part.is_empty())
            .collect();
        let path: Vec<&str> = path.iter().map(String::as_str).collect();
        let mut place = Place::file(&self.file).key(key);
        place.line = line_of(&self.text, &path);
        place
    }
}

fn metres(mm: [f64; 3]) -> [f64; 3] {
    mm.map(|v| v / 1e3)
}

fn stand(text: StandText) -> Stand {
    Stand { name: text.name, position_m: metres(text.position_mm), of_region: false }
}

fn places(region: &RegionText) -> Vec<Stand> {
    let at = |[low, high]: [f64; 2], step: usize, steps: usize| {
        let share = if steps > 1 { step as f64 / (steps - 1) as f64 } else { 0.5 };
        (low + share * (high - low)) / 1e3
    };
    let [nx, ny, nz] = region.steps;
    let place = |k: usize| Stand {
        name: format!("R{}", k + 1),
        position_m: [at(region.X, k % nx, nx), at(region.Y, k / nx % ny, ny), at(region.Z, k / (nx * ny), nz)],
        of_region: true,
    };
    (0..nx * ny * nz).map(place).collect()
}

fn motion(text: MotionText) -> Motion {
    Motion {
        feeds_m_s: text.feeds_mm_s.into_iter().map(|feed| feed / 1e3).collect(),
        acceleration_m_s2: text.acceleration_mm_s2 / 1e3,
        dwell_s: text.dwell_s,
        station_change_s: text.station_change_s,
        holder_change_s: text.holder_change_s,
    }
}

fn sensor(text: SensorText) -> Sensor {
    Sensor { name: text.name, range: (text.range[0], text.range[1]), period_s: text.period_h * 3600.0 }
}

fn value_of(value: toml::Value) -> Option<ShapeValue> {
    match value {
        toml::Value::String(text) => Some(ShapeValue::Text(text)),
        toml::Value::Float(number) => Some(ShapeValue::Number(number)),
        toml::Value::Integer(number) => Some(ShapeValue::Number(number as f64)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "\
[goal]
budget_h = 4
[tracer]
nearest_mm = 100
farthest_mm = 10000
elevation_deg = [-35, 80]
[region]
X = [-300, 1100]
Y = [-300, 900]
Z = [-100, -100]
steps = [3, 2, 1]
[[stand]]
name = \"corner\"
position_mm = [-200, -250, -250]
[[holder]]
offset_mm = [0, 0, -60]
faces = [1, 0, 0]
acceptance_deg = 90
[motion]
feeds_mm_s = [50]
acceleration_mm_s2 = 300
dwell_s = 3
station_change_s = 900
holder_change_s = 60
[[tell]]
effect = \"reversal\"
axis = \"x\"
";

    #[test]
    fn a_request_is_read_into_si_and_its_keys_are_found_again() {
        let request = parse_plan_request(TEXT, "r.toml").unwrap();
        assert_eq!(request.goal, Goal { uncertainty_m: None, budget_s: Some(14400.0) });
        assert_eq!(request.stands.len(), 7);
        assert_eq!(request.stands[0].position_m, [-0.2, -0.25, -0.25]);
        assert_eq!(request.stands[3].position_m, [1.1, -0.3, -0.1]);
        assert!((request.holders[0].acceptance.unwrap().1 - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
        assert_eq!(request.tell[0].shape.0["axis"], ShapeValue::Text("x".to_owned()));
        assert_eq!(request.place("goal.budget_h").line, Some(2));
        assert_eq!(request.place("stand[0] corner").line, Some(12));
        assert_eq!(request.place("holder[0].acceptance_deg").line, Some(18));
    }

    #[test]
    fn unknown_missing_and_half_given_keys_are_refused_with_their_line() {
        let said = |text: &str| parse_plan_request(text, "r.toml").unwrap_err().to_string();
        assert!(said(&TEXT.replace("dwell_s", "dwel_s")).contains("dwel_s"));
        assert!(said(&TEXT.replace("budget_h = 4", "budget_h = \"4\"")).contains("line 2"));
        assert!(said(&TEXT.replace("acceptance_deg = 90\n", "")).contains("belong together"));
        assert!(said(&TEXT.replace("[3, 2, 1]", "[300, 200, 1]")).contains("60000"));
    }

    #[test]
    fn regress_a_sensor_with_the_name_of_a_campaign_column_is_refused_with_its_line() {
        for name in ["length_mm", "x_mm", "offset_z_mm", "time_s", "station"] {
            let text = format!("{TEXT}[[sensor]]\nname = \"{name}\"\nrange = [19, 21]\nperiod_h = 1\n");
            let said = parse_plan_request(&text, "r.toml").unwrap_err().to_string();
            assert!(["line 29", "sensor.0.name", name].iter().all(|part| said.contains(part)), "{said}");
        }
    }
}
