//! Boxes that write lines, seen by a user: readings from one, temperatures from another, the motion from neither.

use std::io::Write;
use std::net::{TcpListener, UdpSocket};
use std::thread;
use std::time::{Duration, Instant};

use crate::common::dds::{Listener, PATIENCE};
use crate::common::files::{Bench, machine, samples, text};
use crate::common::graph::{topic, user};
use crate::common::network::in_own_network;
use crate::common::program::{Started, abbe_in, signal};
use abbe_msgs::standard::DiagnosticStatus;
use abbe_msgs::{CorrectedCoordinates, ScaleReading};
use abbe_runtime::RunId;
use rustix::process::Signal;

fn launch_file(bench: &Bench, controller: &str, sensor: &str) -> String {
    let edge = |from: &str, to: &str, over: &str| {
        format!("[[edges]]\nfrom = \"{from}\"\nto = \"{to}\"\ntransport = \"{over}\"\n")
    };
    let content = format!(
        "namespace = \"test\"\nmachine = \"{}\"\nmodel = \"model.json\"\nrecord = \"recorded\"\n\
         nodes = [\"scale\", \"geometric\", \"residual\", \"recorder\"]\n\
         max_covariate_age_s = 10.0\nwait_for_subscribers_s = 20.0\nvisible_in_ros = false\n\
         [scale]\npace = \"as_they_come\"\n\
         driver = {{ kind = \"lines\", from = {{ tcp = \"{controller}\" }}, columns = [\"x_mm\", \"y_mm\", \"z_mm\"], \
         offset_mm = [0.0, 0.0, -60.0], silent_after_s = 1.0 }}\n\
         [[covariates]]\nkind = \"lines\"\nfrom = {{ udp = \"{sensor}\" }}\ncolumns = [\"temp_air_f\", \"pressure_pa\"]\n\
         [motion]\nreversal_um = 5.0\nwindow_s = 0.05\n\
         {}{}{}{}{}",
        text(&machine()),
        edge("scale", "geometric", "shared-memory"),
        edge("geometric", "residual", "shared-memory"),
        edge("residual", "user", "shared-memory"),
        edge("scale", "recorder", "shared-memory"),
        edge("scale", "*", "dds"),
    );
    bench.write("launch.toml", content)
}

#[test]
fn readings_sensors_and_motion_come_together_and_a_lost_controller_is_told() {
    let test = "connect::readings_sensors_and_motion_come_together_and_a_lost_controller_is_told";
    in_own_network(test, |domain| {
        const COUNT: u64 = 2000;
        let bench = Bench::identified(5);
        let controller = TcpListener::bind("127.0.0.1:0").unwrap();
        let sensor = UdpSocket::bind("127.0.0.1:0").unwrap();
        let free = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
        let file = launch_file(&bench, &controller.local_addr().unwrap().to_string(), &free);
        let run = RunId::unique();
        let mut heard = Heard { listener: Listener::on_diagnostics(domain), all: Vec::new() };
        let graph = Started::start(abbe_in(domain, ["launch", &file, "--run", run.as_str()]));
        let mut subscriber = user::<CorrectedCoordinates>(&run, "corrected");

        let mut stream = controller.accept().unwrap().0;
        // x goes forth at 100 mm/s with a reading each millisecond.
        for k in 0..COUNT {
            if k % 100 == 0 {
                sensor.send_to(b"68.0,101325\n", &free).unwrap();
            }
            writeln!(stream, "{:.4},200,150", 100.0 + 0.1 * k as f64).unwrap();
            heard.all.extend(heard.listener.news(""));
            let taken = subscriber.take_within(PATIENCE).unwrap().expect("the stream ended");
            assert_eq!((taken.sequence, taken.frame_id.as_str()), (k, "bridge_xyz"));
            thread::sleep(Duration::from_millis(1));
        }
        heard.until("scale: driver", DiagnosticStatus::OK, "connected with 127.0.0.1");
        heard.until("scale: covariates 0", DiagnosticStatus::OK, "connected");
        heard.until("scale: driver", DiagnosticStatus::STALE, "silent for more than 1 s");
        drop((stream, controller));
        heard.until("scale: driver", DiagnosticStatus::ERROR, "it is tried again");
        signal(graph.id(), Signal::INT);
        graph.finish().ok();

        let readings: Vec<ScaleReading> = samples(&bench.path("recorded"), &topic("scale/reading"));
        assert_eq!(readings.len() as u64, COUNT);
        let last = readings.last().unwrap().covariates;
        let value = |name: &str| last.get(name).unwrap_or_else(|| panic!("{name} is missing")).value;
        assert!((value("temp_air_c") - 20.0).abs() < 1e-9 && (value("pressure_hpa") - 1013.25).abs() < 1e-9);
        assert_eq!(value("dir_x"), 1.0);
        assert!(last.get("dir_y").is_none(), "an axis that never moved has no side");
        let ages: Vec<f64> =
            readings[200..].iter().filter_map(|r| Some(r.covariates.get("temp_air_c")?.age_s)).collect();
        assert_eq!(ages.len(), readings.len() - 200);
        assert!(ages.iter().all(|age_s| (-1e-3..10.0).contains(age_s)));
        assert!(ages.iter().any(|age_s| *age_s > 0.02), "the same value grows older until the next one comes");
    });
}

/// What was heard on `/diagnostics`, of all components.
struct Heard {
    listener: Listener,
    all: Vec<DiagnosticStatus>,
}

impl Heard {
    /// Waits until a component has said this.
    #[track_caller]
    fn until(&mut self, component: &str, level: u8, words: &str) {
        let deadline = Instant::now() + PATIENCE;
        loop {
            self.all.extend(self.listener.news(""));
            let said = |status: &DiagnosticStatus| {
                status.name.ends_with(component) && status.level == level && status.message.contains(words)
            };
            if self.all.iter().any(said) {
                return;
            }
            assert!(Instant::now() < deadline, "no {level} {words:?} of {component}: {:?}", self.all);
            thread::sleep(Duration::from_millis(20));
        }
    }
}
