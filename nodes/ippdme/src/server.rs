//! A server of I++ DME for a machine that somebody else moves: session, coordinate system, tools, positions, reports on moves.
//!
//! Place in the flow: what a client sends and where the machine is in, the lines that answer it out; no socket, no clock. It serves
//! the rehearsal of a capture. Commands that move are refused where the machine follows its own path, and `GoTo` is an [`Order`] where
//! it obeys; commands that probe are refused in any case. Errors are those of the
//! specification: outside of a session only `StartSession` and `EndSession` are taken (0008), after an error only what cures it
//! (0514). Millimetres, in the coordinate system of the machine.

use crate::item::{Item, What};
use crate::message::{Command, NoMessage, Tag};
use std::collections::VecDeque;
use std::fmt::Write;

/// Coordinate systems that a client may select: the machine is in all of them as it is.
const SYSTEMS: [&str; 4] = ["MachineCsy", "MoveableMachineCsy", "MultipleArmCsy", "PartCsy"];
/// Commands that ask for a motion, or change what is not here.
const ELSEWHERE: [&str; 8] =
    ["GoTo", "PtMeas", "Home", "ChangeTool", "AlignTool", "ScanOnLine", "ScanOnCircle", "SetProp"];
/// What a position has.
const AXES: [&str; 3] = ["X", "Y", "Z"];

/// Where the machine is.
#[derive(Debug, Clone, PartialEq)]
pub struct Position {
    /// When (s).
    pub time_s: f64,
    /// Scales (mm).
    pub scales_mm: [f64; 3],
    /// Tool, or holder of the reflector, with its offset from the ram reference point (mm).
    pub tool: (String, [f64; 3]),
}

impl Position {
    fn tip_mm(&self, axis: usize) -> f64 {
        self.scales_mm[axis] + self.tool.1[axis]
    }
}

/// What a client wants the machine to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Order {
    /// Move in a straight line.
    Go {
        /// Scales at the end (mm).
        scales_mm: [f64; 3],
        /// Speed (mm/s).
        speed_mm_s: f64,
    },
    /// Stop where it is.
    Stop,
}

/// A report on moves that a client has asked for.
#[derive(Debug, Clone)]
struct Reports {
    tag: Tag,
    names: Vec<String>,
    every_s: f64,
    every_mm: f64,
    last: Option<Position>,
}

/// A client's session.
#[derive(Debug, Clone)]
pub struct Session {
    is_open: bool,
    has_error: bool,
    system: String,
    tool: Option<String>,
    reports: Vec<Reports>,
    tools: Vec<String>,
    /// Where the machine may go by its scales (mm), if it obeys.
    stroke_mm: Option<[(f64, f64); 3]>,
    speed_mm_s: f64,
    order: Option<Order>,
    /// The `GoTo` that is under way.
    going: Option<Tag>,
    /// What came meanwhile.
    queue: VecDeque<Vec<u8>>,
}

/// Speed of a machine that was told none (mm/s).
const SPEED_MM_S: f64 = 10.0;
/// Fastest that it takes (mm/s).
const FASTEST_MM_S: f64 = 500.0;
/// Commands that wait while it moves, at most.
const MOST_WAITING: usize = 1000;

