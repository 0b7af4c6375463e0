//! The recorder where it is hard: stamps and clocks out of range, disks that fill up, a power cut. The graph goes on, what is
//! recorded can be read, and what is not is told.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicUsize};
use std::thread;
use std::time::{Duration, Instant};

use crate::common::assert_says;
use crate::common::clock::{ShiftedClock, preloaded};
use crate::common::dds::PATIENCE;
use crate::common::files::{Bench, samples};
use crate::common::graph::{DDS, LaunchText, MEMORY, long_recording, stream_of, topic, user};
use crate::common::program::{Ran, Started, abbe, children, is_running, run, signal, wait_until};
use crate::common::watched::{StopAtEnd, control};
use abbe_msgs::bag::BagWriter;
use abbe_msgs::{CorrectedCoordinates, ScaleReading, Stamp};
use abbe_runtime::RunId;
use rustix::process::Signal;

/// A bag `readings` of these, to be played.
fn played(bench: &Bench, readings: &[ScaleReading]) {
    let mut writer = BagWriter::create(bench.path("readings")).unwrap();
    for (log_time_ns, reading) in (0..).zip(readings) {
        writer.write(&topic("scale/reading"), reading, log_time_ns).unwrap();
    }
    writer.finish().unwrap();
}

/// A graph that plays `readings` at 200 Hz and records them with what is made of them; gives the recorder's summary.
fn record(bench: &Bench, readings: &[ScaleReading], table: &str) -> serde_json::Value {
    played(bench, readings);
    let launch = LaunchText::default()
        .nodes(&["scale", "geometric", "recorder"])
        .record("recorded")
        .edge("scale", "geometric", MEMORY)
        .edge("scale", "recorder", MEMORY)
        .edge("geometric", "recorder", MEMORY)
        .source("scale", "readings", Some(&topic("scale/reading")), 200.0);
    let text = launch.text().replace("record = \"recorded\"\n", table);
    let said = run(["launch", &bench.write("launch.toml", text)]).ok();
    let summaries = said.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let summaries: Vec<_> = summaries.collect();
    let of = |node: &str| summaries.iter().find(|summary| summary["node"] == node).unwrap().clone();
    let all = serde_json::Value::from(readings.len());
    assert_eq!((&of("geometric")["received"], &of("geometric")["sent"]), (&all, &all), "the graph goes on");
    of("recorder")
}

#[test]
fn regress_stamps_that_no_bag_can_hold_end_no_node_and_are_counted() {
    let bench = Bench::identified(5);
    let bounds = [(i32::MIN, 0), (-1, 999_999_999), (0, 0), (i32::MAX, 999_999_999), (-5, 0), (7, 0)];
    let readings: Vec<ScaleReading> = (0..60)
        .map(|sequence| {
            let (sec, nanosec) = bounds[sequence as usize % bounds.len()];
            ScaleReading { stamp: Stamp::new(sec, nanosec).unwrap(), sequence, ..ScaleReading::default() }
        })
        .collect();
    let summary = record(&bench, &readings, "record = \"recorded\"\n");
    assert_eq!((&summary["received"], &summary["sent"], &summary["lost"]), (&120.into(), &60.into(), &0.into()));
    assert_eq!(summary["figures"]["stamps_refused"], 60.0);
    assert_eq!(samples::<ScaleReading>(&bench.path("recorded"), &topic("scale/reading")).len(), 30);
}

#[test]
fn regress_a_clock_before_1970_or_after_2038_ends_no_node() {
    let bench = Bench::identified(5);
    let Some(clock) = ShiftedClock::new(&bench) else { return };
    let readings: Vec<ScaleReading> =
        (0..600).map(|sequence| ScaleReading { sequence, ..ScaleReading::default() }).collect();
    played(&bench, &readings);
    // For three seconds; past 2038 with DDS and /diagnostics, before 1970 without: the library cannot run with that.
    for offset_s in [600_000_000, -2_000_000_000] {
        let launch = LaunchText::default()
            .nodes(&["scale", "geometric", "recorder"])
            .record(&format!("recorded{offset_s}"))
            .edge("scale", "geometric", MEMORY)
            .edge("geometric", "recorder", MEMORY)
            .edge("geometric", "*", DDS)
            .source("scale", "readings", Some(&topic("scale/reading")), 200.0);
        clock.set(offset_s);
        let mut command = abbe(["launch", &launch.write(&bench)]);
        clock.hold(&mut command);
        let ran = Started::start(command).finish();
        let without_dds = ran.errors.contains("no gateway to DDS: cannot join ROS domain");
        assert_eq!(without_dds, offset_s < 0, "{}", ran.errors);
        let said = ran.ok();
        let recorder = said.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
        let recorder = recorder.into_iter().find(|summary| summary["node"] == "recorder").unwrap();
        assert_eq!((&recorder["sent"], &recorder["lost"]), (&600.into(), &0.into()), "{offset_s}: {recorder}");
    }
}

