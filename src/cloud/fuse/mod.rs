//! Frames with depth, cameras and masks → one labelled cloud, in one pass over the pixels and one vote.
//!
//! Points come from a voxel grid (positions, colours and normals are averaged, labels never). Then every point is
//! projected into every frame, and where the frame *sees* it, the mask's id there is one integer vote. Ids are never
//! interpolated, so no label appears that no mask has.

mod ballots;
mod coverage;
mod grid;
mod layers;
mod lift;
mod majority;
mod onto;
mod options;
mod pairs;
mod relabel;
mod report;
mod run;
mod seen;
mod source;
mod splat;
#[cfg(test)]
mod tests;
mod tolerance;
mod view;
mod visible;
mod vote;
mod votes;
mod votes_file;
mod voxel_map;
mod voxel_size;

pub use coverage::Coverage;
pub use majority::{Majority, Verdict};
pub use onto::{OntoOptions, vote_onto, vote_seen};
pub use options::FuseOptions;
pub use relabel::{ChangedMask, relabel, vote_again};
pub use report::{ChosenVoxel, Dropped, FuseReport, naming};
pub use run::{Fused, fuse};
pub use seen::{SeenPoint, SeenPoints};
pub use source::{ProjectViews, Views, readable};
pub use votes::{Voter, Votes};
pub use votes_file::{read_votes, write_votes};
pub use voxel_size::pixel_footprint;
