//! Rotations of a fork head, and the rows of the linear system.
//!
//! Place in the flow: shared by the fit here and the diagnosis of five-axis machines. Zhang 2016, eq. 1, 6 and 7; radians,
//! metres, machine frame.

use nalgebra::{Matrix3, SMatrix};

/// R_C: from the frame that C turns to the machine.
pub(super) fn c_in_machine(c_rad: f64) -> Matrix3<f64> {
    let (sine, cosine) = c_rad.sin_cos();
    Matrix3::new(cosine, -sine, 0.0, sine, cosine, 0.0, 0.0, 0.0, 1.0)
}

/// R_C·R_A: from the head's frame to the machine (eq. 1).
pub fn head_in_machine(a_rad: f64, c_rad: f64) -> Matrix3<f64> {
    let (sine, cosine) = a_rad.sin_cos();
    c_in_machine(c_rad) * Matrix3::new(1.0, 0.0, 0.0, 0.0, cosine, -sine, 0.0, sine, cosine)
}

/// \[I, −d·R, −R\]: how S1 depends on S0, R_p and T_p (eq. 6), for R = R_C·R_A and distance d (m).
pub fn centre_rows(head_in_machine: &Matrix3<f64>, distance_m: f64) -> SMatrix<f64, 3, 9> {
    let mut rows = SMatrix::<f64, 3, 9>::zeros();
    rows.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::identity());
    rows.fixed_view_mut::<3, 3>(0, 3).copy_from(&(head_in_machine * -distance_m));
    rows.fixed_view_mut::<3, 3>(0, 6).copy_from(&-head_in_machine);
    rows
}
