//! Residual vectors as a study: rows, rigid motion, candidates, blocks.
//!
//! Place in the flow: between shapes, registered effects and the common search. Three whitened rows a vector.

use super::ResidualVector;
use super::blocks::blocks;
use super::registered::{Logged, Registered, motion, registered};
use super::shape::{Quantity, Shape};
use crate::error::DiagnoseError;
use crate::score::Score;
use crate::study::candidate::{Candidate, Local, Study};
use crate::study::diagnosis::{Kind, Untestable};
use crate::study::fit::Fit;
use crate::study::smooth::{levels, range};
use abbe_geometry::effects::ParameterSpec;
use abbe_geometry::machine::Machine;
use abbe_geometry::{Axis, Vector3};
use faer::Mat;
use std::collections::BTreeSet;

/// Assumed where no uncertainty is declared (m); only ratios matter then.
const ASSUMED_M: f64 = 1e-6;
const FEWEST_VECTORS: usize = 12;
const FEWEST_BLOCKS: usize = 3;
/// Largest empirical motion believed (m).
const PLAUSIBLE_M: f64 = 1e-3;
/// Quantities that are tried in pairs: their number grows with the square.
const IN_PAIRS: usize = 16;

/// What a candidate is made of.
enum Part {
    Registered(Registered),
    /// One component of the residual.
    Smooth(Axis, Shape),
}

/// All vectors.
pub(super) struct Vectors<'a> {
    vectors: &'a [ResidualVector],
    machine: Option<&'a Machine>,
    sigma_m: Vec<[f64; 3]>,
    is_declared: bool,
    start_s: f64,
    quantities: Vec<Quantity>,
    /// Rows of each block.
    blocks: Vec<Vec<usize>>,
    block_word: &'static str,
    candidates: Vec<Candidate>,
    parts: Vec<Part>,
    untestable: Vec<Untestable>,
}

impl<'a> Vectors<'a> {
    pub(super) fn new(
        vectors: &'a [ResidualVector],
        machine: Option<&'a Machine>,
    ) -> Result<Vectors<'a>, DiagnoseError> {
        check(vectors)?;
        let (members, block_word) = blocks(vectors);
        if members.len() < FEWEST_BLOCKS {
            return Err(data(
                format!("the vectors come in {} blocks, at least {FEWEST_BLOCKS} are needed", members.len()),
                "name further blocks in the column block, or leave that column out",
            ));
        }
        let is_declared = vectors.iter().all(|vector| vector.u_m.is_some());
        let sigma = |v: &ResidualVector| v.u_m.filter(|_| is_declared).unwrap_or([ASSUMED_M; 3]);
        let (quantities, untestable) = quantities(vectors);
        let rows = |block: Vec<usize>| block.into_iter().flat_map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        let mut study = Vectors {
            vectors,
            machine,
            sigma_m: vectors.iter().map(sigma).collect(),
            is_declared,
            start_s: vectors.iter().filter_map(|vector| vector.time_s).fold(f64::INFINITY, f64::min),
            quantities,
            blocks: members.into_iter().map(rows).collect(),
            block_word,
            candidates: Vec::new(),
            parts: Vec::new(),
            untestable,
        };
        study.add_registered()?;
        study.add_smooth();
        Ok(study)
    }

    fn add_registered(&mut self) -> Result<(), DiagnoseError> {
        let Some(machine) = self.machine else {
            self.untestable.push(Untestable {
                name: "every registered effect of a machine".to_owned(),
                needs: "the machine file of the chain behind the positions".to_owned(),
            });
            return Ok(());
        };
        // Positions are no covariates; they come first among the quantities.
        let logged = |quantity: &&Quantity| !POSITION.contains(&quantity.name.as_str());
        let varying: Vec<String> = self.quantities.iter().filter(logged).map(|q| q.name.clone()).collect();
        let time_s = self.quantities.iter().find(|quantity| quantity.name == TIME).map_or((0.0, 0.0), |q| q.range);
        let (effects, untestable) = registered(self.vectors, machine, &varying, time_s)?;
        for effect in effects {
            self.candidates.push(effect.candidate.clone());
            self.parts.push(Part::Registered(effect));
        }
        self.untestable.extend(untestable);
        Ok(())
    }

    fn add_smooth(&mut self) {
        for shape in Shape::all(&self.quantities, IN_PAIRS) {
            for axis in Axis::ALL {
                self.candidates.push(self.smooth_candidate(shape, axis));
                self.parts.push(Part::Smooth(axis, shape));
            }
        }
    }

    fn smooth_candidate(&self, shape: Shape, axis: Axis) -> Candidate {
        let (words, formula) = shape.words(&self.quantities);
        let names: Vec<String> = shape.quantities().iter().map(|k| self.quantities[*k].name.clone()).collect();
        Candidate {
            name: format!("{words}, component {}", axis.lower()),
            formula: formula.to_owned(),
            kind: Kind::Empirical,
            family: format!("{}, component {}", names.join(" and "), axis.lower()),
            decided_by: format!("vary {} independently of each other and of all else", names.join(" and ")),
            covariates: names,
            parameters: shape.parameters().into_iter().map(|name| ParameterSpec::new(name, "m", PLAUSIBLE_M)).collect(),
        }
    }

    fn centre_m(&self) -> Vector3<f64> {
        self.vectors.iter().map(|vector| Vector3::from(vector.position_m)).sum::<Vector3<f64>>()
            / self.vectors.len() as f64
    }
}

