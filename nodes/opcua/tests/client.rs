//! Evidence for the client against a server that is not ours: subscription and reading, login and policies, units, what is missing
//! or bad, servers that die, fall silent, send garbage or a flood.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod peer;

use abbe_opcua::client::{Asks, Client, Event, Found, Security, Settings, User, Values};
use abbe_opcua::join::{AxisValue, JoinBy, Joined, Joiner, Told};
use abbe_opcua::node::NodeName;
use peer::{Peer, now_ms};
use std::io::Write;
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::{Duration, Instant};

/// Longer than anything takes here, so that a test fails and does not hang.
const PATIENCE: Duration = Duration::from_secs(120);

fn settings(server: &str) -> Settings {
    let node = |name: &str| NodeName::parse(&format!("nsu=urn:peer:axes;s={name}")).unwrap();
    Settings {
        server: server.to_owned(),
        security: Security::None,
        signed_only: false,
        user: None,
        certificates: None,
        nodes: ["X", "Y", "Z", "T"].map(node).to_vec(),
        asks: Asks::Subscribed(Duration::from_millis(50)),
        silent_after: Duration::from_secs(5),
    }
}

fn open(settings: &Settings) -> Client {
    let wait = Box::new(|_| Duration::from_millis(200));
    Client::open(settings.clone(), Box::new(|_| Ok(())), wait).unwrap()
}

/// Waits for an event of this kind; the others are passed over.
fn wait_for<T>(client: &mut Client, what: &str, mut wanted: impl FnMut(Event) -> Option<T>) -> T {
    let until = Instant::now() + PATIENCE;
    let mut last = String::new();
    while Instant::now() < until {
        let Some(event) = client.next(Duration::from_millis(100)) else { continue };
        last = format!("{event:?}");
        if let Some(found) = wanted(event) {
            return found;
        }
    }
    panic!("no {what} that was waited for; the last event is {last}");
}

fn connected(client: &mut Client) -> Vec<Found> {
    wait_for(client, "session", |event| if let Event::Connected(found) = event { Some(found) } else { None })
}

fn lost(client: &mut Client) -> String {
    wait_for(client, "loss", |event| if let Event::Lost(why) = event { Some(why) } else { None })
}

/// The next value of a node that is no first one.
fn value(client: &mut Client, node: usize, source_ms: Option<i64>) -> Result<f64, String> {
    wait_for(client, "value", |event| {
        let Event::Values(values) = event else { return None };
        let found = values
            .values
            .into_iter()
            .find(|value| value.node == node && value.source_ns == source_ms.map(|ms| ms * 1_000_000));
        found.map(|value| value.value)
    })
}

fn told(values: Values) -> Told {
    let axis = |value: &abbe_opcua::client::NodeValue| {
        let one =
            AxisValue { value: value.value.clone(), source_ns: value.source_ns, is_after_loss: value.is_after_loss };
        (value.node, one)
    };
    let axes = values.values.iter().filter(|value| value.node < 3).map(axis).collect();
    Told { arrived_ns: values.arrived_ns, answer: values.is_answer.then_some(values.server_ns), axes }
}

/// Samples until one is of this instant (ms): stamps (ms) with the values.
fn samples(client: &mut Client, joiner: &mut Joiner, last_ms: i64) -> Vec<(i64, [f64; 3])> {
    let until = Instant::now() + PATIENCE;
    let mut samples = Vec::new();
    while Instant::now() < until {
        match client.next(Duration::from_millis(100)) {
            Some(Event::Connected(_)) => joiner.begin(),
            Some(Event::Values(values)) => {
                for one in joiner.take(told(values)) {
                    match one {
                        Joined::Sample { at_ns, values } => samples.push((at_ns / 1_000_000, values)),
                        Joined::Refused(problem) => println!("refused: {problem}"),
                    }
                }
            }
            Some(other) => println!("{other:?}"),
            None => {}
        }
        if samples.last().is_some_and(|(at_ms, _)| *at_ms >= last_ms) {
            return samples;
        }
    }
    panic!("no sample of {last_ms}: {samples:?}");
}

