//! Pages as SVG to PDF: paths as paths, texts as text of the embedded fonts.
//!
//! The drawings hold paths and texts with plain colours and nothing else, so that is all that is translated. A character that the
//! fonts lack is an error: a certificate with a blank where a name stood would be worse than none.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use pdf_writer::types::{LineCapStyle, LineJoinStyle};
use pdf_writer::{Content, Filter, Finish, Name, Pdf, Rect, Ref, Str, TextStr};
use resvg::usvg::{self, Options, Transform, Tree, fontdb, tiny_skia_path};

use super::font::Font;
use super::packed::packed;
use super::pages::{PAGE_PX, PT_PER_PX};
use crate::error::ReportError;
use crate::report::Report;
use crate::theme;

/// The fonts of the pages; the fonts of the machine are never looked at.
const FONTS: [(&str, &[u8]); 2] = [
    ("Inter-Regular", include_bytes!("../../fonts/Inter-Regular.otf")),
    ("Inter-SemiBold", include_bytes!("../../fonts/Inter-SemiBold.otf")),
];
/// Style of the pages beside that of the drawings.
const STYLE: &str = ".h1{font-size:34px;font-weight:600}.h2{font-size:26px;font-weight:600}.h3{font-size:20px;font-weight:600}\
.body{font-size:18px}.detail{font-size:15px}.cell{font-size:16px}.cellb{font-size:16px;font-weight:600}.value{font-size:30px;font-weight:600}\
.rule{stroke:#d5dade;stroke-width:1}.thick{stroke:#1b1f23;stroke-width:2}.panel{fill:#f6f7f8}\
.good{fill:#00805c}.warning{fill:#9a6700}.bad{fill:#b3261e}.neutral{fill:#8b949e}.mutedb{font-size:16px;fill:#59636e}";
/// Objects of a font, and of a page.
const OF_FONT: i32 = 5;
const OF_PAGE: i32 = 2;

fn failed(what: impl Into<String>) -> ReportError {
    ReportError::Pdf { what: what.into() }
}

/// What is drawn: fonts with the glyphs used so far, and degrees of opacity.
struct Drawn {
    fonts: Vec<(fontdb::ID, Font)>,
    /// Fill and stroke in thousandths, by the name of their state.
    opacities: BTreeMap<[u16; 2], String>,
    /// Characters that have a glyph.
    characters: BTreeSet<char>,
}

/// The PDF of the pages.
pub(super) fn document(report: &Report, pages: &[String]) -> Result<Vec<u8>, ReportError> {
    let mut database = fontdb::Database::new();
    let mut drawn = Drawn { fonts: Vec::new(), opacities: BTreeMap::new(), characters: BTreeSet::new() };
    for (name, bytes) in FONTS {
        let ids = database.load_font_source(fontdb::Source::Binary(Arc::new(bytes)));
        for id in ids {
            let font = Font::read(name, bytes).ok_or_else(|| failed("an embedded font cannot be read"))?;
            drawn.fonts.push((id, font));
        }
    }
    database.set_sans_serif_family("Inter");
    let database = Arc::new(database);
    let css = theme::standalone_css();
    let mut contents = Vec::new();
    for body in pages {
        let svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\"><style>{css}{STYLE}</style>{body}</svg>",
            PAGE_PX[0], PAGE_PX[1]
        );
        let options = Options { font_family: "Inter".to_owned(), fontdb: Arc::clone(&database), ..Options::default() };
        let tree = Tree::from_str(&svg, &options).map_err(|error| failed(error.to_string()))?;
        let mut content = Content::new();
        let scale = PT_PER_PX as f32;
        // Pages of a PDF begin at the bottom.
        content.transform([scale, 0.0, 0.0, -scale, 0.0, PAGE_PX[1] as f32 * scale]);
        drawn.group(tree.root(), &mut content)?;
        drawn.check(body)?;
        contents.push(packed(content.finish().as_slice()));
    }
    Ok(written(report, &drawn, &contents))
}

