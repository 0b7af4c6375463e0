//! The simulated machine behind OPC UA: what a client of others sees of it, and a campaign captured whole by the driver `opcua`.

use std::fmt::Write as _;
use std::fs;
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

use crate::common::assert_says;
use crate::common::files::{Bench, machine, text};
use crate::common::program::{Started, abbe, run, signal, wait_until};
use crate::common::python::{python, said};
use rustix::process::Signal;
use serde_json::{Value, json};

/// Far beyond what a rehearsal takes on a loaded machine.
const LIMIT: Duration = Duration::from_secs(900);
const SEED: &str = "11";
/// Place of the reflector.
const OFFSET_MM: [f64; 3] = [0.0, 0.0, -60.0];
/// Millimetre, as the OPC Foundation has it.
const MILLIMETRE: (&str, i64) = ("http://www.opcfoundation.org/UA/units/un/cefact", 5_066_068);

/// Two stations, a way along edges and diagonals of the volume from each, three points a line.
fn plan(bench: &Bench) {
    let corners = [[0.0, 0.0, 0.0], [800.0, 0.0, 0.0], [800.0, 600.0, 0.0], [0.0, 600.0, 600.0], [800.0, 0.0, 600.0]];
    let stations = [("front", [-250.0, -250.0, -150.0]), ("back", [1050.0, 850.0, -150.0])];
    let mut path = "station,line,time_s,x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm,speed_mm_s\n".to_owned();
    let mut places = "station,x_mm,y_mm,z_mm\n".to_owned();
    let [a, b, c] = OFFSET_MM;
    let mut time_s = 0;
    for (name, [x, y, z]) in stations {
        writeln!(places, "{name},{x},{y},{z}").unwrap();
        for (way, ends) in corners.windows(2).enumerate() {
            for k in 0..3 {
                let share = f64::from(k) / 2.0;
                let [x, y, z]: [f64; 3] = std::array::from_fn(|d| ends[0][d] + share * (ends[1][d] - ends[0][d]));
                time_s += 5;
                writeln!(path, "{name},{name}-{way},{time_s},{x:.4},{y:.4},{z:.4},{a},{b},{c},50").unwrap();
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
    let own = ["simulate", "--machine", &machine, "--seed", SEED, "--plan", &plan, "--serve", "opcua", "--again"];
    let pace = ["--faster", "100", "--dwell-s", "0.5", "--change-s", "0.5", "--tracer-hz", "200"];
    let at = ["--listen", &server, "--tracer-listen", &tracer];
    let started = Started::start(abbe(own.iter().chain(&pace).chain(&at)));
    wait_until("it serves", Duration::from_secs(60), || TcpStream::connect(&server).is_ok());
    (server, tracer, started)
}

/// Length by line and place, of a campaign.
fn lengths(campaign: &str) -> Vec<(String, f64)> {
    let mut lines = campaign.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let place = |name: &str| names.iter().position(|known| *known == name).unwrap();
    let (station, length) = (place("station"), place("length_mm"));
    let axes = ["x_mm", "y_mm", "z_mm"].map(place);
    let of = |row: &str| {
        let cells: Vec<&str> = row.split(',').collect();
        let at = axes.map(|axis| format!("{:.1}", cells[axis].parse::<f64>().unwrap().abs())).join(" ");
        (format!("{} {at}", cells[station]), cells[length].parse().unwrap())
    };
    lines.map(of).collect()
}

#[test]
fn val_asyncua_reads_and_subscribes_the_simulated_machine_and_cannot_write() {
    let Some(mut client) = python("opcua_user.py") else { return };
    let bench = Bench::empty();
    plan(&bench);
    let (server, _tracer, _served) = serve(&bench);
    client.arg(server.rsplit(':').next().unwrap());
    let seen = said(client);
    assert_eq!(seen["namespaces"], json!(["http://opcfoundation.org/UA/", "urn:abbe:simulated-machine"]), "{seen:#}");
    for name in ["X", "Y", "Z", "Server"] {
        assert!(seen["names"].as_array().unwrap().contains(&json!(name)), "{seen:#}");
    }
    // It stands at the beginning of its way until the tracer is read.
    let values: Vec<f64> = seen["values"].as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect();
    assert!(values.len() == 3 && values.iter().all(|mm| mm.is_finite() && mm.abs() < 1000.0), "{seen:#}");
    assert_eq!(seen["good"], json!([true, true, true]));
    let stamps = seen["stamps"].as_array().unwrap();
    assert!(stamps[0] == stamps[1] && stamps[1] == stamps[2], "one instant: {seen:#}");
    assert_eq!(seen["units"], json!([MILLIMETRE, MILLIMETRE, MILLIMETRE]));
    assert!(seen["changes"].as_u64().unwrap() >= 10, "{seen:#}");
    assert_ne!(seen["write"], json!("taken"), "nobody moves the scales from outside");
}

#[test]
fn a_campaign_is_captured_over_opc_ua_killed_in_the_middle_and_is_the_one_that_was_driven() {
    let bench = Bench::empty();
    plan(&bench);
    let (machine, folder) = (text(&machine()), bench.text("plan"));
    let perfect =
        ["simulate", "--machine", &machine, "--seed", SEED, "--plan", &folder, "--out", &bench.text("perfect")];
    Started::start(abbe(perfect)).finish_within(LIMIT).ok();
    let (server, tracer, _served) = serve(&bench);
    let node = |name: &str| format!("{}_mm = \"nsu=urn:abbe:simulated-machine;s={name}\"", name.to_lowercase());
    let content = format!(
        "machine = \"{machine}\"\nplan = \"plan\"\n\
         [scale]\nkind = \"opcua\"\nserver = \"opc.tcp://{server}\"\naxes = {{ {} }}\nreads = \"polled\"\njoined = \"held\"\n\
         every_s = 0.01\noffset_mm = {OFFSET_MM:?}\n\
         [tracer]\nkind = \"lines\"\nfrom = {{ tcp = \"{tracer}\" }}\ncolumns = [\"station\", \"length_mm\", \"u_length_um\"]\n\
         [standstill]\nspan_um = 1.0\ncreep_um = 0.3\nshortest_s = 0.2\nlongest_s = 0.3\npause_s = 0.15\nmargin_s = 0.03\n\
         [lengths]\npause_s = 0.1\n",
        ["X", "Y", "Z"].map(node).join(", ")
    );
    let config = bench.write("capture.toml", content);
    let out = bench.text("captured");
    let taken = || {
        let journal = fs::read_to_string(bench.path("captured/journal.jsonl")).unwrap_or_default();
        journal.lines().filter(|line| line.contains("\"taken\"")).count()
    };
    let started = Started::start(abbe(["capture", &config, "--out", &out]));
    wait_until("readings come", LIMIT, || taken() >= 5);
    signal(started.id(), Signal::KILL);
    drop(started);
    let finished = Started::start(abbe(["capture", &config, "--out", &out, "--json"])).finish_within(LIMIT);
    assert_eq!(finished.code, Some(0), "{}", finished.errors);
    assert_says(&finished.errors, &["going on: ", "all points are captured"]);
    let outcome: Value = serde_json::from_slice(&finished.output).unwrap();
    assert_eq!(outcome["open"], json!([]), "{outcome:#}");

    let (own, perfect) = (lengths(&bench.read("captured/campaign.csv")), lengths(&bench.read("perfect/campaign.csv")));
    assert!(own.len() >= 18, "{own:?}");
    let off: Vec<f64> = own
        .iter()
        .map(|(place, mm)| {
            let same = perfect.iter().filter(|(other, _)| other == place).map(|(_, other)| (mm - other) * 1e3);
            same.min_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or_else(|| panic!("{place} was not driven"))
        })
        .collect();
    let rms_um = (off.iter().map(|um| um * um).sum::<f64>() / off.len() as f64).sqrt();
    println!("{} readings, lengths {rms_um:.4} µm off", off.len());
    assert!(rms_um < 0.05, "{rms_um} µm: {off:?}");
}

#[test]
fn what_opc_ua_cannot_do_is_refused_with_what_to_do() {
    let bench = Bench::empty();
    plan(&bench);
    let (machine, folder) = (text(&machine()), bench.text("plan"));
    let words = ["simulate", "--machine", &machine, "--seed", SEED, "--plan", &folder, "--serve", "opcua", "--obey"];
    assert_says(&run(words).refused(), &["--obey", "OPC UA has no order to move"]);
}
