//! Fields of volumetric error over the working volume.
//!
//! Place in the flow: measured error vectors in, the error at any other point out.
