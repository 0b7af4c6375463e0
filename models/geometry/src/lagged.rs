//! Lagged quantities: what follows a logged one with a time constant, as a structure follows the temperature of its air, or what is ahead
//! of it, where its sensor is what follows.
//!
//! Place in the flow: effects read a lagged quantity like any other covariate, by its name; [`Lag`] makes its values from those of
//! the logged one, for the rows of a campaign, of a table of points and of a live stream alike. `temp_air_lag_1800s_c` is
//! `temp_air_c` behind a time constant of 1800 s, `temp_air_lead_600s_c` what a sensor that lags by 600 s wrote down as `temp_air_c`: the
//! unit stays the end of the name. A time constant below zero is ahead.
//! Formula: behind, τ dy/dt = u − y, solved exactly for u that runs straight from one value to the next. Ahead, y = u + τ du/dt, with the
//! level and the slope of the parabola through what was logged so far, weighted by exp(−age / ε), ε = τ/10 (Brown 1963, triple exponential
//! smoothing): a parabola comes out exactly, and a sensor's noise is averaged over some ε. Nobody logged what was before the first
//! value: y begins there, and has forgotten it after three time constants, or six ε. Times in s, values in the unit of the name.

/// What stands between the name and its unit, and whether it is behind.
const MARKS: [(&str, bool); 2] = [("_lag_", true), ("_lead_", false)];

/// The name of a quantity behind a time constant of whole seconds, ahead by one below zero; `None` for a name without a unit, or one that
/// has a time constant already.
pub fn lagged_name(name: &str, lag_s: i32) -> Option<String> {
    let (stem, unit) = name.rsplit_once('_')?;
    let (mark, _) = MARKS.into_iter().find(|(_, behind)| *behind == (lag_s > 0))?;
    let is_plain = lag_s != 0 && !stem.is_empty() && !unit.is_empty() && of_lagged(name).is_none();
    is_plain.then(|| format!("{stem}{mark}{}s_{unit}", lag_s.unsigned_abs()))
}

/// The logged quantity behind a lagged one, and its time constant (s, below zero ahead of it); `None` for any other name.
pub fn of_lagged(name: &str) -> Option<(String, i32)> {
    let (rest, unit) = name.rsplit_once('_')?;
    let ((stem, lag), behind) =
        MARKS.into_iter().find_map(|(mark, behind)| rest.rsplit_once(mark).map(|parts| (parts, behind)))?;
    let lag_s: i32 = lag.strip_suffix('s')?.parse().ok().filter(|lag_s| *lag_s > 0)?;
    // "+7s" and "007s" parse as well, and would be other names of the same.
    let is_plain = format!("{lag_s}s") == lag && !stem.is_empty() && !unit.is_empty();
    is_plain.then(|| (format!("{stem}_{unit}"), if behind { lag_s } else { -lag_s }))
}

/// Time constants after which 5 % of a wrong beginning are left.
const SETTLED: f64 = 3.0;
/// What is ahead averages over this share of its time constant: a tenth leaves the least error of a room's temperatures behind 5 to 30
/// min, logged with 5 to 20 mK of noise; a twentieth doubles the noise, a quarter the error of fast changes.
const SHARPNESS: f64 = 0.1;
/// The same in those of the average: three stages, one after the other, forget later.
const SETTLED_AHEAD: f64 = 6.0;

/// Longest pause in which any temperature of a structure or a room is taken to run straight (s): points of a table are minutes apart.
const STRAIGHT_S: f64 = 300.0;

/// A first-order lag, or what is ahead of one.
#[derive(Debug, Clone)]
pub struct Lag {
    tau_s: f64,
    /// Longest pause across which a straight line leads.
    pause_s: f64,
    last: Option<Last>,
}

#[derive(Debug, Clone, Copy)]
struct Last {
    time_s: f64,
    input: f64,
    /// Behind the input, behind that, and once more.
    stages: [f64; 3],
    /// When the history began.
    since_s: f64,
}

/// The lagged value at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lagged {
    /// In the unit of what it follows.
    pub value: f64,
    /// Whether the history is long enough to have forgotten its beginning.
    pub is_settled: bool,
    /// Whether the history began anew: at the first value, after a pause that is too long, or when time went back.
    pub is_new: bool,
}

