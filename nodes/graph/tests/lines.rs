//! Evidence for lines of text as a source: units, stamps and what is missing; connections that end; lines that are no reading.

use crate::common::bench;
use abbe_files::MachineFile;
use abbe_graph::driver::{DriverConfig, DriverError, LinesConfig, ScaleDriver, open_scale, open_sensor, open_tracer};
use abbe_graph::link::LinkState;
use abbe_msgs::ScaleReading;
use abbe_runtime::Shutdown;
use std::io::Write;
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// What the launch file says; with an offset, which the machine of these tests has none of.
fn config(text: &str) -> LinesConfig {
    let config: LinesConfig = toml::from_str(text).unwrap();
    LinesConfig { offset_mm: config.offset_mm.or(Some([0.0, 0.0, -60.0])), ..config }
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

fn machine() -> &'static MachineFile {
    &bench().machine
}

fn scale(config: &LinesConfig) -> Box<dyn ScaleDriver> {
    open_scale(&DriverConfig::Lines(config.clone()), Path::new(""), machine(), &patience(), None).unwrap()
}

/// The next reading, and what was refused before it.
fn next(driver: &mut dyn ScaleDriver) -> (ScaleReading, Vec<String>) {
    let mut refused = Vec::new();
    loop {
        match driver.next_reading() {
            Ok(Some(reading)) => return (reading, refused),
            Ok(None) => panic!("it was not told to stop"),
            Err(error @ DriverError::Line { .. }) => {
                assert!(error.is_of_one_reading());
                refused.push(error.to_string());
            }
            Err(error) => panic!("{error}"),
        }
    }
}

fn server() -> (TcpListener, String) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    (listener, address)
}

#[test]
fn a_controllers_lines_become_readings_with_units_stamps_and_what_is_missing() {
    let (listener, address) = server();
    let text = format!(
        "from = {{ tcp = \"{address}\" }}\ncolumns = [\"stamp_s\", \"x_mm\", \"y_m\", \"z_um\", \"-\", \"temp_air_c\"]\n\
         offset_mm = [1.0, 2.0, -60.0]\n"
    );
    let writer = thread::spawn(move || {
        let mut stream = listener.accept().unwrap().0;
        stream.write_all(b"# controller\r\n\r\n1700000000.25,100.5,0.2,300,ok,20.5\r\n").unwrap();
        stream.write_all(b"1700000000.50,101,0.2,300,ok,\r\n1700000000.75,102,0.2,300,ok,ERR\r\n").unwrap();
        stream
    });
    let mut driver = scale(&config(&text));
    let (first, refused) = next(driver.as_mut());
    assert!(refused.is_empty(), "{refused:?}");
    assert_eq!(first.reading_m, [0.1005, 0.2, 300e-6]);
    assert_eq!(first.offset_m, [1e-3, 2e-3, -0.06]);
    assert_eq!((first.sequence, first.stamp.to_nanos()), (0, 1_700_000_000_250_000_000));
    assert_eq!(first.frame_id.as_str(), machine().machine.frame_id);
    assert_eq!(first.covariates.get("temp_air_c").unwrap().value, 20.5);
    let (second, _) = next(driver.as_mut());
    assert_eq!((second.sequence, second.reading_m[0]), (1, 0.101));
    assert!(second.covariates.is_empty(), "an empty cell is no value, and not the one before");
    let (third, refused) = next(driver.as_mut());
    assert_eq!((third.sequence, third.reading_m[0], refused.len()), (2, 0.102, 0), "the position is still one");
    assert!(third.covariates.is_empty(), "a sensor that fails has no value, and not the one before");
    let told = driver.link().unwrap().status();
    assert!(
        told.refused == 1 && told.last_refusal.contains("line 5: temp_air_c: \"ERR\" is no finite number"),
        "{told:?}"
    );
    drop(writer.join().unwrap());
}

