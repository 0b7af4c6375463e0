//! Evidence for a server of OPC UA as a source, with a server that is not ours: units, stamps, ages, what is missing, restarts.

use crate::common::bench;
use crate::peer::{Peer, now_ms};
use abbe_graph::driver::{DriverConfig, DriverError, ScaleDriver, open_scale, open_sensor, open_tracer};
use abbe_graph::link::{Link, LinkState};
use abbe_msgs::ScaleReading;
use abbe_runtime::Shutdown;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

const AXES: &str =
    "axes = { x = \"ns=2;s=X\", y_mm = \"ns=2;s=Y\", z_um = \"ns=2;s=Z\" }\noffset_mm = [0.0, 0.0, -60.0]";
/// X in millimetres, T in kelvin.
const UNITS: &str = "{\"units\": {\"X\": 5066068, \"T\": 4932940}}";

fn config(server: &str, keys: &str) -> DriverConfig {
    DriverConfig::Opcua(toml::from_str(&format!("server = \"{server}\"\n{keys}\n")).unwrap())
}

/// A wait that ends after two minutes, so that a test fails and does not hang.
fn patience() -> Shutdown {
    let shutdown = Shutdown::manual();
    let ends = shutdown.clone();
    thread::spawn(move || {
        thread::sleep(Duration::from_secs(120));
        ends.request();
    });
    shutdown
}

fn open(server: &str, keys: &str) -> Box<dyn ScaleDriver> {
    let config = config(server, &format!("{AXES}\nevery_s = 0.05\n{keys}"));
    open_scale(&config, Path::new(""), &bench().machine, &patience(), None).unwrap()
}

/// The next reading, and what was refused before it.
fn next(driver: &mut dyn ScaleDriver) -> (ScaleReading, Vec<String>) {
    let mut refused = Vec::new();
    loop {
        match driver.next_reading() {
            Ok(Some(reading)) => return (reading, refused),
            Ok(None) => panic!("it was not told to stop; refused: {refused:?}"),
            Err(error @ DriverError::Value { .. }) => {
                assert!(error.is_of_one_reading());
                refused.push(error.to_string());
            }
            Err(error) => panic!("{error}"),
        }
    }
}

fn wait_until(link: &Link, what: &str, is_so: impl Fn(&LinkState) -> bool) -> LinkState {
    let since = Instant::now();
    loop {
        let state = link.status().state;
        if is_so(&state) {
            return state;
        }
        assert!(since.elapsed() < Duration::from_secs(90), "not {what}: {state:?}");
        thread::sleep(Duration::from_millis(20));
    }
}

/// Tells the server an instant every 20 ms until dropped, from a thread.
struct Driving {
    peer: Arc<Mutex<Option<Peer>>>,
    is_over: Arc<AtomicBool>,
    thread: Option<thread::JoinHandle<()>>,
}

impl Driving {
    fn start(peer: Peer) -> Driving {
        let (peer, is_over) = (Arc::new(Mutex::new(Some(peer))), Arc::new(AtomicBool::new(false)));
        let (of_thread, ends) = (Arc::clone(&peer), Arc::clone(&is_over));
        let drive = move || {
            let mut last = 0;
            while !ends.load(Ordering::Relaxed) {
                if let Some(peer) = of_thread.lock().unwrap().as_mut() {
                    last = now_ms().max(last + 1);
                    peer.axes(last, [100.0, 200.0, 300_000.0]);
                    peer.tell(&format!("[[\"T\",293.15,{last},0]]"));
                }
                thread::sleep(Duration::from_millis(20));
            }
        };
        Driving { peer, is_over, thread: Some(thread::spawn(drive)) }
    }

    fn replace(&self, peer: Option<Peer>) {
        *self.peer.lock().unwrap() = peer;
    }
}

impl Drop for Driving {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        drop(self.thread.take().unwrap().join());
    }
}

