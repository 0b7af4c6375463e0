//! A campaign captured from the simulated machine, through the drivers that a real one has: whole, killed, cut, disturbed.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use crate::common::assert_says;
use crate::common::files::{Bench, WHO, assert_names_who, machine, other_machine, text};
use crate::common::printed::follows;
use crate::common::program::{Started, abbe, run, signal, wait_until};
use rustix::process::Signal;
use serde_json::Value;

/// Far beyond what a rehearsal takes on a loaded machine.
const LIMIT: Duration = Duration::from_secs(900);
/// Points of a line.
const POINTS: usize = 4;
const SEED: &str = "11";
const STATIONS: [(&str, [f64; 3]); 4] = [
    ("front-left", [-250.0, -250.0, -150.0]),
    ("front-right", [1050.0, -250.0, -100.0]),
    ("back-right", [1050.0, 850.0, -150.0]),
    ("top-left", [-250.0, 850.0, 500.0]),
];

/// Places of the reflector (mm), and the lines that are driven with it.
const HOLDERS: [([i32; 3], &[usize]); 3] = [
    ([0, 0, -60], &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15]),
    ([120, 0, -60], &[1, 4, 10, 11, 12, 14]),
    ([0, 140, -60], &[0, 4, 9, 10, 13, 14]),
];

/// Edges and diagonals of the volume from each of these stations, so many of each place of the reflector, four points a line.
fn plan(bench: &Bench, stations: usize, holders: usize, lines: usize) {
    let high = [800.0, 600.0, 600.0];
    let corner = |k: usize| -> [f64; 3] { std::array::from_fn(|d| if k >> d & 1 == 0 { 0.0 } else { high[d] }) };
    // Each line begins where the one before ends.
    let ways = [0, 1, 3, 2, 0, 4, 5, 7, 6, 4, 3, 7, 0, 6, 1, 5, 2];
    let mut path = "station,line,time_s,x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm,speed_mm_s\n".to_owned();
    let mut places = "station,x_mm,y_mm,z_mm\n".to_owned();
    let mut time_s = 0;
    for (name, [x, y, z]) in &STATIONS[..stations] {
        writeln!(places, "{name},{x},{y},{z}").unwrap();
        for (holder, ([a, b, c], own)) in HOLDERS[..holders].iter().enumerate() {
            for way in own.iter().take(lines) {
                let (from, to) = (corner(ways[*way]), corner(ways[way + 1]));
                for k in 0..POINTS {
                    let share = k as f64 / (POINTS - 1) as f64;
                    let [x, y, z]: [f64; 3] = std::array::from_fn(|d| from[d] + share * (to[d] - from[d]));
                    time_s += 5;
                    writeln!(path, "{name},{name}-{holder}-{way},{time_s},{x:.4},{y:.4},{z:.4},{a},{b},{c},50")
                        .unwrap();
                }
            }
        }
    }
    fs::create_dir_all(bench.path("plan")).unwrap();
    bench.write("plan/path.csv", path);
    bench.write("plan/stations.csv", places);
}

fn free_address() -> String {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string()
}

/// The simulated machine on sockets: its server, its tracer, and the process.
fn serve(bench: &Bench) -> (String, String, Started) {
    let (server, tracer) = (free_address(), free_address());
    let (machine, plan) = (text(&machine()), bench.text("plan"));
    let own = ["simulate", "--machine", &machine, "--seed", SEED, "--plan", &plan, "--serve", "ippdme", "--again"];
    let pace = ["--faster", "200", "--dwell-s", "0.2", "--change-s", "0.3", "--tracer-hz", "200"];
    let at = ["--listen", &server, "--tracer-listen", &tracer];
    let started = Started::start(abbe(own.iter().chain(&pace).chain(&at)));
    for address in [&server, &tracer] {
        wait_until("it serves", Duration::from_secs(60), || TcpStream::connect(address).is_ok());
    }
    (server, tracer, started)
}

