//! Anderson acceleration of an update that is repeated until it changes nothing.
//!
//! Place in the flow: [`crate::smoothing`] repeats the update of its penalties, and each costs a factorisation of the whole system. Here the
//! last few updates tell how each of them was undone by the next, and the step is taken that would have left least (Walker & Ni 2011, SIAM J.
//! Numer. Anal. 49, 1715, type II). Where the update leads to is the same; it is reached in fewer of them.

use crate::linear::{Factor, dot};
use faer::Mat;
use std::collections::VecDeque;

/// Updates that are looked back on.
const DEPTH: usize = 4;
/// Share of the largest square by which the squares of differences are raised, so that two that say the same are no contradiction.
const RIDGE: f64 = 1e-8;

/// What the last updates did.
#[derive(Debug, Default)]
pub(crate) struct Anderson {
    /// Change by the last update, and where it led.
    last: Option<(Vec<f64>, Vec<f64>)>,
    /// Differences of both from one update to the next.
    differences: VecDeque<(Vec<f64>, Vec<f64>)>,
}

impl Anderson {
    /// Where to go from `at`, when the update leads `to`; `weights` say how much a change of each number matters.
    pub(crate) fn step(&mut self, at: &[f64], to: &[f64], weights: &[f64]) -> Vec<f64> {
        let change = difference(to, at);
        if let Some((change_before, to_before)) = self.last.replace((change.clone(), to.to_vec())) {
            self.differences.push_back((difference(&change, &change_before), difference(to, &to_before)));
            if self.differences.len() > DEPTH {
                self.differences.pop_front();
            }
        }
        let weighed = |values: &[f64]| values.iter().zip(weights).map(|(value, weight)| value * weight).collect();
        let past: Vec<Vec<f64>> = self.differences.iter().map(|(change, _)| weighed(change)).collect();
        let now: Vec<f64> = weighed(&change);
        let Some(shares) = shares(&past, &now) else {
            self.forget();
            return to.to_vec();
        };
        let mut next = to.to_vec();
        for (share, (_, led)) in shares.iter().zip(&self.differences) {
            next.iter_mut().zip(led).for_each(|(next, led)| *next -= share * led);
        }
        next
    }

    /// Begins anew: what the last updates did is no guide any more.
    pub(crate) fn forget(&mut self) {
        *self = Anderson::default();
    }
}

/// Shares of the past changes that make up the present one, by least squares.
fn shares(past: &[Vec<f64>], now: &[f64]) -> Option<Vec<f64>> {
    if past.is_empty() {
        return Some(Vec::new());
    }
    let largest = past.iter().map(|past| dot(past, past)).fold(f64::MIN_POSITIVE, f64::max);
    let ridge = |i: usize, j: usize| if i == j { RIDGE * largest } else { 0.0 };
    let squares = Mat::from_fn(past.len(), past.len(), |i, j| dot(&past[i], &past[j]) + ridge(i, j));
    let right: Vec<f64> = past.iter().map(|past| dot(past, now)).collect();
    let shares = Factor::new(&squares).ok()?.solve(&right);
    shares.iter().all(|share| share.is_finite()).then_some(shares)
}

fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An update that shrinks the distance to (1, 2, 3) along three directions by 0.9, 0.6 and 0.2.
    fn update(at: &[f64]) -> Vec<f64> {
        let away = difference(at, &[1.0, 2.0, 3.0]);
        let along = [[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 0.0, 1.0]].map(|d| (d, dot(&d, &away) / dot(&d, &d)));
        let mut to = vec![1.0, 2.0, 3.0];
        for ((direction, size), rate) in along.into_iter().zip([0.9, 0.6, 0.2]) {
            to.iter_mut().zip(direction).for_each(|(to, d)| *to += rate * size * d);
        }
        to
    }

    fn updates_until_settled(accelerated: bool) -> (usize, Vec<f64>) {
        let (mut anderson, mut at) = (Anderson::default(), vec![-4.0, 9.0, 5.0]);
        for count in 1.. {
            let to = update(&at);
            if difference(&to, &at).iter().all(|change| change.abs() < 1e-6) {
                return (count, to);
            }
            at = if accelerated { anderson.step(&at, &to, &[1.0; 3]) } else { to };
        }
        unreachable!()
    }

    #[test]
    fn a_slow_update_arrives_at_the_same_place_in_a_tenth_of_the_steps() {
        let ((plain, _), (fast, place)) = (updates_until_settled(false), updates_until_settled(true));
        assert!(plain > 100 && fast <= 10, "{plain}, {fast}");
        assert!(difference(&place, &[1.0, 2.0, 3.0]).iter().all(|off| off.abs() < 1e-5), "{place:?}");
    }

    #[test]
    fn an_update_that_is_no_number_is_handed_on_and_forgotten() {
        let mut anderson = Anderson::default();
        anderson.step(&[0.0, 0.0], &[1.0, 2.0], &[1.0; 2]);
        assert!(anderson.step(&[1.0, 2.0], &[f64::NAN, 3.0], &[1.0; 2])[0].is_nan());
        assert_eq!(anderson.step(&[1.0, 2.0], &[1.5, 2.5], &[1.0; 2]), [1.5, 2.5]);
    }

    #[test]
    fn an_update_that_says_the_same_twice_is_followed() {
        let mut anderson = Anderson::default();
        for at in [0.0, 1.0, 2.0, 3.0] {
            // Every update goes one further: nothing of a change is undone by the next.
            let next = anderson.step(&[at, at], &[at + 1.0, at + 1.0], &[1.0, 1.0]);
            assert!(next.iter().all(|next| next.is_finite()));
        }
    }
}
