//! The instant from which on a station's readings agree among themselves, but not with those before.
//!
//! Place in the flow: residuals of one station (m) with the direction of each line of sight in; where a moved tracer or a
//! broken beam explains them, the instant and the size out. The readings of a station that moved by s and whose beam was
//! counted on from another zero by c differ by −u·s − c, u from the station to the reflector: four unknowns on each side of
//! the instant, found robustly; the instant is where the fewest readings are left outside.

use nalgebra::{Matrix4, Vector3, Vector4};

/// Readings that each side must have: four unknowns, and as many again that confirm them.
const FEWEST: usize = 8;
/// Readings that are looked at to find the instant roughly.
const LOOKED_AT: usize = 600;
/// Instants that are tried on these.
const TRIED: usize = 60;
/// Share of the trace below which a direction is not told: rounding, not noise.
const UNTOLD: f64 = 1e-11;
/// Steps of a robust fit.
const PASSES: usize = 12;
/// Standard deviations beyond which a reading counts as outside: where the weights of a fit reject.
const OUTSIDE: f64 = 6.0;
/// Share of the outside readings that a step must bring inside before it explains them.
const EXPLAINED: f64 = 0.75;
/// How much worse an interrupted beam alone may do than a motion, and still be the simpler word: a share of the readings.
const AS_GOOD: f64 = 0.02;

/// A reading of the station.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen {
    /// Its place in the campaign.
    pub(crate) reading: usize,
    /// From the station to the reflector, of length one.
    pub(crate) sight: Vector3<f64>,
    /// Measured less predicted length (m).
    pub(crate) residual_m: f64,
    /// Standard deviation that is expected of it (m).
    pub(crate) u_m: f64,
}

impl Seen {
    fn row(&self) -> Vector4<f64> {
        Vector4::new(-self.sight.x, -self.sight.y, -self.sight.z, -1.0)
    }

    /// Standardised residual beside a change of station and dead path.
    fn left(&self, change: &Vector4<f64>) -> f64 {
        (self.residual_m - self.row().dot(change)) / self.u_m
    }
}

/// A step of a station.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Step {
    /// Last reading before it and first after it, by place in the campaign.
    pub(crate) readings: (usize, usize),
    /// How the station moved (m); `None` where an interrupted beam explains it as well.
    pub(crate) moved_m: Option<Vector3<f64>>,
    /// Change of the dead path (m).
    pub(crate) dead_path_m: f64,
    /// Readings that only the step explains.
    pub(crate) explains: usize,
}

/// The step that explains the readings outside; `None` where none does. Readings in the order of time.
pub(crate) fn find(all: &[Seen]) -> Option<Step> {
    let stride = all.len().div_ceil(LOOKED_AT).max(1);
    let some: Vec<Seen> = all.iter().step_by(stride).copied().collect();
    if some.len() < 2 * FEWEST {
        return None;
    }
    let instants = (1..TRIED).map(|k| k * some.len() / TRIED).filter(|at| (FEWEST..=some.len() - FEWEST).contains(at));
    let tried = instants.filter_map(|at| {
        let (before, after) = (fit(&some[..at], None)?, fit(&some[at..], None)?);
        Some((loss(&some[..at], &before) + loss(&some[at..], &after), before, after))
    });
    let (_, before, after) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let at = exact(all, &before, &after)?;
    let (first, second) = all.split_at(at);
    let (before, after) = (fit(first, None)?, fit(second, None)?);
    // One fit to both sides may leave every reading outside; the residuals as they came then say how many are.
    let unmoved = fit(all, None).map_or(0, |change| outside(all, &change));
    let without = unmoved.max(outside(all, &Vector4::zeros()));
    let with = outside(first, &before) + outside(second, &after);
    if without < FEWEST || with as f64 > (1.0 - EXPLAINED) * without as f64 {
        return None;
    }
    let beam = fit(second, Some(&before))?;
    let is_beam = outside(second, &beam) as f64 <= outside(second, &after) as f64 + AS_GOOD * second.len() as f64;
    let change = if is_beam { beam - before } else { after - before };
    Some(Step {
        readings: (first.last()?.reading, second.first()?.reading),
        moved_m: (!is_beam).then(|| change.xyz()),
        dead_path_m: change.w,
        explains: without - with,
    })
}

