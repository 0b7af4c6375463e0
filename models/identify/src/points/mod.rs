//! Identification from measured positions: scale readings and where the tip or reflector really was.
//!
//! Place in the flow: where an instrument gives 3-D positions (a tracker, several tracers at once, a calibrated artefact)
//! instead of ranges; [`crate::identify`] is for ranges. Inputs SI: readings and offsets in the machine frame, positions in
//! any right-handed frame of their own. Output: a model with the covariance of everything, the pose of that frame, and
//! what the data could not tell.
//!
//! Source: Liang 2025, eq. 6-11. With q the chain and R, t the pose of the measuring frame, the objective is
//!
//! > F(p, R, t) = Σᵢ ρ(‖R q(rᵢ, oᵢ; p) + t − Pᵢ‖² / uᵢ²), ρ(s) = s in the paper.
//!
//! The paper lists 18 polynomials a₀ … aₙ and three squareness angles, n = 4 makes 93 numbers. Fifteen of their
//! combinations move no point: nine constants of the linear errors only add up to three, nine constants of the angles and
//! three squareness angles only repeat the slopes of the linear errors or turn the offset. Of the 78 that are left, six merely
//! say where the measuring frame lies and three how the ram is turned. So every error is zero at its origin and straightness
//! at both ends, in the basis itself (as everywhere in Abbe), and six numbers of the frame and three of the ram take the
//! place of what they stood for: 72 unknowns of the machine, 78 in all. The turn of the ram has a prior, for points with
//! one offset or several on a line.
//!
//! F is least by Levenberg-Marquardt, or by [`crate::jade`] started from least squares with perturbations as in the paper.
//! F is so nearly quadratic that both end in the same point; JADE takes a thousand times as long, and is of use only
//! where ρ has many minima ([`Loss::Trimmed`] with gross errors in a large share of the points).

mod certificate;
mod error;
mod fit;
mod levenberg_marquardt;
mod loss;
mod observable;
mod outcome;
mod plate;
mod poses;
mod problem;
mod search;
mod smooth;

pub use error::PointsError;
#[cfg(test)]
pub(crate) use error::tests::machine as tests_machine;
pub use fit::{fit_points, fit_points_of_best_degree};
pub use loss::Loss;
pub use outcome::{FittedPoints, NotSeen, PointEvidence, Pose, RejectedPoint};
pub use plate::{fit_plates, fit_plates_of_best_degree};
pub use poses::Plates;
pub use smooth::{fit_plates_smooth, fit_points_smooth};

use abbe_geometry::Vector3;

/// A position measured while the machine stood still.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredPoint {
    /// Indicated axis positions X, Y, Z (m).
    pub reading_m: [f64; 3],
    /// Tip or reflector relative to the ram reference point (m, ram frame).
    pub offset_m: [f64; 3],
    /// Where it really was (m, frame of the instrument).
    pub actual_m: Vector3<f64>,
    /// Standard uncertainty of each of its coordinates (m, k = 1).
    pub u_m: f64,
}

/// Which way to the minimum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    /// Damped Gauss-Newton with analytic derivatives.
    LevenbergMarquardt,
    /// Adaptive differential evolution from least squares with perturbations.
    Jade(JadeChoices),
}

/// What JADE is given beside the objective.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JadeChoices {
    /// Seed of population and search.
    pub seed: u64,
    /// Members of the population; `None`: four for each unknown.
    pub members: Option<usize>,
    /// Generations after which the search is given up.
    pub max_generations: usize,
    /// Perturbation of the start, in standard uncertainties of each unknown.
    pub perturbation: f64,
}

impl Default for JadeChoices {
    fn default() -> JadeChoices {
        JadeChoices { seed: 1, members: None, max_generations: 20_000, perturbation: 3.0 }
    }
}

/// Choices of one fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointOptions {
    /// Way to the minimum.
    pub method: Method,
    /// What is summed.
    pub loss: Loss,
}

impl Default for PointOptions {
    fn default() -> PointOptions {
        PointOptions { method: Method::LevenbergMarquardt, loss: Loss::Squares }
    }
}

/// One step of progress; the observer returns false to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointProgress {
    /// Steps of Levenberg-Marquardt or generations of JADE so far.
    pub step: usize,
    /// Least value of the objective so far.
    pub objective: f64,
    /// Worst minus best of the population (JADE), or what the last step gained.
    pub spread: f64,
}