/// All objects: catalog, pages, resources, fonts, contents.
fn written(report: &Report, drawn: &Drawn, contents: &[Vec<u8>]) -> Vec<u8> {
    let (catalog, tree, info, first_font) = (Ref::new(1), Ref::new(2), Ref::new(3), 4);
    let first_page = first_font + OF_FONT * drawn.fonts.len() as i32;
    let font_id = |index: usize| Ref::new(first_font + OF_FONT * index as i32);
    let page_id = |index: usize| Ref::new(first_page + OF_PAGE * index as i32);
    let mut pdf = Pdf::new();
    pdf.catalog(catalog).pages(tree).lang(TextStr("en"));
    pdf.pages(tree).kids((0..contents.len()).map(page_id)).count(contents.len() as i32);
    let mut about = pdf.document_info(info);
    about.title(TextStr(&report.title));
    if let Some(software) = &report.footer {
        about.creator(TextStr(software));
    }
    about.finish();
    for (index, (_, font)) in drawn.fonts.iter().enumerate() {
        let id = font_id(index).get();
        font.write(&mut pdf, Ref::new(id), [1, 2, 3, 4].map(|k| Ref::new(id + k)));
    }
    let [width, height] = PAGE_PX.map(|px| (px * PT_PER_PX) as f32);
    for (index, content) in contents.iter().enumerate() {
        let data = Ref::new(page_id(index).get() + 1);
        let mut page = pdf.page(page_id(index));
        page.media_box(Rect::new(0.0, 0.0, width, height)).parent(tree).contents(data);
        let mut resources = page.resources();
        let mut fonts = resources.fonts();
        for index in 0..drawn.fonts.len() {
            fonts.pair(Name(font_name(index).as_bytes()), font_id(index));
        }
        fonts.finish();
        let mut states = resources.ext_g_states();
        for ([fill, stroke], name) in &drawn.opacities {
            let mut state = states.insert(Name(name.as_bytes())).start::<pdf_writer::writers::ExtGraphicsState<'_>>();
            state.non_stroking_alpha(f32::from(*fill) / 1000.0).stroking_alpha(f32::from(*stroke) / 1000.0);
        }
        states.finish();
        resources.finish();
        page.finish();
        pdf.stream(data, content).filter(Filter::FlateDecode);
    }
    pdf.finish()
}

fn font_name(index: usize) -> String {
    format!("F{index}")
}

fn matrix(of: Transform) -> [f32; 6] {
    [of.sx, of.ky, of.kx, of.sy, of.tx, of.ty]
}

fn colour(paint: &usvg::Paint) -> Option<[f32; 3]> {
    match paint {
        usvg::Paint::Color(colour) => Some([colour.red, colour.green, colour.blue].map(|v| f32::from(v) / 255.0)),
        // Gradients and patterns occur in no drawing.
        _ => None,
    }
}

impl Drawn {
    fn group(&mut self, group: &usvg::Group, content: &mut Content) -> Result<(), ReportError> {
        for node in group.children() {
            match node {
                usvg::Node::Group(inner) => self.group(inner, content)?,
                usvg::Node::Path(path) => self.path(path, content),
                usvg::Node::Text(text) => self.text(text, content)?,
                usvg::Node::Image(_) => return Err(failed("a drawing holds a picture, which is not translated")),
            }
        }
        Ok(())
    }

    /// Refuses characters of a page that became no glyph: `usvg` leaves them out without a word.
    fn check(&self, body: &str) -> Result<(), ReportError> {
        let shown = body.split("<title>").map(|part| part.split_once("</title>").map_or(part, |(_, rest)| rest));
        let texts = shown.flat_map(|part| part.split('<')).filter_map(|tag| Some(tag.split_once('>')?.1));
        // Entities are written with plain letters and signs; those signs are in the fonts.
        let lacking =
            texts.flat_map(str::chars).find(|c| !c.is_whitespace() && !c.is_ascii() && !self.characters.contains(c));
        match lacking {
            Some(character) => {
                Err(failed(format!("the fonts of the PDF lack {character:?}; write it with other letters")))
            }
            None => Ok(()),
        }
    }

    /// Chooses the state of a fill and a stroke opacity.
    fn opacity(&mut self, fill: f32, stroke: f32, content: &mut Content) {
        let key = [fill, stroke].map(|share| (share * 1000.0).round() as u16);
        let name = self.opacities.entry(key).or_insert_with(|| format!("G{}x{}", key[0], key[1]));
        content.set_parameters(Name(name.as_bytes()));
    }

    fn path(&mut self, path: &usvg::Path, content: &mut Content) {
        let fill = path.fill().and_then(|fill| Some((colour(fill.paint())?, fill.opacity().get())));
        let stroke = path.stroke().and_then(|stroke| Some((colour(stroke.paint())?, stroke)));
        if fill.is_none() && stroke.is_none() {
            return;
        }
        content.save_state().transform(matrix(path.abs_transform()));
        let opacities = [fill.map_or(1.0, |(_, share)| share), stroke.map_or(1.0, |(_, s)| s.opacity().get())];
        self.opacity(opacities[0], opacities[1], content);
        if let Some(([r, g, b], _)) = fill {
            content.set_fill_rgb(r, g, b);
        }
        if let Some(([r, g, b], stroke)) = stroke {
            content.set_stroke_rgb(r, g, b).set_line_width(stroke.width().get());
            content.set_line_cap(match stroke.linecap() {
                usvg::LineCap::Butt => LineCapStyle::ButtCap,
                usvg::LineCap::Round => LineCapStyle::RoundCap,
                usvg::LineCap::Square => LineCapStyle::ProjectingSquareCap,
            });
            content.set_line_join(match stroke.linejoin() {
                usvg::LineJoin::Round => LineJoinStyle::RoundJoin,
                usvg::LineJoin::Bevel => LineJoinStyle::BevelJoin,
                usvg::LineJoin::Miter | usvg::LineJoin::MiterClip => LineJoinStyle::MiterJoin,
            });
            if let Some(dashes) = stroke.dasharray() {
                content.set_dash_pattern(dashes.iter().copied(), stroke.dashoffset());
            }
        }
        outline(path.data(), content);
        match (fill.is_some(), stroke.is_some()) {
            (true, true) => content.fill_nonzero_and_stroke(),
            (true, false) => content.fill_nonzero(),
            _ => content.stroke(),
        };
        content.restore_state();
    }

