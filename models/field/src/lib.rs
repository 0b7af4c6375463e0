//! Fields of volumetric error over the working volume.
//!
//! Place in the flow: error vectors measured at points (m, machine frame) in, the error at any other point out, with its
//! uncertainty where the method has one. [`cells`] says which measured points surround a target and whether the target
//! lies among them; every method is an [`Interpolator`]; [`table`] turns any of them, or a model, into a grid for a
//! controller. Error = actual − indicated. Pure numerics.

pub mod cells;
mod hull;
pub mod idw;
mod interpolator;
pub mod kriging;
mod lattice;
mod measured;
mod on_plane;
pub mod rbf;
pub mod scores;
mod step_choice;
pub mod table;
mod trilinear;

pub use cells::{Arrangement, Cells, Enclosure, Neighbours};
pub use hull::{Hull, Region};
pub use idw::Idw;
pub use interpolator::{Estimate, Interpolator, Unanswered};
pub use kriging::{Kriging, KrigingError};
pub use measured::{FieldError, MeasuredField, Plane, SAME_POINT_M};
pub use on_plane::OnPlane;
pub use rbf::Rbf;
pub use step_choice::table_within;
pub use table::{Grid, Table};
pub use trilinear::Trilinear;
