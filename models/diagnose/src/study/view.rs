//! The rows of a study that are used, and the noise in which its candidates are sought.
//!
//! Place in the flow: between a kind of data and the common search. Rejected rows and parts left out are not in it; each
//! chain of rows (an axis, a component) has a deviation and a correlation of its own, estimated from what the present fit
//! leaves. Rows here are numbered among those kept; rows out are whitened.

use super::candidate::Study;
use super::display::{FINEST_M, hidden, step};
use super::filters::Gaps;
use super::fit::{Fit, Fitted, independent};
use super::memory::{Based, Memory, Start};
use super::series::{Filter, Noise, Theta, noise};
use super::step::APART;
use super::waves::best;
use crate::error::DiagnoseError;
use crate::linear::{Linear, column, joined, picked};
use crate::peak::peak;
use crate::score::score;
use abbe_geometry::Axis;
use abbe_identify::in_parallel;
use faer::Mat;
use std::sync::Arc;

/// Places of a step that are tried before those around the best, and rounds in which several are set.
const COARSE: usize = 64;
const MOST_ROUNDS: usize = 5;

/// Rows of one chain that are kept.
#[derive(Debug, Clone)]
pub(super) struct Kept {
    /// In words.
    pub(super) of: String,
    /// In the view, in order.
    pub(super) rows: Vec<usize>,
    /// The same rows of the study.
    rows_of_study: Vec<usize>,
    /// Steps since the row before; chains with the same ones share them.
    pub(super) gaps: Arc<Gaps>,
    /// Of a row (m).
    pub(super) unit_m: f64,
    pub(super) along: Option<Axis>,
    pub(super) noise: Noise,
    /// Step of the display, in units of a row; `None` where there is none.
    pub(super) step: Option<f64>,
    filter: Filter,
}

impl Kept {
    /// A deviation, with what the display hides of it.
    fn with_hidden(&self, sigma: f64) -> f64 {
        self.step.map_or(sigma, |step| sigma.hypot(hidden(step, sigma)))
    }

    /// Noise, with what the display hides of it.
    fn with_display(&self, noise: Noise) -> Noise {
        let sigma = self.with_hidden(noise.sigma);
        // What is left of rounding follows the places, not the order.
        if self.step.is_some_and(|step| noise.sigma < hidden(step, 0.0)) {
            return Noise { sigma, degrees: noise.degrees, ..Noise::white() };
        }
        Noise { sigma, ..noise }
    }

    /// Standard uncertainty of a mean of many rows, in units of a row, that no scatter shows.
    pub(super) fn hidden(&self) -> f64 {
        self.step.map_or(0.0, |step| hidden(step, self.noise.sigma))
    }
}

/// A study with some of its rows.
pub(super) struct View<'a> {
    pub(super) study: &'a mut dyn Study,
    /// Rows of the study.
    kept: Vec<usize>,
    blocks: Vec<Vec<usize>>,
    chains: Vec<Kept>,
    memory: Memory,
}

