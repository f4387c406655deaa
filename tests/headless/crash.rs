//! A project survives kills between edits, and a full disk.
//!
//! The accuracy tests kill ten times as often.

use crate::crash_child;

/// Runs in its own process, started by the other tests.
#[test]
fn child() {
    crash_child::child();
}

#[test]
fn kill_loses_at_most_the_edit_in_progress() {
    crash_child::kill_at_random_moments(20);
}

#[test]
#[cfg(unix)]
fn full_disk_refuses_the_step_and_damages_nothing() {
    crash_child::fill_the_disk();
}
