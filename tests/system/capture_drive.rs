//! A capture that moves the machine itself: rehearsed on the simulated one, which obeys, and on a server that fails.

use std::fmt::Write as _;
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, ChildStdin, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use crate::common::assert_says;
use crate::common::files::{Bench, machine, text};
use crate::common::program::{Started, abbe, run, signal, wait_until};
use rustix::process::Signal;
use serde_json::Value;

/// Far beyond what a rehearsal takes on a loaded machine.
const LIMIT: Duration = Duration::from_secs(120);
const SEED: &str = "11";

/// Two set-ups of a few points; each line begins elsewhere.
fn plan(bench: &Bench) {
    let mut path = "station,line,time_s,x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm,speed_mm_s\n".to_owned();
    let mut time_s = 0;
    for (holder, offset) in ["0,0,-60", "120,0,-60"].into_iter().enumerate() {
        for line in 0..3 {
            for k in 0..3 {
                time_s += 5;
                let (x, y, z) = (100 + 250 * k, 100 + 150 * line, 50 + 100 * line);
                writeln!(path, "S1,S1-{holder}-{line},{time_s},{x},{y},{z},{offset},50").unwrap();
            }
        }
    }
    fs::create_dir_all(bench.path("plan")).unwrap();
    bench.write("plan/path.csv", path);
    bench.write("plan/stations.csv", "station,x_mm,y_mm,z_mm\nS1,-250,-250,-150\n");
}

fn free_address() -> String {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string()
}

/// The simulated machine, which obeys.
fn serve(bench: &Bench) -> (String, String, Started) {
    let (server, tracer) = (free_address(), free_address());
    let (machine, plan) = (text(&machine()), bench.text("plan"));
    let own = ["simulate", "--machine", &machine, "--seed", SEED, "--plan", &plan, "--serve", "ippdme", "--obey"];
    let pace = ["--faster", "20", "--dwell-s", "0.1", "--change-s", "2", "--tracer-hz", "200"];
    let at = ["--listen", &server, "--tracer-listen", &tracer];
    let started = Started::start(abbe(own.iter().chain(&pace).chain(&at)));
    for address in [&server, &tracer] {
        wait_until("it serves", Duration::from_secs(60), || TcpStream::connect(address).is_ok());
    }
    (server, tracer, started)
}

/// The file that a capture is told by.
fn config(bench: &Bench, server: &str, tracer: &str, drive: &str) -> String {
    let content = format!(
        "machine = \"{}\"\nplan = \"plan\"\ncheck = {{ raw_error_um = 100.0 }}\n\
         [scale]\nkind = \"ippdme\"\nserver = \"{server}\"\nreads = \"polled\"\nevery_s = 0.005\nsilent_after_s = 1.0\n\
         offset_mm = [0.0, 0.0, -60.0]\ntools_mm = {{ Holder1 = [0.0, 0.0, -60.0], Holder2 = [120.0, 0.0, -60.0] }}\n\
         [tracer]\nkind = \"lines\"\nfrom = {{ tcp = \"{tracer}\" }}\ncolumns = [\"station\", \"length_mm\", \"u_length_um\"]\n\
         [standstill]\nspan_um = 1.0\ncreep_um = 0.3\nshortest_s = 0.08\nlongest_s = 0.12\npause_s = 0.1\nmargin_s = 0.02\n\
         [motion]\nreversal_um = 20.0\nwindow_s = 0.02\n\
         [lengths]\npause_s = 0.1\n\
         {drive}\n",
        text(&machine())
    );
    bench.write("capture.toml", content)
}

/// A capture beside which somebody sits.
struct Capture {
    child: Child,
    keys: Option<ChildStdin>,
    said: Arc<Mutex<String>>,
    reader: Option<thread::JoinHandle<()>>,
}