#[test]
fn a_recording_is_split_by_time_and_stops_with_a_whole_bag_before_the_disk_is_full() {
    let stamped = |sequence: u64| {
        let stamp = Stamp::from_nanos(i64::try_from(sequence).unwrap() * 5_000_000).unwrap();
        ScaleReading { stamp, sequence, ..ScaleReading::default() }
    };
    let readings: Vec<ScaleReading> = (0..500).map(stamped).collect();
    let bench = Bench::identified(5);
    let summary = record(&bench, &readings, "record = { bag = \"recorded\", split_s = 1.0, split_mib = 100 }\n");
    assert!(summary["figures"]["files"].as_f64().unwrap() >= 2.0, "{summary}");
    assert_eq!((&summary["sent"], &summary["dropped"]), (&1000.into(), &0.into()));
    let back = samples::<ScaleReading>(&bench.path("recorded"), &topic("scale/reading"));
    assert!(back == readings, "{} of {} readings, in order", back.len(), readings.len());

    let bench = Bench::identified(5);
    let full = "record = { bag = \"recorded\", least_free_mib = 1_000_000_000_000 }\n";
    let summary = record(&bench, &readings[..200], full);
    assert_eq!((&summary["sent"], &summary["dropped"]), (&0.into(), &400.into()), "{summary}");
    assert!(samples::<ScaleReading>(&bench.path("recorded"), &topic("scale/reading")).is_empty(), "a whole bag");
}

/// A disk of its own that holds so many MiB, for one command: `script` runs there with the disk as `$DISK` and a folder that
/// stays as `$KEPT`. None, said aloud, where mounts are not allowed.
fn on_a_small_disk(mib: u32, script: &str, kept: &Path, arguments: &[&str]) -> Option<Ran> {
    let ways: [&[&str]; 2] = [&["unshare", "-m"], &["unshare", "-rm"]];
    let mount = |mib: u32| format!("mount -t tmpfs -o size={mib}m abbe_test \"$DISK\"");
    let in_namespace = |way: &[&str], script: &str| {
        let mut command = Command::new(way[0]);
        command.args(&way[1..]).args(["sh", "-c", script]).env("DISK", kept.join("disk")).env("KEPT", kept);
        command.stdin(Stdio::null());
        command
    };
    fs::create_dir_all(kept.join("disk")).unwrap();
    let allows = |way: &&&[&str]| {
        let tried = in_namespace(way, &mount(1)).stdout(Stdio::null()).stderr(Stdio::null()).status();
        tried.is_ok_and(|status| status.success())
    };
    let Some(way) = ways.iter().find(allows) else {
        println!("SKIPPED: no mount namespace to be had, so there is no disk to fill");
        return None;
    };
    let script = format!("{} && {script}", mount(mib));
    let mut command = in_namespace(way, &script);
    command.arg(env!("CARGO_BIN_EXE_abbe")).args(arguments).env_remove("RUST_LOG");
    Some(Started::start(command).finish())
}

/// A graph at 1 kHz that records all of it to the bag `disk/recorded`, while at least 16 MiB are free.
fn recorded_to_the_disk(bench: &Bench) -> String {
    let bag = bench.text("disk/recorded");
    let launch = LaunchText::default()
        .nodes(&["scale", "geometric", "recorder"])
        .record(&bag)
        .edge("scale", "geometric", MEMORY)
        .edge("scale", "recorder", MEMORY)
        .edge("geometric", "recorder", MEMORY)
        .source("scale", &bench.text("long"), Some(&topic("scale/reading")), 1000.0);
    let table = format!("record = {{ bag = \"{bag}\", least_free_mib = 16 }}\n");
    bench.write("launch.toml", launch.text().replace(&format!("record = \"{bag}\"\n"), &table))
}

