//! Commands on their way to the server.
//!
//! Place in the flow: [`Relay::from_client`]. A command waits where its answer could not be corrected yet: what is not known of
//! the machine is asked for first. Reports are asked for with all axes, targets are turned back; all else passes as it came.

use super::commands::{Does, does, is_fast, may_be_asked_in_error};
use super::place::Place;
use super::refusal::{Refusal, sign};
use super::report::{Refused, Report};
use super::targets::{Targets, with_axes, with_points};
use super::{Correct, Daemon, Known, Out, Relay, Role, Transaction, moves_tip};
use crate::item::Item;
use crate::line::text;
use crate::message::{Command, Tag};

/// Why scans are refused.
const OPEN_ORDER: &str =
    "values of a scan have no names, and in which order this server writes them is open; see --scans-as-asked";

impl Relay {
    pub(super) fn take_command(&mut self, line: &[u8], correct: &mut dyn Correct) {
        match Command::parse(text(line)) {
            // The fast queue does not wait.
            Ok(command) if is_fast(&command.name) => self.pass_command(line, command, correct),
            _ => self.held.push_back(line.to_vec()),
        }
    }

    /// Passes a command on, or gives it back where it has to wait.
    pub(super) fn pass_on(&mut self, line: Vec<u8>, correct: &mut dyn Correct) -> Option<Vec<u8>> {
        let Ok(command) = Command::parse(text(&line)) else {
            // The server may understand it all the same, and do anything.
            self.distrust();
            self.out.push(Out::ToServer(line));
            return None;
        };
        if self.has_to_wait(&command) {
            return Some(line);
        }
        self.pass_command(&line, command, correct);
        None
    }

    fn does(&self, command: &Command) -> Does {
        match does(&command.name) {
            Does::Unknown if self.settings.harmless.contains(&command.name) => Does::Nothing,
            // Positions are no properties; a server may answer all the same.
            Does::Nothing if command.name.starts_with("GetProp") && Report::of(command).has_axes() => Does::Unknown,
            does => does,
        }
    }

    /// Whether something has to be known before this command; asks for it if nothing else is under way.
    fn has_to_wait(&mut self, command: &Command) -> bool {
        let does = self.does(command);
        let has_targets = matches!(does, Does::Moves | Does::Measures | Does::Scans) && self.settings.inverts_targets;
        let needs_place = match does {
            Does::Gets | Does::ReportsMoves => Report::of(command).has_axes(),
            Does::Measures | Does::Scans | Does::EnablesUser => true,
            _ => has_targets,
        };
        if !self.has_session || !needs_place || self.has_error {
            return false;
        }
        let is_known = match &self.known {
            Known::Here(_) => true,
            Known::Not(why) => why.is_lasting || std::mem::take(&mut self.has_just_asked),
            Known::Stale => false,
        };
        if !is_known {
            if self.pending.is_empty() {
                self.has_just_asked = true;
                self.begin_survey();
            }
            return true;
        }
        let is_partial = matches!(Targets::of(command), Ok(Targets::Named(axes)) if axes.contains(&None));
        if has_targets && is_partial && matches!(self.known, Known::Here(_)) && self.position.is_none() {
            if self.pending.is_empty() {
                self.ask_position();
            }
            return true;
        }
        false
    }

    fn pass_command(&mut self, line: &[u8], command: Command, correct: &mut dyn Correct) {
        let does = self.does(&command);
        if self.has_error && !may_be_asked_in_error(does, &command.name) {
            return self.answer_with(&command, Refusal::InError, "");
        }
        if self.has_error && does == Does::TellsErrorState {
            let data = format!("{} # ErrStatus(1)\r\n", command.tag).into_bytes();
            return self.answer(command.tag, &command.name, vec![data]);
        }
        match self.prepared(line, &command, does, correct) {
            Ok((role, told)) => self.send(command, role, told),
            Err(words) if self.settings.passes_uncorrected => {
                self.out.push(Out::Say(format!("{} {}: passed as it is: {words}", command.tag, command.name)));
                self.send(command, Role::Never(words), line.to_vec());
            }
            Err(words) => {
                let is_lasting = matches!(&self.known, Known::Not(why) if why.is_lasting);
                let refusal = if is_lasting { Refusal::AsItIs } else { Refusal::Point };
                self.answer_with(&command, refusal, &words);
            }
        }
    }

