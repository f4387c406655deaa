use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::print::say_aside;
use ostra_core::{disk, programs};

/// Ctrl+C was pressed; what was finished is kept.
#[derive(Debug, Clone, Copy, thiserror::Error)]
#[error("stopped; what was finished is kept")]
pub(super) struct Interrupted;

/// Exit code of a command that Ctrl+C ended: 128 and the number of the signal, as in a shell.
pub(super) const EXIT_CODE: u8 = 130;

/// How long a command that changes a project may take to stop by itself. A job notices a stop at its next step, within
/// 100 ms, and saves what it finished; what takes longer is ended from outside. The system needs up to as long again to take
/// back a gigabyte of memory: together this stays near 200 ms.
pub(super) const TIME_TO_SAVE: Duration = Duration::from_millis(100);

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Whether Ctrl+C was pressed.
pub(super) fn is_requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}

/// Watches for Ctrl+C from now on. The running command is asked to stop; where it has not ended after `grace`, or Ctrl+C is
/// pressed again, the process exits. A command that only reads projects has nothing to save and gets no time. Every file is written whole or not at all and every step is on the disk when it is
/// reported, so that loses no more than a kill does.
pub(super) fn watch(grace: Duration) {
    // Where no handler can be set, Ctrl+C ends the program as the system does.
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

/// Ends the process and the programs it started, and removes the temporary files it was writing.
fn exit() -> ! {
    programs::kill_children();
    disk::remove_unfinished();
    let line_start = if std::io::stderr().is_terminal() {
        "\r\x1b[2K"
    } else {
        ""
    };
    say_aside(&format!("{line_start}ostra: {Interrupted}\n"));
    // Not `std::process::exit`: it runs the cleanup of loaded libraries while other threads still use them.
    signal_hook::low_level::exit(EXIT_CODE.into())
}
