//! JADE: adaptive differential evolution with an optional archive, for any function of many numbers.
//!
//! Place in the flow: [`crate::points`] offers it beside Levenberg-Marquardt, for objectives that no derivative leads
//! through; nothing here knows a machine. In: a function to be made small, a first population, options with a seed. Out:
//! the best point found, and whether the population agreed on it. Numbers have the unit that the function gives them.
//!
//! Source: Zhang & Sanderson 2009, IEEE Trans. Evol. Comput. 13(5), table I. Each generation, for every member x of the
//! population P:
//! - F is drawn from a Cauchy distribution (location μ_F, scale 0.1; again while ≤ 0, cut to 1), CR from a normal one
//!   (mean μ_CR, deviation 0.1; cut to 0 … 1);
//! - mutation current-to-pbest/1: v = x + F (x_p − x) + F (x_r1 − x_r2), with x_p one of the best p·NP members, x_r1 from
//!   P, x_r2 from P and the archive A of parents that lost;
//! - binomial crossover with CR, at least one component from v; a component beyond its bound goes half-way from x to it;
//! - the trial replaces x only if it is better. Then μ_CR ← (1 − c) μ_CR + c·mean(CR that won), and
//!   μ_F ← (1 − c) μ_F + c·Σ F²/Σ F over those that won (Lehmer mean). A is cut to NP by removing members at random.
//!
//! All trials of a generation are drawn from one seeded generator before any is judged, so the outcome depends neither
//! on the number of threads nor on which finishes first.

mod draw;
mod start;

pub use start::{perturbed_population, uniform_population};

use crate::parallel::in_parallel;
use draw::{Draw, Trial};
use thiserror::Error;

/// μ_CR and μ_F of the first generation.
const FIRST_MEANS: (f64, f64) = (0.5, 0.5);
/// Members that mutation needs: the one that moves, a better one and two others.
const FEWEST_MEMBERS: usize = 4;

/// Lower and upper bound of each number; infinite where there is none.
pub type Bounds = [(f64, f64)];

/// Choices of one search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JadeOptions {
    /// Seed of everything that is drawn after the first population.
    pub seed: u64,
    /// p: share of the best members that others are drawn towards, above 0 up to 1. The source recommends 0.05 to 0.2.
    pub greediness: f64,
    /// c: how fast the means of F and CR follow what succeeds, 0 up to 1. The source recommends 0.05 to 0.2.
    pub adaptation: f64,
    /// Whether parents that lost are kept as a source of directions.
    pub archive: bool,
    /// Generations after which the search is given up.
    pub max_generations: usize,
    /// The population agrees when its worst and best value differ by no more than this (unit of the function).
    pub agreement: f64,
    /// Judge the trials on all cores. Never changes the outcome; worth it where one evaluation takes some microseconds.
    pub parallel: bool,
}

impl Default for JadeOptions {
    fn default() -> JadeOptions {
        JadeOptions {
            seed: 1,
            greediness: 0.05,
            adaptation: 0.1,
            archive: true,
            max_generations: 5000,
            agreement: 1e-9,
            parallel: true,
        }
    }
}

/// One generation, for progress; the observer returns false to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Generation<'a> {
    /// Its number, from 1.
    pub number: usize,
    /// Best point so far.
    pub best: &'a [f64],
    /// Its value.
    pub best_value: f64,
    /// Largest value in the population.
    pub worst_value: f64,
    /// μ_F.
    pub mean_f: f64,
    /// μ_CR.
    pub mean_cr: f64,
    /// Evaluations so far.
    pub evaluations: usize,
}

/// Why a search ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// The population agreed.
    Agreed,
    /// The generations were used up; the point is the best seen, not a minimum.
    OutOfGenerations,
    /// The observer stopped it; the point is the best seen, not a minimum.
    Stopped,
}

/// What a search found.
#[derive(Debug, Clone, PartialEq)]
pub struct Minimum {
    /// Best point.
    pub point: Vec<f64>,
    /// Its value.
    pub value: f64,
    /// Largest minus smallest value of the last population.
    pub spread: f64,
    /// Generations made.
    pub generations: usize,
    /// Evaluations of the function, the first population included.
    pub evaluations: usize,
    /// Why it ended.
    pub ended: Ended,
}

