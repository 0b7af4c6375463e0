//! What a response reports, and the same with other coordinates.
//!
//! Place in the flow: below [`super::Relay`]. A report is asked for by names; axes that it lacks are asked for beside them, since
//! no position can be corrected without all three, and are taken out of the answer again. Only the digits of coordinates are
//! replaced; every other byte of a line stays. Lengths in millimetres, in the coordinate system that is active.

use crate::item::Item;
use crate::message::{Command, Response};
use crate::number;

/// Axes of a position.
pub(super) const AXES: [&str; 3] = ["X", "Y", "Z"];
/// Decimals of a corrected coordinate (mm) at least: those of `abbe correct`.
const LEAST_DECIMALS: usize = 7;
/// Arguments of reports on moves that are no part of what is reported.
const NOT_REPORTED: [&str; 2] = ["Time", "Dis"];

/// What a report holds, in the order in which it was asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Report {
    names: Vec<String>,
    /// Axes that were asked for beside them; they stand last.
    added: usize,
}

/// Why a line cannot be corrected.
pub(super) type Refused = String;

impl Report {
    pub(super) fn of_names(names: &[&str]) -> Report {
        Report { names: names.iter().map(|name| (*name).to_owned()).collect(), added: 0 }
    }

    /// What a command asks for.
    pub(super) fn of(command: &Command) -> Report {
        let names: Vec<&str> = command.asked().filter(|name| !NOT_REPORTED.contains(name)).collect();
        Report::of_names(&names)
    }

    /// Whether it holds a coordinate.
    pub(super) fn has_axes(&self) -> bool {
        self.names.iter().any(|name| AXES.contains(&name.as_str()))
    }

    /// The report with all axes, and the command that asks for it.
    pub(super) fn with_all_axes(mut self, line: &[u8], end: usize) -> (Report, Vec<u8>) {
        let mut asking = line[..end].to_vec();
        for axis in AXES {
            if !self.names.iter().any(|name| name == axis) {
                asking.extend_from_slice(format!(", {axis}()").as_bytes());
                self.names.push(axis.to_owned());
                self.added += 1;
            }
        }
        asking.extend_from_slice(&line[end..]);
        (self, asking)
    }

    fn asked(&self) -> &[String] {
        &self.names[..self.names.len() - self.added]
    }

    /// A name that stands for a number of values that is not known here.
    pub(super) fn of_unknown_width(&self) -> Option<&str> {
        self.names.iter().map(String::as_str).find(|name| width(name).is_none())
    }

    /// The line with these values, each named, with other coordinates; with the same ones where `convert` gives `None`.
    pub(super) fn named(&self, line: &[u8], items: &[Item], convert: impl FnOnce([f64; 3]) -> Converted) -> Rewritten {
        let mut place = [None; 3];
        for (k, item) in items.iter().enumerate() {
            for (found, axis) in place.iter_mut().zip(AXES) {
                if item.call().is_some_and(|(name, _)| name == axis) {
                    let (value_mm, digits) = item.number_of(axis).ok_or_else(|| format!("{axis} is no number"))?;
                    if found.replace((k, value_mm, digits)).is_some() {
                        return Err(format!("{axis} stands twice"));
                    }
                }
            }
        }
        let [Some(x), Some(y), Some(z)] = place else {
            return Err("the server did not report X, Y and Z together".to_owned());
        };
        let told = [x, y, z];
        let texts = told.map(|(_, _, digits)| &line[digits.span.clone()]);
        let new = convert(told.map(|(_, value_mm, _)| value_mm))?.map(|to_mm| digits_of(to_mm, texts)).transpose()?;
        let mut pieces = Pieces::new(line, items);
        for (k, item) in items.iter().enumerate() {
            let axis = told.iter().position(|(place, ..)| *place == k);
            match (axis, &new) {
                (Some(d), _) if !self.asked().iter().any(|name| name == AXES[d]) => pieces.leave_out(item),
                (Some(d), Some(new)) => pieces.replace(item, told[d].2, &new[d]),
                _ => pieces.keep(item),
            }
        }
        Ok(pieces.finish())
    }

    /// Whether data without names holds as many values as were asked for, or a multiple of them.
    pub(super) fn has_as_many(&self, response: &Response) -> bool {
        let asked = self.names.iter().map(|name| width(name)).sum::<Option<usize>>();
        let told = response.items().map(|items| items.len());
        match (asked, told) {
            (Some(0), Ok(told)) => told == 0,
            (Some(asked), Ok(told)) => told.is_multiple_of(asked),
            _ => false,
        }
    }

