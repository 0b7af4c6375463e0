//! What a plan promises is what identification states and what a verification achieves.
//!
//! Place in the flow: plans for four kinds of machine are made without any of their data; then machines that nobody has seen
//! are simulated along them, identified and verified. The promise holds on average over machines.

use crate::common::{Kinds, bridge, drive, fyxz, gantry, measured, moving_table, request, simulated, verified};
use abbe_identify::in_parallel;
use abbe_measurement::planned::Goal;
use abbe_plan::plan;

/// Machines of each kind.
const MACHINES: u64 = 12;
/// Verification points of each.
const POINTS: usize = 150;
/// How far promise and achievement may be apart.
const APART: f64 = 0.10;

#[test]
fn the_promised_uncertainty_is_what_a_verification_achieves_on_every_kind_of_machine() {
    let kinds: [(&str, Kinds); 4] =
        [("bridge", bridge), ("fyxz", fyxz), ("moving table", moving_table), ("gantry", gantry)];
    let mut wrong = Vec::new();
    for (name, kind) in kinds {
        let request = request(kind, Goal { uncertainty_m: None, budget_s: Some(4.5 * 3600.0) });
        let plan = plan(&request, &mut |_| true).unwrap();
        assert!(plan.time_s <= 4.5 * 3600.0, "{name}: {} s", plan.time_s);
        let seeds: Vec<u64> = (1..=MACHINES).collect();
        let of = |seed: &u64| {
            let config = simulated(kind(500 + seed), drive(&request, &plan), *seed);
            let (_, fit) = measured(&request.machine, &config);
            verified(&config, &fit.model, POINTS)
        };
        let all = in_parallel(&seeds, of);
        let rms_um =
            |values: &dyn Fn(&(f64, f64)) -> f64| (all.iter().map(values).sum::<f64>() / all.len() as f64).sqrt() * 1e6;
        let (achieved_um, stated_um) = (rms_um(&|v| v.0), rms_um(&|v| v.1));
        let promised_um = plan.promise.u_model_m * 1e6;
        println!(
            "{name}: {} stations, {} lines, {:.2} h; promised {promised_um:.3} µm, stated {stated_um:.3} µm, achieved \
             {achieved_um:.3} µm; if bent half and twice {:?} µm",
            plan.stations.len(),
            plan.lines.len(),
            plan.time_s / 3600.0,
            plan.if_bent_m.map(|u| u * 1e6)
        );
        for (what, value_um) in [("stated", stated_um), ("achieved", achieved_um)] {
            if (value_um / promised_um - 1.0).abs() > APART {
                wrong.push(format!("{name}: promised {promised_um:.3} µm, {what} {value_um:.3} µm"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
