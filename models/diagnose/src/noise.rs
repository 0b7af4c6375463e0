//! Is the residual consistent with the declared noise, before any effect is named?
//!
//! Place in the flow: first step of a diagnosis, and again after the effects found. Every figure allows for what the fit
//! itself took out of the residuals (hat matrix). Whitened residuals have no unit; others are in m.

use crate::candidates::Round;
use abbe_identify::verdict::three_digits;
use abbe_identify::{CorrelatedNoise, Evidence};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::chance::beyond;
use faer::Mat;
use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};

/// Positions and offsets this close are one point measured again (m).
const SAME_M: f64 = 2e-6;
/// Pairs of replicates from which their scatter is worth a comparison.
const ENOUGH_PAIRS: usize = 20;
/// Probability below which structure counts as shown.
const SHOWN: f64 = 1e-4;

/// What the residual says about itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Detection {
    /// χ² per degree of freedom with the declared uncertainties.
    pub chi2_per_dof: f64,
    /// Probability of a larger one if the declared uncertainties are right.
    pub p_declared: f64,
    /// Robust standard deviation of the residuals over the declared one.
    pub estimated_over_declared: f64,
    /// Rms of the residuals used (m).
    pub rms_m: f64,
    /// Readings used and rejected.
    pub readings: (usize, usize),
    /// Correlation of neighbours on a line, and its probability by chance.
    pub along_lines: Structure,
    /// Scatter of the lines' means over what noise gives, and its probability by chance.
    pub between_lines: Structure,
    /// Misfit over the scatter of replicates, and its probability by chance; `None` without enough replicates.
    pub lack_of_fit: Option<Structure>,
    /// How the noise is correlated, where the data show that it is: all other figures are of what is new in each reading.
    pub correlated: Option<CorrelatedNoise>,
    /// Mean and mean square by station, offset and direction of approach.
    pub groups: Vec<Group>,
}

/// One figure that is 0 or 1 for noise, and how surely it is not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Structure {
    /// The figure.
    pub value: f64,
    /// Probability of such a value by chance.
    pub p_value: f64,
}

/// Residuals of some readings.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// Which: `station S1`, `offset 0 0 -60 mm`, `dir_x +1`.
    pub name: String,
    /// Readings.
    pub readings: usize,
    /// Mean residual (m).
    pub mean_m: f64,
    /// Mean square of the whitened residuals.
    pub mean_square: f64,
}

impl Detection {
    /// Whether some structure is shown that noise does not have.
    pub fn has_structure(&self) -> bool {
        let tests = [Some(self.along_lines), Some(self.between_lines), self.lack_of_fit];
        tests.iter().flatten().any(|test| test.p_value < SHOWN)
    }

    /// In words.
    pub fn verdict(&self) -> String {
        let size = match (self.p_declared < SHOWN, self.chi2_per_dof > 1.0) {
            (true, true) => "larger than the declared uncertainties say",
            (true, false) => "smaller than the declared uncertainties say",
            (false, _) => "as large as the declared uncertainties say",
        };
        let structure = match (self.along_lines.p_value < SHOWN, self.between_lines.p_value < SHOWN) {
            (true, true) => "neighbours on a line are alike and whole lines are off",
            (true, false) => "neighbours on a line are alike",
            (false, true) => "whole lines are off together",
            (false, false) => "neither neighbours nor lines are correlated",
        };
        let known = self.correlated.map_or_else(String::new, |noise| {
            let (neighbours, effective) = (noise.neighbours, noise.effective_readings);
            format!(
                " The noise is correlated (neighbours on a line {neighbours:+.2}), which all figures allow for: on what \
                 neighbours share the readings tell as much as {effective:.0} independent ones."
            )
        });
        let beyond = if self.correlated.is_some() { "beyond that " } else { "" };
        let chi2_per_dof = three_digits(self.chi2_per_dof);
        format!("The residuals are {size} (χ² per degree of freedom {chi2_per_dof}); {beyond}{structure}.{known}")
    }
}

pub(crate) fn detect(round: &Round, campaign: &Campaign, evidence: &Evidence) -> Detection {
    let (linear, rows) = (&round.linear, &round.rows);
    let used: Vec<usize> = (0..rows.len()).filter(|k| rows.whitening[*k] > 0.0).collect();
    let square: f64 = used.iter().map(|k| rows.residuals_m[*k].powi(2)).sum();
    Detection {
        chi2_per_dof: linear.noise_factor(),
        p_declared: p_chi2(linear.chi2(), linear.degrees()),
        estimated_over_declared: evidence.robust_scale,
        rms_m: (square / used.len().max(1) as f64).sqrt(),
        readings: (used.len(), rows.len() - used.len()),
        along_lines: along_lines(round, campaign, &used),
        between_lines: between_lines(round, campaign, &used),
        lack_of_fit: lack_of_fit(round, campaign, &used),
        correlated: evidence.noise,
        groups: groups(round, campaign, &used),
    }
}

/// Two-sided where the declared noise is too large, too.
fn p_chi2(chi2: f64, degrees: f64) -> f64 {
    let Ok(distribution) = ChiSquared::new(degrees) else { return 1.0 };
    2.0 * beyond(&distribution, chi2).min(distribution.cdf(chi2))
}

