//! Axis scales: data value → pixel, and the round numbers to mark.

use crate::text;

/// How values map to an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Spacing {
    /// Proportional.
    Linear,
    /// Decades; values must be positive.
    Log,
}

/// A scale from data (`low..high`) to pixels (`from..to`; `from > to` for a vertical axis).
#[derive(Debug, Clone)]
pub(crate) struct Scale {
    kind: Spacing,
    low: f64,
    high: f64,
    from: f64,
    to: f64,
}

/// A mark on an axis.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tick {
    /// Data value.
    pub(crate) value: f64,
    /// Text; empty for a minor mark.
    pub(crate) label: String,
}

impl Scale {
    /// Linear scale whose range grows to the next tick-friendly margin (4 % on both sides).
    pub(crate) fn linear(range: Option<(f64, f64)>, from: f64, to: f64) -> Self {
        let (low, high) = widen(range.unwrap_or((0.0, 1.0)));
        let margin = 0.04 * (high - low);
        Self::exact(low - margin, high + margin, from, to)
    }

    /// Linear scale over exactly `low..high`.
    pub(crate) fn exact(low: f64, high: f64, from: f64, to: f64) -> Self {
        let (low, high) = widen((low, high));
        Self { kind: Spacing::Linear, low, high, from, to }
    }

    /// Logarithmic scale with a margin of a twentieth decade; both limits must be positive.
    pub(crate) fn log(low: f64, high: f64, from: f64, to: f64) -> Self {
        let high = if high > low { high } else { low * 10.0 };
        Self { kind: Spacing::Log, low: low / 1.12, high: high * 1.12, from, to }
    }

    /// Pixel of a value.
    pub(crate) fn map(&self, value: f64) -> f64 {
        let share = match self.kind {
            Spacing::Linear => (value - self.low) / (self.high - self.low),
            Spacing::Log => (value / self.low).log10() / (self.high / self.low).log10(),
        };
        self.from + share * (self.to - self.from)
    }

    /// What the page's script needs of a scale: kind, lower and upper value, their pixels, wanted marks.
    pub(crate) fn to_attribute(&self, wanted: usize) -> String {
        let kind = match self.kind {
            Spacing::Linear => "lin",
            Spacing::Log => "log",
        };
        format!("{kind} {:e} {:e} {:.2} {:.2} {wanted}", self.low, self.high, self.from, self.to)
    }

    /// Round marks inside the range, about `wanted` and seldom more; a logarithmic scale has its own.
    pub(crate) fn ticks(&self, wanted: usize) -> Vec<Tick> {
        match self.kind {
            Spacing::Linear => linear_ticks(self.low, self.high, wanted),
            Spacing::Log => log_ticks(self.low, self.high),
        }
    }
}

/// Gives a degenerate range a width, so that one value or a constant still has an axis.
fn widen((low, high): (f64, f64)) -> (f64, f64) {
    if high - low > 1e-12 * low.abs().max(high.abs()) {
        (low, high)
    } else if low == 0.0 {
        (-1.0, 1.0)
    } else {
        (low - 0.1 * low.abs(), low + 0.1 * low.abs())
    }
}

/// Step of the form 1, 2 or 5 times a power of ten nearest to `rough` from above.
fn nice_step(rough: f64) -> f64 {
    let decade = 10f64.powf(rough.log10().floor());
    let factor = [1.0, 2.0, 5.0].into_iter().find(|f| f * decade >= rough * 0.999);
    factor.unwrap_or(10.0) * decade
}

fn linear_ticks(low: f64, high: f64, wanted: usize) -> Vec<Tick> {
    let step = nice_step((high - low) / wanted.max(1) as f64);
    // The small allowance keeps a mark that rounding puts a hair outside its own end of the axis.
    let (first, last) = ((low / step - 1e-9).ceil(), (high / step + 1e-9).floor());
    // A span that overflows has no round marks; the writer reports the overflow itself.
    if !step.is_normal() || !(0.0..=64.0).contains(&(last - first)) {
        return Vec::new();
    }
    let decimals = (-step.log10().floor()).clamp(0.0, 9.0) as u8;
    (0..=(last - first) as u32)
        .map(|i| (first + f64::from(i)) * step)
        .map(|value| Tick {
            label: if step < 1e-6 { text::significant(value, 3) } else { text::fixed(value, decimals) },
            value,
        })
        .collect()
}

/// Decades with labels; 2 and 5 too when there are few decades, as bare marks otherwise.
fn log_ticks(low: f64, high: f64) -> Vec<Tick> {
    // A range that overflows has no decades, or two thousand million of them; the writer reports the overflow itself.
    if !(low > 0.0 && high.is_finite()) {
        return Vec::new();
    }
    let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
    let label_all = last - first <= 4;
    let every = (last - first) / 12 + 1;
    let mut ticks = Vec::new();
    for exponent in first..=last {
        for factor in 1..10_i32 {
            let value = f64::from(factor) * 10f64.powi(exponent);
            if value < low || value > high {
                continue;
            }
            let labelled = (factor == 1 && exponent % every == 0) || (label_all && matches!(factor, 2 | 5));
            let label = if labelled { decade_label(f64::from(factor), exponent) } else { String::new() };
            ticks.push(Tick { value, label });
        }
    }
    ticks
}

fn decade_label(factor: f64, exponent: i32) -> String {
    if (-4..5).contains(&exponent) {
        text::fixed(factor * 10f64.powi(exponent), (-exponent).max(0) as u8)
    } else {
        format!("{factor}×10{}", text::superscript(&exponent.to_string()))
    }
}

/// Smallest and largest of many values; `None` when there are none.
pub(crate) fn extent(values: impl IntoIterator<Item = f64>) -> Option<(f64, f64)> {
    values.into_iter().fold(None, |range, v| match range {
        None => Some((v, v)),
        Some((low, high)) => Some((f64::min(low, v), f64::max(high, v))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_ticks_are_round_and_inside() {
        let labels: Vec<_> = Scale::exact(-0.3, 0.31, 0.0, 1.0).ticks(7).into_iter().map(|t| t.label).collect();
        assert_eq!(labels, ["−0.3", "−0.2", "−0.1", "0.0", "0.1", "0.2", "0.3"]);
    }

    #[test]
    fn log_scale_maps_decades_evenly() {
        let scale = Scale::log(0.1, 10.0, 0.0, 100.0);
        assert!((scale.map(1.0) - 50.0).abs() < 1e-9);
        assert!(scale.ticks(0).iter().any(|t| t.label == "0.5"));
    }

    #[test]
    fn constants_and_huge_ranges_do_not_loop() {
        assert!(!Scale::linear(Some((3.0, 3.0)), 0.0, 1.0).ticks(5).is_empty());
        assert!(Scale::exact(-f64::MAX, f64::MAX, 0.0, 1.0).ticks(5).is_empty());
        assert!(!Scale::linear(None, 0.0, 1.0).ticks(5).is_empty());
        // Marks up to 10^2147483647 took all memory.
        for (low, high) in [(1e-70, f64::INFINITY), (0.0, 1.0), (f64::NAN, 1.0)] {
            assert!(log_ticks(low, high).is_empty(), "{low} {high}");
        }
    }
}