impl Lag {
    /// A lag of that time constant (s, below zero for what is ahead; not zero), without history. A straight line leads across pauses of up
    /// to five minutes, or of its time constant.
    pub fn new(tau_s: f64) -> Lag {
        Lag::across(tau_s, STRAIGHT_S)
    }

    /// The same for what is looked back at: a straight line leads across pauses of up to `pause_s` (s), or of its time constant. What is not
    /// known of the slope in a pause counts for one time constant, and is forgotten after three.
    pub fn across(tau_s: f64, pause_s: f64) -> Lag {
        Lag { tau_s, pause_s: tau_s.abs().max(pause_s), last: None }
    }

    /// Takes the next value; both numbers must be finite.
    pub fn push(&mut self, time_s: f64, input: f64) -> Lagged {
        let follows = |last: &Last| time_s >= last.time_s && time_s - last.time_s <= self.pause_s;
        let before = self.last.filter(follows);
        let now = match before {
            None => Last { time_s, input, stages: [input; 3], since_s: time_s },
            Some(last) => last.after(time_s, input, self.stage_s()),
        };
        self.last = Some(now);
        let settled = if self.tau_s > 0.0 { SETTLED } else { SETTLED_AHEAD };
        let is_settled = now.time_s - now.since_s >= settled * self.stage_s();
        Lagged { value: self.value(now.stages), is_settled, is_new: before.is_none() }
    }

    /// Time constant of a stage (s).
    fn stage_s(&self) -> f64 {
        if self.tau_s > 0.0 { self.tau_s } else { -SHARPNESS * self.tau_s }
    }

    fn value(&self, [first, second, third]: [f64; 3]) -> f64 {
        if self.tau_s > 0.0 {
            return first;
        }
        // The parabola whose three lags these are.
        let level = 3.0 * (first - second) + third;
        let slope_by_stage = 3.0 * first - 5.0 * second + 2.0 * third;
        level + slope_by_stage / SHARPNESS
    }
}

