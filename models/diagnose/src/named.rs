//! What a term is called where readers are told of it.
//!
//! Place in the flow: words of steps, of exchanges and of what may stand in the place of an effect.

use abbe_geometry::effects::{Shape, ShapeValue};

/// A name with what the shape says of axis and sensor: `backlash (axis y, over x)`.
pub(crate) fn named(name: &str, shape: &Shape) -> String {
    let word = |(key, value): (&String, &ShapeValue)| match value {
        ShapeValue::Text(text) => Some(format!("{key} {text}")),
        ShapeValue::Number(_) | ShapeValue::Numbers(_) | ShapeValue::Texts(_) => None,
    };
    let words: Vec<String> = shape.0.iter().filter_map(word).collect();
    if words.is_empty() { name.to_owned() } else { format!("{name} ({})", words.join(", ")) }
}
