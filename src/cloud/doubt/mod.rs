//! Where the vote of all views contradicts a frame's mask, and what the mask would be by that vote.

mod disagreement;
mod lifted;
mod sighted;
#[cfg(test)]
mod tests;
mod voted_mask;

pub use disagreement::{FrameDoubt, contradiction, frame_doubt};
pub(super) use lifted::Lifted;
pub use sighted::{Sighted, mask_has_near};
pub use voted_mask::voted_mask;
pub(super) use voted_mask::{FILL_PX, REACH};