/// A search that cannot begin or go on.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum JadeError {
    /// Too few members.
    #[error("a population of {0} cannot evolve; give at least {FEWEST_MEMBERS} members, better ten for each unknown")]
    TooFewMembers(usize),
    /// Members of different length, or of none.
    #[error("member {member} of the first population has {found} numbers, {expected} were expected (at least one)")]
    Length {
        /// Number of the member, from 1.
        member: usize,
        /// Its length.
        found: usize,
        /// The length it should have.
        expected: usize,
    },
    /// A number of the first population is not finite or outside its bounds.
    #[error("member {member} of the first population, number {number}: {value} is not finite or outside its bounds")]
    Outside {
        /// Number of the member, from 1.
        member: usize,
        /// Place in it, from 1.
        number: usize,
        /// Its value.
        value: f64,
    },
    /// Bounds that hold nothing.
    #[error("bound {number}: {lower} … {upper} holds no number; the lower bound must be below the upper")]
    Bounds {
        /// Place, from 1.
        number: usize,
        /// Lower bound.
        lower: f64,
        /// Upper bound.
        upper: f64,
    },
    /// An option out of its range.
    #[error("{option} is {value}, but must be {range}")]
    Option {
        /// Name of the option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
    /// The function gave no number.
    #[error("the function is not a number at {point:?}; it must give a value, or infinity where it is not defined")]
    NotANumber {
        /// Where.
        point: Vec<f64>,
    },
}

/// Makes a function small, from a first population (see [`uniform_population`], [`perturbed_population`]).
///
/// The function may be infinite where it is not defined, but never NaN. `observe` sees every generation and returns false
/// to stop; what was found so far is then returned with [`Ended::Stopped`]. Only [`Ended::Agreed`] is a minimum, and that
/// no other lies elsewhere is never certain.
///
/// ```
/// use abbe_identify::jade::{Ended, JadeOptions, minimise, uniform_population};
/// let bounds = [(-5.0, 5.0); 3];
/// let sphere = |x: &[f64]| x.iter().map(|v| (v - 1.0) * (v - 1.0)).sum::<f64>();
/// let first = uniform_population(&bounds, 30, 7)?;
/// let found = minimise(&sphere, first, Some(&bounds), &JadeOptions::default(), &mut |_| true)?;
/// assert_eq!(found.ended, Ended::Agreed);
/// assert!(found.point.iter().all(|v| (v - 1.0).abs() < 1e-4));
/// # Ok::<(), abbe_identify::jade::JadeError>(())
/// ```
///
/// # Errors
/// A population, bound or option that makes no sense, or a function that is not a number.
pub fn minimise(
    function: &(impl Fn(&[f64]) -> f64 + Sync),
    first: Vec<Vec<f64>>,
    bounds: Option<&Bounds>,
    options: &JadeOptions,
    observe: &mut dyn FnMut(&Generation) -> bool,
) -> Result<Minimum, JadeError> {
    check_options(options)?;
    check_population(&first, bounds)?;
    let mut search = Search::new(function, first, bounds, options)?;
    let mut ended = Ended::OutOfGenerations;
    for _ in 0..options.max_generations {
        if search.spread() <= options.agreement {
            ended = Ended::Agreed;
            break;
        }
        search.generation()?;
        if !observe(&search.progress()) {
            ended = Ended::Stopped;
            break;
        }
    }
    // The last generation may have brought agreement.
    if ended == Ended::OutOfGenerations && search.spread() <= options.agreement {
        ended = Ended::Agreed;
    }
    Ok(search.minimum(ended))
}

/// State between two generations.
struct Search<'a, F> {
    function: &'a F,
    bounds: Option<&'a Bounds>,
    options: &'a JadeOptions,
    draw: Draw,
    population: Vec<Vec<f64>>,
    values: Vec<f64>,
    /// Members by value, best first.
    ranking: Vec<usize>,
    archive: Vec<Vec<f64>>,
    mean_f: f64,
    mean_cr: f64,
    generations: usize,
    evaluations: usize,
}