impl Capture {
    fn start(bench: &Bench, config: &str) -> Capture {
        let mut command = abbe(["capture", config, "--out", &bench.text("captured"), "--json"]);
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let (said, mut errors) = (Arc::new(Mutex::new(String::new())), child.stderr.take().unwrap());
        let own = Arc::clone(&said);
        let reader = thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(count @ 1..) = errors.read(&mut bytes) {
                own.lock().unwrap().push_str(&String::from_utf8_lossy(&bytes[..count]));
            }
        });
        Capture { keys: child.stdin.take(), child, said, reader: Some(reader) }
    }

    fn said(&self) -> String {
        self.said.lock().unwrap().clone()
    }

    /// Waits until these words were said so many times.
    fn wait_for(&mut self, words: &str, times: usize) {
        wait_until(words, LIMIT, || {
            let ended = self.child.try_wait().unwrap();
            let has_said = self.said().matches(words).count() >= times;
            assert!(has_said || ended.is_none(), "it ended before {words:?}: {}", self.said());
            has_said
        });
    }

    fn press_enter(&mut self) {
        self.keys.as_mut().unwrap().write_all(b"\n").unwrap();
    }

    fn signal(&self, which: Signal) {
        signal(self.child.id(), which);
    }

    /// Exit code and what was said, at its end.
    fn finish(mut self) -> (Option<i32>, String) {
        wait_until("it ends", LIMIT, || self.child.try_wait().unwrap().is_some());
        let code = self.child.wait().unwrap().code();
        self.reader.take().unwrap().join().unwrap();
        (code, self.said())
    }
}

