//! Positions from ranges of several stations.
//!
//! Place in the flow: a tracer campaign whose points were measured from at least four stations in; stations, dead paths and
//! the volumetric error of every point with its covariance out (m, machine frame). No model of the machine is involved:
//! what comes out is what an error field is made of.
//!
//! 1. `targets`: readings are dealt to the points they were taken at.
//! 2. `pairs`: repeated readings of a point from a station are compared; what differs by more than the declared uncertainties
//!    explain is rejected, and reported (after Chen 2020 section 3.1).
//! 3. [`crate::network`]: stations, dead paths and points together, from the ranges alone; what contradicts is left out.
//!
//! Ranges do not tell how everything together stands in the machine. Errors are of the frame in which the points fit their
//! indicated positions best, so that they hold no common shift and no common turn; to compare, align first.
//!
//! [`station`] and [`point`] are the published procedure (Chen 2020 eq. 1-11), stations from nominal points and then points
//! from stations. It takes a part of the machine's errors for stations, and is kept to be compared with.

mod campaign;
mod descent;
mod pairs;
pub mod point;
mod problem;
pub mod station;
mod targets;

pub use campaign::{MultiStation, MultilaterationOptions, RejectedSight, SolvedPoint, Unsolved, solve};
pub use pairs::{LIMIT_M, LeftOut, RejectedPair};
pub use problem::Problem;
pub use targets::Target;

#[cfg(test)]
mod tests;