#[test]
fn val_asyncua_axes_of_one_instant_are_samples_with_its_time() {
    let Some(mut peer) =
        Peer::start(Peer::free_port(), "{\"units\": {\"X\": 5066068, \"T\": 4932940, \"Y\": \"urn:other\"}}")
    else {
        return;
    };
    for asks in [Asks::Subscribed(Duration::from_millis(50)), Asks::Polled(Duration::from_millis(20))] {
        let mut client = open(&Settings { asks, ..settings(&peer.address) });
        let found = connected(&mut client);
        assert_eq!(found.iter().map(|found| found.problem.clone()).collect::<Vec<_>>(), vec![None; 4]);
        let suffixes: Vec<_> = found.iter().map(|found| found.unit.as_ref().map(|unit| unit.suffix())).collect();
        assert_eq!(suffixes, [Some(Some("_mm")), Some(None), None, Some(Some("_k"))], "known, unknown, none");
        let mut joiner = Joiner::new(JoinBy::Source { apart_ns: 0 });
        // How things stand when a session begins makes no sample.
        wait_for(&mut client, "first values", |event| {
            if let Event::Values(values) = event {
                drop(joiner.take(told(values)));
                Some(())
            } else {
                None
            }
        });
        let begin = now_ms();
        let mut all = Vec::new();
        for k in 0..5 {
            let mm = [f64::from(k), 20.0 + f64::from(k), 300.0];
            peer.axes(begin + i64::from(k), mm);
            all.extend(samples(&mut client, &mut joiner, begin + i64::from(k)));
        }
        let expected: Vec<_> =
            (0..5).map(|k| (begin + i64::from(k), [f64::from(k), 20.0 + f64::from(k), 300.0])).collect();
        assert_eq!(all, expected, "{asks:?}");
    }
}

#[test]
fn bad_and_missing_values_say_so_and_are_never_the_ones_before() {
    let Some(mut peer) = Peer::start(Peer::free_port(), "{\"missing\": [\"Z\"]}") else { return };
    let mut client = open(&settings(&peer.address));
    let found = connected(&mut client);
    assert!(found[2].problem.as_ref().unwrap().contains("BadNodeIdUnknown"), "{found:?}");
    assert_eq!(found[3].problem, None);
    let at = now_ms();
    peer.tell(&format!("[[\"T\",293.15,{at},0]]"));
    assert_eq!(value(&mut client, 3, Some(at)), Ok(293.15));
    // BadSensorFailure, UncertainLastUsableValue, no number.
    for (k, (number, status, words)) in [
        ("null", 0x808C_0000_u32, "BadSensorFailure"),
        ("293.15", 0x4090_0000, "UncertainLastUsableValue"),
        ("NaN", 0, "no number"),
    ]
    .into_iter()
    .enumerate()
    {
        let at = at + 1 + k as i64;
        peer.tell(&format!("[[\"T\",{number},{at},{status}]]"));
        let problem = value(&mut client, 3, Some(at)).unwrap_err();
        assert!(problem.contains(words), "{problem}");
    }
    peer.tell(&format!("[[\"T\",294.15,{},0]]", at + 9));
    assert_eq!(value(&mut client, 3, Some(at + 9)), Ok(294.15));
}

