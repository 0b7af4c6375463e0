//! `abbe … | head`: a command whose reader has gone ends as other programs do, by SIGPIPE and in silence, and leaves no
//! partial file. A graph of nodes does its work to the end without a reader. Ctrl-C ends a command soon, with words and
//! without a trace, whatever it waits for or computes.

use std::ffi::OsStr;
use std::fmt::Write as _;
use std::io::{BufRead, BufReader, pipe};
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::common::assert_says;
use crate::common::files::{Bench, listing, machine, samples, text};
use crate::common::graph::{long_recording, recorded_stream_of, topic};
use crate::common::program::{Started, abbe, run, signal, wait_until_interruptible};
use abbe_msgs::CorrectedCoordinates;
use rustix::process::Signal;

/// Runs `abbe` with a standard output that nobody reads any more.
fn without_reader<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Output {
    let (reader, writer) = pipe().unwrap();
    drop(reader);
    abbe(arguments).stdout(writer).output().unwrap()
}

/// Asserts that a command ended as `cat` does when its reader goes.
#[track_caller]
fn ended_with_its_reader(output: &Output) {
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(said, "", "{:?}", output.status);
    assert_eq!(output.status.signal(), Some(Signal::PIPE.as_raw()), "{:?}", output.status);
}

/// What lies in a folder.
fn names(folder: &Path) -> Vec<PathBuf> {
    listing(folder).into_keys().map(|path| path.strip_prefix(folder).unwrap().to_owned()).collect()
}

fn shipped(path: &str) -> String {
    text(&machine().parent().unwrap().join("..").join(path).canonicalize().unwrap())
}

#[test]
fn a_command_whose_reader_has_gone_ends_in_silence_and_leaves_what_it_leaves_with_one() {
    let bench = Bench::identified(5);
    let (machine, campaign, model) = (text(&machine()), bench.text("campaign.csv"), bench.text("model.json"));
    let (verify, lengths) = (bench.text("verify.csv"), shipped("data/liang2025_lengths.csv"));
    let centres = shipped("data/zhang2016_centres.csv");
    let commands: [&[&str]; 10] = [
        &["identify", "--machine", &machine, "--campaign", &campaign, "--out", "OUT/model.json"],
        &["identify", "--machine", &machine, "--campaign", &campaign, "--out", "OUT/model.json", "--json"],
        &["verify", "--model", &model, "--points", &verify],
        &["correct", "--model", &model, "--in", &verify, "--out", "-"],
        &["volumetric", "--model", &model, "--out", "OUT/map", "--steps", "3", "--offset-mm", "0,0,-60"],
        &["conformity", "--lengths", &lengths, "--probing", "bidirectional", "--out", "OUT/tests", "--json"],
        &["probe-pose", "--centres", &centres, "--out", "OUT/probe"],
        &["simulate", "--machine", &machine, "--seed", "3", "--out", "OUT/virtual"],
        &["convert", "--machine", &machine, "--campaign", &campaign, "--out", "OUT/campaign_bag"],
        &["papers", "--paper", "Zhang 2011", "--effort", "0.02", "--out", "OUT/papers"],
    ];
    for command in commands {
        let in_folder = |name: &str| {
            let folder = bench.path(name);
            std::fs::create_dir_all(&folder).unwrap();
            let arguments: Vec<String> = command.iter().map(|word| word.replace("OUT", &text(&folder))).collect();
            (folder, arguments)
        };
        let (folder, arguments) = in_folder("alone");
        ended_with_its_reader(&without_reader(arguments));
        let alone = names(&folder);
        let (with_reader, arguments) = in_folder("read");
        run(arguments).ok();
        assert_eq!(alone, names(&with_reader), "{command:?}");
        [folder, with_reader].iter().for_each(|folder| std::fs::remove_dir_all(folder).unwrap());
    }
}

