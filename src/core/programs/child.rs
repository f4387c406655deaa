use std::io::{Error, ErrorKind, Result};
use std::path::Path;
use std::process::{Child, ChildStderr, ChildStdin, ChildStdout, Command, ExitStatus};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The programs that this process started and that may still run.
static RUNNING: Mutex<Vec<Arc<Mutex<Child>>>> = Mutex::new(Vec::new());

/// A program started by this process. It is killed when this is dropped, and by [`kill_children`].
#[derive(Debug)]
pub struct ChildProcess(Arc<Mutex<Child>>);

impl ChildProcess {
    /// Starts a program.
    ///
    /// # Errors
    /// When it cannot be started; [`ErrorKind::NotFound`] where its program is not an absolute path, which the system would
    /// look for in the current folder too.
    pub fn spawn(command: &mut Command) -> Result<Self> {
        // Under the lock, so that no child that starts now escapes `kill_children`.
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

    /// Its standard input, once, if it is piped.
    pub fn take_stdin(&self) -> Option<ChildStdin> {
        lock(&self.0).stdin.take()
    }

    /// Its standard output, once, if it is piped.
    pub fn take_stdout(&self) -> Option<ChildStdout> {
        lock(&self.0).stdout.take()
    }

    /// Its standard error, once, if it is piped.
    pub fn take_stderr(&self) -> Option<ChildStderr> {
        lock(&self.0).stderr.take()
    }

    /// Kills it; nothing happens where it has ended.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn kill(&self) -> Result<()> {
        lock(&self.0).kill()
    }

    /// Waits until it ends. Read what it writes before, or kill it: while this waits, [`kill_children`] passes it over.
    ///
    /// # Errors
    /// When the system does not say how it ended.
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

/// Kills every program that this process started. Only for a process that exits right after: no thread of it can start
/// another program from then on.
pub fn kill_children() {
    let running = running();
    for child in running.iter() {
        // One that is being waited for is about to end by itself.
        if let Ok(mut child) = child.try_lock() {
            let _ = child.kill();
        }
    }
    // Other threads still run until the process exits; they must not start another program.
    std::mem::forget(running);
}

fn running() -> MutexGuard<'static, Vec<Arc<Mutex<Child>>>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

fn lock(child: &Mutex<Child>) -> MutexGuard<'_, Child> {
    child.lock().unwrap_or_else(PoisonError::into_inner)
}
