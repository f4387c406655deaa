use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{Error, ErrorKind, Result, Seek, SeekFrom, Write, copy};
use std::path::{Path, PathBuf};

use tempfile::{Builder, NamedTempFile, TempDir};

use super::fault::without_path;
use super::open::is_still_at;
use super::temporary::{LOCK, PREFIX, SUFFIX, Unfinished};

/// A file that replaces another one only when it is complete.
///
/// The content is written to a temporary file in the same folder, which is created exclusively
/// under a random name, so that a link planted there is never followed. [`AtomicFile::commit`]
/// renames it. If it is dropped without that, or after an error or a kill, the former content is
/// unchanged.
///
/// The temporary file stays locked while it is written. [`super::remove_leftovers`] recognises
/// files of killed processes by the missing lock.
#[derive(Debug)]
pub struct AtomicFile {
    file: NamedTempFile,
    target: PathBuf,
    _listed: Unfinished,
}

impl AtomicFile {
    /// Starts writing a file for `target`; its folder must exist.
    ///
    /// # Errors
    /// Fails if the folder is missing or not writable, or if something other than a regular file (a
    /// folder, a device) is at `target`.
    pub fn create(target: &Path) -> Result<Self> {
        if fs::metadata(target).is_ok_and(|found| !found.is_file()) {
            return Err(Error::new(
                ErrorKind::InvalidInput,
                "it is not a regular file",
            ));
        }
        let prefix = prefix_for(target)?;
        let make = || {
            builder(&prefix)
                .tempfile_in(folder_of(target))
                .map_err(without_path)
        };
        loop {
            let (file, listed) = Unfinished::create(make)?;
            if lock_new(file.as_file(), file.path()) {
                return Ok(Self {
                    file,
                    target: target.to_owned(),
                    _listed: listed,
                });
            }
        }
    }

    /// Returns the file under its temporary name.
    #[must_use]
    pub fn as_file(&mut self) -> &mut File {
        self.file.as_file_mut()
    }

    /// Flushes the file to disk and renames it to its target.
    ///
    /// # Errors
    /// Fails if the disk is full or the target cannot be written; the former content is kept.
    pub fn commit(self) -> Result<()> {
        self.file.as_file().sync_all()?;
        let folder = folder_of(&self.target).to_owned();
        self.file
            .persist(&self.target)
            .map_err(|failed| failed.error)?;
        sync_folder(&folder);
        Ok(())
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        self.file.as_file_mut().write(bytes)
    }

    fn flush(&mut self) -> Result<()> {
        self.file.as_file_mut().flush()
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        self.file.as_file_mut().seek(to)
    }
}

/// Replaces the content of the file at `target` by `bytes`, or leaves it unchanged.
///
/// See [`AtomicFile`].
///
/// # Errors
/// Same as [`AtomicFile::create`] and [`AtomicFile::commit`].
pub fn write(target: &Path, bytes: &[u8]) -> Result<()> {
    let mut file = AtomicFile::create(target)?;
    file.write_all(bytes)?;
    file.commit()
}

/// A folder for the output of another program before it is renamed; removed when dropped.
#[derive(Debug)]
pub struct WorkFolder {
    folder: TempDir,
    /// Locked while the folder is in use.
    _lock: File,
}

impl WorkFolder {
    /// Creates a work folder inside `folder`, under a random name.
    ///
    /// # Errors
    /// Fails if `folder` is missing or not writable.
    pub fn create(folder: &Path) -> Result<Self> {
        loop {
            let made = Builder::new()
                .prefix(PREFIX)
                .suffix(SUFFIX)
                .rand_bytes(12)
                .tempdir_in(folder);
            let folder = made.map_err(without_path)?;
            let path = folder.path().join(LOCK);
            let lock = File::create_new(&path)?;
            if lock_new(&lock, &path) {
                return Ok(Self {
                    folder,
                    _lock: lock,
                });
            }
        }
    }

    /// Returns the folder's path.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.folder.path()
    }
}

/// Locks a file that was just created; returns false if it is gone.
///
/// Until it is locked, another process may take it for one of a killed process and remove it. That
/// process holds the lock while it does, so a file that is still there once it is locked stays.
fn lock_new(file: &File, path: &Path) -> bool {
    // Some network file systems have no locks; there, leftovers are recognised by their name only.
    file.lock().is_err() || is_still_at(file, path)
}

/// Prefix of the temporary name of a file.
pub(super) fn prefix_for(target: &Path) -> Result<OsString> {
    let name = target
        .file_name()
        .ok_or_else(|| Error::new(ErrorKind::InvalidInput, "it has no file name"))?;
    let mut prefix = OsString::from(PREFIX);
    // Names may be as long as the file system allows; the temporary name needs room for more.
    prefix.push(name.to_string_lossy().chars().take(32).collect::<String>());
    prefix.push(".");
    Ok(prefix)
}

