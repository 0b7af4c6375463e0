//! Residual vectors as a study: rows, rigid motion, candidates, blocks.
//!
//! Place in the flow: between shapes, registered effects and the common search. Three whitened rows a vector.

mod columns;
mod proposed;
mod unseen;

use super::angle::{self, Angle};
use super::blocks::blocks;
use super::drift::{Course, Drift, Motion, OF_THE_INSTRUMENT, STANDS_STILL, of_registered, of_shape};
use super::linear::Named;
use super::plate::{Poses, RIGID, data};
use super::quantities::{PLAUSIBLE_M, POSITION, TIME, quantities};
use super::registered::{Nominal, Registered};
use super::shape::{Bent, Quantity, Shape};
use super::step::Steps;
use super::wave::Wave;
use super::{OF, ResidualVector, model, order};
use crate::error::DiagnoseError;
use crate::linear::{in_the_worst_way, joined};
use crate::study::candidate::{Candidate, Chain, Forms, Local, ModelTerm, Open, PoseRows, Question, Study};
use crate::study::outcome::{Ambiguity, Untestable};
use crate::study::series::steps;
use crate::study::smooth::legendre;
use crate::study::step::{NO_PROPERTY, Step};
use crate::study::told::Changed;
use abbe_geometry::Axis;
use abbe_geometry::effects::ShapeValue;
use abbe_geometry::machine::Machine;
use abbe_geometry::seen::TEMPERATURE;
use abbe_geometry::unseen_expansion::UnseenExpansion;
use faer::Mat;
use std::collections::BTreeMap;

/// Assumed where no uncertainty is declared (m); only ratios matter then.
const ASSUMED_M: f64 = 1e-6;
const FEWEST_BLOCKS: usize = 3;
/// Highest degree of the polynomials that single rows are held against.
const RICH: usize = 4;
/// Quantities that are tried in pairs with each other, as the number of pairs grows with the square. With positions and the time all are.
const IN_PAIRS: usize = 16;

/// What no vector tells where none of it was logged.
const NO_TEMPERATURE: &str = "what the machine does as it gets warm, then and later: no temperature was logged; log those of its scales beside each vector";

/// What a candidate is made of.
enum Part {
    Registered(Registered),
    /// An angular error of an axis.
    Angle(Angle),
    /// A wave along an axis, of whatever period.
    Wave(Wave),
    /// A scale or squareness of a plane.
    Named(Named),
    /// One component of the residual, with those parameters of the shape that nothing else names.
    Smooth(Axis, Bent),
    /// One component, from a time on.
    Step(Axis, Step),
    /// What the instrument or the plate does by itself.
    Drift(Drift),
}

/// All vectors.
pub(super) struct Vectors<'a> {
    pub(super) vectors: &'a [ResidualVector],
    pub(super) poses: Poses,
    /// Row of the file of each vector.
    pub(super) rows_of_file: Vec<usize>,
    notes: Vec<String>,
    /// Components that were measured.
    pub(super) measured: [bool; 3],
    /// One a component that was measured.
    chains: Vec<Chain>,
    machine: Option<&'a Machine>,
    /// Of the machine, at each vector; none without one.
    nominal: Vec<Nominal>,
    pub(super) sigma_m: Vec<[f64; 3]>,
    is_declared: bool,
    start_s: f64,
    pub(super) quantities: Vec<Quantity>,
    /// Rows of each block.
    blocks: Vec<Vec<usize>>,
    block_word: &'static str,
    candidates: Vec<Candidate>,
    parts: Vec<Part>,
    steps: Steps,
    untestable: Vec<Untestable>,
    /// What would be the same at all rows.
    hidden: Vec<String>,
    /// What a search is offered.
    forms: Forms,
}

