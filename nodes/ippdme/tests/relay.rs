//! Evidence for the relay: positions leave corrected or as an error, all else leaves as it came. The server of these tests has a
//! known geometry and shares no code with the crate.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

mod cmm;
#[path = "cmm/errors.rs"]
mod errors;

use abbe_ippdme::line;
use abbe_ippdme::message::{ReplyKind, Response};
use abbe_ippdme::relay::{Correct, Offsets, Out, Purpose, Relay, Settings};
use abbe_ippdme::trouble::Trouble;
use cmm::{Cmm, placed};
use proptest::prelude::*;
use std::collections::BTreeMap;

/// Errors of a machine (m): some hundred micrometres, other at each place and with each tool. Beyond two metres it is refused.
#[derive(Default)]
struct Errors {
    asked: Vec<[f64; 3]>,
}

fn actual_m(indicated_m: [f64; 3], offset_m: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = indicated_m;
    [
        x + 1e-4 * (y * 3.0).sin() + 2e-4 * offset_m[2],
        y - 8e-5 * x * z + 1e-4 * offset_m[0],
        z + 5e-5 * (x + y) + 3e-5 * (x * 5.0).cos() - 1e-4 * offset_m[1],
    ]
}

impl Correct for Errors {
    fn corrected_m(&mut self, indicated_m: [f64; 3], offset_m: [f64; 3], purpose: Purpose) -> Result<[f64; 3], String> {
        if indicated_m.iter().any(|m| m.abs() > 2.0) {
            return Err("too far out".to_owned());
        }
        if purpose == Purpose::Report {
            self.asked.push(indicated_m);
        }
        Ok(actual_m(indicated_m, offset_m))
    }
}

fn actual_mm(tip_mm: [f64; 3], offset_mm: [f64; 3]) -> [f64; 3] {
    actual_m(tip_mm.map(|mm| mm / 1e3), offset_mm.map(|mm| mm / 1e3)).map(|m| m * 1e3)
}

/// Software, relay and server on one thread.
struct Bench {
    relay: Relay,
    cmm: Cmm,
    errors: Errors,
    said: Vec<String>,
    closed: Option<String>,
    number: u32,
}

fn tools() -> Offsets {
    let by_tool_m: BTreeMap<_, _> =
        Cmm::default().tools_mm.into_iter().map(|(name, mm)| (name, mm.map(|mm| mm / 1e3))).collect();
    Offsets { by_tool_m, ..Offsets::default() }
}

impl Bench {
    fn new(settings: Settings, cmm: Cmm) -> Bench {
        let relay = Relay::new(settings);
        let (said, closed) = (Vec::new(), None);
        let mut bench = Bench { relay, cmm, errors: Errors::default(), said, closed, number: 0 };
        bench.ask("StartSession()");
        bench
    }

    fn usual() -> Bench {
        Bench::new(Settings { offsets: tools(), scans_as_asked: true, ..Settings::default() }, Cmm::default())
    }

    /// Takes what comes out, until nothing more does; gives what the software hears.
    fn settle(&mut self, outs: Vec<Out>) -> Vec<String> {
        let (mut heard, mut open) = (Vec::new(), std::collections::VecDeque::from(outs));
        while let Some(out) = open.pop_front() {
            match out {
                Out::ToClient(line) => heard.push(String::from_utf8(line::text(&line).to_vec()).unwrap()),
                Out::ToServer(line) => {
                    let command = String::from_utf8_lossy(line::text(&line)).into_owned();
                    for answer in self.cmm.take(&command) {
                        open.extend(self.relay.from_server(format!("{answer}\r\n").as_bytes(), &mut self.errors));
                    }
                }
                Out::Say(words) => self.said.push(words),
                Out::Close(why) => self.closed = Some(why),
            }
        }
        heard
    }

    fn line(&mut self, line: &str) -> Vec<String> {
        let outs = self.relay.from_client(format!("{line}\r\n").as_bytes(), &mut self.errors);
        self.settle(outs)
    }

