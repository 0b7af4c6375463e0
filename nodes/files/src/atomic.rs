//! Output files that are there whole or not at all.
//!
//! Place in the flow: every file that Abbe writes goes through [`AtomicFile`]. On Linux the content grows in a
//! file without a name, so that an error, Ctrl-C or `kill -9` leaves nothing behind; it gets its name only when
//! it is complete and on the disk. Where the file system cannot do that, a named temporary file beside the target
//! takes its place, removed when the value is dropped, or by [`remove_unfinished`] where the program ends on request without
//! dropping its values. Bags, which others write by name, are made in a folder of their own and end with [`put_in_place`].

use crate::error::{FileError, Place};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use tempfile::{Builder, NamedTempFile};

const BUFFER_BYTES: usize = 1 << 16;

/// Files and folders with a name that are not finished.
static UNFINISHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Notes a file or folder under a temporary name for as long as this lives.
#[derive(Debug)]
pub struct Unfinished(PathBuf);

impl Unfinished {
    /// Notes this one.
    pub fn new(path: &Path) -> Unfinished {
        UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner).insert(path.to_owned());
        Unfinished(path.to_owned())
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner).remove(&self.0);
    }
}

/// Removes what is not finished, just before the program ends. Nothing can be told any more of what cannot be removed.
pub fn remove_unfinished() {
    for path in UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner).iter() {
        let _ = if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
    }
}

/// A file in the making.
#[derive(Debug)]
pub struct AtomicFile {
    writer: BufWriter<Storage>,
    target: PathBuf,
    file: String,
}

impl AtomicFile {
    /// Begins the file that shall replace `path`, in the same folder; what is at `path` stays until
    /// [`AtomicFile::commit`].
    pub fn create(path: &Path) -> Result<AtomicFile, FileError> {
        let file = path.display().to_string();
        let target = resolve(path, &file)?;
        let storage = Storage::create(folder(&target)).map_err(FileError::io(&file, "create the file"))?;
        Ok(AtomicFile { writer: BufWriter::with_capacity(BUFFER_BYTES, storage), target, file })
    }

    /// Brings everything to the disk and puts the file in its place.
    pub fn commit(self) -> Result<(), FileError> {
        let AtomicFile { writer, target, file } = self;
        let storage = writer.into_inner().map_err(|error| FileError::io(&file, "write")(error.into_error()))?;
        storage.publish(&target).map_err(FileError::io(&file, "put the finished file in its place"))
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.writer.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.writer.flush()
    }
}

/// Writes a whole file at once.
pub fn write_atomically(path: &Path, content: &[u8]) -> Result<(), FileError> {
    let mut output = AtomicFile::create(path)?;
    output.write_all(content).map_err(FileError::io(&path.display().to_string(), "write"))?;
    output.commit()
}

/// Brings a finished file, or a folder with all that is in it, to the disk and gives it its name; both lie in one file system.
pub fn put_in_place(finished: &Path, target: &Path) -> Result<(), FileError> {
    let publish = || {
        bring_to_disk(finished)?;
        std::fs::rename(finished, target)?;
        sync_folder(folder(target))
    };
    publish().map_err(FileError::io(&target.display().to_string(), "put what is finished in its place"))
}

fn bring_to_disk(path: &Path) -> std::io::Result<()> {
    if !path.is_dir() {
        // Windows brings to the disk only what it may write.
        return File::options().write(true).open(path)?.sync_all();
    }
    for entry in std::fs::read_dir(path)? {
        bring_to_disk(&entry?.path())?;
    }
    sync_folder(path)
}

/// Names are on the disk only once their folder is. Windows opens no folder as a file.
fn sync_folder(folder: &Path) -> std::io::Result<()> {
    #[cfg(unix)]
    File::open(folder)?.sync_all()?;
    #[cfg(not(unix))]
    let _ = folder;
    Ok(())
}

/// Follows links, so that what they point to is replaced, and refuses what is no file (`/dev/null` would be
/// replaced by one).
fn resolve(path: &Path, file: &str) -> Result<PathBuf, FileError> {
    match std::fs::metadata(path) {
        Ok(metadata) if metadata.is_file() => path.canonicalize().map_err(FileError::io(file, "resolve the path")),
        Ok(_) => {
            let remedy = "name a file, or write - for the standard output where the command allows it";
            Err(FileError::content(Place::file(file), "this exists and is not a regular file", remedy))
        }
        Err(_) => Ok(path.to_owned()),
    }
}

fn folder(target: &Path) -> &Path {
    match target.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Where the content is until it is complete.
#[derive(Debug)]
enum Storage {
    #[cfg(target_os = "linux")]
    Unnamed(File),
    Named {
        file: NamedTempFile,
        _unfinished: Unfinished,
    },
}

impl Storage {
    fn create(folder: &Path) -> std::io::Result<Storage> {
        #[cfg(target_os = "linux")]
        {
            use rustix::fs::{Mode, OFlags};
            let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
            if let Ok(file) = rustix::fs::open(folder, flags, Mode::from_raw_mode(0o666)) {
                return Ok(Storage::Unnamed(file.into()));
            }
        }
        Storage::named(folder)
    }

    fn named(folder: &Path) -> std::io::Result<Storage> {
        let file = named(folder)?;
        let unfinished = Unfinished::new(file.path());
        Ok(Storage::Named { file, _unfinished: unfinished })
    }

    fn file(&mut self) -> &mut File {
        match self {
            #[cfg(target_os = "linux")]
            Storage::Unnamed(file) => file,
            Storage::Named { file, .. } => file.as_file_mut(),
        }
    }

    fn publish(mut self, target: &Path) -> std::io::Result<()> {
        self.file().sync_all()?;
        match self {
            #[cfg(target_os = "linux")]
            Storage::Unnamed(file) => link(&file, folder(target))?.persist(target).map_err(|error| error.error)?,
            Storage::Named { file, .. } => file.persist(target).map(drop).map_err(|error| error.error)?,
        }
        sync_folder(folder(target))
    }
}

impl Write for Storage {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.file().write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file().flush()
    }
}

