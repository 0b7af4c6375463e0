//! The frame of a plot panel: grid, ticks, axis labels with units; legend and colour bar beside it.

use crate::scale::Scale;
use crate::svg::{Anchor, Svg, text_width_px};
use crate::text;
use crate::theme::DIVERGING_STEPS;
use abbe_measurement::subset::spread;

/// Width of every drawing on the page, px.
pub(crate) const WIDTH_PX: f64 = 1080.0;
/// Of a title above its panel, px.
pub(crate) const TITLE_ABOVE_PX: f64 = 9.0;

/// Place of a panel's plotting area, px.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Area {
    /// Left edge.
    pub(crate) left: f64,
    /// Top edge.
    pub(crate) top: f64,
    /// Width.
    pub(crate) width: f64,
    /// Height.
    pub(crate) height: f64,
}

impl Area {
    /// Right edge.
    pub(crate) fn right(&self) -> f64 {
        self.left + self.width
    }

    /// Bottom edge.
    pub(crate) fn bottom(&self) -> f64 {
        self.top + self.height
    }

    /// Middle of the width.
    pub(crate) fn middle(&self) -> f64 {
        self.left + self.width / 2.0
    }
}

/// What a frame shows besides the data.
#[derive(Debug, Default)]
pub(crate) struct Labels {
    /// Above the panel.
    pub(crate) title: String,
    /// Under the horizontal axis, with unit; may be empty.
    pub(crate) x: String,
    /// Beside the vertical axis, with unit; may be empty.
    pub(crate) y: String,
    /// Wanted marks on the horizontal axis; 0 for none.
    pub(crate) x_ticks: usize,
    /// Wanted marks on the vertical axis; 0 for none.
    pub(crate) y_ticks: usize,
}

/// A panel in which values can be read, enlarged and moved by the page's script: [`draw_frame`] inside a group that says how
/// pixels and values belong together. What is drawn until [`end_panel`] is data.
pub(crate) fn begin_panel(svg: &mut Svg, area: Area, x: &Scale, y: &Scale, labels: &Labels) {
    let place = [area.left, area.top, area.width, area.height].map(|v| svg.number(v)).join(" ");
    let label = |text: &str| text::escape(text);
    svg.open(&format!(
        "class=\"panel\" data-a=\"{place}\" data-x=\"{}\" data-y=\"{}\" data-xn=\"{}\" data-yn=\"{}\"",
        x.to_attribute(labels.x_ticks),
        y.to_attribute(labels.y_ticks),
        label(&labels.x),
        label(&labels.y)
    ));
    draw_frame(svg, area, x, y, labels);
    svg.open("class=\"pts\"");
}

/// Ends the data of a panel, and the panel.
pub(crate) fn end_panel(svg: &mut Svg) {
    svg.name(None);
    svg.close();
    svg.close();
}

/// Draws grid, axes, marks and labels of a panel.
pub(crate) fn draw_frame(svg: &mut Svg, area: Area, x: &Scale, y: &Scale, labels: &Labels) {
    if labels.x_ticks > 0 {
        svg.open("class=\"tx\"");
        draw_x_axis(svg, area, x, labels.x_ticks);
        svg.close();
    }
    if labels.y_ticks > 0 {
        svg.open("class=\"ty\"");
        draw_y_axis(svg, area, y, labels.y_ticks);
        svg.close();
    }
    svg.line("ax", (area.left, area.bottom()), (area.right(), area.bottom()));
    if !labels.title.is_empty() {
        svg.text("title", (area.left, area.top - TITLE_ABOVE_PX), Anchor::Start, &labels.title);
    }
    if !labels.x.is_empty() {
        svg.text("muted", (area.middle(), area.bottom() + 34.0), Anchor::Middle, &labels.x);
    }
    if !labels.y.is_empty() {
        svg.text_up("muted", (area.left - 44.0, area.top + area.height / 2.0), &labels.y);
    }
}

fn draw_x_axis(svg: &mut Svg, area: Area, scale: &Scale, wanted: usize) {
    for tick in scale.ticks(wanted) {
        let x = scale.map(tick.value);
        let class = if tick.label.is_empty() { "gr2" } else { "gr" };
        svg.line(class, (x, area.top), (x, area.bottom()));
        svg.line("ax", (x, area.bottom()), (x, area.bottom() + 4.0));
        if !tick.label.is_empty() {
            svg.text("small muted", (x, area.bottom() + 17.0), Anchor::Middle, &tick.label);
        }
    }
}

fn draw_y_axis(svg: &mut Svg, area: Area, scale: &Scale, wanted: usize) {
    for tick in scale.ticks(wanted) {
        let y = scale.map(tick.value);
        let class = if tick.label.is_empty() { "gr2" } else { "gr" };
        svg.line(class, (area.left, y), (area.right(), y));
        if !tick.label.is_empty() {
            svg.text("small muted", (area.left - 7.0, y + 4.0), Anchor::End, &tick.label);
        }
    }
}