/// The figures of a node at its end.
fn summary(output: &str, node: &str) -> serde_json::Value {
    let summaries = output.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    summaries.into_iter().find(|summary| summary["node"] == node).unwrap()
}

/// The readings of a bag that are there without a gap from the first on.
#[track_caller]
fn recorded_from_the_first(bag: &Path) -> u64 {
    let sequences = samples::<ScaleReading>(bag, &topic("scale/reading")).into_iter().map(|reading| reading.sequence);
    let sequences: Vec<u64> = sequences.collect();
    assert!(sequences.iter().copied().eq(0..sequences.len() as u64), "a gap in the recording: {sequences:?}");
    sequences.len() as u64
}

const LONG: u64 = 6000;

#[test]
fn a_recorder_that_fills_its_disk_completes_its_bag_in_time_and_correction_goes_on() {
    let bench = Bench::identified(5);
    long_recording(&bench, LONG);
    let file = recorded_to_the_disk(&bench);
    // A quarter of a MiB to go.
    let script = "head -c 768K /dev/zero > \"$DISK/others\"; \"$0\" \"$@\"; code=$?; \
                  cp -r \"$DISK/recorded\" \"$KEPT/kept\"; exit $code";
    let Some(ran) = on_a_small_disk(17, script, &bench.path(""), &["launch", &file]) else { return };
    assert_says(&ran.errors, &["recording has stopped: 15 MiB are free", "make room", "the graph goes on without it"]);
    let said = ran.ok();
    let (geometric, recorder) = (summary(&said, "geometric"), summary(&said, "recorder"));
    assert_eq!((&geometric["sent"], &geometric["lost"]), (&LONG.into(), &0.into()), "correction goes on");
    let [sent, dropped] = ["sent", "dropped"].map(|key| recorder[key].as_u64().unwrap());
    println!("{sent} recorded, {dropped} not");
    assert!(sent > 500 && dropped > 500 && sent + dropped == 2 * LONG, "{recorder}");
    let kept = bench.path("kept");
    let corrected = samples::<CorrectedCoordinates>(&kept, &topic("geometric/corrected")).len() as u64;
    assert_eq!(recorded_from_the_first(&kept) + corrected, sent, "the bag is whole");
}

#[test]
fn regress_a_disk_that_others_fill_up_at_once_ends_no_node_and_the_recording_can_be_recovered() {
    let bench = Bench::identified(5);
    long_recording(&bench, LONG);
    let file = recorded_to_the_disk(&bench);
    // Not a byte is left, from one moment to the next, and half-way between two times that everything is put on the disk; there
    // is room again at the end.
    let script = "(until [ \"$(stat -c %s \"$DISK\"/recorded/*.mcap)\" -gt 400000 ]; do sleep 0.02; done; sleep 0.2; \
                  head -c 64M /dev/zero > \"$DISK/others\") 2>/dev/null & \"$0\" \"$@\"; code=$?; \
                  rm -f \"$DISK/others\"; cp -r \"$DISK/recorded\" \"$KEPT/kept\"; exit $code";
    let Some(ran) = on_a_small_disk(24, script, &bench.path(""), &["launch", &file]) else { return };
    assert_says(&ran.errors, &["recording has stopped", "goes on without it"]);
    // On a busy machine the disk may fill up after everything was put on it and before its free space is looked at: the bag is whole then.
    if !ran.errors.contains("make room") {
        assert_says(&ran.errors, &["check the free space", "can be recovered"]);
    }
    let said = ran.ok();
    let (geometric, recorder) = (summary(&said, "geometric"), summary(&said, "recorder"));
    assert_eq!((&geometric["sent"], &geometric["lost"]), (&LONG.into(), &0.into()), "correction goes on");
    let [sent, dropped] = ["sent", "dropped"].map(|key| recorder[key].as_u64().unwrap());
    assert!(sent > 0 && dropped > 500 && sent + dropped == 2 * LONG, "{recorder}");
    let (kept, saved) = (bench.text("kept"), bench.text("saved"));
    let recovered = run(["recover", "--bag", &kept, "--out", &saved]);
    let saved = bench.path("saved");
    let corrected = samples::<CorrectedCoordinates>(&saved, &topic("geometric/corrected")).len() as u64;
    let readings = recorded_from_the_first(&saved);
    println!("{sent} counted as recorded, {} recovered; {}", readings + corrected, recovered.errors);
    assert!(readings + corrected >= sent, "{readings} and {corrected} of {sent} recovered");
}

