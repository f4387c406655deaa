//! The driver of all engines that propagate masks from frame to frame.
//!
//! Optical flow, XMem and DeAOT each implement the trait [`MaskPropagator`]. The driver
//! ([`propagate`]) plans the order of the frames ([`PropagationPlan`]), reads their images (in
//! blocks for a backward pass) and skips unreadable frames. It merges the results of two passes,
//! reports progress and stops when the user asks. An engine only propagates masks from one frame to
//! the next.

mod driver;
mod frames;
mod pass_result;
mod plan;
#[cfg(test)]
mod tests;

pub(crate) use driver::{MaskPropagator, propagate};
pub(crate) use frames::{LookAhead, PassFrame};
pub(crate) use pass_result::{LabelProbabilities, PassResult, most_probable, shown_labels};
pub(crate) use plan::{KeyframeUse, Section};
