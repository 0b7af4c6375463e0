//! Which parameter stands where in the vector that identification estimates and the model stores.
//!
//! Place in the flow: shared by identification, covariance, correction and the model file. Order: coefficients
//! of the 18 error functions in [`ErrorId::index`] order, the three squareness angles, effect parameters;
//! after these, outside this layout, four for each station (x, y, z, dead path).

use crate::axis::ErrorId;
use crate::chain::{ChainPoint, ErrorValues, actual_point_m, chain_point};
use crate::error_function::{Basis, LocalBasis};
use crate::machine::{Machine, MachineError};
use nalgebra::Vector3;
use std::ops::Range;

/// Bases and positions of all machine parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    bases: Vec<Option<Basis>>,
    ranges: Vec<Range<usize>>,
    /// Which of `distinct` each function has.
    which: Vec<Option<usize>>,
    /// Axis and basis that differ: most functions of an axis share one, which is evaluated once a point.
    distinct: Vec<(usize, Basis)>,
    squareness: usize,
}

/// One chain evaluation with what is needed to spread its partials over the coefficients.
#[derive(Debug, Clone)]
pub struct ModelPoint {
    /// Position and partials by error value.
    pub chain: ChainPoint,
    /// In the order of the layout's distinct bases.
    locals: Vec<LocalBasis>,
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
        let mut distinct: Vec<(usize, Basis)> = Vec::new();
        let mut place = |(id, basis): (ErrorId, Basis)| {
            let entry = (id.axis().index(), basis);
            distinct.iter().position(|other| *other == entry).unwrap_or_else(|| {
                distinct.push(entry);
                distinct.len() - 1
            })
        };
        let which = ErrorId::all().zip(&bases).map(|(id, basis)| basis.map(|basis| place((id, basis)))).collect();
        Ok(Layout { bases, ranges, which, distinct, squareness: next })
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
        let locals = self.locals(reading_m);
        let values = self.values(coefficients, &locals);
        ModelPoint { chain: chain_point(machine, reading_m, offset_m, &values), locals }
    }

    /// Actual position (m, machine frame) without partials, from the geometric coefficients.
    pub fn position_m(
        &self,
        machine: &Machine,
        coefficients: &[f64],
        reading_m: [f64; 3],
        offset_m: [f64; 3],
    ) -> Vector3<f64> {
        actual_point_m(machine, reading_m, offset_m, &self.values(coefficients, &self.locals(reading_m)))
    }

    /// The same with basis functions from [`Layout::locals`], for fits that come back to a reading thousands of times.
    pub fn position_from_m(
        &self,
        machine: &Machine,
        coefficients: &[f64],
        (reading_m, offset_m): ([f64; 3], [f64; 3]),
        locals: &[LocalBasis],
    ) -> Vector3<f64> {
        actual_point_m(machine, reading_m, offset_m, &self.values(coefficients, locals))
    }

    /// Basis functions at a reading, one for each basis that differs.
    pub fn locals(&self, reading_m: [f64; 3]) -> Vec<LocalBasis> {
        self.distinct.iter().map(|(axis, basis)| basis.at(reading_m[*axis])).collect()
    }

    fn values(&self, coefficients: &[f64], locals: &[LocalBasis]) -> ErrorValues {
        let mut values = ErrorValues::ZERO;
        for ((value, which), range) in values.errors.iter_mut().zip(&self.which).zip(&self.ranges) {
            if let Some(which) = which {
                *value = locals[*which].dot(&coefficients[range.clone()]);
            }
        }
        values.squareness.copy_from_slice(&coefficients[self.squareness()]);
        values
    }

    /// Calls `visit(first, partials, basis values)` for each error function: the partial derivative by coefficient
    /// `first + k` is `partials · values[k]`.
    pub fn visit_errors(&self, point: &ModelPoint, mut visit: impl FnMut(usize, &Vector3<f64>, &[f64])) {
        for (index, which) in self.which.iter().enumerate() {
            if let Some(which) = which {
                let local = &point.locals[*which];
                visit(self.ranges[index].start + local.first, &point.chain.by_error[index], local.values());
            }
        }
    }
}
