//! A part of a long list that stands for the whole: where a fit, a start or a picture needs only some thousand readings.
//!
//! Place in the flow: everything that looks at a part of the readings takes it from here: the start of the stations, the
//! first fits of a large campaign, residual fields, recorded drivers, pictures. Indices in, indices out.
//!
//! Campaigns are regular: lines of so many points, to and fro, station by station. Every n-th reading of such a list meets
//! the same place of each line where n divides the length of a line, and its part then lies in a plane or lacks an axis.
//! So the list is cut into equal blocks, and one member is taken from each at a place that a fixed generator draws
//! (jittered sampling: Cook 1986, Stochastic sampling in computer graphics): as even as every n-th, and no period can
//! fall into step with it. The same list gives the same part.

/// Fixes the draws.
const SEED: u64 = 0x5ab3_9c1e_77d2_40f1;

/// At most `most` of `count` indices, evenly spread, in ascending order; all of them where they are no more.
pub fn spread(count: usize, most: usize) -> Vec<usize> {
    if count <= most {
        return (0..count).collect();
    }
    // In 128 bits: the product of two lengths may exceed 64.
    let bound = |block: usize| (block as u128 * count as u128 / most as u128) as usize;
    let drawn = |block: usize| {
        let (from, to) = (bound(block), bound(block + 1));
        from + (draw(block as u64) % (to - from) as u64) as usize
    };
    (0..most).map(drawn).collect()
}

/// The same for each group on its own (stations, lines): of the members of a group of `n`, at most `most_of(n)`. `groups`
/// names the group of each index; the indices kept come in ascending order.
pub fn spread_by_group(groups: impl Iterator<Item = u32>, most_of: impl Fn(usize) -> usize) -> Vec<usize> {
    let mut members: Vec<Vec<usize>> = Vec::new();
    for (index, group) in groups.enumerate() {
        if members.len() <= group as usize {
            members.resize_with(group as usize + 1, Vec::new);
        }
        members[group as usize].push(index);
    }
    let kept = |own: &Vec<usize>| -> Vec<usize> {
        spread(own.len(), most_of(own.len())).into_iter().map(|place| own[place]).collect()
    };
    let mut indices: Vec<usize> = members.iter().flat_map(kept).collect();
    indices.sort_unstable();
    indices
}

/// A number that looks random and is always the same (the mixing step of SplitMix64: Steele, Lea and Flood 2014).
fn draw(block: u64) -> u64 {
    let mut z = SEED.wrapping_add(block.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_of_each_block_in_order_and_always_the_same() {
        for (count, most) in [(300_000, 30_000), (4_001, 4_000), (17, 5), (5, 1)] {
            let part = spread(count, most);
            assert_eq!(part.len(), most);
            let inside =
                |(block, index): (usize, &usize)| (block * count / most..(block + 1) * count / most).contains(index);
            assert!(part.iter().enumerate().all(inside));
            assert_eq!(part, spread(count, most));
        }
        assert_eq!(spread(3, 3), [0, 1, 2]);
        assert_eq!((spread(0, 7), spread(7, 0)), (vec![], vec![]));
    }

    /// Of lines of any length, to and fro or not, every place is met about equally often.
    #[test]
    fn regress_no_length_of_line_falls_into_step() {
        let (count, most) = (100_000, 10_000);
        let part = spread(count, most);
        for length in 2..60 {
            let mut met = vec![0.0_f64; length];
            part.iter().for_each(|index| met[index % length] += 1.0);
            let expected = most as f64 / length as f64;
            let chi2: f64 = met.iter().map(|found| (found - expected).powi(2) / expected).sum();
            // χ² of length − 1 degrees of freedom at most: 5 standard deviations.
            let degrees = length as f64 - 1.0;
            assert!(chi2 < degrees + 5.0 * (2.0 * degrees).sqrt() + 5.0, "{length}: {chi2}");
        }
    }

    #[test]
    fn a_small_group_keeps_all_and_a_large_one_its_share() {
        // Two large stations in turn, and a small one of three readings.
        let groups = (0..1000_u32).map(|k| if k.is_multiple_of(400) { 2 } else { k % 2 });
        let of = |group: u32, part: &[usize]| {
            let all: Vec<u32> = groups.clone().collect();
            part.iter().filter(|k| all[**k] == group).count()
        };
        let part = spread_by_group(groups.clone(), |_| 50);
        assert_eq!([0, 1, 2].map(|group| of(group, &part)), [50, 50, 3]);
        assert!(part.is_sorted());
    }
}
