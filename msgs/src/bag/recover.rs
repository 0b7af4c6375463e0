//! Keeps what is readable of a bag that was cut off or damaged, and tells what is not.
//!
//! Place in the flow: damaged bag -> new, complete bag. Whole chunks are found wherever they lie
//! ([`super::salvage`]) and their messages are written anew, unchanged; what is missing is told by place,
//! time and, where an index of the bag survives, by number. Nothing is taken that does not match its
//! checksum, unless its file has no checksums.

use std::collections::BTreeSet;
use std::fmt;
use std::fs::File;
use std::io::{Read, Seek};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::records::Record;

use super::channels::{ChannelFault, Channels};
use super::index::{Index, Reading};
use super::reader::BagMessage;
use super::salvage::{Found, Salvage};
use super::{BagError, BagWriter, convert, metadata};

/// What a recovery saved, and what it could not.
#[derive(Debug)]
pub struct Recovery {
    /// Messages in the new bag.
    pub messages_saved: u64,
    /// Each file of the bag.
    pub files: Vec<FileRecovery>,
}

impl Recovery {
    /// Whether every message is in the new bag: each file is whole, or its index says so.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.files.iter().all(FileRecovery::is_complete)
    }

    /// Messages that are missing; `None` where nobody knows.
    #[must_use]
    pub fn messages_missing(&self) -> Option<u64> {
        // What a damaged metadata.yaml promises need not fit.
        self.files.iter().try_fold(0_u64, |sum, file| Some(sum.saturating_add(file.messages_missing()?)))
    }
}

/// What became of one file of a bag.
#[derive(Debug)]
pub struct FileRecovery {
    /// The file.
    pub path: PathBuf,
    /// Messages of it in the new bag.
    pub messages_saved: u64,
    /// Messages that it held when it was complete, where its index or the `metadata.yaml` says so.
    pub messages_named: Option<u64>,
    /// Chunks of it that are whole.
    pub chunks_saved: u64,
    /// Chunks that it held when it was complete, where its index says so.
    pub chunks_named: Option<u64>,
    /// What is wrong with it.
    pub faults: Vec<Fault>,
}

impl FileRecovery {
    /// Whether every message of it is in the new bag.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.messages_missing() == Some(0)
    }

    /// Messages that are missing; `None` where nobody knows.
    #[must_use]
    pub fn messages_missing(&self) -> Option<u64> {
        let uncertain = self.faults.iter().any(|fault| fault.is_uncertain);
        match self.messages_named {
            _ if uncertain => None,
            Some(named) => Some(named.saturating_sub(self.messages_saved)),
            None if self.faults.is_empty() => Some(0),
            None => None,
        }
    }
}

/// One place of a file that is damaged.
#[derive(Debug)]
pub struct Fault {
    /// Where in the file; `None` where it is the file as a whole.
    pub bytes: Option<Range<u64>>,
    /// What is wrong.
    pub reason: String,
    /// Log times (ns) of the last message saved before the damage and of the first one after it.
    pub between_ns: (Option<u64>, Option<u64>),
    /// Whether what was saved of the file may be wrong.
    is_uncertain: bool,
}

impl Fault {
    fn of_file(reason: String) -> Fault {
        Fault { bytes: None, reason, between_ns: (None, None), is_uncertain: false }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(bytes) = &self.bytes {
            write!(f, "bytes {} to {}: ", bytes.start, bytes.end)?;
        }
        f.write_str(&self.reason)?;
        let seconds = |ns: u64| format!("{}.{:09} s", ns / 1_000_000_000, ns % 1_000_000_000);
        match (&self.bytes, self.between_ns) {
            (None, _) | (_, (None, None)) => Ok(()),
            (_, (Some(before), None)) => write!(f, "; after {}", seconds(before)),
            (_, (None, Some(after))) => write!(f, "; before {}", seconds(after)),
            (_, (Some(before), Some(after))) => write!(f, "; between {} and {}", seconds(before), seconds(after)),
        }
    }
}

