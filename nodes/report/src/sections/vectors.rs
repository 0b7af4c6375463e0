//! Error vectors over a volume: each point with its error before and after, enlarged; the page's script turns and stretches it.
//!
//! In: positions and vectors in the units named; out: an isometric drawing, and the same numbers for the script. The drawing
//! fits into its frame however it is turned.

use serde::{Deserialize, Serialize};
use serde_json::json;

use super::State;
use crate::digits;
use crate::error::ReportError;
use crate::frame::{Swatch, WIDTH_PX, draw_legend, drawn, one_in};
use crate::svg::{Anchor, Drawing, Svg};
use crate::text::{escape, fixed, integer};

/// Height of the view, px.
const HEIGHT_PX: f64 = 560.0;
/// Space around the view for names and the longest vectors, px.
const MARGIN_PX: f64 = 56.0;
/// From the corner at the end of an axis to its name, as in the page's script, px.
const NAME_PX: f64 = 14.0;
/// Length of the largest vector as drawn, as a share of the volume's diagonal.
const LARGEST_SHARE: f64 = 0.12;

/// A point with its vectors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Vector {
    /// Position, in the unit of the positions.
    pub at: [f64; 3],
    /// One vector a state, in the order of [`Vectors::states`] and in the unit of the vectors.
    pub states: [Option<[f64; 3]>; 2],
}

/// Error vectors over a volume.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Vectors {
    /// Title of the figure.
    pub title: String,
    /// Sentence under the title.
    pub note: Option<String>,
    /// Unit of the positions, e.g. `mm`.
    pub position_unit: String,
    /// Unit of the vectors, e.g. `µm`.
    pub vector_unit: String,
    /// One unit of the vectors in units of the positions, e.g. 0.001.
    pub vector_in_position: f64,
    /// Lower corner of the volume.
    pub volume_min: [f64; 3],
    /// Upper corner of the volume.
    pub volume_max: [f64; 3],
    /// Names of the states, one or two, and what they are.
    pub states: Vec<(String, State)>,
    /// Points.
    pub points: Vec<Vector>,
}

/// Length of a vector.
fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|c| c * c).sum::<f64>().sqrt()
}

/// Largest number of the form 1, 2 or 5 times a power of ten up to `value`.
fn round_down(value: f64) -> f64 {
    let decade = 10f64.powf(value.log10().floor());
    [5.0, 2.0].into_iter().map(|f| f * decade).find(|round| *round <= value).unwrap_or(decade)
}

/// The projection: viewer in the direction (1, −1, 1), as the script begins.
struct View {
    centre: [f64; 3],
    scale: f64,
}

impl View {
    fn map(&self, at: [f64; 3]) -> (f64, f64) {
        let [u, v, w] = std::array::from_fn(|i| at[i] - self.centre[i]);
        let (half, third) = (0.5_f64.sqrt(), (1.0_f64 / 3.0).sqrt());
        let up = third * half * (v - u) + (2.0_f64 / 3.0).sqrt() * w;
        (WIDTH_PX / 2.0 + self.scale * half * (u + v), HEIGHT_PX / 2.0 - self.scale * up)
    }
}

impl Vectors {
    /// Refuses an empty volume, no or too many states, and a scale of the vectors that is not positive.
    pub(crate) fn check(&self) -> Result<(), ReportError> {
        if (0..3).any(|i| self.volume_min[i] >= self.volume_max[i]) {
            let what = "volume_min is not below volume_max on every axis";
            return Err(ReportError::shape(&self.title, what, "pass the lower and the upper corner"));
        }
        if self.states.is_empty() || self.states.len() > 2 {
            let what = format!("{} states", self.states.len());
            return Err(ReportError::shape(&self.title, what, "give one state or two"));
        }
        if self.vector_in_position <= 0.0 {
            let what = "vector_in_position is not above 0";
            return Err(ReportError::shape(&self.title, what, "pass the vectors' unit in units of the positions"));
        }
        Ok(())
    }

    fn corner(&self, bits: usize) -> [f64; 3] {
        std::array::from_fn(|i| if bits >> i & 1 == 1 { self.volume_max[i] } else { self.volume_min[i] })
    }

    fn view(&self) -> View {
        let centre = std::array::from_fn(|i| self.volume_min[i] / 2.0 + self.volume_max[i] / 2.0);
        View { centre, scale: (HEIGHT_PX - 2.0 * MARGIN_PX) / self.diagonal() }
    }

