//! Fields of volumetric error over the working volume.
//!
//! Place in the flow: error vectors measured at points (m, machine frame) in, the error at any other point out, with its
//! uncertainty where the method has one. [`cells`] says which measured points surround a target and whether the target
//! lies among them; every method is an [`Interpolator`]; [`table`] turns any of them, or a model, into a grid for a
//! controller. Error = actual − indicated. Pure numerics.
//!
//! Errors measured at the corners of a box, and the error between them:
//!
//! ```
//! use abbe_field::{Interpolator, MeasuredField, Trilinear};
//! use nalgebra::Vector3;
//!
//! let corner = |k: usize| Vector3::new((k & 1) as f64, (k >> 1 & 1) as f64, (k >> 2) as f64);
//! let points_m: Vec<_> = (0..8).map(corner).collect();
//! // The machine is too long in X by 10 µm/m, so it indicates too little.
//! let errors_m = points_m.iter().map(|p| Vector3::new(10e-6 * p.x, 0.0, 0.0)).collect();
//! let field = MeasuredField::new(points_m, errors_m, None)?;
//! let estimate = Trilinear::new(&field).at(&Vector3::new(0.5, 0.2, 0.9))?;
//! assert!((estimate.error_m - Vector3::new(5e-6, 0.0, 0.0)).norm() < 1e-12);
//! assert!(estimate.region.is_inside());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod cells;
mod error;
mod hull;
pub mod idw;
mod interpolator;
pub mod kriging;
mod lattice;
mod measured;
mod on_plane;
pub mod rbf;
mod samples;
pub mod scores;
mod step_choice;
pub mod table;
mod trilinear;

pub use cells::{Arrangement, Cells, Enclosure, Neighbours};
pub use error::{FieldError, MOST_INPUTS};
pub use hull::{Hull, Region};
pub use idw::Idw;
pub use interpolator::{Estimate, Interpolator, Unanswered};
pub use kriging::{Kriging, KrigingError};
pub use measured::{MeasuredField, Plane, SAME_POINT_M};
pub use on_plane::OnPlane;
pub use rbf::Rbf;
pub use samples::{POSITION, Samples, corners, place_of};
pub use step_choice::table_within;
pub use table::{Grid, Table};
pub use trilinear::Trilinear;
