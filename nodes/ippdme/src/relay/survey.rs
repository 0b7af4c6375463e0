//! What the relay asks the server itself: which coordinate system is active and where it lies, which tool, where its tip is.
//!
//! Place in the flow: runs while nothing of the software is under way; its commands wait until it has ended. A system other than
//! the machine's is held against the server's own numbers before a point in it is corrected: the same position is asked for in
//! both. Commands go out one at a time, answers to them go no further.

use super::place::{Offsets, Place};
use crate::csy::{ALL, Csy, Transformation};
use crate::item::{Item, What};
use crate::message::{ReplyKind, Response, Tag};
use crate::trouble::Trouble;
use std::collections::{BTreeMap, VecDeque};

/// How far the transformation and the server's numbers may differ (mm). Less moves no correction by a nanometre; servers round
/// to a micrometre, and axes tremble by as much.
const CHECK_WITHIN_MM: f64 = 0.01;
/// How often the software's coordinate system is selected again before the connection is given up.
const MOST_RETURNS: usize = 3;
const POSITION: &str = "Get(X(), Y(), Z())";

/// Why a point cannot be corrected as things are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Why {
    pub(super) words: String,
    /// The server would say the same again until something is changed.
    pub(super) is_lasting: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    MachineClass,
    CoordSystem,
    Placed(Csy),
    ToolName,
    ToMachine,
    ToolOffset,
    /// The position in the machine's system, and in the active one.
    InMachine,
    Back(Csy),
    InActive,
    Clear,
}

/// What lasts from one survey to the next.
#[derive(Debug, Clone, Default)]
pub(super) struct Memory {
    /// Whether the machine has a rotary table; `None` where the server did not say.
    pub(super) has_table: Option<bool>,
    /// A system that was held against the server's numbers.
    checked: Option<(Csy, Transformation)>,
    /// Whether the tool was turned since it was put into use.
    pub(super) is_turned: bool,
}

impl Memory {
    /// Whether a system has still to be held against the server's numbers. One that lies where the machine's does is a claim like
    /// any other: servers that cannot tell answer zeros.
    fn is_open(&self, active: Csy, from_machine: Transformation) -> bool {
        active != Csy::Machine && self.checked != Some((active, from_machine))
    }
}

/// What goes out of a survey.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Next {
    /// A command, without its tag.
    Ask(String),
    /// It goes on with an answer.
    Wait,
    /// The end.
    Found(Result<Place, Why>),
    /// The end of a question for the position (mm, active system).
    Position(Result<[f64; 3], Why>),
    /// The software's coordinate system could not be selected again.
    Lost(String),
}

/// A survey under way.
#[derive(Debug)]
pub(super) struct Survey {
    pub(super) tag: Tag,
    steps: VecDeque<Step>,
    current: Option<Step>,
    data: Vec<u8>,
    error: Option<Trouble>,
    is_only_position: bool,
    is_second_part: bool,
    active: Option<Csy>,
    placed: BTreeMap<Csy, Transformation>,
    tool: Option<String>,
    offset_m: Option<[f64; 3]>,
    in_machine_mm: Option<[f64; 3]>,
    in_active_mm: Option<[f64; 3]>,
    /// The system to go back to.
    pub(super) away_from: Option<Csy>,
    returns: usize,
    failure: Option<Why>,
    /// Something was changed meanwhile.
    pub(super) is_outdated: bool,
}

impl Survey {
    /// Of everything that a correction needs.
    pub(super) fn new(tag: Tag, memory: &Memory) -> Survey {
        let class = memory.has_table.is_none().then_some(Step::MachineClass);
        Survey::of(tag, class.into_iter().chain([Step::CoordSystem, Step::ToolName]).collect(), false)
    }

    /// Of the position alone.
    pub(super) fn of_position(tag: Tag) -> Survey {
        Survey::of(tag, VecDeque::from([Step::InActive]), true)
    }

    fn of(tag: Tag, steps: VecDeque<Step>, is_only_position: bool) -> Survey {
        Survey {
            tag,
            steps,
            current: None,
            data: Vec::new(),
            error: None,
            is_only_position,
            is_second_part: false,
            active: None,
            placed: BTreeMap::new(),
            tool: None,
            offset_m: None,
            in_machine_mm: None,
            in_active_mm: None,
            away_from: None,
            returns: 0,
            failure: None,
            is_outdated: false,
        }
    }

    /// Takes a response to its question.
    pub(super) fn take(&mut self, response: &Response, memory: &mut Memory, offsets: &Offsets) -> Next {
        match response.kind {
            ReplyKind::Ack => Next::Wait,
            ReplyKind::Data => {
                self.data = response.data().to_vec();
                Next::Wait
            }
            ReplyKind::Error => {
                let trouble = Trouble::parse(response.data());
                if trouble.severity.stops() {
                    self.error = Some(trouble);
                }
                Next::Wait
            }
            ReplyKind::Done => {
                if let Some(step) = self.current.take() {
                    match self.error.take() {
                        Some(trouble) => self.refused(step, &trouble),
                        None => self.answered(step, memory),
                    }
                }
                self.data.clear();
                self.next(memory, offsets)
            }
        }
    }

