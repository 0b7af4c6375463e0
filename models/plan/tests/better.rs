//! A plan reaches more than other plans of the same length, and lines added to a campaign help more than random ones.
//!
//! Place in the flow: machines that no plan has seen are simulated along each of the paths, identified and verified.

use crate::common::{OFFSETS_M, bridge, drive, measured, request, simulated, verified_inside};
use abbe_identify::{Belief, in_parallel};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::planned::Goal;
use abbe_plan::{Measured, Request, plan};
use abbe_virtual_machine::plan::{LineKind, LineSelection, Plan as Drive, PlanRecipe, presets};
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const MACHINES: u64 = 10;
const POINTS: usize = 120;

/// Time of a path as the simulator reckons it (s); a plan reckons acceleration as well.
fn time_s(drive: &Drive) -> f64 {
    drive.targets().last().unwrap().time_s + drive.station_change_s
}

/// Rms error (µm) that machines measured along a path have left, without the outer 2 % of each stroke, which the recorded
/// campaigns do not measure.
fn achieved_um(request: &Request, drive: &Drive) -> f64 {
    let seeds: Vec<u64> = (1..=MACHINES).collect();
    let of = |seed: &u64| {
        let config = simulated(bridge(700 + seed), drive.clone(), *seed);
        verified_inside(&config, &measured(&request.machine, &config).1.model, POINTS).0
    };
    (in_parallel(&seeds, of).iter().sum::<f64>() / MACHINES as f64).sqrt() * 1e6
}

/// The plan that this time allows, with the speeds and pauses of the simulator's plans.
fn planned(time_s: f64, feed_m_s: f64) -> (Request, Drive) {
    let mut request = request(bridge, Goal { uncertainty_m: None, budget_s: Some(time_s) });
    request.motion.feeds_m_s = vec![feed_m_s];
    let plan = plan(&request, &mut |_| true).unwrap();
    assert!(plan.time_s <= time_s);
    let drive = drive(&request, &plan);
    (request, drive)
}

#[test]
fn a_plan_beats_the_recorded_campaigns_plan_of_equal_length() {
    let stroke_m = bridge(1).stroke_m;
    let recorded = PlanRecipe { pause_s: [0.0, 0.0], feeds_m_s: vec![0.05], ..presets::case_like(stroke_m, 3) };
    // Most of what the recorded plan lacks is that its lines stop short of the ends, where errors are zero by definition; so
    // the same lines over all of the stroke are the harder comparison.
    let widened = PlanRecipe { box_m: stroke_m, ..recorded.clone() }.build().unwrap();
    let recorded = recorded.build().unwrap();
    let (request, own) = planned(time_s(&recorded), 0.05);
    let [recorded_um, widened_um, own_um] = [&recorded, &widened, &own].map(|path| achieved_um(&request, path));
    println!(
        "{:.2} h: like the recorded campaigns {} readings, {recorded_um:.3} µm, over all of the stroke {widened_um:.3} µm; \
         planned {} readings, {own_um:.3} µm",
        time_s(&recorded) / 3600.0,
        recorded.readings(),
        own.readings()
    );
    assert!(own_um < 0.95 * recorded_um.min(widened_um), "{own_um} {recorded_um} {widened_um}");
}

#[test]
fn a_plan_beats_edges_and_diagonals_of_equal_length() {
    let stroke_m = bridge(1).stroke_m;
    // Twelve edges and four body diagonals from four stations, each with three reflectors (Liang 2025), there and back.
    let recipe = PlanRecipe {
        kinds: vec![LineKind::AlongX, LineKind::AlongY, LineKind::AlongZ, LineKind::BodyDiagonal],
        levels: [2; 3],
        box_m: stroke_m,
        selection: LineSelection::Every,
        offsets_m: OFFSETS_M.to_vec(),
        points: [15, 15],
        pause_s: [0.0, 0.0],
        feeds_m_s: vec![0.05],
        ..presets::plan_b(stroke_m, 3)
    };
    // Offsets go in turn from line to line: three times as many passes give each line each of them.
    let edges = recipe.build().unwrap();
    let edges = edges.repeated_to(2 * edges.readings()).unwrap();
    let (request, own) = planned(time_s(&edges), 0.05);
    let (edges_um, own_um) = (achieved_um(&request, &edges), achieved_um(&request, &own));
    println!(
        "{:.2} h: edges and diagonals {} readings, {edges_um:.3} µm; planned {} readings, {own_um:.3} µm",
        time_s(&edges) / 3600.0,
        edges.readings(),
        own.readings()
    );
    assert!(own_um < 0.95 * edges_um, "{own_um} {edges_um}");
}

