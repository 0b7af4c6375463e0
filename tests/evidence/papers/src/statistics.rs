//! Means with their 95 % intervals over simulated runs.
//!
//! Place in the flow: rows that come from a simulation show them, so that a verdict can be told from chance.

/// Factor of a 95 % interval of a normal distribution; with few runs Student's factor takes its place.
const NORMAL_95: f64 = 1.96;
/// Student's factors (two-sided 95 %) for 1 to 30 degrees of freedom.
const STUDENT_95: [f64; 30] = [
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131, 2.120,
    2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042,
];

/// Mean and half width of its 95 % interval; the half width is missing for fewer than two values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Interval {
    pub(crate) mean: f64,
    pub(crate) half_width: Option<f64>,
}

impl Interval {
    /// Of these values; `None` of none.
    pub(crate) fn of(values: &[f64]) -> Option<Interval> {
        let count = values.len();
        if count == 0 {
            return None;
        }
        let mean = values.iter().sum::<f64>() / count as f64;
        if count == 1 {
            return Some(Interval { mean, half_width: None });
        }
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (count - 1) as f64;
        let factor = STUDENT_95.get(count - 2).copied().unwrap_or(NORMAL_95);
        Some(Interval { mean, half_width: Some(factor * (variance / count as f64).sqrt()) })
    }

    /// Geometric mean of ratios with its interval, as (mean, low, high).
    pub(crate) fn of_ratios(ratios: &[f64]) -> Option<(f64, f64, f64)> {
        let logs: Vec<f64> = ratios.iter().map(|r| r.ln()).collect();
        let interval = Interval::of(&logs)?;
        let half = interval.half_width.unwrap_or(f64::INFINITY);
        Some((interval.mean.exp(), (interval.mean - half).exp(), (interval.mean + half).exp()))
    }

    /// `1.230 ± 0.042`: two digits of the half width, and with at most these decimals.
    pub(crate) fn text(&self, most: usize) -> String {
        let decimals = self.half_width.map_or(most, |half| decimals_of(half).min(most));
        match self.half_width {
            Some(half) => format!("{:.decimals$} ± {half:.decimals$}", self.mean),
            None => format!("{:.decimals$}", self.mean),
        }
    }
}

/// Decimals that show an uncertainty with two digits.
fn decimals_of(u: f64) -> usize {
    let text = format!("{u:.1e}");
    let exponent = text.split_once('e').and_then(|(_, exponent)| exponent.parse::<i32>().ok());
    exponent.and_then(|exponent| usize::try_from(1 - exponent).ok()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_is_students() {
        let interval = Interval::of(&[1.0, 2.0, 3.0]).unwrap();
        // s = 1, s/√3 = 0.57735, t(2) = 4.303.
        assert_eq!(interval.mean, 2.0);
        assert!((interval.half_width.unwrap() - 4.303 / 3.0_f64.sqrt()).abs() < 1e-12);
        assert_eq!(Interval::of(&[5.0]).unwrap().half_width, None);
        assert_eq!(Interval::of(&[]), None);
        assert_eq!(interval.text(1), "2.0 ± 2.5");
        // 0.430 ± 1.525 has digits that the interval does not allow.
        let of = |mean: f64, half: f64| Interval { mean, half_width: Some(half) }.text(3);
        assert_eq!(
            [of(0.430, 1.525), of(0.3571, 0.481), of(12.34, 20.0), of(0.1, 0.0002)],
            ["0.4 ± 1.5", "0.36 ± 0.48", "12 ± 20", "0.100 ± 0.000"]
        );
        let (mean, low, high) = Interval::of_ratios(&[1.0, 4.0]).unwrap();
        assert!((mean - 2.0).abs() < 1e-12 && low < 1.0 && high > 4.0);
    }
}