    /// A command; its answers without the tag, `&` and `%`, which have to be there.
    fn ask(&mut self, command: &str) -> Vec<String> {
        self.number += 1;
        let tag = format!("{:05}", self.number);
        let heard = self.line(&format!("{tag} {command}"));
        let own: Vec<&str> = heard.iter().filter_map(|line| line.strip_prefix(&tag)).collect();
        assert_eq!((own.first(), own.last()), (Some(&" &"), Some(&" %")), "{command}: {heard:?}");
        own[1..own.len() - 1].iter().map(|line| line.trim_start().to_owned()).collect()
    }

    fn server_says(&mut self, line: &str) -> Vec<String> {
        let outs = self.relay.from_server(format!("{line}\r\n").as_bytes(), &mut self.errors);
        self.settle(outs)
    }

    /// The corrected tip in the active system, from the geometry itself.
    fn expected_mm(&self) -> [f64; 3] {
        let corrected = actual_mm(self.cmm.tip_mm(), self.cmm.offset_mm());
        placed(self.cmm.placed.get(&self.cmm.csy).copied().unwrap_or_default(), corrected)
    }
}

/// The coordinates of a line with names.
fn coordinates(line: &str) -> [f64; 3] {
    let text = format!("00001 {line}");
    let items = Response::parse(text.as_bytes()).unwrap().items().unwrap();
    ["X", "Y", "Z"].map(|axis| items.iter().find_map(|item| item.number_of(axis)).unwrap_or_else(|| panic!("{line}")).0)
}

/// What the server's own rounding to 10 nm leaves, and the last digit written.
fn assert_near(told: [f64; 3], expected: [f64; 3]) {
    let apart = (0..3).map(|d| (told[d] - expected[d]).abs()).fold(0.0, f64::max);
    assert!(apart < 1.2e-5, "{told:?} and {expected:?} are {apart} mm apart");
}

fn error_of(answers: &[String]) -> Trouble {
    let [error] = answers else { panic!("one error: {answers:?}") };
    let text = format!("00001 {error}");
    let response = Response::parse(text.as_bytes()).unwrap();
    assert_eq!(response.kind, ReplyKind::Error, "{error}");
    Trouble::parse(response.data())
}

#[test]
fn every_report_of_a_position_comes_out_corrected() {
    let mut bench = Bench::usual();
    bench.ask("GoTo(X(310), Y(-120), Z(45))");
    let told = bench.ask("Get(X(), Y(), Z(), R())");
    assert_near(coordinates(&told[0]), bench.expected_mm());
    assert!(told[0].ends_with(", R(0.00000)"), "{told:?}");
    let told = bench.ask("PtMeas(X(20), Y(30), Z(-40), IJK(0,0,1))");
    assert_near(coordinates(&told[0]), bench.expected_mm());
    bench.ask("OnPtMeasReport(Z(), X(), ER(), IJK())");
    let told = bench.ask("PtMeas(X(21), Y(30), Z(-40), IJK(0,0,1))");
    let expected = bench.expected_mm();
    assert!(told[0].starts_with(&format!("# Z({:.4}", expected[2])[..8]), "{told:?} {expected:?}");
    assert!(told[0].ends_with("ER(1.50000), IJK(0.00000, 0.00000, 1.00000)") && !told[0].contains('Y'), "{told:?}");
    let scan = bench.ask("ScanOnLine(0, 10, 20, 100, 10, 20, 0, 0, 1, 10)");
    assert_eq!(scan.len(), 3);
    let values: Vec<f64> = scan.join(", ").replace("# ", "").split(", ").map(|v| v.parse().unwrap()).collect();
    for (k, point) in values.chunks(4).enumerate() {
        let offset = bench.cmm.offset_mm();
        assert_near([point[0], point[1], point[2]], actual_mm([10.0 * k as f64, 10.0, 20.0], offset));
        assert_eq!(point[3], 0.0);
    }
    assert_eq!(bench.relay.counts().refused, 0);
    assert_eq!(bench.relay.counts().corrected, 6);
}

