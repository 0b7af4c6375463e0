//! Values of three axes, each with an instant of its own, become samples of one instant; what does not belong together is refused.
//!
//! Place in the flow: the driver `opcua` hands over what a session gives, message by message. Three rules, of which the launch file
//! names one:
//!
//! - **source**: axes are joined whose source timestamps are equal, or apart by no more than was allowed. The stamp is the
//!   latest of them.
//! - **held**: a source timestamp is the time of the last change (OPC 10000-4, 7.11.3), so that a value holds until the server tells
//!   another. At each instant at which an axis changed, another is joined if it changed then, too, or has stood
//!   still since long enough, and goes on standing as far as is known. One that moves, and was seen at another instant, is refused.
//!   An instant waits for the message after the one that told it, so that nothing that belongs to it is under way. Of answers to a
//!   question for all axes the stamp is the server's time of the answer while all stand still: while source timestamps are the same
//!   in answers that span that time. The time of an answer is never held against a source's: these are two clocks.
//! - **arrival**: the values of one answer are joined, and the stamp is when it arrived; for servers without timestamps.
//!
//! The first value of an axis in a session tells how things stand, and may be of hours ago: alone it makes no sample. Stamps rise
//! from sample to sample, over sessions too, so that nothing is given twice. Nanoseconds since 1970.

use std::collections::VecDeque;

/// Values of an axis that wait for those of another at most.
const LONGEST_QUEUE: usize = 256;
/// Axes.
pub const AXES: usize = 3;
/// Their names.
pub const NAMES: [&str; AXES] = ["x", "y", "z"];

/// Which rule.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JoinBy {
    /// By source timestamps that are this far apart at most (ns).
    Source {
        /// Furthest apart.
        apart_ns: i64,
    },
    /// By source timestamps; a value holds until there is another.
    Held {
        /// Furthest apart.
        apart_ns: i64,
        /// An axis that has not changed for this long stands still.
        still_ns: i64,
    },
    /// What comes in one answer.
    Arrival,
}

/// A value of an axis.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisValue {
    /// The value, or why there is none.
    pub value: Result<f64, String>,
    /// The source's time (ns).
    pub source_ns: Option<i64>,
    /// The server has thrown values away before this one.
    pub is_after_loss: bool,
}

/// What came together.
#[derive(Debug, Clone, PartialEq)]
pub struct Told {
    /// When it arrived (ns).
    pub arrived_ns: i64,
    /// The answer to a question for all axes, with the server's time of the answer where it tells it (ns).
    pub answer: Option<Option<i64>>,
    /// Axes and their values.
    pub axes: Vec<(usize, AxisValue)>,
}

/// What becomes of it.
#[derive(Debug, Clone, PartialEq)]
pub enum Joined {
    /// A sample of all axes.
    Sample {
        /// The instant (ns).
        at_ns: i64,
        /// Values in the order of the axes.
        values: [f64; AXES],
    },
    /// Something that makes no sample, and why.
    Refused(String),
}

/// A value that waits.
#[derive(Debug, Clone)]
struct Waiting {
    at_ns: i64,
    axis: usize,
    value: Result<f64, String>,
    message: u64,
}

/// Joins what comes.
#[derive(Debug)]
pub struct Joiner {
    by: JoinBy,
    /// Stamp of the last sample.
    last_stamp: Option<i64>,
    /// By source: what waits for the others, and the newest instant of each axis.
    queues: [VecDeque<(i64, Result<f64, String>)>; AXES],
    seen: [Option<i64>; AXES],
    /// Held: where each axis stands, what waits, and up to where samples were made.
    last: [Option<(i64, Result<f64, String>)>; AXES],
    waiting: Vec<Waiting>,
    done_to: Option<i64>,
    message: u64,
    /// Held: source timestamps of the last answer, and the time of the first one that had them.
    stood: Option<([i64; AXES], i64)>,
    /// An axis has told its first value of the session.
    has_begun: [bool; AXES],
}

