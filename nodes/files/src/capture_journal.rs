//! The journal of a capture: every reading on the disk before the next one is waited for.
//!
//! Place in the flow: `abbe capture` appends a line a reading, of JSON, and has it written to the disk; after Ctrl-C, a crash or a
//! power cut it reads them and goes on where it stopped. Half a line at the end is what was being written then, and is taken
//! off; anything else that is no entry is refused with its line. SI, stamps in ns. One capture at a time writes a journal.

use crate::error::{FileError, Place};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Version of the entries.
const VERSION: u32 = 1;

/// What a journal is about: one of another capture is not gone on with.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JournalHead {
    /// Version of the entries.
    pub version: u32,
    /// Name of the machine.
    pub machine: String,
    /// SHA-256 of the machine file.
    pub machine_sha256: String,
    /// SHA-256 of points and stations of the plan.
    pub plan_sha256: String,
    /// SHA-256 of what tells readings and offsets: drivers and machine frame.
    pub sources_sha256: String,
    /// What wrote it.
    pub software: String,
}

impl JournalHead {
    /// A head of this version.
    pub fn new(
        machine: &str,
        [machine_sha256, plan_sha256, sources_sha256]: [String; 3],
        software: &str,
    ) -> JournalHead {
        let (machine, software) = (machine.to_owned(), software.to_owned());
        JournalHead { version: VERSION, machine, machine_sha256, plan_sha256, sources_sha256, software }
    }

    /// What is not the same, in words; `None` where it is the same capture.
    fn differs(&self, other: &JournalHead) -> Option<String> {
        if self.version != other.version {
            return Some(format!("it is of version {}, and this program writes {}", self.version, other.version));
        }
        if self.machine != other.machine {
            return Some(format!("it is of machine {}, and this is {}", self.machine, other.machine));
        }
        let parts = [
            (self.machine_sha256 != other.machine_sha256, "the machine file"),
            (self.plan_sha256 != other.plan_sha256, "the plan"),
            (self.sources_sha256 != other.sources_sha256, "what tells readings and offsets (scale, tracer or offsets)"),
        ];
        let changed: Vec<&str> = parts.iter().filter(|(is, _)| *is).map(|(_, what)| *what).collect();
        (!changed.is_empty()).then(|| format!("since it was begun {} changed", changed.join(" and ")))
    }
}

/// A point as it was captured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Captured {
    /// Place in the plan, from 0.
    pub point: usize,
    /// Number of the tracer's zero at this station, from 0: it counts interruptions of the beam.
    pub zero: u32,
    /// The middle of the standstill (ns).
    pub stamp_ns: i64,
    /// Mean of the scales (m).
    pub reading_m: [f64; 3],
    /// Reflector (m, ram frame).
    pub offset_m: [f64; 3],
    /// Mean length (m).
    pub length_m: f64,
    /// Standard uncertainty of the mean of the scales by their scatter (m).
    pub u_reading_m: [f64; 3],
    /// The same of the length (m).
    pub u_length_m: f64,
    /// Standard deviation of a single length (m).
    pub scatter_m: f64,
    /// How many lengths, and how many of them are worth as much as independent ones.
    pub lengths: usize,
    /// Independent lengths that are worth as much.
    pub effective: f64,
    /// How long the machine stood (s).
    pub stood_s: f64,
    /// What was logged, in the unit of its name.
    pub covariates: BTreeMap<String, f64>,
    /// Measured less expected length (m), and the standard uncertainty of that; nothing where nothing was expected.
    pub off_m: Option<(f64, f64)>,
}

