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

    /// A map of texts: its length in bytes, then keys and values inside it.
    fn map(&mut self) -> Result<(), McapError> {
        let mut entries = Walk { rest: self.text()? };
        while !entries.rest.is_empty() {
            entries.text()?;
            entries.text()?;
        }
        Ok(())
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
            walk.map()?;
        }
        op::METADATA => {
            walk.text()?; // name
            walk.map()?;
        }
        op::CHUNK => check_chunk(&mut walk)?,
        _ => {}
    }
    Ok(())
}

/// Checks that a record outside chunks fills its length exactly, as far as its kind says how long it is: a
/// damaged length must not lead past records that are whole.
///
/// # Errors
/// What is wrong with it, in words.
pub(super) fn check_whole(opcode: u8, body: &[u8]) -> Result<(), &'static str> {
    let fits = match opcode {
        op::HEADER => fills(body, |walk| walk.text().and_then(|_| walk.text())),
        op::SCHEMA => fills(body, |walk| {
            walk.take(2)?;
            walk.text()?;
            walk.text()?;
            walk.text()
        }),
        op::CHANNEL => fills(body, |walk| {
            walk.take(4)?;
            walk.text()?;
            walk.text()?;
            walk.text()
        }),
        op::MESSAGE => body.len() >= 22,
        op::MESSAGE_INDEX => fills(body, |walk| {
            walk.take(2)?;
            walk.text()
        }),
        op::ATTACHMENT => fills(body, |walk| {
            walk.take(16)?;
            walk.text()?;
            walk.text()?;
            let data = walk.u64()?;
            walk.take(data)?;
            walk.take(4)
        }),
        op::METADATA => fills(body, |walk| walk.text().and_then(|_| walk.text())),
        op::DATA_END => body.len() == 4,
        op::SUMMARY_OFFSET => body.len() == 17,
        op::CHUNK_INDEX => fills(body, |walk| {
            walk.take(32)?;
            walk.text()?; // a map as long as it says
            walk.take(8)?;
            walk.text()?;
            walk.take(16)
        }),
        op::STATISTICS => fills(body, |walk| {
            walk.take(8 + 2 + 4 * 4 + 16)?;
            walk.text()
        }),
        op::METADATA_INDEX => fills(body, |walk| {
            walk.take(16)?;
            walk.text()
        }),
        op::ATTACHMENT_INDEX => fills(body, |walk| {
            walk.take(40)?;
            walk.text()?;
            walk.text()
        }),
        _ => return Err("a record is of no known kind"),
    };
    if fits { Ok(()) } else { Err("a record is not as long as its content") }
}

fn fills<'a>(body: &'a [u8], fields: impl FnOnce(&mut Walk<'a>) -> Result<&'a [u8], McapError>) -> bool {
    let mut walk = Walk { rest: body };
    fields(&mut walk).is_ok() && walk.rest.is_empty()
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