    fn send(&mut self, command: Command, role: Role, line: Vec<u8>) {
        self.position = None;
        let Command { tag, name, .. } = command;
        if !tag.is_unsolicited() {
            let new = Transaction { tag, name, role, is_accepted: false, has_failed: false, is_refused: false };
            self.pending.push_back(new);
        }
        self.out.push(Out::ToServer(line));
    }

    /// What its answers are, and what the server is told; or why it is refused.
    fn prepared(
        &mut self,
        line: &[u8],
        command: &Command,
        does: Does,
        correct: &mut dyn Correct,
    ) -> Result<(Role, Vec<u8>), Refused> {
        let as_it_is = |role: Role| Ok((role, line.to_vec()));
        match does {
            Does::Nothing | Does::Clear | Does::TellsErrorState => {
                // Cleared at once: errors of the server's own stay its own.
                self.has_error &= does != Does::Clear;
                as_it_is(Role::Plain)
            }
            Does::EnablesUser => {
                self.user_enabled = true;
                as_it_is(Role::Plain)
            }
            Does::TellsErrors => as_it_is(Role::Errors),
            Does::Start => as_it_is(Role::Start),
            Does::End => as_it_is(Role::End),
            Does::StopsOne => {
                let named = command.arguments.first().and_then(Item::text);
                as_it_is(Role::StopsOne(named.and_then(|name| Tag::parse(name.as_bytes()))))
            }
            Does::StopsAll => as_it_is(Role::StopsAll),
            Does::SetsProperties => as_it_is(if moves_tip(&command.arguments) { self.turning() } else { Role::Plain }),
            Does::ChangesTool => {
                self.distrust();
                as_it_is(Role::Tool { is_turned: false })
            }
            Does::TurnsTool => as_it_is(self.turning()),
            Does::ChangesCsy => {
                self.distrust();
                as_it_is(Role::Csy)
            }
            Does::Unknown => {
                self.distrust();
                as_it_is(Role::Never(format!("what {} reports is not known; see --harmless", command.name)))
            }
            Does::SetsMeasured | Does::SetsScanned | Does::Gets | Does::ReportsMoves => {
                self.asking(line, command, does)
            }
            Does::Moves | Does::Measures | Does::Scans => {
                let told = self.with_targets(line, command, correct)?;
                Ok((self.moving(command, does)?, told))
            }
        }
    }

    /// The tool is turned; where its tip is then has to be asked for.
    fn turning(&mut self) -> Role {
        self.distrust();
        Role::Tool { is_turned: true }
    }

    /// Commands that say what is reported: with all axes, where there is one.
    fn asking(&mut self, line: &[u8], command: &Command, does: Does) -> Result<(Role, Vec<u8>), Refused> {
        let report = Report::of(command);
        if !report.has_axes() {
            return Ok(match does {
                Does::SetsMeasured => (Role::SetsMeasured(report), line.to_vec()),
                Does::SetsScanned => (Role::SetsScanned(report), line.to_vec()),
                _ => (Role::Plain, line.to_vec()),
            });
        }
        if does == Does::SetsScanned && !self.settings.scans_as_asked {
            return Ok((Role::SetsScanned(report), line.to_vec()));
        }
        if let (Does::SetsScanned, Some(name)) = (does, report.of_unknown_width()) {
            return Err(format!("how many values {name} has in a scan is not known"));
        }
        self.check_lasting(does)?;
        let (report, told) = report.with_all_axes(line, command.end);
        let role = match does {
            Does::SetsMeasured => Role::SetsMeasured(report),
            Does::SetsScanned => Role::SetsScanned(report),
            Does::ReportsMoves => {
                // Reports may come before the command is complete.
                self.daemons.insert(command.tag, Daemon { report, last_words: String::new() });
                Role::Daemon
            }
            _ => Role::Named(report),
        };
        Ok((role, told))
    }

