//! Which parameter stands where in the vector that identification estimates and the model stores.
//!
//! Place in the flow: shared by identification, covariance, correction and the model file. Order: coefficients
//! of the 18 error functions in [`ErrorId::index`] order, the three squareness angles, the three angles of the turn of the
//! ram; after these, outside this layout, effect parameters, and four for each station (x, y, z, dead path).
//!
//! The turn of the ram is what is left of the nine constants of the angular errors. Every error function is zero at the
//! lower end of its stroke, and the frame is fixed by the motions of the axes; so whatever turned all axes and the ram alike
//! is in the frame, whatever turned one axis against another is squareness, and how the ram and all that it carries stand
//! in that frame is left: a rotation vector φ (rad), the same in every chain. It turns the offset about the centre ō of
//! the offsets that were measured, o ↦ ō + R(φ)·(o − ō): a turn about any other point would only shift the frame, which
//! the stations follow, and what one offset alone was measured with must not depend on φ.

use crate::axis::ErrorId;
use crate::chain::{ChainPoint, ErrorValues, actual_point_m, chain_point};
use crate::error_function::{Basis, LocalBasis};
use crate::machine::{Machine, MachineError};
use crate::rotation::{RotationForm, rotation, rotation_partials};
use nalgebra::{Matrix3, Vector3};
use smallvec::SmallVec;
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
    /// Offset about which the ram turns (m, ram frame).
    offset_centre_m: Vector3<f64>,
}

/// Basis functions at a reading, one for each basis that differs: six, where the functions of an axis are equally fine.
pub type Locals = SmallVec<[LocalBasis; 6]>;

/// One chain evaluation with what is needed to spread its partials over the coefficients.
#[derive(Debug, Clone)]
pub struct ModelPoint {
    /// Position and partials by error value.
    pub chain: ChainPoint,
    /// ∂position/∂turn of the ram (m/rad).
    pub by_ram_turn: [Vector3<f64>; 3],
    /// In the order of the layout's distinct bases.
    locals: Locals,
}

/// The ram with an offset on it.
struct Ram {
    form: RotationForm,
    turn_rad: Vector3<f64>,
    offset_m: Vector3<f64>,
    /// From the offset that the turn leaves where it is.
    arm_m: Vector3<f64>,
}

impl Ram {
    /// Where the turned ram holds the offset (m, frame of the last joint); the tiny part is added last.
    fn carried_m(&self) -> Vector3<f64> {
        self.offset_m + (rotation(self.form, &self.turn_rad) - Matrix3::identity()) * self.arm_m
    }
}

/// Mean of some offsets (m), exactly the offset where there is but one; zero for none.
pub fn centre_of(mut offsets_m: impl Iterator<Item = [f64; 3]>) -> [f64; 3] {
    let Some(first_m) = offsets_m.next().map(Vector3::from) else { return [0.0; 3] };
    let sum = |(total, count), offset_m: [f64; 3]| (total + (Vector3::from(offset_m) - first_m), count + 1.0);
    let (total, count) = offsets_m.fold((Vector3::zeros(), 1.0), sum);
    (first_m + total / count).into()
}

impl Layout {
    /// Layout of the machine's error functions; the ram turns about `offset_centre_m` (m, ram frame).
    pub fn new(machine: &Machine, offset_centre_m: [f64; 3]) -> Result<Layout, MachineError> {
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
        let offset_centre_m = Vector3::from(offset_centre_m);
        Ok(Layout { bases, ranges, which, distinct, squareness: next, offset_centre_m })
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

    /// The turn of the ram about X, Y and Z.
    pub fn ram_turn(&self) -> Range<usize> {
        self.squareness + 3..self.squareness + 6
    }

    /// Offset about which the ram turns (m, ram frame).
    pub fn offset_centre_m(&self) -> [f64; 3] {
        self.offset_centre_m.into()
    }

    /// Number of geometric parameters (errors, squareness, turn of the ram).
    pub fn len(&self) -> usize {
        self.squareness + 6
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
        self.point_from(machine, coefficients, (reading_m, offset_m), self.locals(reading_m))
    }

    /// The same with basis functions from [`Layout::locals`].
    pub fn point_from(
        &self,
        machine: &Machine,
        coefficients: &[f64],
        (reading_m, offset_m): ([f64; 3], [f64; 3]),
        locals: Locals,
    ) -> ModelPoint {
        let values = self.values(coefficients, &locals);
        let ram = self.ram(machine.rotation, coefficients, offset_m);
        let chain = chain_point(machine, reading_m, ram.carried_m().into(), &values);
        let turned = chain.by_offset * rotation_partials(machine.rotation, &ram.turn_rad, &ram.arm_m);
        ModelPoint { chain, by_ram_turn: std::array::from_fn(|d| turned.column(d).into_owned()), locals }
    }

    /// Actual position (m, machine frame) without partials, from the geometric coefficients.
    pub fn position_m(
        &self,
        machine: &Machine,
        coefficients: &[f64],
        reading_m: [f64; 3],
        offset_m: [f64; 3],
    ) -> Vector3<f64> {
        self.position_from_m(machine, coefficients, (reading_m, offset_m), &self.locals(reading_m))
    }

    /// The same with basis functions from [`Layout::locals`], for fits that come back to a reading thousands of times.
    pub fn position_from_m(
        &self,
        machine: &Machine,
        coefficients: &[f64],
        (reading_m, offset_m): ([f64; 3], [f64; 3]),
        locals: &[LocalBasis],
    ) -> Vector3<f64> {
        let carried_m = self.ram(machine.rotation, coefficients, offset_m).carried_m();
        actual_point_m(machine, reading_m, carried_m.into(), &self.values(coefficients, locals))
    }

    fn ram(&self, form: RotationForm, coefficients: &[f64], offset_m: [f64; 3]) -> Ram {
        let offset_m = Vector3::from(offset_m);
        let turn_rad = Vector3::from_column_slice(&coefficients[self.ram_turn()]);
        Ram { form, turn_rad, offset_m, arm_m: offset_m - self.offset_centre_m }
    }

    /// Basis functions at a reading, one for each basis that differs.
    pub fn locals(&self, reading_m: [f64; 3]) -> Locals {
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