impl<'a> View<'a> {
    /// All rows for which `keep` holds, in white noise until [`View::adapt`].
    pub(super) fn new(study: &'a mut dyn Study, rows: usize, keep: impl Fn(usize) -> bool) -> View<'a> {
        let kept: Vec<usize> = (0..rows).filter(|row| study.is_measured(*row) && keep(*row)).collect();
        let mut own = vec![None; rows];
        kept.iter().enumerate().for_each(|(k, row)| own[*row] = Some(k));
        let pick = |rows: &Vec<usize>| rows.iter().filter_map(|row| own[*row]).collect::<Vec<usize>>();
        let blocks = study.blocks().iter().map(pick).filter(|block| !block.is_empty()).collect();
        let mut chains: Vec<Kept> = Vec::with_capacity(study.chains().len());
        for chain in study.chains() {
            let (mut rows, mut rows_of_study, mut steps, mut since) = (Vec::new(), Vec::new(), Vec::new(), 0.0);
            for (row, gap) in chain.rows.iter().zip(&chain.gaps) {
                since += gap;
                if let Some(k) = own[*row] {
                    rows.push(k);
                    rows_of_study.push(*row);
                    steps.push(since);
                    since = 0.0;
                }
            }
            if rows.is_empty() {
                continue;
            }
            let same = chains.iter().find(|other| other.gaps.steps() == steps).map(|other| Arc::clone(&other.gaps));
            let gaps = same.unwrap_or_else(|| Arc::new(Gaps::new(steps)));
            let (of, unit_m, along) = (chain.of.clone(), chain.unit_m, chain.along);
            let (noise, filter) = (Noise::white(), gaps.filter(Theta::WHITE).into_owned());
            chains.push(Kept { of, rows, rows_of_study, gaps, unit_m, along, noise, step: None, filter });
        }
        let mut view = View { study, kept, blocks, chains, memory: Memory::default() };
        view.read_displays();
        view
    }

    /// Finds the step of the display of each chain in the errors as they were shown.
    fn read_displays(&mut self) {
        let Ok(start) = self.start(&[]) else { return };
        for chain in &mut self.chains {
            let shown_m = |(row, of_study): (&usize, &usize)| start.rows[(*row, 0)] * self.study.row_unit_m(*of_study);
            let shown_m: Vec<f64> = chain.rows.iter().zip(&chain.rows_of_study).map(shown_m).collect();
            chain.step = step(&shown_m, FINEST_M).map(|step_m| step_m / chain.unit_m);
        }
    }

    /// Whether it holds a row of the study.
    pub(super) fn holds(&self, row: usize) -> bool {
        self.kept.binary_search(&row).is_ok()
    }

    /// Rows of the study that are kept, in order.
    pub(super) fn kept(&self) -> &[usize] {
        &self.kept
    }

    pub(super) fn len(&self) -> usize {
        self.kept.len()
    }

    pub(super) fn blocks(&self) -> &[Vec<usize>] {
        &self.blocks
    }

    /// Blocks of the chain that has fewest.
    pub(super) fn least_blocks(&self) -> usize {
        let of = |chain: &Kept| {
            let mut is_own = vec![false; self.len()];
            chain.rows.iter().for_each(|row| is_own[*row] = true);
            self.blocks.iter().filter(|block| block.iter().any(|row| is_own[*row])).count()
        };
        self.chains.iter().map(of).min().unwrap_or(self.blocks.len())
    }

    pub(super) fn chains(&self) -> &[Kept] {
        &self.chains
    }

    /// Rows of the study that a chain keeps, in order.
    pub(super) fn rows_of_study(&self, chain: usize) -> &[usize] {
        &self.chains[chain].rows_of_study
    }

    /// Rows of a matrix of the study that are kept.
    pub(super) fn picked(&self, matrix: &Mat<f64>) -> Mat<f64> {
        picked(matrix.as_ref(), &self.kept)
    }

    /// The base model where these candidates have these parameters, and the rows.
    pub(super) fn start(&self, at: &[(usize, Vec<f64>)]) -> Result<Arc<Start>, DiagnoseError> {
        if let Some(start) = self.memory.start.get() {
            return Ok(Arc::clone(start));
        }
        let local = self.study.local(at)?;
        let (base, rows) = (independent(&self.picked(&local.base)), self.picked(&column(&local.residual)));
        let start = Arc::new(Start { point: local.point, base, rows });
        Ok(if self.study.is_linear() { Arc::clone(self.memory.start.get_or_init(|| start)) } else { start })
    }

    /// The fit of the base model alone.
    pub(super) fn based(&self, start: &Start) -> Result<Arc<Based>, DiagnoseError> {
        if let Some(based) = self.memory.based.get() {
            return Ok(Arc::clone(based));
        }
        let observed = self.whitened(&start.rows);
        let (linear, _) = Linear::least_squares(self.whitened(&start.base), observed.col_as_slice(0))?;
        let based = Arc::new(Based { linear, observed });
        Ok(if self.study.is_linear() { Arc::clone(self.memory.based.get_or_init(|| based)) } else { based })
    }

    /// Columns of a candidate, not whitened.
    pub(super) fn columns(&self, point: &[f64], candidate: usize) -> Arc<Mat<f64>> {
        let make = || self.picked(&self.study.columns(point, candidate));
        if self.study.is_linear() { self.memory.columns(candidate, make) } else { Arc::new(make()) }
    }

    /// The one chain that a candidate acts on.
    pub(super) fn chain_of(&self, candidate: usize) -> Option<usize> {
        let (of, _) = self.study.chain_columns(candidate, &[])?;
        let name = &self.study.chains()[of].of;
        self.chains.iter().position(|chain| chain.of == *name)
    }

    /// Whitened columns, side by side, of candidates that act on one chain, and how many each has.
    pub(super) fn chain_columns(&self, chain: usize, candidates: &[usize]) -> (Mat<f64>, Vec<usize>) {
        let rows = &self.chains[chain].rows_of_study;
        let own = |k: &usize| self.study.chain_columns(*k, rows).map_or_else(|| Mat::zeros(rows.len(), 0), |own| own.1);
        let own: Vec<Mat<f64>> = candidates.iter().map(own).collect();
        let counts = own.iter().map(Mat::ncols).collect();
        (self.whitened_in(chain, joined(&own)), counts)
    }

    /// Whitens rows of one chain, in its order.
    pub(super) fn whitened_in(&self, chain: usize, columns: Mat<f64>) -> Mat<f64> {
        let chain = &self.chains[chain];
        let mut columns = chain.filter.whitened(columns);
        columns *= faer::Scale(chain.noise.sigma.recip());
        columns
    }

    /// Whitens all rows.
    pub(super) fn whitened(&self, columns: &Mat<f64>) -> Mat<f64> {
        let mut whitened = columns.clone();
        for (k, chain) in self.chains.iter().enumerate() {
            let own = self.whitened_in(k, picked(columns.as_ref(), &chain.rows));
            for j in 0..columns.ncols() {
                let (all, own) = (whitened.col_as_slice_mut(j), own.col_as_slice(j));
                chain.rows.iter().zip(own).for_each(|(row, value)| all[*row] = *value);
            }
        }
        whitened
    }

    /// Chains on which columns act; all where there are none.
    pub(super) fn touched(&self, columns: &Mat<f64>) -> Vec<usize> {
        let acts =
            |k: &usize| self.chains[*k].rows.iter().any(|row| (0..columns.ncols()).any(|j| columns[(*row, j)] != 0.0));
        (0..self.chains.len()).filter(acts).collect()
    }

    /// Rows of these chains; all where there are no chains.
    pub(super) fn rows_of(&self, chains: &[usize]) -> Vec<usize> {
        if self.chains.is_empty() {
            return (0..self.len()).collect();
        }
        chains.iter().flat_map(|k| self.chains[*k].rows.iter().copied()).collect()
    }

    /// The fit with these candidates, in the noise that it leaves.
    pub(super) fn adapt(&mut self, set: &[usize]) -> Result<Fit, DiagnoseError> {
        let fit = Fit::settle(self, set)?;
        if self.chains.is_empty() {
            return Ok(fit);
        }
        for k in 0..self.chains.len() {
            let noise = self.noise_of(k, &fit);
            self.set_noise(k, noise);
        }
        Fit::settle(self, set)
    }

    fn noise_of(&mut self, chain: usize, fit: &Fit) -> Noise {
        let beside = self.beside(chain, fit);
        if let Some(found) = beside.as_ref().and_then(|beside| self.memory.noise(chain, beside)) {
            return found.clone();
        }
        let own = &self.chains[chain];
        let rows: Vec<f64> = own.rows.iter().map(|row| fit.raw_residuals[*row]).collect();
        let noise = own.with_display(noise(&own.gaps, &picked(fit.raw_columns.as_ref(), &own.rows), &rows));
        if let Some(beside) = beside {
            self.memory.keep_noise(chain, beside, &noise);
        }
        noise
    }

    /// Candidates of a fit that act on a chain, where these alone say what it is left with: with all of their directions, and
    /// columns that are the same in every fit.
    fn beside(&self, chain: usize, fit: &Fit) -> Option<Vec<usize>> {
        let acts = |fitted: &&Fitted| self.chain_of(fitted.candidate).is_none_or(|own| own == chain);
        let whole = |fitted: &Fitted| fitted.map.ncols() == self.study.candidates()[fitted.candidate].parameters.len();
        let own: Vec<&Fitted> = fit.added.iter().filter(acts).collect();
        let is_known = self.study.is_linear() && own.iter().all(|fitted| whole(fitted));
        let mut beside: Vec<usize> = own.iter().map(|fitted| fitted.candidate).collect();
        beside.sort_unstable();
        is_known.then_some(beside)
    }

    /// Takes white noise of the size that a fit leaves.
    pub(super) fn take_white(&mut self, fit: &Fit) {
        for k in 0..self.chains.len() {
            let square: f64 = self.chains[k].rows.iter().map(|row| fit.raw_residuals[*row].powi(2)).sum();
            let sigma = (square / self.chains[k].rows.len() as f64).sqrt().max(f64::MIN_POSITIVE);
            self.set_noise(k, Noise { sigma: self.chains[k].with_hidden(sigma), ..Noise::white() });
        }
    }

    /// Noise of every chain.
    pub(super) fn noises(&self) -> Vec<Noise> {
        self.chains.iter().map(|chain| chain.noise.clone()).collect()
    }

    /// Takes such noise back.
    pub(super) fn take_noises(&mut self, noises: Vec<Noise>) {
        noises.into_iter().enumerate().for_each(|(chain, noise)| self.set_noise(chain, noise));
    }

    /// Takes a description of the noise of a chain.
    pub(super) fn set_noise(&mut self, chain: usize, noise: Noise) {
        self.chains[chain].filter = self.chains[chain].gaps.filter(noise.theta).into_owned();
        self.chains[chain].noise = noise;
        self.memory.forget_fit();
    }

    /// The frequency of its band, of its scan, or near its own, at which a candidate explains most of what a fit without it leaves.
    pub(super) fn refine(&mut self, fit: &Fit, candidate: usize) {
        let Some((own, reach)) = self.study.frequency(candidate) else { return };
        let Some(chain) = self.chain_of(candidate) else { return };
        let frequency = best(self, fit, candidate).unwrap_or_else(|| {
            let rows = &self.chains[chain].rows_of_study;
            let part = fit.part(self, &[chain]);
            let explained = |frequency: f64| {
                let columns = self.whitened_in(chain, self.study.columns_at(candidate, frequency, rows));
                score(&part.project(columns.as_ref()), part.chi2, part.degrees).reduction
            };
            let scan = self.study.scan(candidate);
            let gains = in_parallel(&scan, |frequency| explained(*frequency));
            let best = scan.into_iter().zip(gains).max_by(|a, b| a.1.total_cmp(&b.1)).map_or(own, |(best, _)| best);
            peak((best - reach, best + reach), explained)
        });
        self.set_frequency(candidate, frequency);
    }

    /// Takes this frequency for a candidate.
    pub(super) fn set_frequency(&mut self, candidate: usize, frequency: f64) {
        self.study.set_frequency(candidate, frequency);
        self.memory.forget_columns(candidate);
    }

    /// Sets the steps of a candidate where they are worth most beside a fit without it.
    pub(super) fn place(&mut self, fit: &Fit, candidate: usize) {
        if let Some(places) = self.best_places(fit, candidate) {
            self.set_places(candidate, &places);
        }
    }

    /// Where the steps of a candidate explain most of what a fit without it leaves, less the price of the choice: one after another,
    /// and again beside the others until none moves.
    pub(super) fn best_places(&self, fit: &Fit, candidate: usize) -> Option<Vec<usize>> {
        let count = self.study.steps_after(candidate).len();
        let chain = self.chain_of(candidate)?;
        let rows = &self.chains[chain].rows_of_study;
        let part = fit.part(self, &[chain]);
        // Of each place beside those taken.
        let worth = |taken: &[usize], places: &[usize]| -> Vec<f64> {
            let all = [taken, places].concat();
            let columns = self.whitened_in(chain, self.study.columns_from(candidate, &all, rows));
            let group = part.project(columns.as_ref());
            let one = |k: usize| {
                let members: Vec<usize> = (0..taken.len()).chain([k]).collect();
                let mut set: Vec<usize> = members.iter().map(|member| all[*member]).collect();
                set.sort_unstable();
                let score = score(&group.pick(&members), part.chi2, part.degrees);
                score.gain - 2.0 * self.study.choices(candidate, &set).ln()
            };
            (taken.len()..all.len()).map(one).collect()
        };
        let (mut taken, mut unmoved): (Vec<usize>, usize) = (Vec::new(), 0);
        for _ in 0..MOST_ROUNDS * count {
            let moving = if taken.len() == count { Some(taken.remove(0)) } else { None };
            let place = best_place(self.study.places(candidate), &taken, &worth)?;
            taken.push(place);
            unmoved = if moving == Some(place) { unmoved + 1 } else { 0 };
            if taken.len() == count && (count == 1 || unmoved == count) {
                break;
            }
        }
        taken.sort_unstable();
        Some(taken)
    }

    /// Sets the steps of a candidate.
    pub(super) fn set_places(&mut self, candidate: usize, places: &[usize]) {
        self.study.set_places(candidate, places);
        self.memory.forget_columns(candidate);
    }
}

/// The place worth most beside those taken: first among some, then around the best of these. `worth` is asked for several at once.
fn best_place(places: &[usize], taken: &[usize], worth: &impl Fn(&[usize], &[usize]) -> Vec<f64>) -> Option<usize> {
    let best = |among: &mut dyn Iterator<Item = usize>| {
        let is_apart = |k: &usize| taken.iter().all(|other| places[*k].abs_diff(*other) >= APART);
        let among: Vec<usize> = among.filter(is_apart).collect();
        let places: Vec<usize> = among.iter().map(|k| places[*k]).collect();
        let worth = places.chunks(COARSE).flat_map(|some| worth(taken, some));
        let all = among.into_iter().zip(worth);
        all.reduce(|best, own| if own.1 > best.1 { own } else { best }).map(|(k, _)| k)
    };
    let stride = places.len().div_ceil(COARSE).max(1);
    let near = best(&mut (0..places.len()).step_by(stride))?;
    best(&mut (near.saturating_sub(stride)..(near + stride + 1).min(places.len()))).map(|k| places[k])
}
