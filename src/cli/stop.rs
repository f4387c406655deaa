use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::print::print_to_stderr;
use ostra_core::{disk, programs};

/// Error of a command that was stopped by Ctrl+C.
#[derive(Debug, Clone, Copy, thiserror::Error)]
#[error("stopped; what was finished is kept")]
pub(super) struct Interrupted;

/// Exit code after Ctrl+C: 128 plus the number of the signal, as in a shell.
pub(super) const EXIT_CODE: u8 = 130;

/// Time for a command that changes a project to stop by itself.
///
/// A job notices a stop at its next step, within 100 ms, and saves its finished part. After this
/// time the process exits. The system needs up to as long again to free a gigabyte of memory, so
/// that stopping takes about 200 ms in all.
pub(super) const TIME_TO_SAVE: Duration = Duration::from_millis(100);

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Returns `true` if Ctrl+C was pressed.
pub(super) fn is_requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}

/// Handles Ctrl+C from now on.
///
/// The running command is asked to stop. If it has not ended after `grace`, or Ctrl+C is pressed
/// again, the process exits. A command that only reads projects has nothing to save and gets no
/// time. Exiting is safe: files are replaced atomically, and a step is on disk before it is
/// reported.
pub(super) fn watch(grace: Duration) {
    // Without a handler, Ctrl+C ends the process at once.
    let _ = ctrlc::set_handler(move || {
        if REQUESTED.swap(true, Ordering::Relaxed) {
            exit();
        }
        let exit_after_grace = move || {
            let requested = Instant::now();
            while let Some(left) = grace.checked_sub(requested.elapsed()) {
                std::thread::park_timeout(left);
            }
            exit();
        };
        if std::thread::Builder::new()
            .name("stop".into())
            .spawn(exit_after_grace)
            .is_err()
        {
            exit();
        }
    });
}

/// Ends the process and its child processes, and removes unfinished temporary files.
fn exit() -> ! {
    programs::kill_children();
    disk::remove_unfinished();
    let line_start = if std::io::stderr().is_terminal() {
        "\r\x1b[2K"
    } else {
        ""
    };
    print_to_stderr(&format!("{line_start}ostra: {Interrupted}\n"));
    // `std::process::exit` would clean up loaded libraries while other threads still use them.
    signal_hook::low_level::exit(EXIT_CODE.into())
}

#[cfg(test)]
mod tests {
    use super::Interrupted;

    #[test]
    fn message_of_a_stopped_command_states_what_is_kept() {
        assert_eq!(
            Interrupted.to_string(),
            "stopped; what was finished is kept"
        );
    }
}