/// The instant with these two fits: between readings `at − 1` and `at`.
fn exact(all: &[Seen], before: &Vector4<f64>, after: &Vector4<f64>) -> Option<usize> {
    let mut sum: f64 = all.iter().map(|seen| capped(seen, after)).sum();
    let mut least = (f64::INFINITY, 0);
    for (at, seen) in all.iter().enumerate() {
        if (FEWEST..=all.len() - FEWEST).contains(&at) && sum < least.0 {
            least = (sum, at);
        }
        sum += capped(seen, before) - capped(seen, after);
    }
    (least.1 > 0).then_some(least.1)
}

fn capped(seen: &Seen, change: &Vector4<f64>) -> f64 {
    seen.left(change).powi(2).min(OUTSIDE * OUTSIDE)
}

fn loss(seen: &[Seen], change: &Vector4<f64>) -> f64 {
    seen.iter().map(|seen| capped(seen, change)).sum()
}

fn outside(seen: &[Seen], change: &Vector4<f64>) -> usize {
    seen.iter().filter(|seen| seen.left(change).abs() > OUTSIDE).count()
}

/// Change of station and dead path: least absolute values, then squares of what is inside. With a `station` only the dead
/// path changes from there.
fn fit(seen: &[Seen], station: Option<&Vector4<f64>>) -> Option<Vector4<f64>> {
    let mut change = station.copied().unwrap_or_default();
    for pass in 0..PASSES {
        let mut normal = Matrix4::zeros();
        let mut gradient = Vector4::zeros();
        for one in seen {
            let (row, left) = (one.row() / one.u_m, one.left(&change));
            let weight = match pass {
                0 => 1.0,
                early if early < PASSES - 3 => 1.0 / left.abs().max(1.0),
                _ if left.abs() <= OUTSIDE => 1.0,
                _ => 0.0,
            };
            normal += row * row.transpose() * weight;
            gradient += row * (left * weight);
        }
        // Readings in one direction do not tell all four; a trace of the trace keeps what they do not tell at zero.
        let step = match station {
            Some(_) if normal[(3, 3)] > 0.0 => Vector4::new(0.0, 0.0, 0.0, gradient.w / normal[(3, 3)]),
            Some(_) => Vector4::zeros(),
            None => (normal + Matrix4::identity() * (normal.trace() * UNTOLD)).cholesky()?.solve(&gradient),
        };
        change += step;
    }
    Some(change)
}

#[cfg(test)]
mod tests {
    use super::*;

    const U_M: f64 = 0.3e-6;

    /// 300 readings in all directions of an octant with the noise given; a hundredth are gross errors.
    fn readings(disturbed: impl Fn(usize, &Vector3<f64>) -> f64) -> Vec<Seen> {
        let noise = |k: usize| (((k * 7919) % 1000) as f64 / 1000.0 - 0.5) * 3.4 * U_M;
        let of = |k: usize| {
            let at = k as f64;
            let sight =
                Vector3::new(1.5 + (0.7 * at).sin(), 1.4 + (1.3 * at).cos(), 0.8 * (2.1 * at).sin()).normalize();
            let gross = if k % 100 == 17 { 40e-6 } else { 0.0 };
            Seen { reading: 1000 + k, sight, residual_m: noise(k) + gross + disturbed(k, &sight), u_m: U_M }
        };
        (0..300).map(of).collect()
    }

    #[test]
    fn a_moved_station_is_found_with_its_instant_and_size() {
        let moved_m = Vector3::new(30e-6, -20e-6, 45e-6);
        let step = find(&readings(|k, sight| if k >= 190 { -sight.dot(&moved_m) } else { 0.0 })).unwrap();
        assert_eq!(step.readings, (1189, 1190));
        assert!((step.moved_m.unwrap() - moved_m).norm() < 1e-6, "{step:?}");
    }

    #[test]
    fn an_interrupted_beam_is_told_from_a_moved_station() {
        for size_m in [12e-6, 8e-3] {
            let step = find(&readings(|k, _| if k >= 120 { size_m } else { 0.0 })).unwrap();
            assert_eq!((step.readings, step.moved_m), ((1119, 1120), None));
            assert!((step.dead_path_m + size_m).abs() < 0.3e-6, "{step:?}");
        }
    }

    #[test]
    fn noise_gross_errors_and_a_bad_line_are_no_step() {
        assert_eq!(find(&readings(|_, _| 0.0)), None);
        assert_eq!(find(&readings(|k, _| if (100..140).contains(&k) { 25e-6 } else { 0.0 })), None);
        assert_eq!(find(&readings(|k, _| if k.is_multiple_of(5) { 9e-6 } else { 0.0 })), None);
        assert_eq!(find(&readings(|k, _| 0.3e-6 * k as f64)), None, "a drift is no step");
    }
}
