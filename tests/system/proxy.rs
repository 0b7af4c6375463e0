//! `abbe proxy` as measuring software sees it: corrected positions equal those of `abbe correct`, all else is what the server
//! said, and what cannot be corrected is an error.

#[path = "../../nodes/ippdme/tests/cmm/mod.rs"]
mod cmm;
#[path = "../../nodes/ippdme/tests/cmm/tcp.rs"]
mod tcp;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Stdio};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use crate::common::assert_says;
use crate::common::files::{Bench, samples};
use crate::common::program::{abbe, run, signal};
use abbe_msgs::{CorrectedCoordinates, ScaleReading};
use cmm::{Cmm, placed};
use rustix::process::Signal;
use tcp::Tcp;

/// Inside the offsets of the simulated campaign.
const PROBE_MM: [f64; 3] = [0.0, 0.0, -60.0];

/// The program under test, listening.
struct Proxy {
    child: Child,
    address: String,
    said: Option<JoinHandle<String>>,
}

impl Proxy {
    fn start(bench: &Bench, to: &str, more: &[&str]) -> Proxy {
        let model = bench.text("model.json");
        let arguments = ["proxy", "--listen", "127.0.0.1:0", "--to", to, "--model", &model];
        let mut command = abbe(arguments.iter().chain(more).copied().collect::<Vec<_>>());
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let mut errors = BufReader::new(child.stderr.take().unwrap());
        let mut first = String::new();
        errors.read_line(&mut first).unwrap();
        let address = first.split("listening on ").nth(1).unwrap_or_else(|| panic!("{first}"));
        let address = address.split(',').next().unwrap().to_owned();
        let said = thread::spawn(move || {
            let mut said = String::new();
            errors.read_to_string(&mut said).unwrap();
            said
        });
        Proxy { child, address, said: Some(said) }
    }

    /// Ends it with Ctrl-C; gives its exit code and what it said.
    fn end(mut self) -> (Option<i32>, String) {
        signal(self.child.id(), Signal::INT);
        let code = self.child.wait().unwrap().code();
        (code, self.said.take().unwrap().join().unwrap())
    }
}

impl Drop for Proxy {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Measuring software.
struct Software {
    stream: BufReader<TcpStream>,
    number: u32,
}

impl Software {
    fn connect(address: &str) -> Software {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let mut software = Software { stream: BufReader::new(stream), number: 0 };
        assert!(software.ask("StartSession()").is_empty());
        software
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.stream.read_line(&mut line).unwrap();
        line.strip_suffix("\r\n").unwrap_or_else(|| panic!("no whole line: {line:?}")).to_owned()
    }

    /// A command; the lines of its answer between `&` and `%`, without tag.
    fn ask(&mut self, command: &str) -> Vec<String> {
        self.number += 1;
        let tag = format!("{:05} ", self.number);
        self.stream.get_mut().write_all(format!("{tag}{command}\r\n").as_bytes()).unwrap();
        let mut lines = Vec::new();
        loop {
            let line = self.line();
            let Some(own) = line.strip_prefix(&tag) else { panic!("{command}: {line}") };
            match own {
                "&" => {}
                "%" => return lines,
                other => lines.push(other.to_owned()),
            }
        }
    }
}

/// Digits of X, Y, Z as they stand in an answer.
fn digits(answer: &[String]) -> [String; 3] {
    let [line] = answer else { panic!("one line: {answer:?}") };
    ["X(", "Y(", "Z("].map(|axis| {
        let after = line.split(axis).nth(1).unwrap_or_else(|| panic!("{line}"));
        after.split(')').next().unwrap().to_owned()
    })
}

fn numbers(digits: &[String; 3]) -> [f64; 3] {
    std::array::from_fn(|d| digits[d].parse().unwrap())
}

fn server(decimals: usize) -> Tcp {
    let mut cmm = Cmm { decimals, ..Cmm::default() };
    cmm.tools_mm.insert("Probe1".to_owned(), PROBE_MM);
    Tcp::start(cmm)
}

/// Positions all over the volume (mm, scales).
fn places() -> Vec<[f64; 3]> {
    let share = |k: usize, factor: f64| (k as f64 * factor).fract();
    (1..=40)
        .map(|k| [780.0 * share(k, 0.819_172_5), 580.0 * share(k, 0.671_043_6), 580.0 * share(k, 0.549_700_5)])
        .collect()
}

/// What `abbe correct` makes of tips in the machine's system (mm), as text.
fn corrected(bench: &Bench, tips: &[[String; 3]]) -> Vec<[f64; 3]> {
    let rows: Vec<String> = tips
        .iter()
        .map(|tip| {
            // The tip less its offset, exact in the digits of the wire.
            let z: f64 = tip[2].parse().unwrap();
            format!("{},{},{:.9},0,0,{}", tip[0], tip[1], z - PROBE_MM[2], PROBE_MM[2])
        })
        .collect();
    let head = "x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm";
    let points = bench.write("points.csv", format!("{head}\n{}\n", rows.join("\n")));
    let out = bench.text("corrected.csv");
    run(["correct", "--model", &bench.text("model.json"), "--in", &points, "--out", &out]).ok();
    let table = bench.read("corrected.csv");
    let mut lines = table.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = |name: &str| names.iter().position(|known| *known == name).unwrap_or_else(|| panic!("{names:?}"));
    let columns = ["corrected_x_mm", "corrected_y_mm", "corrected_z_mm"].map(column);
    lines
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            columns.map(|column| cells[column].parse().unwrap())
        })
        .collect()
}

