//! Unpacks one chunk of an MCAP file: all its records, or an error.
//!
//! Place in the flow: whole chunk -> checked records -> [`super::reader`]. Nothing of a chunk is
//! used before all of it has been unpacked and its checksum compared, so that a damaged chunk
//! yields no message at all.
//!
//! Source: MCAP specification, "Chunk" (opcode 0x06).

use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::framing;

/// Longest record that is read; bounds the memory a damaged length can ask for.
pub(super) const RECORD_LIMIT: usize = 128 * 1024 * 1024;

/// The records of a chunk that matter here: schemas, channels and messages, in their order.
///
/// # Errors
/// When the chunk is damaged or compressed in an unknown way.
pub(super) fn records(body: &[u8]) -> Result<Vec<Record<'static>>, McapError> {
    framing::check(op::CHUNK, body)?;
    let mut reader = LinearReader::new_with_options(
        LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_validate_chunk_crcs(true)
            .with_record_length_limit(RECORD_LIMIT),
    );
    let mut record = vec![op::CHUNK];
    record.extend((body.len() as u64).to_le_bytes());
    record.extend(body);
    let mut rest = record.as_slice();
    let mut records = Vec::new();
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(wanted) => {
                let (now, later) = rest.split_at(wanted.min(rest.len()));
                reader.insert(now.len()).copy_from_slice(now);
                // No bytes mean the end to the reader.
                reader.notify_read(now.len());
                rest = later;
            }
            LinearReadEvent::Record { data, opcode } => {
                if let Some(record) = parse(opcode, data)? {
                    records.push(record.into_owned());
                }
            }
        }
    }
    Ok(records)
}

/// Parses a record if it is one that matters here. The others are not even parsed: they carry
/// nothing that a message needs.
pub(super) fn parse(opcode: u8, data: &[u8]) -> Result<Option<Record<'_>>, McapError> {
    match opcode {
        op::SCHEMA | op::CHANNEL | op::MESSAGE => {
            framing::check(opcode, data)?;
            mcap::parse_record(opcode, data).map(Some)
        }
        _ => Ok(None),
    }
}
