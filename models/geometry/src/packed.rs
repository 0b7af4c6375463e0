//! Where entries of symmetric matrices stand that are stored as packed lower triangles, row by row.
//!
//! Place in the flow: covariances of models, from fits to files and back.

/// Place of an entry in a packed lower triangle.
pub fn packed(a: usize, b: usize) -> usize {
    let (row, column) = (a.max(b), a.min(b));
    row * (row + 1) / 2 + column
}
