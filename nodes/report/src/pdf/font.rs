//! The embedded fonts in a PDF: the whole OpenType file (they hold what reports need, 47 kB each), glyphs by their number.
//!
//! In: bytes of a font. Out: its objects in the PDF. Advances and heights are read from the tables `head`, `hhea` and `hmtx`
//! (OpenType 1.9); the page's layout is that of `usvg`, a reader needs the advances to know where words end.

use std::collections::BTreeMap;

use pdf_writer::types::{CidFontType, FontFlags, SystemInfo, UnicodeCmap};
use pdf_writer::{Filter, Finish, Name, Pdf, Rect, Ref, Str};

use super::packed::packed;

/// A font as the PDF knows it.
pub(super) struct Font {
    bytes: &'static [u8],
    name: &'static str,
    /// Units of an em.
    pub(super) units_per_em: f32,
    ascent: f32,
    descent: f32,
    bbox: [f32; 4],
    metrics: usize,
    hmtx: usize,
    /// Glyphs that were used, with the text that each stands for.
    pub(super) used: BTreeMap<u16, String>,
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_be_bytes(bytes.get(at..at + 2)?.try_into().ok()?))
}

fn i16_at(bytes: &[u8], at: usize) -> Option<f32> {
    Some(f32::from(i16::from_be_bytes(bytes.get(at..at + 2)?.try_into().ok()?)))
}

fn table(bytes: &[u8], tag: &[u8; 4]) -> Option<usize> {
    let count = usize::from(u16_at(bytes, 4)?);
    let record = (0..count).map(|k| 12 + 16 * k).find(|at| bytes.get(*at..*at + 4) == Some(tag))?;
    let offset = u32::from_be_bytes(bytes.get(record + 8..record + 12)?.try_into().ok()?);
    usize::try_from(offset).ok()
}

impl Font {
    /// Reads what the PDF has to say of the font; `None` for what is no OpenType font.
    pub(super) fn read(name: &'static str, bytes: &'static [u8]) -> Option<Font> {
        let (head, hhea) = (table(bytes, b"head")?, table(bytes, b"hhea")?);
        let mut bbox = [0.0; 4];
        for (k, value) in bbox.iter_mut().enumerate() {
            *value = i16_at(bytes, head + 36 + 2 * k)?;
        }
        Some(Font {
            bytes,
            name,
            units_per_em: f32::from(u16_at(bytes, head + 18)?),
            ascent: i16_at(bytes, hhea + 4)?,
            descent: i16_at(bytes, hhea + 6)?,
            bbox,
            metrics: usize::from(u16_at(bytes, hhea + 34)?),
            hmtx: table(bytes, b"hmtx")?,
            used: BTreeMap::new(),
        })
    }

    /// Advance of a glyph in thousandths of an em.
    pub(super) fn advance(&self, glyph: u16) -> f32 {
        let entry = usize::from(glyph).min(self.metrics.saturating_sub(1));
        u16_at(self.bytes, self.hmtx + 4 * entry).map_or(0.0, |units| self.thousandths(f32::from(units)))
    }

    fn thousandths(&self, units: f32) -> f32 {
        units * 1000.0 / self.units_per_em
    }

    /// Writes the font under `id`; the four references are its own.
    pub(super) fn write(&self, pdf: &mut Pdf, id: Ref, [cid, descriptor, file, cmap]: [Ref; 4]) {
        let system = SystemInfo { registry: Str(b"Adobe"), ordering: Str(b"Identity"), supplement: 0 };
        let name = Name(self.name.as_bytes());
        let mut font = pdf.type0_font(id);
        font.base_font(name).encoding_predefined(Name(b"Identity-H")).descendant_font(cid).to_unicode(cmap);
        font.finish();
        let mut font = pdf.cid_font(cid);
        font.subtype(CidFontType::Type0).base_font(name).system_info(system).font_descriptor(descriptor);
        let mut widths = font.widths();
        for glyph in self.used.keys() {
            widths.consecutive(*glyph, [self.advance(*glyph)]);
        }
        widths.finish();
        font.finish();
        let [x0, y0, x1, y1] = self.bbox.map(|units| self.thousandths(units));
        let mut about = pdf.font_descriptor(descriptor);
        about.name(name).flags(FontFlags::SYMBOLIC).bbox(Rect::new(x0, y0, x1, y1)).italic_angle(0.0);
        about.ascent(self.thousandths(self.ascent)).descent(self.thousandths(self.descent));
        about.cap_height(self.thousandths(self.ascent)).stem_v(80.0).font_file3(file);
        about.finish();
        let data = packed(self.bytes);
        let mut stream = pdf.stream(file, &data);
        stream.filter(Filter::FlateDecode).pair(Name(b"Subtype"), Name(b"OpenType"));
        stream.finish();
        let mut map = UnicodeCmap::<u16>::new(Name(b"Glyphs"), system);
        for (glyph, text) in &self.used {
            map.pair_with_multiple(*glyph, text.chars());
        }
        let map = map.finish();
        pdf.cmap(cmap, map.as_slice());
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // a test

    use super::*;

    #[test]
    fn an_embedded_font_has_an_em_and_advances() {
        let font = Font::read("Inter", include_bytes!("../../fonts/Inter-Regular.otf")).unwrap();
        assert!(font.units_per_em >= 1000.0 && font.ascent > 0.0 && font.descent < 0.0);
        // The glyph of what is missing has a width like any letter.
        assert!((200.0..1200.0).contains(&font.advance(0)), "{}", font.advance(0));
        assert!(Font::read("none", b"no font").is_none());
    }
}
