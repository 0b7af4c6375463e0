//! A few shapes of SVG, and plots of curves; coordinates in pixels, one decimal, so that rounding does not change a picture.

use std::fmt::Write;

pub(crate) const INK: &str = "#1b1f23";
pub(crate) const MUTED: &str = "#59636e";
pub(crate) const GRID: &str = "#e4e7ea";
pub(crate) const BLUE: &str = "#0067a5";
pub(crate) const ORANGE: &str = "#c05600";
pub(crate) const GREEN: &str = "#00805c";

pub(crate) type Point = (f64, f64);

/// A picture that grows.
pub(crate) struct Canvas {
    width: f64,
    height: f64,
    body: String,
}

impl Canvas {
    pub(crate) fn new(width: f64, height: f64) -> Canvas {
        Canvas { width, height, body: String::new() }
    }

    /// The whole file; `title` is read aloud where nothing is seen.
    pub(crate) fn finished(self, title: &str) -> String {
        let Canvas { width, height, body } = self;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" role=\"img\" font-family=\"sans-serif\" \
             font-size=\"13\">\n<title>{title}</title>\n<rect width=\"{width}\" height=\"{height}\" rx=\"6\" fill=\"#ffffff\"/>\n{body}</svg>\n"
        )
    }

    pub(crate) fn path(&mut self, points: &[Point], colour: &str, width: f64, dashes: &str) {
        let points: Vec<String> = points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        let dashes = if dashes.is_empty() { String::new() } else { format!(" stroke-dasharray=\"{dashes}\"") };
        let points = points.join(" ");
        writeln!(
            self.body,
            "<polyline points=\"{points}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\"{dashes}/>"
        )
        .unwrap();
    }

    pub(crate) fn area(&mut self, points: &[Point], fill: &str, opacity: f64) {
        let points: Vec<String> = points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        let points = points.join(" ");
        writeln!(self.body, "<polygon points=\"{points}\" fill=\"{fill}\" fill-opacity=\"{opacity}\"/>").unwrap();
    }

    pub(crate) fn dot(&mut self, (x, y): Point, radius: f64, colour: &str) {
        writeln!(self.body, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{colour}\"/>").unwrap();
    }

    /// `anchor` is start, middle or end.
    pub(crate) fn text(&mut self, (x, y): Point, anchor: &str, colour: &str, text: &str) {
        writeln!(self.body, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" fill=\"{colour}\">{text}</text>")
            .unwrap();
    }

    /// A line with a head at its end.
    pub(crate) fn arrow(&mut self, from: Point, to: Point, colour: &str) {
        self.path(&[from, to], colour, 1.5, "");
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let length = dx.hypot(dy).max(1.0);
        let (ux, uy) = (dx / length, dy / length);
        let side = |sign: f64| (to.0 - 8.0 * ux - 4.0 * sign * uy, to.1 - 8.0 * uy + 4.0 * sign * ux);
        self.area(&[to, side(1.0), side(-1.0)], colour, 1.0);
    }
}

/// A plot: where its corner and its values lie on the canvas.
#[derive(Clone, Copy)]
pub(crate) struct Plot {
    pub(crate) left: f64,
    pub(crate) top: f64,
    pub(crate) width: f64,
    pub(crate) height: f64,
    pub(crate) x: (f64, f64),
    pub(crate) y: (f64, f64),
}

impl Plot {
    pub(crate) fn at(&self, x: f64, y: f64) -> Point {
        let share = |(low, high): (f64, f64), value: f64| (value - low) / (high - low);
        (self.left + self.width * share(self.x, x), self.top + self.height * (1.0 - share(self.y, y)))
    }

    pub(crate) fn curve(&self, values: &[(f64, f64)]) -> Vec<Point> {
        values.iter().map(|(x, y)| self.at(*x, *y)).collect()
    }

    /// Frame, marks of each axis and what they are.
    pub(crate) fn frame(&self, canvas: &mut Canvas, marks: (&[f64], &[f64]), words: (&str, &str)) {
        for y in marks.1 {
            canvas.path(&[self.at(self.x.0, *y), self.at(self.x.1, *y)], GRID, 1.0, "");
            let (x, y_px) = self.at(self.x.0, *y);
            canvas.text((x - 6.0, y_px + 4.0), "end", MUTED, &number(*y));
        }
        for x in marks.0 {
            let (x_px, y) = self.at(*x, self.y.0);
            canvas.path(&[(x_px, y), (x_px, y + 4.0)], MUTED, 1.0, "");
            canvas.text((x_px, y + 18.0), "middle", MUTED, &number(*x));
        }
        canvas.path(&[self.at(self.x.0, self.y.0), self.at(self.x.1, self.y.0)], MUTED, 1.0, "");
        let (x, y) = self.at(self.x.1, self.y.0);
        canvas.text((x, y + 34.0), "end", MUTED, words.0);
        let (x, y) = self.at(self.x.0, self.y.1);
        canvas.text((x - 6.0, y - 8.0), "start", MUTED, words.1);
    }
}

fn number(value: f64) -> String {
    if value < 0.0 { format!("−{}", -value) } else { format!("{value}") }
}
