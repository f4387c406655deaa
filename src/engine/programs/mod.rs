//! Other programs that this one starts, found in the folders of `PATH`.
//!
//! May use: std. Must not touch: what the programs do.

mod child;
mod find;

pub use child::{ChildProcess, kill_children};
pub use find::{command, find};