    /// The same for values without names, as scans report them: one point or several, one after the other.
    pub(super) fn flat(
        &self,
        line: &[u8],
        items: &[Item],
        mut convert: impl FnMut([f64; 3]) -> Converted,
    ) -> Rewritten {
        let mut columns = Vec::new();
        for (k, name) in self.names.iter().enumerate() {
            let wide = width(name).ok_or_else(|| format!("how many values {name} has is not known"))?;
            columns.extend(std::iter::repeat_n((name.as_str(), k >= self.asked().len()), wide));
        }
        let at = AXES.map(|axis| columns.iter().position(|(name, _)| *name == axis));
        let [Some(x), Some(y), Some(z)] = at else { return Err("the report lacks an axis".to_owned()) };
        if items.is_empty() || !items.len().is_multiple_of(columns.len()) {
            return Err(format!("{} values are no multiple of the {} asked for", items.len(), columns.len()));
        }
        let values = items.iter().map(Item::number).collect::<Option<Vec<f64>>>().ok_or("a value is no number")?;
        let mut pieces = Pieces::new(line, items);
        for (point, values) in items.chunks(columns.len()).zip(values.chunks(columns.len())) {
            check_quality(&columns, values)?;
            let texts = [x, y, z].map(|k| &line[point[k].span.clone()]);
            let new = convert([values[x], values[y], values[z]])?.map(|to_mm| digits_of(to_mm, texts)).transpose()?;
            for (item, (name, is_added)) in point.iter().zip(&columns) {
                let axis = AXES.iter().position(|axis| axis == name);
                match (axis, &new) {
                    _ if *is_added => pieces.leave_out(item),
                    (Some(d), Some(new)) => pieces.replace(item, item, &new[d]),
                    _ => pieces.keep(item),
                }
            }
        }
        Ok(pieces.finish())
    }
}

/// Other coordinates (mm), `None` for the same ones, or why there are none.
pub(super) type Converted = Result<Option<[f64; 3]>, Refused>;
/// A line with other coordinates, or why there is none.
pub(super) type Rewritten = Result<Vec<u8>, Refused>;

/// Values that a name stands for where values have no names.
fn width(name: &str) -> Option<usize> {
    match name {
        "X" | "Y" | "Z" | "R" | "Q" | "ER" | "Tool.A" | "Tool.B" | "Tool.C" => Some(1),
        "IJK" => Some(3),
        _ => None,
    }
}

/// A quality outside 0 to 100 says that values stand in another order than asked for.
fn check_quality(columns: &[(&str, bool)], values: &[f64]) -> Result<(), Refused> {
    let qualities = columns.iter().zip(values).filter(|((name, _), _)| *name == "Q");
    match qualities.map(|(_, value)| value).find(|value| !(0.0..=100.0).contains(*value)) {
        Some(value) => {
            Err(format!("Q is {value}, and must lie in 0 to 100: the server writes values in another order"))
        }
        None => Ok(()),
    }
}

/// Coordinates (mm) as digits: as many decimals as the server wrote, and seven at least.
fn digits_of(coordinates_mm: [f64; 3], told: [&[u8]; 3]) -> Result<[String; 3], Refused> {
    let decimals = told.map(number::decimals).into_iter().fold(LEAST_DECIMALS, usize::max);
    let written = coordinates_mm.map(|value| number::written(value, decimals));
    let [Some(x), Some(y), Some(z)] = written else { return Err("the corrected position is no number".to_owned()) };
    Ok([x, y, z])
}

/// A line that is put together again from its parts.
struct Pieces<'a> {
    line: &'a [u8],
    out: Vec<u8>,
    /// Where the part before ended.
    at: usize,
    end: usize,
    has_begun: bool,
}

