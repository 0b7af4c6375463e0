//! What was measured together, where residual vectors do not say: stretches of time, or cells of space.
//!
//! Place in the flow: the study of vectors leaves these out to judge. Indices of vectors; every block holds some.

use super::ResidualVector;
use std::collections::BTreeMap;

/// Blocks wanted where the file names none.
const WANTED: usize = 8;
/// Fewest vectors of a block that is cut here.
const FEWEST: usize = 4;

/// Blocks and what they are, in words. Fewer than three where the vectors are too few.
pub(super) fn blocks(vectors: &[ResidualVector]) -> (Vec<Vec<usize>>, &'static str) {
    let named: Option<Vec<&String>> = vectors.iter().map(|vector| vector.block.as_ref()).collect();
    if let Some(names) = named {
        let mut groups: BTreeMap<&String, Vec<usize>> = BTreeMap::new();
        names.into_iter().enumerate().for_each(|(k, name)| groups.entry(name).or_default().push(k));
        return (groups.into_values().collect(), "block of the file");
    }
    let times: Option<Vec<f64>> = vectors.iter().map(|vector| vector.time_s).collect();
    let count = WANTED.min(vectors.len() / FEWEST).max(1);
    match times {
        Some(times) => {
            let mut order: Vec<usize> = (0..vectors.len()).collect();
            order.sort_by(|a, b| times[*a].total_cmp(&times[*b]));
            let at = |k: usize| k * order.len() / count;
            ((0..count).map(|k| order[at(k)..at(k + 1)].to_vec()).collect(), "stretch of time")
        }
        None => (cells(vectors, (0..vectors.len()).collect(), count), "cell of space"),
    }
}

/// Cells of equal counts: the longest edge is halved again and again.
fn cells(vectors: &[ResidualVector], mut members: Vec<usize>, count: usize) -> Vec<Vec<usize>> {
    if count < 2 {
        return vec![members];
    }
    let along = |k: usize, d: usize| vectors[k].position_m[d];
    let extent = |d: usize| {
        let low = members.iter().map(|k| along(*k, d)).fold(f64::INFINITY, f64::min);
        members.iter().map(|k| along(*k, d)).fold(f64::NEG_INFINITY, f64::max) - low
    };
    let longest = (0..3).max_by(|a, b| extent(*a).total_cmp(&extent(*b))).unwrap_or(0);
    members.sort_by(|a, b| along(*a, longest).total_cmp(&along(*b, longest)));
    let lower = count / 2;
    let upper = members.split_off(members.len() * lower / count);
    let mut all = cells(vectors, members, lower);
    all.extend(cells(vectors, upper, count - lower));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vectors() -> Vec<ResidualVector> {
        let at =
            |k: usize| ResidualVector { position_m: [(k % 10) as f64, (k / 10) as f64, 0.0], ..Default::default() };
        (0..80).map(at).collect()
    }

    #[test]
    fn cells_of_space_hold_equal_counts_and_every_vector_once() {
        let (blocks, what) = blocks(&vectors());
        assert_eq!((blocks.len(), what), (8, "cell of space"));
        assert!(blocks.iter().all(|block| block.len() == 10));
        let mut all: Vec<usize> = blocks.concat();
        all.sort_unstable();
        assert_eq!(all, (0..80).collect::<Vec<_>>());
    }

    #[test]
    fn named_blocks_come_before_time_and_time_before_space() {
        let mut vectors = vectors();
        vectors.iter_mut().enumerate().for_each(|(k, vector)| vector.time_s = Some(-(k as f64)));
        let (in_time, what) = blocks(&vectors);
        assert_eq!((what, in_time[0][0]), ("stretch of time", 79));
        vectors.iter_mut().enumerate().for_each(|(k, vector)| vector.block = Some(format!("run {}", k % 3)));
        let (named, what) = blocks(&vectors);
        assert_eq!((what, named.len(), named[1][0]), ("block of the file", 3, 1));
    }
}
