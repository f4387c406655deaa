//! What every other crate builds on: jobs with progress and cancellation, atomic file writing, child processes.

pub mod disk;
pub mod job;
pub mod programs;
