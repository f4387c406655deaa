//! Child processes, found in the folders of `PATH` and killed with this program.

use std::ffi::OsStr;
use std::io::{Error, ErrorKind, Result};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, ChildStdin, ChildStdout, Command, ExitStatus};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Returns the absolute path of the program `name` (without `.exe`) in the folders of `PATH`.
///
/// Empty and relative entries are skipped: they mean the current folder, whose files are not
/// trusted.
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

/// Returns a command that runs the program `name`; see [`find`].
///
/// # Errors
/// [`ErrorKind::NotFound`] if no absolute folder of `PATH` contains it.
pub fn command(name: &str) -> Result<Command> {
    let missing = || {
        Error::new(
            ErrorKind::NotFound,
            format!("no folder of the PATH holds `{name}`"),
        )
    };
    find(name).map(Command::new).ok_or_else(missing)
}

/// Programs that this process started and that may still run.
static RUNNING: Mutex<Vec<Arc<Mutex<Child>>>> = Mutex::new(Vec::new());

/// A program started by this process; killed when this is dropped, and by [`kill_children`].
#[derive(Debug)]
pub struct ChildProcess(Arc<Mutex<Child>>);

impl ChildProcess {
    /// Starts a program.
    ///
    /// # Errors
    /// Fails if it cannot be started. [`ErrorKind::NotFound`] if its program is not an absolute
    /// path, because the system would search the current folder too.
    pub fn spawn(command: &mut Command) -> Result<Self> {
        // Under the lock, so that a child that starts now does not escape `kill_children`.
        let mut running = running();
        if !Path::new(command.get_program()).is_absolute() {
            return Err(Error::new(
                ErrorKind::NotFound,
                "not found in the folders of the PATH",
            ));
        }
        let child = Arc::new(Mutex::new(command.spawn()?));
        running.push(Arc::clone(&child));
        Ok(Self(child))
    }

    /// Takes its standard input; returns it once, if it is piped.
    pub fn take_stdin(&self) -> Option<ChildStdin> {
        lock(&self.0).stdin.take()
    }

    /// Takes its standard output; returns it once, if it is piped.
    pub fn take_stdout(&self) -> Option<ChildStdout> {
        lock(&self.0).stdout.take()
    }

    /// Takes its standard error; returns it once, if it is piped.
    pub fn take_stderr(&self) -> Option<ChildStderr> {
        lock(&self.0).stderr.take()
    }

    /// Kills the program; does nothing if it has ended.
    ///
    /// # Errors
    /// Fails if the system refuses.
    pub fn kill(&self) -> Result<()> {
        lock(&self.0).kill()
    }

    /// Waits until the program ends.
    ///
    /// Read its output before, or kill it: while this waits, [`kill_children`] skips it.
    ///
    /// # Errors
    /// Fails if the system does not report the exit status.
    pub fn wait(&self) -> Result<ExitStatus> {
        lock(&self.0).wait()
    }
}

impl Drop for ChildProcess {
    fn drop(&mut self) {
        running().retain(|child| !Arc::ptr_eq(child, &self.0));
        let _ = self.kill();
        let _ = self.wait();
    }
}

/// Kills every program that this process started.
///
/// Only for a process that exits right after: no thread can start another program from then on.
pub fn kill_children() {
    let running = running();
    for child in running.iter() {
        // A program that is being waited for is about to end by itself.
        if let Ok(mut child) = child.try_lock() {
            let _ = child.kill();
        }
    }
    // Other threads keep running until the process exits; they must not start another program.
    std::mem::forget(running);
}

fn running() -> MutexGuard<'static, Vec<Arc<Mutex<Child>>>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

fn lock(child: &Mutex<Child>) -> MutexGuard<'_, Child> {
    child.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
#[cfg(unix)]
mod tests {
    use super::*;
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
