//! Registered effects on residual vectors: their tip motion under a nominal chain.
//!
//! Place in the flow: the study of vectors takes effects from the one registry of the geometry crate. An effect that
//! moves only what a tracer reads cannot show here and is listed as untestable. SI.

use super::ResidualVector;
use super::wave::REGISTERED;
use crate::error::DiagnoseError;
use crate::explanation::Explanation;
use crate::study::candidate::{Candidate, Goes};
use crate::study::outcome::Untestable;
use abbe_geometry::chain::{ErrorValues, chain_point};
use abbe_geometry::effects::{
    CovariateSource, CovariateValue, Effect, Known, Observed, REGISTRY, Shape, ShapeValue, State, TipColumns,
    construct, tip_columns,
};
use abbe_geometry::machine::Machine;
use abbe_geometry::{ErrorId, Vector3};

/// Effects that the look without candidates covers by other means.
const LOOKED_FOR_OTHERWISE: [&str; 3] = ["axis_term", "empirical", REGISTERED];

/// Shapes for each that is proposed of a figure that can be refined.
const FINER: i32 = 3;

/// A registered effect with its candidate.
#[derive(Debug)]
pub(super) struct Registered {
    pub(super) effect: Box<dyn Effect>,
    pub(super) shape: Shape,
    pub(super) candidate: Candidate,
}

impl Registered {
    /// Whether it reads the position and nothing else, and has a form of its own there.
    pub(super) fn is_of_position(&self) -> bool {
        self.candidate.covariates.is_empty()
    }
}

/// What one vector logged, for effects; times count from the first.
pub(super) struct Logged<'a> {
    pub(super) vector: &'a ResidualVector,
    pub(super) start_s: f64,
}

impl CovariateSource for Logged<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        let value = match name {
            "time_s" => self.vector.time_s.map(|time_s| time_s - self.start_s),
            _ => self.vector.covariates.get(name).copied(),
        };
        value.map_or(CovariateValue::Missing, CovariateValue::Fresh)
    }
}

/// Where the nominal chain stands at one vector, and what each error does to the tip there: the same for all effects.
#[derive(Debug, Clone)]
pub(super) struct Nominal {
    reading_m: [f64; 3],
    offset_m: [f64; 3],
    by_error: [Vector3<f64>; ErrorId::COUNT],
}

impl Nominal {
    /// At each of these vectors.
    pub(super) fn at(vectors: &[ResidualVector], machine: &Machine) -> Vec<Nominal> {
        let offset_m = machine.default_offset_m.unwrap_or([0.0; 3]);
        let one = |vector: &ResidualVector| {
            let reading_m = [0, 1, 2].map(|k| vector.position_m[k] - offset_m[k]);
            let by_error = chain_point(machine, reading_m, offset_m, &ErrorValues::ZERO).by_error;
            Nominal { reading_m, offset_m, by_error }
        };
        vectors.iter().map(one).collect()
    }

    /// Motion of the tip per unit of an error of an axis (m/m or m/rad).
    pub(super) fn by_error(&self, id: ErrorId) -> Vector3<f64> {
        self.by_error[id.index()]
    }

    /// Motion of the tip per unit of each of `count` parameters (m per unit).
    pub(super) fn motion(
        &self,
        effect: &dyn Effect,
        count: usize,
        logged: &Logged,
    ) -> Result<TipColumns, DiagnoseError> {
        let state = State { reading_m: self.reading_m, offset_m: self.offset_m, covariates: logged };
        Ok(tip_columns(effect, count, &state, &self.by_error)?)
    }
}

