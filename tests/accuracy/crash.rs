//! A project survives two hundred kills at random moments.

use crate::crash_child;

/// Started by the other, in a process of its own.
fn child() {
    crash_child::child();
}

fn killed_at_any_moment_nothing_is_lost_but_the_edit_in_flight() {
    crash_child::kill_at_random_moments(200);
}

crate::registry::tests! {
    Nothing => child, killed_at_any_moment_nothing_is_lost_but_the_edit_in_flight;
}
