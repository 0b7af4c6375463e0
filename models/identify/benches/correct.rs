//! Time of one correction and one predicted length, with effects, and where their covariates are lacking.
//!
//! Place in the flow: `cargo bench -p abbe-identify --bench correct`. The model is identified from a simulated campaign and then
//! given effects of believable sizes; samples lie all over its volume. What an effect that is left out costs more than one that
//! is evaluated (its doubt is made on a grid over the usual range, see `abbe_geometry`'s `doubt.rs`) is printed as a ratio.

#![allow(missing_docs, clippy::unwrap_used)] // criterion's macros; a bench that cannot be prepared stops

use abbe_geometry::correct::{Status, correct};
use abbe_geometry::effects::{CovariateSource, CovariateValue, NoCovariates, Shape, State};
use abbe_geometry::model::{FittedEffect, MachineModel};
use abbe_geometry::predict::{Sighted, predicted_length};
use abbe_geometry::volumetric::{Diagonal, along_line};
use abbe_geometry::{Matrix3, Vector3};
use abbe_identify::{IdentifyOptions, identify};
use abbe_virtual_machine::TruthRecipe;
use common::{Case, INSTRUMENT, SPLINE};
use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use std::time::{Duration, Instant};

#[path = "../tests/common/mod.rs"]
mod common;

/// Range of every covariate in the campaign that the models pretend to come from.
const USUAL: (f64, f64) = (19.0, 21.0);
const OFFSET_M: [f64; 3] = [0.0, 0.0, -0.06];
/// Samples a round, rounds, of which the median is told.
const SAMPLES: usize = 2000;
const ROUNDS: usize = 15;

/// Every covariate in its range.
struct Logged;

impl CovariateSource for Logged {
    fn covariate(&self, _name: &str) -> CovariateValue {
        CovariateValue::Fresh(20.4)
    }
}

fn bow() -> (&'static str, Shape) {
    let shape = Shape::new().text("axis", "x").text("form", "free");
    ("gradient_bow", shape.text("warm", "temp_bridge_top_c").text("cold", "temp_bridge_bottom_c"))
}

fn expansion(axis: &str) -> (&'static str, Shape) {
    ("scale_expansion", Shape::new().text("axis", axis).text("sensor", format!("temp_scale_{axis}_c")))
}

/// The model with these effects, independent of everything else.
fn with_effects(model: &MachineModel, effects: &[(&str, Shape)]) -> MachineModel {
    let mut parts = model.parts().clone();
    // The campaign's own covariates have ranges of their own, of which the samples here know nothing.
    (parts.identified.covariates, parts.identified.differences) = Default::default();
    parts.quality.unseen_expansions = Default::default();
    let mut deviations = Vec::new();
    for (name, shape) in effects {
        let plausible =
            |fitted: &FittedEffect| fitted.effect.parameters().iter().map(|p| p.plausible).collect::<Vec<_>>();
        let blank = MachineModel::fitted_effect(name, shape.clone(), &parts.machine, Vec::new()).unwrap();
        let sizes = plausible(&blank);
        deviations.extend(sizes.iter().map(|size| 1e-3 * size));
        parts.identified.covariates.extend(blank.effect.reads().into_iter().map(|name| (name, USUAL)));
        parts.effects.push(FittedEffect { parameters: sizes.iter().map(|size| 1e-2 * size).collect(), ..blank });
    }
    let (before, added) = (model.machine_parameters(), deviations.len());
    let place = |k: usize| match k {
        own if own < before => Ok(own),
        new if new < before + added => Err(new - before),
        station => Ok(station - added),
    };
    let entry = |(a, b): (usize, usize)| match (place(a), place(b)) {
        (Ok(a), Ok(b)) => model.covariance(a, b),
        (Err(a), Err(b)) if a == b => deviations[a] * deviations[a],
        _ => 0.0,
    };
    let all = before + added + 4 * parts.stations.len();
    parts.covariance = (0..all).flat_map(|a| (0..=a).map(move |b| (a, b))).map(entry).collect();
    MachineModel::new(parts).unwrap()
}

