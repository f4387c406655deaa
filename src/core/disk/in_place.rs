use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{Error, ErrorKind, Result};
use std::path::Path;

use super::open::is_same_file;
use super::write;

/// Opens a file that is changed in place, such as a journal, for reading and writing.
///
/// The file is created if it is missing. Links and anything that is not a regular file are rejected
/// without following or waiting for them. A file with further names on the disk (hard links) is
/// first replaced by a copy of its own, so that only the file at `path` changes.
///
/// # Errors
/// Fails if the file is a link or not regular, or cannot be opened or copied.
pub fn open_in_place(path: &Path) -> Result<File> {
    let found = match fs::symlink_metadata(path) {
        // Exclusive creation does not follow links either.
        Err(error) if error.kind() == ErrorKind::NotFound => match options()
            .create_new(true)
            .open(path)
        {
            // Another process has created it in the meantime.
            Err(error) if error.kind() == ErrorKind::AlreadyExists => fs::symlink_metadata(path)?,
            opened => return opened,
        },
        found => found?,
    };
    check_regular(&found)?;
    if has_other_names(&found) {
        write(path, &fs::read(path)?)?;
    }
    let file = options().open(path)?;
    let now = fs::symlink_metadata(path)?;
    check_regular(&now)?;
    if is_same_file(&now, &file.metadata()?) {
        Ok(file)
    } else {
        Err(Error::other("it was replaced just now"))
    }
}

fn options() -> OpenOptions {
    let mut options = OpenOptions::new();
    options.read(true).write(true);
    options
}

fn check_regular(found: &Metadata) -> Result<()> {
    match found.file_type() {
        kind if kind.is_file() => Ok(()),
        kind if kind.is_symlink() => Err(Error::new(ErrorKind::InvalidInput, "it is a link")),
        _ => Err(Error::new(
            ErrorKind::InvalidInput,
            "it is not a regular file",
        )),
    }
}

#[cfg(unix)]
fn has_other_names(found: &Metadata) -> bool {
    std::os::unix::fs::MetadataExt::nlink(found) > 1
}

#[cfg(not(unix))]
fn has_other_names(_: &Metadata) -> bool {
    false
}

#[cfg(all(test, unix))]
mod tests {
    use std::io::Write;
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn only_the_file_of_this_name_changes() {
        let folder = tempfile::tempdir().unwrap();
        let (other, path) = (folder.path().join("other"), folder.path().join("journal"));
        fs::write(&other, "theirs").unwrap();
        fs::hard_link(&other, &path).unwrap();
        open_in_place(&path).unwrap().write_all(b"ours!!").unwrap();
        assert_eq!(
            (fs::read(&other).unwrap(), fs::read(&path).unwrap()),
            (b"theirs".to_vec(), b"ours!!".to_vec())
        );
        open_in_place(&path).unwrap().write_all(b"again!").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"again!");
    }

    #[test]
    fn file_created_by_several_threads_is_opened_by_all() {
        for _ in 0..50 {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("lock");
            std::thread::scope(|scope| {
                let opened: Vec<_> = (0..4)
                    .map(|_| scope.spawn(|| open_in_place(&path).map(drop)))
                    .collect();
                opened
                    .into_iter()
                    .for_each(|one| one.join().unwrap().unwrap());
            });
        }
    }

    #[test]
    fn links_and_pipes_are_rejected_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::write(path("other"), "theirs").unwrap();
        symlink(path("other"), path("link")).unwrap();
        symlink(path("missing"), path("dangling")).unwrap();
        assert!(
            std::process::Command::new("mkfifo")
                .arg(path("pipe"))
                .status()
                .unwrap()
                .success()
        );
        for name in ["link", "dangling", "pipe", "."] {
            assert!(open_in_place(&path(name)).is_err(), "{name}");
        }
        assert!(!path("missing").exists() && fs::read(path("other")).unwrap() == b"theirs");
    }
}
