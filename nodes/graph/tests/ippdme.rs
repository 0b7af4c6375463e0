//! Evidence for a server of I++ DME as a source: positions, tools, coordinate systems, errors of each class, connections that end.

use crate::cmm::Cmm;
use crate::common::bench;
use crate::errors;
use crate::tcp::Tcp;
use abbe_graph::driver::{DriverConfig, DriverError, IppdmeConfig, ScaleDriver, open_scale, open_tracer};
use abbe_graph::link::LinkState;
use abbe_msgs::ScaleReading;
use abbe_runtime::Shutdown;
use std::collections::BTreeMap;
use std::io::Write;
use std::net::TcpListener;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

const TOOLS: &str = "tools_mm = { Probe1 = [0.0, 0.0, -120.0], Star = [35.0, -12.0, -150.0] }";

fn config(address: &str, keys: &str) -> DriverConfig {
    DriverConfig::Ippdme(toml::from_str(&format!("server = \"{address}\"\n{keys}\n")).unwrap())
}

/// A wait that ends after a minute, so that a test fails and does not hang.
fn patience() -> Shutdown {
    let shutdown = Shutdown::manual();
    let ends = shutdown.clone();
    thread::spawn(move || {
        thread::sleep(Duration::from_secs(60));
        ends.request();
    });
    shutdown
}

fn open(address: &str, keys: &str) -> Box<dyn ScaleDriver> {
    open_scale(&config(address, &format!("{TOOLS}\n{keys}")), Path::new(""), &bench().machine, &patience(), None)
        .unwrap()
}

/// The next reading, and what was refused before it.
fn next(driver: &mut dyn ScaleDriver) -> (ScaleReading, Vec<String>) {
    let mut refused = Vec::new();
    loop {
        match driver.next_reading() {
            Ok(Some(reading)) => return (reading, refused),
            Ok(None) => panic!("it was not told to stop; refused: {refused:?}"),
            Err(error @ DriverError::Line { .. }) => {
                assert!(error.is_of_one_reading());
                refused.push(error.to_string());
            }
            Err(error) => panic!("{error}"),
        }
    }
}

/// Readings until one is this far along X (mm).
fn until(driver: &mut dyn ScaleDriver, x_mm: f64) -> ScaleReading {
    loop {
        let reading = next(driver).0;
        if (reading.reading_m[0] * 1e3 - x_mm).abs() < 1e-3 {
            return reading;
        }
    }
}

fn assert_near(told_m: [f64; 3], expected_mm: [f64; 3]) {
    let near = told_m.iter().zip(expected_mm).all(|(m, mm)| (m * 1e3 - mm).abs() < 1e-5);
    assert!(near, "{told_m:?} m and {expected_mm:?} mm");
}

#[test]
fn polled_positions_are_scales_tool_temperature_and_instant_of_arrival() {
    let server = Tcp::start(Cmm { csy: "PartCsy".to_owned(), ..Cmm::default() });
    server.cmm().placed.insert("PartCsy".to_owned(), [1.0, 2.0, 3.0, 40.0, 50.0, 60.0]);
    let before = SystemTime::now();
    let mut driver = open(
        &server.address,
        "reads = \"polled\"\nevery_s = 0.02\ncovariates = { temp_part_f = \"Part.Temperature\", temp_x_f = \"No.Such\" }",
    );
    let (first, refused) = next(driver.as_mut());
    assert!(refused.is_empty(), "{refused:?}");
    assert_near(first.reading_m, [200.0, 150.0, 100.0]);
    assert_eq!((first.offset_m, first.sequence), ([0.0, 0.0, -0.12], 0));
    assert_eq!(first.frame_id.as_str(), bench().machine.machine.frame_id);
    let stamp = UNIX_EPOCH + Duration::from_nanos(u64::try_from(first.stamp.to_nanos()).unwrap());
    assert!(stamp >= before && stamp <= SystemTime::now());
    let covariate = first.covariates.get("temp_part_c").unwrap();
    assert!((covariate.value - (21.25 - 32.0) * 5.0 / 9.0).abs() < 1e-12, "in the unit of the name");
    assert!(covariate.age_s >= 0.0 && covariate.age_s < 60.0);
    assert_eq!(first.covariates.iter().count(), 1, "what the server does not tell is missing");
    server.cmm().scales_mm = [10.0, 20.0, 30.0];
    assert_near(until(driver.as_mut(), 10.0).reading_m, [10.0, 20.0, 30.0]);
    drop(driver);
    server.wait_for(2, "EndSession()");
    assert_eq!(server.cmm().csy, "PartCsy", "the server is left as it was found");
}