impl Joiner {
    /// Nothing has come yet.
    pub fn new(by: JoinBy) -> Joiner {
        Joiner {
            by,
            last_stamp: None,
            queues: Default::default(),
            seen: [None; AXES],
            last: Default::default(),
            waiting: Vec::new(),
            done_to: None,
            message: 0,
            stood: None,
            has_begun: [false; AXES],
        }
    }

    /// A session begins: only the stamps that were given are remembered.
    pub fn begin(&mut self) {
        let (last_stamp, seen) = (self.last_stamp, self.seen);
        *self = Joiner { last_stamp, seen, ..Joiner::new(self.by) };
    }

    /// Takes what came together; an empty message says that nothing has changed.
    pub fn take(&mut self, told: Told) -> Vec<Joined> {
        self.message += 1;
        let mut out = Vec::new();
        match (self.by, told.answer) {
            (JoinBy::Arrival, _) => self.take_arrival(&told, &mut out),
            (JoinBy::Source { apart_ns }, _) => self.take_source(told, apart_ns, &mut out),
            (JoinBy::Held { apart_ns, still_ns }, Some(answered_ns)) => {
                self.take_answer(&told, answered_ns.unwrap_or(told.arrived_ns), (apart_ns, still_ns), &mut out);
            }
            (JoinBy::Held { apart_ns, still_ns }, None) => self.take_held(told, apart_ns, still_ns, &mut out),
        }
        out
    }

    fn take_arrival(&mut self, told: &Told, out: &mut Vec<Joined>) {
        match all_of(&told.axes) {
            Ok(values) => self.give(told.arrived_ns, values.map(|(_, value)| value), out),
            Err(problem) => out.push(Joined::Refused(problem)),
        }
    }

    fn take_source(&mut self, told: Told, apart_ns: i64, out: &mut Vec<Joined>) {
        for (axis, AxisValue { value, source_ns, .. }) in told.axes {
            let Some(at_ns) = source_ns else {
                out.push(Joined::Refused(without_time(axis, value.err())));
                continue;
            };
            let (is_first, before) = (!std::mem::replace(&mut self.has_begun[axis], true), self.seen[axis]);
            match before {
                Some(seen) if at_ns == seen => continue,
                Some(seen) if at_ns < seen => {
                    out.push(Joined::Refused(went_back(axis, at_ns, seen)));
                    continue;
                }
                _ => self.seen[axis] = Some(at_ns),
            }
            if is_first {
                continue;
            }
            self.queues[axis].push_back((at_ns, value));
        }
        while let [Some(x), Some(y), Some(z)] = std::array::from_fn(|axis| self.queues[axis].front().map(|(at, _)| *at))
        {
            let newest = x.max(y).max(z);
            if newest - x.min(y).min(z) > apart_ns {
                for axis in 0..AXES {
                    if self.queues[axis].pop_front_if(|(at, _)| newest - *at > apart_ns).is_some() {
                        out.push(Joined::Refused(alone(axis, apart_ns)));
                    }
                }
                continue;
            }
            let fronts = std::array::from_fn(|axis| self.queues[axis].pop_front().map(|(_, value)| value));
            match values_of(fronts) {
                Ok(values) => self.give(newest, values, out),
                Err(problem) => out.push(Joined::Refused(problem)),
            }
        }
        // A message may hold many values of one axis before the first of another.
        for axis in 0..AXES {
            while self.queues[axis].len() > LONGEST_QUEUE && self.queues[axis].pop_front().is_some() {
                out.push(Joined::Refused(alone(axis, apart_ns)));
            }
        }
    }

