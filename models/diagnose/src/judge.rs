//! The judgement: how much less error on data that no step of the search saw?
//!
//! Place in the flow: after [`crate::search`]. Whole lines are dealt into folds, those of each station apart, so that every
//! fold leaves every station lines to stand on; for each fold the whole search (order, choice of effects, shapes, fit) runs
//! on the other lines, and the lines left out are predicted with and without what it found. A fold that cannot be
//! fitted is left out and said. Beside it, cheaper: blocks left out of the final fit by line, station and time, and
//! placebos. Residuals in m.

use crate::blocks::blocks;
use crate::candidates::Round;
use crate::diagnosis::{BAND_95, HeldOutError, Placebo, Unseen};
use crate::error::DiagnoseError;
use crate::held_out::{HeldOut, held_out};
use crate::linear::Linear;
use crate::options::{DiagnoseOptions, Progress};
use crate::same_claim::has;
use crate::search::{Search, State};
use crate::side_by_side::side_by_side;
use abbe_geometry::Vector3;
use abbe_geometry::effects::Ray;
use abbe_geometry::machine::Machine;
use abbe_identify::{EffectTerm, Excess, by_axis, residuals_of};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use faer::Mat;
use rand::{Rng, SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeSet;

/// Standardised residual (of the robust scale) beyond which a reading left out counts as an outlier, as in the fit.
const OUTLIER: f64 = 6.0;
/// Folds that must have been fitted for a figure: one fold is one draw of lines.
const FEWEST_FOLDS: usize = 2;

/// Runs the search without each fold of lines and predicts them; why there is no figure where too few folds can be fitted.
pub(crate) fn unseen(
    search: &Search,
    machine: &Machine,
    base: &[EffectTerm],
    (weights, rays): (&[f64], &[Ray]),
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Result<Unseen, String>, DiagnoseError> {
    let dealt = folds(search.campaign, search.options.folds, search.options.seed);
    let (mut errors, mut found, mut not_judged) = (Vec::new(), Vec::new(), dealt.not_judged);
    let whole = Whole { instrument: search.instrument, campaign: search.campaign, options: search.options };
    let without = |k: usize, observe: &mut dyn FnMut(Progress) -> bool| match observe(Progress::Judging {
        fold: k + 1,
        folds: dealt.folds.len(),
    }) {
        true => one(whole, (machine, base), &dealt.folds[k], (weights, rays), observe),
        false => Err(DiagnoseError::Stopped),
    };
    for (k, outcome) in side_by_side(dealt.folds.len(), without, observe)?.into_iter().enumerate() {
        match outcome {
            Ok((predictions, names)) => {
                errors.extend(predictions);
                found.push(names);
            }
            Err(DiagnoseError::Stopped) => return Err(DiagnoseError::Stopped),
            Err(problem) => not_judged.push(format!("part {} of {}: {problem}", k + 1, dealt.folds.len())),
        }
    }
    if found.len() < FEWEST_FOLDS || 2 * found.len() < dealt.folds.len() || errors.is_empty() {
        let parts = (found.len(), dealt.folds.len());
        let because = not_judged.first().map_or_else(String::new, |first| format!(" ({first})"));
        return Ok(Err(format!("only {} of {} parts of the campaign can be left out{because}", parts.0, parts.1)));
    }
    Ok(Ok(summary(errors, found, not_judged)))
}

/// What a search of a part needs of the search of the whole.
#[derive(Clone, Copy)]
struct Whole<'a> {
    instrument: RangeUncertainty,
    campaign: &'a Campaign,
    options: &'a DiagnoseOptions,
}

/// Predictions of the lines of a fold by a search that does not see them, and what that search found.
fn one(
    whole: Whole,
    (machine, base): (&Machine, &[EffectTerm]),
    fold: &[u32],
    (weights, rays): (&[f64], &[Ray]),
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<(Vec<Prediction>, Vec<String>), DiagnoseError> {
    let (seen, left) = split(whole.campaign, fold);
    let (seen_part, left_part) = (whole.campaign.part(&seen), whole.campaign.part(&left));
    let inner = Search::new(whole.instrument, &seen_part, whole.options);
    let before = inner.fit(machine, base, observe)?;
    let first = inner.round(&before)?;
    let state = inner.run(before.clone(), first, base.to_vec(), observe)?;
    let predict = |model| residuals_of(model, whole.instrument, &left_part);
    let (without, with) = (predict(&before.model)?, predict(&state.fit.model)?);
    let mut predictions = Vec::new();
    for (index, (a, b)) in left.iter().zip(without.iter().zip(&with)) {
        if weights[*index] > 0.0 {
            let line = whole.campaign.readings[*index].line;
            let direction = rays[*index].direction;
            predictions.push(Prediction { line, direction, before_m: a.0, after_m: b.0, u_m: a.1 });
        }
    }
    Ok((predictions, names(&state, base)))
}

/// One reading predicted by fits that did not see its line.
struct Prediction {
    line: u32,
    direction: Vector3<f64>,
    before_m: f64,
    after_m: f64,
    u_m: f64,
}

fn names(state: &State, base: &[EffectTerm]) -> Vec<String> {
    state.terms.iter().filter(|term| !has(base, term)).map(|term| term.effect.name().to_owned()).collect()
}

/// Lines dealt into folds.
struct Dealt {
    folds: Vec<Vec<u32>>,
    /// Lines that no fold can do without, in words.
    not_judged: Vec<String>,
}

/// Whole lines, in random order, dealt station by station, so that each fold holds about as many lines of every station. A
/// line that is all that a station has is never left out: nothing else would tell where the station stands.
fn folds(campaign: &Campaign, count: usize, seed: u64) -> Dealt {
    let mut stations: Vec<BTreeSet<u32>> = vec![BTreeSet::new(); campaign.lines.len()];
    campaign.readings.iter().for_each(|r| {
        stations[r.line as usize].insert(r.station);
    });
    let mut left = vec![0_usize; campaign.stations.len()];
    stations.iter().flatten().for_each(|station| left[*station as usize] += 1);
    let mut lines: Vec<u32> = (0..campaign.lines.len() as u32).filter(|k| !stations[*k as usize].is_empty()).collect();
    lines.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    lines.sort_by_key(|line| stations[*line as usize].first().copied());
    let mut folds = vec![Vec::new(); count.max(2)];
    // Lines of each station that each fold would take away.
    let mut taken = vec![vec![0_usize; campaign.stations.len()]; folds.len()];
    let (mut next, mut not_judged) = (0, Vec::new());
    for line in lines {
        let own = &stations[line as usize];
        let fits = |k: &usize| own.iter().all(|s| taken[*k][*s as usize] + 1 < left[*s as usize]);
        match (next..next + folds.len()).map(|k| k % taken.len()).find(fits) {
            Some(fold) => {
                own.iter().for_each(|s| taken[fold][*s as usize] += 1);
                folds[fold].push(line);
                next = fold + 1;
            }
            None => not_judged.push(format!(
                "line {} is never left out: a station would be left without any line",
                campaign.lines[line as usize]
            )),
        }
    }
    folds.retain(|fold| !fold.is_empty());
    Dealt { folds, not_judged }
}

/// Indices of the readings kept and left out.
fn split(campaign: &Campaign, fold: &[u32]) -> (Vec<usize>, Vec<usize>) {
    (0..campaign.readings.len()).partition(|k| !fold.contains(&campaign.readings[*k].line))
}

fn summary(mut errors: Vec<Prediction>, found: Vec<Vec<String>>, not_judged: Vec<String>) -> Unseen {
    // What the fit of all readings accepted may still be wild for a fit that did not see it; both errors must lose it.
    let mut sizes: Vec<f64> = errors.iter().map(|e| (e.before_m / e.u_m).abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let scale = sizes.get(sizes.len() / 2).map_or(1.0, |median| median / 0.6745);
    errors.retain(|e| (e.before_m / e.u_m).abs() < 2.0 * OUTLIER * scale.max(1.0));
    let lines = by_line(&errors);
    let of = |pick: fn(&Line) -> f64| block_error(&lines, pick);
    let gain = mean_and_deviation(&lines, |line| line.before - line.after);
    let beyond = mean_and_deviation(&lines, |line| line.after - line.declared);
    let excess =
        |e: &Prediction| Excess { direction: e.direction, square_m2: e.after_m.powi(2) - e.u_m.powi(2), line: e.line };
    let excess: Vec<Excess> = errors.iter().map(excess).collect();
    Unseen {
        unexplained_m: by_axis(&excess, (beyond.0 - beyond.1).max(0.0).sqrt()),
        before: of(|line| line.before),
        after: of(|line| line.after),
        gain_m2: (gain.0 - BAND_95 * gain.1, gain.0 + BAND_95 * gain.1),
        found,
        not_judged,
    }
}

/// Sums of squares of one line.
struct Line {
    before: f64,
    after: f64,
    /// What the declared noise makes of it.
    declared: f64,
    count: f64,
}

fn by_line(errors: &[Prediction]) -> Vec<Line> {
    let mut lines: std::collections::BTreeMap<u32, Line> = std::collections::BTreeMap::new();
    for error in errors {
        let line = lines.entry(error.line).or_insert(Line { before: 0.0, after: 0.0, declared: 0.0, count: 0.0 });
        line.before += error.before_m.powi(2);
        line.after += error.after_m.powi(2);
        line.declared += error.u_m.powi(2);
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

/// Whitened rms of blocks left out.
pub(crate) fn blocked_rms(fit: &Linear, blocks: &[Vec<usize>]) -> f64 {
    let parts: Vec<HeldOut> = held_out(fit, blocks);
    let judged: usize = parts.iter().map(|p| p.judged).sum();
    (parts.iter().map(|p| p.square).sum::<f64>() / judged.max(1) as f64).sqrt()
}

/// Gain of an effect's columns over a fit without them, and of the same columns moved to other readings.
///
/// All rows move on together, whatever line they belong to, so that a placebo is as smooth in time and as flexible as the
/// effect; only its tie to the readings is cut.
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
    if rows == 0 {
        return columns.clone();
    }
    let shift = generator.random_range(rows / 10..rows - rows / 10);
    let mirrored = generator.random::<bool>();
    let from = |k: usize| {
        let moved = (k + shift) % rows;
        if mirrored { rows - 1 - moved } else { moved }
    };
    Mat::from_fn(rows, columns.ncols(), |k, j| columns[(from(k), j)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_measurement::campaign::RangeReading;

    /// Lines of ten readings, each of the station named.
    fn campaign(stations: usize, lines: &[u32]) -> Campaign {
        let reading = |line: usize, station: u32| RangeReading {
            station,
            line: line as u32,
            time_s: line as f64,
            reading_m: [0.0; 3],
            offset_m: [0.0; 3],
            length_m: 0.0,
        };
        let of = |(line, station): (usize, &u32)| vec![reading(line, *station); 10];
        Campaign {
            stations: (0..stations).map(|k| format!("S{k}")).collect(),
            lines: (0..lines.len()).map(|k| k.to_string()).collect(),
            readings: lines.iter().enumerate().flat_map(of).collect(),
            covariates: Vec::new(),
        }
    }

    #[test]
    fn regress_a_station_with_one_line_keeps_it_in_every_fold() {
        let lines = [vec![0; 9], vec![1; 2], vec![2]].concat();
        let campaign = campaign(3, &lines);
        for seed in 0..20 {
            let dealt = folds(&campaign, 4, seed);
            for fold in &dealt.folds {
                let (seen, left) = split(&campaign, fold);
                let stations: BTreeSet<u32> = seen.iter().map(|k| campaign.readings[*k].station).collect();
                assert_eq!(stations.len(), 3, "seed {seed}: every part stands on all stations");
                let lines = |part: &[usize]| part.iter().map(|k| campaign.readings[*k].line).collect::<BTreeSet<u32>>();
                assert!(lines(&seen).is_disjoint(&lines(&left)), "lines are dealt whole");
                let of_first = fold.iter().filter(|line| lines_of(&campaign, **line) == 0).count();
                assert!((2..=3).contains(&of_first), "nine lines over four parts: {of_first}");
            }
            let mut dealt_lines: Vec<u32> = dealt.folds.concat();
            dealt_lines.sort_unstable();
            assert_eq!(dealt_lines, (0..11).collect::<Vec<u32>>(), "all but the only line of the third station");
            assert!(dealt.not_judged.len() == 1 && dealt.not_judged[0].contains("line 11"), "{:?}", dealt.not_judged);
        }
    }

    fn lines_of(campaign: &Campaign, line: u32) -> u32 {
        campaign.readings.iter().find(|r| r.line == line).unwrap().station
    }

    #[test]
    fn a_campaign_of_single_lines_has_no_folds_and_no_panic() {
        let dealt = folds(&campaign(2, &[0, 1]), 4, 1);
        assert!(dealt.folds.is_empty() && dealt.not_judged.len() == 2);
        assert_eq!(dealt_rows(0), 0);
        assert_eq!(dealt_rows(1), 1);
    }

    fn dealt_rows(rows: usize) -> usize {
        super::dealt(&Mat::zeros(rows, 2), &mut ChaCha8Rng::seed_from_u64(1)).nrows()
    }

    #[test]
    fn lines_that_are_predicted_worse_beyond_their_scatter_are_a_loss() {
        let error = HeldOutError { rms_m: 1e-6, interval_m: (0.9e-6, 1.1e-6) };
        let of = |gain_m2| Unseen {
            before: error,
            after: error,
            gain_m2,
            unexplained_m: [0.0; 3],
            found: Vec::new(),
            not_judged: Vec::new(),
        };
        assert!(of((-3.0, -1.0)).loses() && !of((-2.0, 1.0)).loses() && !of((1.0, 2.0)).loses());
    }
}
