//! Measured vectors that are far off, in words.
//!
//! Place in the flow: what is held out before a training, and what a training says of its points.

use abbe_field::Samples;
use abbe_geometry::Axis;

/// A measured vector and how far it is off, in words.
pub(crate) fn off_text(field: &Samples, index: usize, component: usize, off_m: f64, times: f64) -> String {
    let (at, name) = (place_text(field, index), Axis::ALL[component].lower());
    format!("{at}: {name} is {:+.3} µm off, {times:.0} u", off_m * 1e6)
}

/// A point in words: its position in mm, and other inputs by name.
fn place_text(field: &Samples, index: usize) -> String {
    let (point, names) = (field.point(index), field.names());
    let first = if field.has_position() { 3 } else { 0 };
    let position: Vec<String> = point[..first].iter().map(|m| format!("{:.3}", m * 1e3)).collect();
    let further = names[first..].iter().zip(&point[first..]).map(|(name, value)| format!("{name} {value:.4}"));
    let position = (first > 0).then(|| format!("({}) mm", position.join(" ")));
    position.into_iter().chain(further).collect::<Vec<_>>().join(", ")
}
