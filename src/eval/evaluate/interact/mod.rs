//! A simulated user who clicks, tracks and corrects a sequence with ground truth.

mod corrections;
mod options;
mod outline;
mod play;
mod sequence;
mod start;
mod user;

#[cfg(test)]
mod tests;

pub use options::InteractOptions;
pub use play::interact;
pub use sequence::{FrameByFrame, Goal, InteractReport, Sequence};
pub use start::{InteractRequest, evaluate_interaction};
