//! Who else is there: readings of another machine, a second source, a second launch, another publisher of what a node
//! publishes. Each is refused or told, in the samples and on `/diagnostics`.

use std::thread;
use std::time::{Duration, Instant};

use crate::common::assert_says;
use crate::common::dds::{DEPTH, Fed, Listener, PATIENCE, publisher_of_readings, user_node};
use crate::common::files::{Bench, samples};
use crate::common::graph::{DDS, MEMORY, files_of_run, long_recording, stream_of, topic, user};
use crate::common::network::in_own_network;
use crate::common::program::{Started, abbe_in, run, signal};
use abbe_msgs::standard::DiagnosticStatus;
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, Message, ScaleReading, ros};
use abbe_runtime::RunId;
use abbe_runtime::ros::stream_qos;
use rustix::process::Signal;

#[test]
fn regress_readings_of_another_frame_and_of_a_second_source_are_refused_aloud() {
    const EACH: usize = 100;
    let test = "publishers::regress_readings_of_another_frame_and_of_a_second_source_are_refused_aloud";
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        long_recording(&bench, 4 * EACH as u64);
        let good = samples::<ScaleReading>(&bench.path("long"), &topic("scale/reading"));
        let listener = Listener::on_diagnostics(domain);
        let mut fed = Fed::start(&bench, domain, &good[0]);

        let frame_id = abbe_msgs::Text::new("other_machine").unwrap();
        fed.send(good[..EACH].iter().map(|reading| ScaleReading { frame_id, ..*reading }));
        let foreign = fed.take(EACH);
        assert!(foreign.iter().all(|sample| sample.status == CorrectionStatus::OtherFrame && !sample.corrected_valid));

        // The machine, and beside it a recording that somebody plays.
        let other = publisher_of_readings(&fed.node);
        let deadline = Instant::now() + PATIENCE;
        while other.subscribers() == 0 {
            assert!(Instant::now() < deadline, "the second source is not heard");
            thread::sleep(Duration::from_millis(10));
        }
        thread::sleep(Duration::from_millis(500));
        for place in 0..EACH {
            fed.send([good[EACH + place]]);
            other.publish(ScaleReading { sequence: 5000 + place as u64, ..good[2 * EACH + place] }.to_ros());
            thread::sleep(Duration::from_millis(1));
        }
        let mixed = fed.take(2 * EACH);
        let told = mixed.iter().position(|sample| sample.status == CorrectionStatus::SeveralSources).expect("not told");
        assert!(told < 10, "told after {told} samples");
        assert!(mixed[told..].iter().all(|sample| sample.corrected_point_in_machine_m().is_none()));

        // Alone again, with later stamps.
        drop(other);
        fed.send(good[3 * EACH..].iter().copied());
        let alone = fed.take(EACH);
        assert!(alone[40..].iter().all(|sample| sample.status == CorrectionStatus::InVolume), "{:?}", alone[40].status);

        listener.hears_warnings("geometric: input", &["another frame", "are mixed", "several publishers"]);
        signal(fed.graph.id(), Signal::INT);
        let ran = fed.graph.finish();
        assert_says(&ran.errors, &["in another frame are refused", "of several sources are mixed"]);
        assert_says(&ran.ok(), &[&format!("\"scale_readings_other_frame\":{EACH}.0")]);
    });
}

