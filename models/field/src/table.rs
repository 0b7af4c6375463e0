//! Compensation table: the error on a grid, trilinear between its nodes.
//!
//! Place in the flow: any error function of a point (the geometric model, a field) in, a table for a controller out, which
//! states by how much it misses the function. Points in m in the machine frame; error = actual − indicated (m), so a
//! controller adds it to what is indicated. Source: Liang 2025 section 5 (3-D table of the geometric part).

use crate::hull::Region;
use crate::interpolator::{Estimate, Interpolator, Unanswered, finite};
use crate::lattice::{flat, unit_cell};
use crate::trilinear::blend;
use nalgebra::Vector3;
use thiserror::Error;

/// Parts into which each step is cut where a table is compared with its function.
const CHECKS_PER_STEP: usize = 4;

/// Axis coordinates of a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    axes_m: [Vec<f64>; 3],
}

impl Grid {
    /// A grid from the coordinates of each axis, ascending, at least two (m, machine frame).
    pub fn new(axes_m: [Vec<f64>; 3]) -> Result<Grid, GridError> {
        for (axis, coordinates) in ["x", "y", "z"].into_iter().zip(&axes_m) {
            if coordinates.len() < 2 {
                return Err(GridError::TooFew { axis, count: coordinates.len() });
            }
            if let Some(index) = coordinates.iter().position(|c| !c.is_finite()) {
                return Err(GridError::NotFinite { axis, index });
            }
            if let Some(index) = coordinates.windows(2).position(|pair| pair[1] <= pair[0]) {
                return Err(GridError::NotAscending { axis, index: index + 1 });
            }
        }
        Ok(Grid { axes_m })
    }

    /// A grid of so many equal steps on each axis between a lower and an upper end (m).
    pub fn regular(ends_m: [(f64, f64); 3], steps: [usize; 3]) -> Result<Grid, GridError> {
        let axis = |d: usize| -> Vec<f64> {
            let ((lower, upper), count) = (ends_m[d], steps[d]);
            (0..=count)
                .map(|k| if k == count { upper } else { lower + (upper - lower) * (k as f64 / count as f64) })
                .collect()
        };
        Grid::new([axis(0), axis(1), axis(2)])
    }

    /// Coordinates of each axis, ascending (m).
    pub fn axes_m(&self) -> &[Vec<f64>; 3] {
        &self.axes_m
    }

    /// Nodes on each axis.
    pub fn counts(&self) -> [usize; 3] {
        [0, 1, 2].map(|d| self.axes_m[d].len())
    }

    /// Nodes of the grid.
    pub fn nodes(&self) -> usize {
        self.counts().iter().product()
    }

    /// All nodes, x fastest (m).
    pub fn points_m(&self) -> impl Iterator<Item = Vector3<f64>> + '_ {
        let [x_m, y_m, z_m] = &self.axes_m;
        z_m.iter().flat_map(move |z| y_m.iter().flat_map(move |y| x_m.iter().map(move |x| Vector3::new(*x, *y, *z))))
    }

    /// The same grid with each step cut into equal parts.
    fn refined(&self, parts: usize) -> Grid {
        let refine = |axis: &Vec<f64>| {
            let cut =
                |pair: &[f64]| (0..parts).map(|k| pair[0] + (pair[1] - pair[0]) * (k as f64 / parts as f64)).collect();
            let inner = axis.windows(2).flat_map(|pair| -> Vec<f64> { cut(pair) });
            inner.chain(axis.last().copied()).collect::<Vec<f64>>()
        };
        Grid { axes_m: self.axes_m.each_ref().map(refine) }
    }
}

/// By how much a table misses its function.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InterpolationError {
    /// Root mean square over the checks, by direction (m).
    pub rms_m: Vector3<f64>,
    /// Largest, by direction (m).
    pub largest_m: Vector3<f64>,
    /// Where the largest of all directions was found (m).
    pub at_m: Vector3<f64>,
    /// Points at which table and function were compared: each step in quarters along every axis.
    pub checks: usize,
}

/// Errors at the nodes of a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    grid: Grid,
    errors_m: Vec<Vector3<f64>>,
}

impl Table {
    /// A table from the error at each node, x fastest (m).
    pub fn new(grid: Grid, errors_m: Vec<Vector3<f64>>) -> Result<Table, GridError> {
        if errors_m.len() != grid.nodes() {
            return Err(GridError::Lengths { nodes: grid.nodes(), errors: errors_m.len() });
        }
        match errors_m.iter().position(|e| e.iter().any(|v| !v.is_finite())) {
            Some(node) => Err(GridError::Error { node }),
            None => Ok(Table { grid, errors_m }),
        }
    }

    /// A table of a function's values at the nodes.
    pub fn of<E>(
        grid: Grid,
        error_m: impl Fn(&Vector3<f64>) -> Result<Vector3<f64>, E>,
    ) -> Result<Table, TableError<E>> {
        let errors_m: Result<Vec<_>, E> = grid.points_m().map(|point| error_m(&point)).collect();
        Ok(Table::new(grid, errors_m.map_err(TableError::Function)?)?)
    }