    /// The next question, or the end.
    pub(super) fn next(&mut self, memory: &mut Memory, offsets: &Offsets) -> Next {
        if self.returns > MOST_RETURNS {
            return Next::Lost("the server does not select the coordinate system again that was active".to_owned());
        }
        if self.steps.is_empty() && !self.is_only_position && !std::mem::replace(&mut self.is_second_part, true) {
            self.plan_second_part(memory, offsets);
        }
        let Some(step) = self.steps.pop_front() else {
            return match self.is_only_position {
                true => Next::Position(self.in_active_mm.ok_or_else(|| self.why("the server gave no position"))),
                false => Next::Found(self.conclude(memory, offsets)),
            };
        };
        self.current = Some(step);
        if step == Step::ToMachine {
            self.away_from = self.active;
        }
        Next::Ask(match step {
            Step::MachineClass => "GetMachineClass()".to_owned(),
            Step::CoordSystem => "GetCoordSystem()".to_owned(),
            Step::Placed(csy) => format!("GetCsyTransformation({})", csy.name()),
            Step::ToolName => "GetProp(Tool.Name())".to_owned(),
            Step::ToolOffset => "GetProp(Tool.AvrOffsets())".to_owned(),
            Step::ToMachine => format!("SetCoordSystem({})", Csy::Machine.name()),
            Step::Back(csy) => format!("SetCoordSystem({})", csy.name()),
            Step::InMachine | Step::InActive => POSITION.to_owned(),
            Step::Clear => "ClearAllErrors()".to_owned(),
        })
    }

    fn answered(&mut self, step: Step, memory: &mut Memory) {
        let items = crate::item::items(&self.data).unwrap_or_default();
        match step {
            Step::MachineClass => {
                // A word, or a string; newer servers name several.
                let names: Vec<&str> = items.iter().flat_map(inner).filter_map(Item::text).collect();
                memory.has_table = (!names.is_empty()).then(|| names.iter().any(|name| name.contains("Rotary")));
            }
            Step::CoordSystem => {
                self.active = items.iter().flat_map(inner).filter_map(Item::text).find_map(Csy::of_name);
                match self.active {
                    None => self.fail("the server names a coordinate system that is not known here", true),
                    Some(active) => {
                        let above = ALL.into_iter().filter(|csy| *csy != Csy::Machine && *csy <= active);
                        self.steps.extend(above.map(Step::Placed));
                    }
                }
            }
            Step::Placed(csy) => {
                let numbers: Option<Vec<f64>> = items.iter().flat_map(inner).map(Item::number).collect();
                if let Some(Ok(placed)) = numbers.map(|numbers| Transformation::new(&numbers)) {
                    self.placed.insert(csy, placed);
                }
            }
            Step::ToolName => {
                self.tool = items.iter().flat_map(inner).find_map(Item::text).map(str::to_owned);
            }
            Step::ToolOffset => {
                let numbers: Option<Vec<f64>> = items.iter().flat_map(inner).map(Item::number).collect();
                if let Some([x, y, z]) = numbers.as_deref() {
                    self.offset_m = Some([x / 1e3, y / 1e3, z / 1e3]);
                }
            }
            Step::InMachine => self.in_machine_mm = position(&items),
            Step::InActive => self.in_active_mm = position(&items),
            Step::Back(_) => self.away_from = None,
            Step::ToMachine | Step::Clear => {}
        }
    }

    fn refused(&mut self, step: Step, trouble: &Trouble) {
        match step {
            Step::Back(csy) => {
                self.returns += 1;
                self.steps.push_front(Step::Back(csy));
            }
            Step::CoordSystem | Step::ToMachine | Step::InMachine | Step::InActive => {
                self.fail(&trouble.to_string(), false);
                // What is left but the way back would be refused, too.
                self.steps.retain(|step| matches!(step, Step::Back(_)));
            }
            // Whether these are missed is seen at the end.
            Step::MachineClass | Step::Placed(_) | Step::ToolName | Step::ToolOffset | Step::Clear => {}
        }
        if step != Step::Clear {
            self.steps.push_front(Step::Clear);
        }
    }

    fn fail(&mut self, words: &str, is_lasting: bool) {
        self.failure.get_or_insert(Why { words: words.to_owned(), is_lasting });
    }

    fn why(&self, otherwise: &str) -> Why {
        self.failure.clone().unwrap_or_else(|| Why { words: otherwise.to_owned(), is_lasting: false })
    }

