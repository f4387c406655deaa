//! A simulated user who clicks, tracks and corrects a sequence with ground truth.

mod hand;
mod mended;
mod outline;
mod play;
mod sequence;
mod start;
mod user;

#[cfg(test)]
mod tests;

pub use hand::InteractOptions;
pub use play::interact;
pub use sequence::{FrameByFrame, Goal, InteractReport, Sequence};
pub use start::{InteractRequest, evaluate_interaction};