#[test]
fn val_asyncua_axes_are_readings_in_metres_with_the_servers_time_and_ages() {
    let Some(peer) = Peer::start(Peer::free_port(), UNITS) else { return };
    let address = peer.address.clone();
    let _driving = Driving::start(peer);
    for keys in ["", "reads = \"polled\"", "joined = \"held\"", "reads = \"polled\"\njoined = \"held\""] {
        let mut driver = open(&address, &format!("covariates = {{ temp_air = \"ns=2;s=T\" }}\n{keys}"));
        let (mut last, begin) = (0, now_ms());
        for sequence in 0..10 {
            let (reading, _) = next(driver.as_mut());
            let near = reading.reading_m.iter().zip([0.1, 0.2, 0.3]).all(|(m, expected)| (m - expected).abs() < 1e-12);
            assert!(near, "{keys}: {:?}", reading.reading_m);
            assert_eq!((reading.sequence, reading.offset_m), (sequence, [0.0, 0.0, -0.06]));
            let at_ms = reading.stamp.to_nanos() / 1_000_000;
            assert!(at_ms > last && at_ms >= begin - 1000 && at_ms <= now_ms(), "{keys}: {at_ms} after {last}");
            last = at_ms;
            if let Some(air) = reading.covariates.get("temp_air_c") {
                assert!((air.value - 20.0).abs() < 1e-9 && (0.0..5.0).contains(&air.age_s), "{air:?}");
            } else {
                assert!(sequence < 3, "{keys}: the sensor's value is missing");
            }
        }
    }
}

#[test]
fn a_wrong_unit_or_a_missing_node_gives_no_reading_and_says_why() {
    let Some(peer) =
        Peer::start(Peer::free_port(), "{\"units\": {\"X\": 13384, \"Y\": \"urn:maker\"}, \"missing\": [\"T\"]}")
    else {
        return;
    };
    for (axes, words) in [
        ("x_mm = \"ns=2;s=X\", y_mm = \"ns=2;s=Z\", z_mm = \"ns=2;s=Z\"", "axis x_mm: the server says um"),
        ("x = \"ns=2;s=X\", y_mm = \"ns=2;s=Y\", z_mm = \"ns=2;s=Z\"", "no length that is known"),
        ("x = \"ns=2;s=X\", y = \"ns=2;s=Z\", z_mm = \"ns=2;s=Z\"", "names no unit"),
        ("x = \"ns=2;s=X\", y_mm = \"ns=2;s=T\", z_mm = \"ns=2;s=Z\"", "BadNodeIdUnknown"),
        ("x = \"nsu=urn:other;s=X\", y_mm = \"ns=2;s=Z\", z_mm = \"ns=2;s=Z\"", "no namespace"),
    ] {
        let shutdown = Shutdown::manual();
        let keys = format!("axes = {{ {axes} }}\noffset_mm = [0.0, 0.0, 0.0]");
        let mut driver =
            open_scale(&config(&peer.address, &keys), Path::new(""), &bench().machine, &shutdown, None).unwrap();
        let link = driver.link().unwrap();
        let reading = thread::spawn(move || driver.next_reading());
        let state = wait_until(&link, words, |state| matches!(state, LinkState::Lost(_)));
        assert!(matches!(&state, LinkState::Lost(why) if why.contains(words)), "{words}: {state:?}");
        shutdown.request();
        assert!(matches!(reading.join().unwrap(), Ok(None)), "no reading: {words}");
    }
}

