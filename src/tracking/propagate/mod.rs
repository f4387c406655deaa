//! One driver for every engine that carries masks from frame to frame (optical flow, XMem, DeAOT), each behind the trait
//! [`MaskPropagator`].
//!
//! The driver ([`propagate`]) plans which frames are passed through in which order ([`PropagationPlan`]), reads their images
//! (in blocks where a pass runs backwards), leaves out frames that cannot be read, merges the answers of two passes that meet,
//! reports progress and ends when the user stops it. An engine only carries masks from the frame before to the next.

mod answer;
mod driver;
mod frames;
mod plan;
#[cfg(test)]
mod tests;

pub(crate) use answer::{Answer, LabelProbabilities, most_probable, shown_labels};
pub(crate) use driver::{MaskPropagator, propagate};
pub(crate) use frames::{LookAhead, PassFrame};
pub(crate) use plan::{KeyframeUse, Section};
