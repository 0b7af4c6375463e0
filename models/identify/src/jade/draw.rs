//! What JADE draws: factors, partners, trials, and what is thrown out of the archive.
//!
//! Place in the flow: [`super::minimise`] asks for one trial a member; every number comes from one seeded ChaCha stream in
//! a fixed order. Source: Zhang & Sanderson 2009, eq. 8 and 10 to 14, table I.

use super::Bounds;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use std::f64::consts::PI;

/// Scale of the Cauchy distribution of F and deviation of the normal distribution of CR.
const SCALE: f64 = 0.1;

/// A trial and the factors that made it.
pub(super) struct Trial {
    pub(super) point: Vec<f64>,
    pub(super) f: f64,
    pub(super) cr: f64,
}

/// The source of all chance.
pub(super) struct Draw {
    generator: ChaCha8Rng,
}

impl Draw {
    pub(super) fn new(seed: u64) -> Draw {
        Draw { generator: ChaCha8Rng::seed_from_u64(seed) }
    }

    /// A trial for `member`, from population, archive and the best members; `(mean_f, mean_cr)` as adapted so far.
    pub(super) fn trial(
        &mut self,
        member: usize,
        (population, archive, best): (&[Vec<f64>], &[Vec<f64>], &[usize]),
        bounds: Option<&Bounds>,
        (mean_f, mean_cr): (f64, f64),
    ) -> Trial {
        let (cr, f) = (self.cr(mean_cr), self.f(mean_f));
        let towards = &population[best[self.generator.random_range(0..best.len())]];
        let first = self.other_than(population.len(), &[member]);
        let second = self.other_than(population.len() + archive.len(), &[member, first]);
        let second = population.get(second).unwrap_or_else(|| &archive[second - population.len()]);
        let (own, first) = (&population[member], &population[first]);
        let certain = self.generator.random_range(0..own.len());
        let component = |j: usize| {
            // One number is drawn for each component, whether it is needed or not.
            let chance: f64 = self.generator.random();
            if chance >= cr && j != certain {
                return own[j];
            }
            let mutant = own[j] + f * (towards[j] - own[j]) + f * (first[j] - second[j]);
            bounds.map_or(mutant, |bounds| within(bounds[j], own[j], mutant))
        };
        Trial { point: (0..own.len()).map(component).collect(), f, cr }
    }

    /// Removes members at random until `most` are left.
    pub(super) fn thin_out(&mut self, archive: &mut Vec<Vec<f64>>, most: usize) {
        while archive.len() > most {
            let place = self.generator.random_range(0..archive.len());
            archive.swap_remove(place);
        }
    }

    /// Normal about the mean, cut to 0 … 1.
    fn cr(&mut self, mean: f64) -> f64 {
        let deviate: f64 = self.generator.sample(StandardNormal);
        (mean + SCALE * deviate).clamp(0.0, 1.0)
    }

    /// Cauchy about the location, drawn again while not above 0, cut to 1.
    fn f(&mut self, location: f64) -> f64 {
        loop {
            let u: f64 = self.generator.random();
            let f = location + SCALE * (PI * (u - 0.5)).tan();
            if f > 0.0 {
                return f.min(1.0);
            }
        }
    }

    /// A place below `count` that is none of `taken`.
    fn other_than(&mut self, count: usize, taken: &[usize]) -> usize {
        loop {
            let place = self.generator.random_range(0..count);
            if !taken.contains(&place) {
                return place;
            }
        }
    }
}

/// Half-way from the parent to a bound that the mutant has crossed.
fn within((lower, upper): (f64, f64), own: f64, mutant: f64) -> f64 {
    if mutant < lower {
        0.5 * (lower + own)
    } else if mutant > upper {
        0.5 * (upper + own)
    } else {
        mutant
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_follow_their_distributions() {
        let mut draw = Draw::new(3);
        let count = 20_000;
        let mut f: Vec<f64> = (0..count).map(|_| draw.f(0.5)).collect();
        f.sort_by(f64::total_cmp);
        assert!(f[0] > 0.0 && f[count - 1] == 1.0);
        // P(F > 0) = 1/2 + atan(5)/π = 0.9372 before drawing again; the median of what is left solves
        // P(0 < F < m) = 0.4686: m = 0.5 + 0.1 tan(π(0.0628 + 0.4686 − 0.5)) = 0.50991.
        assert!((f[count / 2] - 0.50991).abs() < 0.005, "{}", f[count / 2]);
        // P(F ≥ 1) = 1/2 − atan(5)/π = 0.0628 of 0.9372.
        let ones = f.iter().filter(|f| **f == 1.0).count() as f64 / count as f64;
        assert!((ones - 0.0670).abs() < 0.006, "{ones}");
        let cr: Vec<f64> = (0..count).map(|_| draw.cr(0.5)).collect();
        let mean = cr.iter().sum::<f64>() / count as f64;
        let deviation = (cr.iter().map(|cr| (cr - mean).powi(2)).sum::<f64>() / count as f64).sqrt();
        assert!((mean - 0.5).abs() < 0.003 && (deviation - 0.1).abs() < 0.003, "{mean} {deviation}");
    }

    #[test]
    fn a_trial_is_the_mutation_of_the_source_worked_out_by_hand() {
        // Four members on a line, the best alone to go towards: with F = f, x = 0, x_p = 8, partners among 1, 3, 8,
        // every trial is f·8 + f·(r1 − r2) with r1 ≠ r2.
        let population: Vec<Vec<f64>> = [0.0, 1.0, 3.0, 8.0].iter().map(|v| vec![*v]).collect();
        let mut draw = Draw::new(5);
        let differences: Vec<f64> = [1.0, 3.0, 8.0].iter().flat_map(|a| [1.0, 3.0, 8.0].map(|b| a - b)).collect();
        for _ in 0..200 {
            let trial = draw.trial(0, (&population, &[], &[3]), None, (0.5, 0.5));
            let difference = trial.point[0] / trial.f - 8.0;
            assert!(difference.abs() > 0.5, "both partners are the same: {difference}");
            assert!(differences.iter().any(|d| (d - difference).abs() < 1e-9), "{difference}");
        }
    }

    #[test]
    fn archived_parents_take_part_and_a_crossed_bound_is_met_half_way() {
        let population: Vec<Vec<f64>> = [0.0, 1.0, 3.0, 8.0].iter().map(|v| vec![*v]).collect();
        let archive = vec![vec![-100.0]];
        let mut draw = Draw::new(5);
        let far = (0..200).filter(|_| draw.trial(0, (&population, &archive, &[3]), None, (0.5, 0.5)).point[0] > 20.0);
        // One of three possible partners is the archived one.
        assert!((30..=110).contains(&far.count()));
        for _ in 0..200 {
            let bounds = [(-1.0, 9.0)];
            let trial = draw.trial(0, (&population, &archive, &[3]), Some(&bounds), (0.5, 0.5));
            assert!((-1.0..=9.0).contains(&trial.point[0]));
        }
        assert_eq!(within((-1.0, 9.0), 0.5, 20.0), 4.75);
        assert_eq!(within((-1.0, 9.0), 0.5, -20.0), -0.25);
    }

    #[test]
    fn the_archive_is_cut_to_its_size() {
        let mut archive: Vec<Vec<f64>> = (0..20).map(|k| vec![f64::from(k)]).collect();
        Draw::new(1).thin_out(&mut archive, 6);
        assert_eq!(archive.len(), 6);
        Draw::new(1).thin_out(&mut archive, 6);
        assert_eq!(archive.len(), 6);
    }
}