impl<'a> Vectors<'a> {
    pub(super) fn new(
        vectors: &'a [ResidualVector],
        rows_of_file: Vec<usize>,
        mut notes: Vec<String>,
        machine: Option<&'a Machine>,
    ) -> Result<Vectors<'a>, DiagnoseError> {
        let poses = Poses::new(vectors)?;
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
        // A column of zeros was filled in, not measured.
        let lacks = vectors[0].residual_lacks;
        let is_measured =
            |axis: Axis| !lacks[axis.index()] && vectors.iter().any(|vector| vector.residual_m[axis.index()] != 0.0);
        let measured = Axis::ALL.map(is_measured);
        if measured == [false; 3] {
            return Err(data("all residuals are zero".to_owned(), "give the residuals that were measured"));
        }
        for axis in Axis::ALL.into_iter().filter(|axis| !measured[axis.index()]) {
            notes.push(match lacks[axis.index()] {
                true => format!("Component {} was not measured.", axis.lower()),
                false => format!("Component {} is zero in every row: it was taken as not measured.", axis.lower()),
            });
        }
        let components: Vec<usize> = (0..3).filter(|d| measured[*d]).collect();
        let rows = |block: Vec<usize>| {
            block.into_iter().flat_map(|k| components.iter().map(move |d| 3 * k + d)).collect::<Vec<usize>>()
        };
        let mut study = Vectors {
            vectors,
            steps: Steps::new(vectors, &poses),
            poses,
            rows_of_file,
            notes,
            measured,
            chains: Vec::new(),
            machine,
            nominal: machine.map_or_else(Vec::new, |machine| Nominal::at(vectors, machine)),
            sigma_m: vectors.iter().map(sigma).collect(),
            is_declared,
            start_s: vectors.iter().filter_map(|vector| vector.time_s).fold(f64::INFINITY, f64::min),
            quantities,
            blocks: members.into_iter().map(rows).collect(),
            block_word,
            candidates: Vec::new(),
            parts: Vec::new(),
            untestable,
            hidden: Vec::new(),
            forms: Forms::All,
        };
        study.add_registered()?;
        study.add_waves()?;
        study.add_angles();
        study.add_named(false);
        study.add_smooth();
        study.add_steps();
        study.add_drifts();
        study.add_plate_notes();
        study.chains = components.iter().map(|d| study.chain(*d)).collect();
        Ok(study)
    }

    /// One component in order of time, or of the rows; single rows are held against polynomials of every quantity, as
    /// far as there are rows for these.
    fn chain(&self, component: usize) -> Chain {
        let count = self.vectors.len();
        let mut order: Vec<usize> = (0..count).collect();
        let times: Option<Vec<f64>> = self.vectors.iter().map(|vector| vector.time_s).collect();
        if let Some(times) = &times {
            order.sort_by(|a, b| times[*a].total_cmp(&times[*b]));
        }
        let degree = RICH.min(count / 3 / self.quantities.len().max(1));
        let poses = if self.poses.list.len() > 1 { self.poses.list.len() } else { 0 };
        let polynomials = 1 + degree * self.quantities.len();
        let mut rich = Mat::zeros(count, polynomials + RIGID * poses);
        for (i, k) in order.iter().enumerate() {
            let sigma_m = self.sigma_m[*k][component];
            rich[(i, 0)] = 1.0 / sigma_m;
            for (q, quantity) in self.quantities.iter().enumerate() {
                let powers = legendre(quantity.values[*k], quantity.range, degree);
                (1..=degree).for_each(|j| rich[(i, q * degree + j)] = powers[j] / sigma_m);
            }
            if poses > 0 {
                let first = polynomials + RIGID * self.poses.of[*k];
                let own = self.rigid(*k, component);
                own.into_iter().enumerate().for_each(|(j, value)| rich[(i, first + j)] = value / sigma_m);
            }
        }
        let of = format!("component {}", Axis::ALL[component].lower());
        let gaps =
            times.as_ref().map_or_else(|| vec![1.0; count], |times| steps(order.iter().map(|k| times[*k]).collect()));
        let square = self.sigma_m.iter().map(|sigma| sigma[component].powi(2)).sum::<f64>() / count as f64;
        Chain {
            of,
            rows: order.into_iter().map(|k| 3 * k + component).collect(),
            gaps,
            rich,
            unit_m: square.sqrt(),
            along: Some(Axis::ALL[component]),
        }
    }

    /// Offset of the tip (m).
    fn offset_m(&self) -> [f64; 3] {
        self.machine.and_then(|machine| machine.default_offset_m).unwrap_or([0.0; 3])
    }

    /// What a quantity of a model is smaller by: readings lack the offset, times count from the first vector.
    fn less(&self, name: &str) -> f64 {
        let offset_m = |k: usize| self.offset_m()[k];
        POSITION.iter().position(|own| *own == name).map_or(if name == TIME { self.start_s } else { 0.0 }, offset_m)
    }

    fn chain_of(&self, axis: Axis) -> usize {
        (0..axis.index()).filter(|other| self.measured[*other]).count()
    }

    fn time(&self) -> Option<(usize, &Quantity)> {
        self.quantities.iter().enumerate().find(|(_, quantity)| quantity.name == TIME)
    }

    /// What was wrong with the vectors given.
    pub(super) fn given_notes(&self) -> &[String] {
        &self.notes
    }
}