#[test]
fn val_abbe_correct_positions_are_the_same_to_the_last_digit_and_the_recording_replays() {
    let bench = Bench::identified(5);
    let server = server(5);
    let folder = bench.text("recorded");
    let proxy =
        Proxy::start(&bench, &server.address, &["--tool", "Probe1=0,0,-60", "--scans-as-asked", "--record", &folder]);
    let mut software = Software::connect(&proxy.address);
    let (mut raw, mut told) = (Vec::new(), Vec::new());
    for (k, place) in places().into_iter().enumerate() {
        server.cmm().scales_mm = place;
        let tip = server.cmm().tip_mm();
        raw.push(tip.map(|mm| format!("{mm:.5}")));
        told.push(match k % 2 {
            0 => digits(&software.ask("Get(X(), Y(), Z())")),
            _ => digits(&software.ask(&format!("PtMeas(X({}), Y({}), Z({}), IJK(0,0,1))", tip[0], tip[1], tip[2]))),
        });
    }
    let expected = corrected(&bench, &raw);
    let mut moved = 0.0_f64;
    for ((told, expected), raw) in told.iter().zip(&expected).zip(&raw) {
        assert_eq!(*told, expected.map(|mm| format!("{mm:.7}")));
        moved = (0..3).map(|d| (expected[d] - raw[d].parse::<f64>().unwrap()).abs()).fold(moved, f64::max);
    }
    assert!(moved > 0.005, "the machine errs by micrometres: {moved} mm");
    // Of a scan, too: four numbers a point, several points a line.
    let scan = software.ask("ScanOnLine(100, 110, 20, 600, 110, 20, 0, 0, 1, 50)");
    let values: Vec<&str> = scan.iter().flat_map(|line| line.strip_prefix("# ").unwrap().split(", ")).collect();
    let raw: Vec<[String; 3]> =
        (0..=10).map(|k| [100.0 + 50.0 * f64::from(k), 110.0, 20.0].map(|mm| format!("{mm:.5}"))).collect();
    for (point, expected) in values.chunks(4).zip(corrected(&bench, &raw)) {
        assert_eq!(point[..3], expected.map(|mm| format!("{mm:.7}")));
        assert_eq!(point[3], "0.00000", "what is no coordinate stays as it was");
    }
    drop(software);
    let (code, said) = proxy.end();
    assert_eq!(code, Some(0), "{said}");
    assert_says(
        &said,
        &[
            "1 connections; lines with positions: 43 corrected, 0 refused",
            "2 Extrapolated, 49 InVolume",
            "102 messages, 0 not recorded",
        ],
    );
    run(["replay", "--bag", &folder, "--model", &bench.text("model.json")]).ok();
    let readings = samples::<ScaleReading>(&bench.path("recorded"), "/bridge_xyz/scale/reading");
    let sent = samples::<CorrectedCoordinates>(&bench.path("recorded"), "/bridge_xyz/corrected");
    assert_eq!((readings.len(), sent.len()), (51, 51));
    assert_eq!(sent[0].corrected_m.map(|m| format!("{:.7}", m * 1e3)), told[0]);
}