#[test]
fn moves_and_points_of_the_operator_are_readings() {
    let server = Tcp::start(Cmm::default());
    let mut driver = open(&server.address, "reads = \"moves\"\nevery_s = 0.1");
    server.wait_for(1, "E0001 OnMoveReportE(Time(0.1), Dis(1), X(), Y(), Z())");
    for k in 0..3 {
        server.cmm().scales_mm[0] = f64::from(k);
        let lines = server.cmm().moved().join("\r\n") + "\r\n";
        server.say(lines.as_bytes());
        let reading = next(driver.as_mut()).0;
        assert_eq!((reading.sequence, (reading.reading_m[0] * 1e3).round()), (k as u64, f64::from(k)));
    }
    drop(driver);
    let server = Tcp::start(Cmm::default());
    let mut driver = open(&server.address, "reads = \"points\"");
    server.wait_for(1, "IsUserEnabled()");
    let picked = server.cmm().picked() + "\r\n";
    // Positions that were not asked for are none.
    server.say(
        format!("E0001 # X(1), Y(1), Z(1)\r\n00077 # X(1), Y(1), Z(1)\r\nE0000 # KeyPress(\"F1\")\r\n{picked}")
            .as_bytes(),
    );
    let (reading, refused) = next(driver.as_mut());
    assert!(refused.is_empty(), "{refused:?}");
    assert_near(reading.reading_m, [200.0, 150.0, 100.0]);
}

#[test]
fn the_tool_is_the_one_in_the_machine_and_an_unknown_one_gives_no_readings() {
    let server = Tcp::start(Cmm::default());
    let mut driver = open(&server.address, "reads = \"polled\"\nevery_s = 0.02");
    next(driver.as_mut());
    server.cmm().tool = "Star".to_owned();
    server.say(b"E0000 # ChangeTool(\"Star\")\r\n");
    let mut reading = next(driver.as_mut()).0;
    while reading.offset_m[0] == 0.0 {
        reading = next(driver.as_mut()).0;
    }
    assert_eq!(reading.offset_m, [0.035, -0.012, -0.15]);
    assert_near(reading.reading_m, [200.0, 150.0, 100.0]);
    server.cmm().tool = "RefTool".to_owned();
    server.say(b"E0000 # ChangeTool(\"RefTool\")\r\n");
    let told = loop {
        match driver.next_reading() {
            Ok(_) => {}
            Err(error) => {
                let told = error.to_string();
                if told.contains("RefTool") {
                    break told;
                }
            }
        }
    };
    assert!(told.contains("the offset of tool RefTool is not known; give it in tools_mm"), "{told}");
    // A server that tells offsets is asked.
    let server = Tcp::start(Cmm { tells_offsets: true, ..Cmm::default() });
    let keys = "reads = \"polled\"\nserver_offsets = true";
    let config = config(&server.address, keys);
    let mut driver = open_scale(&config, Path::new(""), &bench().machine, &patience(), None).unwrap();
    assert_eq!(next(driver.as_mut()).0.offset_m, [0.0, 0.0, -0.12]);
}

/// Readings until one satisfies this; each must be where the ram stands.
fn of_the_ram(driver: &mut dyn ScaleDriver, is_last: impl Fn(&ScaleReading) -> bool) -> ScaleReading {
    loop {
        let reading = next(driver).0;
        assert_near(reading.reading_m, [200.0, 150.0, 100.0]);
        if is_last(&reading) {
            return reading;
        }
    }
}