/// An error: severity, number, text.
type Trouble = (u8, u16, &'static str);

impl Session {
    /// A connection on which nothing was said; with the names of all tools.
    pub fn new(tools: Vec<String>) -> Session {
        let system = SYSTEMS[0].to_owned();
        Session {
            is_open: false,
            has_error: false,
            system,
            tool: None,
            reports: Vec::new(),
            tools,
            stroke_mm: None,
            speed_mm_s: SPEED_MM_S,
            order: None,
            going: None,
            queue: VecDeque::new(),
        }
    }

    /// The same of a machine that obeys `GoTo` within these readings of its scales (mm).
    pub fn obeying(self, stroke_mm: [(f64, f64); 3]) -> Session {
        Session { stroke_mm: Some(stroke_mm), ..self }
    }

    /// What the machine has to do now.
    pub fn order(&mut self) -> Option<Order> {
        self.order.take()
    }

    /// The machine stands at the end of its way: lines that say so, and answers to what waited for it.
    pub fn arrived(&mut self, at: &Position) -> Vec<String> {
        if self.order.is_some() {
            return Vec::new();
        }
        let mut lines: Vec<String> = self.going.take().map(|tag| format!("{tag} %")).into_iter().collect();
        while self.going.is_none()
            && let Some(line) = self.queue.pop_front()
        {
            lines.extend(self.take(&line, at));
        }
        lines
    }

    /// Whether a client has begun one.
    pub fn is_open(&self) -> bool {
        self.is_open
    }

    /// Takes a line without its end, gives the lines that answer it.
    pub fn take(&mut self, line: &[u8], at: &Position) -> Vec<String> {
        let command = match Command::parse(line) {
            Ok(command) => command,
            Err(problem) => {
                self.has_error = self.is_open;
                let (number, text) = match problem {
                    NoMessage::Tag => (1, "Illegal tag"),
                    NoMessage::Space => (2, "No space at pos. 6"),
                    _ => (8, "Protocol error"),
                };
                return vec![error(Tag::UNSOLICITED, (2, number, text), "parser")];
            }
        };
        let tag = command.tag;
        if self.going.is_some() && matches!(tag, Tag::Command(_)) {
            // One after the other; only events are heard meanwhile.
            if self.queue.len() < MOST_WAITING {
                self.queue.push_back(line.to_vec());
                return Vec::new();
            }
            return vec![error(tag, (2, 0, "Buffer full"), &command.name)];
        }
        let mut lines = vec![format!("{tag} &")];
        if let (Some(stroke_mm), "GoTo", true, false) =
            (self.stroke_mm, command.name.as_str(), self.is_open, self.has_error)
        {
            match target(&command.arguments, at, &stroke_mm) {
                Ok(scales_mm) => {
                    self.order = Some(Order::Go { scales_mm, speed_mm_s: self.speed_mm_s });
                    self.going = Some(tag);
                }
                Err(trouble) => {
                    self.has_error = true;
                    lines.extend([error(tag, trouble, "GoTo"), format!("{tag} %")]);
                }
            }
            return lines;
        }
        if let ("AbortE", Some(going)) = (command.name.as_str(), self.going) {
            (self.order, self.going, self.has_error) = (Some(Order::Stop), None, true);
            self.queue.clear();
            let aborted = (2, 6, "Transaction aborted (Use ClearAllErrors To Continue)");
            lines.extend([error(going, aborted, "GoTo"), format!("{going} %"), format!("{tag} %")]);
            return lines;
        }
        match self.answer(&command, at) {
            Ok(answers) => lines.extend(answers.into_iter().map(|answer| format!("{tag} # {answer}"))),
            Err(trouble) => {
                self.has_error |= trouble.0 > 1;
                lines.push(error(tag, trouble, &command.name));
            }
        }
        lines.push(format!("{tag} %"));
        lines
    }

    /// What a client that asked for reports is told of this position.
    pub fn moved(&mut self, at: &Position) -> Vec<String> {
        let mut lines = Vec::new();
        // Only a tool that was changed after the session began is news.
        if self.is_open && self.tool.as_ref().is_some_and(|tool| *tool != at.tool.0) {
            lines.push(format!("{} # ChangeTool(\"{}\")", Tag::UNSOLICITED, at.tool.0));
        }
        self.tool = Some(at.tool.0.clone());
        for report in &mut self.reports {
            let is_due = match &report.last {
                None => true,
                Some(last) => {
                    let way_mm = (0..3).map(|d| (at.tip_mm(d) - last.tip_mm(d)).powi(2)).sum::<f64>().sqrt();
                    // A machine that stands says nothing.
                    way_mm >= report.every_mm || way_mm > 1e-3 && at.time_s - last.time_s >= report.every_s
                }
            };
            if is_due {
                lines.push(format!("{} # {}", report.tag, values(&report.names, at)));
                report.last = Some(at.clone());
            }
        }
        lines
    }

    fn answer(&mut self, command: &Command, at: &Position) -> Result<Vec<String>, Trouble> {
        let name = command.name.as_str();
        match name {
            "StartSession" if self.is_open => return Err((3, 8, "Protocol error")),
            "StartSession" | "EndSession" => {
                let new = Session::new(std::mem::take(&mut self.tools));
                let (is_open, stroke_mm) = (name == "StartSession", self.stroke_mm);
                *self = Session { is_open, stroke_mm, ..new };
                self.tool = Some(at.tool.0.clone());
                return Ok(Vec::new());
            }
            _ if !self.is_open => return Err((3, 8, "Protocol error")),
            "GetErrStatusE" => return Ok(vec![format!("ErrStatus({})", u8::from(self.has_error))]),
            "ClearAllErrors" => {
                self.has_error = false;
                return Ok(Vec::new());
            }
            _ if self.has_error => return Err((2, 514, "Use ClearAllErrors to continue")),
            _ => {}
        }
        let words = || command.arguments.iter().filter_map(|item| item.text().map(str::to_owned));
        Ok(match name {
            "GetDMEVersion" => vec!["DMEVersion(\"1.4.3\")".to_owned()],
            "GetMachineClass" => vec!["GetMachineClass(\"CartCMM\")".to_owned()],
            "IsHomed" => vec!["IsHomed(1)".to_owned()],
            "IsUserEnabled" => vec!["IsUserEnabled(0)".to_owned()],
            "EnableUser" | "DisableUser" => vec![],
            "GetCoordSystem" => vec![format!("CoordSystem({})", self.system)],
            "SetCoordSystem" => {
                self.system =
                    words().next().filter(|own| SYSTEMS.contains(&own.as_str())).ok_or((3, 509, "Bad argument"))?;
                vec![]
            }
            "GetCsyTransformation" => vec!["GetCsyTransformation(0, 0, 0, 0, 0, 0)".to_owned()],
            "EnumTools" => self.tools.iter().map(|tool| format!("\"{tool}\"")).collect(),
            "Get" => vec![values(&asked(&command.arguments)?, at)],
            "GetProp" | "GetPropE" if self.stroke_mm.is_some() && speed_of(&command.arguments).is_some() => {
                vec![format!("Tool.GoToPar.Speed({:?})", self.speed_mm_s)]
            }
            "SetProp" if self.stroke_mm.is_some() => {
                let speed_mm_s = speed_of(&command.arguments).flatten().ok_or((3, 510, "Bad property"))?;
                // What is too fast becomes the fastest, and the client asks what it got.
                self.speed_mm_s = if speed_mm_s > 0.0 { speed_mm_s.min(FASTEST_MM_S) } else { SPEED_MM_S };
                vec![]
            }
            "GetProp" | "GetPropE" => vec![property(&command.arguments, at)?],
            "OnMoveReportE" => return self.report(command),
            "StopAllDaemons" => {
                self.reports.clear();
                vec![]
            }
            "StopDaemon" => {
                let wanted = words().next().and_then(|tag| Tag::parse(tag.as_bytes()));
                let place = self.reports.iter().position(|report| Some(report.tag) == wanted);
                self.reports.remove(place.ok_or((2, 513, "Daemon does not exist"))?);
                vec![]
            }
            "AbortE" => vec![],
            _ if ELSEWHERE.contains(&name) => return Err((3, 508, "Bad context")),
            _ => return Err((3, 501, "Unsupported command")),
        })
    }

    fn report(&mut self, command: &Command) -> Result<Vec<String>, Trouble> {
        let Tag::Event(1..) = command.tag else { return Err((2, 1, "Illegal tag")) };
        if self.reports.iter().any(|report| report.tag == command.tag) {
            return Err((2, 515, "Daemon already exists"));
        }
        let number = |name: &str| command.arguments.iter().find_map(|item| Some(item.number_of(name)?.0));
        let is_asked = |item: &&Item| item.number_of("Time").is_none() && item.number_of("Dis").is_none();
        let names = asked(command.arguments.iter().filter(is_asked))?;
        let every_s = number("Time").unwrap_or(f64::INFINITY);
        let every_mm = number("Dis").unwrap_or(f64::INFINITY);
        if !(every_s >= 0.1 && every_mm > 0.0) {
            return Err((1, 504, "Argument out of range"));
        }
        self.reports.push(Reports { tag: command.tag, names, every_s, every_mm, last: None });
        Ok(Vec::new())
    }
}

fn error(tag: Tag, (severity, number, text): Trouble, cause: &str) -> String {
    format!("{tag} ! Error({severity}, {number:04}, \"{cause}\", \"{text}\")")
}

/// Names of the axes that are asked for, such as `X()`.
fn asked<'a>(arguments: impl IntoIterator<Item = &'a Item>) -> Result<Vec<String>, Trouble> {
    let name = |item: &Item| match item.call() {
        Some((name, [])) if AXES.contains(&name) => Ok(name.to_owned()),
        Some((_, [])) => Err((3, 506, "Argument not supported")),
        _ => Err((3, 502, "Incorrect arguments")),
    };
    let names: Vec<String> = arguments.into_iter().map(name).collect::<Result<_, _>>()?;
    if names.is_empty() { Err((3, 502, "Incorrect arguments")) } else { Ok(names) }
}