#[test]
fn what_is_no_reading_is_told_with_its_line_and_the_next_one_is_read() {
    let (listener, address) = server();
    let text = format!("from = {{ tcp = \"{address}\" }}\ncolumns = [\"x_mm\", \"y_mm\", \"z_mm\"]\n");
    let writer = thread::spawn(move || {
        let mut stream = listener.accept().unwrap().0;
        let long = "7".repeat(10_000);
        let lines = format!("1,2\n1,2,x\n1,,3\n1,2,inf\n{long}\n\u{1}\u{7f},,\n");
        stream.write_all(lines.as_bytes()).unwrap();
        stream.write_all(b"\xff\xfe,1,2\n4,5,6\n").unwrap();
        stream
    });
    let before = SystemTime::now();
    let (reading, refused) = next(scale(&config(&text)).as_mut());
    assert_eq!((reading.reading_m, reading.sequence), ([4e-3, 5e-3, 6e-3], 0));
    let stamp = UNIX_EPOCH + Duration::from_nanos(u64::try_from(reading.stamp.to_nanos()).unwrap());
    assert!(stamp >= before && stamp <= SystemTime::now(), "without a stamp of its own, that of its arrival");
    for (told, words) in refused.iter().zip([
        "line 1 from tcp 127.0.0.1",
        "\"x\" is no finite number",
        "x, y or z is empty",
        "\"inf\" is no finite number",
        "longer than 4096 bytes",
        "no finite number",
        "line 7",
    ]) {
        assert!(told.contains(words), "{told}");
    }
    assert_eq!(refused.len(), 7, "{refused:?}");
    drop(writer.join().unwrap());
}

#[test]
fn half_a_line_at_the_end_of_a_connection_a_command_or_a_packet_is_no_reading() {
    let (listener, address) = server();
    let columns = "columns = [\"x_mm\", \"y_mm\", \"z_mm\"]\n";
    let writer = thread::spawn(move || {
        // Cut in the middle of 300.125.
        listener.accept().unwrap().0.write_all(b"100,200,300.125\n100,200,30").unwrap();
        let mut last = listener.accept().unwrap().0;
        last.write_all(b"100,200,300.25\n").unwrap();
        last
    });
    let mut driver = scale(&config(&format!("from = {{ tcp = \"{address}\" }}\n{columns}")));
    assert_eq!(next(driver.as_mut()).0.reading_m[2], 0.300125);
    let (reading, refused) = next(driver.as_mut());
    assert_eq!((reading.reading_m[2], reading.sequence), (0.30025, 1));
    assert!(refused.len() == 1 && refused[0].contains("it was cut off"), "{refused:?}");
    drop(writer.join().unwrap());

    let text = format!("from = {{ command = [\"printf\", \"7,0,0\\\\n8,0,1\"] }}\n{columns}");
    let mut command = scale(&config(&text));
    assert_eq!(next(command.as_mut()).0.reading_m[0], 7e-3);
    let (again, refused) = next(command.as_mut());
    assert_eq!((again.reading_m[0], refused.len()), (7e-3, 1), "{refused:?}");

    let free = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let mut packets = scale(&config(&format!("from = {{ udp = \"{free}\" }}\n{columns}")));
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    for packet in ["1,2,3.5\n", "1,2,4", ".5\n1,2,5.5\n"] {
        sender.send_to(packet.as_bytes(), &free).unwrap();
    }
    assert_eq!(next(packets.as_mut()).0.reading_m[2], 3.5e-3);
    let (reading, refused) = next(packets.as_mut());
    assert_eq!((reading.reading_m[2], refused.len()), (5.5e-3, 1), "{refused:?}");
}

