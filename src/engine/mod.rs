//! Machinery that knows no word of the domain.
//!
//! May use: std. Must not touch: any domain word.

pub mod disk;
pub mod gpu;
pub mod job;
pub mod nn;
pub mod programs;