/// How a legend entry is drawn.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Swatch {
    /// A line of this class.
    Line(String),
    /// The marker of a series, of this class.
    Marker(u8, String),
    /// A filled patch of this class.
    Patch(String),
}

/// Draws legend entries from left to right and returns where the next one would begin.
pub(crate) fn draw_legend(svg: &mut Svg, (mut x, y): (f64, f64), entries: &[(Swatch, String)]) -> f64 {
    for (swatch, name) in entries {
        svg.name(Some(name));
        match swatch {
            Swatch::Line(class) => svg.line(class, (x, y - 4.0), (x + 22.0, y - 4.0)),
            Swatch::Marker(series, class) => svg.markers(*series, class, &[(x + 11.0, y - 4.0)], (0, 1)),
            Swatch::Patch(class) => svg.rect(class, (x, y - 10.0), (22.0, 12.0), None),
        }
        svg.text("small", (x + 28.0, y), Anchor::Start, name);
        x += 28.0 + text_width_px(name) + 18.0;
    }
    svg.name(None);
    x
}

/// Draws the bar of the diverging map with a scale symmetric about zero.
///
/// `beyond` says that values outside `±limit` exist; they carry the end colours and the bar gets pointed ends.
pub(crate) fn draw_diverging_bar(svg: &mut Svg, area: Area, limit: f64, label: &str, beyond: bool) {
    let cell = area.height / DIVERGING_STEPS as f64;
    for step in 0..DIVERGING_STEPS {
        let y = area.bottom() - (step + 1) as f64 * cell;
        // Half a pixel of overlap hides the seams between the steps.
        svg.rect(&format!("e{step}"), (area.left, y - 0.25), (area.width, cell + 0.5), None);
    }
    if beyond {
        let (left, mid, right) = (area.left, area.middle(), area.right());
        let top = [(left, area.top), (mid, area.top - 10.0), (right, area.top)];
        let bottom = [(left, area.bottom()), (mid, area.bottom() + 10.0), (right, area.bottom())];
        svg.path(&format!("e{}", DIVERGING_STEPS - 1), &top, true);
        svg.path("e0", &bottom, true);
    }
    let scale = Scale::exact(-limit, limit, area.bottom(), area.top);
    for tick in scale.ticks(6) {
        let y = scale.map(tick.value);
        svg.line("ax", (area.right(), y), (area.right() + 4.0, y));
        svg.text("small muted", (area.right() + 8.0, y + 4.0), Anchor::Start, &tick.label);
    }
    svg.text_up("muted", (area.left - 9.0, area.top + area.height / 2.0), label);
}

/// Class index of a value on the diverging map of `±limit`.
pub(crate) fn diverging_step(value: f64, limit: f64) -> usize {
    let share = ((value / limit).clamp(-1.0, 1.0) + 1.0) / 2.0;
    ((share * DIVERGING_STEPS as f64) as usize).min(DIVERGING_STEPS - 1)
}

/// `label / unit` of an axis.
pub(crate) fn axis_text(axis: &crate::sections::Axis) -> String {
    text::with_unit(&axis.label, &axis.unit)
}

/// Most dots a panel shows; of more, one in k is shown and the note says so.
const MAX_DOTS: usize = 8000;

/// Of how many points one is drawn.
pub(crate) fn one_in(count: usize) -> usize {
    count.div_ceil(MAX_DOTS).max(1)
}

/// The points that are drawn: evenly spread, but not every k-th, which would show the same place of each line.
pub(crate) fn drawn<T>(points: &[T], one_in: usize) -> impl Iterator<Item = &T> {
    spread(points.len(), points.len().div_ceil(one_in)).into_iter().map(|place| &points[place])
}

/// Areas of `count` panels in `columns` columns below `top`, and the height of the whole drawing.
pub(crate) fn grid(count: usize, columns: usize, panel_height: f64, top: f64) -> (Vec<Area>, f64) {
    const LEFT: f64 = 62.0;
    const RIGHT: f64 = 16.0;
    const TITLE: f64 = 28.0;
    const BOTTOM: f64 = 46.0;
    let columns = columns.clamp(1, 4);
    let cell = WIDTH_PX / columns as f64;
    let row = TITLE + panel_height + BOTTOM;
    let areas = (0..count)
        .map(|index| Area {
            left: (index % columns) as f64 * cell + LEFT,
            top: top + (index / columns) as f64 * row + TITLE,
            width: cell - LEFT - RIGHT,
            height: panel_height,
        })
        .collect();
    (areas, top + count.div_ceil(columns) as f64 * row)
}

/// Says in a panel that there is nothing to show.
pub(crate) fn draw_empty(svg: &mut Svg, area: Area) {
    let middle = (area.middle(), area.top + area.height / 2.0);
    svg.text("muted", middle, Anchor::Middle, "no data");
}