#[test]
fn regress_an_empty_holder_gives_no_reading_unless_it_is_named() {
    let mut cmm = Cmm::default();
    cmm.tools_mm.insert("NoTool".to_owned(), [0.0; 3]);
    let server = Tcp::start(cmm);
    let keys = "reads = \"polled\"\nevery_s = 0.02\noffset_mm = [0.0, 0.0, -120.0]";
    let mut driver =
        open_scale(&config(&server.address, keys), Path::new(""), &bench().machine, &patience(), None).unwrap();
    of_the_ram(driver.as_mut(), |_| true);
    server.cmm().tool = "NoTool".to_owned();
    server.say(b"E0000 # ChangeTool(\"NoTool\")\r\n");
    // A poll that was under way may still be of the tool before.
    let told = loop {
        match driver.next_reading() {
            Ok(reading) => assert_near(reading.unwrap().reading_m, [200.0, 150.0, 100.0]),
            Err(error) if error.to_string().contains("no tool is in the machine") => break error.to_string(),
            Err(_) => {}
        }
    };
    assert!(told.contains("no tip has a position"), "{told}");
    server.cmm().tool = "Probe1".to_owned();
    server.say(b"E0000 # ChangeTool(\"Probe1\")\r\n");
    of_the_ram(driver.as_mut(), |_| true);
    // Who names it says where its end is.
    server.cmm().tool = "NoTool".to_owned();
    let keys = "reads = \"polled\"\nevery_s = 0.02\ntools_mm = { NoTool = [0.0, 0.0, 0.0] }";
    drop(driver);
    let mut driver =
        open_scale(&config(&server.address, keys), Path::new(""), &bench().machine, &patience(), None).unwrap();
    of_the_ram(driver.as_mut(), |_| true);
}

#[test]
fn regress_a_tool_that_is_changed_while_a_question_waits_has_its_own_offset() {
    let server = Tcp::start(Cmm::default());
    let mut driver = open(&server.address, "reads = \"polled\"\nevery_s = 0.02");
    for (during, tool, x_m) in [("Get(", "Star", 0.035), ("Get(", "Probe1", 0.0), ("GetProp(Tool.Name", "Star", 0.035)]
    {
        server.cmm().changes_during = Some((during, tool));
        if during != "Get(" {
            server.say(b"E0000 # SetProp(Part.Temperature(20))\r\n");
        }
        of_the_ram(driver.as_mut(), |reading| reading.offset_m[0] == x_m);
    }
    // The same of reports: those before the change, after it, and the answer that names the tool arrive together.
    let server = Tcp::start(Cmm::default());
    let mut driver = open(&server.address, "reads = \"moves\"\ncovariates_every_s = 0.1");
    server.wait_for(1, "OnMoveReportE");
    server.cmm().changes_during = Some(("GetProp(Tool.Name", "Star"));
    let asked = server.count("GetProp(Tool.Name");
    let (before, refused) = next(driver.as_mut());
    assert!(refused.is_empty(), "{refused:?}");
    assert_eq!(before.offset_m, [0.0, 0.0, -0.12]);
    assert_near(before.reading_m, [200.0, 150.0, 100.0]);
    // The question that was asked when it was changed, one for the new tool, and one that comes after both.
    server.wait_for(asked + 3, "GetProp(Tool.Name");
    let lines = server.cmm().moved().join("\r\n") + "\r\n";
    server.say(lines.as_bytes());
    let (after, refused) = next(driver.as_mut());
    assert_eq!(after.offset_m, [0.035, -0.012, -0.15]);
    assert_near(after.reading_m, [200.0, 150.0, 100.0]);
    assert!(refused.len() == 1 && refused[0].contains("not known yet"), "{refused:?}");
}

#[test]
fn regress_a_head_that_is_turned_at_the_panel_has_no_offset_of_the_launch_file() {
    let server = Tcp::start(Cmm::default());
    let mut driver = open(&server.address, "reads = \"polled\"\nevery_s = 0.02");
    next(driver.as_mut());
    server.say(b"E0000 # SetProp(Tool.A(90), Tool.B(0))\r\n");
    let told = loop {
        let told = driver
            .next_reading()
            .map_or_else(|error| error.to_string(), |reading| reading.map(|_| String::new()).unwrap());
        if told.contains("turned") {
            break told;
        }
    };
    assert!(told.contains("tool Probe1 was turned, and its offset is known for one direction only"), "{told}");
    // A connection that is made again turns no head back; another tool is another one.
    server.cut();
    server.wait_for(2, "StartSession()");
    assert!(driver.next_reading().unwrap_err().to_string().contains("turned"));
    server.cmm().tool = "Star".to_owned();
    server.say(b"E0000 # ChangeTool(\"Star\")\r\n");
    assert_eq!(next(driver.as_mut()).0.offset_m[0], 0.035);
}

