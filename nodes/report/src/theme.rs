//! Colours of the report, light and dark, and the style sheets that use them.
//!
//! Series colours are those of Okabe and Ito (2008), readable with any colour vision; the diverging map is a
//! blue–red pair through the page's neutral, so that "no residual" recedes on light and on dark pages alike.

use std::fmt::Write as _;

/// Style sheet of the page.
const PAGE_CSS: &str = include_str!("page.css");
/// Style sheet of the drawings, on page and PNG.
const FIGURE_CSS: &str = include_str!("figure.css");

/// Steps of the diverging colour map (odd: the middle one is neutral).
pub(crate) const DIVERGING_STEPS: usize = 21;
/// Steps of the sequential colour map.
pub(crate) const SEQUENTIAL_STEPS: usize = 11;
/// Series colours `1..=SERIES`.
pub(crate) const SERIES: u8 = 8;

/// Named colours: token, light, dark.
const TOKENS: [(&str, &str, &str); 21] = [
    ("page", "#ffffff", "#14171a"),
    ("panel", "#f6f7f8", "#1c2024"),
    ("ink", "#1b1f23", "#e4e7ea"),
    ("muted", "#59636e", "#9aa4ae"),
    ("axis", "#8b949e", "#6b747d"),
    ("grid", "#e4e7ea", "#2a2f35"),
    ("before", "#c05600", "#e8954a"),
    ("after", "#0067a5", "#5cb3ec"),
    ("between", "#a8508a", "#d795bf"),
    ("s1", "#0067a5", "#5cb3ec"),
    ("s2", "#c05600", "#e8954a"),
    ("s3", "#00805c", "#3cc49b"),
    ("s4", "#a8508a", "#d795bf"),
    ("s5", "#7a6a00", "#d6c545"),
    ("s6", "#4b4f9e", "#9da2ef"),
    ("s7", "#5b6470", "#b3bcc5"),
    ("s8", "#a3262e", "#ff9d95"),
    ("good", "#00805c", "#3cc49b"),
    ("warn", "#9a6700", "#e3b341"),
    ("bad", "#b3261e", "#ff8a80"),
    ("rule", "#d5dade", "#333a41"),
];

/// Texts on a cell: on a dark one, on a light one. One of these two has a contrast of at least √21 to any colour.
const CELL_TEXTS: [&str; 2] = ["#ffffff", "#000000"];

/// Anchors of the diverging map: low, low middle, neutral, high middle, high.
const DIVERGING: [[[u8; 3]; 5]; 2] = [
    [[5, 65, 140], [86, 152, 205], [226, 228, 230], [226, 132, 92], [160, 22, 30]],
    [[110, 185, 255], [60, 120, 175], [58, 64, 70], [190, 100, 62], [255, 150, 120]],
];
/// Anchors of a sequential map: small to large, light and dark.
type Sequential = [[[u8; 3]; 3]; 2];
/// Sequential maps by the letter of their classes: of the state after and of none, before, between. Each goes to the colour of
/// its state, so that a map before a correction looks like no map after it.
const SEQUENTIAL: [(&str, Sequential); 3] = [
    ("", [[[238, 243, 248], [118, 169, 209], [8, 62, 118]], [[32, 40, 48], [46, 104, 150], [150, 210, 255]]]),
    ("B", [[[250, 242, 234], [230, 158, 94], [134, 56, 0]], [[46, 38, 30], [166, 96, 40], [255, 200, 150]]]),
    ("M", [[[248, 240, 246], [204, 142, 184], [100, 30, 78]], [[44, 35, 41], [148, 84, 125], [246, 194, 226]]]),
];

/// Which of the two colour sets.
#[derive(Clone, Copy)]
enum Mode {
    Light,
    Dark,
}

impl Mode {
    fn index(self) -> usize {
        match self {
            Self::Light => 0,
            Self::Dark => 1,
        }
    }
}

/// All tokens of a mode as (name, colour).
fn tokens(mode: Mode) -> Vec<(String, String)> {
    let mut all: Vec<_> = TOKENS
        .iter()
        .map(|(name, light, dark)| {
            let colour = match mode {
                Mode::Light => light,
                Mode::Dark => dark,
            };
            ((*name).to_owned(), (*colour).to_owned())
        })
        .collect();
    let diverging = &DIVERGING[mode.index()];
    all.extend((0..DIVERGING_STEPS).map(|i| (format!("d{i}"), interpolate(diverging, i, DIVERGING_STEPS))));
    for (letter, map) in &SEQUENTIAL {
        for i in 0..SEQUENTIAL_STEPS {
            let cell = interpolate(&map[mode.index()], i, SEQUENTIAL_STEPS);
            all.push((format!("t{letter}{i}"), readable_on(&cell).to_owned()));
            all.push((format!("q{letter}{i}"), cell));
        }
    }
    all
}

/// Every step of every sequential map.
fn steps() -> impl Iterator<Item = (&'static str, usize)> {
    SEQUENTIAL.iter().flat_map(|(letter, _)| (0..SEQUENTIAL_STEPS).map(move |i| (*letter, i)))
}

/// Colour of a text on a cell of this colour: that of the two with the higher contrast.
fn readable_on(cell: &str) -> &'static str {
    CELL_TEXTS.into_iter().max_by(|a, b| contrast(a, cell).total_cmp(&contrast(b, cell))).unwrap_or(CELL_TEXTS[0])
}

