use std::fs::{self, File};
use std::io::{ErrorKind, Result, Write, copy};
use std::path::Path;

use super::AtomicFile;
use super::atomic::{builder, folder_of, prefix_for, sync_folder};

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