#[test]
fn reports_of_moves_and_points_of_the_operator_come_out_corrected() {
    let mut bench = Bench::usual();
    let heard = bench.line("E0007 OnMoveReportE(Time(1), Dis(20), X())");
    assert_eq!(heard, ["E0007 &", "E0007 %"]);
    let heard = bench.line("00100 GoTo(X(77), Y(1), Z(2))");
    let report = heard.iter().find_map(|line| line.strip_prefix("E0007 # ")).unwrap();
    assert_eq!(report, format!("X({:.7})", bench.expected_mm()[0]), "only what was asked for");
    bench.ask("EnableUser()");
    let picked = bench.cmm.picked();
    let heard = bench.server_says(&picked);
    let inside = heard[0].strip_prefix("E0000 # PtMeas(").unwrap().strip_suffix(')').unwrap();
    assert_near(coordinates(&format!("# {inside}")), bench.expected_mm());
}

#[test]
fn points_of_a_part_are_the_corrected_points_of_the_machine_turned_and_shifted() {
    for numbers in [
        [0.0; 6],
        [5.0, -6.0, 7.0, 0.0, 0.0, 0.0],
        [100.0, 20.0, -30.0, 33.0, 71.0, -12.5],
        [0.0, 0.0, 0.0, 180.0, 40.0, 0.0],
    ] {
        let mut bench = Bench::usual();
        bench.ask(&format!("SetCsyTransformation(PartCsy, {})", numbers.map(|n| n.to_string()).join(", ")));
        bench.ask("SetCoordSystem(PartCsy)");
        let told = bench.ask("PtMeas(X(60), Y(70), Z(80), IJK(0,0,1))");
        assert_near(coordinates(&told[0]), bench.expected_mm());
        assert_eq!(bench.cmm.csy, "PartCsy", "the software's system stays selected");
        let asked = bench.errors.asked.len();
        let machine = bench.ask("SetCoordSystem(MachineCsy)");
        assert!(machine.is_empty());
        let told = bench.ask("Get(X(), Y(), Z())");
        assert_near(coordinates(&told[0]), actual_mm(bench.cmm.tip_mm(), bench.cmm.offset_mm()));
        assert_eq!(bench.errors.asked.len(), asked + 1, "the relay's own questions are no reports");
    }
}

#[test]
fn a_server_that_means_something_else_by_its_transformation_is_noticed() {
    let cmm = Cmm { turns_wrongly: true, ..Cmm::default() };
    let mut bench = Bench::new(Settings { offsets: tools(), scans_as_asked: true, ..Settings::default() }, cmm);
    bench.ask("SetCsyTransformation(PartCsy, 1, 2, 3, 0, 30, 0)");
    bench.ask("SetCoordSystem(PartCsy)");
    let error = error_of(&bench.ask("Get(X(), Y(), Z())"));
    assert!(error.text.contains("off what its transformation says"), "{error:?}");
    assert_eq!(bench.cmm.csy, "PartCsy");
}

#[test]
fn regress_zeros_for_a_system_that_is_moved_are_noticed() {
    let cmm = Cmm { tells_zeros: true, ..Cmm::default() };
    let mut bench = Bench::new(Settings { offsets: tools(), scans_as_asked: true, ..Settings::default() }, cmm);
    bench.ask("SetCsyTransformation(PartCsy, -100, -100, 0, 0, 0, 0)");
    bench.ask("SetCoordSystem(PartCsy)");
    let error = error_of(&bench.ask("Get(X(), Y(), Z())"));
    assert!(error.text.contains("off what its transformation says"), "{error:?}");
}

#[test]
fn regress_a_turn_is_not_taken_for_checked_where_it_does_not_show() {
    let cmm = Cmm { turns_wrongly: true, ..Cmm::default() };
    let mut bench = Bench::new(Settings { offsets: tools(), scans_as_asked: true, ..Settings::default() }, cmm);
    // On the axis of the turn, whatever its sense.
    bench.ask("GoTo(X(0), Y(0), Z(20))");
    bench.ask("SetCsyTransformation(PartCsy, 1, 2, 3, 0, 10, 0)");
    bench.ask("SetCoordSystem(PartCsy)");
    let error = error_of(&bench.ask("Get(X(), Y(), Z())"));
    assert!(error.text.contains("the other way would tell the same position"), "{error:?}");
}