    fn diagonal(&self) -> f64 {
        length(std::array::from_fn(|i| self.volume_max[i] - self.volume_min[i]))
    }

    /// Decimals of the components: those of the state whose vectors are the shortest.
    fn decimals(&self) -> u8 {
        let longest = |k: usize| self.points.iter().filter_map(|p| p.states[k].map(length)).reduce(f64::max);
        (0..self.states.len().min(2)).filter_map(longest).map(digits::of_result).max().unwrap_or(0)
    }

    /// How many times the vectors are enlarged: a round number.
    fn magnification(&self) -> f64 {
        let vectors = self.points.iter().flat_map(|p| p.states.iter().flatten());
        let largest = vectors.map(|v| length(*v)).fold(0.0, f64::max) * self.vector_in_position;
        if largest > 0.0 { round_down(LARGEST_SHARE * self.diagonal() / largest) } else { 1.0 }
    }

    /// The points that are drawn.
    fn shown(&self) -> Vec<&Vector> {
        drawn(&self.points, one_in(self.points.len())).collect()
    }

    /// The note, with what the drawing leaves out.
    pub(crate) fn full_note(&self) -> Option<String> {
        let step = one_in(self.points.len());
        let thinned = (step > 1).then(|| format!("One point in {step} is drawn."));
        let parts: Vec<String> = self.note.iter().cloned().chain(thinned).collect();
        (!parts.is_empty()).then(|| parts.join(" "))
    }

    /// Draws the figure.
    pub(crate) fn draw(&self) -> Result<Drawing, ReportError> {
        let (view, magnification) = (self.view(), self.magnification());
        let mut svg = Svg::new(WIDTH_PX, HEIGHT_PX);
        let legend = |(name, state): &(String, State)| (Swatch::Line(format!("vec l{}", state.class())), name.clone());
        let legend: Vec<_> = self.states.iter().map(legend).collect();
        draw_legend(&mut svg, (MARGIN_PX, 16.0), &legend);
        svg.text("small muted magnified", (WIDTH_PX - MARGIN_PX, 16.0), Anchor::End, &self.enlarged_text());
        svg.text("small muted", (WIDTH_PX - MARGIN_PX, HEIGHT_PX - 8.0), Anchor::End, &self.size_text());
        svg.open("class=\"scene\"");
        let edges = (0..8_usize).flat_map(|from| [1, 2, 4].map(|bit| (from, from | bit)));
        let edges: Vec<_> = edges
            .filter(|(from, to)| from != to)
            .map(|(from, to)| [from, to].map(|c| view.map(self.corner(c))))
            .collect();
        svg.segments("vol", &edges);
        for (name, corner) in [("x", 1), ("y", 2), ("z", 4)] {
            // Beyond its corner, away from the middle: nothing is drawn there but long vectors.
            let (from, to) = (view.map(self.corner(0)), view.map(self.corner(corner)));
            let away = NAME_PX / (to.0 - from.0).hypot(to.1 - from.1).max(1.0);
            let at = (to.0 + away * (to.0 - from.0), to.1 + away * (to.1 - from.1) + 4.0);
            svg.text("muted halo", at, Anchor::Middle, name);
        }
        let shown = self.shown();
        svg.dots("muteds", &shown.iter().map(|p| view.map(p.at)).collect::<Vec<_>>(), &[]);
        let stretch = magnification * self.vector_in_position;
        for (index, (name, state)) in self.states.iter().enumerate() {
            let ends = shown.iter().filter_map(|p| {
                let vector = p.states[index]?;
                Some([view.map(p.at), view.map(std::array::from_fn(|i| p.at[i] + stretch * vector[i]))])
            });
            let ends: Vec<_> = ends.collect();
            svg.name(Some(name));
            svg.segments(&format!("vec l{}", state.class()), &ends);
            svg.dots(&format!("vtip l{}", state.class()), &ends.iter().map(|[_, tip]| *tip).collect::<Vec<_>>(), &[]);
        }
        svg.name(None);
        svg.close();
        svg.finish(&self.title)
    }

    /// The words of the drawing as text below it.
    pub(crate) fn key(&self) -> String {
        let state = |(name, state): &(String, State)| {
            let colour = format!("<i style=\"background:var(--{})\"></i>", state.variable());
            format!("<b>{colour}{}</b>; ", escape(name))
        };
        let states: String = self.states.iter().map(state).collect();
        let (enlarged, size) = (self.enlarged_text(), escape(&self.size_text()));
        format!("<p class=\"key\">{states}<span class=\"magnified\">{enlarged}</span>; {size}</p>\n")
    }

