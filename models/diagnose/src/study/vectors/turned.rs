//! A plate that was turned: what differs between its poses, from which its own form has gone.
//!
//! Place in the flow: stands before the study of vectors where the points of a plate are named and it was turned. With
//! r_p the residuals of one point in its poses, R_p the turn of the plate and d the plate's own error there,
//! R_pᵀ r_p = R_pᵀ e(x_p) − d + noise: orthonormal contrasts over the poses (Helmert) hold no d, and white noise stays
//! white. Rows are these contrasts, three a contrast, in the frame of the first pose. Every contrast is blind to fields that
//! turn with the plate: its scale, so that the study names the difference of the axes' scales, and others ([`blind`]).
//! Source: Raugh 1985, Precision Engineering 7(1), 3-13 (self-calibration by turned artefacts).

mod blind;

use super::ResidualVector;
use super::blocks::blocks;
use super::plate::{Turns, data};
use super::problem::Vectors;
use super::quantities::POSITION;
use crate::error::DiagnoseError;
use crate::score::LEFT;
use crate::study::candidate::{Candidate, Chain, Local, ModelTerm, Open, Question, Study, Untold};
use crate::study::combinations::combinations;
use crate::study::outcome::Untestable;
use crate::study::smooth::{legendre, range};
use abbe_geometry::{Axis, Matrix3, Vector3};
use faer::Mat;
use std::collections::{BTreeMap, BTreeSet};

const FEWEST_CONTRASTS: usize = 12;
const FEWEST_BLOCKS: usize = 3;
/// Highest total degree of the polynomials that single rows are held against.
const RICH: usize = 3;

/// One combination of the poses of one point.
struct Contrast {
    point: String,
    /// Vector, its factor, and the turn of the plate there.
    parts: Vec<(usize, f64, Matrix3<f64>)>,
    /// Standard uncertainty of each component (m).
    sigma_m: [f64; 3],
    /// Number among the contrasts of the point.
    order: usize,
}

/// All of them.
pub(super) struct Contrasts {
    list: Vec<Contrast>,
    plane: (usize, usize),
}

/// The contrasts of a plate that was turned; nothing where its own form cannot be told.
pub(super) fn contrasts(study: &Vectors) -> Result<Option<Contrasts>, DiagnoseError> {
    let Some(Turns { points, turns, plane }) = study.poses.turns(study.vectors)? else { return Ok(None) };
    if !(study.measured[plane.0] && study.measured[plane.1]) {
        let problem = "a plate that was turned needs both components in its plane".to_owned();
        return Err(data(problem, "measure both, or leave the column point out"));
    }
    let mut list = Vec::new();
    for (point, members) in points {
        for order in 1..members.len() {
            let root = ((order * (order + 1)) as f64).sqrt();
            let factor = |place: usize| if place < order { root.recip() } else { -(order as f64) / root };
            let part = |place: usize| {
                let k = members[place];
                (k, factor(place), turns[study.poses.of[k]])
            };
            let parts: Vec<_> = (0..=order).map(part).collect();
            let variance = |c: usize| -> f64 {
                let one = |(k, factor, turn): &(usize, f64, Matrix3<f64>)| {
                    (0..3).map(|d| (factor * turn[(d, c)] * study.sigma_m[*k][d]).powi(2)).sum::<f64>()
                };
                parts.iter().map(one).sum()
            };
            let sigma_m = [0, 1, 2].map(|c| variance(c).sqrt());
            list.push(Contrast { point: point.clone(), parts, sigma_m, order });
        }
    }
    if list.len() < FEWEST_CONTRASTS {
        let problem = format!("{} points stand in two poses, at least {FEWEST_CONTRASTS} are needed", list.len());
        return Err(data(problem, "measure more points of the plate in every pose, or leave the column point out"));
    }
    list.sort_by_key(|contrast| contrast.parts[0].0);
    Ok(Some(Contrasts { list, plane }))
}

/// The study of what differs between poses.
pub(super) struct Turned<'a> {
    inner: Vectors<'a>,
    list: Vec<Contrast>,
    plane: (usize, usize),
    blocks: Vec<Vec<usize>>,
    block_word: String,
    chains: Vec<Chain>,
}