#[test]
fn garbage_is_told_with_its_line_and_a_connection_that_ends_or_falls_silent_is_made_again() {
    let server = Tcp::start(Cmm::default());
    let mut driver = open(&server.address, "reads = \"moves\"\nsilent_after_s = 1.0");
    server.wait_for(1, "OnMoveReportE");
    server.say(b"\xff\xfe garbage\r\nE0001 # X(1), Y(2)\r\nE0001 # X(1), Y(2), Z(3\r\nE0001 # 1, 2, 3\r\nE0001 # X(77), Y(2), Z(3)\r\n");
    let (reading, refused) = next(driver.as_mut());
    assert_eq!((reading.sequence, reading.reading_m[0]), (0, 0.077));
    for words in ["no line of the protocol", "it does not give Z once", "column", "X once"] {
        assert!(refused.iter().any(|told| told.contains(words) && told.contains("ippdme 127.0.0.1")), "{refused:?}");
    }
    assert_eq!(refused.len(), 4, "{refused:?}");
    // A flood of what is no position, and the end in the middle of a line.
    server.say("E0000 # KeyPress(\"F1\")\r\n".repeat(20_000).as_bytes());
    server.say(b"E0001 # X(78), Y(2), Z(3");
    server.cut();
    server.wait_for(2, "OnMoveReportE");
    server.say(b"E0001 # X(79), Y(2), Z(3)\r\n");
    let (reading, _) = next(driver.as_mut());
    assert_eq!((reading.sequence, reading.reading_m[0]), (1, 0.079), "half a line is none, and numbers go on");
    drop(driver);
    // One that takes connections and answers nothing.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let _driver = open(&address, "reads = \"polled\"\nsilent_after_s = 0.1");
    let _kept: Vec<_> = (0..3).map(|_| listener.accept().unwrap()).collect();
}

#[test]
fn another_coordinate_system_than_the_machines_gives_no_reading() {
    let placed = BTreeMap::from([("PartCsy".to_owned(), [100.0, 0.0, 0.0, 0.0, 0.0, 0.0])]);
    let server = Tcp::start(Cmm { csy: "PartCsy".to_owned(), keeps_csy: true, placed, ..Cmm::default() });
    let mut driver = open(&server.address, "reads = \"polled\"\nevery_s = 0.02\ncovariates_every_s = 0.2");
    let link = driver.link().unwrap();
    let waiting = thread::spawn(move || (next(driver.as_mut()).0, driver));
    server.wait_for(3, "StartSession()");
    assert!(!waiting.is_finished(), "a position of the part is no reading");
    assert!(
        matches!(link.status().state, LinkState::Lost(words) if words.contains("its coordinate system is PartCsy")),
        "{:?}",
        link.status()
    );
    server.cmm().keeps_csy = false;
    let (reading, mut driver) = waiting.join().unwrap();
    assert_near(reading.reading_m, [200.0, 150.0, 100.0]);
    // One that does not tell may be in any.
    server.cmm().tells_no_csy = true;
    let link = driver.link().unwrap();
    let waiting = thread::spawn(move || {
        loop {
            let reading = next(driver.as_mut()).0;
            if reading.reading_m[0] > 0.5 {
                return driver;
            }
        }
    });
    let since = Instant::now();
    while !matches!(link.status().state, LinkState::Lost(words) if words.contains("does not tell its coordinate system"))
    {
        assert!(since.elapsed() < Duration::from_secs(60), "{:?}", link.status());
        thread::sleep(Duration::from_millis(5));
    }
    server.cmm().tells_no_csy = false;
    server.cmm().scales_mm[0] = 600.0;
    let mut driver = waiting.join().unwrap();
    // And one that is selected at a panel meanwhile is noticed with the next question for the tool.
    server.cmm().heard.clear();
    server.cmm().csy = "PartCsy".to_owned();
    while server.count("StartSession()") == 0 {
        next(driver.as_mut());
    }
    server.wait_for(1, "SetCoordSystem(MachineCsy)");
}