#[test]
fn regress_positions_that_nobody_asked_for_do_not_pass() {
    let mut bench = Bench::usual();
    bench.ask("EnableUser()");
    for report in ["OnPtMeasReport()", "OnPtMeasReport(Q())", "OnPtMeasReport(R())"] {
        bench.ask(report);
        for told in ["PtMeas(X(400.5), Y(300.0), Z(180.0))", "PtMeas(400.5, 300, 180)", "PtMeas(Q(0), X(400.5))"] {
            let heard = bench.server_says(&format!("E0000 # {told}"));
            assert!(!heard.concat().contains("400.5"), "{report}: {heard:?}");
        }
    }
    for told in [
        "00002 & X(400.5), Y(300.0), Z(180.0)",
        "00002 % X(400.5), Y(300.0), Z(180.0)",
        "00002 ! X(400.5), Y(300.0), Z(180.0)",
        "00002 &\r00002 # X(400.5), Y(300.0), Z(180.0)",
    ] {
        let heard = bench.server_says(told);
        assert!(!heard.concat().contains("400.5"), "{told}: {heard:?}");
        assert!(bench.relay.counts().refused > 0);
    }
}

#[test]
fn systems_that_count_from_moved_ones_or_turn_with_a_table_are_refused() {
    let mut bench = Bench::usual();
    bench.ask("SetCsyTransformation(MultipleArmCsy, 1, 2, 3, 0, 0, 0)");
    bench.ask("SetCoordSystem(PartCsy)");
    assert!(error_of(&bench.ask("Get(X(), Y(), Z())")).text.contains("whether PartCsy counts from it is open"));
    let cmm = Cmm { has_table: true, ..Cmm::default() };
    let mut bench = Bench::new(Settings { offsets: tools(), scans_as_asked: true, ..Settings::default() }, cmm);
    assert_eq!(bench.ask("Get(X(), Y(), Z())").len(), 1, "machine coordinates do not turn");
    bench.ask("SetCoordSystem(PartCsy)");
    let error = error_of(&bench.ask("PtMeas(X(1), Y(2), Z(3))"));
    assert!(error.text.contains("rotary table"), "{error:?}");
    assert!(!bench.cmm.heard.iter().any(|line| line.contains("PtMeas")), "and the machine is not moved");
}

#[test]
fn each_tool_is_corrected_with_its_own_offset_and_one_without_is_refused() {
    let mut bench = Bench::usual();
    let told = bench.ask("Get(X(), Y(), Z())");
    assert_near(coordinates(&told[0]), bench.expected_mm());
    bench.ask("ChangeTool(\"Star\")");
    let told = bench.ask("Get(X(), Y(), Z())");
    assert_near(coordinates(&told[0]), bench.expected_mm());
    // The server changes the tool by itself.
    bench.cmm.tool = "RefTool".to_owned();
    assert_eq!(bench.server_says("E0000 # ChangeTool(\"RefTool\")"), ["E0000 # ChangeTool(\"RefTool\")"]);
    let told = bench.ask("Get(X(), Y(), Z())");
    assert_near(coordinates(&told[0]), bench.expected_mm());
    bench.cmm.tools_mm.insert("New".to_owned(), [0.0; 3]);
    bench.ask("ChangeTool(\"New\")");
    let error = error_of(&bench.ask("Get(X(), Y(), Z())"));
    assert!(error.text.contains("offset of tool New is not known"), "{error:?}");
    assert_eq!(error.number, Some(8502));
    // After a change that failed the server knows none, and no offset holds, not even one for all tools.
    let offsets = Offsets { of_any_m: Some([0.0; 3]), ..Offsets::default() };
    let cmm = Cmm { tool: "UnDefTool".to_owned(), ..Cmm::default() };
    let mut bench = Bench::new(Settings { offsets, ..Settings::default() }, cmm);
    assert!(error_of(&bench.ask("PtMeas(X(1), Y(2), Z(3))")).text.contains("does not know which tool"));
    // The direction of a tool that was turned is not in a list of names.
    let mut bench = Bench::usual();
    bench.ask("AlignTool(0, 0, 1, 0)");
    assert!(error_of(&bench.ask("Get(X(), Y(), Z())")).text.contains("was turned"));
    bench.ask("ClearAllErrors()");
    bench.ask("ChangeTool(\"Star\")");
    assert_near(coordinates(&bench.ask("Get(X(), Y(), Z())")[0]), bench.expected_mm());
    // Nor one that was turned at the panel; a property that moves no tip changes nothing.
    bench.server_says("E0000 # SetProp(Tool.GoToPar.Speed(10))");
    assert_near(coordinates(&bench.ask("Get(X(), Y(), Z())")[0]), bench.expected_mm());
    bench.server_says("E0000 # SetProp(Tool.A(90), Tool.B(0))");
    assert!(error_of(&bench.ask("Get(X(), Y(), Z())")).text.contains("was turned"));
}