/// The file that a capture is told by.
fn config(bench: &Bench, server: &str, tracer: &str, more: &str) -> String {
    let content = format!(
        "machine = \"{}\"\nplan = \"plan\"\n{more}\n\
         [scale]\nkind = \"ippdme\"\nserver = \"{server}\"\nreads = \"polled\"\nevery_s = 0.005\nserver_offsets = true\n\
         [tracer]\nkind = \"lines\"\nfrom = {{ tcp = \"{tracer}\" }}\ncolumns = [\"station\", \"length_mm\", \"u_length_um\"]\n\
         silent_after_s = 2.0\n\
         [standstill]\nspan_um = 1.0\ncreep_um = 0.3\nshortest_s = 0.08\nlongest_s = 0.12\npause_s = 0.1\nmargin_s = 0.02\n\
         [motion]\nreversal_um = 20.0\nwindow_s = 0.02\n\
         [lengths]\npause_s = 0.1\n",
        text(&machine())
    );
    bench.write("capture.toml", content)
}

fn capture(bench: &Bench, config: &str) -> Started {
    let who = bench.write("who.toml", WHO);
    Started::start(abbe(["capture", config, "--out", &bench.text("captured"), "--json", "--identity", &who]))
}

/// Whole lines of the journal.
fn journal(bench: &Bench) -> Vec<Value> {
    let bytes = fs::read(bench.path("captured/journal.jsonl")).unwrap_or_default();
    let whole = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
    String::from_utf8_lossy(&bytes[..whole]).lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Points of the readings that were taken at once.
fn taken(bench: &Bench) -> Vec<u64> {
    journal(bench)
        .iter()
        .filter(|entry| entry["entry"] == "taken")
        .map(|entry| entry["point"].as_u64().unwrap())
        .collect()
}

fn ok(words: &[&str]) -> String {
    Started::start(abbe(words)).finish_within(LIMIT).ok()
}

/// Model of a campaign, and what is left at verification points: rms (µm) and what is stated of them.
fn verified(bench: &Bench, campaign: &str) -> Value {
    let (machine, model, points) = (text(&machine()), bench.text("model.json"), bench.text("perfect/verify.csv"));
    ok(&["identify", "--machine", &machine, "--campaign", &bench.text(campaign), "--out", &model]);
    serde_json::from_str(&ok(&["verify", "--model", &model, "--points", &points, "--json"])).unwrap()
}

/// How far lengths are from those at the same place in another campaign (um). Where lines meet the machine comes to a place more
/// than once, each time a little elsewhere: the nearest of them is meant.
fn off_um(own: &[(String, f64)], other: &[(String, f64)]) -> Vec<f64> {
    let of = |(place, length_mm): &(String, f64)| {
        let same = other.iter().filter(|(name, _)| name == place).map(|(_, mm)| (length_mm - mm) * 1e3);
        same.min_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or_else(|| panic!("{place} was not driven"))
    };
    own.iter().map(of).collect()
}

/// Length by station, reflector and place, of a campaign.
fn lengths(campaign: &str) -> Vec<(String, f64)> {
    let mut lines = campaign.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let place = |name: &str| names.iter().position(|known| *known == name).unwrap();
    let (line, length) = (place("line"), place("length_mm"));
    let axes = ["x_mm", "y_mm", "z_mm"].map(place);
    let mut all: Vec<(String, f64)> = lines
        .map(|row| {
            let cells: Vec<&str> = row.split(',').collect();
            let at = axes.map(|axis| format!("{:.1}", cells[axis].parse::<f64>().unwrap().abs())).join(" ");
            let (name, zero) = cells[line].split_once("-zero").unwrap_or((cells[line], "1"));
            let (set_up, _) = name.rsplit_once('-').unwrap();
            (format!("{set_up} zero{zero} {at}"), cells[length].parse().unwrap())
        })
        .collect();
    all.sort_by(|a, b| a.0.cmp(&b.0));
    all
}

#[test]
fn a_rehearsed_campaign_that_is_killed_goes_on_and_is_the_one_that_was_driven() {
    let bench = Bench::empty();
    plan(&bench, 4, 3, 6);
    let (machine, folder) = (text(&machine()), bench.text("plan"));
    ok(&["simulate", "--machine", &machine, "--seed", SEED, "--plan", &folder, "--out", &bench.text("perfect")]);
    let (server, tracer, served) = serve(&bench);
    let config = config(&bench, &server, &tracer, "");

    // Killed three times, whatever it is doing then.
    for count in [60, 140, 141] {
        let started = capture(&bench, &config);
        wait_until("readings come", LIMIT, || taken(&bench).len() >= count);
        signal(started.id(), Signal::KILL);
        drop(started);
    }
    let before = taken(&bench);
    let finished = capture(&bench, &config).finish_within(LIMIT);
    assert_eq!(finished.code, Some(0), "{}", finished.errors);
    let said = finished.errors;
    let outcome: Value = serde_json::from_slice(&finished.output).unwrap();
    drop(served);

    // What was captured before stands as it was, each point once.
    let after = taken(&bench);
    assert_eq!(after[..before.len()], before);
    // A line that begins where the one before ends needs no second reading there.
    assert!((248..=288).contains(&after.len()), "{}", after.len());
    assert_eq!(after.iter().collect::<BTreeSet<_>>().len(), after.len());
    assert_says(
        &said,
        &[
            "going on: 14",
            "uncertainty of a corrected point so far: ",
            "readings; time left",
            "all points are captured",
        ],
    );
    assert!(!said.contains("jumped") && !said.contains("differs"), "{said}");
    assert_eq!(
        [&outcome["captured"], &outcome["readings"], &outcome["points"]],
        [&Value::from(after.len()); 3],
        "{outcome:#}"
    );
    assert_eq!(outcome["open"], Value::Array(Vec::new()));
    let page = bench.read("captured/report.html");
    assert_says(&page, &["Captured campaign of", "Stations", "In order — Complete", "campaign.csv, SHA-256 "]);
    assert!(!page.contains("Still open"), "{page}");
    // The day is that of the capture itself.
    assert_names_who(&page);
    assert_says(&page, &["<dt>Measured</dt><dd>20"]);

    // The readings are those of the machine: 0.05 um of a single length, averaged.
    let (own, perfect) = (lengths(&bench.read("captured/campaign.csv")), lengths(&bench.read("perfect/campaign.csv")));
    let off = off_um(&own, &perfect);
    let rms_um = (off.iter().map(|um| um * um).sum::<f64>() / off.len() as f64).sqrt();
    assert!(rms_um < 0.03, "{rms_um} µm: {off:?}");
    assert!(bench.read("captured/campaign.csv").contains("dir_x"));

    // And so is the machine that is identified from them.
    let (captured, recorded) = (verified(&bench, "captured/campaign.csv"), verified(&bench, "perfect/campaign.csv"));
    let rms = |value: &Value| value["after_rms_um"].as_f64().unwrap();
    println!("captured {:.3} µm, recorded {:.3} µm, lengths {rms_um:.4} µm", rms(&captured), rms(&recorded));
    // The recorded one has a second reading at each corner; both know little of a machine from four points a line.
    assert!((rms(&captured) - rms(&recorded)).abs() < 0.3 * rms(&recorded), "{captured:#} {recorded:#}");
    let stated = outcome["u_um"].as_f64().unwrap();
    assert!(rms(&captured) < 2.0 * stated, "{captured:#} {stated}");
}

/// Between the tracer and the capture: what passes can be spoilt.
struct Relay {
    address: String,
    jump_nm: Arc<AtomicI64>,
    has_beam: Arc<AtomicBool>,
    stream: Arc<Mutex<Option<TcpStream>>>,
    inject: Arc<Mutex<Vec<u8>>>,
}

impl Relay {
    fn start(tracer: &str) -> Relay {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let relay = Relay {
            address: listener.local_addr().unwrap().to_string(),
            jump_nm: Arc::default(),
            has_beam: Arc::new(AtomicBool::new(true)),
            stream: Arc::default(),
            inject: Arc::default(),
        };
        let (jump_nm, has_beam) = (Arc::clone(&relay.jump_nm), Arc::clone(&relay.has_beam));
        let (stream, inject, tracer) = (Arc::clone(&relay.stream), Arc::clone(&relay.inject), tracer.to_owned());
        thread::spawn(move || {
            for client in listener.incoming().map(Result::unwrap) {
                *stream.lock().unwrap() = Some(client.try_clone().unwrap());
                let (mut client, source) = (client, TcpStream::connect(&tracer).unwrap());
                for line in BufReader::new(source).lines().map_while(Result::ok).skip(1) {
                    let cells: Vec<&str> = line.split(',').collect();
                    let length_mm: f64 = cells[1].parse().unwrap();
                    let shown = match has_beam.load(Ordering::Relaxed) {
                        true => format!("{:.7}", length_mm + jump_nm.load(Ordering::Relaxed) as f64 * 1e-6),
                        false => String::new(),
                    };
                    let more = std::mem::take(&mut *inject.lock().unwrap());
                    let sent =
                        client.write_all(&more).and_then(|()| writeln!(client, "{},{shown},{}", cells[0], cells[2]));
                    if sent.is_err() {
                        break;
                    }
                }
            }
        });
        relay
    }

    fn cut(&self) {
        if let Some(stream) = self.stream.lock().unwrap().take() {
            stream.shutdown(std::net::Shutdown::Both).unwrap();
        }
    }
}

#[test]
fn garbage_a_cut_line_a_lost_beam_and_a_jump_of_the_zero_are_told_and_no_wrong_reading_counts() {
    let bench = Bench::empty();
    plan(&bench, 1, 1, 12);
    let (server, tracer, _served) = serve(&bench);
    let relay = Relay::start(&tracer);
    let config = config(&bench, &server, &relay.address, "check = { raw_error_um = 100.0 }");
    let started = capture(&bench, &config);
    wait_until("readings come", LIMIT, || taken(&bench).len() >= 6);
    let garbage = [
        b"\xff\xfe\x00 nonsense\nfront-left,1e99x,0.2\nfront-left\n".to_vec(),
        vec![b'7'; 50_000],
        b"\n".repeat(20_000),
    ];
    relay.inject.lock().unwrap().extend(garbage.concat());
    wait_until("it goes on after garbage", LIMIT, || taken(&bench).len() >= 10);
    relay.cut();
    wait_until("it goes on after a lost connection", LIMIT, || taken(&bench).len() >= 20);
    relay.has_beam.store(false, Ordering::Relaxed);
    let lost = taken(&bench).len();
    thread::sleep(Duration::from_secs(2));
    assert!(taken(&bench).len() <= lost + 1, "without a beam there is no reading");
    // The beam comes back with another zero.
    relay.jump_nm.store(2_500_000, Ordering::Relaxed);
    relay.has_beam.store(true, Ordering::Relaxed);
    let finished = started.finish_within(LIMIT);
    assert_eq!(finished.code, Some(0), "{}", finished.errors);
    let said = &finished.errors;
    assert_says(
        said,
        &[
            "tracer: line",
            "is no UTF-8 text",
            "longer than 4096 bytes",
            "it is tried again",
            "the length is empty",
            "the zero of the tracer jumped by +25",
            "kept as a station of its own",
        ],
    );
    let entries = journal(&bench);
    let of = |what: &str| entries.iter().filter(|entry| entry["entry"] == what).collect::<Vec<_>>();
    assert_eq!(of("zero").len(), 1, "{said}");
    // After the jump every reading that counts has the new zero.
    let place = entries.iter().position(|entry| entry["entry"] == "zero").unwrap();
    assert!(entries[place..].iter().filter(|entry| entry["entry"] == "taken").all(|entry| entry["zero"] == 1));
    let outcome: Value = serde_json::from_slice(&finished.output).unwrap();
    assert!((37..=48).contains(&outcome["captured"].as_u64().unwrap()), "{outcome:#}");
    assert_eq!(outcome["open"], Value::Array(Vec::new()));
    // Each reading counts from the zero that it was measured with, those before the jump was noticed too.
    let (machine, folder) = (text(&machine()), bench.text("plan"));
    ok(&["simulate", "--machine", &machine, "--seed", SEED, "--plan", &folder, "--out", &bench.text("perfect")]);
    let perfect = lengths(&bench.read("perfect/campaign.csv"));
    let captured = lengths(&bench.read("captured/campaign.csv"));
    let (of_new, of_old): (Vec<_>, Vec<_>) = captured.into_iter().partition(|(place, _)| place.contains("zero2"));
    assert!(of_new.len() > 10 && of_old.len() > 10, "{said}");
    let back: Vec<(String, f64)> =
        of_new.into_iter().map(|(place, mm)| (place.replace("zero2", "zero1"), mm - 2.5)).collect();
    let off = [off_um(&of_old, &perfect), off_um(&back, &perfect)].concat();
    assert!(off.iter().all(|um| um.abs() < 0.3), "{off:?}");
}

#[test]
fn what_does_not_belong_together_is_refused_and_ctrl_c_keeps_what_is_there() {
    let bench = Bench::empty();
    // Long enough to be interrupted before its end, and before its second station, however busy the machine is.
    plan(&bench, 2, 1, 16);
    let (server, tracer, _served) = serve(&bench);
    let file = config(&bench, &server, &tracer, "");
    let out = bench.text("captured");
    let capture_again = |more: &[&str]| run(["capture", &file, "--out", &out].iter().chain(more));
    assert_says(&capture_again(&["--finish"]).refused(), &["journal.jsonl: there is no journal"]);
    let started = capture(&bench, &file);
    wait_until("readings come", LIMIT, || taken(&bench).len() >= 3);
    assert_says(&capture_again(&[]).refused(), &["journal.jsonl: another capture is writing it", "--out"]);
    signal(started.id(), Signal::INT);
    let stopped = started.finish_within(LIMIT).ended(130);
    assert_says(&stopped, &["stopped on request with", "of 98 points; the same command goes on"]);
    let outcome: Value = serde_json::from_str(&bench.read("captured/report.json")).unwrap();
    assert_eq!(outcome["captured"].as_u64().unwrap() as usize, taken(&bench).len());
    assert!(outcome["open"][0].as_str().unwrap().contains("of line front-left-"), "{outcome:#}");
    let finished = capture_again(&["--finish"]).ok();
    assert_says(&finished, &["points of the plan are captured"]);
    follows(&bench.path(""), &finished, "capture");
    assert_says(
        &bench.read("captured/report.html"),
        &["Warning — Not complete", "Still open", "journal.jsonl, SHA-256 ", "No readings yet from front-right."],
    );
    // Half a line, as a power cut leaves it.
    let journal = bench.path("captured/journal.jsonl");
    let whole = fs::read(&journal).unwrap();
    fs::write(&journal, &whole[..whole.len() - 7]).unwrap();
    assert_says(&capture_again(&["--finish"]).errors, &["ended in the middle of a reading"]);
    fs::write(&journal, [&whole[..], b"no entry\n"].concat()).unwrap();
    assert_says(&capture_again(&["--finish"]).refused(), &["journal.jsonl, line", "is no entry"]);
    fs::write(&journal, &whole).unwrap();
    // Another plan, another machine.
    plan(&bench, 1, 1, 3);
    assert_says(&capture_again(&["--finish"]).refused(), &["since it was begun the plan changed", "--out"]);
    bench.write("plan/plan.json", "{\"machine\": \"gantry\"}");
    assert_says(&capture_again(&[]).refused(), &["plan.json", "the plan is of machine gantry", "bridge_xyz"]);
    fs::remove_file(bench.path("plan/plan.json")).unwrap();
    let content = fs::read_to_string(&file).unwrap();
    bench.write("capture.toml", content.replace(&text(&machine()), &text(&other_machine())));
    assert_says(
        &capture_again(&[]).refused(),
        &["path.csv", "outside of the stroke", "plan with the machine file of this one"],
    );
    bench.write("capture.toml", content.replace("reads = \"polled\"\nevery_s = 0.005", "reads = \"moves\""));
    assert_says(&capture_again(&[]).refused(), &["capture.toml", "scale.reads"]);
    bench.write("capture.toml", content.replace("every_s", "evry_s"));
    assert_says(&capture_again(&[]).refused(), &["capture.toml", "evry_s"]);
}
