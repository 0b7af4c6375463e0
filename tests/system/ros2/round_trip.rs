//! How long a position takes from a program of rclpy through the graph and back, beside the way to a node that only answers.
//!
//! `just round-trip` takes many on a machine that does nothing else; a run of the tests only sees that they come back.

use std::process::Stdio;

use abbe_msgs::ScaleReading;

use super::beside;
use crate::common::files::{Bench, machine, samples, text};
use crate::common::graph::{NAMESPACE, topic};
use crate::common::network::in_own_network;
use crate::common::program::{Started, abbe_in, run};
use crate::common::python::ros2;

/// Positions that go each way, where the environment does not name another number.
const COUNT: &str = "1000";
const COUNT_VARIABLE: &str = "ABBE_ROUND_TRIPS";
/// Share that may be missing: a best-effort reader on a loaded machine.
const MISSING: f64 = 0.01;

#[test]
fn val_rclpy_positions_at_1_khz_come_back_corrected_as_they_come_back_from_an_echo() {
    let test = "ros2::round_trip::val_rclpy_positions_at_1_khz_come_back_corrected_as_they_come_back_from_an_echo";
    in_own_network(test, |domain| {
        let Some(mut echo) = ros2(domain, &["echo", "/echo/there", "/echo/back"]) else { return };
        let bench = Bench::identified(5);
        let [x, y, z] = position(&bench);
        let count = std::env::var(COUNT_VARIABLE).unwrap_or_else(|_| COUNT.to_owned());
        let words = ["round_trip", NAMESPACE, "/echo/there", "/echo/back", &x, &y, &z, &count];
        let user = ros2(domain, &words).unwrap();

        let mut echo = echo.stdin(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
        let heard = beside(Started::start(abbe_in(domain, ["launch", &launch_file(&bench)])), user);
        drop(echo.stdin.take());
        assert!(echo.wait().unwrap().success());
        println!("{heard:#}");
        for way in ["corrected", "echo"] {
            let number = |name: &str| heard[way][name].as_f64().unwrap();
            assert!(number("came") >= (1.0 - MISSING) * number("sent"), "{way}: {heard}");
        }
    });
}

/// A position of the campaign (m), as words.
pub(super) fn position(bench: &Bench) -> [String; 3] {
    let (campaign, bag) = (bench.text("campaign.csv"), bench.text("campaign"));
    let convert = ["convert", "--machine", &text(&machine()), "--campaign", &campaign, "--out", &bag];
    run(convert.into_iter().chain(["--namespace", NAMESPACE])).ok();
    let reading = samples::<ScaleReading>(&bench.path("campaign"), &topic("scale/reading"))[0].reading_m;
    reading.map(|value| value.to_string())
}

/// A graph that corrects the positions which come on `axes`.
pub(super) fn launch_file(bench: &Bench) -> String {
    let edge = |from: &str, to: &str, transport: &str| {
        format!("[[edges]]\nfrom = \"{from}\"\nto = \"{to}\"\ntransport = \"{transport}\"\n")
    };
    let content = format!(
        "namespace = \"{NAMESPACE}\"\nmachine = \"{}\"\nmodel = \"model.json\"\n\
         nodes = [\"scale\", \"geometric\", \"residual\"]\nmax_covariate_age_s = 1e6\nwait_for_subscribers_s = 20.0\n\
         [scale]\npace = \"as_they_come\"\n\
         driver = {{ kind = \"ros\", topic = \"axes\", message = \"joint_state\", joints = [\"x\", \"y\", \"z\"], \
         offset_mm = [0.0, 0.0, -60.0] }}\n{}{}{}",
        text(&machine()),
        edge("scale", "geometric", "shared-memory"),
        edge("geometric", "residual", "shared-memory"),
        edge("residual", "*", "dds"),
    );
    bench.write("launch.toml", content)
}