#[test]
fn a_server_that_dies_is_told_of_and_readings_go_on_without_a_repetition() {
    let port = Peer::free_port();
    let Some(peer) = Peer::start(port, UNITS) else { return };
    let address = peer.address.clone();
    let driving = Driving::start(peer);
    let mut driver = open(&address, "");
    let link = driver.link().unwrap();
    let readings = Arc::new(Mutex::new(Vec::new()));
    let kept = Arc::clone(&readings);
    let shutdown = Arc::new(AtomicBool::new(false));
    let ends = Arc::clone(&shutdown);
    let reading = thread::spawn(move || {
        while !ends.load(Ordering::Relaxed) {
            let (reading, _) = next(driver.as_mut());
            kept.lock().unwrap().push(reading);
        }
    });
    let wait_for_more = || {
        let (had, since) = (readings.lock().unwrap().len(), Instant::now());
        while readings.lock().unwrap().len() < had + 5 {
            assert!(since.elapsed() < Duration::from_secs(90), "no more readings: {:?}", link.status());
            thread::sleep(Duration::from_millis(20));
        }
    };
    for _ in 0..2 {
        wait_for_more();
        driving.replace(None);
        wait_until(&link, "lost", |state| matches!(state, LinkState::Lost(_)));
        driving.replace(Peer::start(port, UNITS));
        wait_until(&link, "connected", |state| matches!(state, LinkState::Connected(_)));
    }
    wait_for_more();
    // It lives, and says nothing new.
    let peer = driving.peer.lock().unwrap().take();
    wait_until(&link, "silent", |state| matches!(state, LinkState::Silent(_)));
    driving.replace(peer);
    wait_for_more();
    shutdown.store(true, Ordering::Relaxed);
    reading.join().unwrap();
    let readings = readings.lock().unwrap();
    assert!(readings.windows(2).all(|pair| pair[0].stamp < pair[1].stamp && pair[1].sequence == pair[0].sequence + 1));
    assert_eq!(link.status().refused, 0, "{:?}", link.status());
    assert!(link.status().losses >= 2);
}

#[test]
fn a_sensor_says_what_is_good_with_its_instant_and_is_missing_otherwise() {
    let Some(mut peer) = Peer::start(Peer::free_port(), UNITS) else { return };
    let keys = "covariates = { temp_air_k = \"ns=2;s=T\", other_c = \"ns=2;s=Q\" }\nevery_s = 0.05";
    let mut driver =
        open_sensor(&config(&peer.address, keys), Path::new(""), &bench().machine, &patience(), None).unwrap();
    let link = driver.link().unwrap();
    // The first value is how the server stands.
    assert_eq!(driver.next_values().unwrap().unwrap().values, [("temp_air_c".to_owned(), -273.15)]);
    let at = now_ms();
    peer.tell(&format!("[[\"T\",300.15,{},2156658688]]", at + 1));
    peer.tell(&format!("[[\"T\",294.15,{},0]]", at + 2));
    let said = driver.next_values().unwrap().unwrap();
    assert_eq!(
        (said.values, said.missing),
        (vec![], vec!["temp_air_c".to_owned()]),
        "what was said before holds no longer"
    );
    let said = driver.next_values().unwrap().unwrap();
    assert_eq!(said.stamp.to_nanos(), (at + 2) * 1_000_000);
    assert!((said.values[0].1 - 21.0).abs() < 1e-9 && said.values.len() == 1, "{said:?}");
    assert!(
        link.status().refused >= 1 && link.status().last_refusal.contains("BadSensorFailure"),
        "{:?}",
        link.status()
    );
    // Of a lost session nothing is kept.
    drop(peer);
    assert_eq!(driver.next_values().unwrap().unwrap().missing, ["temp_air_c"]);
}

#[test]
fn what_cannot_be_opened_is_refused_by_its_key() {
    let machine = &bench().machine;
    let all = config("opc.tcp://127.0.0.1:9", AXES);
    let told = open_tracer(&all, Path::new(""), machine, &Shutdown::manual(), None).map(drop).unwrap_err();
    assert!(told.to_string().contains("driver.kind: opcua gives scale readings"), "{told}");
    let keys = format!("{AXES}\nuser = \"u\"\npassword_file = \"no such file\"\npassword_without_security = true");
    let told =
        open_scale(&config("opc.tcp://127.0.0.1:9", &keys), Path::new("/nowhere"), machine, &Shutdown::manual(), None);
    let told = told.map(drop).unwrap_err().to_string();
    assert!(told.contains("driver.password_file: /nowhere/no such file"), "{told}");
}

#[test]
fn a_wait_for_a_server_ends_when_told_to_stop() {
    let shutdown = Shutdown::manual();
    let mut driver =
        open_scale(&config("opc.tcp://127.0.0.1:9", AXES), Path::new(""), &bench().machine, &shutdown, None).unwrap();
    let since = Instant::now();
    shutdown.request();
    assert!(driver.next_reading().unwrap().is_none());
    drop(driver);
    assert!(since.elapsed() < Duration::from_secs(20));
}
