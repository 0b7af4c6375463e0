//! Positions from ranges of several stations.
//!
//! Place in the flow: a tracer campaign whose points were measured from at least four stations in; stations, dead paths and
//! the volumetric error of every point with its covariance out (m, machine frame). No model of the machine is involved:
//! what comes out is what an error field is made of. Source: Chen 2020 eq. 1-11.
//!
//! 1. [`station`]: position and dead path of each station from the nominal points (Levenberg-Marquardt).
//! 2. `pairs`: repeated readings of a point from a station are compared; a pair that differs by more than a limit is
//!    rejected, and reported.
//! 3. [`point`]: actual position of each point from all its stations (Levenberg-Marquardt with Armijo's step).
//!
//! Stations that come from nominal points take up part of the machine's errors, as far as a shift of a station can pass for
//! one. The covariance here holds the noise of the ranges and of the stations, not that part; a joint identification of
//! machine and stations does not have it.

mod campaign;
mod descent;
mod pairs;
pub mod point;
pub mod station;

pub use campaign::{MultiStation, Options, Problem, SolvedPoint, Target, Unsolved, solve};
pub use pairs::{LIMIT_M, RejectedPair};

#[cfg(test)]
mod tests;
