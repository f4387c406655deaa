//! Tests that a kill in the middle of any kind of long job loses nothing.
//!
//! `OSTRA_KILLS` sets the number of kills over all kinds; the default is two of each.

use crate::kill_jobs::{JOBS, kill};

fn kills_of_every_kind_of_job_lose_nothing() {
    let kills: usize =
        std::env::var("OSTRA_KILLS").map_or(2 * JOBS.len(), |text| text.parse().unwrap());
    kill(&JOBS.iter().collect::<Vec<_>>(), kills);
}

crate::registry::tests! {
    Nothing => kills_of_every_kind_of_job_lose_nothing;
}
