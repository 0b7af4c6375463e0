//! Sections on pages: what stands where, as SVG in px of a page that is 1200 px wide.
//!
//! In: a checked report. Out: the body of each page. What does not fit a page begins the next one, and a drawing that is higher than
//! a page is made smaller.

use super::pages::{BOTTOM, MARGIN, PAGE_PX, Pages, WIDTH, empty, letters, lines, title};
use super::table;
use crate::error::ReportError;
use crate::report::Report;
use crate::sections::{Callout, KeyFigure, KeyFigures, Section, Tone};
use crate::svg::Anchor;
use crate::text::{MISSING, fixed, prose};

/// Height of a heading, and of what is to follow it on the same page.
const HEADING: f64 = 71.0;
const AHEAD: f64 = 220.0;
/// Width of the labels of values below each other, and height of a row there.
const LABEL: f64 = 190.0;
const ROW: f64 = 24.0;
/// Cards of key figures side by side.
const CARDS: usize = 4;

/// The pages of a report.
pub(super) fn pages(report: &Report) -> Result<Vec<String>, ReportError> {
    let mut pages = Pages::new();
    pages.text("h1", 34.0, &report.title)?;
    if let Some(lead) = &report.lead {
        pages.text("body muted", 18.0, &prose(lead))?;
    }
    pages.y += 10.0;
    pages.rule("rule");
    let known = report.identity.lines();
    pairs(&mut pages, &known.iter().map(|(label, text)| (*label, text.as_str())).collect::<Vec<_>>())?;
    let (opening, rest) = report.sections.split_at(report.opening());
    opening.iter().try_for_each(|section| add(&mut pages, section))?;
    rest.iter().try_for_each(|section| add(&mut pages, section))?;
    let made = report.made_from();
    if !made.is_empty() {
        let made: Vec<(&str, &str)> = made.iter().map(|(label, text)| (label.as_str(), *text)).collect();
        heading(&mut pages, "Made from", (HEADING + pairs_height(&made)).min(AHEAD))?;
        pairs(&mut pages, &made)?;
    }
    pages.end()?;
    with_footers(report, pages.done)
}

/// Each page with its number and what it belongs to; a long footer goes on into the margin.
fn with_footers(report: &Report, bodies: Vec<String>) -> Result<Vec<String>, ReportError> {
    const LINE: f64 = 15.0;
    let count = bodies.len();
    let certificate = report.identity.certificate.as_ref().map(|number| format!("certificate {number}"));
    let parts: Vec<String> = certificate.into_iter().chain(report.footer.clone()).collect();
    let left = lines(&parts.join("  ·  "), letters(WIDTH - 160.0, 11.0));
    let with_footer = |(index, body): (usize, String)| {
        let mut svg = empty();
        let y = PAGE_PX[1] - MARGIN;
        for (k, line) in left.iter().enumerate() {
            svg.text("small muted", (MARGIN, y + LINE * k as f64), Anchor::Start, line);
        }
        let number = format!("page {} of {count}", index + 1);
        svg.text("small muted", (MARGIN + WIDTH, y), Anchor::End, &number);
        Ok(body + &svg.finish("PDF")?.body)
    };
    bodies.into_iter().enumerate().map(with_footer).collect()
}

/// A heading alone at the foot of a page belongs to the next: it stands where there is room for so much.
fn heading(pages: &mut Pages, title: &str, room: f64) -> Result<(), ReportError> {
    pages.need(room)?;
    pages.y += 26.0;
    pages.rule("thick");
    pages.y += 8.0;
    pages.text("h2", 26.0, title)
}

/// Lines of a value beside its label.
fn value_lines(value: &str) -> Vec<String> {
    lines(value, letters(WIDTH - LABEL, 16.0))
}

/// Height of what [`pairs`] sets.
fn pairs_height(pairs: &[(&str, &str)]) -> f64 {
    8.0 + pairs.iter().map(|(_, value)| ROW * value_lines(value).len() as f64).sum::<f64>()
}

/// Labels and values below each other.
fn pairs(pages: &mut Pages, pairs: &[(&str, &str)]) -> Result<(), ReportError> {
    pages.y += 8.0;
    for (label, value) in pairs {
        let value = value_lines(value);
        pages.need(ROW * value.len() as f64)?;
        for (index, line) in value.iter().enumerate() {
            pages.y += ROW;
            let y = pages.y - 6.0;
            if index == 0 {
                pages.svg().text("mutedb", (MARGIN, y), Anchor::Start, label);
            }
            pages.svg().text("cell", (MARGIN + LABEL, y), Anchor::Start, line);
        }
    }
    Ok(())
}