impl Study for Vectors<'_> {
    fn of(&self) -> &'static str {
        "residual vectors"
    }

    fn candidates(&self) -> &[Candidate] {
        &self.candidates
    }

    fn local(&self, _added: &[(usize, Vec<f64>)]) -> Result<Local, DiagnoseError> {
        let centre_m = self.centre_m();
        let mut base = Mat::zeros(3 * self.vectors.len(), 6);
        let mut residual = Vec::with_capacity(3 * self.vectors.len());
        for (k, (vector, sigma_m)) in self.vectors.iter().zip(&self.sigma_m).enumerate() {
            let arm_m = Vector3::from(vector.position_m) - centre_m;
            for d in 0..3 {
                residual.push(vector.residual_m[d] / sigma_m[d]);
                base[(3 * k + d, d)] = 1.0 / sigma_m[d];
                for about in 0..3 {
                    base[(3 * k + d, 3 + about)] = Vector3::ith(about, 1.0).cross(&arm_m)[d] / sigma_m[d];
                }
            }
        }
        Ok(Local { residual, base, point: Vec::new() })
    }

    fn columns(&self, _point: &[f64], candidate: usize) -> Mat<f64> {
        let mut columns = Mat::zeros(3 * self.vectors.len(), self.candidates[candidate].parameters.len());
        for (k, (vector, sigma_m)) in self.vectors.iter().zip(&self.sigma_m).enumerate() {
            match (&self.parts[candidate], self.machine) {
                (Part::Smooth(axis, shape), _) => {
                    let d = axis.index();
                    for (j, value) in shape.columns(&self.quantities, k).into_iter().enumerate() {
                        columns[(3 * k + d, j)] = value / sigma_m[d];
                    }
                }
                (Part::Registered(registered), Some(machine)) => {
                    let logged = Logged { vector, start_s: self.start_s };
                    // Only what is logged at every vector is proposed, so that there is no problem to report here.
                    let moved = motion(registered.effect.as_ref(), machine, &logged).unwrap_or_default();
                    for (j, moved) in moved.iter().enumerate() {
                        (0..3).for_each(|d| columns[(3 * k + d, j)] = moved[d] / sigma_m[d]);
                    }
                }
                (Part::Registered(_), None) => {}
            }
        }
        columns
    }

    fn blocks(&self) -> &[Vec<usize>] {
        &self.blocks
    }

    fn block_word(&self) -> &str {
        self.block_word
    }

    fn rows_per_point(&self) -> usize {
        3
    }

    fn unit_m(&self) -> f64 {
        let weights: f64 = self.sigma_m.iter().flatten().map(|s| s.powi(-2)).sum();
        (weights / (3 * self.sigma_m.len()) as f64).sqrt().recip()
    }

    fn is_declared(&self) -> bool {
        self.is_declared
    }

    fn lack_of_fit(&self, _fit: &Fit) -> Option<(String, Score)> {
        None
    }

    fn base_word(&self) -> &'static str {
        "a rigid motion of the frame"
    }

    fn untestable(&self) -> Vec<Untestable> {
        self.untestable.clone()
    }

    fn notes(&self) -> Vec<String> {
        let mut notes = vec![
            format!("Left out to judge: one {} at a time, {} in all.", self.block_word, self.blocks.len()),
            "The 21 errors of a chain are not fitted here: what they leave shows as dependence on position.".to_owned(),
        ];
        if self.quantities.len() > IN_PAIRS {
            let names: Vec<&str> = self.quantities[IN_PAIRS..].iter().map(|quantity| quantity.name.as_str()).collect();
            notes.push(format!("Not tried in pairs, only alone: {}.", names.join(", ")));
        }
        notes
    }
}