/// Notes the size of a file when it is put on the disk, and takes that for done: what a power cut leaves is up to there.
const NOTED_SYNC: &str = "
#define _GNU_SOURCE
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>
int fdatasync(int fd) {
  struct stat synced;
  char text[32];
  const char *file = getenv(\"SYNCED_FILE\");
  if (!file || fstat(fd, &synced)) return -1;
  int note = open(file, O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
  if (note < 0) return -1;
  snprintf(text, sizeof text, \"%20lld\", (long long)synced.st_size);
  ssize_t written = pwrite(note, text, 20, 0);
  close(note);
  return written == 20 ? 0 : -1;
}
";

#[test]
fn after_a_power_cut_everything_up_to_a_second_before_can_be_recovered() {
    /// What the documents promise.
    const PROMISED: Duration = Duration::from_secs(1);
    let bench = Bench::identified(5);
    long_recording(&bench, 60_000);
    let Some(library) = preloaded(&bench, "sync", NOTED_SYNC) else { return };
    let file = stream_of(&bench, |launch| {
        let launch = launch.nodes(&["recorder"]).edge("residual", "recorder", MEMORY).record("recorded");
        launch.edge("residual", "user", MEMORY)
    });
    let run_name = RunId::unique();
    let mut command = abbe(["launch", &file, "--run", run_name.as_str()]);
    command.env("LD_PRELOAD", &library).env("SYNCED_FILE", bench.path("synced"));
    let launcher = Started::start(command);
    let mut subscriber = user::<CorrectedCoordinates>(&run_name, "corrected");
    let (phase, cut) = (AtomicUsize::new(0), AtomicBool::new(false));
    // A thread that only sleeps: how late the recorder may be for want of a processor.
    let (heard, control) = thread::scope(|scope| {
        let stops = StopAtEnd(&cut);
        let control = scope.spawn(|| control(&phase, &cut));
        let mut heard: Vec<(Instant, u64)> = Vec::new();
        while heard.len() < 4000 {
            let sample = subscriber.take_within(PATIENCE).unwrap().expect("the stream ended");
            heard.push((Instant::now(), sample.sequence));
        }
        drop(stops);
        (heard, control.join().unwrap()[0])
    });
    let processes: Vec<u32> = children(launcher.id()).into_iter().map(|(id, _)| id).chain([launcher.id()]).collect();
    processes.iter().for_each(|id| signal(*id, Signal::STOP));
    let at = Instant::now();
    processes.iter().for_each(|id| signal(*id, Signal::KILL));
    wait_until("all have ended", PATIENCE, || processes[..processes.len() - 1].iter().all(|id| !is_running(*id)));
    drop((launcher, subscriber));
    abbe_runtime::transport::shared_memory::cleanup(&run_name).unwrap();

    let whole = fs::read(bench.path("recorded/recorded_0.mcap")).unwrap();
    let synced: usize = fs::read_to_string(bench.path("synced")).unwrap().trim().parse().unwrap();
    assert!(synced > 0 && synced <= whole.len());
    let due = heard.iter().filter(|(when, _)| *when + PROMISED + 4 * control <= at).map(|(_, sequence)| *sequence);
    let due = due.max().expect("it ran for longer than that");
    // A file system may have lost the rest, or hold zeros in its place.
    let lost = whole[..synced].to_vec();
    let zeros = [lost.as_slice(), &vec![0; whole.len() - synced + 4096]].concat();
    for (what, left) in [("lost", lost), ("zeros", zeros)] {
        let (bag, saved) = (bench.write("cut.mcap", left), bench.text(&format!("{what}.mcap")));
        run(["recover", "--bag", &bag, "--out", &saved]);
        let saved = samples::<CorrectedCoordinates>(Path::new(&saved), &topic("corrected"));
        let recovered: Vec<u64> = saved.iter().map(|sample| sample.sequence).collect();
        assert!(recovered.iter().copied().eq(0..recovered.len() as u64), "{what}: a gap");
        println!("{what}: {} recovered, {due} due, {} heard, control {control:?}", recovered.len(), heard.len());
        assert!(recovered.len() as u64 > due, "{what}: {} recovered, {due} due", recovered.len());
    }
}
