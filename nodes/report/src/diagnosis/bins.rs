//! Means of residuals over a quantity, with the band that their scatter gives.
//!
//! In each bin a size a is estimated from residuals r_k = a·w_k + noise, by least squares: a = Σ w r / Σ w². With w the
//! share of an axis in the line of sight, a is the displacement along the axis; with w = 1 it is the mean.

/// Levels up to which each value of the quantity is a bin of its own.
const LEVELS: usize = 12;
/// Bins of equal width otherwise.
const BINS: usize = 24;
/// A bin with fewer observations joins its neighbour.
const FEWEST: usize = 6;
/// Half width of a 95 % interval in standard deviations.
const BAND_95: f64 = 1.96;
/// Values closer than this share of the range are one level.
const SAME: f64 = 1e-9;

/// Estimates over a quantity.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Binned {
    pub(super) x: Vec<f64>,
    pub(super) y: Vec<Option<f64>>,
    pub(super) half_width: Vec<Option<f64>>,
}

/// One observation: quantity, weight, residual.
pub(super) type Point = (f64, f64, f64);

/// Estimates by bin, in ascending order of the quantity.
pub(super) fn binned(points: &[Point]) -> Binned {
    let mut sorted: Vec<Point> = points.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut all = Binned::default();
    for bin in bins(&sorted) {
        let mean_x = bin.iter().map(|p| p.0).sum::<f64>() / bin.len() as f64;
        let (value, half_width) = estimate(bin);
        all.x.push(mean_x);
        all.y.push(value);
        all.half_width.push(half_width);
    }
    all
}

fn bins(sorted: &[Point]) -> Vec<&[Point]> {
    let (Some(first), Some(last)) = (sorted.first(), sorted.last()) else { return Vec::new() };
    let range = last.0 - first.0;
    let levels: Vec<&[Point]> = sorted.chunk_by(|a, b| b.0 - a.0 <= SAME * range).collect();
    if levels.len() <= LEVELS {
        return levels;
    }
    let bin = |p: &Point| (((p.0 - first.0) / range * BINS as f64) as usize).min(BINS - 1);
    let mut starts = vec![0];
    for (k, pair) in sorted.windows(2).enumerate() {
        let next = k + 1;
        let is_full = next - starts.last().unwrap_or(&0) >= FEWEST && sorted.len() - next >= FEWEST;
        if bin(&pair[0]) != bin(&pair[1]) && is_full {
            starts.push(next);
        }
    }
    let ends = starts.iter().skip(1).copied().chain([sorted.len()]);
    starts.iter().zip(ends).map(|(start, end)| &sorted[*start..end]).collect()
}

/// Size and half width of its 95 % interval; missing where the weights say nothing.
fn estimate(bin: &[Point]) -> (Option<f64>, Option<f64>) {
    let information: f64 = bin.iter().map(|(_, w, _)| w * w).sum();
    if information <= 0.0 {
        return (None, None);
    }
    let size = bin.iter().map(|(_, w, r)| w * r).sum::<f64>() / information;
    if bin.len() < 2 {
        return (Some(size), None);
    }
    let scatter: f64 = bin.iter().map(|(_, w, r)| (w * (r - w * size)).powi(2)).sum();
    let few = bin.len() as f64 / (bin.len() as f64 - 1.0);
    (Some(size), Some(BAND_95 * (scatter * few).sqrt() / information))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_stay_levels_and_means_are_means() {
        let points = [(1.0, 1.0, 3.0), (-1.0, 1.0, 1.0), (1.0, 1.0, 5.0), (-1.0, 1.0, 1.0)];
        let found = binned(&points);
        assert_eq!((found.x, found.y), (vec![-1.0, 1.0], vec![Some(1.0), Some(4.0)]));
        assert_eq!(found.half_width, [Some(0.0), Some(BAND_95 * 1.0)]);
    }

    #[test]
    fn a_displacement_is_found_whatever_share_the_sight_has_of_it() {
        let point = |k: u32| {
            let share = f64::from(k).sin();
            (f64::from(k), share, -2.5 * share)
        };
        let found = binned(&(0..500).map(point).collect::<Vec<_>>());
        assert_eq!(found.x.len(), BINS, "500 observations fill every bin");
        assert!(found.y.iter().all(|y| (y.unwrap() + 2.5).abs() < 1e-12));
    }

    #[test]
    fn sparse_bins_join_their_neighbours() {
        let cluster = (0..100).map(|k| (f64::from(k) * 1e-3, 1.0, 1.0));
        let tail = (1..=8).map(|k| (f64::from(k) * 10.0, 1.0, 1.0));
        let found = binned(&cluster.chain(tail).collect::<Vec<_>>());
        assert_eq!(found.x.len(), 2, "{:?}", found.x);
    }

    #[test]
    fn nothing_gives_nothing() {
        assert_eq!(binned(&[]), Binned::default());
        assert_eq!(binned(&[(0.0, 0.0, 1.0)]).y, [None]);
    }
}