#[test]
fn points_of_a_part_are_turned_and_shifted_corrected_points_of_the_machine() {
    let bench = Bench::identified(5);
    let server = server(9);
    let proxy = Proxy::start(&bench, &server.address, &["--tool", "Probe1=0,0,-60"]);
    let mut software = Software::connect(&proxy.address);
    let part = [120.0, -30.0, 45.0, 37.0, 211.0, 15.0];
    software.ask(&format!("SetCsyTransformation(PartCsy, {})", part.map(|n| n.to_string()).join(", ")));
    for place in places().into_iter().take(10) {
        server.cmm().scales_mm = place;
        software.ask("SetCoordSystem(MachineCsy)");
        let machine = numbers(&digits(&software.ask("Get(X(), Y(), Z())")));
        software.ask("SetCoordSystem(PartCsy)");
        let told = numbers(&digits(&software.ask("Get(X(), Y(), Z())")));
        let expected = placed(part, machine);
        // Both are written to a nanometre, and turned digits add up.
        let apart = (0..3).map(|d| (told[d] - expected[d]).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-8, "{apart} mm");
        let tip = server.cmm().tip_mm();
        let raw = placed(part, tip);
        assert!((0..3).any(|d| (told[d] - raw[d]).abs() > 1e-3), "and not the raw ones");
    }
}

#[test]
fn a_target_turned_back_is_where_the_tip_comes_to_a_nanometre() {
    let bench = Bench::identified(5);
    let server = server(9);
    let proxy = Proxy::start(&bench, &server.address, &["--tool", "Probe1=0,0,-60", "--invert-targets"]);
    let mut software = Software::connect(&proxy.address);
    for [x, y, z] in places().into_iter().take(10) {
        let wanted = [x, y, z - 60.0];
        software.ask(&format!("GoTo(X({}), Y({}), Z({}))", wanted[0], wanted[1], wanted[2]));
        let told = numbers(&digits(&software.ask("Get(X(), Y(), Z())")));
        let missed = (0..3).map(|d| (told[d] - wanted[d]).abs()).fold(0.0, f64::max);
        assert!(missed < 1e-6, "{missed} mm, a nanometre is allowed");
        let tip = server.cmm().tip_mm();
        assert!((0..3).any(|d| (tip[d] - wanted[d]).abs() > 1e-4), "the machine was told something else");
    }
}

#[test]
fn what_cannot_be_corrected_is_an_error_and_never_the_raw_position() {
    let bench = Bench::identified(5);
    let server = server(5);
    let proxy = Proxy::start(&bench, &server.address, &["--tool", "Probe1=0,0,-60"]);
    let mut software = Software::connect(&proxy.address);
    server.cmm().scales_mm = [5000.0, 0.0, 0.0];
    let told = software.ask("Get(X(), Y(), Z())");
    assert_says(&told.join("\n"), &["! Error(2, 8501, \"Get\"", "implausible for this machine"]);
    assert!(!told.join("").contains("5000"), "{told:?}");
    assert_says(&software.ask("GoTo(X(1), Y(2), Z(3))").join(""), &["0514"]);
    software.ask("ClearAllErrors()");
    software.ask("ChangeTool(\"Star\")");
    assert_says(&software.ask("PtMeas(X(1), Y(2), Z(3))").join(""), &["8502", "offset of tool Star is not known"]);
    assert_eq!(server.count("PtMeas"), 0, "a point that could not be corrected is not measured");
    software.ask("ClearAllErrors()");
    software.ask("ChangeTool(\"Probe1\")");
    server.cmm().scales_mm = [100.0, 100.0, 100.0];
    digits(&software.ask("Get(X(), Y(), Z())"));
    drop(software);
    let (code, said) = proxy.end();
    assert_eq!(code, Some(0));
    assert_says(&said, &["1 corrected, 2 refused", "implausible"]);
}

