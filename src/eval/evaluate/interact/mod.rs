//! A robot user on a sequence with truth: clicks, tracks, corrects, and counts the clicks.

mod aim;
mod alone;
mod choose;
mod draw;
mod hand;
mod mended;
mod options;
mod outline;
mod play;
mod pulls;
mod report;
mod sequence;
mod start;
mod user;

#[cfg(test)]
mod tests;

pub use options::InteractOptions;
pub use play::interact;
pub use report::{FrameByFrame, Goal, InteractReport};
pub use sequence::Sequence;
pub use start::{InteractRequest, evaluate_interaction};
