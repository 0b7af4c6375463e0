//! Evidence for LinuxCNC as a source: when its samples were taken, what it says of side and feed, axes that are not homed, and the
//! real program with a simulated machine (Debian: `linuxcnc-uspace`; without it that one test says that it was skipped).

use crate::common::bench;
use abbe_graph::driver::{DriverConfig, DriverError, ScaleDriver, open_scale, open_tracer};
use abbe_graph::link::{Link, LinkState};
use abbe_msgs::ScaleReading;
use abbe_runtime::Shutdown;
use std::fmt::Write as _;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Far beyond what anything here takes on a loaded machine.
const LIMIT: Duration = Duration::from_secs(60);
/// Where `linuxcncrsh` listens.
const RSH: &str = "127.0.0.1:5007";

fn config(text: &str) -> DriverConfig {
    DriverConfig::Linuxcnc(toml::from_str(&format!("{text}\nunits = \"mm\"\noffset_mm = [0.0, 0.0, -60.0]")).unwrap())
}

fn open(config: &DriverConfig, shutdown: &Shutdown) -> Result<Box<dyn ScaleDriver>, DriverError> {
    open_scale(config, Path::new(""), &bench().machine, shutdown, None)
}

/// What the driver gives, and how it stands.
fn given(config: &DriverConfig, shutdown: &Shutdown) -> (Receiver<Result<ScaleReading, String>>, Link) {
    let mut driver = open(config, shutdown).unwrap();
    let link = driver.link().unwrap();
    let (give, given) = channel();
    thread::spawn(move || {
        while let Some(one) = driver.next_reading().transpose() {
            if give.send(one.map_err(|error| error.to_string())).is_err() {
                return;
            }
        }
    });
    (given, link)
}

fn wait_until(what: &str, mut is_so: impl FnMut() -> bool) {
    let since = Instant::now();
    while !is_so() {
        assert!(since.elapsed() < LIMIT, "not within {LIMIT:?}: {what}");
        thread::sleep(Duration::from_millis(10));
    }
}

fn covariate(reading: &ScaleReading, name: &str) -> Option<f64> {
    reading.covariates.iter().find(|own| own.name.as_str() == name).map(|own| own.value)
}

fn now_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_secs_f64()
}

/// Samples as a sampler gives them: so many from this number on, the first of them taken at `begin_s`, written in bursts.
fn samples(stream: &mut TcpStream, begin_s: f64, numbers: std::ops::Range<u32>, row: impl Fn(u32) -> String) {
    let first = numbers.start;
    let mut burst = String::new();
    for number in numbers {
        writeln!(burst, "{number} {} ", row(number)).unwrap();
        if number % 20 == 19 {
            let ready_s = begin_s + f64::from(number - first) * 1e-3;
            thread::sleep(Duration::from_secs_f64((ready_s - now_s()).max(0.0)));
            stream.write_all(std::mem::take(&mut burst).as_bytes()).unwrap();
        }
    }
    stream.write_all(burst.as_bytes()).unwrap();
}

#[test]
fn samples_are_readings_of_their_own_instant_and_none_before_the_axes_are_homed() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let (tell, told) = channel();
    let writer = thread::spawn(move || {
        let mut stream = listener.accept().unwrap().0;
        let begin_s = now_s();
        // X moves by 1 mm each second, so that a position tells when it was.
        let row = |number: u32| {
            let is_homed = u8::from(number >= 2000);
            format!("{:.6} 50.0 10.0 1 1 {is_homed} 1.0 0.0 0.0 1.0", f64::from(number) * 1e-3)
        };
        samples(&mut stream, begin_s, 0..6000, row);
        stream.write_all(b"rubbish\n\xff\n").unwrap();
        tell.send(begin_s).unwrap();
        stream
    });
    let shutdown = Shutdown::manual();
    let (given, link) =
        given(&config(&format!("from = {{ tcp = \"{address}\" }}\nevery_s = 0.02\nlate_s = 0.25")), &shutdown);
    wait_until(
        "not homed is told",
        || matches!(link.status().state, LinkState::Lost(words) if words == "Z is not homed, and has no position; home the machine"),
    );
    let begin_s = told.recv_timeout(LIMIT).unwrap();
    let readings: Vec<_> = (0..200).map(|_| given.recv_timeout(LIMIT).unwrap().unwrap()).collect();
    for (sequence, reading) in readings.iter().enumerate() {
        // The 2000th sample is the first of a homed machine; every twentieth is given.
        let taken_s = 2.0 + 0.02 * sequence as f64;
        assert_eq!(reading.sequence, sequence as u64);
        assert!((reading.reading_m[0] - taken_s * 1e-3).abs() < 1e-9, "{reading:?}");
        assert_eq!((reading.reading_m[1], reading.offset_m), (0.05, [0.0, 0.0, -0.06]));
        assert_eq!((covariate(reading, "dir_x"), covariate(reading, "dir_y")), (Some(1.0), None));
        assert_eq!(covariate(reading, "speed_mm_s"), Some(1.0));
    }
    // A loaded host writes later than it should, never earlier; the numbers keep their distance.
    let late_s = |reading: &ScaleReading| reading.stamp.to_seconds() - begin_s - reading.reading_m[0] * 1e3;
    let all: Vec<f64> = readings.iter().map(late_s).collect();
    assert!(all.iter().all(|late_s| (-0.001..0.1).contains(late_s)), "{all:?}");
    for words in ["it has 1 columns instead of 11", "UTF-8"] {
        let said = given.recv_timeout(LIMIT).unwrap().unwrap_err();
        assert!(said.contains(words), "{said}");
    }
    drop(writer.join().unwrap());
    shutdown.request();
}