    /// A command whose positions could not be corrected whatever the machine does is not begun.
    fn check_lasting(&self, does: Does) -> Result<(), Refused> {
        match &self.known {
            Known::Not(why) if why.is_lasting && matches!(does, Does::Gets | Does::Measures | Does::Scans) => {
                Err(why.words.clone())
            }
            _ => Ok(()),
        }
    }

    fn moving(&mut self, command: &Command, does: Does) -> Result<Role, Refused> {
        let turns = command.asked().any(|name| name.starts_with("Tool"));
        let turns_on_the_way = command.name == "ScanOnCurve" && turns_at_points(command);
        if does != Does::Moves {
            self.check_lasting(does)?;
            if does == Does::Scans && !self.settings.scans_as_asked {
                return Err(OPEN_ORDER.to_owned());
            }
            if turns || turns_on_the_way {
                return Err("the tool turns in the middle of it, and where its tip is then is not known; turn it before, with AlignTool".to_owned());
            }
        }
        Ok(match does {
            Does::Moves if turns => self.turning(),
            Does::Moves => Role::Silent,
            Does::Scans => Role::Scanned,
            _ => Role::Measured,
        })
    }

    /// The command with its targets turned back, where that is wanted.
    fn with_targets(&mut self, line: &[u8], command: &Command, correct: &mut dyn Correct) -> Result<Vec<u8>, Refused> {
        if !self.settings.inverts_targets {
            return Ok(line.to_vec());
        }
        let targets = Targets::of(command)?;
        if targets == Targets::None {
            return Ok(line.to_vec());
        }
        let Known::Here(place) = &self.known else {
            return Err(self.why_not().unwrap_or_default());
        };
        let told = match targets {
            Targets::None => line.to_vec(),
            Targets::Named(named) => {
                let wanted_mm = whole(place, named, self.position.as_ref(), correct)?;
                with_axes(line, command, place.target_mm(wanted_mm, correct)?)?
            }
            Targets::Points(mut points) => {
                for (_, point_mm) in &mut points {
                    *point_mm = place.target_mm(*point_mm, correct)?;
                }
                with_points(line, command, &points)?
            }
        };
        self.counts.targets += 1;
        Ok(told)
    }

    fn answer_with(&mut self, command: &Command, refusal: Refusal, words: &str) {
        self.has_error = true;
        self.counts.refused += u64::from(refusal != Refusal::InError);
        if refusal != Refusal::InError {
            self.out.push(Out::Say(format!("{} {}: refused: {words}", command.tag, command.name)));
        }
        let error = refusal.line(command.tag, &command.name, words);
        self.answer(command.tag, &command.name, vec![error]);
    }

    /// Answers in the name of the server, when it is its turn.
    fn answer(&mut self, tag: Tag, name: &str, mut lines: Vec<Vec<u8>>) {
        self.position = None;
        self.out.push(Out::ToClient(sign(tag, '&')));
        lines.push(sign(tag, '%'));
        let role = Role::Own(lines);
        let name = name.to_owned();
        self.pending.push_back(Transaction {
            tag,
            name,
            role,
            is_accepted: true,
            has_failed: false,
            is_refused: false,
        });
    }
}

/// Where the tip has to go (mm): axes that are not named stay where it is.
fn whole(
    place: &Place,
    named: [Option<f64>; 3],
    position: Option<&Result<[f64; 3], super::Why>>,
    correct: &mut dyn Correct,
) -> Result<[f64; 3], Refused> {
    if let [Some(x), Some(y), Some(z)] = named {
        return Ok([x, y, z]);
    }
    let reported_mm = match position {
        Some(Ok(reported_mm)) => *reported_mm,
        Some(Err(why)) => return Err(why.words.clone()),
        None => return Err("where the axes are that it does not name is not known".to_owned()),
    };
    let here_mm = place.corrected_mm(reported_mm, correct, super::Purpose::Target)?;
    Ok(std::array::from_fn(|d| named[d].unwrap_or(here_mm[d])))
}

/// Whether a scan along a curve gives the tool a direction at each point.
fn turns_at_points(command: &Command) -> bool {
    let format = command.arguments.iter().find_map(|item| item.call().filter(|(name, _)| *name == "Format"));
    format.is_none_or(|(_, parts)| parts.iter().any(|part| matches!(part.text(), Some("pi" | "si"))))
}