impl Last {
    /// What follows a value that runs straight from the last to this one, stage by stage.
    fn after(mut self, time_s: f64, input: f64, stage_s: f64) -> Last {
        let share = (time_s - self.time_s) / stage_s;
        let ramp = if share > 0.0 { (-share).exp_m1() / share } else { -1.0 };
        let (mut from, mut to) = (self.input, input);
        for stage in &mut self.stages {
            let now = to + (*stage - from) * (-share).exp() + (to - from) * ramp;
            (from, to) = (*stage, now);
            *stage = now;
        }
        Last { time_s, input, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TAU_S: f64 = 1800.0;

    /// A sine followed for many periods: amplitude and delay of the known answer, whatever the step.
    #[test]
    fn a_sine_comes_out_smaller_and_later() {
        let omega = std::f64::consts::TAU / 7200.0;
        for step_s in [1.0, 13.0, 120.0] {
            let mut lag = Lag::new(TAU_S);
            let mut worst: f64 = 0.0;
            for k in 0..(80_000.0 / step_s) as usize {
                let time_s = k as f64 * step_s;
                let lagged = lag.push(time_s, 20.0 + (omega * time_s).sin());
                let (gain, phase) = ((1.0 + (omega * TAU_S).powi(2)).sqrt().recip(), (omega * TAU_S).atan());
                assert_eq!(lagged.is_settled, time_s >= 3.0 * TAU_S);
                if time_s > 20.0 * TAU_S {
                    worst = worst.max((lagged.value - 20.0 - gain * (omega * time_s - phase).sin()).abs());
                }
            }
            // What remains is the chord below the sine: (ωh)²/12 of it.
            assert!(worst < (omega * step_s).powi(2) / 8.0 + 1e-9, "step {step_s} s: {worst}");
        }
    }

    /// A temperature behind a sensor that lags is found again from what the sensor wrote down, but for what a tenth of the time constant hides.
    #[test]
    fn what_is_ahead_is_what_a_sensor_that_lags_was_told() {
        let omega = std::f64::consts::TAU / 14_400.0;
        for step_s in [1.0, 13.0, 60.0] {
            let (mut sensor, mut ahead) = (Lag::new(900.0), Lag::new(-900.0));
            let (mut worst, mut off): (f64, f64) = (0.0, 0.0);
            for k in 0..(40_000.0 / step_s) as usize {
                let time_s = k as f64 * step_s;
                let room = 20.0 + (omega * time_s).sin();
                let logged = sensor.push(time_s, room).value;
                let found = ahead.push(time_s, logged);
                assert_eq!(found.is_settled, time_s >= 540.0);
                if time_s > 20_000.0 {
                    (worst, off) = (worst.max((found.value - room).abs()), off.max((logged - room).abs()));
                }
            }
            assert!(off > 0.35 && worst < 0.03, "step {step_s} s: {off} without, {worst} with it");
        }
    }

    /// Slope and curvature of what is logged pass whole; the stages have the same parabola.
    #[test]
    fn a_parabola_is_ahead_by_its_slope() {
        let parabola = |time_s: f64| 20.0 + 1e-4 * time_s + 1e-8 * time_s * time_s;
        let mut ahead = Lag::new(-600.0);
        let mut last = 0.0;
        for k in 0..20_000 {
            last = ahead.push(f64::from(k), parabola(f64::from(k))).value;
        }
        let time_s = 19_999.0;
        let expected = parabola(time_s) + 600.0 * (1e-4 + 2e-8 * time_s);
        assert!((last - expected).abs() < 1e-4, "{last} {expected}");
    }

    /// Behind 80 s, of points that are two or three minutes apart none was corrected.
    #[test]
    fn regress_a_short_lag_goes_on_over_points_that_are_minutes_apart() {
        let mut lag = Lag::new(80.0);
        lag.push(0.0, 20.0);
        let next = lag.push(180.0, 20.9);
        assert!(!next.is_new && !next.is_settled, "{next:?}");
        let later = lag.push(360.0, 21.8);
        // 80 s behind a ramp of 5 mK/s, but for what is left of the beginning.
        assert!(later.is_settled && (later.value - (21.8 - 0.4)).abs() < 0.01, "{later:?}");
        assert!(lag.push(661.0, 21.8).is_new);
    }

    #[test]
    fn a_pause_and_a_clock_that_goes_back_begin_anew() {
        let mut lag = Lag::new(TAU_S);
        assert!(lag.push(0.0, 20.0).is_new);
        assert!(!lag.push(1800.0, 21.0).is_new);
        assert!(!lag.push(1800.0, 21.0).is_new, "the same instant again is no pause");
        let after = lag.push(3601.0, 25.0);
        assert!(after.is_new && !after.is_settled && after.value == 25.0);
        assert!(lag.push(3600.0, 25.0).is_new);
        let mut across = Lag::across(600.0, 1800.0);
        across.push(0.0, 20.0);
        let after = across.push(1800.0, 21.8);
        assert!(
            !after.is_new && (after.value - 21.2).abs() < 0.04,
            "a straight line, one time constant behind: {after:?}"
        );
        assert!(across.push(3601.0, 22.0).is_new);
    }

    #[test]
    fn a_lagged_name_keeps_its_unit_and_reads_back() {
        let name = lagged_name("temp_bridge_top_c", 1800).unwrap();
        assert_eq!(name, "temp_bridge_top_lag_1800s_c");
        assert_eq!(of_lagged(&name), Some(("temp_bridge_top_c".to_owned(), 1800)));
        let name = lagged_name("temp_bridge_top_c", -900).unwrap();
        assert_eq!(name, "temp_bridge_top_lead_900s_c");
        assert_eq!(of_lagged(&name), Some(("temp_bridge_top_c".to_owned(), -900)));
    }

    #[test]
    fn what_is_no_lagged_name_is_none() {
        for name in
            ["temp_air_c", "speed_lag_um", "temp_lag_1800_c", "temp_lag_0s_c", "temp_lag_+7s_c", "temp_lag_007s_c"]
        {
            assert_eq!(of_lagged(name), None, "{name}");
        }
        assert_eq!(of_lagged("_lag_7s_c"), None, "the lag of nothing");
        assert_eq!(lagged_name("temperature", 60), None, "without a unit nobody knows where it ends");
        assert_eq!(lagged_name("temp_air_c", 0), None);
        assert_eq!(lagged_name("temp_air_lag_60s_c", 60), None, "one lag is enough");
        assert_eq!(lagged_name("temp_air_lead_60s_c", 60), None, "one lag is enough");
    }
}
