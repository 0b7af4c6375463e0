//! The laws of a transport, each a function of the world it is tried in.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

use std::thread;
use std::time::{Duration, Instant};

use abbe_runtime::TransportKind;

use abbe_msgs::ScaleReading;
use abbe_runtime::Publish;

use super::World;
use super::common::samples::{PATIENCE, connect, expect, next, send};

pub(crate) fn order_is_kept_and_content_is_identical_to_the_bit(world: &World) {
    let (mut publisher, mut subscriber) = (world.publisher(), world.subscriber());
    connect(&mut *publisher, &mut *subscriber);
    send(&mut *publisher, 0..300);
    expect(&mut *subscriber, 0..300);
    assert_eq!(subscriber.lost(), 0);
    assert_eq!(publisher.dropped(), 0);
}

pub(crate) fn who_joins_late_gets_what_is_sent_from_then_on(world: &World) {
    let (mut publisher, mut early) = (world.publisher(), world.subscriber());
    connect(&mut *publisher, &mut *early);
    send(&mut *publisher, 0..50);
    expect(&mut *early, 0..50);
    let mut late = world.subscriber();
    connect(&mut *publisher, &mut *late);
    send(&mut *publisher, 50..100);
    expect(&mut *late, 50..100);
    expect(&mut *early, 50..100);
    assert_eq!((early.lost(), late.lost()), (0, 0));
}

pub(crate) fn a_publisher_that_starts_again_is_heard_again(world: &World) {
    let mut subscriber = world.subscriber();
    for _life in 0..3 {
        let mut publisher = world.publisher();
        connect(&mut *publisher, &mut *subscriber);
        send(&mut *publisher, 0..20);
        expect(&mut *subscriber, 0..20);
    }
    assert_eq!(subscriber.lost(), 0);
}

pub(crate) fn a_subscriber_that_goes_leaves_the_others_untouched(world: &World) {
    let mut publisher = world.publisher();
    let (mut stays, mut goes) = (world.subscriber(), world.subscriber());
    connect(&mut *publisher, &mut *stays);
    connect(&mut *publisher, &mut *goes);
    send(&mut *publisher, 0..100);
    drop(goes);
    send(&mut *publisher, 100..300);
    expect(&mut *stays, 0..300);
    assert_eq!((stays.lost(), publisher.dropped()), (0, 0));
}

pub(crate) fn a_burst_of_2000_arrives_whole(world: &World) {
    let (mut publisher, mut subscriber) = (world.publisher(), world.subscriber());
    connect(&mut *publisher, &mut *subscriber);
    send(&mut *publisher, 0..2000);
    expect(&mut *subscriber, 0..2000);
    assert_eq!(subscriber.lost(), 0);
}

pub(crate) fn overflow_is_counted_and_never_blocks(world: &World) {
    const DEPTH: usize = 64;
    const SENT: u64 = 1000;
    // The subscriber first: over shared memory whoever comes first sets the depth of the topic.
    let edges = world.edges(DEPTH);
    let mut subscriber = edges.subscriber("scale/reading", world.kind).unwrap();
    let sending = world.edges(DEPTH);
    let mut publisher = sending.publisher("scale/reading", &[world.kind]).unwrap();
    connect(&mut *publisher, &mut *subscriber);
    send(&mut *publisher, 0..1);
    expect(&mut *subscriber, 0..1);

    // Nobody takes anything; had send waited for that, this would not end.
    for number in 1..SENT {
        send(&mut *publisher, number..number + 1);
        if number % 10 == 0 {
            thread::sleep(Duration::from_millis(1)); // for the queue before DDS, as deep as the rest
        }
    }
    thread::sleep(Duration::from_millis(300)); // over DDS, until the last is there
    let mut taken = Vec::new();
    while taken.last() != Some(&(SENT - 1)) {
        let sample = next(&mut *subscriber, PATIENCE);
        taken.push(sample.expect("the newest sample did not arrive").sequence);
    }
    assert!(taken.is_sorted(), "out of order: {taken:?}");
    assert!(taken.len() as u64 <= SENT / 2, "{} samples were kept", taken.len());
    // Every sample is accounted for: taken, lost at the subscriber, or given up at the publisher.
    let (lost, dropped) = (subscriber.lost(), publisher.dropped());
    assert_eq!(taken.len() as u64 + lost + dropped, SENT - 1, "{lost} lost, {dropped} dropped");
    assert!(lost > 0, "the subscriber lost nothing: {dropped} dropped");
}

