use std::ffi::OsStr;
use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The absolute path of the program `name` (without `.exe`) in the folders of `PATH`.
///
/// Empty and relative entries are skipped: they mean the current folder, which may hold files of a stranger.
#[must_use]
pub fn find(name: &str) -> Option<PathBuf> {
    find_in(&std::env::var_os("PATH")?, name)
}

fn find_in(folders: &OsStr, name: &str) -> Option<PathBuf> {
    let file = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    let folders = std::env::split_paths(folders).filter(|folder| folder.is_absolute());
    folders
        .map(|folder| folder.join(&file))
        .find(|path| is_executable(path))
}

#[cfg(unix)]
fn is_executable(path: &Path) -> bool {
    use std::os::unix::fs::PermissionsExt;
    path.metadata()
        .is_ok_and(|file| file.is_file() && file.permissions().mode() & 0o111 != 0)
}

#[cfg(not(unix))]
fn is_executable(path: &Path) -> bool {
    path.is_file()
}

/// A command that runs the program `name`, see [`find`].
///
/// # Errors
/// [`ErrorKind::NotFound`] where no absolute folder of `PATH` holds it.
pub fn command(name: &str) -> std::io::Result<Command> {
    let missing = || {
        Error::new(
            ErrorKind::NotFound,
            format!("no folder of the PATH holds `{name}`"),
        )
    };
    find(name).map(Command::new).ok_or_else(missing)
}

#[cfg(test)]
#[cfg(unix)]
mod tests {
    use super::*;
    use crate::programs::ChildProcess;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn only_absolute_folders_are_searched() {
        let folder = tempfile::tempdir().unwrap();
        let place = |name: &str, mode| {
            let path = folder.path().join(name);
            std::fs::write(&path, "").unwrap();
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
            path
        };
        let (tool, _) = (place("tool", 0o755), place("text", 0o644));
        let path = |entries: &str| {
            std::ffi::OsString::from(entries.replace('@', folder.path().to_str().unwrap()))
        };
        assert_eq!(find_in(&path(":.:relative:@"), "tool"), Some(tool));
        assert_eq!(find_in(&path("@"), "text"), None, "not executable");
        let here = std::env::current_dir().unwrap();
        let entry = here
            .read_dir()
            .unwrap()
            .flatten()
            .next()
            .unwrap()
            .file_name();
        assert_eq!(find_in(&path(":.:"), entry.to_str().unwrap()), None);
        assert!(
            ChildProcess::spawn(&mut Command::new("sh")).is_err(),
            "a bare name is not started"
        );
        assert!(command("no-program-of-this-name").is_err());
    }
}
