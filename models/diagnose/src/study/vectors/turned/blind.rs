//! Fields that no turn of a plate shows, beside its scale.
//!
//! Place in the flow: called once effects are found. Contrasts are blind to every field with e(R p) = R e(p): at 0 and 90 degrees about one middle
//! that is a common scale, and as well one cubic that X and Y have in common. Seen is their difference alone; which axis it belongs to is not,
//! and what is found on the one may be the other's. So both axes get, beside what was found, terms of zero value and of its size.

use super::Turned;
use crate::score::LEFT;
use crate::study::candidate::{ModelTerm, Open, Study, Untold};
use crate::study::series::{independent, left_by};
use abbe_geometry::Axis;
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};

/// Degree of the lowest smooth field that turns with a square plate, beside its scale.
const CUBIC: usize = 3;
/// Share of the largest square that keeps columns which hold nothing, or depend on others, at little.
const RIDGE: f64 = 1e-9;

/// A candidate of another component that leaves nothing of parts of one found: those, and combinations of its parameters that do.
struct Twin {
    candidate: usize,
    parts: Vec<(usize, Vec<f64>)>,
}

impl Turned<'_> {
    /// What the turns do not tell of effects found, with their sizes.
    pub(super) fn untold_of_turns(&self, open: &Open) -> Vec<Untold> {
        let Ok(local) = self.local(&[]) else { return Vec::new() };
        let base = independent(&local.base);
        let smooth: Vec<(usize, Axis)> =
            (0..self.candidates().len()).filter_map(|k| Some((k, self.inner.smooth_on(k)?))).collect();
        let mut all = Vec::new();
        for (found, axis) in smooth.iter().filter(|(k, _)| open.found.contains(k)) {
            let own = left_by(&base, &self.columns(&local.point, *found));
            let mut others: Vec<usize> = smooth.iter().filter(|(_, other)| other != axis).map(|(k, _)| *k).collect();
            others.sort_by_key(|k| self.candidates()[*k].parameters.len());
            let twin = |k: usize| twin(&own, k, &left_by(&base, &self.columns(&local.point, k)));
            let Some(twin) = others.into_iter().find_map(twin) else { continue };
            let values = (open.values)(*found);
            let mut sizes = vec![0.0; values.len()];
            let mut of_twin = vec![0.0_f64; self.candidates()[twin.candidate].parameters.len()];
            for (part, made_of) in &twin.parts {
                sizes[*part] = values[*part].abs();
                of_twin.iter_mut().zip(made_of).for_each(|(u, factor)| *u = u.hypot(factor * values[*part]));
            }
            let names = [*found, twin.candidate].map(|k| self.candidates()[k].name.clone());
            let what = format!(
                "whether it is \"{}\" or \"{}\", of which a turned plate shows the difference alone",
                names[0], names[1]
            );
            all.extend(self.untold_of(*found, &sizes, &what));
            all.extend(
                self.untold_of(twin.candidate, &of_twin, &what)
                    .into_iter()
                    .map(|own| Untold { is_usual: false, ..own }),
            );
        }
        all
    }

    /// A candidate as terms of zero value, its parameters known to these sizes.
    fn untold_of(&self, candidate: usize, sizes: &[f64], what: &str) -> Vec<Untold> {
        let terms = self.inner.model_terms(candidate).unwrap_or_default();
        let one = |mut term: ModelTerm| {
            let map = std::mem::replace(&mut term.map, Mat::zeros(0, 0));
            let u = |row: usize| (0..map.ncols()).map(|k| (map[(row, k)] * sizes[k]).powi(2)).sum::<f64>().sqrt();
            let u: Vec<f64> = (0..map.nrows()).map(u).collect();
            term.map = Mat::zeros(u.len(), 0);
            Untold { what: what.to_owned(), is_usual: true, term, u, reads: None }
        };
        terms.into_iter().map(one).collect()
    }

    /// Whether a cubic that both axes of the plane have in common leaves nothing in the contrasts.
    pub(super) fn hides_a_common_cubic(&self) -> bool {
        let quantity = |axis: Axis| self.inner.position(axis).filter(|own| own.levels > CUBIC);
        let [Some(a), Some(b)] = self.plane().map(quantity) else { return false };
        let mut fields = Mat::zeros(3 * self.inner.vectors.len(), 2);
        for (j, (axis, quantity)) in self.plane().into_iter().zip([a, b]).enumerate() {
            for (k, sigma_m) in self.inner.sigma_m.iter().enumerate() {
                fields[(3 * k + axis.index(), j)] = quantity.powers[CUBIC][k] / sigma_m[axis.index()];
            }
        }
        let Ok(local) = self.local(&[]) else { return false };
        let left = left_by(&independent(&local.base), &self.turned(&fields));
        let [one, other] = [0, 1].map(|j| left.subcols(j, 1).to_owned());
        twin(&one, 0, &other).is_some()
    }
}

/// The parts of a candidate, beside the base, of which another's columns leave nothing; `None` where there are none.
fn twin(own: &Mat<f64>, candidate: usize, other: &Mat<f64>) -> Option<Twin> {
    let mut parts = Vec::new();
    for part in 0..own.ncols() {
        let column = own.subcols(part, 1).to_owned();
        let square = column.squared_norm_l2();
        if square > 0.0 && left_by(other, &column).squared_norm_l2() < LEFT * square {
            parts.push((part, solved(other, &column)?));
        }
    }
    (!parts.is_empty()).then_some(Twin { candidate, parts })
}

/// The least combination of columns that is nearest to another; `None` where they hold nothing.
fn solved(columns: &Mat<f64>, wanted: &Mat<f64>) -> Option<Vec<f64>> {
    let mut gram = columns.transpose() * columns;
    let most = (0..gram.nrows()).map(|k| gram[(k, k)]).fold(0.0, f64::max);
    (0..gram.nrows()).for_each(|k| gram[(k, k)] += RIDGE * most);
    let factor = Llt::new(gram.as_ref(), Side::Lower).ok()?;
    let solved = factor.solve(columns.transpose() * wanted);
    Some((0..columns.ncols()).map(|k| solved[(k, 0)]).collect())
}