#[test]
fn a_flood_half_a_line_repeats_and_a_connection_that_ends_or_falls_silent_give_no_reading_of_a_wrong_instant() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let (tell, told) = channel();
    let writer = thread::spawn(move || {
        // X is the number of a sample in micrometres, 100 mm further on with each connection.
        let row = |connection: u32, number: u32| {
            format!("{:.6} 50.0 10.0 1 1 1 1.0 0.0 0.0 1.0", f64::from(connection * 100_000 + number) * 1e-3)
        };
        let mut stream = listener.accept().unwrap().0;
        let begin_s = now_s();
        tell.send(begin_s).unwrap();
        samples(&mut stream, begin_s, 0..2000, |number| row(0, number));
        stream.write_all("rubbish\n".repeat(20_000).as_bytes()).unwrap();
        // Refusing the flood takes its time, and what comes later than allowed is refused: the end of this comes in time.
        samples(&mut stream, begin_s + 2.6, 2600..5600, |number| row(0, number));
        // The 5 of 50 mm, and no more: what is missing would change what it says.
        stream.write_all(b"5600 5.600000 5").unwrap();
        drop(stream);
        let mut stream = listener.accept().unwrap().0;
        let begin_s = now_s();
        tell.send(begin_s).unwrap();
        samples(&mut stream, begin_s, 0..2000, |number| row(1, number));
        // The last second again, at once, and on from there.
        let again: String = (1000..2000).map(|number| format!("{number} {} \n", row(1, number))).collect();
        stream.write_all(again.as_bytes()).unwrap();
        samples(&mut stream, begin_s + 2.0, 2000..4000, |number| row(1, number));
        // It stays connected, and says nothing more.
        let third = listener.accept().unwrap().0;
        (stream, third)
    });
    let shutdown = Shutdown::manual();
    let keys = format!("from = {{ tcp = \"{address}\" }}\nevery_s = 0.02\nlate_s = 0.25\nsilent_after_s = 1.5");
    let (given, link) = given(&config(&keys), &shutdown);
    let mut was_silent = false;
    wait_until("it connects again after a silence", || {
        was_silent |= matches!(link.status().state, LinkState::Silent(_) | LinkState::Lost(_));
        writer.is_finished()
    });
    let _kept = writer.join().unwrap();
    shutdown.request();
    let begins_s: Vec<f64> = told.try_iter().collect();
    let (mut readings, mut refused) = (Vec::new(), Vec::new());
    while let Ok(one) = given.recv_timeout(LIMIT) {
        match one {
            Ok(reading) => readings.push(reading),
            Err(words) => refused.push(words),
        }
    }
    assert!(was_silent);
    let mm: Vec<f64> = readings.iter().map(|reading| reading.reading_m[0] * 1e3).collect();
    assert!(mm.is_sorted_by(|a, b| a < b), "none comes twice: {mm:?}");
    for part in [0.0..2.0, 2.6..5.6, 100.0..102.0, 102.0..104.0] {
        assert!(mm.iter().any(|mm| part.contains(mm)), "none of {part:?}: {mm:?}");
    }
    for (sequence, reading) in readings.iter().enumerate() {
        let [x_mm, y_mm, _] = reading.reading_m.map(|m| m * 1e3);
        let (begin_s, taken_s) = if x_mm < 50.0 { (begins_s[0], x_mm) } else { (begins_s[1], x_mm - 100.0) };
        assert_eq!(reading.sequence, sequence as u64);
        assert!((y_mm - 50.0).abs() < 1e-9, "{reading:?}");
        let late_s = reading.stamp.to_seconds() - begin_s - taken_s;
        // What is later than the driver allows is refused.
        assert!((-0.001..0.25).contains(&late_s), "{late_s}: {reading:?}");
    }
    let count = |words: &str| refused.iter().filter(|said| said.contains(words)).count();
    assert_eq!((count("it has 1 columns"), count("it has no end")), (20_000, 1), "{:?}", refused.last());
}

