//! Rows of a table, corrected many at a time on all cores.
//!
//! Place in the flow: between the reader and the writer of `abbe correct`. Rows are read one after the other, with the covariates
//! that the model asks for, since what a cell means may depend on the cells before it. Correcting them and turning them
//! into text is what takes long, and depends on nothing but the row. They leave in the order of the table.

use crate::residual::with_residual;
use abbe_files::{CovariatePlace, FileError, PointRow, PointsReader, RowsForm, RowsText};
use abbe_geometry::Vector3;
use abbe_geometry::chain::nominal_point_m;
use abbe_geometry::correct::{Correction, Status, correct};
use abbe_geometry::effects::{CovariateSource, CovariateValue, State};
use abbe_geometry::model::MachineModel;
use abbe_graph::step::OwnedField;
use abbe_identify::in_parallel;
use std::collections::BTreeSet;
use std::io::Read;
use std::ops::Range;

/// Rows that one thread takes at once: some milliseconds of work.
const PART: usize = 1024;
/// Rows that are read before they are corrected.
pub(crate) const MANY: usize = 16 * PART;

/// What was done to one row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moved {
    /// Corrected − indicated position (m).
    pub(crate) by_m: Vector3<f64>,
    /// Standard uncertainty of the corrected coordinates (m).
    pub(crate) u_m: Vector3<f64>,
}

/// Rows that were read and not yet corrected.
pub(crate) struct Batch {
    rows: Vec<PointRow>,
    read: usize,
    /// Names of the covariates that the model asks for, where they are found, and their values row by row.
    names: Vec<String>,
    places: Vec<CovariatePlace>,
    values: Vec<CovariateValue>,
}

/// Some of the rows, corrected.
pub(crate) struct Part {
    rows: Range<usize>,
    /// Of each row.
    pub(crate) statuses: Vec<Status>,
    /// What was done to each row; `None` to one that was rejected.
    pub(crate) moved: Vec<Option<Moved>>,
    /// What to write.
    pub(crate) text: RowsText,
}

/// Covariates of one row.
struct Logged<'a> {
    names: &'a [String],
    values: &'a [CovariateValue],
}

impl CovariateSource for Logged<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        let at = self.names.iter().position(|known| known == name);
        at.map_or(CovariateValue::Missing, |at| self.values[at])
    }
}

impl Batch {
    /// Room for `size` rows of this table that this model corrects, and a residual model with these inputs.
    pub(crate) fn new<R: Read>(
        reader: &PointsReader<R>,
        model: &MachineModel,
        inputs: &[String],
        size: usize,
    ) -> Batch {
        let parts = model.parts();
        let names = parts.effects.iter().flat_map(|fitted| fitted.effect.covariates());
        // Those of the range alone are looked at where a row outside what was measured is told of.
        let names: BTreeSet<String> = names.chain(parts.identified.covariates.keys().chain(inputs).cloned()).collect();
        let names: Vec<String> = names.into_iter().collect();
        let places = names.iter().map(|name| reader.place_of(name)).collect();
        Batch { rows: vec![PointRow::default(); size], read: 0, names, places, values: Vec::new() }
    }

    /// Forgets the rows.
    pub(crate) fn clear(&mut self) {
        self.read = 0;
        self.values.clear();
    }

    /// The rows.
    pub(crate) fn rows(&self) -> &[PointRow] {
        &self.rows[..self.read]
    }

    /// Reads one row more, unless it is full; `None` at the end of the table.
    pub(crate) fn read<R: Read>(&mut self, reader: &mut PointsReader<R>) -> Result<Option<&PointRow>, FileError> {
        let Some(row) = self.rows.get_mut(self.read) else { return Ok(None) };
        if !reader.read(row)? {
            return Ok(None);
        }
        self.values.extend(self.places.iter().map(|place| reader.covariate_at(row, *place)));
        self.read += 1;
        Ok(Some(row))
    }

    /// The rows of a part, and the state of the machine at each.
    pub(crate) fn visit(&self, rows: Range<usize>, mut visit: impl FnMut(&PointRow, &State)) {
        for (k, row) in rows.clone().zip(&self.rows[rows]) {
            let values = &self.values[k * self.names.len()..(k + 1) * self.names.len()];
            let covariates = Logged { names: &self.names, values };
            visit(row, &State { reading_m: row.reading_m, offset_m: row.offset_m, covariates: &covariates });
        }
    }

    /// All rows corrected, in parts, in order.
    pub(crate) fn corrected(
        &self,
        model: &MachineModel,
        residual: Option<&OwnedField>,
        form: RowsForm,
    ) -> Result<Vec<Part>, FileError> {
        let part = |rows: &Range<usize>| {
            let (mut text, mut statuses, mut outcome) = (form.text(), Vec::with_capacity(rows.len()), Ok(()));
            let mut moved = Vec::with_capacity(rows.len());
            self.visit(rows.clone(), |row, state| {
                let correction = with_residual(correct(model, state), residual, state.covariates);
                statuses.push(correction.status);
                moved.push(moved_by(&correction, state));
                if outcome.is_ok() {
                    outcome = text.push(row, &correction);
                }
            });
            outcome.map(|()| Part { rows: rows.clone(), statuses, moved, text })
        };
        let ranges: Vec<Range<usize>> =
            (0..self.read).step_by(PART).map(|first| first..self.read.min(first + PART)).collect();
        match ranges.as_slice() {
            [one] => Ok(vec![part(one)?]),
            several => in_parallel(several, part).into_iter().collect(),
        }
    }
}

fn moved_by(correction: &Correction, state: &State) -> Option<Moved> {
    let by_m = correction.position_m - nominal_point_m(state.reading_m, state.offset_m);
    Some(Moved { by_m, u_m: correction.covariance_m2?.diagonal().map(|v| v.max(0.0).sqrt()) })
}

impl Part {
    /// Which rows of the batch.
    pub(crate) fn rows(&self) -> Range<usize> {
        self.rows.clone()
    }
}
