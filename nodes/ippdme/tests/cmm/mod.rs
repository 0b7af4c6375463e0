//! A server of a machine whose geometry is known: scales, tools, coordinate systems, reports, errors. Reads and writes the
//! protocol by itself, and shares no code with the crate.

#![allow(dead_code)] // Each test program uses another part.

use std::collections::{BTreeMap, BTreeSet};

/// The server and its machine. Lengths in millimetres.
pub(crate) struct Cmm {
    pub(crate) scales_mm: [f64; 3],
    pub(crate) tools_mm: BTreeMap<String, [f64; 3]>,
    pub(crate) tool: String,
    pub(crate) csy: String,
    pub(crate) placed: BTreeMap<String, [f64; 6]>,
    pub(crate) decimals: usize,
    pub(crate) has_table: bool,
    pub(crate) tells_offsets: bool,
    /// Turns coordinate systems the other way round than the specification says.
    pub(crate) turns_wrongly: bool,
    /// Answers zeros for wherever a coordinate system lies.
    pub(crate) tells_zeros: bool,
    /// Says that it selects a coordinate system, and stays in the one that it has.
    pub(crate) keeps_csy: bool,
    /// Answers `Get` without a position.
    pub(crate) tells_nothing: bool,
    /// Answers `GetCoordSystem` without a word.
    pub(crate) tells_no_csy: bool,
    /// The operator changes to this tool while the next command of this name waits for its answer; moves are reported before it
    /// and after.
    pub(crate) changes_during: Option<(&'static str, &'static str)>,
    /// Tells a point of the operator, a target and what is no line when the machine's system is selected.
    pub(crate) picks_in_machine: bool,
    /// Commands that it does not know.
    pub(crate) unknown: BTreeSet<String>,
    /// Tells an error of this class and number before what it answers to `Get`.
    pub(crate) fails: Option<(u8, u16)>,
    /// Commands as they came.
    pub(crate) heard: Vec<String>,
    pub(crate) has_error: bool,
    pub(crate) measured: Vec<String>,
    pub(crate) scanned: Vec<String>,
    pub(crate) daemons: Vec<(String, Vec<String>)>,
}

impl Default for Cmm {
    fn default() -> Cmm {
        let tools = [("RefTool", [0.0; 3]), ("Probe1", [0.0, 0.0, -120.0]), ("Star", [35.0, -12.0, -150.0])];
        Cmm {
            scales_mm: [200.0, 150.0, 100.0],
            tools_mm: tools.into_iter().map(|(name, offset)| (name.to_owned(), offset)).collect(),
            tool: "Probe1".to_owned(),
            csy: "MachineCsy".to_owned(),
            placed: BTreeMap::new(),
            decimals: 5,
            has_table: false,
            tells_offsets: false,
            turns_wrongly: false,
            tells_zeros: false,
            keeps_csy: false,
            tells_nothing: false,
            tells_no_csy: false,
            changes_during: None,
            picks_in_machine: false,
            unknown: BTreeSet::new(),
            fails: None,
            heard: Vec::new(),
            has_error: false,
            measured: words("X Y Z"),
            scanned: words("X Y Z Q"),
            daemons: Vec::new(),
        }
    }
}

fn words(text: &str) -> Vec<String> {
    text.split(' ').map(str::to_owned).collect()
}

/// Turns a vector about z or x, axes with it.
fn turned(about: usize, degrees: f64, v: [f64; 3]) -> [f64; 3] {
    let (sin, cos) = degrees.to_radians().sin_cos();
    match about {
        2 => [cos * v[0] + sin * v[1], cos * v[1] - sin * v[0], v[2]],
        _ => [v[0], cos * v[1] + sin * v[2], cos * v[2] - sin * v[1]],
    }
}

/// A point of the machine in a system of these six numbers.
pub(crate) fn placed(numbers: [f64; 6], point: [f64; 3]) -> [f64; 3] {
    let turned = turned(2, numbers[5], turned(0, numbers[3], turned(2, numbers[4], point)));
    std::array::from_fn(|d| turned[d] + numbers[d])
}

/// And back.
pub(crate) fn unplaced(numbers: [f64; 6], point: [f64; 3]) -> [f64; 3] {
    let moved: [f64; 3] = std::array::from_fn(|d| point[d] - numbers[d]);
    turned(2, -numbers[4], turned(0, -numbers[3], turned(2, -numbers[5], moved)))
}

impl Cmm {
    pub(crate) fn offset_mm(&self) -> [f64; 3] {
        self.tools_mm[&self.tool]
    }