/// A line of the journal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "entry", rename_all = "snake_case", deny_unknown_fields)]
pub enum JournalEntry {
    /// The first line.
    Begun(JournalHead),
    /// A reading.
    Taken(Captured),
    /// A reading that does not agree with those before, and why. It counts once its zero is found to be new.
    Doubted {
        /// The reading.
        reading: Captured,
        /// Why.
        why: String,
    },
    /// Doubted readings that count from another zero of the tracer.
    Zero {
        /// Name of the station.
        station: String,
        /// Number of the zero.
        zero: u32,
        /// Points whose doubted reading counts from it.
        points: Vec<usize>,
        /// What is known of it.
        why: String,
    },
    /// Doubted readings that do not count: their points are to be measured again.
    Dismissed {
        /// Their points.
        points: Vec<usize>,
        /// Why.
        why: String,
    },
    /// The tracer was moved, or the reflector: somebody said so.
    SetUp {
        /// Number of the set-up in the plan, from 0.
        set_up: usize,
        /// When (ns).
        stamp_ns: i64,
    },
}

/// A journal that is being written.
#[derive(Debug)]
pub struct CaptureJournal {
    file: File,
    name: String,
}

impl CaptureJournal {
    /// Begins a journal, or goes on with the one that is there; gives what it holds already, and whether half a line was taken off.
    ///
    /// # Errors
    /// A journal of another capture, one that somebody else is writing, a line that is no entry.
    pub fn open(path: &Path, head: &JournalHead) -> Result<(CaptureJournal, Vec<JournalEntry>, bool), FileError> {
        let name = path.display().to_string();
        let options = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path);
        let mut file = options.map_err(FileError::io(&name, "open the journal"))?;
        file.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => FileError::content(
                Place::file(&name),
                "another capture is writing it",
                "end that one first, or name another folder with --out",
            ),
            TryLockError::Error(other) => FileError::io(&name, "keep the journal for this capture alone")(other),
        })?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(FileError::io(&name, "read the journal"))?;
        let whole = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
        let entries = entries_of(&bytes[..whole], &name)?;
        let mut journal = CaptureJournal { file, name };
        journal.take_off(whole as u64)?;
        match entries.first() {
            None => {
                journal.append(&JournalEntry::Begun(head.clone()))?;
                journal.keep_name(path)?;
            }
            Some(JournalEntry::Begun(begun)) => {
                if let Some(problem) = begun.differs(head) {
                    let remedy = "name another folder with --out, or give this one what it was begun with";
                    return Err(FileError::content(Place::file(&journal.name), problem, remedy));
                }
            }
            Some(_) => {
                let problem = "the first line does not say what it is about";
                let remedy = "give the journal as it was written, or name another folder with --out";
                return Err(FileError::content(Place::file(&journal.name).line(1), problem, remedy));
            }
        }
        Ok((journal, entries, whole < bytes.len()))
    }

    /// Appends an entry; it is on the disk when this returns.
    ///
    /// # Errors
    /// What the system says, such as a full disk.
    pub fn append(&mut self, entry: &JournalEntry) -> Result<(), FileError> {
        let mut line = serde_json::to_vec(entry).map_err(|error| {
            FileError::content(Place::file(&self.name), format!("a reading cannot be written: {error}"), "report this")
        })?;
        line.push(b'\n');
        self.file.write_all(&line).map_err(FileError::io(&self.name, "write the journal"))?;
        self.file.sync_data().map_err(FileError::io(&self.name, "bring the journal to the disk"))
    }

    /// Takes off what follows the last whole line.
    fn take_off(&mut self, whole: u64) -> Result<(), FileError> {
        self.file.set_len(whole).map_err(FileError::io(&self.name, "take half a line off the journal"))?;
        self.file.seek(SeekFrom::Start(whole)).map(drop).map_err(FileError::io(&self.name, "write the journal"))
    }

    /// The name of a file is on the disk only once its folder is.
    fn keep_name(&self, path: &Path) -> Result<(), FileError> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let synced = File::open(folder).and_then(|folder| folder.sync_all());
        synced.map_err(FileError::io(&self.name, "bring the journal to the disk"))
    }
}

