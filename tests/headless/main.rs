//! Tests of everything below the window, on real data and as a process: one module a subject.

#[path = "../support/mod.rs"]
mod support;

mod architecture;
mod frames;
mod shared;
