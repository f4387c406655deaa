//! What every other crate builds on: jobs with progress and cancellation, atomic file writing, child processes,
//! and primitives: caches, image sampling and resizing, statistics, disjoint sets.

pub mod cache;
pub mod disk;
pub mod image;
pub mod job;
pub mod programs;
pub mod statistics;
pub mod union_find;