#[test]
fn offsets_of_the_server_are_asked_for_in_the_machines_system() {
    let offsets = Offsets { from_server: true, ..Offsets::default() };
    let cmm = Cmm { tells_offsets: true, ..Cmm::default() };
    let mut bench = Bench::new(Settings { offsets: offsets.clone(), ..Settings::default() }, cmm);
    bench.ask("SetCsyTransformation(PartCsy, 10, 20, 30, 90, 0, 0)");
    bench.ask("SetCoordSystem(PartCsy)");
    bench.ask("ChangeTool(\"Star\")");
    assert_near(coordinates(&bench.ask("Get(X(), Y(), Z())")[0]), bench.expected_mm());
    let asked = bench.cmm.heard.iter().position(|line| line.contains("AvrOffsets")).unwrap();
    assert!(bench.cmm.heard[asked - 1].contains("SetCoordSystem(MachineCsy)"));
    // A server that has none says so, and its error is cleared for the software.
    let mut bench = Bench::new(Settings { offsets, ..Settings::default() }, Cmm::default());
    assert!(error_of(&bench.ask("Get(X(), Y(), Z())")).text.contains("does not tell the offset"));
    assert!(!bench.cmm.has_error);
}

#[test]
fn what_cannot_be_corrected_is_an_error_that_stands_until_it_is_cleared() {
    let mut bench = Bench::usual();
    bench.ask("GoTo(X(5000), Y(0), Z(0))");
    let error = error_of(&bench.ask("Get(X(), Y(), Z())"));
    assert_eq!((error.number, error.origin.as_str()), (Some(8501), "Get"));
    assert!(error.text.contains("too far out"));
    assert_eq!(error_of(&bench.ask("GoTo(X(1), Y(2), Z(3))")).number, Some(514));
    assert_eq!(bench.ask("GetErrStatusE()"), ["# ErrStatus(1)"]);
    assert!(bench.ask("GetXtdErrStatus()")[0].contains("8501"));
    bench.ask("ClearAllErrors()");
    assert_eq!(bench.ask("GetErrStatusE()"), ["# ErrStatus(0)"]);
    bench.ask("GoTo(X(1), Y(2), Z(3))");
    assert_near(coordinates(&bench.ask("Get(X(), Y(), Z())")[0]), bench.expected_mm());
    // Of a scan nothing passes after the first point that could not be corrected.
    let scan = bench.ask("ScanOnLine(1500, 0, 0, 2500, 0, 0, 0, 0, 1, 100)");
    assert_eq!(scan.len(), 2, "{scan:?}");
    assert!(scan[0].starts_with("# ") && scan[1].starts_with("! Error(2, 8501"), "{scan:?}");
}

#[test]
fn scans_are_refused_where_the_order_of_their_values_is_not_known() {
    let mut bench = Bench::new(Settings { offsets: tools(), ..Settings::default() }, Cmm::default());
    bench.ask("OnScanReport(Q(), X(), Y())");
    let error = error_of(&bench.ask("ScanOnLine(0, 10, 20, 100, 10, 20, 0, 0, 1, 10)"));
    assert!(error.text.contains("in which order this server writes them is open"), "{error:?}");
    assert!(!bench.cmm.heard.iter().any(|line| line.contains("ScanOnLine")), "and none is begun");
    // A quality that is none gives another order away.
    let mut bench = Bench::usual();
    let command = b"00900 ScanOnLine(0, 10, 20, 100, 10, 20, 0, 0, 1, 10)\r\n";
    bench.ask("Get(X(), Y(), Z())");
    bench.relay.from_client(command, &mut bench.errors);
    assert!(bench.server_says("00900 # 0.0, 310.0, 20.0, 150.0")[0].contains("another order"));
}