pub(super) fn folder_of(target: &Path) -> &Path {
    target
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."))
}

pub(super) fn builder(prefix: &OsString) -> Builder<'_, 'static> {
    let mut builder = Builder::new();
    builder.prefix(prefix).suffix(SUFFIX).rand_bytes(12);
    #[cfg(unix)]
    {
        // Permissions of an ordinary file, minus the process's umask; temporary files are private
        // by default.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    builder
}

/// Makes the rename durable, if the system supports it.
pub(super) fn sync_folder(folder: &Path) {
    #[cfg(unix)]
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
    #[cfg(not(unix))]
    let _ = folder;
}

/// Puts the content of the file `source` at `target`, replacing what is there.
///
/// `target` becomes a hard link, or a copy with the same modification time if the disk has no hard
/// links. The former content stays until that is done.
///
/// # Errors
/// Fails if the source is missing or `target` cannot be written.
pub fn link(source: &Path, target: &Path) -> Result<()> {
    let folder = folder_of(target);
    let linked =
        builder(&prefix_for(target)?).make_in(folder, |temporary| fs::hard_link(source, temporary));
    match linked {
        Ok(named) => {
            named.persist(target).map_err(|failed| failed.error)?;
            sync_folder(folder);
            Ok(())
        }
        Err(error) if error.kind() == ErrorKind::NotFound => Err(error),
        Err(_) => copy_to(source, target),
    }
}

fn copy_to(source: &Path, target: &Path) -> Result<()> {
    let mut read = File::open(source)?;
    let mut file = AtomicFile::create(target)?;
    copy(&mut read, &mut file)?;
    file.flush()?;
    file.as_file().set_modified(read.metadata()?.modified()?)?;
    file.commit()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect()
    }

    #[test]
    fn dropped_file_leaves_only_the_former_content() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a.txt");
        write(&target, b"first").unwrap();
        let mut second = AtomicFile::create(&target).unwrap();
        second.write_all(b"half").unwrap();
        assert_eq!(
            (fs::read(&target).unwrap(), names(folder.path()).len()),
            (b"first".to_vec(), 2)
        );
        drop(second);
        assert_eq!(
            (fs::read(&target).unwrap(), names(folder.path())),
            (b"first".to_vec(), vec!["a.txt".to_owned()])
        );
        write(&target, b"second").unwrap();
        assert_eq!(
            (fs::read(&target).unwrap(), names(folder.path()).len()),
            (b"second".to_vec(), 1)
        );
    }

    #[cfg(unix)]
    #[test]
    fn link_at_the_target_is_replaced_and_its_destination_is_unchanged() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let (photo, target) = (folder.path().join("photo"), folder.path().join("out"));
        fs::write(&photo, "photo").unwrap();
        symlink(&photo, &target).unwrap();
        write(&target, b"export").unwrap();
        assert_eq!(
            (fs::read(&photo).unwrap(), fs::read(&target).unwrap()),
            (b"photo".to_vec(), b"export".to_vec())
        );
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&photo), mode(&target));
    }

    #[test]
    fn folders_and_devices_are_rejected() {
        let folder = tempfile::tempdir().unwrap();
        assert!(write(folder.path(), b"x").is_err());
        assert!(write(&folder.path().join("missing/file"), b"x").is_err());
        #[cfg(unix)]
        assert!(
            write(Path::new("/dev/null"), b"x")
                .unwrap_err()
                .to_string()
                .contains("regular file")
        );
    }

    #[test]
    fn long_names_can_be_written() {
        let folder = tempfile::tempdir().unwrap();
        write(&folder.path().join("é".repeat(120)), b"x").unwrap();
        assert_eq!(names(folder.path()).len(), 1);
    }

    #[test]
    fn linked_and_copied_files_replace_the_former_content() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::write(path("source"), "points").unwrap();
        for (target, put) in [
            ("linked", link as fn(&Path, &Path) -> Result<()>),
            ("copied", copy_to),
        ] {
            fs::write(path(target), "before").unwrap();
            put(&path("source"), &path(target)).unwrap();
            assert_eq!(fs::read(path(target)).unwrap(), b"points");
            let modified = |name: &str| fs::metadata(path(name)).unwrap().modified().unwrap();
            assert_eq!(modified(target), modified("source"));
        }
        assert!(link(&path("missing"), &path("linked")).is_err());
        assert_eq!(
            (
                fs::read(path("linked")).unwrap(),
                fs::read_dir(folder.path()).unwrap().count()
            ),
            (b"points".to_vec(), 3)
        );
    }
}
