//! Opening edges by their kind: what is refused, what a fan-out reaches, what stays apart.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

#[path = "common/mod.rs"]
mod common;

use std::time::Duration;

use abbe_msgs::{ScaleReading, TracerReading};
use abbe_runtime::ros::{NodeIdentity, RemapRule};
use abbe_runtime::transport::in_process::InProcess;
use abbe_runtime::transport::shared_memory::cleanup;
use abbe_runtime::{Edges, EdgesConfig, RunId, TransportError, TransportKind};
use common::samples::{connect, expect, next, sample, send};

const TOPIC: &str = "scale/reading";
const LOCAL: [TransportKind; 2] = [TransportKind::InProcess, TransportKind::SharedMemory];

/// Edges within this process and over the shared memory of a run that is removed at the end.
struct Local {
    run: RunId,
    config: EdgesConfig,
}

impl Local {
    fn new() -> Self {
        let run = RunId::unique();
        let mut config = EdgesConfig::new(NodeIdentity::new("/cmm", "test").unwrap());
        config.in_process = Some(InProcess::default());
        config.run = Some(run.clone());
        Self { run, config }
    }

    fn open(&self) -> Edges {
        Edges::open(self.config.clone()).unwrap()
    }
}

impl Drop for Local {
    fn drop(&mut self) {
        let _ = cleanup(&self.run);
    }
}

#[test]
fn a_fan_out_reaches_every_transport_and_counts_all_subscribers() {
    let local = Local::new();
    let edges = local.open();
    let mut publisher = edges.publisher(TOPIC, &LOCAL).unwrap();
    let mut subscribers = LOCAL.map(|kind| edges.subscriber(TOPIC, kind).unwrap());
    for subscriber in &mut subscribers {
        connect(&mut *publisher, &mut **subscriber);
    }
    assert_eq!(publisher.subscribers(), 2);
    send(&mut *publisher, 0..100);
    for subscriber in &mut subscribers {
        expect(&mut **subscriber, 0..100);
    }
}

#[test]
fn a_name_is_remapped_the_same_on_every_transport() {
    let mut local = Local::new();
    let there = local.open();
    let rule = |from: &str, to: &str| RemapRule { node: None, from: from.into(), to: to.into() };
    // Each other's names: a rule applied twice would undo itself.
    local.config.remaps = vec![rule("a", "b"), rule("b", "a")];
    let remapped = local.open();
    for kind in LOCAL {
        let mut publisher = remapped.publisher("a", &[kind]).unwrap();
        let mut subscriber = there.subscriber("/cmm/b", kind).unwrap();
        connect(&mut *publisher, &mut *subscriber);
    }
}

#[test]
fn another_type_on_the_same_topic_is_refused() {
    let local = Local::new();
    let edges = local.open();
    for kind in LOCAL {
        let _readings = edges.publisher::<ScaleReading>(TOPIC, &[kind]).unwrap();
        let error = edges.subscriber::<TracerReading>(TOPIC, kind).err().unwrap();
        assert!(matches!(error, TransportError::OtherType { .. }), "{kind}: {error}");
        assert!(error.to_string().contains("/cmm/scale/reading"), "{error}");
    }
}

#[test]
fn what_is_not_configured_is_named() {
    let edges = Edges::open(EdgesConfig::new(NodeIdentity::new("/", "test").unwrap())).unwrap();
    for kind in TransportKind::ALL {
        let error = edges.subscriber::<ScaleReading>(TOPIC, kind).err().unwrap().to_string();
        assert!(error.contains(kind.name()), "{error}");
    }
    let error = edges.publisher::<ScaleReading>(TOPIC, &[]).err().unwrap();
    assert!(matches!(error, TransportError::NoTransport { .. }), "{error}");
    let error = edges.publisher::<ScaleReading>("a b", &LOCAL).err().unwrap();
    assert!(error.to_string().contains("'a b'"), "{error}");
}

#[test]
fn two_runs_do_not_hear_each_other() {
    let (left, right) = (Local::new(), Local::new());
    let kind = TransportKind::SharedMemory;
    let (left_edges, right_edges) = (left.open(), right.open());
    let mut publisher = left_edges.publisher(TOPIC, &[kind]).unwrap();
    let mut here = left_edges.subscriber(TOPIC, kind).unwrap();
    let mut there = right_edges.subscriber(TOPIC, kind).unwrap();
    connect(&mut *publisher, &mut *here);
    send(&mut *publisher, 0..10);
    expect(&mut *here, 0..10);
    assert!(next(&mut *there, Duration::from_millis(50)).is_none());
    drop((there, right_edges));
    cleanup(&right.run).unwrap();
    send(&mut *publisher, 10..20);
    expect(&mut *here, 10..20);
}

#[test]
fn a_sample_that_validation_refuses_is_reported_and_the_next_arrives() {
    let local = Local::new();
    let edges = local.open();
    for kind in LOCAL {
        let mut publisher = edges.publisher(TOPIC, &[kind]).unwrap();
        let mut subscriber = edges.subscriber::<TracerReading>(TOPIC, kind).unwrap();
        let bad = TracerReading { u_length_m: -1.0, ..TracerReading::default() };
        publisher.send(&bad).unwrap();
        publisher.send(&TracerReading::default()).unwrap();
        let error = subscriber.take_within(Duration::from_secs(5)).unwrap_err();
        assert!(error.is_malformed_sample(), "{kind}: {error}");
        assert!(error.to_string().contains("u_length_m"), "{kind}: {error}");
        let good = subscriber.take_within(Duration::from_secs(5)).unwrap();
        assert_eq!(good, Some(TracerReading::default()));
    }
}

#[test]
fn a_wait_without_end_is_ended_by_a_sample() {
    let local = Local::new();
    let edges = local.open();
    for kind in LOCAL {
        let mut publisher = edges.publisher("endless", &[kind]).unwrap();
        let mut subscriber = edges.subscriber::<ScaleReading>("endless", kind).unwrap();
        let waiting = std::thread::spawn(move || subscriber.wait(Duration::MAX));
        std::thread::sleep(Duration::from_millis(10));
        publisher.send(&sample(1)).unwrap();
        assert!(waiting.join().unwrap().unwrap());
    }
}