/// Writes every message of the bag at `input` that is provably whole to a new bag at `output`. A directory
/// needs no `metadata.yaml`.
///
/// # Errors
/// When `input` is no bag or not one message of it is whole, or `output` exists or cannot be written. Damage
/// in `input` is no error here; it is told in [`Recovery::files`].
pub fn recover(input: impl AsRef<Path>, output: impl AsRef<Path>) -> Result<Recovery, BagError> {
    let (input, output) = (input.as_ref(), output.as_ref());
    let mut writer: Option<BagWriter> = None;
    // The new bag begins with the first message, so that none is left of what holds nothing.
    let mut keep = |message: BagMessage| -> Result<(), BagError> {
        let writer = match &mut writer {
            Some(writer) => writer,
            None => writer.insert(BagWriter::create(output)?),
        };
        writer.copy(&message)
    };
    let mut files = Vec::new();
    for (path, named) in sources(input)? {
        let mut file = match File::open(&path) {
            Ok(source) => recover_from(&path, source, &mut keep)?,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => missing(&path),
            Err(error) => return Err(BagError::io(&path, "open the bag's file")(error)),
        };
        file.messages_named = file.messages_named.or(named);
        files.push(file);
    }
    let found_nothing = files.iter().all(|file| file.messages_saved == 0 && !file.faults.is_empty());
    if found_nothing {
        return Err(BagError::NotABag { path: input.to_owned(), reason: nothing_in(&files) });
    }
    let writer = match writer {
        Some(writer) => writer,
        None => BagWriter::create(output)?,
    };
    let messages_saved = writer.message_count();
    writer.finish()?;
    Ok(Recovery { messages_saved, files })
}

/// The files of a bag, those that only its `metadata.yaml` knows of included, with the messages that it names.
fn sources(input: &Path) -> Result<Vec<(PathBuf, Option<u64>)>, BagError> {
    let entry = std::fs::metadata(input).map_err(BagError::io(input, "open the bag"))?;
    if !entry.is_dir() {
        if entry.is_file() {
            convert::refuse_sqlite(input)?;
        }
        return Ok(vec![(input.to_owned(), None)]);
    }
    let found = metadata::numbered_files(input)?;
    if found.is_empty() {
        convert::refuse_unlisted(input)?;
        return Err(BagError::NotABag {
            path: input.to_owned(),
            reason: "the directory holds no .mcap file; name the directory of the recording".to_owned(),
        });
    }
    let mut named = metadata::promises(input);
    for path in found {
        named.entry(path).or_insert(None);
    }
    // By path already, which decides among equal numbers.
    let mut files: Vec<_> = named.into_iter().collect();
    files.sort_by_key(|(path, _)| metadata::split_number(path));
    Ok(files)
}

fn missing(path: &Path) -> FileRecovery {
    let fault = Fault::of_file("the file is missing, although metadata.yaml names it".to_owned());
    FileRecovery { faults: vec![fault], ..FileRecovery::new(path) }
}

/// Why nothing was saved, and what to do.
fn nothing_in(files: &[FileRecovery]) -> String {
    let reasons: BTreeSet<&str> = files.iter().flat_map(|file| &file.faults).map(|f| f.reason.as_str()).collect();
    let reasons: Vec<&str> = reasons.into_iter().collect();
    format!(
        "not one whole message is in it ({}), so there is nothing to recover; name a .mcap file or the directory of a \
         rosbag2 recording",
        reasons.join("; ")
    )
}

impl FileRecovery {
    fn new(path: &Path) -> FileRecovery {
        FileRecovery {
            path: path.to_owned(),
            messages_saved: 0,
            messages_named: None,
            chunks_saved: 0,
            chunks_named: None,
            faults: Vec::new(),
        }
    }
}