    /// The tip as the scales say, in the machine's system.
    pub(crate) fn tip_mm(&self) -> [f64; 3] {
        std::array::from_fn(|d| self.scales_mm[d] + self.offset_mm()[d])
    }

    fn numbers(&self) -> [f64; 6] {
        let numbers = self.placed.get(&self.csy).copied().unwrap_or_default();
        match self.turns_wrongly {
            true => [numbers[0], numbers[1], numbers[2], numbers[3], -numbers[4], -numbers[5]],
            false => numbers,
        }
    }

    /// The tip in the active system.
    pub(crate) fn told_mm(&self) -> [f64; 3] {
        placed(self.numbers(), self.tip_mm())
    }

    fn go(&mut self, target_mm: [f64; 3]) {
        let tip = unplaced(self.numbers(), target_mm);
        self.scales_mm = std::array::from_fn(|d| tip[d] - self.offset_mm()[d]);
    }

    /// A value that a report names.
    fn value(&self, name: &str) -> Vec<f64> {
        let told = self.told_mm();
        match name {
            "X" => vec![told[0]],
            "Y" => vec![told[1]],
            "Z" => vec![told[2]],
            "IJK" => vec![0.0, 0.0, 1.0],
            "ER" => vec![1.5],
            _ => vec![0.0],
        }
    }

    fn digits(&self, values: &[f64]) -> String {
        values.iter().map(|value| format!("{value:.*}", self.decimals)).collect::<Vec<_>>().join(", ")
    }

    fn named(&self, names: &[String]) -> String {
        names.iter().map(|name| format!("{name}({})", self.digits(&self.value(name)))).collect::<Vec<_>>().join(", ")
    }

    /// What the daemons say after a move.
    pub(crate) fn moved(&self) -> Vec<String> {
        self.daemons.iter().map(|(tag, names)| format!("{tag} # {}", self.named(names))).collect()
    }

    /// A point that the operator takes.
    pub(crate) fn picked(&self) -> String {
        format!("E0000 # PtMeas({})", self.named(&self.measured))
    }

    /// Takes a command line, gives the lines that answer it.
    pub(crate) fn take(&mut self, line: &str) -> Vec<String> {
        self.heard.push(line.to_owned());
        let (tag, command) = line.split_at(line.len().min(5));
        let command = command.trim();
        let (name, inside) = command.split_once('(').unwrap_or((command, ""));
        let inside = inside.trim_end().strip_suffix(')').unwrap_or(inside);
        let mut lines = vec![format!("{tag} &")];
        let is_cure = matches!(name, "ClearAllErrors" | "StartSession" | "EndSession" | "GetErrStatusE");
        if self.has_error && !is_cure {
            lines.push(format!("{tag} ! Error(2, 0514, \"{name}\", \"Use ClearAllErrors to continue\")"));
        } else if self.unknown.contains(name) {
            self.has_error = true;
            lines.push(format!("{tag} ! Error(3, 0501, \"{name}\", \"Unsupported command\")"));
        } else {
            if let Some((class, number)) = self.fails.filter(|_| name == "Get") {
                lines.push(format!("{tag} ! Error({class}, {number:04}, \"Get\", \"told by a test\")"));
            }
            if let Some((_, tool)) = self.changes_during.take_if(|(during, _)| command.starts_with(*during)) {
                lines.extend(self.moved());
                self.tool = tool.to_owned();
                lines.push(format!("E0000 # ChangeTool(\"{tool}\")"));
                lines.extend(self.moved());
            }
            match self.answers(tag, name, &split(inside)) {
                Ok(answers) => lines.extend(answers.into_iter().map(|answer| format!("{tag} # {answer}"))),
                Err((severity, number, text)) => {
                    self.has_error |= severity > 1;
                    lines.push(format!("{tag} ! Error({severity}, {number:04}, \"{name}\", \"{text}\")"));
                }
            }
        }
        lines.push(format!("{tag} %"));
        if matches!(name, "GoTo" | "PtMeas" | "ChangeTool" | "SetCoordSystem") {
            lines.extend(self.moved());
        }
        if self.picks_in_machine && name == "SetCoordSystem" && self.csy == "MachineCsy" {
            let point = self.named(&self.measured);
            lines.extend([format!("E0000 # PtMeas({point})"), format!("E0000 # GoTo({point})")]);
            lines.push(format!("E0000 # {point} and more"));
        }
        lines
    }