#[test]
fn answers_without_a_position_and_without_an_end_are_told() {
    let server = Tcp::start(Cmm { tells_nothing: true, ..Cmm::default() });
    let mut driver = open(&server.address, "reads = \"polled\"\nevery_s = 0.02");
    let told = driver.next_reading().unwrap_err().to_string();
    assert!(told.contains("answered Get without a position"), "{told}");
    assert!(driver.link().unwrap().status().refused >= 1);
    // One that answers without end is left, and does not fill the memory.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let mut driver = open(&address, "reads = \"polled\"\nsilent_after_s = 60.0");
    let link = driver.link().unwrap();
    let waiting = thread::spawn(move || driver.next_reading().map(|reading| reading.is_some()));
    let mut stream = listener.accept().unwrap().0;
    let flood = "00001 # X(1), Y(2), Z(3)\r\n".repeat(1000);
    let since = Instant::now();
    while stream.write_all(flood.as_bytes()).is_ok() {
        assert!(since.elapsed() < Duration::from_secs(30), "it listens for ever");
    }
    while !matches!(link.status().state, LinkState::Lost(words) if words.contains("does not end")) {
        assert!(since.elapsed() < Duration::from_secs(30), "{:?}", link.status());
        thread::sleep(Duration::from_millis(10));
    }
    assert!(!waiting.is_finished());
}

#[test]
fn each_class_of_error_is_answered_as_the_specification_asks() {
    let server = Tcp::start(Cmm::default());
    let mut driver = open(&server.address, "reads = \"polled\"\nevery_s = 0.02\nsilent_after_s = 2.0");
    next(driver.as_mut());
    let sessions = |server: &Tcp| server.count("StartSession()");
    // Info and warning: it goes on.
    server.say(b"E0000 ! Error(0, 0000, \"x\", \"Buffer full\")\r\nE0000 ! Error(1, 0504, \"x\", \"Argument out of range\")\r\n");
    server.cmm().scales_mm[0] = 1.0;
    until(driver.as_mut(), 1.0);
    assert_eq!((sessions(&server), server.count("ClearAllErrors")), (1, 0));
    // An error that the client mends.
    server.cmm().has_error = true;
    server.say(b"E0000 ! Error(2, 1001, \"x\", \"Illegal touch\")\r\n");
    server.cmm().scales_mm[0] = 2.0;
    until(driver.as_mut(), 2.0);
    assert!(server.count("ClearAllErrors") >= 1 && sessions(&server) >= 2);
    // One that somebody at the machine mends: it is not cleared from here.
    server.cmm().heard.clear();
    server.say(b"E0000 ! Error(3, 0500, \"x\", \"Emergency stop\")\r\n");
    server.wait_for(1, "GetErrStatusE()");
    assert_eq!(server.count("ClearAllErrors"), 0);
    server.cmm().scales_mm[0] = 3.0;
    until(driver.as_mut(), 3.0);
    assert_eq!(server.count("ClearAllErrors"), 0, "{:?}", server.cmm().heard);
    // A fatal one: a new connection.
    server.cmm().heard.clear();
    server.say(b"E0000 ! Error(9, 0503, \"x\", \"Controller communications failure\")\r\n");
    server.wait_for(1, "StartSession()");
    server.cmm().scales_mm[0] = 4.0;
    until(driver.as_mut(), 4.0);
    // A command that the server refuses is cleared by who sent it, and tried again.
    server.cmm().unknown.insert("Get".to_owned());
    server.cmm().heard.clear();
    server.wait_for(1, "ClearAllErrors()");
    server.cmm().unknown.clear();
    server.cmm().scales_mm[0] = 5.0;
    until(driver.as_mut(), 5.0);
}

