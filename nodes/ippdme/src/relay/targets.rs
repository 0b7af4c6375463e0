//! Targets turned back, so that the tip goes where the software says.
//!
//! Place in the flow: [`super::Relay`] asks here before it passes on a command that moves the machine, where
//! [`super::Settings::inverts_targets`]. `GoTo` and `PtMeas` name axes; an axis that is not named has to stay where the tip is,
//! so that the server's position is needed. Points of scans stand at fixed places. Only digits of coordinates change.

use super::commands::targets;
use super::report::{AXES, Refused};
use crate::message::Command;
use crate::number;

/// Decimals of a target (mm): a tenth of a nanometre.
const DECIMALS: usize = 7;

/// What a command has for targets.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Targets {
    /// None.
    None,
    /// Named axes (mm), `None` where one is not named.
    Named([Option<f64>; 3]),
    /// Points of a scan (mm), by the places of their numbers among the arguments.
    Points(Vec<(usize, [f64; 3])>),
}

impl Targets {
    pub(super) fn of(command: &Command) -> Result<Targets, Refused> {
        let name = command.name.as_str();
        if matches!(name, "GoTo" | "PtMeas" | "PtMeasSelfCenter" | "PtMeasSelfCenterLocked") {
            let mut named = [None; 3];
            for item in &command.arguments {
                for (value, axis) in named.iter_mut().zip(AXES) {
                    if item.call().is_some_and(|(name, _)| name == axis) {
                        let (mm, _) = item.number_of(axis).ok_or_else(|| format!("{axis} is no number"))?;
                        if value.replace(mm).is_some() {
                            return Err(format!("{axis} stands twice"));
                        }
                    }
                }
            }
            return Ok(if named == [None; 3] { Targets::None } else { Targets::Named(named) });
        }
        let Some((count, places)) = targets(name) else {
            return Err(format!("targets of {name} are not turned back; give others, or run without --invert-targets"));
        };
        if command.arguments.len() != count {
            return Err(format!("{name} has {} arguments, and {count} are known", command.arguments.len()));
        }
        let number = |k: usize| command.arguments[k].number().ok_or_else(|| format!("argument {} is no number", k + 1));
        let point = |k: &usize| Ok((*k, [number(*k)?, number(k + 1)?, number(k + 2)?]));
        Ok(Targets::Points(places.iter().map(point).collect::<Result<_, Refused>>()?))
    }
}

/// The command with these targets in the place of its own; axes that it did not name stand behind the others.
pub(super) fn with_axes(line: &[u8], command: &Command, target_mm: [f64; 3]) -> Result<Vec<u8>, Refused> {
    let mut changes = Vec::new();
    let mut added = String::new();
    for (axis, mm) in AXES.into_iter().zip(target_mm) {
        match command.arguments.iter().find_map(|item| item.number_of(axis)) {
            Some((_, digits)) => changes.push((digits.span.clone(), digits_of(mm)?)),
            None => added += &format!(", {axis}({})", digits_of(mm)?),
        }
    }
    changes.push((command.end..command.end, added));
    Ok(changed(line, changes))
}

/// The scan with these points in the place of its own.
pub(super) fn with_points(line: &[u8], command: &Command, points: &[(usize, [f64; 3])]) -> Result<Vec<u8>, Refused> {
    let mut changes = Vec::new();
    for (first, point_mm) in points {
        for (item, mm) in command.arguments.iter().skip(*first).zip(point_mm) {
            changes.push((item.span.clone(), digits_of(*mm)?));
        }
    }
    Ok(changed(line, changes))
}

fn digits_of(mm: f64) -> Result<String, Refused> {
    number::written(mm, DECIMALS).ok_or_else(|| "the target is no number".to_owned())
}

fn changed(line: &[u8], mut changes: Vec<(std::ops::Range<usize>, String)>) -> Vec<u8> {
    changes.sort_by_key(|(span, _)| span.start);
    let (mut out, mut at) = (Vec::new(), 0);
    for (span, text) in changes {
        out.extend_from_slice(&line[at..span.start]);
        out.extend_from_slice(text.as_bytes());
        at = span.end;
    }
    out.extend_from_slice(&line[at..]);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_digits_of_targets_change() {
        let line = b"00011 GoTo( Y(150), R(180),X( 1e2 ))\r\n";
        let command = Command::parse(crate::line::text(line)).unwrap();
        assert_eq!(Targets::of(&command), Ok(Targets::Named([Some(100.0), Some(150.0), None])));
        let told = with_axes(line, &command, [100.0000001, 149.5, -0.0]).unwrap();
        assert_eq!(told, b"00011 GoTo( Y(149.5000000), R(180),X( 100.0000001 ), Z(0.0000000))\r\n");
        let line = b"00016 ScanOnLine(0,1,2, 10,11,12, 0,0,1, .5)";
        let command = Command::parse(line).unwrap();
        let Targets::Points(points) = Targets::of(&command).unwrap() else { panic!() };
        assert_eq!(points, [(0, [0.0, 1.0, 2.0]), (3, [10.0, 11.0, 12.0])]);
        let moved: Vec<_> = points.iter().map(|(k, p)| (*k, p.map(|mm| mm + 0.5))).collect();
        let told = with_points(line, &command, &moved).unwrap();
        assert_eq!(
            told,
            b"00016 ScanOnLine(0.5000000,1.5000000,2.5000000, 10.5000000,11.5000000,12.5000000, 0,0,1, .5)"
        );
    }

    #[test]
    fn targets_that_are_not_known_are_refused() {
        for (line, words) in [
            ("00016 ScanOnLine(0,1,2)", "3 arguments, and 10"),
            ("00016 ScanOnCurve(Closed(0))", "ScanOnCurve are not turned back"),
            ("00016 GoTo(X(1),X(2))", "twice"),
            ("00016 GoTo(X())", "no number"),
            ("00016 ScanOnLine(0,1,2,3,\"a\",5,6,7,8,9)", "argument 5"),
        ] {
            let command = Command::parse(line.as_bytes()).unwrap();
            assert!(Targets::of(&command).unwrap_err().contains(words), "{line}");
        }
        let turn = Command::parse(b"00016 GoTo(R(90))").unwrap();
        assert_eq!(Targets::of(&turn), Ok(Targets::None));
    }
}
