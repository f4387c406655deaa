//! A project survives kills between edits, and a full disk. The accuracy tests kill ten times as often.

use crate::crash_child;

/// Started by the others, in a process of its own.
#[test]
fn child() {
    crash_child::child();
}

#[test]
fn killed_at_any_moment_nothing_is_lost_but_the_edit_in_flight() {
    crash_child::kill_at_random_moments(20);
}

#[test]
#[cfg(unix)]
fn a_full_disk_refuses_the_step_and_harms_nothing() {
    crash_child::fill_the_disk();
}
