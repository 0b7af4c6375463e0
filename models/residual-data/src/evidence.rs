//! How likely the ranges are under a residual field of given smoothness: the restricted likelihood.
//!
//! Place in the flow: [`crate::search`] maximises it, [`crate::ranges`] estimates with what came out. The three
//! components of r(p) are independent Gaussian processes, each with its own size a_d and all with one anisotropic
//! Matérn 5/2 correlation; a range sees Σ_d u_d r_d. With C the covariance of the whitened rows and S the prior
//! precision of the model's own parameters (m0 its mean),
//!
//! > −2 ln L = ln|C| + ln|JᵀC⁻¹J + S| + lᵀC⁻¹l − bᵀ(JᵀC⁻¹J + S)⁻¹b,  b = JᵀC⁻¹l + S m0
//!
//! up to a constant. Source: Rasmussen & Williams 2006, Gaussian Processes for Machine Learning, eq. 2.41-2.45 (explicit
//! basis functions); the correlation is that of [`Kernel`].

use crate::ResidualError;
use crate::problem::Problem;
use abbe_field::kriging::Kernel;
use abbe_identify::log_determinant;
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};
use nalgebra::Vector3;

/// Size and smoothness of a residual field, and the noise around it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldPrior {
    /// Standard deviation of each component of the field (m).
    pub amplitude_m: [f64; 3],
    /// Length over which the field changes along each axis (m).
    pub length_m: [f64; 3],
    /// Standard deviation of the readings over the declared one.
    pub noise: f64,
}

impl FieldPrior {
    /// Matérn 5/2 correlation of a component of the field at two points.
    pub(crate) fn correlation(&self, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
        let square: f64 = (0..3).map(|d| ((a[d] - b[d]) / self.length_m[d]).powi(2)).sum();
        Kernel::Matern52.correlation(square)
    }

    /// Covariance of the field with what row `k` sees of it, a vector over the components (m² times 1/m of whitening).
    pub(crate) fn seen_by(&self, problem: &Problem, k: usize, point_m: &Vector3<f64>) -> Vector3<f64> {
        let correlation = self.correlation(&problem.points_m[k], point_m) * problem.whitening[k];
        Vector3::from_fn(|d, _| correlation * self.amplitude_m[d].powi(2) * problem.directions[k][d])
    }

    /// Covariance of the whitened rows: field and noise (lower triangle).
    fn rows(&self, problem: &Problem) -> Mat<f64> {
        let count = problem.len();
        let mut matrix = Mat::zeros(count, count);
        for j in 0..count {
            let at = problem.points_m[j];
            let along =
                Vector3::from_fn(|d, _| self.amplitude_m[d].powi(2) * problem.directions[j][d]) * problem.whitening[j];
            for i in j..count {
                let seen = problem.directions[i].dot(&along) * problem.whitening[i];
                matrix[(i, j)] = seen * self.correlation(&problem.points_m[i], &at);
            }
            matrix[(j, j)] += self.noise * self.noise;
        }
        matrix
    }
}

/// Everything that follows from rows and prior: factors, and the model's own change.
pub(crate) struct Factored {
    /// Factor of C.
    pub(crate) rows: Llt<f64>,
    /// Factor of JᵀC⁻¹J + S.
    pub(crate) trend: Llt<f64>,
    /// δ, the change of the model's parameters.
    pub(crate) change: Mat<f64>,
    /// C⁻¹(l − J δ).
    pub(crate) weights: Mat<f64>,
    /// −2 ln L, up to a constant.
    pub(crate) minus_two_log_likelihood: f64,
}

impl Factored {
    /// Factors everything for one prior.
    pub(crate) fn new(problem: &Problem, prior: &FieldPrior) -> Result<Factored, ResidualError> {
        let (count, width) = (problem.len(), problem.jacobian.ncols());
        let rows = Llt::new(prior.rows(problem).as_ref(), Side::Lower).map_err(|_| ResidualError::Singular)?;
        let right = Mat::from_fn(count, width + 1, |i, j| match j < width {
            true => problem.jacobian[(i, j)],
            false => problem.residuals[i],
        });
        let solved = rows.solve(&right);
        let normal = right.transpose() * &solved;
        let information = Mat::from_fn(width, width, |i, j| normal[(i, j)] + problem.precision[(i, j)]);
        let trend = Llt::new(information.as_ref(), Side::Lower).map_err(|_| ResidualError::Singular)?;
        let gradient = Mat::from_fn(width, 1, |i, _| normal[(i, width)] + problem.pull[i]);
        let change = trend.solve(&gradient);
        let explained: f64 = (0..width).map(|k| gradient[(k, 0)] * change[(k, 0)]).sum();
        let moved = solved.subcols(0, width) * &change;
        let weights = Mat::from_fn(count, 1, |i, _| solved[(i, width)] - moved[(i, 0)]);
        let minus_two_log_likelihood =
            log_determinant(&rows) + log_determinant(&trend) + normal[(width, width)] - explained;
        Ok(Factored { rows, trend, change, weights, minus_two_log_likelihood })
    }
}
