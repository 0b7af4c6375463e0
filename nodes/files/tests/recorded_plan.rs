//! A plan made by the shipped request reaches more, with fewer readings, than the plan of the recorded demo campaign.
//!
//! Place in the flow: what both reach is stated alike, from nominal readings, noise as declared and the same bends; that such
//! statements come true is shown in `models/plan/tests`. Only positions, offsets and stations are taken from the recording.

use abbe_files::{read_campaign_file, read_machine, read_plan_request};
use abbe_geometry::ErrorId;
use abbe_identify::station_start::StationStart;
use abbe_identify::{Belief, IdentifyOptions, identify};
use abbe_measurement::planned::Goal;
use abbe_plan::{Known, Request, of_campaign, plan};
use std::path::Path;

#[test]
fn a_plan_reaches_more_than_the_recorded_demo_campaign_with_fewer_readings() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch-config");
    let machine = read_machine(&folder.join("machines/bridge_xyz.toml")).unwrap();
    let file = read_plan_request(&folder.join("plans/bridge_xyz.toml")).unwrap();
    let recorded = read_campaign_file(&folder.join("demo/campaign.csv.zst"), None).unwrap().campaign;
    let options = IdentifyOptions::default();
    let fit = identify(&machine.machine, machine.instrument, &recorded, &options, &mut |_| true).unwrap();
    let stations: Vec<StationStart> = fit
        .model
        .parts()
        .stations
        .iter()
        .map(|s| StationStart { position_m: s.position_m, dead_path_m: s.dead_path_m })
        .collect();
    let [straightness_m, positioning_m, angle_rad] = file.expected.unwrap();
    let bend = |id: ErrorId| match (id.is_straightness(), id.is_angular()) {
        (true, _) => straightness_m,
        (_, true) => angle_rad,
        _ => positioning_m,
    };
    let belief = Belief::of_bends(&machine.machine, bend).unwrap();
    let mut offsets_m: Vec<[f64; 3]> = Vec::new();
    for reading in &recorded.readings {
        if !offsets_m.contains(&reading.offset_m) {
            offsets_m.push(reading.offset_m);
        }
    }
    // Over what the recording covers: it stops short of the ends of the strokes.
    let volume_m = fit.model.parts().identified.reading_m;
    let known = Known {
        machine: &machine.machine,
        instrument: machine.instrument,
        options: &options,
        belief: &belief,
        misfit: (1.0, [0.0; 3]),
    };
    let of_recorded = of_campaign(known, (&recorded, &stations), &volume_m, &offsets_m).unwrap();
    let request = Request {
        machine: machine.machine.clone(),
        instrument: machine.instrument,
        options,
        volume_m: machine.machine.stroke_m,
        tips_m: offsets_m.clone(),
        tracer: file.tracer,
        stands: file.stands.clone(),
        most_stations: file.most_stations,
        holders: file.holders.clone(),
        motion: file.motion.clone(),
        lines: file.lines,
        goal: Goal { uncertainty_m: None, budget_s: Some(4.0 * 3600.0) },
        tell: Vec::new(),
        sensors: Vec::new(),
        belief: belief.clone(),
        seed: file.seed,
        measured: None,
    };
    let own = plan(&request, &mut |_| true).unwrap();
    let new: Vec<StationStart> = own
        .stations
        .iter()
        .map(|s| StationStart { position_m: abbe_geometry::Vector3::from(s.position_m), dead_path_m: 0.0 })
        .collect();
    let of_own = of_campaign(known, (&own.nominal, &new), &volume_m, &offsets_m).unwrap();
    let (recorded_um, own_um) = (of_recorded.u_model_m * 1e6, of_own.u_model_m * 1e6);
    println!(
        "recorded: {} stations, {} lines, {} readings, {recorded_um:.3} µm; planned: {} stations, {} lines, {} readings, \
         {own_um:.3} µm",
        recorded.stations.len(),
        recorded.lines.len(),
        recorded.readings.len(),
        own.stations.len(),
        own.lines.len(),
        own.nominal.readings.len()
    );
    assert!(own.nominal.readings.len() <= recorded.readings.len());
    assert!(own_um < 0.9 * recorded_um, "{own_um} {recorded_um}");
}