#[test]
fn where_it_is_allowed_points_pass_as_they_came_and_it_is_said() {
    let settings = Settings { offsets: tools(), passes_uncorrected: true, ..Settings::default() };
    let mut bench = Bench::new(settings, Cmm::default());
    bench.ask("GoTo(X(5000), Y(0), Z(0))");
    assert_eq!(bench.ask("Get(X(), Z())"), ["# X(5000.00000), Z(0.00000)"]);
    assert!(bench.said.iter().any(|words| words.contains("passed uncorrected: too far out")), "{:?}", bench.said);
    assert_eq!((bench.relay.counts().uncorrected, bench.relay.counts().corrected), (1, 0));
}

#[test]
fn regress_what_is_reported_while_the_relay_asks_in_the_machines_system_never_passes() {
    let settings = Settings { offsets: tools(), passes_uncorrected: true, ..Settings::default() };
    let mut bench = Bench::new(settings, Cmm { csy: "PartCsy".to_owned(), ..Cmm::default() });
    let lies_at = |bench: &mut Bench, x_mm: f64| {
        bench.cmm.placed.insert("PartCsy".to_owned(), [x_mm, 0.0, 0.0, 0.0, 0.0, 0.0]);
    };
    lies_at(&mut bench, 5000.0);
    bench.line("E0007 OnMoveReportE(Time(1), Dis(20), X())");
    let surveys = |bench: &Bench| bench.cmm.heard.iter().filter(|line| line.contains("(MachineCsy)")).count();
    assert_eq!(surveys(&bench), 1, "{:?}", bench.cmm.heard);
    // The server reports moves in whatever system is selected; here the part is 6 m from where the machine counts from.
    lies_at(&mut bench, 6000.0);
    let (held_before, heard) = (bench.relay.counts().refused, bench.server_says("E0000 # ChangeTool(\"Probe1\")"));
    assert_eq!(surveys(&bench), 2);
    let moves: Vec<&String> = heard.iter().filter(|line| line.starts_with("E0007 #")).collect();
    assert!(!moves.is_empty() && moves.iter().all(|line| line.contains("X(6200.")), "{heard:?}");
    assert_eq!(bench.relay.counts().refused, held_before + 1, "{heard:?}");
    // The same of points of the operator, targets and lines that nobody understands.
    lies_at(&mut bench, 7000.0);
    bench.cmm.picks_in_machine = true;
    let heard = bench.server_says("E0000 # ChangeTool(\"Probe1\")");
    assert_eq!(surveys(&bench), 3);
    assert!(heard.iter().all(|line| !line.contains("X(200.")), "{heard:?}");
    assert_eq!(heard.iter().filter(|line| line.contains(" ! Error(")).count(), 4, "{heard:?}");
}

#[test]
fn commands_that_are_not_known_make_everything_be_asked_again_and_give_no_positions() {
    let mut bench = Bench::usual();
    bench.ask("Get(X(), Y(), Z())");
    let surveys = |bench: &Bench| bench.cmm.heard.iter().filter(|line| line.contains("GetCoordSystem")).count();
    assert_eq!(surveys(&bench), 1);
    bench.ask("Get(X(), Y(), Z())");
    assert_eq!(surveys(&bench), 1, "known is known");
    bench.ask("CZ.Something(1)");
    bench.ask("Get(X(), Y(), Z())");
    assert_eq!(surveys(&bench), 2);
    bench.line("00900  SetCoordSystem(PartCsy)");
    bench.ask("Get(X(), Y(), Z())");
    assert_eq!(surveys(&bench), 3);
    // Its answers pass only where they hold no number.
    let outs = bench.relay.from_client(b"00901 CZ.Other()\r\n", &mut bench.errors);
    assert!(matches!(outs.as_slice(), [Out::ToServer(_)]));
    assert_eq!(bench.server_says("00901 # \"text\""), ["00901 # \"text\""]);
    assert!(bench.server_says("00901 # 1.0, 2.0, 3.0")[0].contains("! Error(2, 8501"));
    assert!(bench.server_says("00899 # X(1.0), Y(2.0), Z(3.0)")[0].contains("! Error(1, 8503"));
    assert!(bench.server_says("  garbage 1.25")[0].contains("! Error(1, 8503"));
    assert_eq!(bench.server_says("garbage"), ["garbage"]);
}

