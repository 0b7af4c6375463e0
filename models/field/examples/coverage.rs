//! How often twice the uncertainty of kriging holds the truth, on smooth fields of three kinds.
//!
//! Place in the flow: measures what `docs/src/how/fields.md` states. `cargo run --workspace --example coverage [SEEDS] [COUNTS [GROSS_UM]]`
//! prints, for each kind of field and number of vectors, in the hull: coverage at k = 2 of the likeliest parameters and of
//! the averaged ones, root mean square of the error and of u (µm), of both. Errors of 10 µm over 0.8 × 0.6 × 0.6 m, u = 0.3 µm.

use abbe_field::kriging::{Kernel, KrigingOptions, Noise, Trend, judge};
use abbe_field::{Interpolator, Kriging, MeasuredField};
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use std::time::Instant;

const EXTENT_M: [f64; 3] = [0.8, 0.6, 0.6];
const U_M: f64 = 0.3e-6;
const TARGETS: usize = 60;
const OPTIONS: KrigingOptions =
    KrigingOptions { kernel: Kernel::Matern52, trend: Trend::Linear, noise: Noise::DeclaredAndFitted };

/// A smooth field: position in extents in, error (m) out.
type Field = Box<dyn Fn(&Vector3<f64>) -> Vector3<f64>>;

fn normal(random: &mut ChaCha8Rng) -> f64 {
    random.sample(StandardNormal)
}

/// Slopes of 8 µm over the extents, as squareness and scale make them.
fn slopes(random: &mut ChaCha8Rng) -> [Vector3<f64>; 3] {
    [0; 3].map(|_| Vector3::from_fn(|_, _| 8e-6 * normal(random)))
}

fn sines(random: &mut ChaCha8Rng) -> Field {
    let slopes = slopes(random);
    let wave = |random: &mut ChaCha8Rng| {
        let along = Vector3::from_fn(|_, _| 2.5 * normal(random));
        (5e-6 * normal(random), along, random.random_range(0.0..std::f64::consts::TAU))
    };
    let waves: Vec<[(f64, Vector3<f64>, f64); 4]> = (0..3).map(|_| [0; 4].map(|_| wave(random))).collect();
    Box::new(move |p| {
        Vector3::from_fn(|d, _| {
            waves[d].iter().map(|(size, along, phase)| size * (p.dot(along) + phase).sin()).sum::<f64>()
                + p.dot(&slopes[d])
        })
    })
}

fn bumps(random: &mut ChaCha8Rng) -> Field {
    let slopes = slopes(random);
    let bump = |random: &mut ChaCha8Rng| {
        let at = Vector3::from_fn(|_, _| random.random_range(0.0..1.0));
        (8e-6 * normal(random), at, random.random_range(0.25..0.6))
    };
    let bumps: Vec<[(f64, Vector3<f64>, f64); 5]> = (0..3).map(|_| [0; 5].map(|_| bump(random))).collect();
    Box::new(move |p| {
        Vector3::from_fn(|d, _| {
            let one = |(size, at, width): &(f64, Vector3<f64>, f64)| {
                size * (-0.5 * (p - at).norm_squared() / (width * width)).exp()
            };
            bumps[d].iter().map(one).sum::<f64>() + p.dot(&slopes[d])
        })
    })
}

fn polynomials(random: &mut ChaCha8Rng) -> Field {
    let slopes = slopes(random);
    let term = |random: &mut ChaCha8Rng| {
        let powers = [0; 3].map(|_| random.random_range(0..3));
        (8e-6 * normal(random), powers)
    };
    let terms: Vec<[(f64, [i32; 3]); 4]> = (0..3).map(|_| [0; 4].map(|_| term(random))).collect();
    let ripples: Vec<(usize, f64, f64)> = (0..3)
        .map(|_| {
            (random.random_range(0..3), random.random_range(8.0..13.0), random.random_range(0.0..std::f64::consts::TAU))
        })
        .collect();
    Box::new(move |p| {
        let q = p * 2.0 - Vector3::repeat(1.0);
        Vector3::from_fn(|d, _| {
            let one = |(size, powers): &(f64, [i32; 3])| size * (0..3).map(|k| q[k].powi(powers[k])).product::<f64>();
            let (axis, rate, phase) = ripples[d];
            terms[d].iter().map(one).sum::<f64>() + p.dot(&slopes[d]) + 0.8e-6 * (rate * p[axis] + phase).sin()
        })
    })
}

fn places(count: usize, is_grid: bool, random: &mut ChaCha8Rng) -> Vec<Vector3<f64>> {
    if !is_grid {
        return (0..count).map(|_| Vector3::from_fn(|_, _| random.random_range(0.0..1.0))).collect();
    }
    let [x, y, z] = match count {
        0..=11 => [2, 2, 2],
        12..=14 => [3, 2, 2],
        15..=19 => [4, 2, 2],
        20..=26 => [5, 2, 2],
        27..=35 => [3, 3, 3],
        36..=99 => [4, 3, 3],
        _ => [8, 5, 5],
    };
    let share = |k: usize, of: usize| k as f64 / (of - 1) as f64;
    (0..x * y * z).map(|k| Vector3::new(share(k % x, x), share(k / x % y, y), share(k / x / y, z))).collect()
}

