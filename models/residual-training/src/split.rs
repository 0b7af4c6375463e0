//! Folds: which points are held out together.
//!
//! Place in the flow: places of measured points in (their first three inputs: the position, m, machine frame, where there is one),
//! the fold of each out. Neighbouring points share their error, so
//! points dealt one by one are judged by their own neighbours; blocks of space are not. Blocks are the cells of a regular
//! division of the box around all points, dealt to the folds in random order such that folds grow evenly.

use crate::config::{Split, SplitKind};
use abbe_field::corners;
use nalgebra::Vector3;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;

/// Block of each point: points of one number are never separated. Of a random split each point is a block of its own.
pub fn blocks(points_m: &[Vector3<f64>], split: &Split) -> Vec<usize> {
    match split.kind {
        SplitKind::Random => (0..points_m.len()).collect(),
        SplitKind::Blocks => cells(points_m, split.blocks_per_axis),
    }
}

/// Cell of each point when the box around them is divided `per_axis` times along each axis.
fn cells(points_m: &[Vector3<f64>], per_axis: usize) -> Vec<usize> {
    let (low, high) = corners(3, points_m.iter().map(|point| point.as_slice()));
    let cell = |point: &Vector3<f64>| {
        let place = |axis: usize| {
            let share = (point[axis] - low[axis]) / (high[axis] - low[axis]);
            // A flat direction has one cell.
            if share.is_finite() { ((share * per_axis as f64) as usize).min(per_axis - 1) } else { 0 }
        };
        (place(0) * per_axis + place(1)) * per_axis + place(2)
    };
    points_m.iter().map(cell).collect()
}

/// Fold of each point, 0 to `folds` − 1.
pub fn folds(points_m: &[Vector3<f64>], split: &Split, seed: u64) -> Vec<usize> {
    let block = blocks(points_m, split);
    let mut size: BTreeMap<usize, usize> = BTreeMap::new();
    block.iter().for_each(|b| *size.entry(*b).or_default() += 1);
    let mut order: Vec<usize> = size.keys().copied().collect();
    order.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    let mut held = vec![0; split.folds];
    let mut fold_of = BTreeMap::new();
    for b in order {
        let smallest = (0..split.folds).min_by_key(|fold| held[*fold]).unwrap_or(0);
        held[smallest] += size.get(&b).copied().unwrap_or(0);
        fold_of.insert(b, smallest);
    }
    block.iter().map(|b| fold_of.get(b).copied().unwrap_or(0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lattice() -> Vec<Vector3<f64>> {
        (0..1000).map(|k| Vector3::new((k / 100) as f64, (k / 10 % 10) as f64, (k % 10) as f64) * 0.05).collect()
    }

    #[test]
    fn a_block_is_never_divided_and_folds_are_of_even_size() {
        let points = lattice();
        let split = Split::default();
        let (block, fold) = (blocks(&points, &split), folds(&points, &split, 1));
        for a in 0..points.len() {
            for b in 0..a {
                assert!(block[a] != block[b] || fold[a] == fold[b]);
            }
        }
        let sizes: Vec<usize> = (0..5).map(|f| fold.iter().filter(|g| **g == f).count()).collect();
        assert!(sizes.iter().all(|s| (170..=230).contains(s)), "{sizes:?}");
    }

    #[test]
    fn seeds_deal_differently_and_repeatably() {
        let (points, split) = (lattice(), Split::default());
        assert_eq!(folds(&points, &split, 3), folds(&points, &split, 3));
        assert_ne!(folds(&points, &split, 3), folds(&points, &split, 4));
    }

    #[test]
    fn points_in_a_plane_are_divided_along_it() {
        let flat: Vec<_> = lattice().into_iter().map(|p| Vector3::new(p.x, p.y, 0.2)).collect();
        let block = blocks(&flat, &Split::default());
        assert!(block.iter().collect::<std::collections::BTreeSet<_>>().len() == 16);
    }
}