/// Contrast of two colours, 1 to 21. Source: W3C, WCAG 2.2, relative luminance and contrast ratio.
fn contrast(one: &str, other: &str) -> f64 {
    let channel = |colour: &str, at: usize| {
        let share =
            colour.get(at..at + 2).and_then(|hex| u8::from_str_radix(hex, 16).ok()).map_or(0.0, f64::from) / 255.0;
        if share <= 0.04045 { share / 12.92 } else { ((share + 0.055) / 1.055).powf(2.4) }
    };
    let light = |colour: &str| 0.2126 * channel(colour, 1) + 0.7152 * channel(colour, 3) + 0.0722 * channel(colour, 5);
    let (a, b) = (light(one), light(other));
    (a.max(b) + 0.05) / (a.min(b) + 0.05)
}

/// Colour of `step` of `steps` between evenly spaced anchors.
fn interpolate(anchors: &[[u8; 3]], step: usize, steps: usize) -> String {
    let position = step as f64 / (steps - 1) as f64 * (anchors.len() - 1) as f64;
    let low = (position as usize).min(anchors.len() - 2);
    let share = position - low as f64;
    let mut out = String::from("#");
    for channel in 0..3 {
        let (a, b) = (f64::from(anchors[low][channel]), f64::from(anchors[low + 1][channel]));
        let _ = write!(out, "{:02x}", (a + share * (b - a)).round() as u8);
    }
    out
}

/// Classes that paint with the tokens: lines `l*`, fills `f*`, bands `b*`, dots and cells of the maps.
fn figure_rules() -> String {
    let mut css = FIGURE_CSS.to_owned();
    let names = (1..=SERIES).map(|i| (format!("{i}"), format!("s{i}")));
    let named = [("B", "before"), ("M", "between"), ("A", "after")].map(|(k, v)| (k.to_owned(), v.to_owned()));
    for (class, token) in names.chain(named) {
        let _ = writeln!(
            css,
            ".l{class}{{stroke:var(--{token})}}.f{class}{{fill:var(--{token})}}\
             .b{class}{{fill:var(--{token});fill-opacity:.2}}.o{class}{{stroke:var(--{token})}}"
        );
    }
    for i in 0..DIVERGING_STEPS {
        let _ = writeln!(css, ".d{i}{{stroke:var(--d{i})}}.e{i}{{fill:var(--d{i})}}");
    }
    for (letter, i) in steps() {
        let step = format!("{letter}{i}");
        let _ = writeln!(css, ".q{step}{{fill:var(--q{step})}}.t{step}{{fill:var(--t{step})}}");
    }
    css
}

/// The page's style sheet: tokens for both colour schemes, light on paper, then page and figure rules.
pub(crate) fn page_css() -> String {
    let declare = |mode| {
        let mut text = String::new();
        for (name, colour) in tokens(mode) {
            let _ = write!(text, "--{name}:{colour};");
        }
        text
    };
    let (light, dark) = (declare(Mode::Light), declare(Mode::Dark));
    format!(
        ":root{{color-scheme:light;{light}}}\n\
         @media screen and (prefers-color-scheme:dark){{:root{{color-scheme:dark;{dark}}}}}\n{}{PAGE_CSS}",
        figure_rules()
    )
}

/// The style sheet of a stand-alone drawing: light colours written out, since rasterisers know no variables.
pub(crate) fn standalone_css() -> String {
    let mut css = figure_rules();
    for (name, colour) in tokens(Mode::Light) {
        css = css.replace(&format!("var(--{name})"), &colour);
    }
    css
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn standalone_sheet_has_no_variable_left() {
        assert!(!standalone_css().contains("var("));
    }

    #[test]
    fn every_variable_used_is_declared_in_both_modes() {
        let css = page_css();
        for used in css.split("var(--").skip(1) {
            let name = used.split(')').next().unwrap();
            assert_eq!(css.matches(&format!("--{name}:")).count(), 2, "{name}");
        }
    }

    /// Directions of approach looked like before and after a correction.
    #[test]
    fn regress_directions_of_approach_have_no_colour_of_a_state() {
        use crate::sections::CurveStyle;
        let series = [CurveStyle::APPROACH_POSITIVE, CurveStyle::APPROACH_NEGATIVE].map(|s| s.of_series().unwrap());
        assert_ne!(series[0], series[1]);
        for mode in [Mode::Light, Mode::Dark] {
            let all: std::collections::BTreeMap<String, String> = tokens(mode).into_iter().collect();
            for series in series {
                for state in ["before", "between", "after"] {
                    assert_ne!(all[&format!("s{series}")], all[state], "series {series} looks like {state}");
                }
            }
        }
    }

    /// A figure in a cell of middling colour could not be read in the dark. 4.5 is what WCAG 2.2 asks of a text.
    #[test]
    fn regress_figures_on_every_cell_can_be_read_in_both_modes() {
        assert!((contrast("#ffffff", "#000000") - 21.0).abs() < 1e-12 && contrast("#123456", "#123456") == 1.0);
        for mode in [Mode::Light, Mode::Dark] {
            let all: std::collections::BTreeMap<String, String> = tokens(mode).into_iter().collect();
            for (letter, i) in steps() {
                let (cell, text) = (&all[&format!("q{letter}{i}")], &all[&format!("t{letter}{i}")]);
                assert!(contrast(cell, text) >= 4.5, "{text} on {cell}: {}", contrast(cell, text));
            }
        }
    }
}