/// All effects that can be tested, and those that cannot.
pub(super) fn registered(
    (vectors, nominal): (&[ResidualVector], &[Nominal]),
    machine: &Machine,
    varying: &[String],
    time_s: (f64, f64),
) -> Result<(Vec<Registered>, Vec<Untestable>), DiagnoseError> {
    let (mut effects, mut untestable) = (Vec::new(), Vec::new());
    // Effects of stations are proposed for one that does not exist, so that they show themselves as such.
    let stations = ["none".to_owned()];
    let offsets_m = [machine.default_offset_m.unwrap_or([0.0; 3])];
    let observed = Observed { machine, varying, stations: &stations, offsets_m: &offsets_m, time_s };
    for entry in REGISTRY.iter().filter(|entry| !LOOKED_FOR_OTHERWISE.contains(&entry.name)) {
        let shapes = (entry.propose)(&observed);
        let none = |needs: String| Untestable { name: entry.title.to_owned(), needs };
        if shapes.is_empty() {
            untestable.push(none(entry.needs.to_owned()));
            continue;
        }
        let before = effects.len();
        for shape in shapes.into_iter().flat_map(|shape| between(entry, shape)) {
            let effect = construct(entry.name, &shape, machine)?;
            if moves_the_tip(effect.as_ref(), (vectors, nominal), time_s.0)? {
                let candidate = candidate(entry, &shape, effect.as_ref());
                effects.push(Registered { effect, shape, candidate });
            }
        }
        if effects.len() == before {
            let needs = "ranges of a tracer: it does not move the tip, so residual vectors cannot show it";
            untestable.push(none(needs.to_owned()));
        }
    }
    Ok((effects, untestable))
}

/// A shape with others up to the next that is proposed, where its figure can be refined: there is no search for it here.
fn between(entry: &Known, shape: Shape) -> Vec<Shape> {
    let Some((refine, ShapeValue::Number(value))) = entry.refine.and_then(|r| Some((r, shape.0.get(r.key)?.clone())))
    else {
        return vec![shape];
    };
    let finer = |k: i32| shape.clone().number(refine.key, value * refine.ratio.powf(f64::from(k) / f64::from(FINER)));
    (0..FINER).map(finer).collect()
}

/// Whether it moves the tip at any vector; an effect that needs what was not logged does not.
fn moves_the_tip(
    effect: &dyn Effect,
    (vectors, nominal): (&[ResidualVector], &[Nominal]),
    start_s: f64,
) -> Result<bool, DiagnoseError> {
    let count = effect.parameters().len();
    for (vector, nominal) in vectors.iter().zip(nominal) {
        match nominal.motion(effect, count, &Logged { vector, start_s }) {
            Ok(columns) if columns.iter().any(|column| *column != Vector3::zeros()) => return Ok(true),
            Ok(_) => {}
            Err(DiagnoseError::Covariate(_)) => return Ok(false),
            Err(other) => return Err(other),
        }
    }
    Ok(false)
}

fn candidate(entry: &'static Known, shape: &Shape, effect: &dyn Effect) -> Candidate {
    let text = |(key, value): (&String, &ShapeValue)| match value {
        ShapeValue::Text(text) => Some(format!("{key} {text}")),
        ShapeValue::Texts(texts) => Some(format!("{key} {}", texts.join(" and "))),
        ShapeValue::Number(_) | ShapeValue::Numbers(_) => None,
    };
    let named: Vec<String> = shape.0.iter().filter_map(text).collect();
    let figures: Vec<String> = shape.0.iter().filter_map(|(key, value)| figure(key, value)).collect();
    let about = named.iter().chain(&figures).cloned().collect::<Vec<_>>().join(", ");
    Candidate {
        name: if about.is_empty() { entry.title.to_owned() } else { format!("{} ({about})", entry.title) },
        formula: format!("{}; typical {}", entry.formula, entry.typical),
        kind: Explanation::Attributed,
        family: format!("{} {}", entry.name, named.join(" ")),
        covariates: effect.covariates(),
        parameters: effect.parameters(),
        decided_by: entry.decided_by.to_owned(),
        essential: effect.essential().to_vec(),
        stands_apart: effect.covariates().is_empty(),
        goes: Goes::ByEvidence,
    }
}

fn figure(key: &str, value: &ShapeValue) -> Option<String> {
    match value {
        ShapeValue::Number(value) => Some(format!("{key} {}", rounded(*value))),
        ShapeValue::Numbers(values) => {
            let values: Vec<String> = values.iter().map(|value| rounded(*value).to_string()).collect();
            Some(format!("{key} {}", values.join(" ")))
        }
        ShapeValue::Text(_) | ShapeValue::Texts(_) => None,
    }
}

/// With the four digits that tell one shape from the next.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}
