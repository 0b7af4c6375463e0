//! Evidence for topics of ROS 2 as a source: what a launch file may say of one, and what is refused with its key.

use abbe_graph::launch::{Launch, NodeName};
use std::path::Path;

const SCALE: &str = "kind = \"ros\"\ntopic = \"axes\"\nmessage = \"joint_state\"\noffset_mm = [0.0, 0.0, -60.0]\n";
const TRACER: &str = "kind = \"ros\"\ntopic = \"/range\"\nmessage = \"range\"\nstation = \"S1\"\nu_length_um = 0.3\nframe_id = \"tracer\"\n";
const SENSOR: &str = "kind = \"ros\"\ntopic = \"/air\"\nmessage = \"temperature\"\ncovariate = \"temp_air_c\"\n";

fn parsed(scale: &str, tracer: &str, sensor: &str) -> Result<Launch, String> {
    let text = format!(
        "namespace = \"m\"\nmachine = \"m.toml\"\nnodes = [\"scale\", \"tracer\", \"geometric\"]\nmax_covariate_age_s = 1.0\n\
         wait_for_subscribers_s = 1.0\n[scale]\npace = \"as_they_come\"\n[scale.driver]\n{scale}[tracer]\n\
         pace = \"as_they_come\"\n[tracer.driver]\n{tracer}[[covariates]]\n{sensor}\
         [[edges]]\nfrom = \"scale\"\nto = \"geometric\"\ntransport = \"shared-memory\"\n\
         [[edges]]\nfrom = \"tracer\"\nto = \"user\"\ntransport = \"shared-memory\"\n\
         [[edges]]\nfrom = \"geometric\"\nto = \"user\"\ntransport = \"shared-memory\"\n"
    );
    Launch::parse(&text, Path::new("launch.toml")).map_err(|error| error.to_string())
}

#[test]
fn a_node_that_takes_a_topic_of_others_is_in_the_ros_graph_whatever_its_edges() {
    let launch = Launch { visible_in_ros: false, ..parsed(SCALE, TRACER, SENSOR).unwrap() };
    let seen = NodeName::ALL.into_iter().filter(|node| launch.is_in_ros_graph(*node)).collect::<Vec<_>>();
    assert_eq!(seen, [NodeName::Tracer, NodeName::Scale]);
    // And reads back as it stands.
    let again = Launch::parse(&launch.to_text().unwrap(), Path::new("launch.toml")).unwrap();
    assert_eq!(again, launch);
}

#[test]
fn what_cannot_be_a_reading_is_refused_with_its_key() {
    let scale = |from: &str, to: &str| parsed(&SCALE.replace(from, to), TRACER, SENSOR).unwrap_err();
    let tracer = |from: &str, to: &str| parsed(SCALE, &TRACER.replace(from, to), SENSOR).unwrap_err();
    let sensor = |from: &str, to: &str| parsed(SCALE, TRACER, &SENSOR.replace(from, to)).unwrap_err();
    for (told, words) in [
        (scale("joint_state", "range"), ["scale.driver.message", "joint_state or point"]),
        (scale("topic =", "joints = [\"x\", \"x\", \"z\"]\ntopic ="), ["scale.driver.joints", "three different"]),
        (scale("topic =", "station = \"S1\"\ntopic ="), ["scale.driver.station", "leave it out"]),
        (scale("-60.0", "-6e9"), ["scale.driver.offset_mm", "10000"]),
        (scale("topic =", "silent_after_s = 0.0\ntopic ="), ["scale.driver.silent_after_s", "above 0"]),
        (scale("topic =", "tpoic = \"a\"\ntopic ="), ["unknown field", "tpoic"]),
        (tracer("station = \"S1\"\n", ""), ["tracer.driver.station", "name it"]),
        (tracer("u_length_um = 0.3\n", ""), ["tracer.driver.u_length_um", "uncertainty"]),
        (tracer("frame_id = \"tracer\"\n", ""), ["tracer.driver.frame_id", "instrument"]),
        (sensor("temp_air_c", "temp_air_k"), ["covariates[0].covariate", "_c"]),
        (sensor("temp_air_c", "temperature"), ["covariates[0].covariate", "no unit"]),
        (sensor("\"temperature\"", "\"float64\""), ["covariates[0].stamp", "arrival"]),
        (sensor("\"temperature\"", "\"joint_state\""), ["covariates[0].message", "covariates are"]),
    ] {
        assert!(words.iter().all(|word| told.contains(word)), "{words:?}: {told}");
    }
}
