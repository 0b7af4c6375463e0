//! Figures of the standards for coordinate measuring machines and machine tools.
//!
//! Place in the flow: measured deviations in, the figures that the standards define out: ISO 10360-2 ([`length`]),
//! ISO 10360-5 ([`probing`]), ISO 230-2 ([`positioning`]) and ISO 230-6 ([`diagonals`]). SI throughout. Pure numerics.
//!
//! Two sign conventions meet here. ISO 10360 speaks of errors of indication, *measured − calibrated*. ISO 230 speaks of
//! deviations of the actual position, *actual − target*, which is Abbe's own sign.
//!
//! What was observed ([`ObservedError`]) and what is permitted ([`PermissibleError`]) are different types; only
//! [`DecisionRule`] brings them together, so that no figure is ever printed or compared as the other:
//!
//! ```
//! use abbe_conformity::{DecisionRule, MaximumPermissibleError, ObservedError, TestUncertainty, Verdict};
//! let limit = MaximumPermissibleError::from_text("0.5+L/400")?;
//! let length_m = 0.42; // where 1.55 µm are permitted
//! let rule = DecisionRule::GuardBand(TestUncertainty::expanded(0.2e-6, 0.0)?);
//! let verdict = |observed_m| rule.decide(ObservedError::from_metres(observed_m), limit.at(length_m), length_m);
//! assert_eq!(verdict(-1.2e-6), Verdict::Conforms);
//! assert_eq!(verdict(1.5e-6), Verdict::Undecided); // nearer to the limit than the test can tell
//! # Ok::<(), abbe_conformity::ConformityError>(())
//! ```
//!
//! What is taken for the other does not compile:
//!
//! ```compile_fail,E0308
//! use abbe_conformity::{MaximumPermissibleError, ObservedError};
//! let limit = MaximumPermissibleError::from_text("0.5+L/400").unwrap();
//! let observed: ObservedError = limit.at(0.42); // a limit is no observation
//! ```

pub mod decision;
pub mod departure;
pub mod diagonals;
mod error;
pub mod frontier;
pub mod length;
pub mod limit;
pub mod positioning;
pub mod probing;
pub mod quantity;

pub use decision::{DecisionRule, TestUncertainty, Verdict};
pub use departure::Departure;
pub use error::ConformityError;
pub use frontier::{Frontier, SupportedLimit};
pub use limit::MaximumPermissibleError;
pub use quantity::{ObservedError, PermissibleError};
