//! A controller, a tracer and sensors that are on ROS 2 already: their standard messages become readings, or are refused in words.

use std::time::Duration;

use crate::common::assert_says;
use crate::common::dds::Listener;
use crate::common::files::{Bench, machine, samples, text};
use crate::common::graph::{NAMESPACE, topic};
use crate::common::network::in_own_network;
use crate::common::program::{Started, abbe_in, run, signal};
use crate::common::python::{python, said};
use abbe_msgs::bag::BagWriter;
use abbe_msgs::standard::DiagnosticStatus;
use abbe_msgs::{CorrectedCoordinates, ScaleReading, TracerReading};
use rustix::process::Signal;
use serde_json::json;

/// Readings of the campaign that are used.
const EVERY: usize = 6;
const U_M: f64 = 0.25e-6;

fn launch_file(bench: &Bench) -> String {
    let edge =
        |from: &str, to: &str| format!("[[edges]]\nfrom = \"{from}\"\nto = \"{to}\"\ntransport = \"shared-memory\"\n");
    let sensor = |topic: &str, message: &str, name: &str| {
        format!(
            "[[covariates]]\nkind = \"ros\"\ntopic = \"{topic}\"\nmessage = \"{message}\"\ncovariate = \"{name}\"\n"
        )
    };
    let content = format!(
        "namespace = \"{NAMESPACE}\"\nmachine = \"{}\"\nmodel = \"model.json\"\nrecord = \"recorded\"\n\
         nodes = [\"scale\", \"tracer\", \"geometric\", \"residual\", \"recorder\"]\n\
         max_covariate_age_s = 1e6\nwait_for_subscribers_s = 20.0\n\
         [scale]\npace = \"as_they_come\"\n\
         driver = {{ kind = \"ros\", topic = \"axes\", message = \"joint_state\", joints = [\"axis_x\", \"axis_y\", \"axis_z\"], \
         offset_mm = [0.0, 0.0, -60.0], silent_after_s = 1.0 }}\n\
         [tracer]\npace = \"as_they_come\"\n\
         driver = {{ kind = \"ros\", topic = \"/{NAMESPACE}/distance\", message = \"range\", station = \"S1\", \
         u_length_um = 0.25, frame_id = \"tracer\" }}\n\
         {}{}{}{}{}{}{}{}",
        text(&machine()),
        sensor("air", "temperature", "temp_air_c"),
        sensor("pressure", "fluid_pressure", "pressure_hpa"),
        sensor("humidity", "relative_humidity", "humidity_pct"),
        edge("scale", "geometric"),
        edge("geometric", "residual"),
        edge("scale", "recorder"),
        edge("tracer", "recorder"),
        edge("residual", "recorder"),
    );
    bench.write("launch.toml", content)
}

