//! Lagged quantities: what follows a logged one with a time constant, as a structure follows the temperature of its air.
//!
//! Place in the flow: effects read a lagged quantity like any other covariate, by its name; [`Lag`] makes its values from those of
//! the logged one, for the rows of a campaign, of a table of points and of a live stream alike. `temp_air_lag_1800s_c` is
//! `temp_air_c` behind a time constant of 1800 s: the unit stays the end of the name.
//! Formula: τ dy/dt = u − y, solved exactly for u that runs straight from one value to the next. Nobody logged what was before
//! the first value: y begins there, and has forgotten it after three time constants. Times in s, values in the unit of the name.

/// What stands between the name and its unit.
const MARK: &str = "_lag_";

/// The name of a quantity behind a time constant of whole seconds; `None` for a name without a unit, or one that lags already.
pub fn lagged_name(name: &str, lag_s: u32) -> Option<String> {
    let (stem, unit) = name.rsplit_once('_')?;
    let is_plain = lag_s > 0 && !stem.is_empty() && !unit.is_empty() && of_lagged(name).is_none();
    is_plain.then(|| format!("{stem}{MARK}{lag_s}s_{unit}"))
}

/// The logged quantity behind a lagged one, and its time constant (s); `None` for any other name.
pub fn of_lagged(name: &str) -> Option<(String, u32)> {
    let (rest, unit) = name.rsplit_once('_')?;
    let (stem, lag) = rest.rsplit_once(MARK)?;
    let lag_s = lag.strip_suffix('s')?.parse().ok().filter(|lag_s| *lag_s > 0)?;
    // "+7s" and "007s" parse as well, and would be other names of the same.
    let is_plain = format!("{lag_s}s") == lag && !stem.is_empty() && !unit.is_empty();
    is_plain.then(|| (format!("{stem}_{unit}"), lag_s))
}

/// Time constants after which 5 % of a wrong beginning are left.
const SETTLED: f64 = 3.0;

/// A first-order lag.
#[derive(Debug, Clone)]
pub struct Lag {
    tau_s: f64,
    last: Option<Last>,
}

#[derive(Debug, Clone, Copy)]
struct Last {
    time_s: f64,
    input: f64,
    output: f64,
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
    /// Whether the history began anew: at the first value, after a pause longer than the time constant, or when time went back.
    pub is_new: bool,
}

impl Lag {
    /// A lag of that time constant (s, above zero), without history.
    pub fn new(tau_s: f64) -> Lag {
        Lag { tau_s, last: None }
    }

    /// Takes the next value; both numbers must be finite.
    pub fn push(&mut self, time_s: f64, input: f64) -> Lagged {
        let follows = |last: &Last| time_s >= last.time_s && time_s - last.time_s <= self.tau_s;
        let before = self.last.filter(follows);
        let now = match before {
            None => Last { time_s, input, output: input, since_s: time_s },
            Some(last) => {
                let share = (time_s - last.time_s) / self.tau_s;
                let ramp = if share > 0.0 { (-share).exp_m1() / share } else { -1.0 };
                let output = input + (last.output - last.input) * (-share).exp() + (input - last.input) * ramp;
                Last { time_s, input, output, ..last }
            }
        };
        self.last = Some(now);
        let is_settled = now.time_s - now.since_s >= SETTLED * self.tau_s;
        Lagged { value: now.output, is_settled, is_new: before.is_none() }
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

    #[test]
    fn a_pause_and_a_clock_that_goes_back_begin_anew() {
        let mut lag = Lag::new(TAU_S);
        assert!(lag.push(0.0, 20.0).is_new);
        assert!(!lag.push(1800.0, 21.0).is_new);
        assert!(!lag.push(1800.0, 21.0).is_new, "the same instant again is no pause");
        let after = lag.push(3601.0, 25.0);
        assert!(after.is_new && !after.is_settled && after.value == 25.0);
        assert!(lag.push(3600.0, 25.0).is_new);
    }

    #[test]
    fn a_lagged_name_keeps_its_unit_and_reads_back() {
        let name = lagged_name("temp_bridge_top_c", 1800).unwrap();
        assert_eq!(name, "temp_bridge_top_lag_1800s_c");
        assert_eq!(of_lagged(&name), Some(("temp_bridge_top_c".to_owned(), 1800)));
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
    }
}
