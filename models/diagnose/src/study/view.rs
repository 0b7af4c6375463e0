//! The rows of a study that are used, and the noise in which its candidates are sought.
//!
//! Place in the flow: between a kind of data and the common search. Rejected rows and parts left out are not in it; each
//! chain of rows (an axis, a component) has a deviation and a correlation of its own, estimated from what the present fit
//! leaves. Rows here are numbered among those kept; rows out are whitened.

use super::candidate::Study;
use super::display::{FINEST_M, hidden, step};
use super::fit::Fit;
use super::series::{Filter, Noise, Theta, noise};
use crate::error::DiagnoseError;
use crate::score::golden_section;
use crate::score::score;
use abbe_geometry::Axis;
use faer::Mat;

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
    /// Step of the display, in units of a row; `None` where there is none.
    pub(super) step: Option<f64>,
    filter: Filter,
}

impl Kept {
    /// A deviation, with what the display hides of it.
    fn with_hidden(&self, sigma: f64) -> f64 {
        self.step.map_or(sigma, |step| sigma.hypot(hidden(step, sigma)))
    }

    /// Standard uncertainty of a mean of many rows, in units of a row, that no scatter shows.
    pub(super) fn hidden(&self) -> f64 {
        self.step.map_or(0.0, |step| hidden(step, self.noise.sigma))
    }
}

/// Errors as they were shown (m), a row each; none where they hang on the fit.
fn shown_m(study: &dyn Study) -> Vec<f64> {
    let Ok(local) = study.local(&[]) else { return Vec::new() };
    local.residual.iter().enumerate().map(|(row, residual)| residual * study.row_unit_m(row)).collect()
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
        let shown_m = shown_m(&*study);
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
            let own: Vec<f64> = rows.iter().filter_map(|row| shown_m.get(kept[*row]).copied()).collect();
            let step = step(&own, FINEST_M).map(|step_m| step_m / unit_m);
            Kept { of, rows, gaps, unit_m, along, noise: Noise::white(), step, filter }
        };
        let chains = study.chains().iter().map(chain).filter(|chain| !chain.rows.is_empty()).collect();
        View { study, kept, blocks, chains }
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
        let noise = noise(&chain.gaps, &columns, &rows);
        let sigma = chain.with_hidden(noise.sigma);
        // What is left of rounding follows the places, not the order.
        if chain.step.is_some_and(|step| noise.sigma < hidden(step, 0.0)) {
            return Noise { sigma, degrees: noise.degrees, ..Noise::white() };
        }
        Noise { sigma, ..noise }
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
}
