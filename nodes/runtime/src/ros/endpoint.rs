//! Names of endpoints as the DDS library wants them, and why one cannot be opened.
//!
//! Place in the flow: below the node and its services, which open endpoints.

use ros2_client::Name;

use super::RosError;
use super::names::NameError;

pub(super) fn dds_name(name: &str) -> Result<Name, NameError> {
    Name::parse(name).map_err(|_| NameError { name: name.to_owned(), reason: "the DDS library refuses it" })
}

pub(super) fn endpoint_error(what: &'static str, name: &str, source: ros2_client::CreateError) -> RosError {
    RosError::Endpoint { what, name: name.to_owned(), source }
}
