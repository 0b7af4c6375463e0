//! Volumetric grid: the error vector at every node of a grid of readings, one node a row, X fastest.
//!
//! Place in the flow: one of [`super::FORMATS`]. Columns `x_mm,y_mm,z_mm,error_x_um,error_y_um,error_z_um`; the head gives
//! nodes and tip. Numbers read back as they were, but for the last bit of some.

use super::{About, ExportedFile, Format, SampledGrid, Writer, commented, grid_words};
use crate::error::FileError;
use crate::units::{micrometres_from_m, millimetres_from_m};
use std::fmt::Write as _;

pub(super) const FORMAT: Format = Format {
    name: "volumetric-grid",
    title: "error vectors on a grid of axis readings, one node a row",
    source: "own; columns x_mm y_mm z_mm (readings) and error_x_um error_y_um error_z_um, X fastest, then Y, then Z",
    most_points: None,
    is_stepped: false,
    writer: Writer::Grid(write),
};

fn write(about: &About, grid: &SampledGrid) -> Result<Vec<ExportedFile>, FileError> {
    let [x, y, z] = grid.table.grid().counts();
    let units = format!("readings mm, errors um; {x} x {y} x {z} nodes; error at the tip, machine frame");
    let mut text = commented(&about.lines(&FORMAT, &units, &grid_words(grid)), "#");
    text.push_str("x_mm,y_mm,z_mm,error_x_um,error_y_um,error_z_um\n");
    // Writing to a string cannot fail.
    for (point, error) in grid.table.grid().points_m().zip(grid.table.errors_m()) {
        let cells = [point.x, point.y, point.z].map(|v| millimetres_from_m(v).to_string());
        let errors = [error.x, error.y, error.z].map(|v| micrometres_from_m(v).to_string());
        let _ = writeln!(text, "{},{}", cells.join(","), errors.join(","));
    }
    Ok(vec![ExportedFile { name: "grid.csv".to_owned(), text }])
}