/// Whether this is the property of the speed of moves, and the value that it is given.
fn speed_of(arguments: &[Item]) -> Option<Option<f64>> {
    let [only] = arguments else { return None };
    match only.call()? {
        ("Tool.GoToPar.Speed", []) => Some(None),
        ("Tool.GoToPar.Speed", [value]) => Some(value.number()),
        _ => None,
    }
}

/// Scales (mm) at the target of a `GoTo`; an axis that is not named stays.
fn target(arguments: &[Item], at: &Position, stroke_mm: &[(f64, f64); 3]) -> Result<[f64; 3], Trouble> {
    let mut scales_mm = at.scales_mm;
    for item in arguments {
        let named = AXES.iter().enumerate().find_map(|(d, axis)| Some((d, item.number_of(axis)?.0)));
        let (axis, tip_mm) = named.ok_or((3, 509, "Bad argument"))?;
        scales_mm[axis] = tip_mm - at.tool.1[axis];
    }
    let is_inside = (0..3).all(|d| (stroke_mm[d].0 - 1e-3..=stroke_mm[d].1 + 1e-3).contains(&scales_mm[d]));
    if is_inside { Ok(scales_mm) } else { Err((3, 2500, "Machine limit encountered [Move Out Of Limits]")) }
}

fn values(names: &[String], at: &Position) -> String {
    let mut text = String::new();
    for (k, name) in names.iter().enumerate() {
        let axis = AXES.iter().position(|axis| axis == name).unwrap_or_default();
        // Writing to a string cannot fail.
        let _ = write!(text, "{}{name}({:.7})", if k > 0 { ", " } else { "" }, at.tip_mm(axis));
    }
    text
}