impl<'a, F: Fn(&[f64]) -> f64 + Sync> Search<'a, F> {
    fn new(
        function: &'a F,
        population: Vec<Vec<f64>>,
        bounds: Option<&'a Bounds>,
        options: &'a JadeOptions,
    ) -> Result<Search<'a, F>, JadeError> {
        let mut search = Search {
            function,
            bounds,
            options,
            draw: Draw::new(options.seed),
            values: Vec::new(),
            ranking: (0..population.len()).collect(),
            population: Vec::new(),
            archive: Vec::new(),
            mean_cr: FIRST_MEANS.0,
            mean_f: FIRST_MEANS.1,
            generations: 0,
            evaluations: 0,
        };
        search.values = search.judge(population.iter().map(Vec::as_slice).collect())?;
        search.population = population;
        search.rank();
        Ok(search)
    }

    /// Values at these points.
    fn judge(&mut self, points: Vec<&[f64]>) -> Result<Vec<f64>, JadeError> {
        self.evaluations += points.len();
        let value = |point: &&[f64]| (self.function)(point);
        let values: Vec<f64> =
            if self.options.parallel { in_parallel(&points, value) } else { points.iter().map(value).collect() };
        match values.iter().position(|value| value.is_nan()) {
            Some(place) => Err(JadeError::NotANumber { point: points[place].to_vec() }),
            None => Ok(values),
        }
    }

    fn generation(&mut self) -> Result<(), JadeError> {
        self.generations += 1;
        let best = ((self.options.greediness * self.population.len() as f64).round() as usize).max(1);
        let trials: Vec<Trial> = (0..self.population.len())
            .map(|member| {
                let pools = (&self.population[..], &self.archive[..], &self.ranking[..best]);
                self.draw.trial(member, pools, self.bounds, (self.mean_f, self.mean_cr))
            })
            .collect();
        let values = self.judge(trials.iter().map(|trial| trial.point.as_slice()).collect())?;
        let mut won = Vec::new();
        for (member, (trial, value)) in trials.into_iter().zip(values).enumerate() {
            if value < self.values[member] {
                let parent = std::mem::replace(&mut self.population[member], trial.point);
                self.values[member] = value;
                won.push((trial.f, trial.cr));
                if self.options.archive {
                    self.archive.push(parent);
                }
            }
        }
        self.draw.thin_out(&mut self.archive, self.population.len());
        self.adapt(&won);
        self.rank();
        Ok(())
    }

    /// Moves the means towards what succeeded; where nothing did, they stay.
    fn adapt(&mut self, won: &[(f64, f64)]) {
        if won.is_empty() {
            return;
        }
        let c = self.options.adaptation;
        let (f, square) = won.iter().fold((0.0, 0.0), |(sum, square), (f, _)| (sum + f, square + f * f));
        let cr = won.iter().map(|(_, cr)| cr).sum::<f64>() / won.len() as f64;
        self.mean_f = (1.0 - c) * self.mean_f + c * square / f;
        self.mean_cr = (1.0 - c) * self.mean_cr + c * cr;
    }

    fn rank(&mut self) {
        let values = &self.values;
        self.ranking.sort_by(|a, b| values[*a].total_cmp(&values[*b]).then(a.cmp(b)));
    }

    fn best(&self) -> usize {
        self.ranking[0]
    }

    fn worst_value(&self) -> f64 {
        self.ranking.last().map_or(f64::INFINITY, |worst| self.values[*worst])
    }

    /// Infinite while some member is where the function is not defined.
    fn spread(&self) -> f64 {
        let worst = self.worst_value();
        if worst.is_finite() { worst - self.values[self.best()] } else { f64::INFINITY }
    }

    fn progress(&self) -> Generation<'_> {
        Generation {
            number: self.generations,
            best: &self.population[self.best()],
            best_value: self.values[self.best()],
            worst_value: self.worst_value(),
            mean_f: self.mean_f,
            mean_cr: self.mean_cr,
            evaluations: self.evaluations,
        }
    }

    fn minimum(mut self, ended: Ended) -> Minimum {
        let (best, spread) = (self.best(), self.spread());
        Minimum {
            point: self.population.swap_remove(best),
            value: self.values[best],
            spread,
            generations: self.generations,
            evaluations: self.evaluations,
            ended,
        }
    }
}

fn check_options(options: &JadeOptions) -> Result<(), JadeError> {
    let wrong = |option, value, range| Err(JadeError::Option { option, value, range });
    let JadeOptions { greediness, adaptation, agreement, .. } = *options;
    if !(greediness > 0.0 && greediness <= 1.0) {
        return wrong("greediness", greediness, "above 0 and at most 1");
    }
    if !(0.0..=1.0).contains(&adaptation) {
        return wrong("adaptation", adaptation, "between 0 and 1");
    }
    if !(agreement >= 0.0 && agreement.is_finite()) {
        return wrong("agreement", agreement, "a finite number of 0 or more");
    }
    if options.max_generations == 0 {
        return wrong("max_generations", 0.0, "1 or more");
    }
    Ok(())
}

fn check_population(first: &[Vec<f64>], bounds: Option<&Bounds>) -> Result<(), JadeError> {
    if first.len() < FEWEST_MEMBERS {
        return Err(JadeError::TooFewMembers(first.len()));
    }
    if let Some(bounds) = bounds {
        start::check_bounds(bounds)?;
    }
    let expected = bounds.map_or(first[0].len(), <[_]>::len).max(1);
    for (member, numbers) in first.iter().enumerate() {
        if numbers.len() != expected {
            return Err(JadeError::Length { member: member + 1, found: numbers.len(), expected });
        }
        for (number, value) in numbers.iter().enumerate() {
            let inside = bounds.is_none_or(|b| (b[number].0..=b[number].1).contains(value));
            if !(value.is_finite() && inside) {
                return Err(JadeError::Outside { member: member + 1, number: number + 1, value: *value });
            }
        }
    }
    Ok(())
}
