//! The judgement: how much less error on data that no step of the search saw?
//!
//! Place in the flow: after [`crate::search`]. Lines are dealt into folds; for each fold the whole search (order, choice
//! of effects, shapes, fit) runs on the other lines, and the lines left out are predicted with and without what it
//! found. Beside it, cheaper: blocks left out of the final fit by line, station and time, and placebos. Residuals in m.

use crate::candidates::Round;
use crate::error::DiagnoseError;
use crate::held_out::{HeldOut, held_out};
use crate::linear::Linear;
use crate::options::Progress;
use crate::search::{Search, State};
use abbe_geometry::machine::Machine;
use abbe_identify::{EffectTerm, residuals_of};
use abbe_measurement::campaign::Campaign;
use faer::Mat;
use rand::{Rng, SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use std::rc::Rc;

/// Half width of a 95 % interval in standard deviations.
const BAND_95: f64 = 1.96;
/// Blocks of time.
const TIME_BLOCKS: usize = 20;
/// Standardised residual (of the robust scale) beyond which a reading left out counts as an outlier, as in the fit.
const OUTLIER: f64 = 6.0;

/// A mean square with the interval that blocks give.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeldOutError {
    /// Rms (m).
    pub rms_m: f64,
    /// 95 % interval of the rms (m).
    pub interval_m: (f64, f64),
}

/// Error on lines left out of the whole search.
#[derive(Debug, Clone, PartialEq)]
pub struct Unseen {
    /// Without what the search found.
    pub before: HeldOutError,
    /// With it.
    pub after: HeldOutError,
    /// 95 % interval of before² − after² (m²), by lines: above zero where the gain is sure.
    pub gain_m2: (f64, f64),
    /// What each fold found, by name.
    pub found: Vec<Vec<String>>,
}

/// Blocked error of the final structure, by kind of block.
#[derive(Debug, Clone, PartialEq)]
pub struct Blocked {
    /// `line`, `station` or `time`.
    pub by: &'static str,
    /// Whitened rms without the effects.
    pub before: f64,
    /// Whitened rms with them.
    pub after: f64,
}

/// Placebos of one effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Placebo {
    /// Reduction of the blocked mean square by the effect itself (whitened, share of the noise).
    pub gain: f64,
    /// The same for its columns dealt to other lines.
    pub placebo_gains: Vec<f64>,
}