impl Drop for Capture {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Points that are taken, in their order.
fn taken(bench: &Bench) -> Vec<u64> {
    let bytes = fs::read(bench.path("captured/journal.jsonl")).unwrap_or_default();
    let whole = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
    let entries = String::from_utf8_lossy(&bytes[..whole])
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect::<Vec<Value>>();
    entries.iter().filter(|entry| entry["entry"] == "taken").map(|entry| entry["point"].as_u64().unwrap()).collect()
}

#[test]
fn the_machine_is_driven_set_up_by_set_up_and_nothing_moves_before_it_may_again_after_a_kill() {
    let bench = Bench::empty();
    plan(&bench);
    let (server, tracer, _served) = serve(&bench);
    let config = config(&bench, &server, &tracer, "[drive]\nspeed_mm_s = 40.0\nover_z_mm = 400.0\nwait_s = 5.0");

    let preview = run(["capture", &config, "--out", &bench.text("captured"), "--preview"]).ok();
    assert_says(
        &preview,
        &[
            "set-up 1 of 2: station S1",
            "     1  X, Y, Z = 100.000, 100.000, 50.000 mm  point 1 of 3 of line S1-0-0, from where the machine stands, up to Z = 400.000",
            "X, Y, Z = 600.000, 100.000, 400.000 mm  on the way",
            "26 moves, ",
            "at 40 mm/s; X 100.000 to 600.000, Y 100.000 to 400.000, Z 50.000 to 400.000 mm",
        ],
    );
    assert!(!bench.path("captured").exists(), "a preview leaves nothing");

    let mut capture = Capture::start(&bench, &config);
    // What was pressed before it was asked is no answer.
    capture.press_enter();
    capture.wait_for("Press Enter, and the machine moves by itself at 40 mm/s", 1);
    thread::sleep(Duration::from_secs(2));
    // It stands at the first point.
    assert!(taken(&bench).len() <= 1, "nothing moves before somebody says so: {}", capture.said());
    assert_says(&capture.said(), &["set-up 1 of 2: station S1", "to point 1 of 3 of line S1-0-0", "then to 8 more"]);
    capture.press_enter();
    wait_until("points are captured", LIMIT, || taken(&bench).len() >= 3);
    capture.signal(Signal::KILL);
    drop(capture);
    let before = taken(&bench);

    // Going on asks first, and says where it will go.
    let mut capture = Capture::start(&bench, &config);
    capture.wait_for("Press Enter, and the machine moves by itself", 1);
    let next = format!("to point {} of 3 of line S1-0-{} at", before.len() % 3 + 1, before.len() / 3);
    assert_says(&capture.said(), &[&next]);
    thread::sleep(Duration::from_secs(1));
    assert!(taken(&bench).len() <= before.len() + 1, "{}", capture.said());
    capture.press_enter();
    capture.wait_for("set-up 2 of 2", 1);
    // The reflector is still at its first place, if somebody presses at once.
    capture.press_enter();
    capture.wait_for("Press Enter, and the machine moves by itself", 3);
    assert_says(
        &capture.said(),
        &["the machine was not moved: the tip sits at offset [0.0, 0.0, -60.0] mm, and the plan wants [120.0"],
    );
    thread::sleep(Duration::from_secs(4));
    capture.press_enter();
    let (code, said) = capture.finish();
    assert_eq!(code, Some(0), "{said}");
    assert_says(&said, &["all points are captured"]);
    // In the order of the plan, each once; where it happens to stand when the reflector is changed is a point, too.
    let mut all = taken(&bench);
    assert_eq!(all[..9], [0, 1, 2, 3, 4, 5, 6, 7, 8], "{said}");
    all.sort_unstable();
    assert_eq!(all, (0..18).collect::<Vec<u64>>(), "{said}");
    assert_says(
        &run(["capture", &config, "--out", &bench.text("captured"), "--preview"]).ok(),
        &["nothing is left to drive"],
    );
}

#[test]
fn ctrl_c_ends_between_moves_and_twice_in_the_middle_of_one() {
    let bench = Bench::empty();
    plan(&bench);
    let (server, tracer, _served) = serve(&bench);
    // Slow enough to be in the middle: 8 mm/s of the simulated machine.
    let config = config(&bench, &server, &tracer, "[drive]\nspeed_mm_s = 0.4");
    let mut capture = Capture::start(&bench, &config);
    capture.wait_for("Press Enter", 1);
    capture.signal(Signal::INT);
    let (code, said) = capture.finish();
    assert_eq!(code, Some(130), "{said}");

    let mut capture = Capture::start(&bench, &config);
    capture.wait_for("Press Enter", 1);
    capture.press_enter();
    let mut looker = Looker::new(&server);
    let from = looker.at();
    wait_until("it moves", LIMIT, || (looker.at() - from).abs() > 1.0);
    capture.signal(Signal::INT);
    capture.wait_for("stopping when this move has ended; Ctrl-C again aborts it", 1);
    let between = looker.at();
    // What comes within half a second belongs to the first signal.
    thread::sleep(Duration::from_millis(600));
    assert!((looker.at() - between).abs() > 0.1, "the first one lets the move end");
    capture.signal(Signal::INT);
    let (code, said) = capture.finish();
    assert_eq!(code, Some(130), "{said}");
    assert_says(&said, &["the move is aborted", "the move was aborted on request"]);
    let stood = looker.at();
    thread::sleep(Duration::from_millis(300));
    assert!((looker.at() - stood).abs() < 0.01, "it stands");
    assert!((100.1..349.0).contains(&stood), "in the middle of the way from 100 to 350 mm: {stood}");
}

/// Another client, which looks at X (mm).
struct Looker(BufReader<TcpStream>);

impl Looker {
    fn new(server: &str) -> Looker {
        let mut looker = Looker(BufReader::new(TcpStream::connect(server).unwrap()));
        looker.ask("StartSession()");
        looker
    }

    fn ask(&mut self, command: &str) -> String {
        self.0.get_mut().write_all(format!("00001 {command}\r\n").as_bytes()).unwrap();
        let mut data = String::new();
        loop {
            let mut line = String::new();
            self.0.read_line(&mut line).unwrap();
            match line.split_at(6).1.trim() {
                "%" => return data,
                own if own.starts_with('#') => data = own.to_owned(),
                _ => {}
            }
        }
    }

