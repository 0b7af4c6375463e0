//! Volume, stations and lines in an isometric view (x to the lower right, y to the upper right, z up).

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::error::ReportError;
use crate::frame::WIDTH_PX;
use crate::svg::{Anchor, Drawing, Svg};
use crate::text::fixed;
use crate::theme::SERIES;

/// Largest height of the view, px.
const MAX_HEIGHT_PX: f64 = 520.0;
/// Space around the view for names, px.
const MARGIN_PX: f64 = 46.0;

/// A named point, e.g. a station.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct IsoPoint {
    /// Name beside the point.
    pub name: String,
    /// Coordinates in the unit of the view.
    pub at: [f64; 3],
}

/// A line; lines of one series share a colour with the point of that index.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct IsoLine {
    /// What it belongs to, such as its station and itself as a line: the page picks it out by them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub names: Vec<String>,
    /// Index of the point whose colour it takes; `None` for the colour of the axes.
    pub point: Option<usize>,
    /// One end, in the unit of the view.
    pub from: [f64; 3],
    /// Other end.
    pub to: [f64; 3],
}

/// Volume, points and lines in an isometric view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Isometric {
    /// Title of the figure.
    pub title: String,
    /// Sentence under the title.
    pub note: Option<String>,
    /// Unit of all coordinates.
    pub unit: String,
    /// Lower corner of the volume.
    pub volume_min: [f64; 3],
    /// Upper corner of the volume.
    pub volume_max: [f64; 3],
    /// Points, e.g. stations.
    pub points: Vec<IsoPoint>,
    /// Lines, e.g. measured lines and lines of sight.
    pub lines: Vec<IsoLine>,
}

/// Isometric projection: viewer in the direction (1, −1, 1); vertical axis of the screen points down.
fn project([x, y, z]: [f64; 3]) -> (f64, f64) {
    let (cos30, sin30) = (0.75_f64.sqrt(), 0.5);
    ((x + y) * cos30, (x - y) * sin30 - z)
}

/// Straight lines, px.
type Segments = Vec<[(f64, f64); 2]>;

/// The map from the projected plane to pixels.
struct View {
    origin: (f64, f64),
    scale: f64,
    offset: (f64, f64),
    height: f64,
}

impl View {
    fn fit(points: impl Iterator<Item = (f64, f64)>) -> Self {
        let start = (f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY);
        let (x0, y0, x1, y1) = points.fold(start, |b, p| (b.0.min(p.0), b.1.min(p.1), b.2.max(p.0), b.3.max(p.1)));
        let (width, height) = (x1 - x0, y1 - y0);
        let scale = ((WIDTH_PX - 4.0 * MARGIN_PX) / width).min((MAX_HEIGHT_PX - 2.0 * MARGIN_PX) / height);
        Self {
            origin: (x0, y0),
            scale,
            offset: ((WIDTH_PX - width * scale) / 2.0, MARGIN_PX),
            height: height * scale + 2.0 * MARGIN_PX,
        }
    }

    fn map(&self, point: [f64; 3]) -> (f64, f64) {
        let (x, y) = project(point);
        ((x - self.origin.0) * self.scale + self.offset.0, (y - self.origin.1) * self.scale + self.offset.1)
    }
}

impl Isometric {
    /// Refuses an empty volume and lines that name a point that is not there.
    pub(crate) fn check(&self) -> Result<(), ReportError> {
        if (0..3).any(|i| self.volume_min[i] >= self.volume_max[i]) {
            let what = "volume_min is not below volume_max on every axis";
            return Err(ReportError::shape(&self.title, what, "pass the lower and the upper corner"));
        }
        match self.lines.iter().filter_map(|l| l.point).find(|&p| p >= self.points.len()) {
            Some(index) => {
                let what = format!("a line names point {index} of {}", self.points.len());
                Err(ReportError::shape(&self.title, what, "use an index of `points` or None"))
            }
            None => Ok(()),
        }
    }

    /// Corner of the volume; bit i of `bits` takes the upper limit of axis i.
    fn corner(&self, bits: usize) -> [f64; 3] {
        std::array::from_fn(|i| if bits >> i & 1 == 1 { self.volume_max[i] } else { self.volume_min[i] })
    }

    /// The point straight below or above on the floor of the volume.
    fn on_floor(&self, at: [f64; 3]) -> [f64; 3] {
        [at[0], at[1], self.volume_min[2]]
    }