impl Study for Vectors<'_> {
    fn of(&self) -> &'static str {
        OF
    }

    fn candidates(&self) -> &[Candidate] {
        &self.candidates
    }

    fn local(&self, _added: &[(usize, Vec<f64>)]) -> Result<Local, DiagnoseError> {
        let mut base = Mat::zeros(3 * self.vectors.len(), RIGID * self.poses.list.len());
        let mut residual = Vec::with_capacity(3 * self.vectors.len());
        for (k, (vector, sigma_m)) in self.vectors.iter().zip(&self.sigma_m).enumerate() {
            let first = RIGID * self.poses.of[k];
            for d in 0..3 {
                residual.push(vector.residual_m[d] / sigma_m[d]);
                let own = self.rigid(k, d);
                own.into_iter().enumerate().for_each(|(j, value)| base[(3 * k + d, first + j)] = value / sigma_m[d]);
            }
        }
        Ok(Local { residual, base, point: Vec::new() })
    }

    fn columns(&self, _point: &[f64], candidate: usize) -> Mat<f64> {
        self.columns_of(candidate)
    }

    fn chain_columns(&self, candidate: usize, rows: &[usize]) -> Option<(usize, Mat<f64>)> {
        let vectors: Vec<usize> = rows.iter().map(|row| row / 3).collect();
        let (axis, columns) = self.component_columns(candidate, &vectors)?;
        Some((self.chain_of(axis), columns))
    }

    fn frequency(&self, candidate: usize) -> Option<(f64, f64)> {
        let Part::Wave(wave) = &self.parts[candidate] else { return None };
        Some(wave.frequency())
    }

    fn scan(&self, candidate: usize) -> Vec<f64> {
        let Part::Wave(wave) = &self.parts[candidate] else { return Vec::new() };
        wave.scan()
    }

    fn columns_at(&self, candidate: usize, frequency: f64, rows: &[usize]) -> Mat<f64> {
        let Part::Wave(wave) = &self.parts[candidate] else { return Mat::zeros(0, 0) };
        let vectors: Vec<usize> = rows.iter().map(|row| row / 3).collect();
        self.wave_columns(wave, frequency, &vectors)
    }

    fn set_frequency(&mut self, candidate: usize, frequency: f64) {
        if let Part::Wave(wave) = &mut self.parts[candidate] {
            wave.set(frequency);
            self.candidates[candidate] = wave.candidate();
        }
    }

    fn reset(&mut self) {
        for (part, candidate) in self.parts.iter_mut().zip(&mut self.candidates) {
            if let Part::Wave(wave) = part {
                wave.reset();
                *candidate = wave.candidate();
            }
        }
    }

    fn steps_after(&self, candidate: usize) -> Vec<usize> {
        let Part::Step(_, step) = &self.parts[candidate] else { return Vec::new() };
        step.before()
    }

    fn places(&self, candidate: usize) -> &[usize] {
        let Part::Step(_, step) = &self.parts[candidate] else { return &[] };
        self.steps.places.of(step)
    }

    fn choices(&self, candidate: usize, places: &[usize]) -> f64 {
        match &self.parts[candidate] {
            Part::Wave(wave) => wave.count() as f64,
            _ if self.places(candidate).is_empty() => 1.0,
            _ => self.steps.places.tried(places),
        }
    }

    fn columns_from(&self, candidate: usize, places: &[usize], rows: &[usize]) -> Mat<f64> {
        let Part::Step(axis, _) = &self.parts[candidate] else { return Mat::zeros(rows.len(), 1) };
        let vectors: Vec<usize> = rows.iter().map(|row| row / 3).collect();
        self.step_columns(*axis, &self.steps.places.steps(places), &vectors)
    }

    fn set_places(&mut self, candidate: usize, places: &[usize]) {
        if let Part::Step(axis, step) = &mut self.parts[candidate] {
            *step = self.steps.places.steps(places);
            self.candidates[candidate] = self.steps.candidate(step, *axis, &self.rows_of_file);
        }
    }

    /// Beside an effect of position alone: what each axis does by itself, which is straightness, positioning, squareness and turns, and what it
    /// does in the course of time, which is a position where one was gone through after the other.
    fn simpler(&self, candidate: usize) -> Mat<f64> {
        match &self.parts[candidate] {
            Part::Registered(registered) if registered.is_of_position() => {
                let moved = self.moved(candidate);
                let time = order::of_the_time(&self.quantities, &moved, &self.sigma_m);
                // In a plane no arm differs that another form of both positions would not hold.
                if self.poses.axes().len() < Axis::ALL.len() {
                    let both = order::of_position(&self.quantities, &moved, &self.sigma_m);
                    return joined(&[both, time]);
                }
                let each = order::of_each_position(&self.quantities, &moved, &self.sigma_m);
                let rest = (moved.len() * self.vectors.len() / 3).saturating_sub(each.ncols() + time.ncols());
                let angles = angle::beside((&self.quantities, &self.nominal, self.measured), &self.sigma_m, rest);
                joined(&[each, angles, time])
            }
            _ => Mat::zeros(0, 0),
        }
    }

    fn position_beside(&self, candidate: usize) -> Mat<f64> {
        match self.passes(candidate) {
            true => order::of_position(&self.quantities, &self.moved(candidate), &self.sigma_m),
            false => Mat::zeros(0, 0),
        }
    }

    fn passes(&self, candidate: usize) -> bool {
        self.candidates[candidate].covariates.iter().any(|name| order::passes(name))
    }

    fn instrument_beside(&self, candidate: usize) -> Mat<f64> {
        let Some((time, time_s)) = self.time() else { return Mat::zeros(0, 0) };
        let courses: Vec<Course> = match &self.parts[candidate] {
            Part::Smooth(_, bent) => of_shape(bent.shape, time),
            Part::Registered(own) if own.candidate.covariates.iter().any(|name| name == TIME) => {
                of_registered(&own.shape)
            }
            _ => return Mat::zeros(0, 0),
        };
        let functions: Vec<Vec<f64>> = courses.into_iter().flat_map(|course| course.functions(time_s)).collect();
        let moving = self.drift_columns(&Motion::all().collect::<Vec<Motion>>(), &functions);
        // A growth from nothing has a mean, and the constant scale of a plate is not the machine's.
        let still = if self.poses.is_plate() { vec![vec![1.0; self.vectors.len()]] } else { Vec::new() };
        joined(&[moving, self.drift_columns(&[Motion::Scale], &still)])
    }

    fn grows(&self, candidate: usize, with: usize) -> bool {
        let Part::Named(Named::Scale(axis)) = &self.parts[candidate] else { return false };
        match &self.parts[with] {
            Part::Smooth(own, _) => {
                own == axis && self.candidates[with].covariates.iter().any(|name| POSITION[axis.index()] == name)
            }
            Part::Registered(own) => own.shape.0.get("axis") == Some(&ShapeValue::Text(axis.lower().to_owned())),
            Part::Drift(drift) => drift.motion == Motion::Scale,
            Part::Wave(wave) => wave.axis == *axis,
            Part::Angle(_) | Part::Named(_) | Part::Step(..) => false,
        }
    }

    fn offer(&mut self, forms: Forms) -> bool {
        self.forms = forms;
        (0..self.candidates.len()).any(|k| !self.is_of_forms(k))
    }

    fn is_offered(&self, candidate: usize) -> bool {
        self.is_next(candidate) && self.is_of_forms(candidate)
    }

    fn is_line(&self, candidate: usize) -> bool {
        matches!(&self.parts[candidate], Part::Smooth(_, bent) if bent.shape.is_straight() && bent.kept.len() == 1)
    }

    fn is_of_instrument(&self, candidate: usize) -> bool {
        match &self.parts[candidate] {
            Part::Drift(_) => true,
            Part::Smooth(_, bent) => {
                matches!(bent.shape, Shape::One { quantity, .. } if self.quantities[quantity].name == TIME)
            }
            Part::Registered(_) | Part::Wave(_) | Part::Angle(_) | Part::Named(_) | Part::Step(..) => false,
        }
    }

    fn instrument_words(&self) -> (&'static str, &'static str) {
        match self.poses.is_plate() {
            true => ("a plate that warms, or an instrument that drifts,", STANDS_STILL),
            false => ("an instrument whose frame or scale drifts", STANDS_STILL),
        }
    }

    /// A scale of the machine, while that of the instrument or the plate changed.
    fn changed_by_instrument(&self, candidate: usize, found: &[(usize, Vec<f64>)]) -> Option<Changed> {
        let (Part::Named(Named::Scale(_)), Some((_, time_s))) = (&self.parts[candidate], self.time()) else {
            return None;
        };
        let reach = |(by, values): &(usize, Vec<f64>)| {
            let Part::Drift(Drift { motion: Motion::Scale, course }) = &self.parts[*by] else { return None };
            let functions = course.functions(time_s);
            let at = |k: usize| functions.iter().zip(values).map(|(own, value)| own[k] * value).sum::<f64>();
            // Courses have no mean: what is farthest from it may be what the machine has.
            let farthest = (0..self.vectors.len()).map(|k| at(k).abs()).fold(0.0, f64::max);
            Some(Changed { by: *by, reach: vec![farthest] })
        };
        found.iter().find_map(reach)
    }

    fn chains(&self) -> &[Chain] {
        &self.chains
    }

    fn is_measured(&self, row: usize) -> bool {
        self.measured[row % 3]
    }

    /// What the calibration of the plate leaves open if its errors act together in the worst way.
    fn u_beside(&self, candidate: usize) -> Vec<f64> {
        let columns = self.columns(&[], candidate);
        let rows: Vec<usize> = (0..columns.nrows()).filter(|row| self.measured[row % 3]).collect();
        let u_m = |row: usize| self.vectors[row / 3].u_plate_m.unwrap_or(0.0);
        let of_row = |row: usize, j: usize| (columns[(row, j)] * self.row_unit_m(row), u_m(row));
        (0..columns.ncols()).map(|j| in_the_worst_way(rows.iter().map(|row| of_row(*row, j)))).collect()
    }

    fn row_unit_m(&self, row: usize) -> f64 {
        self.sigma_m[row / 3][row % 3]
    }

    fn model_terms(&self, candidate: usize) -> Result<Vec<ModelTerm>, String> {
        if let Some(axis) = self.lacking_axis() {
            return Err(format!("where the plane lies along {} is unknown; give its positions", axis.letter()));
        }
        let term = match &self.parts[candidate] {
            Part::Named(named) => named.term(|axis| self.model_range(POSITION[axis.index()]).unwrap_or((0.0, 1.0)))?,
            Part::Smooth(axis, bent) => {
                let less = |own: &Quantity| self.less(&own.name);
                ModelTerm { map: bent.map(), ..model::term(*axis, bent.shape, &self.quantities, less) }
            }
            Part::Angle(angle) => {
                return Ok(angle.terms(self.model_range(POSITION[angle.axis.index()]).unwrap_or((0.0, 1.0))));
            }
            Part::Step(..) => return Err(NO_PROPERTY.to_owned()),
            Part::Drift(_) => return Err(OF_THE_INSTRUMENT.to_owned()),
            Part::Wave(wave) => wave.term(),
            Part::Registered(own) => {
                let count = self.candidates[candidate].parameters.len();
                let map = Mat::identity(count, count);
                ModelTerm { effect: own.effect.name(), shape: own.shape.clone(), map, table: None }
            }
        };
        Ok(std::iter::once(term).chain(self.alias(candidate)).collect())
    }

    fn model_covariates(&self, candidate: usize) -> Vec<String> {
        let logged = self.candidates[candidate].covariates.iter();
        logged.filter(|name| !POSITION.contains(&name.as_str())).cloned().collect()
    }

    fn logged_rows(&self) -> Vec<&BTreeMap<String, f64>> {
        self.vectors.iter().map(|vector| &vector.covariates).collect()
    }

    fn unseen_expansions(&self, open: &Open) -> Vec<UnseenExpansion> {
        self.unseen(open)
    }

    fn unseen_columns(&self, unseen: &[UnseenExpansion]) -> Mat<f64> {
        self.columns_of_unseen(unseen)
    }

    fn model_range(&self, name: &str) -> Option<(f64, f64)> {
        let quantity = self.quantities.iter().find(|quantity| quantity.name == name)?;
        let less = self.less(name);
        Some((quantity.range.0 - less, quantity.range.1 - less))
    }

    fn readings_m(&self) -> [Option<(f64, f64)>; 3] {
        let offset_m = self.offset_m();
        [0, 1, 2].map(|d| {
            if self.vectors[0].position_lacks[d] {
                return None;
            }
            let along = || self.vectors.iter().map(|vector| vector.position_m[d] - offset_m[d]);
            Some((along().reduce(f64::min)?, along().reduce(f64::max)?))
        })
    }

    fn given(&self, row: usize) -> Option<(usize, usize)> {
        Some((self.rows_of_file[row / 3], row % 3))
    }

    fn row_name(&self, row: usize) -> String {
        format!("vector {} (component {})", self.rows_of_file[row / 3] + 1, Axis::ALL[row % 3].lower())
    }

    fn questions(&self) -> Vec<Question> {
        let with = |name: &str| -> Vec<usize> {
            let has = |k: &usize| self.candidates[*k].covariates.iter().any(|own| own == name);
            (0..self.candidates.len()).filter(has).collect()
        };
        let directions = self.quantities.iter().filter(|quantity| quantity.name.starts_with("dir_"));
        let of_sign = directions.flat_map(|quantity| with(&quantity.name)).collect();
        let question = |what: &str, candidates| Question { what: what.to_owned(), candidates };
        vec![question("drift or step in time", with(TIME)), question("direction of approach", of_sign)]
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
        let measured: Vec<usize> = (0..3).filter(|d| self.measured[*d]).collect();
        let own = |sigma_m: &[f64; 3]| measured.iter().map(|d| sigma_m[*d].powi(-2)).sum::<f64>();
        let weights: f64 = self.sigma_m.iter().map(own).sum();
        (weights / (measured.len() * self.sigma_m.len()) as f64).sqrt().recip()
    }

    fn is_declared(&self) -> bool {
        self.is_declared
    }

    fn base_word(&self) -> &'static str {
        if self.poses.list.len() > 1 { "a rigid motion of each pose" } else { "a rigid motion of the frame" }
    }

    fn untestable(&self) -> Vec<Untestable> {
        self.untestable.clone()
    }

    /// Waves on a grid.
    fn ambiguities(&self, found: &[usize]) -> Vec<Ambiguity> {
        let is_wave = |k: &&usize| self.alias(**k).is_some();
        let one = |k: &usize| Ambiguity {
            effects: vec![self.candidates[*k].name.clone()],
            because: "the positions lie on a grid: waves of other periods give the same errors on it".to_owned(),
            decided_by: self.candidates[*k].decided_by.clone(),
        };
        found.iter().filter(is_wave).map(one).collect()
    }

    fn notes(&self) -> Vec<String> {
        self.told()
    }

    fn hidden(&self) -> Vec<String> {
        let is_logged = |vector: &ResidualVector| vector.covariates.keys().any(|name| name.ends_with(TEMPERATURE));
        let lacks = self.machine.is_some() && !self.vectors.iter().any(is_logged);
        self.hidden.iter().cloned().chain(lacks.then(|| NO_TEMPERATURE.to_owned())).collect()
    }

    fn poses(&self) -> Vec<PoseRows> {
        self.poses.rows()
    }
}