#[test]
fn a_server_that_is_killed_is_found_again_and_nothing_is_given_twice() {
    let port = Peer::free_port();
    let Some(mut peer) = Peer::start(port, "{}") else { return };
    let mut client = open(&settings(&peer.address));
    let mut joiner = Joiner::new(JoinBy::Source { apart_ns: 0 });
    connected(&mut client);
    let first = now_ms();
    peer.axes(first, [0.0; 3]);
    let (mut all, mut at) = (Vec::new(), first);
    for round in 0..3 {
        // What a session finds makes no sample: the instants after it do.
        let begun = all.len();
        while all.len() < begun + 5 {
            at = now_ms().max(at + 1);
            peer.axes(at, [all.len() as f64, f64::from(round), 7.0]);
            std::thread::sleep(Duration::from_millis(20));
            if let Some(Event::Values(values)) = client.next(Duration::from_millis(50)) {
                all.extend(joiner.take(told(values)));
            }
        }
        drop(peer);
        let why = lost(&mut client);
        assert!(!why.is_empty());
        // Nobody there: it is tried on.
        lost(&mut client);
        peer = Peer::start(port, "{}").unwrap();
        connected(&mut client);
        joiner.begin();
        // The server says its last value again, as servers do that keep it.
        peer.axes(at, [0.0; 3]);
    }
    let stamps: Vec<i64> = all
        .iter()
        .filter_map(|one| match one {
            Joined::Sample { at_ns, .. } => Some(*at_ns),
            Joined::Refused(_) => None,
        })
        .collect();
    assert!(stamps.len() >= 10 && stamps.windows(2).all(|pair| pair[0] < pair[1]), "{all:?}");
}

#[test]
fn a_server_that_falls_silent_is_given_up_and_tried_again() {
    let Some(mut peer) = Peer::start(Peer::free_port(), "{}") else { return };
    for asks in [Asks::Subscribed(Duration::from_millis(50)), Asks::Polled(Duration::from_millis(50))] {
        let mut client = open(&Settings { silent_after: Duration::from_secs(2), asks, ..settings(&peer.address) });
        connected(&mut client);
        // One that says nothing because nothing changes is not silent.
        let until = Instant::now() + Duration::from_secs(5);
        while Instant::now() < until {
            let event = client.next(Duration::from_millis(100));
            assert!(!matches!(event, Some(Event::Lost(_))), "{event:?}");
        }
        peer.signal("STOP");
        let since = Instant::now();
        let why = lost(&mut client);
        assert!(why.contains("silent") || why.contains("Timeout"), "{why}");
        assert!(since.elapsed() < Duration::from_secs(30));
        peer.signal("CONT");
        connected(&mut client);
        let at = now_ms();
        peer.axes(at, [1.0, 2.0, 3.0]);
        assert_eq!(value(&mut client, 1, Some(at)), Ok(2.0));
    }
}

#[test]
fn a_flood_is_counted_to_the_last_sample() {
    const COUNT: i64 = 800;
    let Some(mut peer) = Peer::start(Peer::free_port(), "{}") else { return };
    let mut client = open(&settings(&peer.address));
    let mut joiner = Joiner::new(JoinBy::Source { apart_ns: 0 });
    connected(&mut client);
    wait_for(&mut client, "first values", |event| {
        if let Event::Values(values) = event {
            drop(joiner.take(told(values)));
            Some(())
        } else {
            None
        }
    });
    let begin = now_ms();
    peer.tell(&format!("[\"flood\", {COUNT}, {begin}]"));
    let all = samples(&mut client, &mut joiner, begin + COUNT - 1);
    let expected: Vec<_> = (0..COUNT).map(|k| (begin + k, [k as f64; 3])).collect();
    assert_eq!(all.len(), expected.len());
    assert!(all == expected);
}

#[test]
fn garbage_and_silence_on_the_port_are_losses_and_nothing_else() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("opc.tcp://{}/x", listener.local_addr().unwrap());
    let serving = std::thread::spawn(move || {
        for (k, stream) in listener.incoming().take(4).enumerate() {
            let mut stream = stream.unwrap();
            let garbage: &[u8] = match k {
                0 => &[0xFF; 4096],
                1 => b"HTTP/1.1 400 Bad Request\r\n\r\n",
                // An acknowledgement that promises four gigabytes.
                2 => b"ACKF\xff\xff\xff\xff",
                _ => b"",
            };
            let _ = stream.write_all(garbage);
            std::thread::sleep(Duration::from_millis(300));
        }
    });
    let mut client = open(&Settings { silent_after: Duration::from_secs(1), ..settings(&address) });
    for _ in 0..4 {
        assert!(!lost(&mut client).is_empty());
    }
    serving.join().unwrap();
    let since = Instant::now();
    drop(client);
    assert!(since.elapsed() < Duration::from_secs(20), "it ends when told to");
}