#[test]
fn a_stream_ends_when_its_reader_has_enough() {
    let bench = Bench::identified(5);
    let (few, mut many) = (bench.read("verify.csv"), String::new());
    let (header, rows) = few.split_once('\n').unwrap();
    writeln!(many, "{header}").unwrap();
    // Far more than a pipe holds.
    (0..50).for_each(|_| many.push_str(rows));
    let readings = bench.write("many.csv", many);
    let mut command = abbe(["correct", "--model", &bench.text("model.json"), "--in", &readings, "--out", "-"]);
    let mut running = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let first = BufReader::new(running.stdout.take().unwrap()).lines().next().unwrap().unwrap();
    assert!(first.ends_with("status"), "{first}");
    ended_with_its_reader(&running.wait_with_output().unwrap());
}

#[test]
fn an_error_that_nobody_reads_is_told_by_the_exit_code() {
    let (reader, writer) = pipe().unwrap();
    drop(reader);
    let status = abbe(["launch", "no_such_file.toml"]).stderr(writer).status().unwrap();
    assert_eq!(status.code(), Some(1), "{status:?}");
}

#[test]
fn a_graph_does_its_work_without_a_reader() {
    let bench = Bench::identified(5);
    long_recording(&bench, 500);
    let output = without_reader(["launch", &recorded_stream_of(&bench, "recorded")]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!said.contains("panicked"), "{said}");
    assert_eq!(output.status.signal(), Some(Signal::PIPE.as_raw()), "{:?}: {said}", output.status);
    assert_eq!(samples::<CorrectedCoordinates>(&bench.path("recorded"), &topic("corrected")).len(), 500);
}

/// When a command has begun its work, and within what it ends after Ctrl-C on a machine that is busy. It is to be half a second.
const BEGUN: Duration = Duration::from_millis(700);
const ENDS_WITHIN: Duration = Duration::from_secs(5);

#[test]
fn regress_ctrl_c_ends_a_command_soon_whatever_it_waits_for() {
    let bench = Bench::identified(5);
    let (machine, model, verify) = (text(&machine()), bench.text("model.json"), bench.text("verify.csv"));
    // A pipe into which nobody writes: no loop comes round in which a request could be looked at.
    let endless = bench.text("endless.csv");
    assert!(Command::new("mkfifo").arg(&endless).status().unwrap().success());
    let out = bench.text("out");
    let commands: [&[&str]; 6] = [
        &["identify", "--machine", &machine, "--campaign", &endless, "--out", &out],
        &["diagnose", "--model", &model, "--campaign", &endless, "--out", &out],
        &["train", "--residuals", &endless, "--out", &out],
        &["correct", "--model", &model, "--in", &endless, "--out", &out],
        &["correct", "--model", &model, "--in", &endless, "--out", "-"],
        &["convert", "--machine", &machine, "--campaign", &endless, "--out", &out],
    ];
    let before = names(&bench.path(""));
    let running: Vec<Started> = commands.iter().map(|arguments| Started::start(abbe(*arguments))).collect();
    running.iter().for_each(|started| wait_until_interruptible(started.id()));
    thread::sleep(BEGUN);
    for (command, started) in commands.iter().zip(running) {
        let since = Instant::now();
        signal(started.id(), Signal::INT);
        let said = started.finish().ended(130);
        assert!(since.elapsed() < ENDS_WITHIN, "{command:?} took {:?}", since.elapsed());
        assert_says(&said, &["abbe: stopped on request before"]);
    }
    // The standard input too, in the middle of a row.
    let mut command = abbe(["correct", "--model", &model, "--in", "-", "--out", &out]);
    command.stdin(Stdio::piped());
    let mut started = Started::start(command);
    let head = bench.read("verify.csv");
    let mut input = started.child.stdin.take().unwrap();
    std::io::Write::write_all(&mut input, &head.as_bytes()[..head.len() / 2]).unwrap();
    wait_until_interruptible(started.id());
    thread::sleep(BEGUN);
    signal(started.id(), Signal::INT);
    assert_says(&started.finish().ended(130), &["stopped on request"]);
    drop(input);
    assert_eq!(names(&bench.path("")), before, "something was left behind");
    run(["correct", "--model", &model, "--in", &verify, "--out", &out]).ok();
}