/// Readings all over the volume: an additive recurrence, never on a lattice.
fn reading_m(model: &MachineModel, k: usize) -> [f64; 3] {
    let bounds_m = &model.parts().identified.reading_m;
    let shares = [0.819_172_5, 0.671_043_6, 0.549_700_5].map(|factor| (k as f64 * factor).fract());
    std::array::from_fn(|d| bounds_m[d].0 + (bounds_m[d].1 - bounds_m[d].0) * shares[d])
}

/// Microseconds of one of many calls, median of the rounds.
fn median_us(mut call: impl FnMut(usize)) -> f64 {
    let round = |_| {
        let begin = Instant::now();
        (0..SAMPLES).for_each(&mut call);
        begin.elapsed().as_secs_f64() * 1e6 / SAMPLES as f64
    };
    let mut times: Vec<f64> = (0..ROUNDS).map(round).collect();
    times.sort_by(f64::total_cmp);
    times[ROUNDS / 2]
}

fn correct_us(model: &MachineModel, covariates: &dyn CovariateSource, status: Status) -> f64 {
    median_us(|k| {
        let state = State { reading_m: reading_m(model, k), offset_m: OFFSET_M, covariates };
        assert!(black_box(correct(model, black_box(&state))).status == status);
    })
}

fn correction(criterion: &mut Criterion) {
    let truth = TruthRecipe { seed: 1, ..TruthRecipe::default() }.bridge_xyz().unwrap();
    let case = Case::case_like(truth, SPLINE, 7);
    let campaign = &case.simulated.campaign;
    let plain =
        identify(&case.machine, INSTRUMENT.range, campaign, &IdentifyOptions::default(), &mut |_| true).unwrap().model;
    let every = [bow(), expansion("x"), expansion("y"), expansion("z")];
    let models = [
        ("no effect", with_effects(&plain, &[])),
        ("one effect of one covariate", with_effects(&plain, &every[1..2])),
        ("one effect of two covariates", with_effects(&plain, &every[..1])),
        ("four effects of five covariates", with_effects(&plain, &every)),
    ];
    let state = State { reading_m: reading_m(&plain, 1), offset_m: OFFSET_M, covariates: &Logged };
    criterion.bench_function("correct/no_effect", |bencher| bencher.iter(|| correct(&plain, black_box(&state))));
    println!("a correction, us              logged    left out      ratio");
    for (name, model) in &models {
        let logged_us = correct_us(model, &Logged, Status::InVolume);
        let left_out = if model.parts().effects.is_empty() { Status::InVolume } else { Status::CovariateMissing };
        let left_out_us = correct_us(model, &NoCovariates, left_out);
        println!("{name:32} {logged_us:8.2} {left_out_us:8.2} {:8.2}", left_out_us / logged_us);
    }
    let all = &models[3].1;
    let station = all.parts().stations[0].name.clone();
    let sighted =
        Sighted { station: &station, line: "", residual_m: Vector3::zeros(), covariance_m2: Matrix3::identity() };
    let predicted_us = median_us(|k| {
        let state = State { reading_m: reading_m(all, k), offset_m: OFFSET_M, covariates: &Logged };
        black_box(predicted_length(all, black_box(&state), &sighted).unwrap());
    });
    let ends_m = Diagonal::ALL[0].ends_m(&all.parts().identified.reading_m);
    let lines = |model: &MachineModel| along_line(model, ends_m, SAMPLES, OFFSET_M).unwrap();
    let line_us = median_us(|k| {
        if k == 0 {
            black_box(lines(&models[0].1));
        }
    });
    println!("a predicted length with four effects {predicted_us:.2} us; a place on a line {line_us:.2} us");
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20).measurement_time(Duration::from_secs(2));
    targets = correction
}
criterion_main!(benches);
