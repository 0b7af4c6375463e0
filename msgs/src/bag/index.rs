//! The index at the end of an MCAP file, as far as it matches its checksum.
//!
//! Place in the flow: end of a file -> what it held when it was complete -> [`super::recover()`] tells what
//! is missing, and knows the topics although the chunk that defines them is lost.

use std::io::{Read, Seek, SeekFrom};

use mcap::records::{Record, op};

use super::{chunk, framing};

/// Record of the end: opcode, length, begin of the index, begin of its table, checksum; then the magic.
const FOOTER: u64 = 1 + 8 + 8 + 8 + 4;

/// What a file says that it holds.
#[derive(Debug, Default)]
pub(super) struct Index {
    /// Messages, where it says so.
    pub(super) messages: Option<u64>,
    /// Chunks, where it says so.
    pub(super) chunks: Option<u64>,
    /// Schemas and channels.
    pub(super) definitions: Vec<Record<'static>>,
}

/// What became of the index of a file.
#[derive(Debug)]
pub(super) enum Reading {
    /// It matches its checksum.
    Whole(Index),
    /// The end of the file names one, and it is not there or does not match: bytes of the file are wrong or missing.
    Contradicted,
    /// The end of the file names none that could be checked, or is not there itself.
    None,
}

impl Index {
    /// Reads the index.
    pub(super) fn read(source: &mut (impl Read + Seek)) -> Reading {
        Self::named(source).map_or(Reading::None, |index| index.map_or(Reading::Contradicted, Reading::Whole))
    }

    /// The index that the end of the file names; the inner one where it matches its checksum.
    fn named(source: &mut (impl Read + Seek)) -> Option<Option<Index>> {
        let length = source.seek(SeekFrom::End(0)).ok()?;
        let magic = mcap::MAGIC.len() as u64;
        let end = length.checked_sub(FOOTER + magic)?;
        let tail = bytes(source, end, FOOTER + magic)?;
        let number = |at: usize| Some(u64::from_le_bytes(tail.get(at..at + 8)?.try_into().ok()?));
        let is_footer = tail[0] == op::FOOTER && number(1)? == FOOTER - 9 && tail.ends_with(mcap::MAGIC);
        let begin = number(9)?;
        let checksum = u32::from_le_bytes(tail.get(25..29)?.try_into().ok()?);
        let is_named = is_footer && begin != 0 && checksum != 0;
        is_named.then(|| {
            let size = end.checked_sub(begin).filter(|size| *size <= chunk::RECORD_LIMIT as u64)?;
            let records = bytes(source, begin, size)?;
            let mut hasher = crc32fast::Hasher::new();
            hasher.update(&records);
            hasher.update(&tail[..25]);
            (hasher.finalize() == checksum).then(|| Index::of(&records)).flatten()
        })
    }

    fn of(mut rest: &[u8]) -> Option<Index> {
        let mut index = Index::default();
        while let [opcode, after @ ..] = rest {
            let (length, after) = after.split_at_checked(8)?;
            let length = usize::try_from(u64::from_le_bytes(length.try_into().ok()?)).ok()?;
            let (body, after) = after.split_at_checked(length)?;
            rest = after;
            if matches!(*opcode, op::SCHEMA | op::CHANNEL | op::STATISTICS) {
                framing::check_whole(*opcode, body).ok()?;
                framing::check(*opcode, body).ok()?;
                match mcap::parse_record(*opcode, body).ok()?.into_owned() {
                    Record::Statistics(counts) => {
                        index.messages = Some(counts.message_count);
                        index.chunks = Some(counts.chunk_count.into());
                    }
                    definition => index.definitions.push(definition),
                }
            }
        }
        Some(index)
    }
}

fn bytes(source: &mut (impl Read + Seek), at: u64, count: u64) -> Option<Vec<u8>> {
    source.seek(SeekFrom::Start(at)).ok()?;
    let mut bytes = vec![0; usize::try_from(count).ok()?];
    source.read_exact(&mut bytes).ok()?;
    Some(bytes)
}