    fn at(&mut self) -> f64 {
        self.ask("Get(X())").trim_start_matches("# X(").trim_end_matches(')').parse().unwrap()
    }
}

/// Commands that begin so are not passed on; the answer, with the tag in front of each line.
type Answers = Vec<(String, Vec<&'static str>)>;

/// Between the capture and the simulated machine: what the server answers can be replaced, and the connection cut.
struct Between {
    address: String,
    answers: Arc<Mutex<Answers>>,
    heard: Arc<Mutex<Vec<String>>>,
    streams: Arc<Mutex<Vec<TcpStream>>>,
}

impl Between {
    fn start(server: &str) -> Between {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let between = Between {
            address: listener.local_addr().unwrap().to_string(),
            answers: Arc::default(),
            heard: Arc::default(),
            streams: Arc::default(),
        };
        let (answers, heard, streams) =
            (Arc::clone(&between.answers), Arc::clone(&between.heard), Arc::clone(&between.streams));
        let server = server.to_owned();
        thread::spawn(move || {
            for client in listener.incoming().map(Result::unwrap) {
                let machine = TcpStream::connect(&server).unwrap();
                *streams.lock().unwrap() = vec![client.try_clone().unwrap(), machine.try_clone().unwrap()];
                let (mut back, mut from) = (client.try_clone().unwrap(), machine.try_clone().unwrap());
                thread::spawn(move || drop(std::io::copy(&mut from, &mut back)));
                let (mut forth, mut back) = (machine, client.try_clone().unwrap());
                for line in BufReader::new(client).lines().map_while(Result::ok) {
                    heard.lock().unwrap().push(line.clone());
                    let (tag, command) = line.split_at(5);
                    let own = answers
                        .lock()
                        .unwrap()
                        .iter()
                        .find(|(begin, _)| command[1..].starts_with(begin.as_str()))
                        .map(|(_, lines)| lines.clone());
                    let sent = match own {
                        Some(lines) => lines.iter().try_for_each(|said| write!(back, "{tag} {said}\r\n")),
                        None => write!(forth, "{line}\r\n"),
                    };
                    if sent.is_err() {
                        break;
                    }
                }
            }
        });
        between
    }

    fn answer(&self, command: &str, lines: &[&'static str]) {
        self.answers.lock().unwrap().push((command.to_owned(), lines.to_vec()));
    }

    fn count(&self, command: &str) -> usize {
        self.heard.lock().unwrap().iter().filter(|line| line[6..].starts_with(command)).count()
    }

    fn cut(&self) {
        for stream in self.streams.lock().unwrap().drain(..) {
            let _ = stream.shutdown(std::net::Shutdown::Both);
        }
    }
}

#[test]
fn a_machine_that_is_not_ready_is_not_moved_and_a_lost_connection_or_an_error_asks_or_stops() {
    let bench = Bench::empty();
    plan(&bench);
    let (server, tracer, _served) = serve(&bench);
    let between = Between::start(&server);
    let config = config(&bench, &between.address, &tracer, "[drive]\nspeed_mm_s = 2.0");
    let mut capture = Capture::start(&bench, &config);
    let mut asked = 1;
    capture.wait_for("Press Enter, and", asked);
    for (command, answer, words) in [
        ("GetErrStatusE", vec!["&", "# ErrStatus(1)", "%"], "the server has an error that is not cleared"),
        ("IsHomed", vec!["&", "# IsHomed(0)", "%"], "the machine is not homed; home it at its panel"),
        (
            "GetProp(Tool.GoToPar",
            vec!["&", "# Tool.GoToPar.Speed(50)", "%"],
            "the server took 50 mm/s for the speed of 2 mm/s",
        ),
        (
            "Get(X(), Y",
            vec!["&", "# X(100), Y(100), Z(9000)", "%"],
            "the machine stands at Z = 9060.000 mm, outside of",
        ),
    ] {
        between.answer(command, &answer);
        capture.press_enter();
        asked += 1;
        capture.wait_for("Press Enter, and", asked);
        assert_says(&capture.said(), &[words]);
        between.answers.lock().unwrap().clear();
    }
    assert_eq!(between.count("GoTo"), 0, "{}", capture.said());

    // Cut in the middle of a move: it connects again by itself, and moves nothing.
    capture.press_enter();
    wait_until("it is sent to a point", LIMIT, || between.count("GoTo") == 1);
    between.cut();
    asked += 1;
    capture.wait_for("Press Enter, and", asked);
    assert_says(&capture.said(), &["the connection was lost", "see where the machine stands"]);
    wait_until("it is connected again", LIMIT, || between.count("StartSession") >= 2);
    thread::sleep(Duration::from_secs(2));
    assert_eq!(between.count("GoTo"), 1, "{}", capture.said());
    // Cut while it stands, after somebody said that it may move: that was said of the session before.
    capture.press_enter();
    wait_until("a point is captured", LIMIT, || !taken(&bench).is_empty());
    let gone = between.count("GoTo");

    // An error of the server ends it; nothing clears it from here.
    between.answer("GoTo", &["&", "! Error(3, 2501, \"GoTo\", \"Collision\")", "%"]);
    let cleared = between.count("ClearAllErrors");
    let (code, said) = capture.finish();
    assert_eq!(code, Some(1), "{said}");
    assert_says(&said, &["the machine was stopped: ", "Collision", "look at the axes of the machine"]);
    assert!(between.count("GoTo") > gone && between.count("ClearAllErrors") == cleared, "{said}");

    // A server that says it has arrived, and has not.
    between.answers.lock().unwrap().clear();
    between.answer("GoTo", &["&", "%"]);
    let mut capture = Capture::start(&bench, &config);
    capture.wait_for("Press Enter, and", 1);
    capture.press_enter();
    let (code, said) = capture.finish();
    assert_eq!(code, Some(1), "{said}");
    assert_says(&said, &["the server says that it has arrived, and it stands", "mm away"]);

    // Nobody there to say that it may move.
    let alone = run(["capture", &config, "--out", &bench.text("captured")]).refused();
    assert_says(&alone, &["standard input has ended, so that nobody can say that the machine may move"]);
}

#[test]
fn what_cannot_be_driven_is_refused_before_anything_is_opened() {
    let bench = Bench::empty();
    plan(&bench);
    let refused = |drive: &str, words: &[&str]| {
        let config = config(&bench, "127.0.0.1:9", "127.0.0.1:9", drive);
        assert_says(&run(["capture", &config, "--out", &bench.text("captured")]).refused(), words);
    };
    refused("[drive]\nspeed_mm_s = 0.0", &["capture.toml", "drive.speed_mm_s: must be a number above 0"]);
    refused(
        "[drive]\nspeed_mm_s = 50.0\nover_z_mm = 200.0",
        &["drive.over_z_mm: must be between 250.000, the highest point"],
    );
    refused("[drive]\nspeed_mm_s = 50.0\nover_z_mm = 2000.0", &["drive.over_z_mm", "the end of the stroke"]);
    refused("[drive]\nspeed_mm_s = 50.0\nwait_s = 0.1", &["drive.wait_s: must be more than standstill.longest_s"]);
    refused("[drive]\n", &["speed_mm_s"]);
    let config = config(&bench, "127.0.0.1:9", "127.0.0.1:9", "");
    let preview = run(["capture", &config, "--out", &bench.text("captured"), "--preview"]).refused();
    assert_says(&preview, &["has no table drive"]);
    let content = fs::read_to_string(&config).unwrap();
    let begin = content.find("[scale]").unwrap();
    let end = content.find("[tracer]").unwrap();
    let lines = "[scale]\nkind = \"lines\"\nfrom = { tcp = \"127.0.0.1:9\" }\ncolumns = [\"x_mm\", \"y_mm\", \"z_mm\"]\noffset_mm = [0.0, 0.0, 0.0]\n";
    bench.write("capture.toml", format!("{}{lines}{}[drive]\nspeed_mm_s = 5.0\n", &content[..begin], &content[end..]));
    assert_says(
        &run(["capture", &config, "--out", &bench.text("captured")]).refused(),
        &["drive: moves a machine by its server of I++ DME alone"],
    );
}