#[test]
fn targets_turned_back_bring_the_tip_where_it_was_told() {
    let settings = Settings { offsets: tools(), inverts_targets: true, scans_as_asked: true, ..Settings::default() };
    for numbers in [[0.0; 6], [100.0, 20.0, -30.0, 33.0, 71.0, -12.5]] {
        let cmm = Cmm { decimals: 9, ..Cmm::default() };
        let mut bench = Bench::new(settings.clone(), cmm);
        bench.ask(&format!("SetCsyTransformation(PartCsy, {})", numbers.map(|n| n.to_string()).join(", ")));
        bench.ask("SetCoordSystem(PartCsy)");
        bench.ask("ChangeTool(\"Star\")");
        let near = |told: [f64; 3], wanted: [f64; 3]| {
            let apart = (0..3).map(|d| (told[d] - wanted[d]).abs()).fold(0.0, f64::max);
            assert!(apart < 1e-6, "{apart} mm, a nanometre is allowed: {told:?}");
        };
        bench.ask("GoTo(X(310.5), Y(-120), Z(45))");
        near(coordinates(&bench.ask("Get(X(), Y(), Z())")[0]), [310.5, -120.0, 45.0]);
        near(bench.expected_mm(), [310.5, -120.0, 45.0]);
        // An axis that is not named stays where the tip is.
        bench.ask("GoTo(Y(200))");
        near(bench.expected_mm(), [310.5, 200.0, 45.0]);
        near(coordinates(&bench.ask("PtMeas(Z(3), IJK(0,0,1))")[0]), [310.5, 200.0, 3.0]);
        bench.ask("ScanOnLine(0, 10, 20, 100, 11, 21, 0, 0, 1, 10)");
        near(bench.expected_mm(), [100.0, 11.0, 21.0]);
        assert!(error_of(&bench.ask("ScanOnCurve(Closed(0))")).text.contains("not turned back"));
    }
}

#[test]
fn the_softwares_system_is_selected_again_whatever_happens() {
    // In the middle of a survey the software goes away.
    let mut bench = Bench::usual();
    bench.cmm.placed.insert("PartCsy".to_owned(), [1.0, 2.0, 3.0, 0.0, 0.0, 0.0]);
    bench.cmm.csy = "PartCsy".to_owned();
    let mut outs = bench.relay.from_client(b"00900 Get(X(), Y(), Z())\r\n", &mut bench.errors);
    while bench.cmm.csy == "PartCsy" {
        let [Out::ToServer(line)] = outs.as_slice() else { panic!("{outs:?}") };
        let answers = bench.cmm.take(std::str::from_utf8(line::text(line)).unwrap());
        outs = answers
            .iter()
            .flat_map(|a| bench.relay.from_server(format!("{a}\r\n").as_bytes(), &mut bench.errors))
            .collect();
    }
    let last = bench.relay.abandon();
    bench.settle(last);
    assert_eq!(bench.cmm.csy, "PartCsy");
    // A position that the server refuses in between is no reason to stay away.
    let mut bench = Bench::usual();
    bench.cmm.placed.insert("PartCsy".to_owned(), [1.0, 2.0, 3.0, 0.0, 0.0, 0.0]);
    bench.cmm.csy = "PartCsy".to_owned();
    bench.cmm.unknown.insert("Get".to_owned());
    let answers = bench.ask("Get(X(), Y(), Z())");
    assert!(error_of(&answers).number == Some(501), "the server's own error: {answers:?}");
    assert_eq!(bench.cmm.csy, "PartCsy");
}