    /// The grid.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Error at each node, x fastest: actual − indicated (m).
    pub fn errors_m(&self) -> &[Vector3<f64>] {
        &self.errors_m
    }

    /// Compares the table with the function it was made of, at every quarter step.
    pub fn interpolation_error<E>(
        &self,
        error_m: impl Fn(&Vector3<f64>) -> Result<Vector3<f64>, E>,
    ) -> Result<InterpolationError, TableError<E>> {
        let (mut square, mut largest_m, mut checks) = (Vector3::zeros(), Vector3::<f64>::zeros(), 0_usize);
        let mut at_m = Vector3::zeros();
        for point in self.grid.refined(CHECKS_PER_STEP).points_m() {
            let missed = self.value(&point) - error_m(&point).map_err(TableError::Function)?;
            if !missed.iter().all(|v| v.is_finite()) {
                return Err(TableError::NotFinite { at_mm: (point * 1e3).into() });
            }
            if missed.amax() > largest_m.max() {
                at_m = point;
            }
            largest_m = largest_m.zip_map(&missed, |largest, m| largest.max(m.abs()));
            square += missed.component_mul(&missed);
            checks += 1;
        }
        Ok(InterpolationError { rms_m: (square / checks as f64).map(f64::sqrt), largest_m, at_m, checks })
    }

    /// Trilinear value at a finite point; the outermost cell goes on beyond the grid.
    fn value(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        let axes = &self.grid.axes_m;
        let cell = [0, 1, 2].map(|d| unit_cell(&axes[d], point_m[d]));
        let share = Vector3::from_fn(|d, _| {
            let (lower, upper) = (axes[d][cell[d]], axes[d][cell[d] + 1]);
            (point_m[d] - lower) / (upper - lower)
        });
        let counts = self.grid.counts();
        let corner = |k: usize| self.errors_m[flat([0, 1, 2].map(|d| cell[d] + (k >> d & 1)), counts)];
        blend([0, 1, 2, 3, 4, 5, 6, 7].map(corner), &share)
    }
}

impl Interpolator for Table {
    fn at(&self, point_m: &Vector3<f64>) -> Result<Estimate, Unanswered> {
        finite(point_m)?;
        let nearest = Vector3::from_fn(|d, _| {
            let axis = &self.grid.axes_m[d];
            point_m[d].clamp(axis[0], axis[axis.len() - 1])
        });
        let region = Region::at_distance((point_m - nearest).norm(), 0.0);
        Ok(Estimate { error_m: self.value(point_m), u_m: None, region })
    }
}

/// A grid or table that is none; the text says what to do.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum GridError {
    /// Too few nodes.
    #[error("axis {axis} of the grid has {count} nodes; give at least 2")]
    TooFew {
        /// Axis.
        axis: &'static str,
        /// Nodes.
        count: usize,
    },
    /// A coordinate that is none.
    #[error("axis {axis} of the grid, node {index}: the coordinate is not a finite number")]
    NotFinite {
        /// Axis.
        axis: &'static str,
        /// Node, from 0.
        index: usize,
    },
    /// Coordinates out of order.
    #[error(
        "axis {axis} of the grid, node {index}: the coordinate is not above the one before; sort them, without repeats"
    )]
    NotAscending {
        /// Axis.
        axis: &'static str,
        /// Node, from 0.
        index: usize,
    },
    /// Not one error a node.
    #[error("{errors} errors for {nodes} nodes; give one for each node, x fastest")]
    Lengths {
        /// Nodes.
        nodes: usize,
        /// Errors.
        errors: usize,
    },
    /// An error that is no number.
    #[error("node {node} (x fastest, from 0): the error is not a finite number")]
    Error {
        /// Node, from 0.
        node: usize,
    },
}

/// Why there is no table of a function.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum TableError<E> {
    /// The grid is none.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The function failed.
    #[error("the error cannot be evaluated: {0}")]
    Function(E),
    /// The function gave no number.
    #[error("the error at ({}, {}, {}) mm is not a finite number", at_mm[0], at_mm[1], at_mm[2])]
    NotFinite {
        /// Where (mm).
        at_mm: [f64; 3],
    },
    /// A wanted error that is none.
    #[error("the wanted interpolation error {wanted_um} µm is not above zero")]
    Wanted {
        /// Asked for (µm).
        wanted_um: f64,
    },
    /// Too many nodes.
    #[error(
        "an interpolation error of {wanted_um} µm needs more than {most_nodes} nodes (with {nodes} it is {reached_um:.3} µm); \
         allow more, or a larger error"
    )]
    TooFine {
        /// Asked for (µm).
        wanted_um: f64,
        /// Nodes allowed.
        most_nodes: usize,
        /// Nodes of the last grid tried.
        nodes: usize,
        /// Its error (µm).
        reached_um: f64,
    },
}

#[cfg(test)]
#[path = "table_tests.rs"]
mod tests;