#[test]
fn settings_that_make_no_linuxcnc_are_refused_with_what_to_do() {
    for (text, words) in [
        ("from = { tcp = \"nowhere\" }", "driver.from: \"nowhere\" is no host:port"),
        ("period_s = 0.0", "driver.period_s: must be the servo period"),
        ("every_s = 0.0015", "driver.every_s: must be one or more whole servo periods"),
        ("late_s = 0.5", "driver.late_s: must be a servo period or more"),
        ("silent_after_s = -1.0", "driver.silent_after_s: must be"),
    ] {
        let Err(error) = open(&config(text), &Shutdown::manual()) else { panic!("{text} was taken") };
        assert!(error.to_string().starts_with(words), "{error}");
    }
    let tracer = open_tracer(&config(""), Path::new(""), &bench().machine, &Shutdown::manual(), None);
    assert!(tracer.is_err_and(|error| error.to_string().contains("linuxcnc reads scales")));
    let without = toml::from_str::<DriverConfig>("kind = \"linuxcnc\"").unwrap_err().to_string();
    assert!(without.contains("units"), "{without}");
}

/// The real program with its simulated machine; ended with the test.
struct Linuxcnc {
    program: Child,
    folder: tempfile::TempDir,
}

impl Linuxcnc {
    /// `None` where it is not installed, or another one runs: it is alone on its host.
    fn start() -> Option<Linuxcnc> {
        let is_there =
            |program: &str| Command::new("which").arg(program).stdout(Stdio::null()).status().unwrap().success();
        if !["linuxcnc", "linuxcncrsh", "halsampler", "stdbuf"].iter().all(|program| is_there(program)) {
            println!("SKIPPED: LinuxCNC is not installed (Debian: linuxcnc-uspace), so the real program was not read");
            return None;
        }
        if TcpStream::connect(RSH).is_ok() || Path::new("/tmp/linuxcnc.lock").exists() {
            println!("SKIPPED: a LinuxCNC runs on this host already, which this test does not disturb");
            return None;
        }
        let folder = tempfile::tempdir().unwrap();
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch-config/linuxcnc");
        for name in ["sim.ini", "sim.hal", "abbe.hal"] {
            fs::copy(source.join(name), folder.path().join(name)).unwrap();
        }
        for name in ["sim.var", "sim.tbl"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        let mut command = Command::new("linuxcnc");
        command.arg(folder.path().join("sim.ini")).current_dir(folder.path()).env("HOME", folder.path());
        if rustix::process::geteuid().is_root() {
            // It refuses to run as root without these, and then runs as nobody.
            fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o777)).unwrap();
            command.env("RTAPI_UID", "65534").env("RTAPI_FIFO_PATH", folder.path().join("fifo"));
        }
        let program = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        Some(Linuxcnc { program, folder })
    }

    /// Sends a command, gives its answer.
    fn tell(lines: &mut BufReader<TcpStream>, command: &str) -> String {
        lines.get_mut().write_all(format!("{command}\r\n").as_bytes()).unwrap();
        let mut answer = String::new();
        lines.read_line(&mut answer).unwrap();
        answer
    }
}

