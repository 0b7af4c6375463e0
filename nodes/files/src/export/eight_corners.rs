//! Eight-corner grid: one row a cell with the error vectors at its eight corners, for controllers that interpolate in cells.
//!
//! Place in the flow: one of [`super::FORMATS`]. Columns: `x_low_mm,x_high_mm,y_low_mm,y_high_mm,z_low_mm,z_high_mm`, then for
//! each corner `eXYZ_x_um,eXYZ_y_um,eXYZ_z_um` where each of X, Y, Z is 0 at the low and 1 at the high end, X fastest (e000,
//! e100, e010, e110, e001, …). Inside a cell the error is the trilinear mean of its corners. Numbers read back as
//! they were, but for the last bit of some.

use super::{About, ExportedFile, Format, SampledGrid, Writer, commented, grid_words};
use crate::error::FileError;
use crate::units::{micrometres_from_m, millimetres_from_m};
use std::fmt::Write as _;

pub(super) const FORMAT: Format = Format {
    name: "eight-corners",
    title: "cells of a grid of axis readings with the error vectors at their eight corners, one cell a row",
    source: "own; ends of the cell in mm, then e000, e100, e010, e110, e001, e101, e011, e111 (x, y, z in um each)",
    most_points: None,
    is_stepped: false,
    writer: Writer::Grid(write),
};

fn write(about: &About, grid: &SampledGrid) -> Result<Vec<ExportedFile>, FileError> {
    let counts = grid.table.grid().counts();
    let cells = counts.map(|n| n - 1);
    let units = format!(
        "readings mm, errors um; {} x {} x {} cells; error at the tip, machine frame",
        cells[0], cells[1], cells[2]
    );
    let mut text = commented(&about.lines(&FORMAT, &units, &grid_words(grid)), "#");
    text.push_str(&header());
    let axes = grid.table.grid().axes_m();
    for k in 0..cells.iter().product::<usize>() {
        let cell = [k % cells[0], k / cells[0] % cells[1], k / (cells[0] * cells[1])];
        let ends = [0, 1, 2].map(|d| [axes[d][cell[d]], axes[d][cell[d] + 1]]);
        let ends: Vec<String> = ends.iter().flatten().map(|v| millimetres_from_m(*v).to_string()).collect();
        text.push_str(&ends.join(","));
        for corner in 0..8 {
            let node = [0, 1, 2].map(|d| cell[d] + (corner >> d & 1));
            let error = grid.table.errors_m()[node[0] + counts[0] * (node[1] + counts[1] * node[2])];
            for value in error.iter() {
                // Writing to a string cannot fail.
                let _ = write!(text, ",{}", micrometres_from_m(*value));
            }
        }
        text.push('\n');
    }
    Ok(vec![ExportedFile { name: "cells.csv".to_owned(), text }])
}

fn header() -> String {
    let mut names: Vec<String> =
        ["x_low_mm", "x_high_mm", "y_low_mm", "y_high_mm", "z_low_mm", "z_high_mm"].map(str::to_owned).into();
    for corner in 0..8 {
        let digits = [0, 1, 2].map(|d| (corner >> d & 1).to_string()).concat();
        names.extend(["x", "y", "z"].map(|axis| format!("e{digits}_{axis}_um")));
    }
    names.join(",") + "\n"
}
