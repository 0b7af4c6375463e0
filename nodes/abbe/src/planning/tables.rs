//! Tables of the page of `abbe plan`: stations, path, uncertainty of each error, what can be told of effects and what cannot.
//!
//! Place in the flow: sections of the page; mm, µm, µrad and min, k = 1.

use super::{shape_in_words, unsaid_words};
use abbe_diagnose::{Foresight, Told, ToldParameter};
use abbe_plan::{Plan, Promise};
use abbe_report::diagnosis::{parameter_name, readable_unit, share_text};
use abbe_report::{Callout, Cell, Column, Section, TableSection, Tone, digits};

/// Lines of the path on the page; all of them are in the files.
const LINES: usize = 20;
/// Parameters of an effect that are named; of more, the first and how many more.
const NAMED: usize = 6;
/// Effects named in a sentence.
const MENTIONED: usize = 3;

fn table(title: &str, note: Option<&str>, columns: Vec<Column>, rows: Vec<Vec<Option<Cell>>>) -> Section {
    let (title, note) = (title.to_owned(), note.map(str::to_owned));
    Section::Table(TableSection { title, note, columns, rows, total_rows: None })
}

/// Where the tracer stands, and what is measured from there.
pub(super) fn stations(plan: &Plan) -> Section {
    let row = |(number, station): (usize, &abbe_measurement::planned::Station)| {
        let own = || plan.lines.iter().filter(move |line| line.station == number);
        let [x, y, z] = station.position_m.map(|v| Cell::number(v * 1e3, 0));
        let done = own().filter_map(|line| line.times_s.last()).copied().reduce(f64::max);
        vec![
            Cell::text(&station.name),
            x,
            y,
            z,
            Cell::count(own().count()),
            Cell::count(own().map(|line| line.points_m.len()).sum()),
            Cell::maybe(done.map(|s| s / 60.0), 0),
        ]
    };
    let mut columns = vec![Column::text("station")];
    columns.extend(["X", "Y", "Z"].map(|axis| Column::number(axis, "mm")));
    columns.extend([Column::number("lines", "1"), Column::number("points", "1"), Column::number("done after", "min")]);
    let note = "Centre of the tracer in the machine frame.";
    table("Stations", Some(note), columns, plan.stations.iter().enumerate().map(row).collect())
}

/// The lines in the order of measurement.
pub(super) fn path(plan: &Plan) -> Section {
    let text = |at_m: Option<&[f64; 3]>| at_m.map(|p| p.map(|v| digits::plain(v * 1e3, 0)).join(", "));
    let row = |line: &abbe_measurement::planned::Line| {
        vec![
            Cell::text(&line.name),
            text(line.points_m.first()).and_then(Cell::text),
            text(line.points_m.last()).and_then(Cell::text),
            Cell::count(line.points_m.len()),
            text(Some(&line.offset_m)).and_then(Cell::text),
            Cell::maybe(line.times_s.last().map(|s| s / 60.0), 0),
        ]
    };
    let columns = vec![
        Column::text("line"),
        Column::text("from X, Y, Z / mm"),
        Column::text("to X, Y, Z / mm"),
        Column::number("points", "1"),
        Column::text("offset X, Y, Z / mm"),
        Column::number("done after", "min"),
    ];
    Section::Table(TableSection {
        title: "Path".to_owned(),
        note: Some("Scale readings, in the order of measurement; path.csv has every point.".to_owned()),
        columns,
        rows: plan.lines.iter().take(LINES).map(row).collect(),
        total_rows: Some(plan.lines.len()),
    })
}

/// Lengths and angles apart, since their units differ. A squareness is one number over the whole volume.
pub(super) fn errors(promise: &Promise) -> [Section; 2] {
    let u = |u: f64| Cell::uncertainty(Some(u * 1e6));
    let of = |is_angle: bool| {
        let errors = promise.errors.iter().filter(move |error| error.is_angle == is_angle);
        errors.map(|error| vec![Cell::text(&error.name), u(error.u_rms), u(error.u_largest)])
    };
    let squareness = promise.squareness.iter().map(|(name, own)| vec![Cell::text(name), u(*own), u(*own)]);
    let columns = |unit: &str| {
        let of_volume = ["rms over the volume", "largest"].map(|name| Column::number(name, unit));
        std::iter::once(Column::text("error")).chain(of_volume).collect()
    };
    [
        table("Uncertainty of each error (k = 1): lengths", None, columns("µm"), of(false).collect()),
        table(
            "Uncertainty of each error (k = 1): angles and squareness",
            None,
            columns("µrad"),
            of(true).chain(squareness).collect(),
        ),
    ]
}

