//! The page of `abbe verify`: errors before and after at points that took no part in any fit.
//!
//! Place in the flow: last step; millimetres and micrometres. Error = actual − indicated after rigid alignment.

use super::Stage;
use abbe_report::{
    Callout, Comparison, ComparisonGroup, Identity, KeyFigure, KeyFigures, MetaItem, NextStep, Quantity, Report,
    Section, State, Tone, Vector, Vectors,
};

/// What the page is made of.
pub(super) struct Page<'a> {
    pub(super) identity: Identity,
    /// File names and hashes.
    pub(super) meta: Vec<MetaItem>,
    /// Positions of the points (m).
    pub(super) at_m: Vec<[f64; 3]>,
    pub(super) stages: &'a [Stage],
    /// Points inside what the model was identified from.
    pub(super) inside: usize,
    /// What so few points do to the figures, where they are few.
    pub(super) few: Option<String>,
    /// That the correction does harm, where it does.
    pub(super) worse: Option<String>,
    /// What the others are, in sentences.
    pub(super) outside: Option<String>,
    pub(super) doubts: Vec<String>,
    /// What to do with the answer.
    pub(super) next: NextStep,
}

/// The report.
pub(super) fn report(page: Page) -> Report {
    let mut sections = vec![figures(&page)];
    sections.extend(limits(&page));
    sections.push(comparison(&page));
    sections.extend(vectors(&page));
    Report {
        title: "Verification".to_owned(),
        lead: Some(format!(
            "{} points of known actual position that took no part in any fit; error = actual − indicated after rigid alignment.",
            page.at_m.len()
        )),
        identity: page.identity,
        next: Some(page.next.clone()),
        meta: page.meta,
        main_plot: None,
        footer: Some(crate::pipeline::software()),
        sections,
    }
}

fn figures(page: &Page) -> Section {
    let figure = |label: &str, of: fn(&Stage) -> f64, detail: String| {
        let (before, after) = (page.stages.first().map(of), page.stages.last().map(of));
        KeyFigure {
            label: label.to_owned(),
            before: before.map(Quantity::result),
            value: after.map(Quantity::result),
            unit: "µm".to_owned(),
            detail: Some(detail),
            tone: match before.zip(after) {
                _ if page.inside == 0 => Tone::Bad,
                Some((before, after)) if after < before => Tone::Good,
                Some(_) => Tone::Bad,
                None => Tone::Neutral,
            },
        }
    };
    let pairs = page.stages.first().map_or(0, |stage| stage.lengths.pairs);
    let limit = page.stages.last().and_then(|stage| stage.lengths.growing_limit());
    let figures = vec![
        figure("3-D error, rms", |stage| stage.rms_um, format!("{} points", page.at_m.len())),
        figure("3-D error, largest", |stage| stage.max_um, "indicated → corrected".to_owned()),
        figure(
            "length error, largest",
            |stage| stage.lengths.largest_m * 1e6,
            format!(
                "{pairs} pairs{}",
                limit.map_or_else(String::new, |limit| format!("; all within {limit} µm, L in mm"))
            ),
        ),
    ];
    Section::KeyFigures(KeyFigures { title: "At a glance".to_owned(), figures })
}

fn limits(page: &Page) -> Vec<Section> {
    let warning = |tone, title: &str, text: String| Section::Callout(Callout { tone, title: title.to_owned(), text });
    let mut list: Vec<Section> = Vec::new();
    list.extend(page.worse.iter().map(|text| warning(Tone::Bad, "The correction makes it worse", format!("{text}."))));
    let tone = if page.inside == 0 { Tone::Bad } else { Tone::Warning };
    list.extend(
        page.outside.iter().map(|text| warning(tone, "Not all points are inside what was measured", text.clone())),
    );
    list.extend(page.few.iter().map(|text| warning(Tone::Warning, "Few points", format!("{text}."))));
    let doubts =
        page.doubts.iter().map(|doubt| warning(Tone::Warning, "What speaks against this model", doubt.clone()));
    list.extend(doubts);
    list
}

fn comparison(page: &Page) -> Section {
    let of_axis =
        |axis: usize| page.stages.iter().map(move |stage| stage.errors_um.iter().map(|e| e[axis].abs()).collect());
    let length = |e: &[f64; 3]| e.iter().map(|v| v * v).sum::<f64>().sqrt();
    let mut groups: Vec<ComparisonGroup> = ["x", "y", "z"]
        .into_iter()
        .enumerate()
        .map(|(axis, label)| ComparisonGroup { label: label.to_owned(), states: of_axis(axis).collect() })
        .collect();
    let lengths = page.stages.iter().map(|stage| stage.errors_um.iter().map(length).collect());
    groups.push(ComparisonGroup { label: "3-D".to_owned(), states: lengths.collect() });
    Section::Comparison(Comparison {
        title: "Error before and after correction".to_owned(),
        note: None,
        label: "error magnitude".to_owned(),
        unit: "µm".to_owned(),
        states: page.stages.iter().map(|stage| stage.name.to_owned()).collect(),
        groups,
    })
}

/// The errors as vectors; none where the points lie in a plane.
fn vectors(page: &Page) -> Option<Section> {
    let (first, last) = (page.stages.first()?, page.stages.last()?);
    let end = |pick: fn(f64, f64) -> f64, axis: usize| page.at_m.iter().map(|p| p[axis] * 1e3).reduce(pick);
    let corner = |pick: fn(f64, f64) -> f64| Some([end(pick, 0)?, end(pick, 1)?, end(pick, 2)?]);
    let (volume_min, volume_max) = (corner(f64::min)?, corner(f64::max)?);
    let point = |(k, at_m): (usize, &[f64; 3])| Vector {
        at: at_m.map(|v| v * 1e3),
        states: [first.errors_um.get(k).copied(), last.errors_um.get(k).copied()],
    };
    (0..3).all(|axis| volume_min[axis] < volume_max[axis]).then(|| {
        Section::Vectors(Vectors {
            title: "Error vectors in the volume".to_owned(),
            note: Some("Each line runs from a point along its error vector.".to_owned()),
            position_unit: "mm".to_owned(),
            vector_unit: "µm".to_owned(),
            vector_in_position: 1e-3,
            volume_min,
            volume_max,
            states: vec![(first.name.to_owned(), State::Before), (last.name.to_owned(), State::After)],
            points: page.at_m.iter().enumerate().map(point).collect(),
        })
    })
}