impl<'a> Pieces<'a> {
    fn new(line: &'a [u8], items: &[Item]) -> Pieces<'a> {
        let first = items.first().map_or(line.len(), |item| item.span.start);
        let end = items.last().map_or(line.len(), |item| item.span.end);
        Pieces { line, out: line[..first].to_vec(), at: first, end, has_begun: false }
    }

    fn keep(&mut self, item: &Item) {
        self.separate(item);
        self.out.extend_from_slice(&self.line[item.span.clone()]);
    }

    /// The part with other digits.
    fn replace(&mut self, item: &Item, digits: &Item, new: &str) {
        self.separate(item);
        self.out.extend_from_slice(&self.line[item.span.start..digits.span.start]);
        self.out.extend_from_slice(new.as_bytes());
        self.out.extend_from_slice(&self.line[digits.span.end..item.span.end]);
    }

    fn leave_out(&mut self, item: &Item) {
        self.at = item.span.end;
    }

    fn separate(&mut self, item: &Item) {
        if std::mem::replace(&mut self.has_begun, true) {
            self.out.extend_from_slice(&self.line[self.at..item.span.start]);
        }
        self.at = item.span.end;
    }

    fn finish(mut self) -> Vec<u8> {
        self.out.extend_from_slice(&self.line[self.end..]);
        self.out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::Response;

    fn add(point: [f64; 3]) -> Converted {
        Ok(Some([point[0] + 0.001, point[1] + 0.002, point[2] + 0.003]))
    }

    fn named(asking: &str, line: &str) -> Result<String, Refused> {
        let command = Command::parse(asking.as_bytes()).unwrap();
        let (report, _) = Report::of(&command).with_all_axes(asking.as_bytes(), command.end);
        let items = Response::parse(line.as_bytes()).unwrap().items().unwrap();
        Ok(String::from_utf8(report.named(line.as_bytes(), &items, add)?).unwrap())
    }

    fn flat(asking: &str, line: &str) -> Result<String, Refused> {
        let command = Command::parse(asking.as_bytes()).unwrap();
        let (report, _) = Report::of(&command).with_all_axes(asking.as_bytes(), command.end);
        let items = Response::parse(line.as_bytes()).unwrap().items().unwrap();
        Ok(String::from_utf8(report.flat(line.as_bytes(), &items, add)?).unwrap())
    }

    #[test]
    fn axes_that_are_missing_are_asked_for_and_taken_out_again() {
        let line = b"00012 Get( X(),Tool.A() )\r\n";
        let command = Command::parse(crate::line::text(line)).unwrap();
        let (_, asking) = Report::of(&command).with_all_axes(line, command.end);
        assert_eq!(asking, b"00012 Get( X(),Tool.A() , Y(), Z())\r\n");
        let told = "00012 # X(1.0000), Tool.A(45.00),Y(2.0), Z(3)";
        assert_eq!(named("00012 Get(X(),Tool.A())", told).unwrap(), "00012 # X(1.0010000), Tool.A(45.00)");
        assert_eq!(named("00012 Get(Tool.A(), Z())", told).unwrap(), "00012 # Tool.A(45.00), Z(3.0030000)");
    }

    #[test]
    fn only_digits_of_coordinates_change_whatever_the_order() {
        let told = "00012 #  Z( -7. ),IJK(0, 0,1) ,X(+2.6E01) , Y(.77000001)";
        assert_eq!(
            named("00012 Get(X(),Y(),Z(),IJK())", told).unwrap(),
            "00012 #  Z( -6.99700000 ),IJK(0, 0,1) ,X(26.00100000) , Y(0.77200001)"
        );
        for (told, words) in [
            ("00012 # X(1), Y(2)", "together"),
            ("00012 # X(1), Y(2), Z(3), X(1)", "twice"),
            ("00012 # X(1), Y(2), Z(\"3\")", "Z is no number"),
            ("00012 # X(1), Y(2), Z(3,4)", "Z is no number"),
            ("00012 # 1, 2, 3", "together"),
        ] {
            assert!(named("00012 Get(X(),Y(),Z())", told).unwrap_err().contains(words), "{told}");
        }
    }

    #[test]
    fn scans_are_points_in_a_row() {
        let asking = "00014 OnScanReport(X(),Y(),Z(),Q())";
        let told = "00016 # 118.5, 0.0001, -3.0002, 0,118.4992,0.1614,3.0002, 100";
        assert_eq!(
            flat(asking, told).unwrap(),
            "00016 # 118.5010000, 0.0021000, -2.9972000, 0,118.5002000,0.1634000,3.0032000, 100"
        );
        let partial = "00014 OnScanReport(IJK(), Z())";
        assert_eq!(
            flat(partial, "00016 # 0,0,1,3,1,2, 0,1,0,6,4,5").unwrap(),
            "00016 # 0,0,1,3.0030000, 0,1,0,6.0030000"
        );
        for (asking, told, words) in [
            (asking, "00016 # 1,2,3", "no multiple of the 4"),
            (asking, "00016 # ", "0 values"),
            (asking, "00016 # 0,1,2,300", "another order"),
            (asking, "00016 # 0,1,2,\"a\"", "no number"),
            ("00014 OnScanReport(X(),Tool.Alignment())", "00016 # 0,1,2", "Tool.Alignment"),
        ] {
            assert!(flat(asking, told).unwrap_err().contains(words), "{told}");
        }
    }
}
