//! The page of `abbe capture`: how far it came, what each station is worth, what was told of single readings.
//!
//! Place in the flow: beside `campaign.csv`; micrometres, k = 1.

use super::Outcome;
use crate::verdict;
use abbe_files::Captured;
use abbe_geometry::chain::nominal_point_m;
use abbe_graph::capture::{PlannedLine, SoFar};
use abbe_identify::verdict::{Finding, Grade};
use abbe_measurement::robust::median;
use abbe_report::{
    Axis, Callout, Cell, Column, Curve, CurveStyle, KeyFigure, KeyFigures, LinePanel, LinePlot, MetaItem, Quantity,
    Report, Section, TableSection, Tone, digits,
};

/// A mean whose own scatter is this many times what the machine file declares is told.
const NOISIER: f64 = 2.0;

/// Lines with open points on the page; report.json has all points.
const OPEN_LINES: usize = 20;

/// The report.
pub(super) fn report(outcome: &Outcome, campaign: Option<MetaItem>, reached: &Result<SoFar, String>) -> Report {
    let mut sections = vec![answer(outcome), key_figures(outcome, reached)];
    if let Err(why) = reached {
        sections.push(callout("It cannot be identified yet", why.clone()));
    }
    for (name, readings, why) in &outcome.captured.left_out {
        sections
            .push(callout("Left out of campaign.csv", format!("The {readings} readings of station {name}: {why}.")));
    }
    for finding in reached.iter().flat_map(|found| &found.findings) {
        sections.push(Section::Callout(finding_callout(finding)));
    }
    let doubted = outcome.capturer.doubted().len();
    if doubted > 0 {
        let text = format!("{doubted} readings, which are not in campaign.csv; journal.jsonl has them.");
        sections.push(callout("In doubt", text));
    }
    sections.extend(lengths(outcome));
    sections.push(stations(outcome));
    sections.extend(open(outcome));
    let software = crate::pipeline::software();
    let files = campaign.into_iter().chain(outcome.files.iter().cloned());
    Report {
        title: format!("Captured campaign of {}", outcome.machine.machine.name),
        lead: Some(
            "One reading a point, averaged over a standstill and held against those before it. journal.jsonl has every reading, \
             those in doubt too."
                .to_owned(),
        ),
        identity: outcome.who.clone(),
        next: Some(outcome.following(reached).step()),
        meta: files.chain([MetaItem::software(&software)]).collect(),
        main_plot: None,
        footer: Some(software),
        sections,
    }
}

/// Whether the plan is done.
fn answer(outcome: &Outcome) -> Section {
    let (done, wanted) = (outcome.capturer.done(), outcome.capturer.wanted());
    let (tone, title, text) = match wanted - done {
        0 => (Tone::Good, "Complete", format!("All {wanted} points of the plan are captured.")),
        open => (Tone::Warning, "Not complete", format!("{open} of {wanted} points of the plan are open.")),
    };
    Section::Callout(Callout { tone, title: title.to_owned(), text })
}

/// Lines of the plan with points that are open, in its order.
fn open(outcome: &Outcome) -> Option<Section> {
    let (capturer, planned) = (outcome.capturer, outcome.capturer.planned());
    let lines = planned.lines.iter().map(|line| {
        let own = || line.points.clone().filter(|point| !capturer.is_done(*point));
        (line, own().count(), own().next().map(|first| planned.reading_m(first)))
    });
    let open: Vec<_> = lines.filter(|(_, count, _)| *count > 0).collect();
    let row = |(line, count, first_m): &(&PlannedLine, usize, Option<[f64; 3]>)| {
        let first = first_m.map(|at_m| at_m.map(|v| digits::plain(v * 1e3, 0)).join(", "));
        vec![
            Cell::text(&line.name),
            Cell::text(&planned.stations[line.station].name),
            Cell::count(*count),
            first.and_then(Cell::text),
        ]
    };
    (!open.is_empty()).then(|| {
        Section::Table(TableSection {
            title: "Still open".to_owned(),
            note: Some("In the order of the plan; scale readings of the first open point of each line.".to_owned()),
            columns: vec![
                Column::text("line"),
                Column::text("station"),
                Column::number("open points", "1"),
                Column::text("first at X, Y, Z / mm"),
            ],
            rows: open.iter().take(OPEN_LINES).map(row).collect(),
            total_rows: Some(open.len()).filter(|all| *all > OPEN_LINES),
        })
    })
}

/// Nothing is refused here; `abbe identify` will.
fn finding_callout(finding: &Finding) -> Callout {
    let title = match finding.grade {
        Grade::Message => "What the readings say of themselves",
        Grade::Warning | Grade::Refusal => "What the readings say against each other",
    };
    Callout { title: title.to_owned(), ..verdict::remark(finding) }
}

fn callout(title: &str, text: String) -> Section {
    Section::Callout(Callout { tone: Tone::Warning, title: title.to_owned(), text })
}