/// Runs the search without each fold of lines and predicts them.
pub(crate) fn unseen(
    search: &Search,
    machine: &Machine,
    base: &[EffectTerm],
    weights: &[f64],
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Unseen, DiagnoseError> {
    let folds = folds(search.campaign, search.options.folds, search.options.seed);
    let mut errors: Vec<Prediction> = Vec::new();
    let mut found = Vec::new();
    for (k, fold) in folds.iter().enumerate() {
        if !observe(Progress::Judging { fold: k + 1, folds: folds.len() }) {
            return Err(DiagnoseError::Stopped);
        }
        let (seen, left) = split(search.campaign, fold);
        let (seen_part, left_part) = (search.campaign.part(&seen), search.campaign.part(&left));
        let inner = Search::new(search.instrument, &seen_part, search.options);
        let before = inner.fit(machine, base, observe)?;
        let first = Rc::new(inner.round(&before)?);
        let state = inner.run(before.clone(), first, base.to_vec(), observe)?;
        let predict = |model| residuals_of(model, search.instrument, &left_part);
        let (without, with) = (predict(&before.model)?, predict(&state.fit.model)?);
        found.push(names(&state, base));
        for (index, (a, b)) in left.iter().zip(without.iter().zip(&with)) {
            if weights[*index] > 0.0 {
                let line = search.campaign.readings[*index].line;
                errors.push(Prediction { line, before_m: a.0, after_m: b.0, u_m: a.1 });
            }
        }
    }
    Ok(summary(errors, found))
}

/// One reading predicted by fits that did not see its line.
struct Prediction {
    line: u32,
    before_m: f64,
    after_m: f64,
    u_m: f64,
}

fn names(state: &State, base: &[EffectTerm]) -> Vec<String> {
    state.terms.iter().skip(base.len()).map(|term| term.effect.name().to_owned()).collect()
}

/// Lines dealt into folds: shuffled, so that each fold holds lines of every station and time.
fn folds(campaign: &Campaign, count: usize, seed: u64) -> Vec<Vec<u32>> {
    let mut lines: Vec<u32> = (0..campaign.lines.len() as u32).collect();
    lines.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    let mut folds = vec![Vec::new(); count.max(2)];
    let number = folds.len();
    lines.into_iter().enumerate().for_each(|(k, line)| folds[k % number].push(line));
    folds
}

/// Indices of the readings kept and left out.
fn split(campaign: &Campaign, fold: &[u32]) -> (Vec<usize>, Vec<usize>) {
    (0..campaign.readings.len()).partition(|k| !fold.contains(&campaign.readings[*k].line))
}

fn summary(mut errors: Vec<Prediction>, found: Vec<Vec<String>>) -> Unseen {
    // What the fit of all readings accepted may still be wild for a fit that did not see it; both errors must lose it.
    let mut sizes: Vec<f64> = errors.iter().map(|e| (e.before_m / e.u_m).abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let scale = sizes.get(sizes.len() / 2).map_or(1.0, |median| median / 0.6745);
    errors.retain(|e| (e.before_m / e.u_m).abs() < 2.0 * OUTLIER * scale.max(1.0));
    let lines = by_line(&errors);
    let of = |pick: fn(&Line) -> f64| block_error(&lines, pick);
    let gain = mean_and_deviation(&lines, |line| line.before - line.after);
    Unseen {
        before: of(|line| line.before),
        after: of(|line| line.after),
        gain_m2: (gain.0 - BAND_95 * gain.1, gain.0 + BAND_95 * gain.1),
        found,
    }
}

/// Sums of squares of one line.
struct Line {
    before: f64,
    after: f64,
    count: f64,
}

fn by_line(errors: &[Prediction]) -> Vec<Line> {
    let mut lines: std::collections::BTreeMap<u32, Line> = std::collections::BTreeMap::new();
    for error in errors {
        let line = lines.entry(error.line).or_insert(Line { before: 0.0, after: 0.0, count: 0.0 });
        line.before += error.before_m.powi(2);
        line.after += error.after_m.powi(2);
        line.count += 1.0;
    }
    lines.into_values().collect()
}

/// Ratio estimate Σ value / Σ count and its standard deviation over lines.
fn mean_and_deviation(lines: &[Line], value: impl Fn(&Line) -> f64) -> (f64, f64) {
    let count: f64 = lines.iter().map(|l| l.count).sum::<f64>().max(1.0);
    let mean = lines.iter().map(&value).sum::<f64>() / count;
    let spread: f64 = lines.iter().map(|l| (value(l) - mean * l.count).powi(2)).sum();
    let blocks = lines.len() as f64;
    (mean, (spread * blocks / (blocks - 1.0).max(1.0)).sqrt() / count)
}

fn block_error(lines: &[Line], value: impl Fn(&Line) -> f64) -> HeldOutError {
    let (mean, deviation) = mean_and_deviation(lines, value);
    let root = |v: f64| v.max(0.0).sqrt();
    HeldOutError { rms_m: root(mean), interval_m: (root(mean - BAND_95 * deviation), root(mean + BAND_95 * deviation)) }
}

/// Blocks of readings used, by line, station and time.
pub(crate) fn blocks(campaign: &Campaign, round: &Round) -> [(&'static str, Vec<Vec<usize>>); 3] {
    let used = || (0..campaign.readings.len()).filter(|k| round.rows.whitening[*k] > 0.0);
    let group = |key: &dyn Fn(usize) -> usize, count: usize| {
        let mut groups = vec![Vec::new(); count];
        used().for_each(|k| groups[key(k)].push(k));
        groups.retain(|g| !g.is_empty());
        groups
    };
    let readings = &campaign.readings;
    let share = readings.len().div_ceil(TIME_BLOCKS).max(1);
    [
        ("line", group(&|k| readings[k].line as usize, campaign.lines.len())),
        ("station", group(&|k| readings[k].station as usize, campaign.stations.len())),
        ("time", group(&|k| k / share, TIME_BLOCKS)),
    ]
}

/// Whitened rms of blocks left out.
pub(crate) fn blocked_rms(fit: &Linear, blocks: &[Vec<usize>]) -> f64 {
    let parts: Vec<HeldOut> = held_out(fit, blocks);
    let judged: usize = parts.iter().map(|p| p.judged).sum();
    (parts.iter().map(|p| p.square).sum::<f64>() / judged.max(1) as f64).sqrt()
}

/// Gain of an effect's columns over a fit without them, and of the same columns dealt to other lines.
///
/// The columns of a line go to another line as they are, so that a placebo is as smooth and as flexible as the effect;
/// only its tie to the readings is cut.
pub(crate) fn placebo(
    without: &Round,
    columns: &Mat<f64>,
    campaign: &Campaign,
    (count, seed): (usize, u64),
) -> Result<Placebo, DiagnoseError> {
    let [(_, lines), ..] = blocks(campaign, without);
    let before = blocked_rms(&without.linear, &lines).powi(2);
    let gain = |columns: &Mat<f64>| -> Result<f64, DiagnoseError> {
        match without.linear.with(columns.as_ref()) {
            Ok(with) => Ok(before - blocked_rms(&with, &lines).powi(2)),
            // Columns that the model contains gain nothing.
            Err(DiagnoseError::Singular) => Ok(0.0),
            Err(other) => Err(other),
        }
    };
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let placebo_gains = (0..count).map(|_| gain(&dealt(columns, &mut generator))).collect::<Result<_, _>>()?;
    Ok(Placebo { gain: gain(columns)?, placebo_gains })
}

/// Rows moved on by a random number of readings, and mirrored in time at random.
fn dealt(columns: &Mat<f64>, generator: &mut ChaCha8Rng) -> Mat<f64> {
    let rows = columns.nrows();
    let shift = generator.random_range(rows / 10..rows - rows / 10);
    let mirrored = generator.random::<bool>();
    let from = |k: usize| {
        let moved = (k + shift) % rows;
        if mirrored { rows - 1 - moved } else { moved }
    };
    Mat::from_fn(rows, columns.ncols(), |k, j| columns[(from(k), j)])
}