/// Properties of the tool.
fn property(arguments: &[Item], at: &Position) -> Result<String, Trouble> {
    let of = |item: &Item| {
        let name = match &item.what {
            What::Call(name, _) => name.as_str(),
            _ => return Err((3, 502, "Incorrect arguments")),
        };
        Ok(match name {
            "Tool.Name" => format!("Tool.Name(\"{}\")", at.tool.0),
            "Tool.AvrOffsets" => {
                let [x, y, z] = at.tool.1;
                format!("Tool.AvrOffsets({x:.7}, {y:.7}, {z:.7})")
            }
            "Part.Temperature" => "Part.Temperature(20.0)".to_owned(),
            _ => return Err((3, 510, "Bad property")),
        })
    };
    let all: Vec<String> = arguments.iter().map(of).collect::<Result<_, _>>()?;
    if all.is_empty() { Err((3, 502, "Incorrect arguments")) } else { Ok(all.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(time_s: f64, x_mm: f64) -> Position {
        Position { time_s, scales_mm: [x_mm, 2.0, 3.0], tool: ("Holder1".to_owned(), [0.0, 0.0, -60.0]) }
    }

    fn session() -> Session {
        let mut session = Session::new(vec!["Holder1".to_owned(), "Holder2".to_owned()]);
        assert_eq!(session.take(b"00001 StartSession()", &at(0.0, 1.0)), ["00001 &", "00001 %"]);
        session
    }

    /// The middle line of an answer.
    fn said(session: &mut Session, command: &str) -> String {
        let lines = session.take(format!("00002 {command}").as_bytes(), &at(0.0, 1.0));
        assert_eq!((lines[0].as_str(), lines[lines.len() - 1].as_str()), ("00002 &", "00002 %"));
        lines[1..lines.len() - 1].join("|")
    }

    #[test]
    fn a_client_is_answered_as_the_specification_says() {
        let mut new = Session::new(Vec::new());
        assert_eq!(said(&mut new, "Get(X())"), "00002 ! Error(3, 0008, \"Get\", \"Protocol error\")");
        assert_eq!(said(&mut new, "EndSession()"), "", "nothing happens where there is none");
        let mut session = session();
        for (command, answer) in [
            ("Get(X(), Y(), Z())", "00002 # X(1.0000000), Y(2.0000000), Z(-57.0000000)"),
            ("GetProp(Tool.Name())", "00002 # Tool.Name(\"Holder1\")"),
            ("GetProp(Tool.AvrOffsets())", "00002 # Tool.AvrOffsets(0.0000000, 0.0000000, -60.0000000)"),
            ("GetCoordSystem()", "00002 # CoordSystem(MachineCsy)"),
            ("SetCoordSystem(PartCsy)", ""),
            ("GetCoordSystem()", "00002 # CoordSystem(PartCsy)"),
            ("GetErrStatusE()", "00002 # ErrStatus(0)"),
            ("EnumTools()", "00002 # \"Holder1\"|00002 # \"Holder2\""),
            ("StopAllDaemons()", ""),
            ("GoTo(X(5))", "00002 ! Error(3, 0508, \"GoTo\", \"Bad context\")"),
            ("Get(X())", "00002 ! Error(2, 0514, \"Get\", \"Use ClearAllErrors to continue\")"),
            ("GetErrStatusE()", "00002 # ErrStatus(1)"),
            ("ClearAllErrors()", ""),
            ("NoSuch()", "00002 ! Error(3, 0501, \"NoSuch\", \"Unsupported command\")"),
            ("ClearAllErrors()", ""),
            ("StopDaemon(E0006)", "00002 ! Error(2, 0513, \"StopDaemon\", \"Daemon does not exist\")"),
            ("ClearAllErrors()", ""),
            ("StartSession()", "00002 ! Error(3, 0008, \"StartSession\", \"Protocol error\")"),
        ] {
            assert_eq!(said(&mut session, command), answer, "{command}");
        }
        assert_eq!(
            session.take(b"20 Get(X())", &at(0.0, 1.0)),
            ["E0000 ! Error(2, 0001, \"parser\", \"Illegal tag\")"]
        );
    }

    #[test]
    fn a_machine_that_obeys_moves_says_when_it_has_arrived_and_is_stopped() {
        let mut session = session().obeying([(0.0, 500.0); 3]);
        assert_eq!(said(&mut session, "SetProp(Tool.GoToPar.Speed(10000))"), "");
        assert_eq!(said(&mut session, "GetProp(Tool.GoToPar.Speed())"), "00002 # Tool.GoToPar.Speed(500.0)");
        let go = |session: &mut Session, x_mm: f64| {
            session.take(format!("00005 GoTo(X({x_mm}), Z(40))").as_bytes(), &at(0.0, 1.0))
        };
        assert_eq!(go(&mut session, 90.0), ["00005 &"]);
        let ordered = Some(Order::Go { scales_mm: [90.0, 2.0, 100.0], speed_mm_s: 500.0 });
        assert_eq!((session.arrived(&at(0.0, 1.0)).len(), session.order(), session.order()), (0, ordered, None));
        // What comes meanwhile waits, but for events.
        assert!(session.take(b"00006 Get(X())", &at(0.1, 50.0)).is_empty());
        assert_eq!(session.take(b"E0007 GetErrStatusE()", &at(0.1, 50.0)).len(), 3);
        assert_eq!(session.arrived(&at(1.0, 90.0)), ["00005 %", "00006 &", "00006 # X(90.0000000)", "00006 %"]);
        assert!(go(&mut session, 501.0)[1].contains("2500"));
        assert!(go(&mut session, 90.0)[1].contains("0514"), "after an error nothing moves");
        assert_eq!((said(&mut session, "ClearAllErrors()"), session.order()), (String::new(), None));
        go(&mut session, 90.0);
        session.order();
        let aborted = session.take(b"E0008 AbortE()", &at(0.1, 50.0));
        assert!(aborted[1].contains("00005 ! Error(2, 0006") && aborted[3] == "E0008 %", "{aborted:?}");
        assert_eq!(session.order(), Some(Order::Stop));
    }

    #[test]
    fn reports_come_by_way_and_time_and_a_machine_that_stands_says_nothing() {
        let mut session = session();
        let asked = session.take(b"E0001 OnMoveReportE(Time(0.5), Dis(10), X(), Z())", &at(0.0, 1.0));
        assert_eq!(asked, ["E0001 &", "E0001 %"]);
        assert_eq!(session.moved(&at(0.0, 1.0)), ["E0001 # X(1.0000000), Z(-57.0000000)"]);
        assert!(session.moved(&at(9.0, 1.0)).is_empty());
        assert!(session.moved(&at(9.1, 12.0)).len() == 1 && session.moved(&at(9.2, 13.0)).is_empty());
        assert_eq!(session.moved(&at(9.7, 13.0)).len(), 1);
        let changed = Position { tool: ("Holder2".to_owned(), [0.0; 3]), ..at(9.7, 13.0) };
        assert_eq!(session.moved(&changed)[0], "E0000 # ChangeTool(\"Holder2\")");
        let again = session.take(b"E0001 OnMoveReportE(Time(0.5), X())", &at(0.0, 1.0));
        assert!(again[1].contains("0515"), "{again:?}");
    }

    proptest! {
        #[test]
        fn no_line_ends_the_program(line in prop::collection::vec(any::<u8>(), 0..60), command in "[A-Z][a-zA-Z]{0,12}\\([A-Za-z(),.0-9]{0,30}\\)?") {
            let mut session = session();
            session.take(&line, &at(0.0, 0.0));
            session.take(format!("00007 {command}").as_bytes(), &at(0.0, 0.0));
            session.moved(&at(1.0, 5.0));
        }
    }
}
