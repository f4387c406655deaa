//! Other programs that this one starts, found in the folders of `PATH`.

mod child;
mod find;

pub use child::{ChildProcess, kill_children};
pub use find::{command, find};
