use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{Error, ErrorKind, Result, Seek, SeekFrom, Write, copy};
use std::path::{Path, PathBuf};

use tempfile::{Builder, NamedTempFile, TempDir};

use super::fault::without_path;
use super::temporary::{LOCK, PREFIX, SUFFIX, Unfinished};

/// A file that takes the place of another when it is complete.
///
/// The content goes to a temporary file in the same folder, created exclusively under a random name, so that a link which
/// somebody placed there is never followed. [`AtomicFile::commit`] renames it. Dropping it without that, an error or a kill
/// leaves the former content as it was. The temporary file stays locked while it is written: [`super::remove_leftovers`]
/// recognises those of killed processes by the missing lock.
#[derive(Debug)]
pub struct AtomicFile {
    file: NamedTempFile,
    target: PathBuf,
    _listed: Unfinished,
}

impl AtomicFile {
    /// Starts writing what will be at `target`. The folder must exist.
    ///
    /// # Errors
    /// When the folder is missing or not writable, or something other than a regular file (a folder, a device) is at
    /// `target`.
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
        let (file, listed) = Unfinished::create(make)?;
        // Some network file systems have no locks; there a leftover is only recognised by its name.
        let _ = file.as_file().try_lock();
        Ok(Self {
            file,
            target: target.to_owned(),
            _listed: listed,
        })
    }

    /// The file under its temporary name.
    #[must_use]
    pub fn as_file(&mut self) -> &mut File {
        self.file.as_file_mut()
    }

    /// Puts the file in its place, on the disk before it is renamed.
    ///
    /// # Errors
    /// When the disk is full or the place cannot be written; the former content stands.
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

/// Replaces the content of the file at `target` by `bytes`, or leaves it as it was; see [`AtomicFile`].
///
/// # Errors
/// As [`AtomicFile::create`] and [`AtomicFile::commit`].
pub fn write(target: &Path, bytes: &[u8]) -> Result<()> {
    let mut file = AtomicFile::create(target)?;
    file.write_all(bytes)?;
    file.commit()
}

/// A folder for what another program writes before it is renamed; it goes when dropped.
#[derive(Debug)]
pub struct WorkFolder {
    folder: TempDir,
    /// Locked while the folder is in use.
    _lock: File,
}

impl WorkFolder {
    /// Makes one inside `folder`, under a random name.
    ///
    /// # Errors
    /// When `folder` is missing or not writable.
    pub fn create(folder: &Path) -> Result<Self> {
        let made = Builder::new()
            .prefix(PREFIX)
            .suffix(SUFFIX)
            .rand_bytes(12)
            .tempdir_in(folder);
        let folder = made.map_err(without_path)?;
        let lock = File::create_new(folder.path().join(LOCK))?;
        let _ = lock.try_lock();
        Ok(Self {
            folder,
            _lock: lock,
        })
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.folder.path()
    }
}

/// How the temporary name of a file begins.
pub(super) fn prefix_for(target: &Path) -> Result<OsString> {
    let name = target
        .file_name()
        .ok_or_else(|| Error::new(ErrorKind::InvalidInput, "it has no file name"))?;
    let mut prefix = OsString::from(PREFIX);
    // Names may be as long as the file system allows; the temporary one needs room for more.
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
        // What an ordinary file gets, less the process's umask; temporary files are private otherwise.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    builder
}

/// Makes the rename durable, where the system can.
pub(super) fn sync_folder(folder: &Path) {
    #[cfg(unix)]
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
    #[cfg(not(unix))]
    let _ = folder;
}

/// Puts the content of the file `source` at `target`, in the place of what is there: as a second name of the same file,
/// or as a copy with the same time where the disk has no hard links. What was at `target` stays until that is done.
///
/// # Errors
/// When the source is missing or `target` cannot be written.
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
    fn dropped_file_leaves_the_former_content_and_nothing_else() {
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
    fn link_at_the_target_is_replaced_and_what_it_leads_to_stays() {
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
    fn folders_and_devices_are_refused() {
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
    fn linked_and_copied_files_take_the_place_of_what_is_there() {
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
