//! Walks over a damaged MCAP file and finds everything in it that is provably whole.
//!
//! Place in the flow: bytes -> [`Salvage`] -> whole chunks and gaps -> [`super::recover()`]. A chunk is whole
//! when its records unpack and match its checksum. Its opcode and length are not needed for that: they may
//! be what is damaged. Where the chain of records is broken, the next whole chunk is looked for byte by
//! byte, so that damage costs the chunks it lies in and no others.

use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;

use mcap::records::{Record, op};

use super::{chunk, definitions, framing};

/// Opcode and length in front of a record.
const HEAD: usize = 9;

/// Bytes of a chunk before the length of its records, where its compression has the longest name.
const CHUNK_HEAD: usize = 8 + 8 + 8 + 4 + 4 + 4 + 8;

/// Bytes that are searched at once.
const WINDOW: usize = 1 << 20;

/// Bytes that are passed over where the disk cannot read.
const SECTOR: u64 = 4096;

/// Something found in a file.
#[derive(Debug)]
pub(super) enum Found {
    /// The records of a chunk that matches its checksum.
    Chunk(Vec<Record<'static>>),
    /// A record outside chunks, before any damage.
    Record(Record<'static>),
    /// The definition of a topic that matches its own checksum.
    Definition([Record<'static>; 2]),
    /// Bytes that belong to nothing whole, and what is wrong at their beginning.
    Gap { bytes: Range<u64>, reason: String },
}

/// What stands at a place.
enum Place {
    Chunk { records: Vec<Record<'static>>, next: u64 },
    Record { record: Option<Record<'static>>, next: u64 },
    Definition { records: [Record<'static>; 2], next: u64 },
    End,
    Damaged(String),
}

/// A walk over one file.
pub(super) struct Salvage<S> {
    source: S,
    length: u64,
    at: u64,
    /// Where the damage began that the walk is in, and what it is.
    gap: Option<(u64, String)>,
    damaged: bool,
    checksums: bool,
    /// Where the data end, and the checksum stated there.
    data_end: Option<(u64, u32)>,
    ended: bool,
}

impl<S: Read + Seek> Salvage<S> {
    /// Begins behind the magic, whether it is right or not.
    pub(super) fn new(mut source: S) -> std::io::Result<Salvage<S>> {
        let length = source.seek(SeekFrom::End(0))?;
        let mut salvage = Salvage {
            source,
            length,
            at: 0,
            gap: None,
            damaged: false,
            checksums: false,
            data_end: None,
            ended: false,
        };
        let magic = mcap::MAGIC.len() as u64;
        if salvage.bytes(0, mcap::MAGIC.len()).is_some_and(|bytes| bytes == mcap::MAGIC) {
            salvage.at = magic;
        } else {
            salvage.open_gap("does not begin as MCAP does".to_owned());
            salvage.at = salvage.next_chunk(0);
        }
        Ok(salvage)
    }

    /// The next thing in the file; nothing after its end.
    pub(super) fn next(&mut self) -> Option<Found> {
        while !self.ended {
            if self.at >= self.length {
                self.ended = true;
                self.open_gap("the file ends before its index, so its recording was not finished".to_owned());
                return self.close_gap();
            }
            match self.place(self.at) {
                Place::Chunk { records, next } => {
                    let gap = self.close_gap();
                    if gap.is_some() {
                        // The chunk is looked at again when the gap has been told.
                        return gap;
                    }
                    self.at = next;
                    return Some(Found::Chunk(records));
                }
                Place::End => {
                    let gap = self.close_gap();
                    if gap.is_some() {
                        return gap;
                    }
                    self.ended = true;
                    return None;
                }
                Place::Record { record, next } if self.gap.is_none() => {
                    self.at = next;
                    if let Some(record) = record.filter(|_| !self.damaged) {
                        return Some(Found::Record(record));
                    }
                }
                Place::Definition { records, next } if self.gap.is_none() => {
                    self.at = next;
                    return Some(Found::Definition(records));
                }
                Place::Record { .. } | Place::Definition { .. } => self.at = self.next_chunk(self.at + 1),
                Place::Damaged(reason) => {
                    self.open_gap(reason);
                    self.at = self.next_chunk(self.at + 1);
                }
            }
        }
        None
    }

    /// Whether the checksum over all that precedes the end of the data contradicts it; asked where messages have
    /// none of their own.
    pub(super) fn data_checksum_differs(&mut self) -> bool {
        let Some((end, stated)) = self.data_end.filter(|(_, stated)| *stated != 0) else { return false };
        let mut hasher = crc32fast::Hasher::new();
        let mut at = 0;
        while at < end {
            let count = usize::try_from(end - at).unwrap_or(usize::MAX).min(WINDOW);
            let Some(bytes) = self.bytes(at, count) else { return true };
            hasher.update(&bytes);
            at += count as u64;
        }
        hasher.finalize() != stated
    }

    fn open_gap(&mut self, reason: String) {
        self.damaged = true;
        self.gap.get_or_insert((self.at, reason));
    }

    fn close_gap(&mut self) -> Option<Found> {
        let (from, reason) = self.gap.take()?;
        Some(Found::Gap { bytes: from..self.at.min(self.length), reason })
    }

    fn place(&mut self, at: u64) -> Place {
        let damaged = |what: &str| Place::Damaged(what.to_owned());
        let Some(head) = self.bytes(at, HEAD) else { return damaged("the file ends in the middle of a record") };
        let opcode = head[0];
        let stated = u64::from_le_bytes([head[1], head[2], head[3], head[4], head[5], head[6], head[7], head[8]]);
        match self.chunk(at, opcode == op::CHUNK) {
            Ok(Some((records, next))) => return Place::Chunk { records, next },
            Ok(None) => {}
            Err(reason) => return Place::Damaged(reason),
        }
        let next = at.checked_add(HEAD as u64).and_then(|body| body.checked_add(stated));
        let Some(next) = next.filter(|next| *next <= self.length) else {
            return damaged("a record reaches beyond the end of the file");
        };
        if stated > chunk::RECORD_LIMIT as u64 {
            return damaged("a record is longer than any that is read");
        }
        let Some(body) = self.bytes(at + HEAD as u64, stated as usize) else {
            return damaged("the disk cannot read a record");
        };
        if opcode == op::FOOTER {
            let end = self.bytes(next, mcap::MAGIC.len());
            let ends = next + mcap::MAGIC.len() as u64 == self.length && end.is_some_and(|end| end == mcap::MAGIC);
            return if ends && body.len() == 20 { Place::End } else { damaged("the end of the file is damaged") };
        }
        if let (op::DATA_END, [a, b, c, d]) = (opcode, body.as_slice()) {
            self.data_end = Some((at, u32::from_le_bytes([*a, *b, *c, *d])));
        }
        match record(opcode, &body) {
            Ok(Some(Record::Metadata(metadata))) => match definitions::of_metadata(metadata) {
                Some(records) => Place::Definition { records, next },
                None => Place::Record { record: None, next },
            },
            Ok(record) => Place::Record { record, next },
            Err(reason) => Place::Damaged(reason),
        }
    }

    /// The chunk at a place: its records and what comes after it. `is_named`: its opcode says that it is one,
    /// so that it is an error if it is not whole.
    #[allow(clippy::type_complexity)] // one use
    fn chunk(&mut self, at: u64, is_named: bool) -> Result<Option<(Vec<Record<'static>>, u64)>, String> {
        let refused = |reason: &str| if is_named { Err(reason.to_owned()) } else { Ok(None) };
        let body = at + HEAD as u64;
        let room = usize::try_from(self.length.saturating_sub(body)).unwrap_or(usize::MAX).min(CHUNK_HEAD);
        let Some(shape) = self.bytes(body, room).and_then(|head| Shape::of(&head)) else {
            return refused("the head of a chunk is damaged");
        };
        let Some(next) = body.checked_add(shape.length).filter(|next| *next <= self.length) else {
            return refused("a chunk is cut off");
        };
        // Without a checksum only its place among whole records speaks for a chunk.
        if !shape.has_checksum && (!is_named || self.damaged || self.checksums) {
            return refused("a chunk has no checksum");
        }
        let Some(bytes) = self.bytes(body, shape.length as usize) else {
            return refused("the disk cannot read a chunk");
        };
        match chunk::records(&bytes) {
            Ok(records) => {
                self.checksums |= shape.has_checksum;
                Ok(Some((records, next)))
            }
            Err(error) => refused(&format!("a chunk is damaged: {error}")),
        }
    }

    /// Where the next thing begins that looks like a chunk; the end of the file without one.
    fn next_chunk(&mut self, from: u64) -> u64 {
        let mut from = from;
        while from < self.length {
            let wanted = usize::try_from(self.length - from).unwrap_or(usize::MAX).min(WINDOW);
            let Some(window) = self.bytes(from, wanted) else {
                let Some(readable) = self.readable(from, wanted) else {
                    from += SECTOR;
                    continue;
                };
                from = readable;
                continue;
            };
            let looks = |at: &usize| {
                window[*at] == op::CHUNK && window.get(at + HEAD..).is_some_and(|head| Shape::of(head).is_some())
            };
            if let Some(at) = (0..window.len()).find(looks) {
                return from + at as u64;
            }
            if wanted < WINDOW {
                break;
            }
            // A head that begins at the end of this window is seen whole in the next one.
            from += (wanted - HEAD - CHUNK_HEAD) as u64;
        }
        self.length
    }

    /// The first place from `from` on, within `wanted` bytes, where a sector can be read and was not before.
    fn readable(&mut self, from: u64, wanted: usize) -> Option<u64> {
        let places = (from + SECTOR..from + wanted as u64).step_by(SECTOR as usize);
        let mut places = places.skip_while(|at| self.bytes(*at, 1).is_none());
        places.next()
    }

    /// Bytes of the file; `None` where there are fewer or the disk cannot read them.
    fn bytes(&mut self, at: u64, count: usize) -> Option<Vec<u8>> {
        if at.checked_add(count as u64)? > self.length {
            return None;
        }
        self.source.seek(SeekFrom::Start(at)).ok()?;
        let mut bytes = vec![0; count];
        self.source.read_exact(&mut bytes).ok()?;
        Some(bytes)
    }
}

/// The record if it is one that matters here, checked to be as long as its content.
fn record(opcode: u8, body: &[u8]) -> Result<Option<Record<'static>>, String> {
    framing::check_whole(opcode, body)?;
    let record = match opcode {
        op::METADATA => framing::check(opcode, body).and_then(|()| mcap::parse_record(opcode, body)).map(Some),
        _ => chunk::parse(opcode, body),
    };
    record.map(|record| record.map(Record::into_owned)).map_err(|error| error.to_string())
}

/// What the head of a chunk says of it.
struct Shape {
    /// Bytes of the chunk, its own head included.
    length: u64,
    has_checksum: bool,
}

impl Shape {
    /// The shape of what looks like a chunk; the bytes begin with its first field.
    fn of(head: &[u8]) -> Option<Shape> {
        let number = |at: usize| Some(u64::from_le_bytes(head.get(at..at + 8)?.try_into().ok()?));
        let unpacked = number(16)?;
        let checksum = head.get(24..28)?;
        let compression = match head.get(28..32)? {
            [0, 0, 0, 0] => &head[32..32],
            [3, 0, 0, 0] => head.get(32..35)?,
            [4, 0, 0, 0] => head.get(32..36)?,
            _ => return None,
        };
        let packed = number(32 + compression.len())?;
        let plausible = match compression {
            b"" => packed == unpacked,
            b"lz4" | b"zstd" => packed > 0,
            _ => false,
        };
        let limit = chunk::RECORD_LIMIT as u64;
        (plausible && packed <= limit && unpacked <= limit)
            .then(|| Shape { length: 40 + compression.len() as u64 + packed, has_checksum: checksum != [0; 4] })
    }
}
