//! The page around the sections: header, table of contents, figures as inline SVG, styles and fonts inside.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use crate::error::ReportError;
use crate::report::{NextStep, Report};
use crate::sections::Section;
use crate::svg::Drawing;
use crate::text::{escape, prose};
use crate::theme;

/// The embedded fonts: weight and file.
const FONTS: [(u16, &[u8]); 2] =
    [(400, include_bytes!("../fonts/Inter-Regular.woff2")), (600, include_bytes!("../fonts/Inter-SemiBold.woff2"))];

/// What adds values under the pointer, enlarging and picking out to a page that is whole without it.
const SCRIPT: &str = include_str!("page.js");
/// Nothing of a page comes from, or goes to, anywhere else.
const POLICY: &str =
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; font-src data:; img-src data:";

impl Report {
    /// The page: one HTML file with styles, fonts and its one script inside, and nothing from outside; whole without the script.
    ///
    /// # Errors
    /// As [`Report::check`], or a drawing that overflows.
    pub fn html(&self) -> Result<String, ReportError> {
        self.check()?;
        page(self)
    }
}

/// The page of a checked report.
fn page(report: &Report) -> Result<String, ReportError> {
    let title = escape(&report.title);
    let mut out = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n\
         <title>{title}</title>\n<style>\n{}{}</style>\n</head>\n<body>\n",
        font_faces(),
        theme::page_css()
    );
    header(report, &mut out);
    out.push_str("<main>\n");
    first_screen(report, &mut out)?;
    for (index, section) in report.sections.iter().enumerate().skip(report.opening()) {
        out.push_str(&section_html(section, index)?);
    }
    made_from(report, &mut out);
    out.push_str("</main>\n");
    // What the page was made from tells all of it, and whole.
    if let (Some(footer), true) = (&report.footer, report.made_from().is_empty()) {
        let _ = writeln!(out, "<footer>{}</footer>", escape(footer));
    }
    let _ = writeln!(out, "<script>\n{SCRIPT}</script>\n</body>\n</html>");
    Ok(out)
}

/// The answer, what limits it and the next command; of many limits the rest after that, and said so.
fn first_screen(report: &Report, out: &mut String) -> Result<(), ReportError> {
    let (before, after) = report.first_screen();
    for place in before {
        out.push_str(&section_html(&report.sections[place], place)?);
    }
    if !after.is_empty() {
        let _ = writeln!(
            out,
            "<p class=\"note more\">{} more to heed: <a href=\"#more\">right after the next command</a>.</p>",
            after.len()
        );
    }
    out.extend(report.next.as_ref().map(next_html));
    if !after.is_empty() {
        out.push_str("<section id=\"more\" aria-label=\"More to heed\">\n");
        for place in after {
            out.push_str(&section_html(&report.sections[place], place)?);
        }
        out.push_str("</section>\n");
    }
    Ok(())
}

fn font_faces() -> String {
    let mut css = String::new();
    for (weight, bytes) in FONTS {
        let data = STANDARD.encode(bytes);
        let _ = writeln!(
            css,
            "@font-face{{font-family:Inter;font-weight:{weight};font-style:normal;\
             src:url(data:font/woff2;base64,{data}) format(\"woff2\")}}"
        );
    }
    css
}

fn header(report: &Report, out: &mut String) {
    let _ = writeln!(out, "<header class=\"top\">\n<h1>{}</h1>", escape(&report.title));
    if let Some(lead) = &report.lead {
        let _ = writeln!(out, "<p class=\"lead\">{}</p>", escape(&prose(lead)));
    }
    let known = report.identity.lines();
    pairs(known.iter().map(|(label, value)| (*label, value.as_str())), " identity", out);
    contents(report, out);
    out.push_str("</header>\n");
}

/// Labels and values side by side. What is not known has no line: one with a dash tells nothing.
fn pairs<'a>(known: impl Iterator<Item = (&'a str, &'a str)>, class: &str, out: &mut String) {
    let mut known = known.peekable();
    if known.peek().is_none() {
        return;
    }
    let _ = writeln!(out, "<dl class=\"meta{class}\">");
    for (label, value) in known {
        let _ = writeln!(out, "<dt>{}</dt><dd>{}</dd>", escape(label), escape(value));
    }
    out.push_str("</dl>\n");
}

/// The next command, ready to be copied.
fn next_html(next: &NextStep) -> String {
    let (what_for, command) = (escape(&next.what_for), escape(&next.command));
    format!("<div class=\"next\"><p><b>Next</b>, {what_for}:</p>\n<pre><code>{command}</code></pre></div>\n")
}

/// Files, hashes and versions, at the end: they matter to who asks where a figure comes from.
fn made_from(report: &Report, out: &mut String) {
    let known = report.made_from();
    if known.is_empty() {
        return;
    }
    out.push_str("<section class=\"made\">\n<h2 id=\"made-from\">Made from</h2>\n");
    pairs(known.iter().map(|(label, value)| (label.as_str(), *value)), "", out);
    out.push_str("</section>\n");
}

/// Links to the chapters.
fn contents(report: &Report, out: &mut String) {
    let headings: Vec<_> = report
        .sections
        .iter()
        .enumerate()
        .filter_map(|(index, section)| match section {
            Section::Heading(heading) => Some((index, &heading.title)),
            _ => None,
        })
        .collect();
    if headings.is_empty() {
        return;
    }
    out.push_str("<nav aria-label=\"Contents\">");
    for (index, title) in headings {
        let _ = write!(out, "<a href=\"#s{index}\">{}</a>", escape(title));
    }
    out.push_str("</nav>\n");
}

fn section_html(section: &Section, index: usize) -> Result<String, ReportError> {
    Ok(match section {
        Section::Heading(heading) => {
            let intro = heading.intro.as_deref().map(|i| format!("<p>{}</p>\n", escape(&prose(i))));
            let title = escape(&heading.title);
            format!("<h2 id=\"s{index}\">{title}</h2>\n{}", intro.unwrap_or_default())
        }
        Section::KeyFigures(figures) => figures.html(),
        Section::Table(table) => table.html(),
        Section::Callout(callout) => callout.html(),
        figure => match figure.drawing() {
            Some(drawn) => {
                let (drawing, note) = drawn?;
                figure_html(figure, note.as_deref(), &drawing)
            }
            None => String::new(),
        },
    })
}

fn figure_html(section: &Section, note: Option<&str>, drawing: &Drawing) -> String {
    let title = escape(section.title());
    let note = note.map(|n| format!("<p class=\"note\">{}</p>\n", escape(&prose(n)))).unwrap_or_default();
    let (class, scene) = match section {
        Section::Vectors(vectors) => (
            format!(" class=\"three\" data-unit=\"{}\"", escape(&vectors.vector_unit)),
            // On a narrow screen the drawing's own words would be too small to read.
            format!("{}<script type=\"application/json\">{}</script>\n", vectors.key(), vectors.scene()),
        ),
        // Its middle is what there is to see: the script shows that first where the screen is narrow.
        Section::Isometric(_) => (" class=\"middle\"".to_owned(), String::new()),
        _ => Default::default(),
    };
    // What the values of coloured points are, for the script.
    let value = match section {
        Section::ResidualMap(map) => {
            format!(" data-value=\"{} % {}\"", escape(&map.value.label), escape(&map.value.unit))
        }
        _ => String::new(),
    };
    format!(
        "<figure{class}>\n<figcaption><h3>{title}</h3>\n{note}</figcaption>\n\
         <svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{title}\"{value}>\n{}</svg>\n{scene}</figure>\n",
        drawing.width,
        drawing.height.ceil(),
        drawing.body
    )
}
