//! The gate: what explains the readings must also predict those taken elsewhere, or it stays out of the model.
//!
//! Place in the flow: after each fit that [`crate::search`] wants to adopt, and once more for all that it adopted. A term
//! that is not there can explain what another cause did at the offsets, stations and covariates that were measured, and
//! then moves the tip wrongly everywhere else. So whole lines, spans of time, stations, offsets and ranges of each covariate that
//! the term reads are left out of both fits, with all that is fitted, the term included; the fit with it must predict
//! lines better than chance among lines, and may not lose in any kind of block (beyond chance, if it acts on the range only).
//! Both are judged over the same readings, weights and directions ([`crate::paired`]). Whitened residuals; no units.

use crate::blocks::blocks;
use crate::candidates::Round;
use crate::context::{read_by, same_offset};
use crate::paired::{Pair, Untold, pairs};
use abbe_geometry::effects::{State, is_scale};
use abbe_identify::{CampaignRow, EffectTerm};
use abbe_measurement::campaign::Campaign;

/// Standard deviations by which lines left out must be predicted better. The scatter is taken between lines, so noise
/// that is correlated along a line cannot pass for a gain.
const GAIN: f64 = 2.5;
/// Standard deviations of a gain by chance by which a kind of block may be predicted worse by a term that acts on the range
/// only. Where the fits differ by more than the noise, the one that is wrong loses by several.
const LOSS: f64 = 1.0;
/// The same for a term that moves the tip: none to speak of. Blocks that tell nothing of the term come out a little better or
/// worse, which must not decide.
const NO_LOSS: f64 = 0.25;
/// Values that a covariate must have for one of them to be left out: of two, the other tells nothing of what changes between them.
const LEVELS: usize = 3;
/// Blocks of a covariate's range. A tenth at either end is extrapolated to. A covariate that was set to no more values than these is not:
/// its lowest and highest value are far from the next, and what bends between three loads is not told by two of them.
const RANGE_BLOCKS: usize = 10;

/// Kinds of block that are no covariate.
const LEFT_OUT: [&str; 4] = ["line", "time", "station", "offset"];

/// One kind of block, judged.
#[derive(Debug, Clone, PartialEq)]
pub struct Judged {
    /// What was left out: `line`, `time`, `station`, `offset`, or the name of a covariate.
    pub by: String,
    /// How many blocks.
    pub blocks: usize,
    /// Whitened rms without the term.
    pub before: f64,
    /// Whitened rms with it, over the same readings.
    pub after: f64,
    /// Gain in its standard deviations: from the scatter between lines for lines, else by chance if the term is right.
    pub deviations: f64,
}

/// What the gate says of a term, or of all terms.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Verdict {
    /// Each kind of block that the campaign can form.
    pub judged: Vec<Judged>,
    /// Kinds that it cannot form, in words.
    pub missing: Vec<String>,
    /// Why the term stays out; `None` where it may go in.
    pub refused: Option<String>,
}

/// Judges a fit with these terms more against one without them.
pub(crate) fn judge(before: &Round, after: &Round, campaign: &Campaign, terms: &[EffectTerm]) -> Verdict {
    let mut verdict = Verdict::default();
    let noise = after.linear.noise_factor();
    let (limit, untold) = match moves_tip(campaign, terms) {
        true => (-NO_LOSS, Untold::Judged),
        false => (-LOSS, Untold::LeftOut),
    };
    for (by, blocks) in kinds(campaign, after, terms) {
        let is_quantity = !LEFT_OUT.contains(&by.as_str());
        if blocks.len() < if is_quantity { 1 } else { 2 } {
            verdict.missing.push(match is_quantity {
                true => format!("{by} has too few values: what the term does at another one cannot be judged"),
                false => format!("there is one {by} only: what the term does at another one cannot be judged"),
            });
            continue;
        }
        let pairs = pairs(before, after, &blocks, untold);
        let gains = by == "line" && touches_lines(after, campaign, terms);
        let deviations = if by == "line" { between(&pairs) } else { by_chance(&pairs, noise) };
        let worst = if by == "line" { by_chance(&pairs, noise).min(deviations) } else { deviations };
        let judged = judged(by, &pairs, deviations);
        if verdict.refused.is_none() {
            verdict.refused = reason(&judged, worst, limit, gains);
        }
        verdict.judged.push(judged);
    }
    verdict
}

/// Whether lines left out are predicted better beyond chance among lines, where neither fit need know a line that it never saw.
pub(crate) fn gains_on_lines(before: &Round, after: &Round, campaign: &Campaign) -> bool {
    let lines = blocks(campaign, after).into_iter().find(|(by, _)| *by == "line");
    lines.is_some_and(|(_, blocks)| between(&pairs(before, after, &blocks, Untold::LeftOut)) >= GAIN)
}

fn reason(judged: &Judged, worst: f64, limit: f64, must_gain: bool) -> Option<String> {
    let Judged { by, before, after, deviations, .. } = judged;
    if worst < limit {
        return Some(format!(
            "readings of each {} left out are predicted worse with it: {after:.3} instead of {before:.3} of their \
             uncertainty, {:.1} standard deviations",
            what(by),
            -worst
        ));
    }
    (must_gain && *deviations < GAIN).then(|| {
        format!(
            "it fits, but lines left out are not predicted better beyond chance: {after:.3} instead of {before:.3} of \
             their uncertainty, {deviations:.1} standard deviations, {GAIN} are asked for"
        )
    })
}

fn what(by: &str) -> String {
    match by {
        "time" => "span of time".to_owned(),
        "line" | "station" | "offset" => by.to_owned(),
        covariate => format!("range of {covariate}"),
    }
}

