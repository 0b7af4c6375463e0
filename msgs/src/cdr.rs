//! CDR, the byte form of ROS 2 messages: a 4-byte encapsulation header and the fields.
//!
//! Place in the flow: between [`RosType`] values and the bytes of DDS and bags. Written is little
//! endian (`00 01 00 00`), byte for byte as ROS 2 writes it; read are both byte orders.
//!
//! Source: OMG Common Object Request Broker Architecture 3.3, part 2, section 9.3 (CDR); OMG
//! DDSI-RTPS 2.3, section 10.2 (encapsulation header).

use byteorder::{BigEndian, LittleEndian};
use thiserror::Error;

use crate::RosType;

const HEADER_SIZE: usize = 4;
const LITTLE_ENDIAN_HEADER: [u8; HEADER_SIZE] = [0, 1, 0, 0];

/// A writer may pad the payload to a multiple of four bytes.
const MAX_PADDING: usize = 3;

/// Bytes that are not the message they should be.
#[derive(Debug, Error)]
pub enum CdrError {
    /// Fewer bytes than a header.
    #[error("{bytes} bytes are too few for a CDR header of 4; the message was cut off")]
    NoHeader {
        /// Number of bytes.
        bytes: usize,
    },
    /// Another encoding than plain CDR.
    #[error(
        "encapsulation {identifier:#06x} is not plain CDR (0x0000 or 0x0001); have the sender use \
         XCDR version 1"
    )]
    Encapsulation {
        /// The first two bytes, big endian.
        identifier: u16,
    },
    /// The bytes end early or a field cannot be what it says.
    #[error("not a {ros_type}: {source}; check that sender and receiver use the same .msg files")]
    Decode {
        /// Full name of the message.
        ros_type: &'static str,
        /// Why.
        source: cdr_encoding::Error,
    },
    /// Bytes left over.
    #[error(
        "{extra} bytes follow the end of a {ros_type}; check that sender and receiver use the same \
         .msg files"
    )]
    TrailingBytes {
        /// Full name of the message.
        ros_type: &'static str,
        /// Number of bytes left over.
        extra: usize,
    },
    /// The message cannot be written.
    #[error("{ros_type} cannot be written as CDR: {source}")]
    Encode {
        /// Full name of the message.
        ros_type: &'static str,
        /// Why.
        source: cdr_encoding::Error,
    },
}

/// The bytes of a message, header included.
///
/// # Errors
/// When the serialiser refuses a field, which no message of this crate makes it do.
pub fn encode<R: RosType>(ros: &R) -> Result<Vec<u8>, CdrError> {
    let mut bytes = LITTLE_ENDIAN_HEADER.to_vec();
    cdr_encoding::to_writer::<R, LittleEndian, _>(&mut bytes, ros)
        .map_err(|source| CdrError::Encode { ros_type: R::ROS_TYPE, source })?;
    Ok(bytes)
}

/// The message of these bytes, header included.
///
/// # Errors
/// When the bytes are cut off, in another encoding, or not this message.
pub fn decode<R: RosType>(bytes: &[u8]) -> Result<R, CdrError> {
    let Some((header, payload)) = bytes.split_first_chunk::<HEADER_SIZE>() else {
        return Err(CdrError::NoHeader { bytes: bytes.len() });
    };
    // The last two bytes of the header are options without meaning for plain CDR.
    let decoded = match u16::from_be_bytes([header[0], header[1]]) {
        0 => cdr_encoding::from_bytes::<R, BigEndian>(payload),
        1 => cdr_encoding::from_bytes::<R, LittleEndian>(payload),
        identifier => return Err(CdrError::Encapsulation { identifier }),
    };
    let (ros, used) = decoded.map_err(|source| CdrError::Decode { ros_type: R::ROS_TYPE, source })?;
    let extra = payload.len().saturating_sub(used);
    if extra > MAX_PADDING {
        return Err(CdrError::TrailingBytes { ros_type: R::ROS_TYPE, extra });
    }
    Ok(ros)
}