#[derive(Default)]
struct Tally {
    all: f64,
    held: f64,
    error: f64,
    u: f64,
    u_m: Vec<f64>,
    seeds_below: usize,
    failed: usize,
    time_s: f64,
    innocent: usize,
    missed: usize,
}

impl Tally {
    fn add(&mut self, method: &dyn Interpolator, targets: &[(Vector3<f64>, Vector3<f64>)]) {
        let (mut all, mut held) = (0.0, 0.0);
        for (at, truth) in targets {
            let Ok(found) = method.at(at) else { continue };
            let Some(u_m) = found.u_m.filter(|_| found.region.is_inside()) else { continue };
            for d in 0..3 {
                let off_m = found.error_m[d] - truth[d];
                all += 1.0;
                held += f64::from(u8::from(off_m.abs() <= 2.0 * u_m[d]));
                self.error += off_m * off_m;
                self.u += u_m[d] * u_m[d];
                self.u_m.push(u_m[d]);
            }
        }
        self.seeds_below += usize::from(held < 0.8 * all);
        self.all += all;
        self.held += held;
    }

    fn text(&self) -> String {
        let mut sorted = self.u_m.clone();
        sorted.sort_by(f64::total_cmp);
        let median = sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN) * 1e6;
        let rms = |sum: f64| (sum / self.all).sqrt() * 1e6;
        format!(
            "{:5.1} % e {:6.3} u {:6.3} median {median:6.3} below80 {:2} failed {} innocent {} missed {} {:6.2} s",
            100.0 * self.held / self.all,
            rms(self.error),
            rms(self.u),
            self.seeds_below,
            self.failed,
            self.innocent,
            self.missed,
            self.time_s
        )
    }
}

/// Draws a field.
type Draws = fn(&mut ChaCha8Rng) -> Field;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let seeds = arguments.first().and_then(|text| text.parse().ok()).unwrap_or(20);
    let counts: Vec<usize> = match arguments.get(1) {
        Some(text) => text.split(',').filter_map(|count| count.parse().ok()).collect(),
        None => vec![10, 12, 15, 20, 40, 200],
    };
    let gross_um: f64 = arguments.get(2).and_then(|text| text.parse().ok()).unwrap_or(0.0);
    let kinds: [(&str, Draws); 3] = [("sines", sines), ("bumps", bumps), ("polynomials", polynomials)];
    for count in counts {
        for (name, kind) in kinds {
            for is_grid in [false, true] {
                let mut tallies = [Tally::default(), Tally::default()];
                for seed in 0..seeds {
                    one(count, is_grid, kind, (seed, gross_um), &mut tallies);
                }
                let [before, after] = tallies.each_ref().map(Tally::text);
                println!(
                    "{count:4} {name:<12} {}  likeliest {before} | averaged {after}",
                    if is_grid { "grid  " } else { "random" }
                );
            }
        }
    }
}

fn one(
    count: usize,
    is_grid: bool,
    kind: fn(&mut ChaCha8Rng) -> Field,
    (seed, gross_um): (u64, f64),
    tallies: &mut [Tally; 2],
) {
    let mut random = ChaCha8Rng::seed_from_u64(seed + 1000);
    let truth = kind(&mut random);
    let shares = places(count, is_grid, &mut random);
    let metres = |p: &Vector3<f64>| p.component_mul(&Vector3::from(EXTENT_M));
    let mut errors_m: Vec<_> =
        shares.iter().map(|p| truth(p) + Vector3::from_fn(|_, _| U_M * normal(&mut random))).collect();
    // One vector in a hundred, at least one.
    let gross: Vec<usize> =
        if gross_um > 0.0 { (0..1.max(shares.len() / 100)).map(|k| 3 + 50 * k).collect() } else { vec![] };
    gross.iter().for_each(|k| errors_m[*k][k % 3] += gross_um * 1e-6);
    let u_m = vec![Vector3::repeat(U_M); shares.len()];
    let Ok(field) = MeasuredField::new(shares.iter().map(metres).collect(), errors_m, Some(u_m)) else { return };
    let targets: Vec<_> = (0..TARGETS)
        .map(|_| Vector3::from_fn(|_, _| random.random_range(0.0..1.0)))
        .map(|p| (metres(&p), truth(&p)))
        .collect();
    let started = Instant::now();
    match Kriging::fit(&field, &OPTIONS) {
        Ok(kriging) => tallies[0].add(&kriging, &targets),
        Err(_) => tallies[0].failed += 1,
    }
    tallies[0].time_s += started.elapsed().as_secs_f64();
    let started = Instant::now();
    match judge(&field, &OPTIONS) {
        Ok((kriging, judgement)) => {
            tallies[1].add(&kriging, &targets);
            let out: Vec<usize> = judgement.left_out.iter().map(|one| one.index).collect();
            tallies[1].innocent += out.iter().filter(|k| !gross.contains(k)).count();
            tallies[1].missed += gross.iter().filter(|k| !out.contains(k)).count();
        }
        Err(why) => {
            eprintln!("seed {seed}: {why}");
            tallies[1].failed += 1;
        }
    }
    tallies[1].time_s += started.elapsed().as_secs_f64();
}