    /// The glyphs of each span in one run, so that a reader's search finds words. Halos, strokes around letters, are left out.
    fn text(&mut self, text: &usvg::Text, content: &mut Content) -> Result<(), ReportError> {
        for span in text.layouted().iter().filter(|span| span.visible) {
            let Some(([r, g, b], share)) =
                span.fill.as_ref().and_then(|f| Some((colour(f.paint())?, f.opacity().get())))
            else {
                continue;
            };
            for run in span.positioned_glyphs.chunk_by(|a, b| a.font == b.font) {
                let Some(first) = run.first() else { continue };
                // A font has at most 65535 glyphs; number 0 stands for what is missing.
                let missing = run.iter().find(|glyph| glyph.id.0 == 0 || u16::try_from(glyph.id.0).is_err());
                let known = self.fonts.iter().position(|(id, _)| *id == first.font);
                let (Some(index), None) = (known, missing) else {
                    let what = &missing.unwrap_or(first).text;
                    return Err(failed(format!("the fonts of the PDF lack {what:?}; write it with other letters")));
                };
                content.save_state().transform(matrix(text.abs_transform()));
                self.opacity(share, 1.0, content);
                content.set_fill_rgb(r, g, b);
                self.run(index, run, span.font_size.get(), content);
                content.restore_state();
            }
        }
        Ok(())
    }

    fn run(&mut self, index: usize, run: &[usvg::layout::PositionedGlyph], size: f32, content: &mut Content) {
        let (Some(first), Some((_, font))) = (run.first(), self.fonts.get_mut(index)) else { return };
        // A glyph's transform scales font units to the size, which the run has from its size.
        let scale = font.units_per_em / size;
        let at = |glyph: &usvg::layout::PositionedGlyph| glyph.transform().pre_scale(scale, scale);
        let start = at(first);
        let Some(inverse) = start.invert() else { return };
        let along = |glyph: &usvg::layout::PositionedGlyph| {
            let own = at(glyph);
            inverse.sx * own.tx + inverse.kx * own.ty + inverse.tx
        };
        content.begin_text().set_font(Name(font_name(index).as_bytes()), size);
        // Letters stand upright where y grows upwards.
        content.set_text_matrix(matrix(start.pre_scale(1.0, -1.0)));
        let mut shown = content.show_positioned();
        let mut items = shown.items();
        for (place, glyph) in run.iter().enumerate() {
            let Ok(id) = u16::try_from(glyph.id.0) else { continue };
            self.characters.extend(glyph.text.chars());
            font.used.entry(id).or_insert_with(|| glyph.text.clone());
            items.show(Str(&id.to_be_bytes()));
            if let Some(next) = run.get(place + 1) {
                let moved = (along(next) - along(glyph)) / size * 1000.0;
                let less = font.advance(id) - moved;
                if less.abs() > 0.5 {
                    items.adjust(less);
                }
            }
        }
        items.finish();
        shown.finish();
        content.end_text();
    }
}

fn outline(path: &tiny_skia_path::Path, content: &mut Content) {
    let mut last = tiny_skia_path::Point::zero();
    for segment in path.segments() {
        match segment {
            tiny_skia_path::PathSegment::MoveTo(p) => {
                content.move_to(p.x, p.y);
                last = p;
            }
            tiny_skia_path::PathSegment::LineTo(p) => {
                content.line_to(p.x, p.y);
                last = p;
            }
            tiny_skia_path::PathSegment::QuadTo(c, p) => {
                // A curve of the second degree as one of the third.
                let third = |from: f32, to: f32| from + 2.0 / 3.0 * (to - from);
                content.cubic_to(third(last.x, c.x), third(last.y, c.y), third(p.x, c.x), third(p.y, c.y), p.x, p.y);
                last = p;
            }
            tiny_skia_path::PathSegment::CubicTo(a, b, p) => {
                content.cubic_to(a.x, a.y, b.x, b.y, p.x, p.y);
                last = p;
            }
            tiny_skia_path::PathSegment::Close => {
                content.close_path();
            }
        }
    }
}