/// The server's certificate, as somebody who trusts it moves it.
fn trust(pki: &Path) {
    for entry in std::fs::read_dir(pki.join("rejected")).unwrap() {
        let from = entry.unwrap().path();
        std::fs::rename(&from, pki.join("trusted").join(from.file_name().unwrap())).unwrap();
    }
}

#[test]
fn val_asyncua_login_with_each_policy_and_not_with_a_wrong_password() {
    let folder = std::env::temp_dir().join(format!("abbe-opcua-test-{}", std::process::id()));
    let (own, pki) = (folder.join("server"), folder.join("client"));
    std::fs::create_dir_all(&own).unwrap();
    let asked = format!(
        "{{\"user\": \"meter\", \"password\": \"g\u{e4}uge block\", \"folder\": {:?}}}",
        own.display().to_string()
    );
    let Some(mut peer) = Peer::start(Peer::free_port(), &asked) else { return };
    let user = |password: &str| Some(User { name: "meter".to_owned(), password: password.to_owned() });
    let with = |security, signed_only, user| Settings {
        security,
        signed_only,
        user,
        certificates: Some(pki.clone()),
        ..settings(&peer.address)
    };
    // Nobody trusts the server yet.
    let mut client = open(&with(Security::Basic256Sha256, false, user("g\u{e4}uge block")));
    let why = lost(&mut client);
    assert!(why.contains("untrusted") || why.contains("BadCertificateUntrusted"), "{why}");
    drop(client);
    let key = std::fs::metadata(pki.join("private/private.pem")).unwrap().permissions().mode();
    assert_eq!(key & 0o077, 0, "nobody else reads the private key");
    let unwritable =
        Settings { certificates: Some("/dev/null/pki".into()), ..with(Security::Basic256Sha256, false, None) };
    let why = lost(&mut open(&unwritable));
    assert!(why.contains("/dev/null/pki/private/private.pem"), "{why}");
    trust(&pki);
    for (security, signed_only) in [
        (Security::Basic256Sha256, false),
        (Security::Basic256Sha256, true),
        (Security::Aes128Sha256RsaOaep, false),
        (Security::Aes256Sha256RsaPss, false),
    ] {
        let mut client = open(&with(security, signed_only, user("g\u{e4}uge block")));
        connected(&mut client);
    }
    let address = peer.address.clone();
    let mut client = open(&Settings {
        asks: Asks::Polled(Duration::from_millis(50)),
        ..with(Security::Basic256Sha256, false, user("g\u{e4}uge block"))
    });
    connected(&mut client);
    let at = now_ms();
    peer.tell(&format!("[[\"T\",293.15,{at},0]]"));
    assert_eq!(value(&mut client, 3, Some(at)), Ok(293.15));
    for (settings, words) in [
        (Settings { user: user("wrong word"), ..self::settings(&address) }, "does not offer"),
        (
            Settings {
                security: Security::Basic256Sha256,
                certificates: Some(pki.clone()),
                user: user("wrong word"),
                ..self::settings(&address)
            },
            "Bad",
        ),
        (
            Settings {
                security: Security::Basic256Sha256,
                certificates: Some(pki.clone()),
                ..self::settings(&address)
            },
            "does not take anonymous",
        ),
    ] {
        let mut client = open(&settings);
        let why = lost(&mut client);
        assert!(why.contains(words) && !why.contains("wrong word"), "{why}");
        assert!(!format!("{settings:?}").contains("wrong word"));
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// What a session finds of nodes by these names.
fn found_of(address: &str, names: &[&str]) -> Vec<Found> {
    let nodes = names.iter().map(|name| NodeName::parse(name).unwrap()).collect();
    connected(&mut open(&Settings { nodes, ..settings(address) }))
}

#[test]
fn val_asyncua_axes_of_a_cnc_are_found_by_their_names_with_their_unit_and_give_values() {
    let axis = "{\"unit\": 5066068, \"rotational\": false, \"referenced\": true, \"places\": [\"PosDirect\", \"PosIndirect\"]}";
    let asked = format!("{{\"cnc\": {{\"Mill\": {{\"X1\": {axis}, \"Y1\": {axis}, \"Z1\": {axis}}}}}}}");
    let Some(mut peer) = Peer::start(Peer::free_port(), &asked) else { return };
    let names = ["opc40502:X1", "opc40502:Mill/Y1", "opc40502-indirect:Z1", "nsu=urn:peer:axes;s=T"];
    let nodes = names.map(|name| NodeName::parse(name).unwrap()).to_vec();
    let mut client = open(&Settings { nodes, ..settings(&peer.address) });
    let found = connected(&mut client);
    assert_eq!(found.iter().map(|found| found.problem.clone()).collect::<Vec<_>>(), vec![None; 4]);
    let units: Vec<_> = found.iter().map(|found| found.unit.as_ref().and_then(|unit| unit.suffix())).collect();
    assert_eq!(units, [Some("_mm"), Some("_mm"), Some("_mm"), None]);
    let at_ms = now_ms();
    let told = [("Mill.X1.PosDirect", 1.5), ("Mill.Y1.PosDirect", -2.5), ("Mill.Z1.PosIndirect", 3.5)];
    for (node, (name, mm)) in told.into_iter().enumerate() {
        // The other measuring system of the axis says something else.
        let other = if name.ends_with("PosDirect") {
            name.replace("PosDirect", "PosIndirect")
        } else {
            name.replace("PosIndirect", "PosDirect")
        };
        peer.tell(&format!("[[{other:?},99.0,{at_ms},0],[{name:?},{mm:?},{at_ms},0]]"));
        assert_eq!(value(&mut client, node, Some(at_ms)), Ok(mm), "{name}");
    }
}

#[test]
fn val_asyncua_axes_of_a_cnc_that_are_not_plain_are_refused_with_what_to_do() {
    let asked = "{\"cnc\": {\"Mill\": {\"X\": {}, \"C\": {\"rotational\": true}, \"Y\": {\"referenced\": false}, \
                 \"Z\": {\"places\": [\"PosIndirect\"]}, \"Q\": {\"places\": []}}, \"Lathe\": {\"X\": {}}}}";
    let Some(peer) = Peer::start(Peer::free_port(), asked) else { return };
    let names =
        ["opc40502:X", "opc40502:Mill/X", "opc40502:Saw/X", "opc40502:Lathe/W", "opc40502:Mill/C", "opc40502:Mill/Y"];
    let more = ["opc40502:Mill/Z", "opc40502-indirect:Mill/Z", "opc40502-indirect:Mill/Q"];
    let found = found_of(&peer.address, &[&names[..], &more].concat());
    let problems: Vec<&str> = found.iter().map(|found| found.problem.as_deref().unwrap_or("")).collect();
    for (problem, words) in problems.iter().zip([
        "opc40502:X: the server has several CNC interfaces that fit (Mill, Lathe)",
        "",
        "no CNC interface has that name; there is Mill, Lathe",
        "no axis of that name; there is X",
        "the axis turns (IsRotational)",
        "the axis is not referenced (IsReferenced); home the machine",
        "no PosDirect with an ActPos; where the motor's",
        "",
        "no PosIndirect with an ActPos",
    ]) {
        assert!(problem.contains(words) && problem.is_empty() == words.is_empty(), "{problem:?} {words:?}");
    }
    let Some(plain) = Peer::start(Peer::free_port(), "{}") else { return };
    let found = found_of(&plain.address, &["opc40502:X", "nsu=urn:peer:axes;s=X"]);
    assert!(found[0].problem.as_ref().unwrap().contains("does not follow OPC 40502"), "{found:?}");
    assert_eq!(found[1].problem, None);
}