    /// An answer has all axes, as they stand.
    fn take_answer(&mut self, told: &Told, answered_ns: i64, (apart_ns, still_ns): (i64, i64), out: &mut Vec<Joined>) {
        let values = match all_of(&told.axes) {
            Ok(values) => values,
            Err(problem) => return out.push(Joined::Refused(problem)),
        };
        let Some(at) = times_of(&values, out) else { return };
        let is_first = !std::mem::replace(&mut self.has_begun[0], true);
        let newest = at.into_iter().fold(i64::MIN, i64::max);
        let since = self.stood.filter(|(stood, since)| *stood == at && *since <= answered_ns).map(|(_, since)| since);
        self.stood = Some((at, since.unwrap_or(answered_ns)));
        if since.is_some_and(|since| answered_ns.saturating_sub(since) >= still_ns) {
            return self.give(answered_ns, values.map(|(_, value)| value), out);
        }
        // How things stood makes no sample; what the answer before said, too, is no new one.
        if is_first || since.is_some() {
            return;
        }
        match (0..AXES).find(|axis| !(newest - at[*axis] <= apart_ns || newest - at[*axis] >= still_ns)) {
            Some(axis) => out.push(Joined::Refused(moves_apart(axis, newest - at[axis], still_ns))),
            None => self.give(newest, values.map(|(_, value)| value), out),
        }
    }

    fn take_held(&mut self, told: Told, apart_ns: i64, still_ns: i64, out: &mut Vec<Joined>) {
        for (axis, AxisValue { value, source_ns, is_after_loss }) in told.axes {
            let Some(at_ns) = source_ns else {
                out.push(Joined::Refused(without_time(axis, value.err())));
                // What it was before holds no longer.
                self.last[axis] = None;
                continue;
            };
            if !std::mem::replace(&mut self.has_begun[axis], true) {
                self.last[axis] = Some((at_ns, value));
                continue;
            }
            if is_after_loss {
                self.waiting.clear();
                out.push(Joined::Refused(format!(
                    "the server threw away values of {} before it could tell them; ask for them less often, or for them more often at once",
                    NAMES[axis]
                )));
            }
            if self.done_to.is_some_and(|done| at_ns <= done) {
                if self.last[axis].as_ref().is_none_or(|(last, _)| at_ns > *last) {
                    out.push(Joined::Refused(late(axis)));
                    self.last[axis] = Some((at_ns, value));
                }
                continue;
            }
            self.waiting.push(Waiting { at_ns, axis, value, message: self.message });
        }
        self.waiting.sort_by_key(|waiting| (waiting.at_ns, waiting.axis));
        while let Some(count) = self.ripe(apart_ns) {
            let ripe: Vec<Waiting> = self.waiting.drain(..count).collect();
            self.hold(ripe, still_ns, out);
        }
    }

    /// So many of those that wait are of one instant, and nothing of it is under way.
    fn ripe(&self, apart_ns: i64) -> Option<usize> {
        let first = self.waiting.first()?;
        let mut has = [false; AXES];
        let together = self.waiting.iter().take_while(|waiting| {
            waiting.at_ns - first.at_ns <= apart_ns && !std::mem::replace(&mut has[waiting.axis], true)
        });
        let (count, newest) = together.fold((0, 0), |(count, newest), one| (count + 1, one.message.max(newest)));
        (count == AXES || newest < self.message).then_some(count)
    }

    /// Values of one instant, with what the others hold.
    fn hold(&mut self, ripe: Vec<Waiting>, still_ns: i64, out: &mut Vec<Joined>) {
        let at_ns = ripe.iter().map(|one| one.at_ns).fold(i64::MIN, i64::max);
        let mut changed = [false; AXES];
        for one in ripe {
            changed[one.axis] = true;
            self.last[one.axis] = Some((one.at_ns, one.value));
        }
        self.done_to = Some(at_ns);
        // Nobody knows yet where all axes stand.
        let [Some(_), Some(_), Some(_)] = &self.last else { return };
        for axis in (0..AXES).filter(|axis| !changed[*axis]) {
            let since = self.last[axis].as_ref().map_or(0, |(last, _)| at_ns - last);
            let next = self.waiting.iter().find(|waiting| waiting.axis == axis).map(|waiting| waiting.at_ns - at_ns);
            if let Some(apart) = [Some(since), next].into_iter().flatten().find(|apart| *apart < still_ns) {
                return out.push(Joined::Refused(moves_apart(axis, apart, still_ns)));
            }
        }
        let values = std::array::from_fn(|axis| self.last[axis].as_ref().map(|(_, value)| value.clone()));
        match values_of(values) {
            Ok(values) => self.give(at_ns, values, out),
            Err(problem) => out.push(Joined::Refused(problem)),
        }
    }

