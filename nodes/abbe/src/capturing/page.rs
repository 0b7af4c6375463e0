//! The page of `abbe capture`: how far it came, what each station is worth, what was told of single readings.
//!
//! Place in the flow: beside `campaign.csv`; micrometres, k = 1.

use super::Outcome;
use abbe_files::Captured;
use abbe_geometry::chain::nominal_point_m;
use abbe_graph::capture::{CapturedCampaign, SoFar};
use abbe_measurement::robust::median;
use abbe_report::{
    Callout, Cell, Column, KeyFigure, KeyFigures, MetaItem, Quantity, Report, Section, TableSection, Tone,
};

/// A mean whose own scatter is this many times what the machine file declares is told.
const NOISIER: f64 = 2.0;

/// The report.
pub(super) fn report(outcome: &Outcome, captured: &CapturedCampaign, reached: &Result<SoFar, String>) -> Report {
    let capturer = outcome.capturer;
    let mut sections = vec![key_figures(outcome, reached)];
    if let Err(why) = reached {
        sections.push(callout("It cannot be identified yet", why.clone()));
    }
    for (name, readings, why) in &captured.left_out {
        sections
            .push(callout("Left out of campaign.csv", format!("The {readings} readings of station {name}: {why}.")));
    }
    for finding in reached.iter().flat_map(|found| &found.findings) {
        sections.push(callout("What the readings say against each other", finding.clone()));
    }
    sections.push(stations(outcome));
    Report {
        title: format!("Captured campaign of {}", outcome.machine.machine.name),
        lead: Some(
            "One reading a point, averaged over a standstill and held against those before it. journal.jsonl has every reading, \
             those in doubt too."
                .to_owned(),
        ),
        identity: outcome.who.clone(),
        next: Some(outcome.following(reached).step()),
        meta: vec![
            MetaItem::new("Points", format!("{} of {}", capturer.done(), capturer.wanted())),
            MetaItem::new("Every reading", "journal.jsonl"),
            MetaItem::software(crate::pipeline::software()),
        ],
        main_plot: None,
        footer: Some(crate::pipeline::software()),
        sections,
    }
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
        figure("corrected point", u, "µm", "k = 1, in space, rms over the plan's volume"),
        figure("planned", outcome.promised_um.map(Quantity::uncertainty), "µm", "what the plan promised of it"),
        figure("mean length", scatter, "µm", "median uncertainty by its own scatter"),
        figure(
            "noisier than declared",
            Some(Quantity::new(noisier(outcome) as f64, 0)),
            "",
            "readings whose own scatter says so",
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

fn stations(outcome: &Outcome) -> Section {
    let (planned, taken) = (outcome.capturer.planned(), outcome.capturer.taken());
    let row = |(number, station): (usize, &abbe_graph::capture::PlannedStation)| {
        let points = || (0..planned.len()).filter(move |point| planned.line(*point).station == number);
        let own: Vec<&Captured> = points().filter_map(|point| taken[point].as_ref()).collect();
        let middle = |of: &dyn Fn(&Captured) -> f64| median(own.iter().map(|reading| of(reading)).collect());
        let zeros = own.iter().map(|reading| reading.zero).max();
        vec![
            Cell::text(&station.name),
            Cell::count(points().count()),
            Cell::count(own.len()),
            zeros.and_then(|zeros| Cell::count(zeros as usize)),
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
        Column::number("single length", "µm"),
        Column::number("mean length", "µm"),
        Column::number("averaged over", "s"),
    ];
    Section::Table(TableSection {
        title: "Stations".to_owned(),
        note: Some("Medians; lengths by their own scatter in the standstill, k = 1.".to_owned()),
        columns,
        rows: planned.stations.iter().enumerate().map(row).collect(),
        total_rows: None,
    })
}