    /// Draws the figure.
    pub(crate) fn draw(&self) -> Result<Drawing, ReportError> {
        let corners = (0..8).map(|bits| self.corner(bits));
        let points = self.points.iter().flat_map(|p| [p.at, self.on_floor(p.at)]);
        let ends = self.lines.iter().flat_map(|l| [l.from, l.to]);
        let view = View::fit(corners.chain(points).chain(ends).map(project));
        let mut svg = Svg::new(WIDTH_PX, view.height);
        let floor = [0b000, 0b001, 0b011, 0b010].map(|bits| view.map(self.corner(bits)));
        svg.path("floor", &floor, true);
        self.draw_edges(&mut svg, &view, true);
        self.draw_lines(&mut svg, &view);
        self.draw_edges(&mut svg, &view, false);
        self.draw_points(&mut svg, &view);
        // Last: a drop of a station went through them.
        self.draw_axis_names(&mut svg, &view);
        svg.finish(&self.title)
    }

    /// The three edges behind the volume, or the nine others.
    fn draw_edges(&self, svg: &mut Svg, view: &View, hidden: bool) {
        // Farthest from the viewer at (1, −1, 1): lowest x, highest y, lowest z.
        const FAR: usize = 0b010;
        let mut edges = Vec::new();
        for from in 0..8_usize {
            for to in [1, 2, 4].map(|bit| from | bit).into_iter().filter(|&to| to != from) {
                if (from == FAR || to == FAR) == hidden {
                    edges.push([view.map(self.corner(from)), view.map(self.corner(to))]);
                }
            }
        }
        svg.segments(if hidden { "hid" } else { "vol" }, &edges);
    }

    /// Lines of sight of each point, then those of none above them; lines of the same names are one shape.
    fn draw_lines(&self, svg: &mut Svg, view: &View) {
        let points = (0..self.points.len()).map(Some).chain([None]);
        for point in points {
            let class = point.map_or_else(|| "ax".to_owned(), |index| format!("hair l{}", class_of(index)));
            let mut named: BTreeMap<&[String], Segments> = BTreeMap::new();
            for line in self.lines.iter().filter(|line| line.point == point) {
                named.entry(&line.names).or_default().push([view.map(line.from), view.map(line.to)]);
            }
            for (names, segments) in named {
                let own = point.and_then(|index| self.points.get(index)).map(|point| point.name.as_str());
                let others = names.iter().map(String::as_str).filter(|name| Some(*name) != own);
                svg.names(own.into_iter().chain(others));
                svg.segments(&class, &segments);
            }
        }
        svg.name(None);
    }

    fn draw_axis_names(&self, svg: &mut Svg, view: &View) {
        // Edges on the outline of the view: x and z at the front, y at the lower right.
        let (min, max) = (self.volume_min, self.volume_max);
        let middle = |a: [f64; 3], b: [f64; 3]| view.map(std::array::from_fn(|i| (a[i] + b[i]) / 2.0));
        let text = |name: &str, i: usize| format!("{name} {} … {} {}", fixed(min[i], 0), fixed(max[i], 0), self.unit);
        let x = middle(self.corner(0b000), self.corner(0b001));
        svg.text("muted halo", (x.0 - 8.0, x.1 + 18.0), Anchor::End, &text("x", 0));
        let y = middle(self.corner(0b001), self.corner(0b011));
        svg.text("muted halo", (y.0 + 8.0, y.1 + 18.0), Anchor::Start, &text("y", 1));
        let z = middle(self.corner(0b011), self.corner(0b111));
        svg.text("muted halo", (z.0 + 10.0, z.1 + 4.0), Anchor::Start, &text("z", 2));
    }

    fn draw_points(&self, svg: &mut Svg, view: &View) {
        for (index, point) in self.points.iter().enumerate() {
            let (at, foot) = (view.map(point.at), view.map(self.on_floor(point.at)));
            svg.name(Some(&point.name));
            svg.line("hid", at, foot);
            svg.circle("none frame", foot, 2.4, None);
            let [x, y, z] = point.at.map(|v| fixed(v, 1));
            let tip = format!("{}: x {x}, y {y}, z {z} {}", point.name, self.unit);
            svg.circle(&format!("f{} edge", class_of(index)), at, 6.5, Some(&tip));
            svg.text("strong halo", (at.0 + 11.0, at.1 - 7.0), Anchor::Start, &point.name);
        }
        svg.name(None);
    }
}

fn class_of(index: usize) -> usize {
    index % usize::from(SERIES) + 1
}