const POSITION: [&str; 3] = ["x_m", "y_m", "z_m"];
const TIME: &str = "time_s";

/// Quantities that vary and stand beside every vector; the others with what they lack.
fn quantities(vectors: &[ResidualVector]) -> (Vec<Quantity>, Vec<Untestable>) {
    let (mut quantities, mut untestable) = (Vec::new(), Vec::new());
    let mut add = |name: &str, values: Vec<Option<f64>>| {
        let logged = values.iter().flatten().count();
        if logged == 0 {
            return;
        }
        let whole: Option<Vec<f64>> = values.into_iter().collect();
        let needs = match whole.map(|values| (range(&values), values)) {
            Some((Some(range), values)) => {
                quantities.push(Quantity { name: name.to_owned(), levels: levels(&values), values, range });
                return;
            }
            Some((None, _)) => format!("vary {name}: it is the same at all vectors"),
            None => format!("log {name} at every vector: it stands at {logged} of {}", vectors.len()),
        };
        untestable.push(Untestable { name: format!("dependence on {name}"), needs });
    };
    for axis in Axis::ALL {
        add(POSITION[axis.index()], vectors.iter().map(|v| Some(v.position_m[axis.index()])).collect());
    }
    add(TIME, vectors.iter().map(|vector| vector.time_s).collect());
    let names: BTreeSet<&String> = vectors.iter().flat_map(|vector| vector.covariates.keys()).collect();
    for name in names {
        add(name, vectors.iter().map(|vector| vector.covariates.get(name).copied()).collect());
    }
    (quantities, untestable)
}

fn check(vectors: &[ResidualVector]) -> Result<(), DiagnoseError> {
    if vectors.len() < FEWEST_VECTORS {
        let problem = format!("there are {} residual vectors, at least {FEWEST_VECTORS} are needed", vectors.len());
        return Err(data(problem, "give the residuals of more points"));
    }
    for (k, vector) in vectors.iter().enumerate() {
        let own = vector.position_m.iter().chain(&vector.residual_m).chain(&vector.time_s);
        if !own.chain(vector.covariates.values()).all(|value| value.is_finite()) {
            return Err(data(format!("vector {} holds a figure that is not finite", k + 1), "remove or correct it"));
        }
        if vector.u_m.is_some_and(|u| u.iter().any(|u| !(u.is_finite() && *u > 0.0))) {
            return Err(data(format!("vector {} has an uncertainty that is not above zero", k + 1), "correct it"));
        }
    }
    Ok(())
}

fn data(problem: String, remedy: &str) -> DiagnoseError {
    DiagnoseError::Data { problem, remedy: remedy.to_owned() }
}