#[test]
fn a_connection_that_ends_or_falls_silent_is_made_again_and_numbers_go_on() {
    let (listener, address) = server();
    let text =
        format!("from = {{ tcp = \"{address}\" }}\ncolumns = [\"x_mm\", \"y_mm\", \"z_mm\"]\nsilent_after_s = 0.3\n");
    let writer = thread::spawn(move || {
        for value in [b"1,0,0\n", b"2,0,0\n"] {
            // Closed at once.
            listener.accept().unwrap().0.write_all(value).unwrap();
        }
        let mut silent = listener.accept().unwrap().0;
        silent.write_all(b"3,0,0\n").unwrap();
        // Kept open without a word.
        let mut last = listener.accept().unwrap().0;
        last.write_all(b"4,0,0\n").unwrap();
        (silent, last)
    });
    let mut driver = scale(&config(&text));
    let taken: Vec<(u64, f64)> =
        (0..4).map(|_| next(driver.as_mut()).0).map(|r| (r.sequence, (r.reading_m[0] * 1e3).round())).collect();
    assert_eq!(taken, [(0, 1.0), (1, 2.0), (2, 3.0), (3, 4.0)]);
    drop(writer.join().unwrap());
}

#[test]
fn a_flood_is_read_to_its_last_line_and_garbage_in_it_is_counted() {
    const LINES: u32 = 50_000;
    let (listener, address) = server();
    let text = format!("from = {{ tcp = \"{address}\" }}\ncolumns = [\"x_um\", \"y_mm\", \"z_mm\"]\n");
    let writer = thread::spawn(move || {
        let mut stream = listener.accept().unwrap().0;
        let line = |number| if number % 10 == 9 { "\u{7}?,".to_owned() } else { format!("{number},2,3") };
        let lines: String = (0..LINES).map(|number| line(number) + "\n").collect();
        stream.write_all(lines.as_bytes()).unwrap();
        stream
    });
    let mut driver = scale(&config(&text));
    let mut garbage = 0;
    for (sequence, number) in (0..LINES).filter(|number| number % 10 != 9).enumerate() {
        let (reading, refused) = next(driver.as_mut());
        assert_eq!((reading.sequence, (reading.reading_m[0] * 1e6).round()), (sequence as u64, f64::from(number)));
        garbage += refused.len();
    }
    // The last line of all is one, and comes after the last reading.
    assert_eq!(garbage, (LINES / 10 - 1) as usize);
    drop(writer.join().unwrap());
}

#[test]
fn packets_clients_and_commands_are_read_alike() {
    let free = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let columns = "separator = \";\"\ndecimal = \",\"\n";
    let mut packets = scale(&config(&format!("from = {{ udp = \"{free}\" }}\n{columns}")));
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    // The first line names the columns.
    for packet in ["z_mm;y_mm;x_mm", "1,5;2;3"] {
        sender.send_to(packet.as_bytes(), &free).unwrap();
    }
    assert_eq!(next(packets.as_mut()).0.reading_m, [3e-3, 2e-3, 1.5e-3]);

    let (listener, address) = server();
    drop(listener);
    let text = format!(
        "from = {{ tcp_listen = \"{address}\" }}\nseparator = \"blank\"\ncolumns = [\"x_mm\", \"y_mm\", \"z_mm\"]\n"
    );
    let mut clients = scale(&config(&text));
    for value in 1..=2 {
        TcpStream::connect(&address).unwrap().write_all(format!("  {value}\t0   0\n").as_bytes()).unwrap();
        assert_eq!(next(clients.as_mut()).0.reading_m, [f64::from(value) / 1e3, 0.0, 0.0]);
    }

    let text = "from = { command = [\"printf\", \"7,0,0\\\\n\"] }\ncolumns = [\"x_mm\", \"y_mm\", \"z_mm\"]\n";
    let mut command = scale(&config(text));
    let sequences = [0, 1].map(|_| next(command.as_mut()).0).map(|reading| (reading.sequence, reading.reading_m[0]));
    assert_eq!(sequences, [(0, 7e-3), (1, 7e-3)], "a command that ends is started again");
}