fn judged(by: String, pairs: &[Pair], deviations: f64) -> Judged {
    let judged: usize = pairs.iter().map(|p| p.judged).sum();
    let rms = |of: fn(&Pair) -> f64| (pairs.iter().map(of).sum::<f64>() / judged.max(1) as f64).sqrt();
    Judged { by, blocks: pairs.len(), before: rms(|p| p.before), after: rms(|p| p.after), deviations }
}

/// Gain over its standard deviation by the scatter of the blocks.
fn between(pairs: &[Pair]) -> f64 {
    let gains: Vec<f64> = pairs.iter().map(|p| p.before - p.after).collect();
    let (count, sum) = (gains.len() as f64, gains.iter().sum::<f64>());
    let mean = sum / count.max(1.0);
    let scatter: f64 = gains.iter().map(|gain| (gain - mean).powi(2)).sum();
    ratio(sum, scatter * count / (count - 1.0).max(1.0))
}

/// Gain over its standard deviation by chance, if the second fit is right.
fn by_chance(pairs: &[Pair], noise: f64) -> f64 {
    ratio(pairs.iter().map(|p| p.before - p.after).sum(), noise * pairs.iter().map(|p| p.variance).sum::<f64>())
}

fn ratio(gain: f64, variance: f64) -> f64 {
    if variance > 0.0 { gain / variance.sqrt() } else { 0.0 }
}

/// Whether any term moves chain or tip at any reading.
pub(crate) fn moves_tip(campaign: &Campaign, terms: &[EffectTerm]) -> bool {
    terms.iter().any(|term| {
        (0..campaign.readings.len()).any(|reading| {
            let r = &campaign.readings[reading];
            let row = CampaignRow { campaign, reading };
            let state = State { reading_m: r.reading_m, offset_m: r.offset_m, covariates: &row };
            let mut moves = false;
            let known = term.effect.motion(&state, &mut |_, _, amount| moves |= amount != 0.0);
            known.is_ok() && moves
        })
    })
}

/// Whether any term is seen on more than one line: what lives on one line cannot be predicted on others.
fn touches_lines(round: &Round, campaign: &Campaign, terms: &[EffectTerm]) -> bool {
    terms.iter().any(|term| {
        let Ok(partials) = round.rows.partials(term.effect.as_ref()) else { return true };
        let moved = |k: usize| round.rows.whitening[k] > 0.0 && (0..partials.ncols()).any(|j| partials[(k, j)] != 0.0);
        let mut lines = (0..partials.nrows()).filter(|k| moved(*k)).map(|k| campaign.readings[k].line);
        let first = lines.next();
        lines.any(|line| Some(line) != first)
    })
}

/// Blocks by line, station and time, by offset, and by the range of each covariate that the terms read.
fn kinds(campaign: &Campaign, round: &Round, terms: &[EffectTerm]) -> Vec<(String, Vec<Vec<usize>>)> {
    let mut kinds: Vec<(String, Vec<Vec<usize>>)> =
        blocks(campaign, round).into_iter().map(|(by, blocks)| (by.to_owned(), blocks)).collect();
    kinds.push(("offset".to_owned(), by_offset(campaign, round)));
    for name in quantities(terms) {
        kinds.push((name.clone(), by_range(campaign, round, &name)));
    }
    kinds
}

fn used<'r>(round: &'r Round<'_>) -> impl Iterator<Item = usize> + 'r {
    (0..round.rows.len()).filter(|k| round.rows.whitening[*k] > 0.0)
}

pub(crate) fn by_offset(campaign: &Campaign, round: &Round) -> Vec<Vec<usize>> {
    let mut offsets: Vec<([f64; 3], Vec<usize>)> = Vec::new();
    for k in used(round) {
        let offset_m = campaign.readings[k].offset_m;
        match offsets.iter_mut().find(|(known, _)| same_offset(known, &offset_m)) {
            Some((_, block)) => block.push(k),
            None => offsets.push((offset_m, vec![k])),
        }
    }
    offsets.into_iter().map(|(_, block)| block).collect()
}

/// Covariates that terms read; scales are left out with lines, offsets have blocks of their own, and so has time.
fn quantities(terms: &[EffectTerm]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for term in terms {
        for name in read_by(term.effect.as_ref(), &term.shape) {
            let has_own_blocks = is_scale(&name) || name.starts_with("offset_") || name == abbe_identify::TIME;
            if !has_own_blocks && !names.contains(&name) {
                names.push(name);
            }
        }
    }
    names
}

/// Readings in order of a covariate, cut where it changes into blocks of about the same size.
fn by_range(campaign: &Campaign, round: &Round, name: &str) -> Vec<Vec<usize>> {
    let value = |reading: usize| {
        let r = &campaign.readings[reading];
        let row = CampaignRow { campaign, reading };
        State { reading_m: r.reading_m, offset_m: r.offset_m, covariates: &row }.quantity(name).ok()
    };
    let mut sorted: Vec<(f64, usize)> = used(round).filter_map(|k| Some((value(k)?, k))).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let levels = 1 + sorted.windows(2).filter(|pair| pair[0].0 != pair[1].0).count();
    if levels < LEVELS {
        return Vec::new();
    }
    if levels <= RANGE_BLOCKS {
        let mut blocks: Vec<Vec<usize>> =
            sorted.chunk_by(|a, b| a.0 == b.0).map(|level| level.iter().map(|(_, k)| *k).collect()).collect();
        return blocks.drain(1..levels - 1).collect();
    }
    let size = sorted.len().div_ceil(RANGE_BLOCKS).max(1);
    let mut blocks: Vec<Vec<usize>> = Vec::new();
    let mut last = f64::NAN;
    for (value, k) in sorted {
        match blocks.last_mut() {
            Some(block) if block.len() < size || value == last => block.push(k),
            _ => blocks.push(vec![k]),
        }
        last = value;
    }
    blocks
}