#[test]
fn regress_another_publisher_of_corrected_is_told_in_the_samples_while_it_is_there_and_replay_agrees() {
    let test =
        "publishers::regress_another_publisher_of_corrected_is_told_in_the_samples_while_it_is_there_and_replay_agrees";
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        long_recording(&bench, 120_000);
        let file = stream_of(&bench, |launch| {
            let launch = launch.edge("residual", "user", MEMORY).edge("residual", "*", DDS);
            let launch = launch.nodes(&["recorder"]).record("recorded");
            launch.edge("scale", "recorder", MEMORY).edge("residual", "recorder", MEMORY)
        });
        let run_name = RunId::unique();
        let listener = Listener::on_diagnostics(domain);
        let graph = Started::start(abbe_in(domain, ["launch", &file, "--run", run_name.as_str()]));
        let mut subscriber = user::<CorrectedCoordinates>(&run_name, "corrected");
        let told = |level: u8| {
            let mut news = listener.news("residual: correction").into_iter();
            news.any(|status| status.level == level && status.message.contains("other publisher") == (level > 0))
        };
        let mut until = |status: CorrectionStatus, level: u8| {
            let (deadline, mut is_told) = (Instant::now() + PATIENCE, false);
            loop {
                let sample = subscriber.take_within(PATIENCE).unwrap().expect("the stream ended");
                assert!(sample.corrected_valid && sample.covariance_of_corrected_m2().is_some());
                is_told |= told(level);
                if sample.status == status && is_told {
                    return;
                }
                assert!(Instant::now() < deadline, "{status:?} not told, /diagnostics {is_told}");
            }
        };
        until(CorrectionStatus::InVolume, DiagnosticStatus::OK);
        // On this host only nodes of ours are refused; a program of others is as one on another host.
        let other = user_node(domain);
        let rival =
            other.publisher::<ros::CorrectedCoordinates>(&topic("corrected"), &stream_qos(DEPTH), DEPTH).unwrap();
        until(CorrectionStatus::OtherPublisher, DiagnosticStatus::WARN);
        drop((rival, other));
        until(CorrectionStatus::InVolume, DiagnosticStatus::OK);
        drop(subscriber);
        signal(graph.id(), Signal::INT);
        let ran = graph.finish();
        assert_says(&ran.errors, &["1 other publishers of corrected over DDS", "has no other publisher any more"]);
        let said = ran.ok();
        let residual = said.lines().find(|line| line.contains("\"node\":\"residual\"")).unwrap();
        assert!(!residual.contains("\"other_publisher\":0.0"), "{residual}");
        let (bag, model) = (bench.text("recorded"), bench.text("model.json"));
        let said = run(["replay", "--bag", &bag, "--model", &model]).ok();
        assert_says(&said, &["identical"]);
    });
}

#[test]
fn regress_a_second_launch_of_a_run_or_in_a_namespace_is_refused_and_the_first_goes_on() {
    let test = "publishers::regress_a_second_launch_of_a_run_or_in_a_namespace_is_refused_and_the_first_goes_on";
    in_own_network(test, |domain| {
        let bench = Bench::identified(5);
        long_recording(&bench, 60_000);
        let file = stream_of(&bench, |launch| launch.edge("residual", "user", MEMORY).edge("residual", "*", DDS));
        let run = RunId::unique();
        let first = Started::start(abbe_in(domain, ["launch", &file, "--run", run.as_str()]));
        let mut subscriber = user::<CorrectedCoordinates>(&run, "corrected");
        let mut next = 0;
        let mut goes_on = |samples: u64| {
            for _ in 0..samples {
                let sample = subscriber.take_within(PATIENCE).unwrap().expect("the stream ended");
                assert_eq!((sample.sequence, sample.status), (next, CorrectionStatus::InVolume));
                next += 1;
            }
        };
        goes_on(100);
        let refused = |arguments: &[&str]| Started::start(abbe_in(domain, arguments)).finish().refused();
        let said = refused(&["launch", &file, "--run", run.as_str()]);
        assert_says(&said, &["is in use", run.as_str(), "--run"]);
        let said = refused(&["node", "geometric", "--launch", &file, "--run", run.as_str()]);
        assert_says(&said, &["has a publisher of /test/geometric/corrected", run.as_str()]);
        let said = refused(&["launch", &file]);
        assert_says(&said, &["has a publisher of /test/corrected", "ROS domain", "namespace"]);
        goes_on(1000);
        drop(subscriber);
        signal(first.id(), Signal::INT);
        first.finish().ok();
        assert_eq!(files_of_run(run.as_str()), Vec::<String>::new());
    });
}
