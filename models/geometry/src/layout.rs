//! Which parameter stands where in the vector that identification estimates and the model stores.
//!
//! Place in the flow: shared by identification, covariance, correction and the model file. Order: coefficients
//! of the 18 error functions in [`ErrorId::index`] order, the three squareness angles, effect parameters;
//! after these, outside this layout, four for each station (x, y, z, dead path).

use crate::axis::ErrorId;
use crate::chain::{ChainPoint, ErrorValues, chain_point};
use crate::error_function::{Basis, LocalBasis};
use crate::machine::{Machine, MachineError};
use nalgebra::Vector3;
use std::ops::Range;

/// Bases and positions of all machine parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    bases: Vec<Option<Basis>>,
    ranges: Vec<Range<usize>>,
    /// First function of the same axis with the same basis: most share one, which is then evaluated once.
    first_alike: Vec<usize>,
    squareness: usize,
}

/// One chain evaluation with what is needed to spread its partials over the coefficients.
#[derive(Debug, Clone)]
pub struct ModelPoint {
    /// Position and partials by error value.
    pub chain: ChainPoint,
    locals: [Option<LocalBasis>; ErrorId::COUNT],
}

impl Layout {
    /// Layout of the machine's error functions.
    pub fn new(machine: &Machine) -> Result<Layout, MachineError> {
        machine.validate()?;
        let bases = ErrorId::all().map(|id| machine.basis(id)).collect::<Result<Vec<_>, _>>()?;
        let mut next = 0;
        let ranges = bases
            .iter()
            .map(|basis| {
                let first = next;
                next += basis.map_or(0, |b| b.len());
                first..next
            })
            .collect();
        let alike =
            |id: ErrorId, other: ErrorId| other.axis() == id.axis() && bases[other.index()] == bases[id.index()];
        let first_alike =
            ErrorId::all().map(|id| ErrorId::all().find(|other| alike(id, *other)).unwrap_or(id).index()).collect();
        Ok(Layout { bases, ranges, first_alike, squareness: next })
    }

    /// Coefficients of one error function.
    pub fn range(&self, id: ErrorId) -> Range<usize> {
        self.ranges[id.index()].clone()
    }

    /// Basis of one error function, `None` where it is held at zero.
    pub fn basis(&self, id: ErrorId) -> Option<&Basis> {
        self.bases[id.index()].as_ref()
    }

    /// The three squareness angles.
    pub fn squareness(&self) -> Range<usize> {
        self.squareness..self.squareness + 3
    }

    /// Number of geometric parameters (errors and squareness).
    pub fn len(&self) -> usize {
        self.squareness + 3
    }

    /// Never: there are always three squareness angles.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Value of one error at an axis position (m or rad).
    pub fn error_value(&self, id: ErrorId, coefficients: &[f64], position_m: f64) -> f64 {
        self.bases[id.index()].map_or(0.0, |basis| basis.at(position_m).dot(&coefficients[self.range(id)]))
    }

    /// Actual position with partials, from the geometric coefficients.
    pub fn point(
        &self,
        machine: &Machine,
        coefficients: &[f64],
        reading_m: [f64; 3],
        offset_m: [f64; 3],
    ) -> ModelPoint {
        let mut locals = [None; ErrorId::COUNT];
        let mut values = ErrorValues::ZERO;
        for id in ErrorId::all() {
            if let Some(basis) = &self.bases[id.index()] {
                let local = match locals[self.first_alike[id.index()]] {
                    Some(local) => local,
                    None => basis.at(reading_m[id.axis().index()]),
                };
                values.errors[id.index()] = local.dot(&coefficients[self.range(id)]);
                locals[id.index()] = Some(local);
            }
        }
        values.squareness.copy_from_slice(&coefficients[self.squareness()]);
        ModelPoint { chain: chain_point(machine, reading_m, offset_m, &values), locals }
    }

    /// Calls `visit(first, partials, basis values)` for each error function: the partial derivative by coefficient
    /// `first + k` is `partials · values[k]`.
    pub fn visit_errors(&self, point: &ModelPoint, mut visit: impl FnMut(usize, &Vector3<f64>, &[f64])) {
        for (index, local) in point.locals.iter().enumerate() {
            if let Some(local) = local {
                visit(self.ranges[index].start + local.first, &point.chain.by_error[index], local.values());
            }
        }
    }
}