    fn enlarged_text(&self) -> String {
        format!("vectors enlarged {} ×", integer(self.magnification().round() as i64))
    }

    fn size_text(&self) -> String {
        let range = |i: usize| {
            format!("{} {} … {}", ["x", "y", "z"][i], fixed(self.volume_min[i], 0), fixed(self.volume_max[i], 0))
        };
        format!("{}, {}, {} {}", range(0), range(1), range(2), self.position_unit)
    }

    /// The numbers of the drawing for the script, as JSON that no markup can end.
    pub(crate) fn scene(&self) -> String {
        let view = self.view();
        let rounded = |value: f64, decimals: u8| {
            let factor = 10f64.powi(i32::from(decimals));
            let rounded = (value * factor).round() / factor;
            // No negative zero.
            json!(rounded + 0.0)
        };
        let decimals = self.decimals();
        let point = |p: &&Vector| {
            let mut numbers: Vec<_> = p.at.iter().map(|v| rounded(*v, 2)).collect();
            for state in p.states.iter().take(self.states.len()) {
                match state {
                    Some(vector) => numbers.extend(vector.iter().map(|v| rounded(*v, decimals))),
                    None => numbers.extend([json!(null), json!(null), json!(null)]),
                }
            }
            json!(numbers)
        };
        let states: Vec<_> = self.states.iter().map(|(name, state)| json!([name, state.class()])).collect();
        let scene = json!({
            "size": [WIDTH_PX, HEIGHT_PX], "centre": view.centre, "scale": view.scale,
            "magnification": self.magnification(), "unit": self.vector_in_position, "position_unit": self.position_unit,
            "corners": (0..8).map(|bits| self.corner(bits)).collect::<Vec<_>>(),
            "states": states, "points": self.shown().iter().map(point).collect::<Vec<_>>(),
        });
        scene.to_string().replace('<', "\\u003c")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(vector: [f64; 3]) -> Vectors {
        Vectors {
            title: "V".into(),
            note: None,
            position_unit: "mm".into(),
            vector_unit: "µm".into(),
            vector_in_position: 1e-3,
            volume_min: [0.0; 3],
            volume_max: [100.0; 3],
            states: vec![("</script>".into(), State::Before)],
            points: vec![Vector { at: [50.0; 3], states: [Some(vector), None] }],
        }
    }

    #[test]
    fn the_largest_vector_takes_a_round_number_of_times_its_length() {
        // 12 % of the diagonal of 173.2 mm is 20.8 mm; 10 µm fit 2078 times: 2000.
        assert_eq!(cube([0.0, 0.0, 10.0]).magnification(), 2000.0);
        assert_eq!(cube([0.0; 3]).magnification(), 1.0);
        // Straight up on the screen: 20 mm at sqrt(2/3) of the scale.
        let body = cube([0.0, 0.0, 10.0]).draw().unwrap().body;
        let up = 280.0 - (2.0_f64 / 3.0).sqrt() * 20.0 * (560.0 - 112.0) / 30_000f64.sqrt();
        assert!(body.contains(&format!("M540 280L540 {up:.2}")), "{up} {body}");
    }

    /// On a phone the drawing's own words were four pixels high.
    #[test]
    fn regress_the_words_of_the_drawing_stand_below_it_too() {
        let key = cube([0.0, 0.0, 10.0]).key();
        assert!(key.contains("var(--before)") && key.contains("&lt;/script&gt;"), "{key}");
        assert!(key.contains("<span class=\"magnified\">vectors enlarged 2000 ×</span>; x 0 … 100"), "{key}");
    }

    #[test]
    fn components_have_the_digits_of_the_shortest_state() {
        let mut two = cube([40.1234, 0.0, 0.0]);
        assert_eq!(two.decimals(), 1);
        two.states.push(("after".into(), State::After));
        two.points[0].states[1] = Some([0.0, 0.21234, 0.0]);
        assert_eq!(two.decimals(), 3);
    }

    #[test]
    fn numbers_for_the_script_cannot_end_its_element() {
        let scene = cube([1.0, -0.001, 2.0]).scene();
        assert!(!scene.contains('<') && scene.contains("[50.0,50.0,50.0,1.0,0.0,2.0]"), "{scene}");
    }
}
