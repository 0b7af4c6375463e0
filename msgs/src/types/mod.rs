//! The messages as plain data of fixed size: what the correcting thread and shared memory carry.
//!
//! Place in the flow: drivers fill them, nodes exchange them, [`crate::Message`] ties them to ROS 2.
//! All are `#[repr(C)]`, `Copy`, without pointers. Their shared-memory name carries a hash of the
//! layout, because iceoryx2 compares the name and not the layout: two versions with different
//! fields then refuse each other instead of misreading. A test holds name and layout together.

mod checks;
mod corrected_coordinates;
mod covariates;
#[cfg(test)]
mod layout;
mod range_residual;
mod scale_reading;
mod sha256;
mod stamp;
mod text;
mod tracer_reading;

pub use corrected_coordinates::{CorrectedCoordinates, CorrectionStatus};
pub use covariates::{COVARIATE_CAPACITY, COVARIATE_NAME_CAPACITY, Covariate, Covariates};
pub use range_residual::{RangeResidual, ResidualStatus};
pub use scale_reading::ScaleReading;
pub use sha256::Sha256;
pub use stamp::Stamp;
pub use text::Text;
pub use tracer_reading::TracerReading;

/// Bytes a `frame_id`, station or line name may have.
pub const NAME_CAPACITY: usize = 64;
