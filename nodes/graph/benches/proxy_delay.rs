//! Delay that the proxy adds to a scan of 1000 points a second, beside a relay that only copies bytes, in the same run.
//!
//! `cargo bench -p abbe-graph --bench proxy_delay`: a server writes a line of a scan each millisecond, in turns to software behind the
//! proxy (correcting and recording) and to software behind the copying relay; the delay of a line is from its writing to its
//! arrival. All sockets on loopback, all in one process.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A benchmark fails by panicking.

#[path = "../tests/common/mod.rs"]
mod common;

use abbe_graph::proxy::{Corrector, ProxyConfig, listen, serve};
use abbe_ippdme::relay::{Offsets, Settings};
use abbe_runtime::Shutdown;
use common::{HASH, bench};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

/// Lines of each way.
const LINES: usize = 20_000;
const EVERY: Duration = Duration::from_millis(1);
/// What may be added at the 99th percentile.
const ALLOWED: Duration = Duration::from_millis(1);

/// A server that answers what the proxy asks, and scans when it is told to by the channel; says when each line was written.
fn server(listener: TcpListener, begin: Receiver<()>, wrote: Sender<Instant>) {
    let stream = listener.accept().unwrap().0;
    stream.set_nodelay(true).unwrap();
    let mut writer = stream.try_clone().unwrap();
    for line in BufReader::new(stream).lines().map_while(Result::ok) {
        let (tag, command) = line.split_at(5);
        let data = match command.trim().split('(').next().unwrap() {
            "GetMachineClass" => Some("GetMachineClass(CartCMM)"),
            "GetCoordSystem" => Some("CoordSystem(MachineCsy)"),
            "GetProp" => Some("Tool.Name(\"Probe1\")"),
            "ScanOnLine" => return scan(tag, &mut writer, &begin, &wrote),
            _ => None,
        };
        let data = data.map_or(String::new(), |data| format!("{tag} # {data}\r\n"));
        writer.write_all(format!("{tag} &\r\n{data}{tag} %\r\n").as_bytes()).unwrap();
    }
}

fn scan(tag: &str, writer: &mut TcpStream, begin: &Receiver<()>, wrote: &Sender<Instant>) {
    writer.write_all(format!("{tag} &\r\n").as_bytes()).unwrap();
    begin.recv().unwrap();
    let mut due = Instant::now();
    for k in 0..LINES {
        due += EVERY;
        thread::sleep(due.saturating_duration_since(Instant::now()));
        let share = |factor: f64| (k as f64 * factor).fract();
        let [x, y, z] = [750.0 * share(0.819_172_5), 550.0 * share(0.671_043_6), 500.0 * share(0.549_700_5)];
        let line = format!("{tag} # {x:.5},{y:.5},{z:.5},0.00000\r\n");
        wrote.send(Instant::now()).unwrap();
        writer.write_all(line.as_bytes()).unwrap();
    }
}

/// Copies bytes both ways.
fn copy(listener: TcpListener, to: String) {
    let software = listener.accept().unwrap().0;
    let machine = TcpStream::connect(to).unwrap();
    for (mut from, mut to) in [(software.try_clone().unwrap(), machine.try_clone().unwrap()), (machine, software)] {
        to.set_nodelay(true).unwrap();
        thread::spawn(move || {
            let mut bytes = [0; 1 << 16];
            while let Ok(count @ 1..) = from.read(&mut bytes) {
                if to.write_all(&bytes[..count]).is_err() {
                    return;
                }
            }
        });
    }
}

/// Delays of the lines of a scan that comes to software at this address, ascending.
fn delays(address: &str, begin: &Sender<()>, wrote: &Receiver<Instant>) -> Vec<Duration> {
    let mut stream = BufReader::new(TcpStream::connect(address).unwrap());
    let (mut line, mut begun) = (String::new(), false);
    stream.get_mut().write_all(b"00001 StartSession()\r\n").unwrap();
    let mut delays = Vec::with_capacity(LINES);
    while delays.len() < LINES {
        line.clear();
        assert!(stream.read_line(&mut line).unwrap() > 0, "the scan ended early");
        assert!(!line.contains('!'), "{line}");
        if line.starts_with("00002 #") {
            delays.push(wrote.recv().unwrap().elapsed());
        } else if line.starts_with("00001 %") {
            stream.get_mut().write_all(b"00002 ScanOnLine(0,0,0,1,1,1,0,0,1,1)\r\n").unwrap();
        } else if line.starts_with("00002 &") && !std::mem::replace(&mut begun, true) {
            begin.send(()).unwrap();
        }
    }
    delays.sort();
    delays
}

/// A server on a thread: its address, what begins its scan, and when lines were written.
fn started() -> (String, Sender<()>, Receiver<Instant>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let ((begin, told), (writes, wrote)) = (channel(), channel());
    thread::spawn(move || server(listener, told, writes));
    (address, begin, wrote)
}

fn main() {
    // The copying relay.
    let (machine, begin, wrote) = started();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    thread::spawn(move || copy(listener, machine));
    let copied = delays(&address, &begin, &wrote);
    // The proxy.
    let (machine, begin, wrote) = started();
    let folder = tempfile::tempdir().unwrap();
    let mut corrector = Corrector::new(Arc::clone(&bench().model), HASH, None, true).unwrap();
    corrector.record(&folder.path().join("recorded")).unwrap();
    let offsets = Offsets { of_any_m: Some([0.0, 0.0, -0.06]), ..Offsets::default() };
    let settings = Settings { offsets, scans_as_asked: true, ..Settings::default() };
    let listener = listen("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let shutdown = Shutdown::manual();
    let ends = shutdown.clone();
    let proxy = thread::spawn(move || serve(&listener, &ProxyConfig { to: machine, settings }, &mut corrector, &ends));
    let corrected = delays(&address, &begin, &wrote);
    shutdown.request();
    let summary = proxy.join().unwrap().unwrap();
    assert_eq!((summary.counts.corrected, summary.unrecorded), (LINES as u64, 0), "{summary:?}");

    let at = |delays: &[Duration], share: f64| delays[((LINES - 1) as f64 * share) as usize];
    for (name, share) in [("p50", 0.5), ("p99", 0.99), ("p99.9", 0.999)] {
        let (copied, corrected) = (at(&copied, share), at(&corrected, share));
        println!("{name}: copied {copied:?}, corrected and recorded {corrected:?}");
    }
    let added = at(&corrected, 0.99).saturating_sub(at(&copied, 0.99));
    println!("added at p99: {added:?}; less than {ALLOWED:?}: {}", if added < ALLOWED { "yes" } else { "no" });
}
