//! Trackers: they propagate masks from keyframes to the other frames of a sequence.
//!
//! Every tracker implements [`ostra_masks::Tracker`]. The input is a request with frames and the
//! masks of the keyframes; the output is one mask per other frame with a confidence of 0–1 per
//! label.
//!
//! - [`flow`] uses optical flow and the appearance of each object. It needs neither depth nor
//!   network weights.
//! - [`xmem`] and [`deaot`] use networks for video object segmentation.
//! - [`reprojection`] transfers masks through depth and cameras of a static scene.
//! - [`geometric_consistency`] wraps any of these trackers and checks its masks against
//!   re-projected keyframes.
//!
//! Optical flow and the networks share one driver (`propagate`), which plans the passes, reads the
//! frames and merges the results of forward and backward passes. The geometry segmenter
//! ([`supervoxels`]) is in this crate because it shares the rays and edges of the re-projection.
//! Masks from optical flow and re-projection do not depend on the number of threads. Depths are in
//! world units, along the optical axis; lengths in images are in pixels.
//!
//! # Example
//!
//! Two equal images have no region that moves against the background:
//!
//! ```rust
//! use ostra_frames::Image;
//! use ostra_masks::{LabelMask, Tracker};
//! use ostra_tracking::flow::{FlowOptions, FlowTracker, moving_apart};
//!
//! assert_eq!(FlowTracker::default().name(), "flow");
//!
//! let pixels = (0..64 * 48).map(|at| [(at * 37 % 251) as u8; 3]).collect();
//! let image = Image { width: 64, height: 48, pixels };
//! let mask = LabelMask::empty(64, 48);
//! let regions = moving_apart(&image, &image, &mask, &FlowOptions::default());
//! assert!(regions.is_empty());
//! ```

pub mod deaot;
pub mod flow;
pub mod geometric_consistency;
mod networks;
mod propagate;
pub mod reprojection;
pub mod supervoxels;
mod xfeat;
pub mod xmem;

pub use geometric_consistency::{ConsistencyOptions, ConsistencyTracker};
pub use reprojection::{GeometryTracker, ReprojectionOptions};
pub use supervoxels::GeometrySegmenter;
pub use xfeat::XFeatCells;
