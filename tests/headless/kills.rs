//! A kill in the middle of a job loses nothing: one kill for each of a few kinds of job.
//!
//! The accuracy tests kill every kind.

use crate::kill_jobs::{JOBS, kill};

#[test]
fn kills_of_a_few_kinds_of_job_lose_nothing() {
    let kinds = [
        "prompt",
        "track by flow",
        "fuse",
        "export cloud and mesh",
        "import masks",
    ];
    let jobs: Vec<_> = JOBS
        .iter()
        .filter(|job| kinds.contains(&job.name))
        .collect();
    assert_eq!(jobs.len(), kinds.len());
    kill(&jobs, jobs.len());
}