    /// A sample, unless one of this instant or a later one was given.
    fn give(&mut self, at_ns: i64, values: [f64; AXES], out: &mut Vec<Joined>) {
        if self.last_stamp.is_none_or(|last| at_ns > last) {
            self.last_stamp = Some(at_ns);
            out.push(Joined::Sample { at_ns, values });
        } else if self.last_stamp.is_some_and(|last| at_ns < last) {
            let back_s = self.last_stamp.map_or(0.0, |last| (last - at_ns) as f64 / 1e9);
            out.push(Joined::Refused(format!(
                "it is {back_s:.3} s before the reading that was given last; if the clock of the server was set back, start again; if its \
                 clock and that of its axes differ, set them alike"
            )));
        }
    }
}

/// The value of each axis once, with its instant.
fn all_of(axes: &[(usize, AxisValue)]) -> Result<[(Option<i64>, f64); AXES], String> {
    let mut all = [(None, 0.0); AXES];
    for (axis, place) in all.iter_mut().enumerate() {
        let found = axes.iter().find(|(number, _)| *number == axis).map(|(_, value)| value);
        let value = found.ok_or_else(|| format!("the answer has no {}", NAMES[axis]))?;
        *place = (value.source_ns, value.value.clone()?);
    }
    Ok(all)
}

fn times_of(values: &[(Option<i64>, f64); AXES], out: &mut Vec<Joined>) -> Option<[i64; AXES]> {
    let mut at = [0; AXES];
    for (axis, (source_ns, _)) in values.iter().enumerate() {
        match source_ns {
            Some(source_ns) => at[axis] = *source_ns,
            None => {
                out.push(Joined::Refused(without_time(axis, None)));
                return None;
            }
        }
    }
    Some(at)
}

fn values_of(values: [Option<Result<f64, String>>; AXES]) -> Result<[f64; AXES], String> {
    let mut all = [0.0; AXES];
    for (axis, value) in values.into_iter().enumerate() {
        all[axis] = value.unwrap_or_else(|| Err(format!("{} has no value", NAMES[axis])))?;
    }
    Ok(all)
}

fn without_time(axis: usize, problem: Option<String>) -> String {
    problem.unwrap_or_else(|| {
        format!(
            "{} has no source timestamp; if the server has none at all, take reads = \"polled\" with joined = \"arrival\"",
            NAMES[axis]
        )
    })
}

fn went_back(axis: usize, at_ns: i64, seen: i64) -> String {
    let back_s = (seen - at_ns) as f64 / 1e9;
    format!("the source timestamp of {} went back by {back_s:.3} s", NAMES[axis])
}

fn alone(axis: usize, apart_ns: i64) -> String {
    let apart_ms = apart_ns as f64 / 1e6;
    format!(
        "a value of {} has none of the other axes within {apart_ms} ms of its source timestamp; where axes that stand still keep an old \
         one, take joined = \"held\"",
        NAMES[axis]
    )
}

fn moves_apart(axis: usize, apart_ns: i64, still_ns: i64) -> String {
    let (apart_ms, still_ms) = (apart_ns as f64 / 1e6, still_ns as f64 / 1e6);
    format!(
        "{} changed {apart_ms} ms away from this instant, and stands still only after {still_ms} ms: it may have been elsewhere",
        NAMES[axis]
    )
}

fn late(axis: usize) -> String {
    format!("a value of {} came after a reading of a later instant was given, which lacks it", NAMES[axis])
}

#[cfg(test)]
mod tests;