/// The campaign with that of another drive behind it, and the fit of both.
fn extended_um(request: &Request, first: &Drive, second: &Drive) -> f64 {
    let seeds: Vec<u64> = (1..=MACHINES).collect();
    let of = |seed: &u64| {
        let mut both = first.clone();
        both.stations.extend(second.stations.iter().cloned());
        let config = simulated(bridge(800 + seed), both, *seed);
        verified_inside(&config, &measured(&request.machine, &config).1.model, POINTS).0
    };
    (in_parallel(&seeds, of).iter().sum::<f64>() / MACHINES as f64).sqrt() * 1e6
}

#[test]
fn lines_chosen_to_extend_a_campaign_beat_random_ones_of_equal_number() {
    // A short campaign of three stations along the edges, which tells all errors, but not well.
    let stroke_m = bridge(1).stroke_m;
    let recipe = PlanRecipe {
        selection: LineSelection::Drawn(16),
        stations_m: presets::case_like(stroke_m, 3).stations_m[..3].to_vec(),
        ..presets::case_like(stroke_m, 3)
    };
    let short = recipe.build().unwrap();
    let mut request = request(bridge, Goal { uncertainty_m: None, budget_s: Some(1.2 * 3600.0) });
    let config = simulated(bridge(42), short.clone(), 42);
    let (campaign, fit): (Campaign, _) = measured(&request.machine, &config);
    request.belief = Belief::of_fit(&fit);
    request.stands.iter_mut().for_each(|stand| stand.name = format!("N{}", stand.name));
    request.measured = Some(Measured { campaign, fit });
    let plan = plan(&request, &mut |_| true).unwrap();
    let before = plan.before.as_ref().unwrap();
    assert!(plan.promise.u_model_m < 0.9 * before.u_model_m, "{} {}", plan.promise.u_model_m, before.u_model_m);
    let chosen = drive(&request, &plan);
    // As many random lines of as many points from as many random stands of the same.
    let mut generator = ChaCha8Rng::seed_from_u64(5);
    let mut random = chosen.clone();
    let mut stands: Vec<usize> = (0..request.stands.len()).collect();
    stands.shuffle(&mut generator);
    for (station, stand) in random.stations.iter_mut().zip(stands) {
        station.position_m = request.stands[stand].position_m;
        for line in &mut station.lines {
            let axis = generator.random_range(0..3);
            let level = |d: usize, k: u32| {
                let [low_m, high_m] = stroke_m[d];
                (low_m + (high_m - low_m) * f64::from(k) / 3.0).min(high_m)
            };
            let at: [f64; 3] = std::array::from_fn(|d| level(d, generator.random_range(0..4)));
            (line.from_m, line.to_m) = (at, at);
            (line.from_m[axis], line.to_m[axis]) = (stroke_m[axis][0], stroke_m[axis][1]);
            line.offset_m = OFFSETS_M[generator.random_range(0..3)];
        }
    }
    let (chosen_um, random_um) = (extended_um(&request, &short, &chosen), extended_um(&request, &short, &random));
    println!(
        "{} lines from {} stations: before {:.3} µm (stated), chosen {chosen_um:.3} µm, random {random_um:.3} µm, promised {:.3} µm",
        plan.lines.len(),
        plan.stations.len(),
        before.u_model_m * 1e6,
        plan.promise.u_model_m * 1e6
    );
    assert!(chosen_um < 0.97 * random_um, "{chosen_um} {random_um}");
}