pub(crate) fn two_subscribers_both_get_everything(world: &World) {
    let mut publisher = world.publisher();
    let mut subscribers = [world.subscriber(), world.subscriber()];
    for subscriber in &mut subscribers {
        connect(&mut *publisher, &mut **subscriber);
    }
    send(&mut *publisher, 0..500);
    for subscriber in &mut subscribers {
        expect(&mut **subscriber, 0..500);
        assert_eq!(subscriber.lost(), 0);
    }
}

pub(crate) fn two_publishers_are_both_heard(world: &World) {
    let mut subscriber = world.subscriber();
    let mut publishers = [world.publisher(), world.publisher()];
    for publisher in &mut publishers {
        connect(&mut **publisher, &mut *subscriber);
        // A probe of the first that comes late must not pass for one of the second.
        while next(&mut *subscriber, Duration::from_millis(200)).is_some() {}
    }
    send(&mut *publishers[0], 0..100);
    expect(&mut *subscriber, 0..100);
    send(&mut *publishers[1], 0..100);
    expect(&mut *subscriber, 0..100);
    assert_eq!(subscriber.lost(), 0);
    let before = subscriber.interleaved();
    for number in 100..110 {
        for publisher in &mut publishers {
            send(&mut **publisher, number..number + 1);
            expect(&mut *subscriber, number..number + 1);
        }
    }
    // Within one process a program knows its own publishers.
    let noticed = if world.kind == TransportKind::InProcess { 0 } else { 20 };
    assert_eq!(subscriber.interleaved() - before, noticed, "two publishers at a time");
}

pub(crate) fn waiting_ends_in_time_and_takes_nothing(world: &World) {
    let (mut publisher, mut subscriber) = (world.publisher(), world.subscriber());
    connect(&mut *publisher, &mut *subscriber);
    while next(&mut *subscriber, Duration::from_millis(200)).is_some() {}

    let start = Instant::now();
    assert!(!subscriber.wait(Duration::from_millis(30)).unwrap());
    assert!(start.elapsed() >= Duration::from_millis(30), "waited too short");
    assert!(subscriber.try_take().unwrap().is_none());

    let waiting = thread::spawn(move || {
        let found = subscriber.wait(PATIENCE).unwrap();
        (found, subscriber)
    });
    thread::sleep(Duration::from_millis(20)); // so that it sleeps when the sample comes
    send(&mut *publisher, 7..8);
    let (found, mut subscriber) = waiting.join().unwrap();
    assert!(found, "the sample did not end the wait");
    assert!(subscriber.wait(PATIENCE).unwrap(), "waiting again lost the sample");
    expect(&mut *subscriber, 7..8);
}

pub(crate) fn the_publisher_knows_its_subscribers(world: &World) {
    let mut publisher = world.publisher();
    assert_eq!(publisher.subscribers(), 0);
    let mut subscribers = vec![world.subscriber(), world.subscriber()];
    for subscriber in &mut subscribers {
        connect(&mut *publisher, &mut **subscriber);
    }
    // Behind a gateway it hears of them ten times a second.
    let knows = |publisher: &dyn Publish<ScaleReading>, wanted: usize| {
        let deadline = Instant::now() + PATIENCE;
        while publisher.subscribers() != wanted && Instant::now() < deadline {
            thread::sleep(Duration::from_millis(10));
        }
        assert_eq!(publisher.subscribers(), wanted);
    };
    knows(&*publisher, 2);
    subscribers.pop();
    knows(&*publisher, 1);
}
