//! A positioning logger, written by itself: an axis with flaws told in words of its builder, not of the engine. Sweeps up
//! and down, rests between cycles, noise that wanders, rows knocked off.

use abbe_diagnose::study::runs::{Approach, Run};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;

/// What an axis does wrong (µm, at distances in mm and times in s).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Flaw {
    Nothing,
    /// A scale graduated anew at every target: deviations with this spread.
    Graduation(f64),
    /// A nut with play.
    Play(f64),
    /// A nut worn along the screw: play by target with this spread.
    WornNut(f64),
    /// A mount that creeps between cycles, by so much a cycle.
    CreepingMount(f64),
    /// A screw that grows steadily, by so much in the whole record, from the fixed bearing at the lower end.
    GrowingScrew(f64),
    /// An offset that runs away steadily, by so much in the whole record.
    Runaway(f64),
    /// A scale that is bent: half a turn of a smooth curve and more.
    Bow(f64),
    /// A screw with a pitch of a seventh of the stroke and this amplitude.
    Wobble(f64),
}

pub(crate) struct Plan {
    pub(crate) targets: usize,
    pub(crate) cycles: i64,
    /// Standard deviation of one reading (µm).
    pub(crate) sigma_um: f64,
    /// Correlation of one reading with the next.
    pub(crate) rho: f64,
    /// Share of rows knocked off by 30 to 200 deviations.
    pub(crate) gross: f64,
    pub(crate) has_times: bool,
}

impl Plan {
    pub(crate) fn new(targets: usize, cycles: i64) -> Plan {
        Plan { targets, cycles, sigma_um: 1.0, rho: 0.0, gross: 0.0, has_times: true }
    }
}

pub(crate) fn normal(generator: &mut ChaCha8Rng) -> f64 {
    // Sum of uniforms: no formula shared with other simulators here, and light tails suffice.
    (0..12).map(|_| generator.random::<f64>()).sum::<f64>() - 6.0
}

/// Runs of one axis, 800 mm long.
pub(crate) fn logged(plan: &Plan, flaws: &[Flaw], seed: u64) -> Vec<Run> {
    let mut generator = ChaCha8Rng::seed_from_u64(0x5eed_0000 + seed);
    let step = 800.0 / (plan.targets as f64 - 1.0);
    // Not on a lattice, as the standard asks.
    let places: Vec<f64> =
        (0..plan.targets).map(|k| step * k as f64 + 0.25 * step * generator.random_range(-1.0..1.0)).collect();
    let marks: Vec<f64> = centred(plan.targets, &mut generator);
    let wear: Vec<f64> = centred(plan.targets, &mut generator);
    let total = 2.0 * plan.targets as f64 * plan.cycles as f64;
    let mut wandering = normal(&mut generator);
    let (mut runs, mut seconds) = (Vec::new(), 0.0);
    for cycle in 1..=plan.cycles {
        for upwards in [true, false] {
            for k in 0..plan.targets {
                let k = if upwards { k } else { plan.targets - 1 - k };
                wandering = plan.rho * wandering + (1.0 - plan.rho * plan.rho).sqrt() * normal(&mut generator);
                let mut um = 4.0 + plan.sigma_um * wandering;
                let elapsed = runs.len() as f64 / total;
                for flaw in flaws {
                    um += match *flaw {
                        Flaw::Nothing => 0.0,
                        Flaw::Graduation(size) => size * marks[k],
                        Flaw::Play(size) => {
                            if upwards {
                                0.0
                            } else {
                                -size
                            }
                        }
                        Flaw::WornNut(size) => {
                            if upwards {
                                0.0
                            } else {
                                -size * wear[k]
                            }
                        }
                        Flaw::CreepingMount(size) => size * (cycle - 1) as f64,
                        Flaw::GrowingScrew(size) => size * elapsed * places[k] / 800.0,
                        Flaw::Runaway(size) => size * elapsed,
                        Flaw::Bow(size) => size * (places[k] / 800.0 * 4.0).sin(),
                        Flaw::Wobble(size) => size * (places[k] / 800.0 * 7.0 * std::f64::consts::TAU + 0.9).sin(),
                    };
                }
                if generator.random::<f64>() < plan.gross {
                    let size = generator.random_range(30.0..200.0) * plan.sigma_um;
                    um += if generator.random_bool(0.5) { size } else { -size };
                }
                runs.push(Run {
                    axis: "X".to_owned(),
                    target_m: places[k] / 1e3,
                    approach: if upwards { Approach::Positive } else { Approach::Negative },
                    cycle,
                    measured_m: places[k] / 1e3 + um * 1e-6,
                    time_s: plan.has_times.then_some(seconds),
                    covariates: BTreeMap::new(),
                });
                seconds += 9.0;
            }
        }
    }
    runs
}

/// Deviations without a mean, of unit spread.
fn centred(count: usize, generator: &mut ChaCha8Rng) -> Vec<f64> {
    let raw: Vec<f64> = (0..count).map(|_| normal(generator)).collect();
    let mean = raw.iter().sum::<f64>() / count as f64;
    let spread = (raw.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count as f64).sqrt();
    raw.into_iter().map(|v| (v - mean) / spread).collect()
}
