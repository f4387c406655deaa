//! Cameras, poses, alignment, two views, triangulation, bundle adjustment, pose graphs: same input + seed → same
//! output.

mod absolute_pose;
mod align;
mod blocks;
pub mod bundle;
mod camera;
mod depth_tolerance;
mod distortion;
mod epipolar;
mod error;
mod pose;
mod pose_graph;
mod posed_camera;
pub mod ransac;
pub mod solvers;
mod trajectory;
mod triangulate;
mod turn;
mod two_view;

pub use absolute_pose::{
    AbsolutePose, AbsolutePoseOptions, estimate_absolute_pose, estimate_absolute_pose_and_focal,
    refine_absolute_pose,
};
pub use align::{Alignment, Similarity};
pub use camera::Camera;
pub use depth_tolerance::{DepthTolerance, is_same_depth};
pub use distortion::Distortion;
pub use epipolar::{essential_from_pose, fundamental_in_pixels};
pub use error::GeometryError;
pub use pose::Pose;
pub use pose_graph::{PoseEdge, PoseGraphOptions, SolvedPoseGraph, solve_pose_graph};
pub use posed_camera::{Isometry, Pinhole, PosedCamera, Projection};
pub use trajectory::{ErrorStatistics, TrajectoryError};
pub use triangulate::{
    Sighting, Triangulated, TriangulationOptions, largest_angle, triangulate, triangulate_robust,
};
pub use turn::Turn;
pub use two_view::{TwoView, TwoViewKind, TwoViewOptions, estimate_two_view};