impl Drop for Linuxcnc {
    fn drop(&mut self) {
        if let Ok(mut stream) = TcpStream::connect(RSH) {
            for command in ["hello EMC abbe 1.0\r\n", "set enable EMCTOO\r\n", "shutdown\r\n"] {
                let _ = stream.write_all(command.as_bytes());
                thread::sleep(Duration::from_millis(100));
            }
        }
        let since = Instant::now();
        while since.elapsed() < Duration::from_secs(20) {
            if matches!(self.program.try_wait(), Ok(Some(_))) {
                return;
            }
            thread::sleep(Duration::from_millis(50));
        }
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

#[test]
fn the_real_linuxcnc_is_read_while_it_homes_moves_and_stands() {
    let Some(linuxcnc) = Linuxcnc::start() else { return };
    wait_until("LinuxCNC takes commands", || TcpStream::connect(RSH).is_ok());
    println!("runs in {}", linuxcnc.folder.path().display());
    let shutdown = Shutdown::manual();
    let (given, link) = given(&config(""), &shutdown);
    wait_until(
        "it is not homed",
        || matches!(link.status().state, LinkState::Lost(words) if words.contains("X is not homed")),
    );
    let stream = TcpStream::connect(RSH).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    let mut rsh = BufReader::new(stream);
    assert!(Linuxcnc::tell(&mut rsh, "hello EMC abbe 1.0").starts_with("HELLO ACK"));
    Linuxcnc::tell(&mut rsh, "set echo off");
    let tell = |rsh: &mut BufReader<TcpStream>, command: &str| {
        rsh.get_mut().write_all(format!("{command}\r\n").as_bytes()).unwrap();
        thread::sleep(Duration::from_millis(200));
    };
    for command in ["set enable EMCTOO", "set estop off", "set machine on", "set mode manual"] {
        tell(&mut rsh, command);
    }
    assert!(given.try_recv().is_err(), "what is not homed has no position");
    for joint in 0..3 {
        tell(&mut rsh, &format!("set home {joint}"));
    }
    wait_until("it is homed", || matches!(link.status().state, LinkState::Connected(_)));
    tell(&mut rsh, "set mode mdi");
    let begun_s = now_s();
    // A loaded host is late now and then, which is said.
    let mut readings: Vec<ScaleReading> = Vec::new();
    let mut stands = |x_mm: f64, feed_mm_s: f64| {
        wait_until("it stands there", || {
            readings.extend(given.try_iter().filter_map(Result::ok));
            let feed = |last| covariate(last, "speed_mm_s").is_some_and(|own| (own - feed_mm_s).abs() < 1e-6);
            readings.last().is_some_and(|last| (last.reading_m[0] * 1e3 - x_mm).abs() < 1e-6 && feed(last))
        });
    };
    // 112 mm at 50 mm/s, and back by 10 mm at 10 mm/s.
    tell(&mut rsh, "set mdi G21 G1 X100 Y50 Z10 F3000");
    stands(100.0, 50.0);
    tell(&mut rsh, "set mdi G1 X90 F600");
    stands(90.0, 10.0);
    let ended_s = now_s();
    drop(linuxcnc);
    shutdown.request();

    assert!(readings.len() > 50, "{}", readings.len());
    let at = |place: usize| readings[place].reading_m.map(|m| (m * 1e9).round() / 1e6);
    let last = readings.len() - 1;
    assert_eq!((at(0), at(last)), ([0.0, 0.0, 0.0], [90.0, 50.0, 10.0]));
    let side = |name| covariate(&readings[last], name);
    assert_eq!([side("dir_x"), side("dir_y"), side("dir_z")], [Some(-1.0), Some(1.0), Some(1.0)]);
    assert!((side("speed_mm_s").unwrap() - 10.0).abs() < 1e-6);
    // At the full feed of 50 mm/s each reading is where its stamp says: 10 ms and 0.5 mm of the way after the one before.
    let full: Vec<&ScaleReading> = readings
        .iter()
        .filter(|reading| covariate(reading, "speed_mm_s").is_some_and(|s| (s - 50.0).abs() < 1e-6))
        .collect();
    let way_mm = |a: &ScaleReading, b: &ScaleReading| {
        (0..3).map(|d| (a.reading_m[d] - b.reading_m[d]).powi(2)).sum::<f64>().sqrt() * 1e3
    };
    // Between braking and standing there are others, and the feed of a standing machine is that of its last move.
    let is_pair = |pair: &&[&ScaleReading]| pair[1].sequence == pair[0].sequence + 1 && way_mm(pair[0], pair[1]) > 0.4;
    let moving: Vec<&[&ScaleReading]> = full.windows(2).filter(is_pair).collect();
    assert!(moving.len() > 20, "{}", moving.len());
    let worst_mm = moving.iter().map(|pair| {
        let lasts_s = pair[1].stamp.to_seconds() - pair[0].stamp.to_seconds();
        (way_mm(pair[0], pair[1]) - 50.0 * lasts_s).abs()
    });
    let worst_mm = worst_mm.fold(0.0, f64::max);
    println!(
        "{} readings, {} on the way; off the line of time by {worst_mm:.4} mm at most",
        readings.len(),
        moving.len()
    );
    // This LinuxCNC has no real-time kernel: periods that it leaves out go into the instants, up to late_s (30 ms, 1.5 mm).
    assert!(worst_mm < 1.6, "{worst_mm}");
    assert!(readings.iter().all(|reading| (begun_s - 60.0..ended_s).contains(&reading.stamp.to_seconds())));
}