fn entries_of(bytes: &[u8], name: &str) -> Result<Vec<JournalEntry>, FileError> {
    let lines = bytes.split_inclusive(|byte| *byte == b'\n').enumerate();
    lines
        .map(|(k, line)| {
            serde_json::from_slice(line).map_err(|error| {
                let remedy = "take the journal from a copy, or correct this line; what stands before it is whole";
                FileError::content(Place::file(name).line(k as u64 + 1), format!("is no entry: {error}"), remedy)
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn head() -> JournalHead {
        JournalHead::new("bridge", ["m", "p", "s"].map(str::to_owned), "abbe test")
    }

    fn captured(point: usize) -> Captured {
        Captured {
            point,
            zero: 0,
            stamp_ns: 1_700_000_000_123_456_789,
            reading_m: [0.1 + 0.2, -1.0 / 3.0, 1e-9],
            offset_m: [0.0, 0.0, -0.06],
            length_m: 0.7 / 3.0,
            u_reading_m: [1e-9; 3],
            u_length_m: 2e-8,
            scatter_m: 1e-7,
            lengths: 40,
            effective: 12.5,
            stood_s: 1.5,
            covariates: BTreeMap::from([("dir_x".to_owned(), 1.0)]),
            off_m: Some((1e-6, 2e-6)),
        }
    }

    fn refused(path: &Path, head: &JournalHead) -> String {
        CaptureJournal::open(path, head).unwrap_err().to_string()
    }

    #[test]
    fn what_is_appended_reads_back_to_the_bit_and_half_a_line_is_taken_off() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal.jsonl");
        let (mut journal, entries, cut) = CaptureJournal::open(&path, &head()).unwrap();
        assert!(entries.is_empty() && !cut);
        let all = [
            JournalEntry::Taken(captured(0)),
            JournalEntry::Doubted { reading: captured(1), why: "off".to_owned() },
            JournalEntry::Zero { station: "S1".to_owned(), zero: 1, points: vec![1], why: "jump".to_owned() },
            JournalEntry::Dismissed { points: vec![2], why: "alone".to_owned() },
            JournalEntry::SetUp { set_up: 1, stamp_ns: 5 },
        ];
        all.iter().for_each(|entry| journal.append(entry).unwrap());
        assert!(refused(&path, &head()).contains("another capture is writing it"));
        drop(journal);
        let whole = std::fs::read(&path).unwrap();
        for cut in 0..=40 {
            std::fs::write(&path, &whole[..whole.len() - cut]).unwrap();
            let (_, entries, was_cut) = CaptureJournal::open(&path, &head()).unwrap();
            assert_eq!(was_cut, cut > 0);
            assert_eq!(entries[1..], all[..if cut > 0 { 4 } else { 5 }]);
        }
        // Nothing is left of the half line: what is appended is a line of its own.
        let (mut journal, ..) = CaptureJournal::open(&path, &head()).unwrap();
        journal.append(&all[0]).unwrap();
        drop(journal);
        assert_eq!(CaptureJournal::open(&path, &head()).unwrap().1.len(), 6);
    }

    #[test]
    fn a_journal_of_something_else_is_refused_with_what_differs() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal.jsonl");
        drop(CaptureJournal::open(&path, &head()).unwrap());
        for (other, words) in [
            (JournalHead { plan_sha256: "q".to_owned(), ..head() }, "the plan changed"),
            (JournalHead { machine: "gantry".to_owned(), ..head() }, "it is of machine bridge, and this is gantry"),
            (JournalHead { machine_sha256: "n".to_owned(), ..head() }, "the machine file changed"),
            (JournalHead { sources_sha256: "t".to_owned(), ..head() }, "readings and offsets"),
        ] {
            let said = refused(&path, &other);
            assert!(said.contains(words) && said.contains("--out"), "{said}");
        }
        let good = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, format!("{good}{{\"entry\":\"taken\"}}\n")).unwrap();
        assert!(refused(&path, &head()).contains("line 2"), "{}", refused(&path, &head()));
        std::fs::write(&path, "{\"entry\":\"set_up\",\"set_up\":1,\"stamp_ns\":5}\n").unwrap();
        assert!(refused(&path, &head()).contains("does not say what it is about"));
        std::fs::write(&path, b"\xff\x00\n").unwrap();
        assert!(refused(&path, &head()).contains("line 1"));
    }
}
