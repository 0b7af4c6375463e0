//! The verification error of a model, and how well it knows it: what is left at points of another day after correction and rigid alignment.
//!
//! Place in the flow: scores models before and after diagnosis; nothing that is fitted may see it. Input: model and
//! points (m, machine frame) with their covariates, in the order of measurement; output: rms length of the residual vectors (m) and the share
//! of coordinates within U (k = 2), each point approached once, with the repeatability of the machine.

use abbe_geometry::Vector3;
use abbe_geometry::correct::{Status, correct};
use abbe_geometry::effects::{CovariateSource, CovariateValue, Lag, State, Travel, of_lagged};
use abbe_geometry::model::MachineModel;
use abbe_measurement::alignment::aligned_residuals_m;
use abbe_virtual_machine::simulate::covariate_names;
use abbe_virtual_machine::verification::{STEP_S, VerificationPoint};

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use crate::error::TrialError;
use crate::scenario::declared_instrument;

/// Time constants after which a lagged quantity counts as known.
const SETTLED: f64 = 3.0;
/// Fewest points that score a model that must first see how the machine came.
const FEWEST: usize = 50;

/// What is left at the points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verified {
    /// Rms of the 3-D error (m), without the machine's repeatability.
    pub rms_m: f64,
    /// Share of the coordinates within U (k = 2), with it.
    pub covered: f64,
}

/// Covariates of one point, the time and what follows others among them.
struct Logged<'a>(&'a VerificationPoint, &'a [(String, Option<f64>)]);

impl CovariateSource for Logged<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        if name == "time_s" {
            return CovariateValue::Fresh(self.0.time_s);
        }
        match covariate_names().position(|known| known == name) {
            Some(place) => CovariateValue::Fresh(self.0.covariates[place]),
            None => {
                let derived = self.1.iter().find(|(known, _)| known == name).and_then(|(_, value)| *value);
                derived.map_or(CovariateValue::Missing, CovariateValue::Fresh)
            }
        }
    }
}

/// Points that only tell a model how the room came before those that score it.
pub fn history(model: &MachineModel) -> usize {
    let longest_s = model.reads().iter().filter_map(|name| of_lagged(name)).map(|(_, lag_s)| lag_s.abs()).max();
    longest_s.map_or(0, |lag_s| (SETTLED * f64::from(lag_s) / STEP_S).ceil() as usize + 1)
}

/// What follows logged quantities or the way of an axis.
enum Follows {
    Quantity(usize, Lag),
    Way(Travel),
}

/// Makes the derived covariates that a model asks for, point by point, as `abbe correct` makes them of a file.
struct Derived(Vec<(String, Follows)>);

impl Derived {
    fn of(model: &MachineModel) -> Derived {
        let follows = |name: &String| {
            if let Some(travel) = Travel::of(name) {
                return Some((name.clone(), Follows::Way(travel)));
            }
            let (logged, lag_s) = of_lagged(name)?;
            let place = covariate_names().position(|known| known == logged)?;
            Some((name.clone(), Follows::Quantity(place, Lag::new(f64::from(lag_s)))))
        };
        Derived(model.reads().iter().filter_map(follows).collect())
    }

    /// Values at the next point; `None` until the points before tell how the machine came.
    fn next(&mut self, point: &VerificationPoint) -> Vec<(String, Option<f64>)> {
        let value = |follows: &mut Follows| match follows {
            Follows::Quantity(place, lag) => {
                let lagged = lag.push(point.time_s, point.covariates[*place]);
                lagged.is_settled.then_some(lagged.value)
            }
            Follows::Way(travel) => {
                let logged = covariate_names().position(|known| known == travel.logged_side());
                let logged = logged.map(|place| point.covariates[place]);
                travel.push(point.reading_m, logged).filter(|now| now.is_settled).map(|now| now.side)
            }
        };
        self.0.iter_mut().map(|(name, follows)| (name.clone(), value(follows))).collect()
    }
}

/// What the model leaves at the points after the best rigid alignment. First points, at which nobody can know how the machine came, are left
/// out.
///
/// # Errors
/// A point could not be corrected in full, too few are left, or the points cannot be aligned.
pub fn verified(model: &MachineModel, points: &[VerificationPoint]) -> Result<Verified, TrialError> {
    let mut derived = Derived::of(model);
    let (mut corrected_m, mut actual_m, mut u_m) = (Vec::new(), Vec::new(), Vec::new());
    for point in points {
        let values = derived.next(point);
        if values.iter().any(|(_, value)| value.is_none()) {
            continue;
        }
        let covariates = Logged(point, &values);
        let state = State { reading_m: point.reading_m, offset_m: point.offset_m, covariates: &covariates };
        let correction = correct(model, &state);
        if !matches!(correction.status, Status::InVolume | Status::Extrapolated) {
            return Err(TrialError::Verification(format!("a point is {:?}", correction.status)));
        }
        corrected_m.push(correction.position_m);
        actual_m.push(Vector3::from(point.actual_in_machine_m));
        u_m.push(correction.covariance_m2.map(|covariance| covariance.diagonal().map(f64::sqrt)));
    }
    if corrected_m.len() < FEWEST {
        return Err(TrialError::Verification(format!("{} points are too few to score a model", corrected_m.len())));
    }
    let residuals = aligned_residuals_m(&corrected_m, &actual_m)
        .map_err(|problem| TrialError::Verification(problem.to_string()))?;
    let square_m2: f64 = residuals.iter().map(Vector3::norm_squared).sum();
    Ok(Verified { rms_m: (square_m2 / residuals.len() as f64).sqrt(), covered: covered(&residuals, &u_m) })
}

/// Share of coordinates within twice their standard uncertainty. A coordinate without one is none of them.
fn covered(residuals_m: &[Vector3<f64>], u_m: &[Option<Vector3<f64>>]) -> f64 {
    let mut generator = ChaCha8Rng::seed_from_u64(0);
    let repeatability_m = declared_instrument().repeatability_m;
    let mut hits = 0;
    for (residual_m, u_m) in residuals_m.iter().zip(u_m) {
        for d in 0..3 {
            let drawn: f64 = StandardNormal.sample(&mut generator);
            let off_m = residual_m[d] + repeatability_m[d] * drawn;
            hits += u32::from(u_m.is_some_and(|u_m| off_m.abs() <= 2.0 * u_m[d]));
        }
    }
    f64::from(hits) / (3 * residuals_m.len()).max(1) as f64
}