fn p_normal(z: f64) -> f64 {
    Normal::new(0.0, 1.0).map_or(1.0, |normal| 2.0 * beyond(&normal, z.abs()))
}

/// Mean product of neighbours on a line over the mean square.
fn along_lines(round: &Round, campaign: &Campaign, used: &[usize]) -> Structure {
    let r = &round.rows.residuals;
    let neighbours = used.windows(2).filter(|w| campaign.readings[w[0]].line == campaign.readings[w[1]].line);
    let (count, sum) = neighbours.fold((0_usize, 0.0), |(n, sum), w| (n + 1, sum + r[w[0]] * r[w[1]]));
    let value = sum / count.max(1) as f64 / round.linear.noise_factor();
    Structure { value, p_value: p_normal(value * (count as f64).sqrt()) }
}

/// Σ (sum of a line's residuals)² over its expectation, which the hat matrix gives.
fn between_lines(round: &Round, campaign: &Campaign, used: &[usize]) -> Structure {
    let mut lines: Vec<Vec<usize>> = vec![Vec::new(); campaign.lines.len()];
    used.iter().for_each(|k| lines[campaign.readings[*k].line as usize].push(*k));
    let (mut total, mut count) = (0.0, 0);
    for line in lines.iter().filter(|line| line.len() > 1) {
        let sum: f64 = line.iter().map(|k| round.linear.residuals()[*k]).sum();
        let summed = Mat::from_fn(1, round.linear.jacobian().ncols(), |_, j| {
            line.iter().map(|k| round.linear.jacobian()[(*k, j)]).sum::<f64>()
        });
        let taken = (&summed * round.linear.covariance() * summed.transpose())[(0, 0)];
        let expected = line.len() as f64 - taken;
        // A line that alone determines a parameter has no freedom left to tell anything.
        if expected > 0.05 * line.len() as f64 {
            total += sum * sum / expected;
            count += 1;
        }
    }
    let statistic = total / round.linear.noise_factor();
    let p_value = ChiSquared::new(f64::from(count).max(1.0)).map_or(1.0, |d| beyond(&d, statistic));
    Structure { value: statistic / f64::from(count).max(1.0), p_value }
}

/// Noise factor of the fit over that of points measured again on the same line of sight.
fn lack_of_fit(round: &Round, campaign: &Campaign, used: &[usize]) -> Option<Structure> {
    let key = |k: usize| {
        let r = &campaign.readings[k];
        let cell = |v: f64| (v / SAME_M).round() as i64;
        (r.station, r.reading_m.map(cell), r.offset_m.map(cell))
    };
    // A row that was logged twice was not measured again.
    let length_m = |k: usize| campaign.readings[k].length_m;
    let mut sorted: Vec<usize> = used.to_vec();
    sorted.sort_by_key(|k| key(*k));
    let pairs: Vec<f64> = sorted
        .windows(2)
        .filter(|w| key(w[0]) == key(w[1]) && length_m(w[0]) != length_m(w[1]))
        .map(|w| 0.5 * (round.rows.residuals[w[0]] - round.rows.residuals[w[1]]).powi(2))
        .collect();
    if pairs.len() < ENOUGH_PAIRS {
        return None;
    }
    let pure = pairs.iter().sum::<f64>() / pairs.len() as f64;
    let value = round.linear.noise_factor() / pure.max(f64::MIN_POSITIVE);
    let f = statrs::distribution::FisherSnedecor::new(round.linear.degrees(), pairs.len() as f64).ok()?;
    Some(Structure { value, p_value: beyond(&f, value) })
}

fn groups(round: &Round, campaign: &Campaign, used: &[usize]) -> Vec<Group> {
    let mut found: Vec<(String, Vec<usize>)> = Vec::new();
    let mut put = |name: String, k: usize| match found.iter_mut().find(|(known, _)| *known == name) {
        Some((_, members)) => members.push(k),
        None => found.push((name, vec![k])),
    };
    for k in used {
        let reading = &campaign.readings[*k];
        put(format!("station {}", campaign.stations[reading.station as usize]), *k);
        let [x, y, z] = reading.offset_m.map(|v| v * 1e3);
        put(format!("offset {x:.1} {y:.1} {z:.1} mm"), *k);
        for name in ["dir_x", "dir_y", "dir_z"] {
            if let Some(Some(sign)) = campaign.covariate(name).and_then(|c| c.values.get(*k).copied()) {
                put(format!("{name} {sign:+.0}"), *k);
            }
        }
    }
    found.sort_by(|a, b| a.0.cmp(&b.0));
    let group = |(name, members): (String, Vec<usize>)| {
        let count = members.len() as f64;
        let rows = &round.rows;
        Group {
            name,
            readings: members.len(),
            mean_m: members.iter().map(|k| rows.residuals_m[*k]).sum::<f64>() / count,
            mean_square: members.iter().map(|k| rows.residuals[*k].powi(2)).sum::<f64>() / count,
        }
    };
    found.into_iter().map(group).collect()
}