fn key_figures(outcome: &Outcome, reached: &Result<SoFar, String>) -> Section {
    let figure = |label: &str, value: Option<Quantity>, unit: &str, detail: &str| KeyFigure {
        label: label.to_owned(),
        value,
        unit: unit.to_owned(),
        detail: Some(detail.to_owned()),
        ..KeyFigure::default()
    };
    let capturer = outcome.capturer;
    let u = reached.as_ref().ok().map(|found| Quantity::uncertainty(found.u_m * 1e6));
    let own: Vec<f64> = capturer.taken().iter().flatten().map(|reading| reading.u_length_m).collect();
    let scatter = median(own).map(|u_m| Quantity::uncertainty(u_m * 1e6));
    let figures = vec![
        figure(
            "captured",
            Some(Quantity::new(capturer.done() as f64, 0)),
            "",
            &format!("of {} points", capturer.wanted()),
        ),
        figure("uncertainty of a corrected point", u, "µm", "k = 1, in space, rms over the plan's volume"),
        figure(
            "uncertainty that was planned",
            outcome.promised_um.map(Quantity::uncertainty),
            "µm",
            "what the plan promised of it",
        ),
        figure("uncertainty of a mean length", scatter, "µm", "k = 1, by its own scatter; median of all points"),
        figure(
            "readings noisier than declared",
            Some(Quantity::new(noisier(outcome) as f64, 0)),
            "",
            "by their own scatter",
        ),
    ];
    // What is not known yet has no card: the warning below says why.
    let figures = figures.into_iter().filter(|figure| figure.value.is_some()).collect();
    Section::KeyFigures(KeyFigures { title: "At a glance".to_owned(), figures })
}

/// Readings whose mean scatters by more than twice what the machine file declares of a length.
pub(super) fn noisier(outcome: &Outcome) -> usize {
    let planned = outcome.capturer.planned();
    let is_noisier = |reading: &&Captured| {
        let station_m = planned.stations[planned.line(reading.point).station].position_m;
        let range_m =
            (nominal_point_m(reading.reading_m, reading.offset_m) - abbe_geometry::Vector3::from(station_m)).norm();
        reading.u_length_m > NOISIER * outcome.machine.instrument.standard_m(range_m)
    };
    outcome.capturer.taken().iter().flatten().filter(is_noisier).count()
}

/// The uncertainty of each mean length by its own scatter, in the order of the plan; nothing before the first.
fn lengths(outcome: &Outcome) -> Option<Section> {
    let (planned, taken) = (outcome.capturer.planned(), outcome.capturer.taken());
    let of_station = |number: usize| {
        let own = (0..planned.len()).filter(|point| planned.line(*point).station == number);
        let own = own.filter_map(|point| Some((point as f64 + 1.0, taken[point].as_ref()?.u_length_m * 1e6)));
        own.unzip::<f64, f64, Vec<_>, Vec<_>>()
    };
    let curve = |(number, station): (usize, &abbe_graph::capture::PlannedStation)| {
        let (x, u_um) = of_station(number);
        let style = CurveStyle::Points((number % 8 + 1) as u8);
        Curve {
            name: station.name.clone(),
            style,
            x,
            y: u_um.into_iter().map(Some).collect(),
            also: None,
            half_width: None,
        }
    };
    let curves: Vec<Curve> =
        planned.stations.iter().enumerate().map(curve).filter(|curve| !curve.x.is_empty()).collect();
    (!curves.is_empty()).then(|| {
        Section::LinePlot(LinePlot {
            title: "Uncertainty of each mean length".to_owned(),
            note: Some(
                "k = 1, by the scatter of the lengths in its standstill; points in the order of the plan, by station."
                    .to_owned(),
            ),
            columns: 1,
            band_name: None,
            panels: vec![LinePanel {
                title: String::new(),
                x: Axis::new("point of the plan", "1"),
                y: Axis::new("uncertainty of a mean length", "µm"),
                curves,
            }],
        })
    })
}

fn stations(outcome: &Outcome) -> Section {
    let (planned, taken) = (outcome.capturer.planned(), outcome.capturer.taken());
    // A row of dashes tells less than a name.
    let has_readings =
        |number: usize| (0..planned.len()).any(|k| taken[k].is_some() && planned.line(k).station == number);
    let (begun, open): (Vec<_>, Vec<_>) =
        planned.stations.iter().enumerate().partition(|(number, _)| has_readings(*number));
    let row = |(number, station): (usize, &abbe_graph::capture::PlannedStation)| {
        // A point at which the machine stands already needs no reading of its own.
        let is_wanted = |point: &usize| taken[*point].is_some() || !planned.is_spare(*point);
        let of_station = |point: &usize| planned.line(*point).station == number;
        let points = || (0..planned.len()).filter(of_station).filter(is_wanted);
        let own: Vec<&Captured> = points().filter_map(|point| taken[point].as_ref()).collect();
        let middle = |of: &dyn Fn(&Captured) -> f64| median(own.iter().map(|reading| of(reading)).collect());
        let zeros = own.iter().map(|reading| reading.zero).max();
        vec![
            Cell::text(&station.name),
            Cell::count(points().count()),
            Cell::count(own.len()),
            Cell::count(zeros.map_or(0, |zeros| zeros as usize)),
            Cell::uncertainty(middle(&|reading| reading.scatter_m * 1e6)),
            Cell::uncertainty(middle(&|reading| reading.u_length_m * 1e6)),
            Cell::maybe(middle(&|reading| reading.stood_s), 2),
        ]
    };
    let columns = vec![
        Column::text("station"),
        Column::number("points", "1"),
        Column::number("captured", "1"),
        Column::number("jumps of the zero", "1"),
        Column::number("scatter of a length", "µm"),
        Column::number("uncertainty of a mean", "µm"),
        Column::number("averaged over", "s"),
    ];
    let mut note = "Medians; of lengths in one standstill, k = 1.".to_owned();
    if !open.is_empty() {
        let names: Vec<&str> = open.iter().map(|(_, station)| station.name.as_str()).collect();
        note.push_str(&format!(" No readings yet from {}.", names.join(", ")));
    }
    Section::Table(TableSection {
        title: "Stations".to_owned(),
        note: Some(note),
        columns,
        rows: begun.into_iter().map(row).collect(),
        total_rows: None,
    })
}
