//! The rows of a study that are used, and the noise in which its candidates are sought.
//!
//! Place in the flow: between a kind of data and the common search. Rejected rows and parts left out are not in it; each
//! chain of rows (an axis, a component) has a deviation and a correlation of its own, estimated from what the present fit
//! leaves. Rows here are numbered among those kept; rows out are whitened.

use super::candidate::Study;
use super::fit::Fit;
use super::series::{Filter, Noise, Theta, noise};
use super::step::APART;
use crate::error::DiagnoseError;
use crate::score::golden_section;
use crate::score::score;
use abbe_geometry::Axis;
use faer::Mat;

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
    /// Steps since the row before.
    pub(super) gaps: Vec<f64>,
    /// Of a row (m).
    pub(super) unit_m: f64,
    pub(super) along: Option<Axis>,
    pub(super) noise: Noise,
    filter: Filter,
}

/// A study with some of its rows.
pub(super) struct View<'a> {
    pub(super) study: &'a mut dyn Study,
    /// Rows of the study.
    kept: Vec<usize>,
    blocks: Vec<Vec<usize>>,
    chains: Vec<Kept>,
}

impl<'a> View<'a> {
    /// All rows for which `keep` holds, in white noise until [`View::adapt`].
    pub(super) fn new(study: &'a mut dyn Study, rows: usize, keep: impl Fn(usize) -> bool) -> View<'a> {
        let kept: Vec<usize> = (0..rows).filter(|row| study.is_measured(*row) && keep(*row)).collect();
        let mut own = vec![None; rows];
        kept.iter().enumerate().for_each(|(k, row)| own[*row] = Some(k));
        let pick = |rows: &Vec<usize>| rows.iter().filter_map(|row| own[*row]).collect::<Vec<usize>>();
        let blocks = study.blocks().iter().map(pick).filter(|block| !block.is_empty()).collect();
        let chain = |chain: &super::candidate::Chain| {
            let (mut rows, mut gaps, mut since) = (Vec::new(), Vec::new(), 0.0);
            for (row, gap) in chain.rows.iter().zip(&chain.gaps) {
                since += gap;
                if let Some(k) = own[*row] {
                    rows.push(k);
                    gaps.push(since);
                    since = 0.0;
                }
            }
            let filter = Filter::new(Theta::WHITE, &gaps);
            let (of, unit_m, along) = (chain.of.clone(), chain.unit_m, chain.along);
            Kept { of, rows, gaps, unit_m, along, noise: Noise::white(), filter }
        };
        let chains = study.chains().iter().map(chain).filter(|chain| !chain.rows.is_empty()).collect();
        View { study, kept, blocks, chains }
    }

    /// Whether it holds a row of the study.
    pub(super) fn holds(&self, row: usize) -> bool {
        self.kept.binary_search(&row).is_ok()
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

    /// Rows of a matrix of the study that are kept.
    pub(super) fn picked(&self, matrix: &Mat<f64>) -> Mat<f64> {
        Mat::from_fn(self.kept.len(), matrix.ncols(), |i, j| matrix[(self.kept[i], j)])
    }

    /// Columns of a candidate, not whitened.
    pub(super) fn columns(&self, point: &[f64], candidate: usize) -> Mat<f64> {
        self.picked(&self.study.columns(point, candidate))
    }

    /// The one chain a candidate acts on, with its whitened columns there.
    pub(super) fn chain_columns(&self, candidate: usize) -> Option<(usize, Mat<f64>)> {
        let (of, _) = self.study.chain_columns(candidate, &[])?;
        let name = &self.study.chains()[of].of;
        let chain = self.chains.iter().position(|chain| chain.of == *name)?;
        let rows: Vec<usize> = self.chains[chain].rows.iter().map(|k| self.kept[*k]).collect();
        let (_, columns) = self.study.chain_columns(candidate, &rows)?;
        Some((chain, self.whitened_in(chain, columns)))
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
            let own = Mat::from_fn(chain.rows.len(), columns.ncols(), |i, j| columns[(chain.rows[i], j)]);
            let own = self.whitened_in(k, own);
            for (i, row) in chain.rows.iter().enumerate() {
                (0..columns.ncols()).for_each(|j| whitened[(*row, j)] = own[(i, j)]);
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

    fn noise_of(&self, chain: usize, fit: &Fit) -> Noise {
        let chain = &self.chains[chain];
        let rows: Vec<f64> = chain.rows.iter().map(|row| fit.raw_residuals[*row]).collect();
        let columns =
            Mat::from_fn(chain.rows.len(), fit.raw_columns.ncols(), |i, j| fit.raw_columns[(chain.rows[i], j)]);
        noise(&chain.gaps, &columns, &rows)
    }

    /// Takes white noise of the size that a fit leaves.
    pub(super) fn take_white(&mut self, fit: &Fit) {
        for k in 0..self.chains.len() {
            let square: f64 = self.chains[k].rows.iter().map(|row| fit.raw_residuals[*row].powi(2)).sum();
            let sigma = (square / self.chains[k].rows.len() as f64).sqrt().max(f64::MIN_POSITIVE);
            self.set_noise(k, Noise { sigma, ..Noise::white() });
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
        self.chains[chain].filter = Filter::new(noise.theta, &self.chains[chain].gaps);
        self.chains[chain].noise = noise;
    }

    /// The frequency near its own at which a candidate explains most of what a fit without it leaves.
    pub(super) fn refine(&mut self, fit: &Fit, candidate: usize) {
        let Some((own, reach)) = self.study.frequency(candidate) else { return };
        let Some((of, _)) = self.study.chain_columns(candidate, &[]) else { return };
        let name = self.study.chains()[of].of.clone();
        let Some(chain) = self.chains.iter().position(|chain| chain.of == name) else { return };
        let rows: Vec<usize> = self.chains[chain].rows.iter().map(|k| self.kept[*k]).collect();
        let part = fit.part(self, &[chain]);
        let explained = |frequency: f64| {
            let columns = self.whitened_in(chain, self.study.columns_at(candidate, frequency, &rows));
            score(&part.project(columns.as_ref()), part.chi2, part.degrees).reduction
        };
        let frequency = golden_section((own - reach, own + reach), explained);
        self.study.set_frequency(candidate, frequency);
    }

    /// Sets the steps of a candidate where they explain most of what a fit without it leaves, less the price of the choice: one after
    /// another, and again beside the others until none moves.
    pub(super) fn place(&mut self, fit: &Fit, candidate: usize) {
        let count = self.study.steps_after(candidate).len();
        let Some((of, _)) = self.study.chain_columns(candidate, &[]) else { return };
        let name = &self.study.chains()[of].of;
        let Some(chain) = self.chains.iter().position(|chain| chain.of == *name) else { return };
        let rows: Vec<usize> = self.chains[chain].rows.iter().map(|k| self.kept[*k]).collect();
        let part = fit.part(self, &[chain]);
        let worth = |places: &[usize]| {
            let columns = self.whitened_in(chain, self.study.columns_from(candidate, places, &rows));
            let score = score(&part.project(columns.as_ref()), part.chi2, part.degrees);
            score.gain - 2.0 * self.study.choices(candidate, places).ln()
        };
        let (mut taken, mut unmoved): (Vec<usize>, usize) = (Vec::new(), 0);
        for _ in 0..MOST_ROUNDS * count {
            let moving = if taken.len() == count { Some(taken.remove(0)) } else { None };
            let Some(place) = best_place(self.study.places(candidate), &taken, &worth) else { return };
            taken.push(place);
            unmoved = if moving == Some(place) { unmoved + 1 } else { 0 };
            if taken.len() == count && (count == 1 || unmoved == count) {
                break;
            }
        }
        taken.sort_unstable();
        self.study.set_places(candidate, &taken);
    }
}

/// The place worth most beside those taken: first among some, then around the best of these.
fn best_place(places: &[usize], taken: &[usize], worth: &impl Fn(&[usize]) -> f64) -> Option<usize> {
    let is_apart = |k: &usize| taken.iter().all(|other| places[*k].abs_diff(*other) >= APART);
    let value = |k: usize| {
        let mut all = [taken, &[places[k]]].concat();
        all.sort_unstable();
        (k, worth(&all))
    };
    let best = |among: &mut dyn Iterator<Item = usize>| {
        let all = among.filter(is_apart).map(value);
        all.reduce(|best, own| if own.1 > best.1 { own } else { best }).map(|(k, _)| k)
    };
    let stride = places.len().div_ceil(COARSE).max(1);
    let near = best(&mut (0..places.len()).step_by(stride))?;
    best(&mut (near.saturating_sub(stride)..(near + stride + 1).min(places.len()))).map(|k| places[k])
}