#[test]
fn each_error_that_the_specification_names_is_answered_by_its_class_and_readings_go_on() {
    let server = Tcp::start(Cmm::default());
    let mut driver = open(&server.address, "reads = \"polled\"\nevery_s = 0.02\nsilent_after_s = 5.0");
    next(driver.as_mut());
    // And classes that it does not name, with numbers of a maker's own: nobody knows what they mean, so somebody has to look.
    let unnamed = [(4, 8000), (5, 8001), (6, 8002), (7, 8003), (8, 8999)];
    let mut x_mm = 1000.0;
    for (class, number) in errors::ERRORS.into_iter().chain(unnamed) {
        let what = format!("class {class}, number {number}");
        server.cmm().heard.clear();
        server.cmm().has_error = class == 2;
        server.say(format!("{}\r\n", errors::told(class, number)).as_bytes());
        let is_asked = match class {
            0 | 1 => None,
            2 => Some("ClearAllErrors()"),
            9 => Some("StartSession()"),
            _ => Some("GetErrStatusE()"),
        };
        if let Some(command) = is_asked {
            server.wait_for(1, command);
        }
        x_mm += 1.0;
        server.cmm().scales_mm[0] = x_mm;
        until(driver.as_mut(), x_mm);
        let begins_anew = server.count("StartSession()") > 0;
        assert_eq!(begins_anew, class >= 2, "{what}: {:?}", server.cmm().heard);
        // What is not the client's to clear stays for whoever has to see it.
        assert_eq!(server.count("ClearAllErrors()") > 0, class == 2, "{what}: {:?}", server.cmm().heard);
    }
}

#[test]
fn a_wait_for_a_server_ends_when_told_to_stop() {
    let shutdown = Shutdown::manual();
    let config = config("127.0.0.1:9", &format!("{TOOLS}\nreads = \"polled\""));
    let mut driver = open_scale(&config, Path::new(""), &bench().machine, &shutdown, None).unwrap();
    let since = Instant::now();
    shutdown.request();
    assert!(driver.next_reading().unwrap().is_none());
    drop(driver);
    assert!(since.elapsed() < Duration::from_secs(20));
}

#[test]
fn keys_that_give_no_reading_are_refused_with_what_to_do() {
    let said = |keys: &str| {
        let config = config("127.0.0.1:9", keys);
        open_scale(&config, Path::new(""), &bench().machine, &Shutdown::manual(), None)
            .map(|_| ())
            .unwrap_err()
            .to_string()
    };
    for (keys, words) in [
        ("reads = \"polled\"".to_owned(), "driver.tools_mm: name the offset of each tool"),
        (format!("reads = \"moves\"\nevery_s = 0.05\n{TOOLS}"), "driver.every_s: must be 0.1 or more"),
        (format!("reads = \"polled\"\nevery_s = 0.0\n{TOOLS}"), "driver.every_s: must be a number of seconds above 0"),
        (format!("reads = \"polled\"\nevery_mm = -1.0\n{TOOLS}"), "driver.every_mm"),
        (format!("reads = \"polled\"\nsilent_after_s = inf\n{TOOLS}"), "driver.silent_after_s"),
        ("reads = \"polled\"\noffset_mm = [0.0, 0.0, 1e9]".to_owned(), "driver.offset_mm"),
        (format!("reads = \"polled\"\n{TOOLS}\ncovariates = {{ a_c = \"b)\" }}"), "driver.covariates"),
        (format!("reads = \"polled\"\n{TOOLS}\ncovariates = {{ temp = \"Part.Temperature\" }}"), "driver.covariates"),
    ] {
        let told = said(&keys);
        assert!(told.contains(words), "{keys}: {told}");
    }
    let nowhere = config("nowhere", &format!("reads = \"polled\"\n{TOOLS}"));
    let told =
        open_scale(&nowhere, Path::new(""), &bench().machine, &Shutdown::manual(), None).map(|_| ()).unwrap_err();
    assert!(told.to_string().contains("driver.server: \"nowhere\" is no host:port"), "{told}");
    let tracer = config("127.0.0.1:9", &format!("reads = \"polled\"\n{TOOLS}"));
    let told =
        open_tracer(&tracer, Path::new(""), &bench().machine, &Shutdown::manual(), None).map(|_| ()).unwrap_err();
    assert!(told.to_string().contains("ippdme reads scales"), "{told}");
    let unknown = toml::from_str::<IppdmeConfig>("server = \"a:1\"\nreads = \"polled\"\nspeed = 3\n").unwrap_err();
    assert!(unknown.to_string().contains("unknown field `speed`"), "{unknown}");
}
