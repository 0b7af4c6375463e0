//! Whether two terms claim the same thing.
//!
//! Place in the flow: [`crate::search`] and what follows it ask before a term goes in, comes back or counts as a rival.

use crate::context::follows_time;
use crate::lagged_columns::logged_of;
use abbe_geometry::effects::{Shape, ShapeValue, of_lagged};
use abbe_geometry::model::FittedEffect;
use abbe_identify::EffectTerm;

/// The effect that describes without a cause.
pub(crate) const DESCRIPTION: &str = "empirical";

/// Whether two terms are the same effect with other figures (degree, time constant): the same claim. With another axis or
/// sensor it is another claim.
pub(crate) fn is_variant(a: &EffectTerm, b: &EffectTerm) -> bool {
    let texts = |term: &EffectTerm| {
        let others = term.shape.0.iter().filter(|(_, value)| !matches!(value, ShapeValue::Number(_)));
        // A temperature and what lags behind it are one sensor, and a side over any travel is one side.
        let logged = |value: &ShapeValue| match value {
            ShapeValue::Text(name) => ShapeValue::Text(logged_of(name)),
            other => other.clone(),
        };
        others.map(|(key, value)| (key.clone(), logged(value))).collect::<Vec<_>>()
    };
    a.effect.name() == b.effect.name() && texts(a) == texts(b)
}

/// Whether a term is among these, figures and all.
pub(crate) fn has(terms: &[EffectTerm], term: &EffectTerm) -> bool {
    is_one(terms, term.effect.name(), &term.shape)
}

/// Whether a fitted effect is one of these.
pub(crate) fn is_of(terms: &[EffectTerm], fitted: &FittedEffect) -> bool {
    is_one(terms, fitted.effect.name(), &fitted.shape)
}

fn is_one(terms: &[EffectTerm], name: &str, shape: &Shape) -> bool {
    terms.iter().any(|other| other.effect.name() == name && other.shape == *shape)
}

/// Whether two terms read one quantity, as it was logged or behind a lag.
pub(crate) fn read_the_same(a: &EffectTerm, b: &EffectTerm) -> bool {
    let logged = |term: &EffectTerm| term.effect.reads().iter().map(|name| logged_of(name)).collect::<Vec<_>>();
    let reads = logged(b);
    logged(a).iter().any(|name| reads.contains(name))
}

/// Whether likelihood alone may choose between them. The search puts a cause before a description, what is logged before what lags
/// behind it, and nothing into a coordinate that only follows the time of the campaign.
pub(crate) fn is_of_its_kind(other: &EffectTerm, found: &EffectTerm) -> bool {
    let describes = |term: &EffectTerm| term.effect.name() == DESCRIPTION;
    let lags = |term: &EffectTerm| term.effect.reads().iter().any(|name| of_lagged(name).is_some());
    (describes(found) || !describes(other))
        && (lags(found) || !lags(other))
        && !follows_time(other.effect.as_ref(), &other.shape)
}