#[test]
fn a_tracers_lines_say_station_and_uncertainty_or_the_launch_file_does() {
    let text = "from = { command = [\"printf\", \"1.5,0.4\\\\n\"] }\ncolumns = [\"length_mm\", \"u_length_um\"]\nstation = \"S1\"\n";
    let driver = DriverConfig::Lines(config(text));
    let mut tracer = open_tracer(&driver, Path::new(""), machine(), &patience(), None).unwrap();
    let reading = tracer.next_reading().unwrap().unwrap();
    assert_eq!((reading.length_m, reading.station.as_str(), reading.line.as_str()), (1.5e-3, "S1", ""));
    assert!((reading.u_length_m - 0.4e-6).abs() < 1e-18);
}

#[test]
fn regress_a_silent_command_and_all_that_it_started_end_with_their_driver() {
    let folder = tempfile::tempdir().unwrap();
    let told = folder.path().join("ids");
    let script = format!("sleep 600 & echo $$ $! > {}; echo 7,0,0; wait", told.display());
    let text =
        format!("from = {{ command = [\"sh\", \"-c\", \"{script}\"] }}\ncolumns = [\"x_mm\", \"y_mm\", \"z_mm\"]\n");
    let mut command = scale(&config(&text));
    assert_eq!(next(command.as_mut()).0.reading_m[0], 7e-3);
    let ids = std::fs::read_to_string(told).unwrap();
    let since = Instant::now();
    drop(command);
    assert!(since.elapsed() < Duration::from_secs(5), "its end was waited for");
    // A process that ended and was not waited for yet is a zombie.
    let runs = |id: &str| std::fs::read_to_string(format!("/proc/{id}/stat")).is_ok_and(|stat| !stat.contains(") Z "));
    let deadline = Instant::now() + Duration::from_secs(5);
    while ids.split_whitespace().any(runs) {
        assert!(Instant::now() < deadline, "{ids} still runs");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn regress_a_stamp_of_a_clock_that_was_never_set_is_refused() {
    let text = "from = { command = [\"printf\", \"0,7,0,0\\\\n5,8,0,0\\\\n\"] }\ncolumns = [\"stamp_s\", \"x_mm\", \"y_mm\", \"z_mm\"]\n";
    let mut command = scale(&config(text));
    assert_eq!(next(command.as_mut()).0.reading_m[0], 8e-3);
}

#[test]
fn a_wait_for_lines_ends_when_told_to_stop() {
    let (_listener, address) = server();
    let text = format!("from = {{ tcp = \"{address}\" }}\ncolumns = [\"x_mm\", \"y_mm\", \"z_mm\"]\n");
    let shutdown = Shutdown::manual();
    let driver = DriverConfig::Lines(config(&text));
    let mut driver = open_scale(&driver, Path::new(""), machine(), &shutdown, None).unwrap();
    let since = Instant::now();
    shutdown.request();
    assert!(driver.next_reading().unwrap().is_none() && since.elapsed() < Duration::from_secs(20));
}

#[test]
fn columns_that_make_no_reading_are_refused_with_what_to_do() {
    let said = |of_scale: bool, text: &str| {
        let driver = DriverConfig::Lines(config(&format!("from = {{ tcp = \"127.0.0.1:9\" }}\n{text}")));
        let shutdown = Shutdown::manual();
        let outcome = match of_scale {
            true => open_scale(&driver, Path::new(""), machine(), &shutdown, None).map(|_| ()),
            false => open_tracer(&driver, Path::new(""), machine(), &shutdown, None).map(|_| ()),
        };
        outcome.unwrap_err().to_string()
    };
    for (of_scale, text, words) in [
        (true, "columns = [\"x_mm\", \"y_mm\"]", "needs x, y and z"),
        (true, "columns = [\"x\", \"y_mm\", \"z_mm\"]", "x has no unit; name it x_mm"),
        (true, "columns = [\"x_mm\", \"x_m\", \"y_mm\", \"z_mm\"]", "x_m stands twice"),
        (true, "columns = [\"x_mm\", \"y_mm\", \"z_mm\", \"offset_x_mm\"]", "or none of them"),
        (true, "columns = [\"x_mm\", \"y_mm\", \"z_mm\", \"\"]", "ends with no unit"),
        (true, "columns = [\"x_mm\", \"y_mm\", \"z_mm\", \"temp_scale_x\"]", "ends with no unit that is known"),
        (true, "columns = [\"x_mm\", \"y_mm\", \"z_mm\", \"temp_air_c\", \"temp_air_k\"]", "temp_air_k stands twice"),
        (false, "columns = [\"length_mm\"]", "needs a station"),
        (false, "columns = [\"length_mm\"]\nstation = \"S\"", "needs its uncertainty"),
        (true, "separator = \"ab\"", "driver.separator"),
        (true, "separator = \"5\"", "driver.separator"),
        (true, "decimal = \",\"", "driver.decimal"),
        (true, "silent_after_s = -1.0", "driver.silent_after_s"),
    ] {
        let told = said(of_scale, text);
        assert!(told.contains(words), "{text}: {told}");
    }
    let columns = "columns = [\"x_mm\", \"y_mm\", \"z_mm\"]";
    let without: LinesConfig = toml::from_str(&format!("from = {{ udp = \"127.0.0.1:0\" }}\n{columns}")).unwrap();
    let driver = DriverConfig::Lines(without);
    let told = open_scale(&driver, Path::new(""), machine(), &Shutdown::manual(), None).map(|_| ()).unwrap_err();
    assert!(told.to_string().contains("declares no default_offset_mm; add the key offset_mm"), "{told}");
    let nowhere = DriverConfig::Lines(config("from = { tcp = \"nowhere\" }"));
    let told = open_scale(&nowhere, Path::new(""), machine(), &Shutdown::manual(), None).map(|_| ()).unwrap_err();
    assert!(told.to_string().contains("is no host:port"), "{told}");
}

#[test]
fn a_sensor_gives_covariates_in_the_units_that_effects_read_and_says_how_it_stands() {
    let (listener, address) = server();
    let text = format!("from = {{ tcp = \"{address}\" }}\ncolumns = [\"temp_air_k\", \"-\", \"pressure_mbar\"]\n");
    let mut driver =
        open_sensor(&DriverConfig::Lines(config(&text)), Path::new(""), machine(), &patience(), None).unwrap();
    let link = driver.link().unwrap();
    assert_eq!(link.status().state, LinkState::Waiting);
    let mut stream = listener.accept().unwrap().0;
    stream.write_all(b"293.65,ok,1013.25\n,ok,\n293.75,ok,\n").unwrap();
    let first = driver.next_values().unwrap().unwrap();
    let value = |name: &str| first.values.iter().find(|(known, _)| known == name).map(|(_, value)| *value);
    assert!((value("temp_air_c").unwrap() - 20.5).abs() < 1e-9, "{first:?}");
    assert_eq!((value("pressure_hpa"), first.values.len()), (Some(1013.25), 2));
    assert!(matches!(link.status().state, LinkState::Connected(_)));
    let empty = driver.next_values().unwrap().unwrap();
    assert_eq!((empty.values, empty.missing), (vec![], vec!["temp_air_c".to_owned(), "pressure_hpa".to_owned()]));
    let half = driver.next_values().unwrap().unwrap();
    assert_eq!((half.values.len(), half.missing), (1, vec!["pressure_hpa".to_owned()]), "an empty cell is no value");
    let status = link.status();
    assert_eq!((status.refused, status.last_refusal.as_str()), (1, "line 2: all of its values are empty"));
    drop((stream, listener));
    let waiting = thread::spawn(move || driver.next_values());
    let deadline = Instant::now() + Duration::from_secs(20);
    while !matches!(link.status().state, LinkState::Lost(_)) {
        assert!(Instant::now() < deadline, "{:?}", link.status());
        thread::sleep(Duration::from_millis(10));
    }
    assert!(!waiting.is_finished(), "it is tried again");
}