#[test]
fn val_cyclone_a_controller_on_ros_2_is_corrected_and_what_is_no_reading_is_refused_in_words() {
    let test = "ros_driver::val_cyclone_a_controller_on_ros_2_is_corrected_and_what_is_no_reading_is_refused_in_words";
    in_own_network(test, |domain| {
        let Some(mut controller) = python("controller.py") else { return };
        let bench = Bench::identified(5);
        let (campaign, bag) = (bench.text("campaign.csv"), bench.text("campaign"));
        let convert = ["convert", "--machine", &text(&machine()), "--campaign", &campaign, "--out", &bag];
        run(convert.into_iter().chain(["--namespace", NAMESPACE])).ok();
        let all = samples::<ScaleReading>(&bench.path("campaign"), &topic("scale/reading"));
        let good: Vec<&ScaleReading> = all.iter().step_by(EVERY).collect();
        let sent = |reading: &ScaleReading| {
            let stamp = [i64::from(reading.stamp.sec()) + 1, i64::from(reading.stamp.nanosec())];
            let [x, y, z] = reading.reading_m;
            // In another order, with one that is no axis.
            let joints = json!([["axis_z", z], ["lamp", 7.0], ["axis_x", x], ["axis_y", y]]);
            json!({"stamp": stamp, "joints": joints, "frame": "", "range_m": 1.5})
        };
        let mut readings: Vec<_> = good.iter().map(|reading| sent(reading)).collect();
        let spoilt = |key: &str, value: serde_json::Value| {
            let mut reading = sent(good.last().unwrap());
            reading[key] = value;
            reading
        };
        readings.extend([
            spoilt("frame", json!("other_machine")),
            spoilt("joints", json!([["axis_x", 0.1], ["axis_y", 0.1], ["lamp", 1.0]])),
            spoilt("joints", json!([["axis_x", 0.1], ["axis_x", 0.2], ["axis_y", 0.1], ["axis_z", 1.0]])),
            spoilt("stamp", json!([0, 0])),
            spoilt("range_m", json!(25.0)),
        ]);
        let refused = 4;
        let path = bench.write("readings.json", serde_json::to_string(&readings).unwrap());
        controller.args([&domain.id().to_string(), NAMESPACE, &path]);

        let listener = Listener::on_diagnostics(domain);
        let graph = Started::start(abbe_in(domain, ["launch", &launch_file(&bench)]));
        assert_eq!(said(controller)["sent"], readings.len());
        listener.hears("scale: driver", DiagnosticStatus::ERROR, &["nobody publishes /test/axes any more"]);
        std::thread::sleep(Duration::from_millis(200));
        signal(graph.id(), Signal::INT);
        let ran = graph.finish();
        let errors = ran.errors.clone();
        let summaries = ran.ok();
        assert_says(
            &errors,
            &[
                "other_machine",
                "no joint \"axis_z\"",
                "axis_x, axis_y, lamp",
                "twice",
                "its stamp is 0",
                "outside its own",
            ],
        );
        assert!(!errors.contains("lost on the way"), "what was refused did arrive: {errors}");
        let summary = |node: &str| {
            let of_node = |line: &&str| line.starts_with('{') && line.contains(&format!("\"node\":\"{node}\""));
            let line = summaries.lines().find(of_node).unwrap();
            serde_json::from_str::<serde_json::Value>(line).unwrap()
        };
        assert_eq!(summary("scale")["malformed"], refused, "{summaries}");
        assert_eq!(summary("tracer")["malformed"], 2, "stamp 0, and out of range: {summaries}");

        check_recorded(&bench, &good);
    });
}

fn check_recorded(bench: &Bench, good: &[&ScaleReading]) {
    let scales: Vec<ScaleReading> = samples(&bench.path("recorded"), &topic("scale/reading"));
    // The last is that whose range alone was spoilt.
    assert_eq!(scales.len(), good.len() + 1);
    for (sequence, (taken, reading)) in scales.iter().zip(good).enumerate() {
        assert_eq!((taken.sequence, taken.reading_m), (sequence as u64, reading.reading_m));
        assert_eq!(taken.stamp.to_nanos() - reading.stamp.to_nanos(), 1_000_000_000);
        assert_eq!((taken.offset_m, taken.frame_id), ([0.0, 0.0, -0.06], reading.frame_id));
        for (name, value) in [("temp_air_c", 20.5), ("pressure_hpa", 1000.0), ("humidity_pct", 40.0)] {
            let covariate = taken.covariates.get(name).unwrap();
            assert_eq!(covariate.value, value, "{name}");
        }
    }
    let tracers: Vec<TracerReading> = samples(&bench.path("recorded"), &topic("tracer/reading"));
    assert_eq!((tracers.len(), tracers[0].station.as_str(), tracers[0].length_m), (good.len() + 3, "S1", 1.5));
    // A float32 of 1.5 m is good to 0.06 µm, which its uncertainty holds besides the instrument's.
    let rounding_m = 1.5 * f64::from(f32::EPSILON) / 2.0 / 3.0_f64.sqrt();
    assert!((tracers[0].u_length_m - U_M.hypot(rounding_m)).abs() < 1e-15 && tracers[0].u_length_m > U_M);

    // What goes out is what `abbe correct` makes of the same readings.
    let mut writer = BagWriter::create(bench.path("readings")).unwrap();
    for (time_ns, reading) in scales.iter().enumerate() {
        writer.write(&topic("scale/reading"), reading, time_ns as u64).unwrap();
    }
    writer.finish().unwrap();
    let [model, input, output] = ["model.json", "readings", "offline"].map(|name| bench.text(name));
    run(["correct", "--model", &model, "--in", &input, "--out", &output]).ok();
    let offline: Vec<CorrectedCoordinates> = samples(&bench.path("offline"), &topic("corrected"));
    let live: Vec<CorrectedCoordinates> = samples(&bench.path("recorded"), &topic("corrected"));
    assert_eq!(live, offline);
}