/// What the plan leaves open, in a sentence for the first screen.
pub(super) fn open(promise: &Promise) -> Section {
    let callout =
        |tone, text: String| Section::Callout(Callout { tone, title: "What this plan cannot tell".to_owned(), text });
    let effects = match &promise.effects {
        Ok(effects) => effects,
        Err(problem) => return callout(Tone::Warning, unsaid_words(problem)),
    };
    let mut titles: Vec<String> = Vec::new();
    for hidden in &effects.not_identifiable {
        let title = crate::diagnosis::title(hidden.name);
        if !titles.contains(&title) {
            titles.push(title);
        }
    }
    let more = titles.len().saturating_sub(MENTIONED);
    let mut listed = titles.iter().take(MENTIONED).cloned().collect::<Vec<_>>().join(", ");
    if more > 0 {
        listed = format!("{listed} and {more} more");
    }
    let hidden = match titles.len() {
        0 => "Every effect that it tests can be told from the geometry".to_owned(),
        _ => format!("The model's own parameters would take up {listed}"),
    };
    let untestable = match effects.untestable.len() {
        0 => String::new(),
        count => format!("; {count} effects are not tested, for want of a sensor or a move"),
    };
    callout(
        Tone::Neutral,
        format!("{hidden}{untestable}. The tables at the end have the reasons, and what would tell."),
    )
}

/// What can be told, what cannot, and what is not tested; nothing where that cannot be said.
pub(super) fn effects(promise: &Promise) -> Vec<Section> {
    promise.effects.as_ref().map_or_else(|_| Vec::new(), |effects| tables(effects).into())
}

fn tables(effects: &Foresight) -> [Section; 3] {
    let columns = ["effect", "parameters", "known to (k = 1)", "found from"].map(Column::text).to_vec();
    let told = table(
        "Effects that can be told",
        Some("A parameter that is found only from more than it can be is not told by itself, only with the others."),
        columns,
        effects.told.iter().flat_map(told).collect(),
    );
    let hidden = effects.not_identifiable.iter().map(|n| {
        vec![
            Cell::text(named(&crate::diagnosis::title(n.name), &shape_in_words(&n.shape))),
            Cell::text(share_text(n.alias_share)),
            Cell::text(n.aliased_with.join(", ")),
            Cell::text(n.decided_by),
        ]
    });
    let columns = ["effect", "share absorbed", "by", "what would tell"].map(Column::text).to_vec();
    let note = "The model's own parameters absorb them.";
    let hidden = table("Cannot be identified", Some(note), columns, hidden.collect());
    let untestable = effects.untestable.iter().map(|u| vec![Cell::text(&u.title), Cell::text(&u.needs)]);
    let columns = ["effect", "needs"].map(Column::text).to_vec();
    [told, hidden, table("Not tested by this plan", None, columns, untestable.collect())]
}

/// One row for the parameters of an effect that share a unit.
fn told(told: &Told) -> Vec<Vec<Option<Cell>>> {
    let label = named(told.title, &shape_in_words(&told.shape));
    let mut units: Vec<&str> = Vec::new();
    for parameter in &told.parameters {
        if !units.contains(&parameter.unit) {
            units.push(parameter.unit);
        }
    }
    let row = |unit: &&str| {
        let own: Vec<&ToldParameter> = told.parameters.iter().filter(|parameter| parameter.unit == *unit).collect();
        let names: Vec<String> = own.iter().take(NAMED).map(|parameter| parameter_name(&parameter.name)).collect();
        let more = own.len() - names.len();
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        vec![
            Cell::text(&label),
            Cell::text(format!("{}{more}", names.join(", "))),
            Cell::text(range(own.iter().map(|parameter| parameter.u), unit)),
            Cell::text(range(own.iter().map(|parameter| parameter.found_from), unit)),
        ]
    };
    units.iter().map(row).collect()
}

/// Smallest and largest of some uncertainties in the unit of readers.
fn range(values: impl Iterator<Item = f64> + Clone, si: &str) -> String {
    let (factor, unit) = readable_unit(si);
    let (low, high) = (values.clone().fold(f64::INFINITY, f64::min), values.fold(0.0, f64::max));
    let [low, high] = [low, high].map(|value| digits::uncertainty(value * factor));
    if low == high { format!("{low} {unit}") } else { format!("{low} to {high} {unit}") }
}

/// An effect with its shape, where it has one.
fn named(title: &str, shape: &str) -> String {
    if shape.is_empty() { title.to_owned() } else { format!("{title} ({shape})") }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 18 rows for one effect, in rad/(m/s2) with exponents.
    #[test]
    fn regress_parameters_of_one_unit_are_one_row_in_units_of_readers() {
        let parameter = |name: &str, unit, u| ToldParameter { name: name.to_owned(), unit, u, found_from: 5.0 * u };
        let parameters = vec![
            parameter("twist_x", "rad/(m/s2)", 1.7e-7),
            parameter("push_x", "m/(m/s2)", 1.1e-7),
            parameter("twist_y", "rad/(m/s2)", 2.4e-7),
        ];
        let shape = Default::default();
        let rows = told(&Told { name: "dynamic", title: "dynamic bending", shape, alias_share: 0.1, parameters });
        let text = |cell: &Option<Cell>| match cell {
            Some(Cell::Text(text)) => text.clone(),
            other => format!("{other:?}"),
        };
        let rows: Vec<Vec<String>> = rows.iter().map(|row| row.iter().map(text).collect()).collect();
        assert_eq!(
            rows,
            [
                ["dynamic bending", "twist X, twist Y", "0.17 to 0.24 µrad/(m/s²)", "0.85 to 1.2 µrad/(m/s²)"],
                ["dynamic bending", "push X", "0.11 µm/(m/s²)", "0.55 µm/(m/s²)"],
            ]
        );
    }
}
