//! Responses on their way to the software.
//!
//! Place in the flow: [`Relay::from_server`]. A tag says which command a response belongs to, and so what its data is. Positions
//! leave corrected or not at all; what came of the relay's own questions goes no further.

use super::refusal::Refusal;
use super::report::{AXES, Report, Rewritten};
use super::{Correct, Known, Out, Relay, Role, measured_by_default, moves_tip, scanned_by_default};
use crate::item::{Item, What};
use crate::line::text;
use crate::message::{ReplyKind, Response, Tag};
use crate::trouble::Trouble;

/// How values stand in a line.
enum Form<'a> {
    Named(&'a [Item]),
    Flat(&'a [Item]),
}

impl Relay {
    pub(super) fn take_response(&mut self, line: &[u8], correct: &mut dyn Correct) {
        // A carriage return in the middle is the end of a line to some software.
        let parsed = Response::parse(text(line)).ok().filter(|_| !text(line).contains(&b'\r'));
        let Some(response) = parsed else { return self.pass_strange(Tag::UNSOLICITED, line) };
        if self.survey.as_ref().is_some_and(|survey| survey.tag == response.tag) {
            if let Some(mut survey) = self.survey.take() {
                let next = survey.take(&response, &mut self.memory, &self.settings.offsets);
                self.survey = Some(survey);
                self.follow(next);
            }
            return;
        }
        match response.kind {
            ReplyKind::Ack => {
                self.of_tag(response.tag, |transaction| transaction.is_accepted = true);
                let line = self.without_data(&response, '&', line);
                self.pass(&line);
            }
            ReplyKind::Error => {
                let stops = Trouble::parse(response.data()).severity.stops();
                self.of_tag(response.tag, |transaction| transaction.has_failed |= stops);
                match names_an_axis(&response) {
                    true => self.pass_strange(response.tag, line),
                    false => self.pass(line),
                }
            }
            ReplyKind::Done => {
                let line = self.without_data(&response, '%', line);
                self.complete(response.tag, &line);
            }
            ReplyKind::Data => self.take_data(&response, line, correct),
        }
    }

    /// A line that has no data by the protocol, without what it has all the same and may be a position.
    fn without_data(&mut self, response: &Response, sign: char, line: &[u8]) -> Vec<u8> {
        if !response.data().iter().any(u8::is_ascii_digit) {
            return line.to_vec();
        }
        self.counts.refused += 1;
        let words = "what follows the sign of a response may hold a position, and was left out";
        self.refuse(Refusal::Event, response.tag, "", words);
        format!("{} {sign}\r\n", response.tag).into_bytes()
    }

    fn pass(&mut self, line: &[u8]) {
        self.out.push(Out::ToClient(line.to_vec()));
    }

    fn of_tag(&mut self, tag: Tag, change: impl FnOnce(&mut super::Transaction)) {
        if let Some(transaction) = self.pending.iter_mut().find(|transaction| transaction.tag == tag) {
            change(transaction);
        }
    }

    fn complete(&mut self, tag: Tag, line: &[u8]) {
        let at = self.pending.iter().position(|transaction| transaction.tag == tag);
        if let Some(transaction) = at.and_then(|at| self.pending.remove(at)) {
            if transaction.role == Role::Errors && self.has_error {
                let words = "an error of the correction stands; use ClearAllErrors";
                self.out.push(Out::ToClient(Refusal::Point.line(tag, &transaction.name, words)));
            }
            self.conclude(tag, transaction.role, transaction.has_failed);
        }
        self.pass(line);
    }

    /// What is different once a command is complete.
    fn conclude(&mut self, tag: Tag, role: Role, has_failed: bool) {
        match role {
            Role::Tool { is_turned } => {
                // One that failed may have gone half the way.
                self.memory.is_turned = is_turned || (has_failed && self.memory.is_turned);
                self.distrust();
            }
            Role::Csy | Role::Never(_) => self.distrust(),
            Role::Daemon if has_failed => drop(self.daemons.remove(&tag)),
            _ if has_failed => {}
            Role::SetsMeasured(report) => self.measured = report,
            Role::SetsScanned(report) => self.scanned = report,
            Role::StopsOne(named) => drop(named.and_then(|tag| self.daemons.remove(&tag))),
            Role::StopsAll => self.daemons.clear(),
            Role::Start | Role::End => {
                self.has_session = role == Role::Start;
                (self.has_error, self.user_enabled) = (false, false);
                (self.measured, self.scanned) = (measured_by_default(), scanned_by_default());
                self.daemons.clear();
                self.memory = super::Memory::default();
                self.distrust();
            }
            _ => {}
        }
    }

    fn take_data(&mut self, response: &Response, line: &[u8], correct: &mut dyn Correct) {
        let tag = response.tag;
        if let Some(report) = self.daemons.get(&tag).map(|daemon| daemon.report.clone()) {
            return self.pass_event(tag, response, &report, line, correct);
        }
        let Some(transaction) = self.pending.iter().find(|transaction| transaction.tag == tag) else {
            return self.take_unasked(response, line, correct);
        };
        let (report, is_flat) = match &transaction.role {
            Role::Named(report) => (report.clone(), false),
            Role::Measured => (self.measured.clone(), false),
            Role::Scanned => (self.scanned.clone(), true),
            role => {
                let words = match role {
                    Role::Never(words) => words.clone(),
                    _ => "the protocol has no position in answers to this command".to_owned(),
                };
                let is_harmless = match role {
                    Role::Plain | Role::Errors | Role::Tool { is_turned: true } | Role::Csy => {
                        let is_bare = transaction.name == "Get" && has_bare_numbers(response);
                        transaction.name == "GetChangeToolAction" || !(is_bare || names_an_axis(response))
                    }
                    _ => holds_no_position(response),
                };
                return if is_harmless { self.pass(line) } else { self.hold_back(tag, line, &words) };
            }
        };
        if !report.has_axes() {
            let is_other = if is_flat { !report.has_as_many(response) } else { has_bare_numbers(response) };
            return match names_an_axis(response) || is_other {
                true => self.hold_back(tag, line, "the server reports what it was not asked for"),
                false => self.pass(line),
            };
        }
        if transaction.is_refused {
            self.counts.refused += 1;
            return;
        }
        let rewritten = response.items().map_err(|problem| problem.to_string()).and_then(|items| {
            let form = if is_flat { Form::Flat(&items) } else { Form::Named(&items) };
            self.rewritten(line, form, &report, correct)
        });
        match rewritten {
            Ok(line) => self.pass_corrected(line),
            Err(words) => self.hold_back(tag, line, &words),
        }
    }

    /// The line with corrected positions; with the same ones where they may pass so.
    fn rewritten(&mut self, line: &[u8], form: Form, report: &Report, correct: &mut dyn Correct) -> Rewritten {
        if self.is_away() {
            return Err("it came while the proxy had the machine's coordinate system selected".to_owned());
        }
        let Known::Here(place) = &self.known else { return Err(self.why_not().unwrap_or_default()) };
        match form {
            Form::Named(items) => report.named(line, items, |mm| place.convert(mm, correct)),
            Form::Flat(items) => report.flat(line, items, |mm| place.convert(mm, correct)),
        }
    }

    /// Whether the machine's coordinate system is selected for the relay's own questions: what the software is told meanwhile it
    /// would take for its own.
    fn is_away(&self) -> bool {
        self.survey.as_ref().is_some_and(|survey| survey.away_from.is_some())
    }

    /// Whether a position that cannot be corrected passes as it came.
    fn passes_uncorrected(&self) -> bool {
        self.settings.passes_uncorrected && !self.is_away()
    }

    fn pass_corrected(&mut self, line: Vec<u8>) {
        self.counts.corrected += 1;
        self.out.push(Out::ToClient(line));
    }

    /// A position that cannot be corrected.
    fn hold_back(&mut self, tag: Tag, line: &[u8], words: &str) {
        if self.passes_uncorrected() {
            let method = self.name_of(tag);
            self.out.push(Out::Say(format!("{tag} {method}: passed uncorrected: {words}")));
            return self.pass_as_it_was(tag, line);
        }
        self.counts.refused += 1;
        let method = self.name_of(tag);
        self.of_tag(tag, |transaction| transaction.is_refused = true);
        self.refuse(Refusal::Point, tag, &method, words);
    }

    fn name_of(&self, tag: Tag) -> String {
        let of_tag = self.pending.iter().find(|transaction| transaction.tag == tag);
        of_tag.map(|transaction| transaction.name.clone()).unwrap_or_default()
    }

    /// Passes a line without the axes that the software did not ask for.
    fn pass_as_it_was(&mut self, tag: Tag, line: &[u8]) {
        self.counts.uncorrected += 1;
        let role = self.pending.iter().find(|transaction| transaction.tag == tag).map(|transaction| &transaction.role);
        let report = match (role, self.daemons.get(&tag)) {
            (_, Some(daemon)) => Some((&daemon.report, false)),
            (Some(Role::Named(report)), _) => Some((report, false)),
            (Some(Role::Measured), _) => Some((&self.measured, false)),
            (Some(Role::Scanned), _) => Some((&self.scanned, true)),
            _ => None,
        };
        let items = Response::parse(text(line)).ok().and_then(|response| response.items().ok());
        let kept = report.zip(items).and_then(|((report, is_flat), items)| match is_flat {
            true => report.flat(line, &items, |_| Ok(None)).ok(),
            false => report.named(line, &items, |_| Ok(None)).ok(),
        });
        self.out.push(Out::ToClient(kept.unwrap_or_else(|| line.to_vec())));
    }

    /// A report that a daemon sends.
    fn pass_event(&mut self, tag: Tag, response: &Response, report: &Report, line: &[u8], correct: &mut dyn Correct) {
        let rewritten = response.items().map_err(|problem| problem.to_string());
        match rewritten.and_then(|items| self.rewritten(line, Form::Named(&items), report, correct)) {
            Ok(line) => {
                self.pass_corrected(line);
                self.of_daemon(tag, "");
            }
            Err(words) if self.passes_uncorrected() => {
                if self.of_daemon(tag, &words) {
                    self.out.push(Out::Say(format!("{tag}: moves pass uncorrected: {words}")));
                }
                self.pass_as_it_was(tag, line);
            }
            Err(words) => {
                self.counts.refused += 1;
                // The same words ten times a second would hide all others.
                if self.of_daemon(tag, &words) {
                    self.refuse(Refusal::Event, tag, "OnMoveReportE", &words);
                }
            }
        }
    }

    /// Whether these words are new of a daemon.
    fn of_daemon(&mut self, tag: Tag, words: &str) -> bool {
        let daemon = self.daemons.get_mut(&tag);
        daemon.is_some_and(|daemon| std::mem::replace(&mut daemon.last_words, words.to_owned()) != words)
    }

    /// What the server says unasked: keys, and points that the operator took.
    fn take_unasked(&mut self, response: &Response, line: &[u8], correct: &mut dyn Correct) {
        let Ok(items) = response.items() else { return self.pass_strange(response.tag, line) };
        match items.as_slice() {
            [Item { what: What::Call(name, _), .. }] if name == "KeyPress" => self.pass(line),
            [Item { what: What::Call(name, values), .. }] if matches!(name.as_str(), "ChangeTool" | "SetProp") => {
                // A head that is turned at the panel is told by its property.
                self.memory.is_turned = name == "SetProp" && (self.memory.is_turned || moves_tip(values));
                self.distrust();
                self.pass(line);
            }
            [Item { what: What::Call(name, values), .. }] if matches!(name.as_str(), "PtMeas" | "GoTo") => {
                let report = self.measured.clone();
                if !report.has_axes() && !values.iter().any(may_be_coordinate) {
                    return self.pass(line);
                }
                let rewritten = match report.has_axes() {
                    true => self.rewritten(line, Form::Named(values), &report, correct),
                    false => Err("the server reports a position that it was not asked for".to_owned()),
                };
                match rewritten {
                    Ok(line) => self.pass_corrected(line),
                    Err(words) if self.passes_uncorrected() => {
                        self.counts.uncorrected += 1;
                        self.out.push(Out::Say(format!("{} {name}: passed uncorrected: {words}", response.tag)));
                        let kept = report.named(line, values, |_| Ok(None));
                        self.out.push(Out::ToClient(kept.unwrap_or_else(|_| line.to_vec())));
                    }
                    Err(words) => {
                        self.counts.refused += 1;
                        self.refuse(Refusal::Point, response.tag, name, &words);
                    }
                }
            }
            _ => self.pass_strange(response.tag, line),
        }
    }

    /// A line that belongs to nothing known: it passes where it cannot hold a position.
    fn pass_strange(&mut self, tag: Tag, line: &[u8]) {
        let after_tag = text(line).get(5..).unwrap_or_default();
        if !after_tag.iter().any(u8::is_ascii_digit) {
            return self.pass(line);
        }
        let words = "a line of the server belongs to no command and may hold a position";
        if self.passes_uncorrected() {
            self.counts.uncorrected += 1;
            self.out.push(Out::Say(format!("passed as it came: {words}")));
            return self.pass(line);
        }
        self.counts.refused += 1;
        self.refuse(Refusal::Event, tag, "", words);
    }
}

/// Whether data holds neither numbers without a name nor a coordinate.
fn holds_no_position(response: &Response) -> bool {
    fn is_harmless(item: &Item) -> bool {
        !matches!(item.what, What::Number(_) | What::Call(..))
    }
    response.items().is_ok_and(|items| items.iter().all(is_harmless))
}

/// Whether a coordinate stands in data, at any depth; or may, where the data cannot be read.
fn names_an_axis(response: &Response) -> bool {
    fn is_axis(item: &Item) -> bool {
        AXES.iter().any(|axis| item.number_of(axis).is_some())
            || item.call().is_some_and(|(_, inner)| inner.iter().any(is_axis))
    }
    match response.items() {
        Ok(items) => items.iter().any(is_axis),
        Err(_) => response.data().windows(2).any(|pair| matches!(pair, [b'X' | b'Y' | b'Z', b'('])),
    }
}

/// Whether a value may be a coordinate: an axis, or a number without a name, at any depth.
fn may_be_coordinate(item: &Item) -> bool {
    match &item.what {
        What::Number(_) => true,
        What::Call(name, _) if AXES.contains(&name.as_str()) => true,
        // One number with a name of its own is what the name says.
        What::Call(_, values) => values.len() > 1 && values.iter().any(may_be_coordinate),
        _ => false,
    }
}

/// Whether a number without a name stands in data.
fn has_bare_numbers(response: &Response) -> bool {
    response.items().is_ok_and(|items| items.iter().any(|item| item.number().is_some()))
}
