//! Fusion of frames with depth, cameras and masks into one labelled cloud.
//!
//! Points come from a voxel grid, which averages positions, colours and normals. Then every point
//! is projected into every frame. Where the frame *sees* the point, the mask's id there is one
//! integer vote. Ids are never interpolated, so no label appears that is not in a mask.

mod coverage;
mod fused;
mod fusion;
mod lift;
mod majority;
mod onto;
mod pairs;
mod relabel;
#[cfg(test)]
mod tests;
mod views;
mod visibility;
mod vote;
mod votes;
mod votes_file;
mod voxel_grid;
mod voxel_map;

pub use coverage::Coverage;
pub use fused::{ChosenVoxel, Dropped, FuseReport, Fused, naming};
pub use fusion::{FuseOptions, fuse};
pub use majority::{Majority, MajorityLabel};
pub use onto::{MaskVote, OntoOptions, vote_onto, vote_seen};
pub use relabel::{ChangedMask, relabel, vote_again};
pub(crate) use views::nearest_corner;
pub use views::{ProjectViews, Views, pixel_footprint, readable};
pub use vote::{SeenPoint, SeenPoints};
pub use votes::{Voter, Votes};
pub use votes_file::{read_votes, write_votes};
pub(crate) use voxel_map::GRID_REACH;
