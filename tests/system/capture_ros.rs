//! A campaign captured from a machine, a tracer and a sensor that are on ROS 2, of others.

use std::fmt::Write as _;
use std::fs;
use std::net::{TcpListener, TcpStream};
use std::process::Child;
use std::time::Duration;

use crate::common::assert_says;
use crate::common::files::{Bench, machine, text};
use crate::common::network::in_own_network;
use crate::common::program::{Started, abbe, abbe_in, wait_until};
use crate::common::python::python;
use serde_json::{Value, json};

/// Far beyond what it takes on a loaded machine.
const LIMIT: Duration = Duration::from_secs(600);
const SEED: &str = "11";
/// What the peer adds to each length (mm).
const LONGER_MM: f64 = 10_000.0;
const OFFSET_Z_MM: &str = "-60";

/// One station and three lines of three points.
fn plan(bench: &Bench) {
    let corners = [[0.0, 0.0, 0.0], [800.0, 0.0, 0.0], [800.0, 600.0, 0.0], [0.0, 600.0, 600.0]];
    let mut path = "station,line,time_s,x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm,speed_mm_s\n".to_owned();
    for (way, ends) in corners.windows(2).enumerate() {
        for k in 0..3 {
            let [x, y, z]: [f64; 3] =
                std::array::from_fn(|d| ends[0][d] + 0.5 * f64::from(k) * (ends[1][d] - ends[0][d]));
            let time_s = 10 * way + 3 * k as usize;
            writeln!(path, "front,way-{way},{time_s},{x:.4},{y:.4},{z:.4},0,0,{OFFSET_Z_MM},50").unwrap();
        }
    }
    fs::create_dir_all(bench.path("plan")).unwrap();
    bench.write("plan/path.csv", path);
    bench.write("plan/stations.csv", "station,x_mm,y_mm,z_mm\nfront,-250,-250,-150\n");
}

/// The peer; it ends with the test.
struct Bridge(Child);

impl Drop for Bridge {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn val_cyclone_a_machine_on_ros_2_is_captured() {
    in_own_network("capture_ros::val_cyclone_a_machine_on_ros_2_is_captured", |domain| {
        let Some(mut peer) = python("bridge.py") else { return };
        let bench = Bench::empty();
        plan(&bench);
        let free = || TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
        let (machine, folder, server, tracer) = (text(&machine()), bench.text("plan"), free(), free());
        let own = ["simulate", "--machine", &machine, "--seed", SEED, "--plan", &folder];
        let perfect = own.iter().chain(&["--out"]).map(|word| (*word).to_owned()).chain([bench.text("perfect")]);
        Started::start(abbe(perfect)).finish_within(LIMIT).ok();
        let serve = ["--serve", "ippdme", "--again", "--faster", "100", "--dwell-s", "0.6", "--change-s", "0.5"];
        let at = ["--tracer-hz", "100", "--listen", &server, "--tracer-listen", &tracer];
        let _served = Started::start(abbe(own.iter().chain(&serve).chain(&at)));
        wait_until("it serves", Duration::from_secs(60), || TcpStream::connect(&server).is_ok());

        let config = bench.write(
            "capture.toml",
            format!(
                "machine = \"{machine}\"\nplan = \"plan\"\n\
                 [scale]\nkind = \"ros\"\ntopic = \"cmm/joint_states\"\nmessage = \"joint_state\"\n\
                 [tracer]\nkind = \"ros\"\ntopic = \"/tracer/point\"\nmessage = \"point\"\nframe_id = \"tracer\"\nu_length_um = 0.2\n\
                 [[covariates]]\nkind = \"ros\"\ntopic = \"/hall/air\"\nmessage = \"temperature\"\ncovariate = \"temp_air_c\"\n\
                 [standstill]\nspan_um = 1.0\ncreep_um = 0.3\nshortest_s = 0.2\nlongest_s = 0.3\npause_s = 0.2\nmargin_s = 0.04\n\
                 [lengths]\npause_s = 0.15\n"
            ),
        );
        peer.args([&domain.id().to_string(), &server, &tracer, OFFSET_Z_MM]);
        let _peer = Bridge(peer.spawn().unwrap());
        let words = ["capture", &config, "--out", &bench.text("captured"), "--json"];
        let finished = Started::start(abbe_in(domain, words)).finish_within(LIMIT);
        assert_eq!(finished.code, Some(0), "{}", finished.errors);
        assert_says(
            &finished.errors,
            &["scale: connected with /cmm/joint_states", "tracer: connected with /tracer/point"],
        );
        let outcome: Value = serde_json::from_slice(&finished.output).unwrap();
        assert_eq!(outcome["open"], json!([]), "{outcome:#}");

        let perfect = lengths(&bench.read("perfect/campaign.csv"));
        let captured = bench.read("captured/campaign.csv");
        assert!(captured.lines().next().unwrap().contains("temp_air_c"), "{captured}");
        let own = lengths(&captured);
        assert!(own.len() >= 7, "{captured}");
        for (place, mm) in &own {
            let off =
                perfect.iter().filter(|(other, _)| other == place).map(|(_, other)| (mm - LONGER_MM - other) * 1e3);
            let off_um =
                off.min_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or_else(|| panic!("{place} was not driven"));
            assert!(off_um.abs() < 0.2, "{place}: {off_um} µm");
        }
    });
}

/// Length by place, of a campaign.
fn lengths(campaign: &str) -> Vec<(String, f64)> {
    let mut lines = campaign.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let place = |name: &str| names.iter().position(|known| *known == name).unwrap();
    let (length, axes) = (place("length_mm"), ["x_mm", "y_mm", "z_mm"].map(place));
    let of = |row: &str| {
        let cells: Vec<&str> = row.split(',').collect();
        let at = axes.map(|axis| format!("{:.1}", cells[axis].parse::<f64>().unwrap().abs()));
        (at.join(" "), cells[length].parse().unwrap())
    };
    lines.map(of).collect()
}
