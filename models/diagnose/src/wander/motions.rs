//! Motions of the tip that are linear or quadratic in the readings, and where the machine stood.
//!
//! Place in the flow: [`super`] multiplies each by a course. A motion is a form of the place ([`VarianceByPlace::forms`]) along an axis;
//! its size makes what is linear and what is quadratic as large at the ends of the strokes.

use crate::columns::range;
use abbe_geometry::by_place::{FORMS, VarianceByPlace};
use abbe_measurement::campaign::Campaign;

/// Where the square of each coordinate stands among the forms.
const SQUARES: [usize; 3] = [4, 7, 9];
/// Axes as readers know them.
const AXES: [&str; 3] = ["X", "Y", "Z"];

/// Motions of the tip: which form of the place moves it along which axis, and by how much (m per unit).
#[derive(Clone)]
pub(super) struct Motions(pub(super) Vec<(usize, usize, f64)>);

impl Motions {
    /// Shifts, scales along the axes and angles between them; one unit is 1 m, and 1 rad.
    fn linear(places: &Places) -> Motions {
        let shifts = (0..3).map(|d| (d, 0, 1.0));
        let scales = (0..3).flat_map(|d| (d..3).map(move |by| (d, 1 + by, places.half_span_m[by])));
        Motions(shifts.chain(scales).collect())
    }

    /// What is linear, and what is quadratic.
    pub(super) fn families(places: &Places) -> [Motions; 2] {
        [Motions::linear(places), Motions::quadratic(places)]
    }

    /// Each motion of these sets, once, and the places of those of each set among them.
    pub(super) fn all_of(sets: &[Motions]) -> (Motions, Vec<Vec<usize>>) {
        let mut all: Vec<(usize, usize, f64)> = Vec::new();
        let mut place = |motion: &(usize, usize, f64)| {
            all.iter().position(|own| own == motion).unwrap_or_else(|| {
                all.push(*motion);
                all.len() - 1
            })
        };
        let places = sets.iter().map(|set| set.0.iter().map(&mut place).collect()).collect();
        (Motions(all), places)
    }

    /// Each motion by itself.
    pub(super) fn each(places: &Places) -> Vec<Motions> {
        Motions::quadratic(places).0.into_iter().map(|motion| Motions(vec![motion])).collect()
    }

    /// Along each axis what goes with one coordinate: shift, tilt and bow.
    pub(super) fn bows(places: &Places) -> Vec<Motions> {
        let all = Motions::quadratic(places).0;
        let is_of = |form: usize, by: usize| form == 0 || form == 1 + by || form == SQUARES[by];
        let one = |(d, by): (usize, usize)| {
            Motions(all.iter().copied().filter(|motion| motion.0 == d && is_of(motion.1, by)).collect())
        };
        (0..3).flat_map(|d| (0..3).map(move |by| (d, by))).map(one).collect()
    }

    /// Each shift, stretch and angle by itself; all motions of one axis.
    pub(super) fn sets(places: &Places) -> Vec<Motions> {
        let each =
            |d: usize| (0..4).map(move |form| (d, form, if form == 0 { 1.0 } else { places.half_span_m[form - 1] }));
        let mut sets: Vec<Motions> = (0..3).flat_map(each).map(|motion| Motions(vec![motion])).collect();
        let all = Motions::quadratic(places);
        let along = |d: usize| Motions(all.0.iter().copied().filter(|motion| motion.0 == d).collect());
        sets.extend((0..3).map(along));
        sets
    }

    /// Whether it asks for several motions of all axes. Those alone decide whether a machine wanders: a look for each motion would cost more than
    /// it sees. Which of all sets it is, the likelihood tells.
    pub(super) fn is_family(&self) -> bool {
        (1..3).all(|d| self.0.iter().any(|motion| motion.0 == d))
    }

    /// What it is, where it is one motion.
    pub(super) fn alone(&self) -> Option<String> {
        let [(d, form, _)] = self.0.as_slice() else { return None };
        let axis = AXES[*d];
        Some(match form.checked_sub(1) {
            None => format!("a motion of all along {axis}"),
            Some(by) if by == *d => format!("a stretch along {axis}"),
            Some(by) => format!("a motion along {axis} in proportion to the reading of {}", AXES[by]),
        })
    }

    /// What is linear, and bows: what is quadratic in the readings, at the ends of the strokes as large as what is linear.
    pub(super) fn quadratic(places: &Places) -> Motions {
        let half_m = places.half_span_m;
        let pairs = (0..3).flat_map(|a| (a..3).map(move |b| (a, b)));
        let forms = pairs.enumerate().map(|(k, (a, b))| (4 + k, half_m[a].min(half_m[b])));
        let mut motions = Motions::linear(places);
        motions.0.extend(forms.flat_map(|(form, size_m)| (0..3).map(move |d| (d, form, size_m))));
        motions
    }
}

/// Where a campaign has moved the machine: the same for all fits of it, whichever readings they reject, so that what they tell can be added.
/// Readings outside the strokes were refused.
#[derive(Debug, Clone, Copy)]
pub(super) struct Span {
    middle_m: [f64; 3],
    half_m: [f64; 3],
}

impl Span {
    /// Of all readings. Along an axis that was not moved, the longest span stands in.
    pub(super) fn of(campaign: &Campaign) -> Span {
        let ends: [(f64, f64); 3] = std::array::from_fn(|d| range(campaign.readings.iter().map(|r| r.reading_m[d])));
        let middle_m = ends.map(|(low, high)| f64::midpoint(low, high));
        let longest_m = ends.iter().map(|(low, high)| high - low).fold(f64::MIN_POSITIVE, f64::max);
        let half_m = ends.map(|(low, high)| if high > low { 0.5 * (high - low) } else { 0.5 * longest_m });
        Span { middle_m, half_m }
    }
}

/// Where the machine stood at each reading.
pub(super) struct Places {
    pub(super) middle_m: [f64; 3],
    pub(super) half_span_m: [f64; 3],
    pub(super) forms: Vec<[f64; FORMS]>,
}

impl Places {
    pub(super) fn of(campaign: &Campaign, Span { middle_m, half_m: half_span_m }: Span) -> Places {
        let forms = campaign.readings.iter().map(|r| VarianceByPlace::forms(middle_m, half_span_m, r.reading_m));
        Places { middle_m, half_span_m, forms: forms.collect() }
    }
}