#[test]
fn software_comes_and_goes_and_connections_that_break_harm_nobody() {
    let bench = Bench::identified(5);
    let server = server(5);
    let proxy = Proxy::start(&bench, &server.address, &["--tool", "Probe1=0,0,-60"]);
    for _ in 0..5 {
        let mut software = Software::connect(&proxy.address);
        digits(&software.ask("Get(X(), Y(), Z())"));
    }
    // The server ends in the middle of a position: half a line does not pass.
    let mut software = Software::connect(&proxy.address);
    server.say(b"00077 # X(1.5), Y(2.5), Z(3");
    server.cut();
    let mut rest = String::new();
    software.stream.read_to_string(&mut rest).unwrap();
    assert_eq!(rest, "");
    // Garbage and floods from both sides.
    let mut software = Software::connect(&proxy.address);
    server.say(&b"E0000 # KeyPress(\"F1\")\r\n".repeat(20_000));
    server.say(b"\xff\x00garbage\r\n");
    for _ in 0..20_000 {
        assert_eq!(software.line(), "E0000 # KeyPress(\"F1\")");
    }
    let mut garbage = Vec::new();
    software.stream.read_until(b'\n', &mut garbage).unwrap();
    assert_eq!(garbage, b"\xff\x00garbage\r\n");
    software.stream.get_mut().write_all(&[b'7'; 200_000]).unwrap();
    let _ = software.stream.get_mut().write_all(b"\r\n");
    let mut rest = Vec::new();
    // The connection ends; how the system says it does not matter.
    let _ = software.stream.read_to_end(&mut rest);
    let mut software = Software::connect(&proxy.address);
    digits(&software.ask("Get(X(), Y(), Z())"));
    drop(software);
    let (code, said) = proxy.end();
    assert_eq!(code, Some(0), "{said}");
    assert_says(
        &said,
        &["8 connections", "in the middle of a line, which did not pass", "longer than the protocol allows"],
    );
    // No server: the software is told in its own words.
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let proxy = Proxy::start(&bench, &free, &["--tool", "Probe1=0,0,-60"]);
    let mut told = String::new();
    TcpStream::connect(&proxy.address).unwrap().read_to_string(&mut told).unwrap();
    assert_eq!(told, "E0000 ! Error(9, 0503, \"abbe\", \"Controller communications failure\")\r\n");
    assert_eq!(proxy.end().0, Some(0));
}

#[test]
fn options_that_give_no_correction_are_refused_with_what_to_do() {
    let bench = Bench::identified(5);
    let model = bench.text("model.json");
    let said = |more: &[&str]| {
        let arguments = ["proxy", "--listen", "127.0.0.1:0", "--model", &model];
        run(arguments.iter().chain(more).copied().collect::<Vec<_>>()).refused()
    };
    let to = ["--to", "127.0.0.1:9"];
    assert_says(&said(&to), &["name each with --tool NAME=X,Y,Z", "--server-offsets"]);
    assert_says(&said(&[to[0], to[1], "--tool", "A=1,2"]), &["--tool A=1,2", "three numbers"]);
    assert_says(&said(&[to[0], to[1], "--tool", "A=1,2,3", "--tool", "A=1,2,3"]), &["each tool once"]);
    assert_says(&said(&[to[0], to[1], "--offset-mm", "0,0,1e9"]), &["10000 mm"]);
    assert_says(&said(&["--to", "nowhere", "--offset-mm", "0,0,-60"]), &["--to: \"nowhere\" is no host:port"]);
    let taken = bench.text("model.json");
    assert_says(&said(&[to[0], to[1], "--offset-mm", "0,0,-60", "--record", &taken]), &["exists already"]);
}

#[test]
fn regress_a_server_that_leaves_a_question_of_the_proxy_open_is_given_up() {
    let bench = Bench::identified(5);
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let proxy = Proxy::start(&bench, &server.local_addr().unwrap().to_string(), &["--offset-mm", "0,0,-60"]);
    let client = TcpStream::connect(&proxy.address).unwrap();
    client.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let mut of_server = BufReader::new(server.accept().unwrap().0);
    // Answers the software, and nothing that the proxy asks by itself.
    let answering = thread::spawn(move || {
        let mut line = String::new();
        while of_server.read_line(&mut line).is_ok_and(|count| count > 0) {
            if line.contains("StartSession") {
                let tag = &line[..5];
                of_server.get_mut().write_all(format!("{tag} &\r\n{tag} %\r\n").as_bytes()).unwrap();
            }
            line.clear();
        }
    });
    let mut answers = BufReader::new(&client);
    (&client).write_all(b"00001 StartSession()\r\n").unwrap();
    let mut heard = String::new();
    while !heard.contains('%') {
        answers.read_line(&mut heard).unwrap();
    }
    (&client).write_all(b"00002 Get(X(), Y(), Z())\r\n").unwrap();
    answers.read_to_string(&mut heard).unwrap();
    assert!(!heard.contains('#'), "{heard:?}");
    answering.join().unwrap();
    assert_says(&proxy.end().1, &["left a question of the proxy without an answer"]);
}