fn add(pages: &mut Pages, section: &Section) -> Result<(), ReportError> {
    match section {
        Section::Heading(found) => {
            heading(pages, &found.title, AHEAD)?;
            found.intro.as_deref().map_or(Ok(()), |intro| pages.text("body", 18.0, &prose(intro)))
        }
        Section::KeyFigures(figures) => cards(pages, figures),
        Section::Callout(found) => callout(pages, found),
        Section::Table(found) => table::add(pages, found),
        figure => match figure.drawing() {
            Some(drawn) => {
                let (drawing, note) = drawn?;
                let room = BOTTOM - MARGIN - 120.0;
                let scale = (room / drawing.height).min(1.0);
                pages.need(90.0 + scale * drawing.height)?;
                title(pages, figure.title(), note.as_deref())?;
                let y = pages.y + 8.0;
                pages.svg().place(&drawing, (MARGIN, y), scale);
                pages.y = y + scale * drawing.height;
                Ok(())
            }
            None => Ok(()),
        },
    }
}

fn cards(pages: &mut Pages, figures: &KeyFigures) -> Result<(), ReportError> {
    pages.y += 14.0;
    let width = WIDTH / CARDS as f64;
    let of_label = |figure: &KeyFigure| lines(&figure.heading(), letters(width - 28.0, 16.0));
    let of_detail =
        |figure: &KeyFigure| lines(&prose(figure.detail.as_deref().unwrap_or_default()), letters(width - 28.0, 15.0));
    for row in figures.figures.chunks(CARDS) {
        let most = |of: &dyn Fn(&KeyFigure) -> Vec<String>| row.iter().map(|f| of(f).len()).max().unwrap_or(0) as f64;
        let (labels, details) = (19.0 * most(&of_label), 18.0 * most(&of_detail));
        let height = labels + 40.0 + details;
        pages.need(height + 12.0)?;
        let top = pages.y;
        for (index, figure) in row.iter().enumerate() {
            let left = MARGIN + index as f64 * width;
            let svg = pages.svg();
            svg.rect(tone_class(figure.tone), (left, top), (4.0, height), None);
            let x = left + 16.0;
            for (k, line) in of_label(figure).iter().enumerate() {
                svg.text("mutedb", (x, top + 15.0 + 19.0 * k as f64), Anchor::Start, line);
            }
            let value = figure.value.map_or_else(|| MISSING.to_owned(), |v| fixed(v.value, v.decimals));
            let value = match figure.before {
                Some(before) => format!("{} → {value}", fixed(before.value, before.decimals)),
                None => value,
            };
            svg.text("value", (x, top + labels + 28.0), Anchor::Start, format!("{value} {}", figure.unit).trim());
            for (k, line) in of_detail(figure).iter().enumerate() {
                svg.text("detail muted", (x, top + labels + 52.0 + 18.0 * k as f64), Anchor::Start, line);
            }
        }
        pages.y = top + height + 12.0;
    }
    Ok(())
}

fn tone_class(tone: Tone) -> &'static str {
    match tone {
        Tone::Neutral => "neutral",
        Tone::Good => "good",
        Tone::Warning => "warning",
        Tone::Bad => "bad",
    }
}

fn callout(pages: &mut Pages, callout: &Callout) -> Result<(), ReportError> {
    const LINE: f64 = 25.0;
    let text = lines(&callout.sentence(), letters(WIDTH - 40.0, 18.0));
    let height = LINE * (text.len() + 1) as f64 + 18.0;
    pages.need(height + 14.0)?;
    let top = pages.y + 14.0;
    let svg = pages.svg();
    svg.rect("panel", (MARGIN, top), (WIDTH, height), None);
    svg.rect(tone_class(callout.tone), (MARGIN, top), (5.0, height), None);
    let callout_title = prose(&callout.title);
    let head = [callout.tone.word(), &callout_title].into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>();
    svg.text(
        &format!("h3 {}", tone_class(callout.tone)),
        (MARGIN + 20.0, top + 26.0),
        Anchor::Start,
        &head.join(" — "),
    );
    for (index, line) in text.iter().enumerate() {
        svg.text("body", (MARGIN + 20.0, top + 26.0 + LINE * (index + 1) as f64), Anchor::Start, line);
    }
    pages.y = top + height;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::MetaItem;
    use crate::sections::{Cell, Column, TableSection};

    /// Rows of a table that fit one page.
    fn rows_of_a_page(meta: &[MetaItem]) -> usize {
        let report = |rows: usize| Report {
            meta: meta.to_vec(),
            sections: vec![Section::Table(TableSection {
                title: "T".to_owned(),
                note: None,
                columns: vec![Column::text("c")],
                rows: vec![vec![Cell::text("x")]; rows],
                total_rows: None,
            })],
            ..Report::default()
        };
        (1..200).take_while(|rows| pages(&report(*rows)).unwrap().len() == 1).count()
    }

    /// A certificate had a second page for two lines that fitted the first.
    #[test]
    fn regress_what_a_report_was_made_from_stands_on_the_page_where_it_fits() {
        let (without, with) = (rows_of_a_page(&[]), rows_of_a_page(&[MetaItem::software("abbe")]));
        // A heading and a line of 103 px are less than six rows of a table.
        assert!(without > 50 && with < without && without - with <= 6, "{without} {with}");
    }
}