/// Lines of commands that report no position, with any spaces and numbers.
fn no_position() -> impl Strategy<Value = String> {
    let name = prop::sample::select(vec![
        "Home",
        "IsHomed",
        "GetProp",
        "SetProp",
        "EnumTools",
        "GetDMEVersion",
        "FindTool",
        "GetErrorInfo",
        "LockAxis",
        "GetChangeToolAction",
        "AlignPart",
        "ScanUnknownHint",
    ]);
    (name, "[ (),.0-9A-Za-z\"]{0,40}").prop_map(|(name, inside)| format!("{name}({inside})"))
}

proptest! {
    #[test]
    fn what_is_no_position_passes_byte_for_byte(
        command in no_position(),
        end in prop::sample::select(vec!["\r\n", "\n"]),
        answers in prop::collection::vec(("[!#]", "[ -W\\[-~]{0,60}"), 0..4),
    ) {
        let mut bench = Bench::usual();
        let told = format!("00500 {command}{end}").into_bytes();
        let outs = bench.relay.from_client(&told, &mut bench.errors);
        prop_assert_eq!(outs, vec![Out::ToServer(told.clone())]);
        // Only where the command was understood is it known what its answers are.
        if abbe_ippdme::message::Command::parse(line::text(&told)).is_ok() {
            let mut lines = vec!["00500 &".to_owned()];
            lines.extend(answers.iter().map(|(kind, text)| format!("00500 {kind} {text}")));
            lines.push("00500 %".to_owned());
            for line in lines {
                let line = format!("{line}{end}").into_bytes();
                let outs = bench.relay.from_server(&line, &mut bench.errors);
                prop_assert_eq!(outs, vec![Out::ToClient(line)]);
            }
        }
    }

    /// Whatever either side sends: no end of the program, and no position that was not corrected.
    #[test]
    fn no_bytes_end_the_program_and_no_raw_position_passes(
        lines in prop::collection::vec((any::<bool>(), prop_oneof![
            prop::collection::vec(any::<u8>(), 0..40),
            "0000[1-4] (Get|PtMeas|ScanOnLine|GoTo|ChangeTool|CZ.A|StartSession|OnScanReport)\\((X\\(7\\.5\\)|X\\(\\)|Y\\(\\), Z\\(\\)|1,2)?\\)".prop_map(String::into_bytes),
            "(0000[1-4]|E000[01]|9000[1-9]) ([&%]|# (X\\(7\\.5\\)(, Y\\(7\\.5\\), Z\\(7\\.5\\))?|7\\.5, 7\\.5, 7\\.5(, 0)?|PtMeas\\(X\\(7\\.5\\), Y\\(7\\.5\\), Z\\(7\\.5\\)\\)|CoordSystem\\(PartCsy\\)))".prop_map(String::into_bytes),
        ]), 0..40),
    ) {
        let mut bench = Bench::usual();
        for (is_client, line) in lines {
            let line = [line.as_slice(), b"\r\n"].concat();
            let outs = match is_client {
                true => bench.relay.from_client(&line, &mut bench.errors),
                false => bench.relay.from_server(&line, &mut bench.errors),
            };
            for out in outs {
                if let Out::ToClient(line) = out {
                    prop_assert!(!String::from_utf8_lossy(&line).contains("7.5"), "{}", String::from_utf8_lossy(&line));
                }
            }
        }
    }
}

#[test]
fn each_error_that_the_specification_names_passes_as_it_came_and_a_position_beside_it_is_never_raw() {
    for (class, number) in errors::ERRORS {
        let mut bench = Bench::usual();
        let line = errors::told(class, number);
        assert_eq!(bench.server_says(&line), [line.as_str()]);
        // In the answer to a question for the position, which the server tells all the same.
        bench.cmm.fails = Some((class, number));
        let answers = bench.ask("Get(X(), Y(), Z())");
        assert_eq!(answers[0], format!("! Error({class}, {number:04}, \"Get\", \"told by a test\")"));
        for answer in &answers[1..] {
            assert_near(coordinates(answer), bench.expected_mm());
        }
        assert!(answers.len() == 2 || class >= 2, "a warning keeps nothing back: {answers:?}");
    }
}
