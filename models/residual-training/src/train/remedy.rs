//! What to write in `[split]` where points cannot be dealt as it says.
//!
//! Place in the flow: before a training is refused. Splits are tried in the order in which they change least: other folds; smaller
//! blocks; single points, whose figures flatter.

use crate::config::{Config, Split, SplitKind};

/// What a deal of points to folds leaves.
pub(super) struct Dealt {
    /// Points left to learn from where fewest are.
    pub(super) learnt: usize,
    /// Points in the smallest fold.
    smallest: usize,
}

impl Dealt {
    /// Where of so many folds after another nothing is learnt.
    pub(super) fn of(fold: &[usize], folds: usize, unseen: usize) -> Dealt {
        let mut held = vec![0; folds];
        fold.iter().for_each(|number| held[*number] += 1);
        let hidden = |number: usize| (0..unseen).map(|next| held[(number + next) % folds]).sum::<usize>();
        Dealt {
            learnt: (0..folds).map(|number| fold.len() - hidden(number)).min().unwrap_or(0),
            smallest: held.iter().copied().min().unwrap_or(0),
        }
    }

    pub(super) fn suffices(&self, least: usize) -> bool {
        self.smallest > 0 && self.learnt >= least
    }
}

/// The first split that works, by the deal of these very points.
pub(super) fn split(asked: &Split, works: impl Fn(&Split) -> bool) -> Option<Split> {
    let folds = || {
        let mut all: Vec<usize> = Config::FOLDS.collect();
        all.sort_by_key(|folds| folds.abs_diff(asked.folds));
        all
    };
    let in_blocks = (asked.blocks_per_axis..=*Config::BLOCKS_PER_AXIS.end())
        .filter(|_| asked.kind == SplitKind::Blocks)
        .flat_map(|blocks_per_axis| folds().into_iter().map(move |folds| Split { folds, blocks_per_axis, ..*asked }));
    let by_points = folds().into_iter().map(|folds| Split { kind: SplitKind::Random, folds, ..*asked });
    in_blocks.chain(by_points).find(works)
}

/// Points from which so many folds of even size leave enough to learn from.
pub(super) fn enough(folds: usize, unseen: usize, least: usize) -> usize {
    // Each more point is dealt to one fold, so that this ends: folds are more than those that are not seen.
    (least..).find(|count| count - unseen * count.div_ceil(folds) >= least).unwrap_or(least)
}