    fn answers(&mut self, tag: &str, name: &str, arguments: &[String]) -> Result<Vec<String>, (u8, u16, &'static str)> {
        let names: Vec<String> = arguments.iter().filter_map(|a| a.strip_suffix("()")).map(str::to_owned).collect();
        let numbers: Vec<f64> = arguments.iter().filter_map(|a| a.parse().ok()).collect();
        Ok(match name {
            "StartSession" | "EndSession" => {
                (self.has_error, self.measured, self.scanned) = (false, words("X Y Z"), words("X Y Z Q"));
                self.daemons.clear();
                vec![]
            }
            "ClearAllErrors" => {
                self.has_error = false;
                vec![]
            }
            "GetErrStatusE" => vec![format!("ErrStatus({})", u8::from(self.has_error))],
            "GetMachineClass" => {
                vec![format!("GetMachineClass(CartCMM{})", if self.has_table { "WithRotaryTable" } else { "" })]
            }
            "GetCoordSystem" if self.tells_no_csy => vec![],
            "GetCoordSystem" => vec![format!("CoordSystem({})", self.csy)],
            "SetCoordSystem" if self.keeps_csy => vec![],
            "Get" if self.tells_nothing => vec![],
            "SetCoordSystem" => {
                self.csy.clone_from(&arguments[0]);
                vec![]
            }
            "SetCsyTransformation" => {
                self.placed.insert(arguments[0].clone(), numbers.try_into().map_err(|_| (3, 509, "Bad argument"))?);
                vec![]
            }
            "GetCsyTransformation" => {
                let known = self.placed.get(&arguments[0]).filter(|_| !self.tells_zeros);
                let numbers = known.copied().unwrap_or_default();
                vec![format!("GetCsyTransformation({})", numbers.map(|n| format!("{n:.9}")).join(", "))]
            }
            "GetProp" if arguments[0] == "Tool.Name()" => vec![format!("Tool.Name(\"{}\")", self.tool)],
            "GetProp" if arguments[0] == "Tool.AvrOffsets()" && self.tells_offsets => {
                vec![format!("Tool.AvrOffsets({})", self.digits(&self.offset_mm()))]
            }
            "GetProp" if arguments[0] == "Part.Temperature()" => vec!["Part.Temperature(21.25)".to_owned()],
            "GetProp" => return Err((3, 510, "Bad property")),
            "ChangeTool" => {
                let tool = arguments[0].trim_matches('"').to_owned();
                if !self.tools_mm.contains_key(&tool) {
                    return Err((3, 1502, "Tool not found"));
                }
                self.tool = tool;
                vec![]
            }
            "Get" => vec![self.named(&names)],
            "OnPtMeasReport" => {
                self.measured = names;
                vec![]
            }
            "OnScanReport" => {
                self.scanned = names;
                vec![]
            }
            "OnMoveReportE" => {
                self.daemons.push((tag.to_owned(), names));
                vec![]
            }
            "StopAllDaemons" => {
                self.daemons.clear();
                vec![]
            }
            "GoTo" | "PtMeas" => {
                let mut target = self.told_mm();
                for argument in arguments {
                    let (axis, value) = argument.split_once('(').ok_or((3, 509, "Bad argument"))?;
                    if let Some(d) = ["X", "Y", "Z"].iter().position(|known| *known == axis) {
                        target[d] = value.trim_end_matches(')').parse().map_err(|_| (3, 509, "Bad argument"))?;
                    }
                }
                if target.iter().any(|mm| mm.abs() > 1e4) {
                    return Err((3, 2500, "Machine limit encountered [Move Out Of Limits]"));
                }
                self.go(target);
                if name == "PtMeas" { vec![self.named(&self.measured)] } else { vec![] }
            }
            "ScanOnLine" => {
                let (from, to) = ([numbers[0], numbers[1], numbers[2]], [numbers[3], numbers[4], numbers[5]]);
                let mut values = Vec::new();
                for k in 0..=10 {
                    self.go(std::array::from_fn(|d| from[d] + (to[d] - from[d]) * f64::from(k) / 10.0));
                    values.extend(self.scanned.iter().flat_map(|name| self.value(name)));
                }
                let width = values.len() / 11;
                values.chunks(4 * width).map(|block| self.digits(block)).collect()
            }
            _ => vec![],
        })
    }
}

/// Arguments at the commas that stand in no bracket.
fn split(inside: &str) -> Vec<String> {
    let (mut depth, mut parts) = (0_i32, vec![String::new()]);
    for sign in inside.chars() {
        depth += i32::from(sign == '(') - i32::from(sign == ')');
        match sign {
            ',' if depth == 0 => parts.push(String::new()),
            ' ' => {}
            _ => parts.last_mut().unwrap().push(sign),
        }
    }
    parts.retain(|part| !part.is_empty());
    parts
}