    /// What has to be asked in the machine's system, and back in the active one.
    fn plan_second_part(&mut self, memory: &Memory, offsets: &Offsets) {
        let Some(active) = self.active.filter(|_| self.failure.is_none()) else { return };
        let asks_offset = offsets.from_server && offsets.of(self.tool.as_deref()).is_none();
        let offset = asks_offset.then_some(Step::ToolOffset);
        if active == Csy::Machine {
            self.steps.extend(offset);
            return;
        }
        let Ok(from_machine) = self.transformation(active, memory) else { return };
        let is_open = memory.is_open(active, from_machine);
        if asks_offset || is_open {
            self.steps.push_back(Step::ToMachine);
            self.steps.extend(offset);
            self.steps.extend(is_open.then_some(Step::InMachine));
            self.steps.push_back(Step::Back(active));
            self.steps.extend(is_open.then_some(Step::InActive));
        }
    }

    /// From the machine's system to the active one.
    fn transformation(&self, active: Csy, memory: &Memory) -> Result<Transformation, Why> {
        let lasting = |words: String| Why { words, is_lasting: true };
        if active == Csy::Machine {
            return Ok(Transformation::identity());
        }
        if memory.has_table != Some(false) {
            let table = if memory.has_table.is_some() { "has" } else { "may have" };
            return Err(lasting(format!(
                "the machine {table} a rotary table, and how {} turns with it is open; select MachineCsy",
                active.name()
            )));
        }
        for csy in ALL.into_iter().filter(|csy| *csy != Csy::Machine && *csy < active) {
            match self.placed.get(&csy) {
                Some(placed) if placed.is_identity() => {}
                Some(_) => {
                    let words =
                        format!("{} is moved, and whether {} counts from it is open", csy.name(), active.name());
                    return Err(lasting(words));
                }
                None => return Err(lasting(format!("the server does not tell where {} lies", csy.name()))),
            }
        }
        let placed = self.placed.get(&active).copied();
        placed.ok_or_else(|| lasting(format!("the server does not tell where {} lies", active.name())))
    }

    fn conclude(&mut self, memory: &mut Memory, offsets: &Offsets) -> Result<Place, Why> {
        if let Some(failure) = self.failure.take() {
            return Err(failure);
        }
        let active = self.active.ok_or_else(|| self.why("the server does not tell its coordinate system"))?;
        let from_machine = self.transformation(active, memory)?;
        let offset_m = self.offset(memory, offsets)?;
        if memory.is_open(active, from_machine) {
            let (Some(in_machine_mm), Some(in_active_mm)) = (self.in_machine_mm, self.in_active_mm) else {
                return Err(self.why("the server gave no position to hold its coordinate system against"));
            };
            let expected_mm = from_machine.from_machine(in_machine_mm);
            let apart_mm = (0..3).map(|d| (expected_mm[d] - in_active_mm[d]).abs()).fold(0.0, f64::max);
            if apart_mm > CHECK_WITHIN_MM {
                let words = format!(
                    "positions in {} are {apart_mm:.3} mm off what its transformation says; let the machine stand still, and \
                     check what the server means by it",
                    active.name()
                );
                return Err(Why { words, is_lasting: false });
            }
            if from_machine.could_be_meant_otherwise(in_machine_mm, in_active_mm, 2.0 * CHECK_WITHIN_MM) {
                let words = format!(
                    "where the machine stands, a turn of {} the other way would tell the same position; move the machine by some \
                     100 mm along each axis, and ask again",
                    active.name()
                );
                return Err(Why { words, is_lasting: false });
            }
            memory.checked = Some((active, from_machine));
        }
        Ok(Place { csy: active, from_machine, offset_m })
    }

    fn offset(&self, memory: &Memory, offsets: &Offsets) -> Result<[f64; 3], Why> {
        let lasting = |words: String| Err(Why { words, is_lasting: true });
        let name = self.tool.as_deref().unwrap_or("without a name");
        if let Some(words) = offsets.refused(self.tool.as_deref(), memory.is_turned) {
            return lasting(words);
        }
        match (offsets.of(self.tool.as_deref()), self.offset_m) {
            (Some(offset_m), _) | (None, Some(offset_m)) => Ok(offset_m),
            (None, None) if offsets.from_server => {
                lasting(format!("the server does not tell the offset of tool {name}"))
            }
            (None, None) => lasting(format!("the offset of tool {name} is not known; name it with --tool")),
        }
    }
}

/// The arguments of a call, or the part itself.
fn inner(item: &Item) -> &[Item] {
    match &item.what {
        What::Call(_, arguments) => arguments,
        _ => std::slice::from_ref(item),
    }
}

/// X, Y and Z of a position (mm).
fn position(items: &[Item]) -> Option<[f64; 3]> {
    let axis = |name: &str| items.iter().find_map(|item| Some(item.number_of(name)?.0));
    Some([axis("X")?, axis("Y")?, axis("Z")?])
}
