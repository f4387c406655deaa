//! Tests that a project survives two hundred kills at random moments.

use crate::crash_child;

/// Runs in its own process, started by the other test.
fn child() {
    crash_child::child();
}

fn kill_loses_at_most_the_edit_in_progress() {
    crash_child::kill_at_random_moments(200);
}

crate::registry::tests! {
    Nothing => child, kill_loses_at_most_the_edit_in_progress;
}
