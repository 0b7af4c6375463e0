//! Checks the lengths inside MCAP records before the MCAP reader believes them.
//!
//! Place in the flow: raw record -> lengths checked -> [`super::chunk`] parses. The reader reserves
//! memory for whatever length a text claims, up to 4 GiB, and subtracts the lengths of records from
//! the rest of an uncompressed chunk unchecked; a damaged file must not get that far.
//!
//! Source: MCAP specification, "Records" (strings and maps have 32-bit lengths in bytes).

use mcap::McapError;
use mcap::records::op;

/// Walks over the bytes of a record.
struct Walk<'a> {
    rest: &'a [u8],
}

impl<'a> Walk<'a> {
    fn take(&mut self, count: u64) -> Result<&'a [u8], McapError> {
        let split = usize::try_from(count).ok().and_then(|count| self.rest.split_at_checked(count));
        let (taken, rest) = split.ok_or(McapError::UnexpectedEoc)?;
        self.rest = rest;
        Ok(taken)
    }

    fn u32(&mut self) -> Result<u64, McapError> {
        let mut number = [0; 4];
        number.copy_from_slice(self.take(4)?);
        Ok(u32::from_le_bytes(number).into())
    }

    fn u64(&mut self) -> Result<u64, McapError> {
        let mut number = [0; 8];
        number.copy_from_slice(self.take(8)?);
        Ok(u64::from_le_bytes(number))
    }

    /// A text or a block of bytes: 32-bit length, then that many bytes.
    fn text(&mut self) -> Result<&'a [u8], McapError> {
        let length = self.u32()?;
        self.take(length)
    }
}

/// Checks the lengths inside a record that is going to be parsed.
///
/// # Errors
/// When one reaches beyond the end of the record.
pub(super) fn check(opcode: u8, body: &[u8]) -> Result<(), McapError> {
    let mut walk = Walk { rest: body };
    match opcode {
        op::SCHEMA => {
            walk.take(2)?; // id
            walk.text()?; // name
            walk.text()?; // encoding
            walk.text()?; // definition
        }
        op::CHANNEL => {
            walk.take(4)?; // ids of channel and schema
            walk.text()?; // topic
            walk.text()?; // encoding
            let mut metadata = Walk { rest: walk.text()? };
            while !metadata.rest.is_empty() {
                metadata.text()?; // key
                metadata.text()?; // value, inside the map as well
            }
        }
        op::CHUNK => check_chunk(&mut walk)?,
        _ => {}
    }
    Ok(())
}

fn check_chunk(walk: &mut Walk<'_>) -> Result<(), McapError> {
    walk.take(8 + 8 + 8 + 4)?; // first and last time, uncompressed size and checksum
    let compression = walk.text()?;
    let size = walk.u64()?;
    let records = walk.take(size)?;
    if !compression.is_empty() {
        return Ok(());
    }
    let mut records = Walk { rest: records };
    while !records.rest.is_empty() {
        records.take(1)?; // opcode
        let length = records.u64()?;
        records.take(length)?;
    }
    Ok(())
}
