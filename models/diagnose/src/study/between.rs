//! Whether an effect that acts between blocks stands out from the scatter of blocks.
//!
//! Place in the flow: beside the F test of the search, as in the analysis of a split plot (Montgomery, Design and Analysis
//! of Experiments, chapter 14). Cycles that are each set to zero anew, or days of a campaign, differ by more than the
//! scatter within them; a trend through them is judged by their means, with as few degrees of freedom as there are.

use super::fit::Fit;
use super::view::View;
use crate::linear::Linear;
use crate::score::score;
use faer::Mat;

/// Share of an effect's information that lies between blocks, from which the means must show it.
const MOSTLY: f64 = 0.5;
/// Probability by chance that is borne: the F test of the rows has been passed already.
const BORNE: f64 = 0.05;

/// Whether columns (not whitened) that act mostly between blocks are seen in the means of blocks; they are the best of so many.
pub(super) fn stands_out(view: &View, fit: &Fit, columns: &Mat<f64>, trials: usize) -> bool {
    let chains = view.touched(columns);
    let groups = groups(view, &chains);
    let (base, effect) = (means(&fit.raw_columns, &groups), means(columns, &groups));
    let rows = Mat::from_fn(fit.raw_residuals.len(), 1, |i, _| fit.raw_residuals[i]);
    let observed = means(&rows, &groups);
    let observed: Vec<f64> = (0..groups.len()).map(|k| observed[(k, 0)]).collect();
    let base = super::series::independent(&base);
    if base.ncols() == 0 || groups.len() <= base.ncols() {
        return true;
    }
    let Ok((linear, _)) = Linear::least_squares(base, &observed) else { return true };
    let between = linear.project(effect.as_ref());
    let all = fit.linear.project(view.whitened(columns).as_ref());
    // Both in units of the rows: a mean of n rows weighs √n.
    let trace = |matrix: &Mat<f64>| (0..matrix.ncols()).map(|k| matrix[(k, k)]).sum::<f64>();
    let rows_alone = trace(&(columns.transpose() * columns));
    let share_left = trace(&all.left) / trace(&all.alone).max(f64::MIN_POSITIVE);
    if trace(&between.left) < MOSTLY * rows_alone * share_left {
        return true;
    }
    let found = score(&between, linear.chi2(), linear.degrees());
    found.degrees == 0
        || groups.len() as f64 - (linear.jacobian().ncols() + found.degrees) as f64 <= 0.0
        || found.p_value * trials as f64 <= BORNE
}

/// Rows of each block in each chain.
fn groups(view: &View, chains: &[usize]) -> Vec<Vec<usize>> {
    let mut groups = Vec::new();
    for chain in chains {
        let mut is_own = vec![false; view.len()];
        view.chains()[*chain].rows.iter().for_each(|row| is_own[*row] = true);
        let own = |block: &Vec<usize>| block.iter().copied().filter(|row| is_own[*row]).collect::<Vec<_>>();
        groups.extend(view.blocks().iter().map(own).filter(|group| !group.is_empty()));
    }
    groups
}

/// √n times the mean of each group.
fn means(matrix: &Mat<f64>, groups: &[Vec<usize>]) -> Mat<f64> {
    Mat::from_fn(groups.len(), matrix.ncols(), |k, j| {
        groups[k].iter().map(|row| matrix[(*row, j)]).sum::<f64>() / (groups[k].len() as f64).sqrt()
    })
}