/// Hands every message of one `.mcap` that is provably whole to `keep`; `name` stands for it in errors.
///
/// # Errors
/// When the source cannot be read at all, a topic is not ROS 2 in CDR, or `keep` fails.
pub fn recover_from<S: Read + Seek>(
    name: &Path,
    mut source: S,
    mut keep: impl FnMut(BagMessage) -> Result<(), BagError>,
) -> Result<FileRecovery, BagError> {
    let mut state = State::new(name);
    if source.seek(std::io::SeekFrom::End(0)).map_err(BagError::io(name, "read the bag"))? == 0 {
        state.file.faults.push(Fault::of_file("the file is empty".to_owned()));
        return Ok(state.file);
    }
    match Index::read(&mut source) {
        Reading::Whole(index) => {
            (state.file.messages_named, state.file.chunks_named) = (index.messages, index.chunks);
            for definition in index.definitions {
                // One that contradicts itself defines nothing.
                let _ = state.channels.define(definition);
            }
        }
        Reading::Contradicted => {
            let reason = "the index at its end does not match the file, so nobody knows whether messages are missing";
            state.file.faults.push(Fault::of_file(reason.to_owned()));
        }
        Reading::None => {}
    }
    let mut salvage = Salvage::new(source).map_err(BagError::io(name, "read the bag"))?;
    while let Some(found) = salvage.next() {
        match found {
            Found::Chunk(records) => {
                state.file.chunks_saved += 1;
                state.take(records, &mut keep)?;
            }
            Found::Record(record) => {
                state.unchecked += u64::from(matches!(record, Record::Message { .. }));
                state.take(vec![record], &mut keep)?;
            }
            Found::Definition(records) => state.take(records.into(), &mut keep)?,
            Found::Gap { bytes, reason } => state.file.faults.push(Fault {
                bytes: Some(bytes),
                reason,
                between_ns: (state.last_ns, None),
                is_uncertain: false,
            }),
        }
    }
    if state.unchecked > 0 && salvage.data_checksum_differs() {
        let reason = format!(
            "{} messages have no checksum of their own, and that of the file does not match: any of them may be wrong",
            state.unchecked
        );
        state.file.faults.push(Fault { is_uncertain: true, ..Fault::of_file(reason) });
    }
    Ok(state.file)
}

/// How far the recovery of a file has come.
struct State {
    path: Arc<Path>,
    file: FileRecovery,
    channels: Channels,
    last_ns: Option<u64>,
    /// Messages outside chunks.
    unchecked: u64,
    /// Whether it has been told that definitions of topics are lost.
    told_undefined: bool,
}

impl State {
    fn new(path: &Path) -> State {
        State {
            path: path.into(),
            file: FileRecovery::new(path),
            channels: Channels::default(),
            last_ns: None,
            unchecked: 0,
            told_undefined: false,
        }
    }

    /// Takes the records of a chunk, in their order.
    fn take(
        &mut self,
        records: Vec<Record<'static>>,
        keep: &mut impl FnMut(BagMessage) -> Result<(), BagError>,
    ) -> Result<(), BagError> {
        for record in records {
            let Record::Message { header, data } = record else {
                if let Err(error) = self.channels.define(record) {
                    self.file.faults.push(Fault::of_file(error.to_string()));
                }
                continue;
            };
            let channel = match self.channels.of(&header, &self.path) {
                Ok(channel) => channel,
                Err(ChannelFault::Unusable(error)) => return Err(error),
                Err(ChannelFault::Unknown(_)) => {
                    self.undefined();
                    continue;
                }
            };
            for fault in self.file.faults.iter_mut().filter(|fault| fault.bytes.is_some()) {
                fault.between_ns.1.get_or_insert(header.log_time);
            }
            self.last_ns = Some(header.log_time);
            let index = self.file.messages_saved;
            keep(BagMessage::new(header.log_time, data.into_owned(), index, channel, &self.path))?;
            self.file.messages_saved += 1;
        }
        Ok(())
    }

    /// Tells once that whole messages cannot be saved, because what says their topic is lost.
    fn undefined(&mut self) {
        if !std::mem::replace(&mut self.told_undefined, true) {
            let reason = "the definition of a topic is lost, and with it the messages on that topic";
            self.file.faults.push(Fault::of_file(reason.to_owned()));
        }
    }
}