fn builder() -> Builder<'static, 'static> {
    let mut builder = Builder::new();
    builder.prefix(".abbe-").suffix(".partial");
    builder
}

fn named(folder: &Path) -> std::io::Result<NamedTempFile> {
    let builder = &mut builder();
    #[cfg(unix)]
    let builder = builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666)); // less the umask, as any new file
    builder.tempfile_in(folder)
}

/// Gives a nameless file a temporary name: a link cannot replace an existing file, a rename can.
#[cfg(target_os = "linux")]
fn link(file: &File, folder: &Path) -> std::io::Result<NamedTempFile<()>> {
    use rustix::fs::{AtFlags, CWD, linkat};
    use std::os::fd::AsRawFd;
    let source = format!("/proc/self/fd/{}", file.as_raw_fd());
    builder().make_in(folder, |path| Ok(linkat(CWD, source.as_str(), CWD, path, AtFlags::SYMLINK_FOLLOW)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn names(folder: &Path) -> Vec<String> {
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn nothing_is_there_before_the_commit_and_everything_after() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.csv");
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(&vec![b'a'; 3 * BUFFER_BYTES]).unwrap();
        assert!(!path.exists());
        #[cfg(target_os = "linux")]
        if matches!(file.writer.get_ref(), Storage::Unnamed(_)) {
            assert!(names(folder.path()).is_empty(), "a kill leaves nothing behind");
        }
        file.commit().unwrap();
        assert_eq!(fs::read(&path).unwrap().len(), 3 * BUFFER_BYTES);
        assert_eq!(names(folder.path()), ["out.csv"]);
    }

    #[test]
    fn a_dropped_file_leaves_the_old_one_and_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.csv");
        write_atomically(&path, b"old").unwrap();
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(&vec![b'b'; 3 * BUFFER_BYTES]).unwrap();
        drop(file);
        assert_eq!((fs::read(&path).unwrap(), names(folder.path()).len()), (b"old".to_vec(), 1));
        write_atomically(&path, b"new").unwrap();
        assert_eq!((fs::read(&path).unwrap(), names(folder.path()).len()), (b"new".to_vec(), 1));
    }

    #[test]
    fn a_named_temporary_file_does_the_same_where_nameless_ones_cannot_be() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("out.csv");
        let mut storage = Storage::named(folder.path()).unwrap();
        storage.write_all(b"text").unwrap();
        assert!(!target.exists());
        storage.publish(&target).unwrap();
        assert_eq!((fs::read(&target).unwrap(), names(folder.path()).len()), (b"text".to_vec(), 1));
        drop(Storage::named(folder.path()).unwrap());
        assert_eq!(names(folder.path()).len(), 1);
        // Where the program ends without dropping it, it is removed beforehand.
        let unfinished = Storage::named(folder.path()).unwrap();
        let bag = folder.path().join("bag");
        fs::create_dir_all(bag.join("inside")).unwrap();
        let of_bag = Unfinished::new(&bag);
        assert_eq!(names(folder.path()).len(), 3);
        remove_unfinished();
        assert_eq!(names(folder.path()), ["out.csv"]);
        drop((unfinished, of_bag));
    }

    #[test]
    fn what_was_made_elsewhere_gets_its_place_with_all_that_is_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let [bag, file, target, missing] = ["bag", "one.mcap", "target", "none"].map(|name| folder.path().join(name));
        fs::create_dir_all(bag.join("inside")).unwrap();
        fs::write(bag.join("inside/0.mcap"), "records").unwrap();
        put_in_place(&bag, &target).unwrap();
        assert_eq!(fs::read(target.join("inside/0.mcap")).unwrap(), b"records");
        fs::write(&file, "records").unwrap();
        put_in_place(&file, &folder.path().join("two.mcap")).unwrap();
        let mut left = names(folder.path());
        left.sort();
        assert_eq!(left, ["target", "two.mcap"]);
        let error = put_in_place(&missing, &bag).unwrap_err().to_string();
        assert!(error.contains("bag") && error.contains("cannot put what is finished in its place"), "{error}");
    }

    #[test]
    fn folders_devices_and_missing_folders_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let device = cfg!(unix).then_some(Path::new("/dev/null"));
        for path in device.into_iter().chain([folder.path()]) {
            let error = AtomicFile::create(path).unwrap_err();
            assert!(error.to_string().contains("not a regular file"), "{}: {error}", path.display());
        }
        let error = AtomicFile::create(&folder.path().join("none/out.csv")).unwrap_err();
        assert!(error.to_string().contains("cannot create the file"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_and_what_it_points_to_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let [real, alias] = ["real.csv", "alias.csv"].map(|name| folder.path().join(name));
        fs::write(&real, "old").unwrap();
        std::os::unix::fs::symlink(&real, &alias).unwrap();
        write_atomically(&alias, b"new").unwrap();
        assert_eq!(fs::read(&real).unwrap(), b"new");
        assert!(fs::symlink_metadata(&alias).unwrap().is_symlink());
    }
}