impl<'a> Turned<'a> {
    pub(super) fn new(mut inner: Vectors<'a>, contrasts: Contrasts) -> Result<Turned<'a>, DiagnoseError> {
        inner.with_unknown_scale();
        let Contrasts { list, plane } = contrasts;
        let first = |contrast: &Contrast| {
            let vector = &inner.vectors[contrast.parts[0].0];
            let (position_m, block) = (vector.position_m, vector.block.clone());
            ResidualVector { position_m, block, ..ResidualVector::default() }
        };
        let places: Vec<ResidualVector> = list.iter().map(first).collect();
        let (members, word) = blocks(&places);
        if members.len() < FEWEST_BLOCKS {
            let problem = format!("the points come in {} blocks, at least {FEWEST_BLOCKS} are needed", members.len());
            return Err(data(problem, "name further blocks in the column block, or leave that column out"));
        }
        let measured: Vec<usize> = (0..3).filter(|d| inner.measured[*d]).collect();
        let rows =
            |block: Vec<usize>| block.into_iter().flat_map(|c| measured.iter().map(move |d| 3 * c + d)).collect();
        let blocks = members.into_iter().map(rows).collect();
        let mut turned =
            Turned { inner, list, plane, blocks, block_word: format!("{word} on the plate"), chains: Vec::new() };
        turned.chains = measured.iter().map(|d| turned.chain(*d, &places, plane)).collect::<Result<_, _>>()?;
        Ok(turned)
    }

    fn chain(
        &self,
        component: usize,
        places: &[ResidualVector],
        (a, b): (usize, usize),
    ) -> Result<Chain, DiagnoseError> {
        let count = self.list.len();
        let along = |d: usize| -> Vec<f64> { places.iter().map(|place| place.position_m[d]).collect() };
        let ranges = [a, b].map(|d| (along(d), range(&along(d))));
        let orders = self.list.iter().map(|contrast| contrast.order).max().unwrap_or(1);
        let terms: Vec<(usize, usize)> =
            (0..=RICH).flat_map(|total| (0..=total).map(move |j| (total - j, j))).collect();
        let terms = if 3 * terms.len() * orders <= count { terms } else { vec![(0, 0), (1, 0), (0, 1)] };
        let base = self.base(&self.inner.local(&[])?.base);
        let mut rich = Mat::zeros(count, terms.len() * orders + base.ncols());
        for (c, contrast) in self.list.iter().enumerate() {
            let powers = ranges.each_ref().map(|(values, range)| match range {
                Some(range) => legendre(values[c], *range, RICH),
                None => vec![1.0; RICH + 1],
            });
            let first = terms.len() * (contrast.order - 1);
            for (j, (p, q)) in terms.iter().enumerate() {
                rich[(c, first + j)] = powers[0][*p] * powers[1][*q] / contrast.sigma_m[component];
            }
            let first = terms.len() * orders;
            (0..base.ncols()).for_each(|j| rich[(c, first + j)] = base[(3 * c + component, j)]);
        }
        let square = self.list.iter().map(|contrast| contrast.sigma_m[component].powi(2)).sum::<f64>() / count as f64;
        let axis = Axis::ALL[component];
        Ok(Chain {
            of: format!("component {} on the plate", axis.lower()),
            rows: (0..count).map(|c| 3 * c + component).collect(),
            gaps: vec![1.0; count],
            rich,
            unit_m: square.sqrt(),
            along: Some(axis),
        })
    }

    /// Rigid motions of the poses as rows of contrasts, as far as these see them. A motion that is the same in all poses moves the plate, and
    /// goes: what is left of it comes of points that stopped elsewhere, which is the machine's error itself, and must not be fitted.
    fn base(&self, before: &Mat<f64>) -> Mat<f64> {
        let turned = self.turned(before);
        let (left, alone) = (turned.transpose() * &turned, before.transpose() * before);
        &turned * combinations(&left, &alone, LEFT)
    }

    fn plane(&self) -> [Axis; 2] {
        [Axis::ALL[self.plane.0], Axis::ALL[self.plane.1]]
    }

    /// Rows of vectors as rows of contrasts.
    fn turned(&self, rows: &Mat<f64>) -> Mat<f64> {
        let mut turned = Mat::zeros(3 * self.list.len(), rows.ncols());
        for (c, contrast) in self.list.iter().enumerate() {
            for (k, factor, turn) in &contrast.parts {
                let sigma_m = self.inner.sigma_m[*k];
                for j in 0..rows.ncols() {
                    let own = Vector3::from_fn(|d, _| rows[(3 * k + d, j)] * sigma_m[d]);
                    let own = turn.transpose() * own * *factor;
                    (0..3).for_each(|d| turned[(3 * c + d, j)] += own[d] / contrast.sigma_m[d]);
                }
            }
        }
        turned
    }
}

impl Study for Turned<'_> {
    fn of(&self) -> &'static str {
        "residual vectors of a turned plate"
    }

    fn candidates(&self) -> &[Candidate] {
        self.inner.candidates()
    }

    fn local(&self, added: &[(usize, Vec<f64>)]) -> Result<Local, DiagnoseError> {
        let local = self.inner.local(added)?;
        let residual = Mat::from_fn(local.residual.len(), 1, |i, _| local.residual[i]);
        let residual = self.turned(&residual);
        let residual = (0..residual.nrows()).map(|i| residual[(i, 0)]).collect();
        Ok(Local { residual, base: self.base(&local.base), point: local.point })
    }

    fn columns(&self, point: &[f64], candidate: usize) -> Mat<f64> {
        let before = self.inner.columns(point, candidate);
        let mut columns = self.turned(&before);
        // What the turns leave so little of is a part of the plate's form but for where it stopped.
        for j in 0..columns.ncols() {
            if columns.col(j).squared_norm_l2() < LEFT * before.col(j).squared_norm_l2() {
                columns.col_mut(j).fill(0.0);
            }
        }
        columns
    }

    fn simpler(&self, candidate: usize) -> Mat<f64> {
        let simpler = self.inner.simpler(candidate);
        if simpler.ncols() == 0 { simpler } else { self.turned(&simpler) }
    }

    fn passes(&self, candidate: usize) -> bool {
        self.inner.passes(candidate)
    }

    fn instrument_beside(&self, candidate: usize) -> Mat<f64> {
        let beside = self.inner.instrument_beside(candidate);
        if beside.ncols() == 0 { beside } else { self.turned(&beside) }
    }

    fn is_of_instrument(&self, candidate: usize) -> bool {
        self.inner.is_of_instrument(candidate)
    }

    fn instrument_words(&self) -> (&'static str, &'static str) {
        self.inner.instrument_words()
    }

    fn chains(&self) -> &[Chain] {
        &self.chains
    }

    fn is_measured(&self, row: usize) -> bool {
        self.inner.measured[row % 3]
    }

    fn row_unit_m(&self, row: usize) -> f64 {
        self.list[row / 3].sigma_m[row % 3]
    }

    fn row_name(&self, row: usize) -> String {
        let contrast = &self.list[row / 3];
        let rows: Vec<String> =
            contrast.parts.iter().map(|(k, ..)| (self.inner.rows_of_file[*k] + 1).to_string()).collect();
        let component = Axis::ALL[row % 3].lower();
        format!("point {}, vectors {} (component {component})", contrast.point, rows.join(" and "))
    }

    fn questions(&self) -> Vec<Question> {
        self.inner.questions()
    }

    fn blocks(&self) -> &[Vec<usize>] {
        &self.blocks
    }

    fn block_word(&self) -> &str {
        &self.block_word
    }

    fn rows_per_point(&self) -> usize {
        3
    }

    fn unit_m(&self) -> f64 {
        let rows: Vec<usize> = (0..3 * self.list.len()).filter(|row| self.is_measured(*row)).collect();
        let weights: f64 = rows.iter().map(|row| self.row_unit_m(*row).powi(-2)).sum();
        (weights / rows.len() as f64).sqrt().recip()
    }

    fn is_declared(&self) -> bool {
        self.inner.is_declared()
    }

    fn base_word(&self) -> &'static str {
        "the form of the plate, and a rigid motion of each pose,"
    }

    fn model_terms(&self, candidate: usize) -> Result<Vec<ModelTerm>, String> {
        self.inner.model_terms(candidate)
    }

    fn model_covariates(&self, candidate: usize) -> Vec<String> {
        self.inner.model_covariates(candidate)
    }

    fn logged_rows(&self) -> Vec<&BTreeMap<String, f64>> {
        self.inner.logged_rows()
    }

    fn model_range(&self, name: &str) -> Option<(f64, f64)> {
        self.inner.model_range(name)
    }

    fn readings_m(&self) -> [Option<(f64, f64)>; 3] {
        self.inner.readings_m()
    }

    fn hidden(&self) -> Vec<String> {
        let axes: Vec<String> = self.inner.poses.axes().iter().map(|axis| axis.letter().to_string()).collect();
        let scale = format!(
            "a scale that {} have in common: the plate's own scale is one of the unknowns, and a calibrated length tells it",
            axes.join(" and ")
        );
        let cubic = self.hides_a_common_cubic().then(|| {
            format!(
                "any other error that turns with the plate, such as one cubic that {} have in common: the plate moved by a part of its \
                 length in a further pose, or a calibrated line along each axis, tells it",
                axes.join(" and ")
            )
        });
        self.inner.hidden().into_iter().chain([scale]).chain(cubic).collect()
    }

    fn untold(&self, open: &Open) -> Vec<Untold> {
        self.untold_of_turns(open)
    }

    fn untestable(&self) -> Vec<Untestable> {
        self.inner.untestable()
    }

    fn notes(&self) -> Vec<String> {
        let points: BTreeSet<&str> = self.list.iter().map(|contrast| contrast.point.as_str()).collect();
        let quantities: Vec<&str> = self.inner.quantities.iter().map(|quantity| quantity.name.as_str()).collect();
        let logged: Vec<&str> = quantities.into_iter().filter(|name| !POSITION.contains(name)).collect();
        let mut notes = vec![
            format!("Left out to judge: one {} at a time, {} in all.", self.block_word, self.blocks.len()),
            format!(
                "The plate was turned, and {} of its points stand in several poses: only what differs between poses was used, \
                 and the plate's own form has gone from it.",
                points.len()
            ),
        ];
        if !logged.is_empty() {
            notes.push(format!("Logged beside: {}.", logged.join(", ")));
        }
        notes.extend(self.inner.given_notes().iter().cloned());
        notes
    }
}
