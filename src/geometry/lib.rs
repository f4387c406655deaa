//! Geometry of one and several cameras.
//!
//! The input is point correspondences: pixels with pixels, or pixels with world points. The output
//! is cameras, poses and points. [`estimate_two_view`] finds the motion between two images,
//! [`estimate_absolute_pose`] the pose of a camera that sees known points, and [`triangulate()`] a
//! point from several views. [`mod@bundle`] refines cameras, poses and points together, and
//! [`solve_pose_graph`] refines poses from relative measurements. [`Similarity::align`] aligns
//! point sets, and [`TrajectoryMetrics`] compares trajectories. [`solvers`] has the minimal solvers,
//! and [`ransac`] the loop that uses them.
//!
//! Camera space has OpenCV axes: x right, y down, z forward. In pixel space, the centre of the
//! top-left pixel is at (0.5, 0.5). A transform is named `target_from_source`; the pose of a camera
//! is `camera_from_world`. Lengths are in world units and angles in radians, unless a name says
//! otherwise. The same input and seed give the same output.
//!
//! # Example
//!
//! ```rust
//! use glam::DVec3;
//! use ostra_geometry::{Camera, Pose, PosedCamera, RayObservation, triangulate};
//!
//! let camera = Camera::pinhole(640, 480, [500.0, 500.0], [320.0, 240.0]);
//! let left = Pose::IDENTITY;
//! // The right camera is 0.2 units to the right of the left one.
//! let right = Pose {
//!     translation: DVec3::new(-0.2, 0.0, 0.0),
//!     ..left
//! };
//!
//! let point = DVec3::new(0.1, -0.05, 2.0);
//! let views = [&left, &right].map(|camera_from_world| {
//!     let seen = PosedCamera::new(&camera, camera_from_world).project(point);
//!     let at_px = seen.expect("the point is in front of both cameras").at_px;
//!     RayObservation {
//!         camera: &camera,
//!         camera_from_world,
//!         at_px,
//!         at_plane: camera.unproject(at_px),
//!     }
//! });
//! let found = triangulate(&views).expect("the rays are not parallel");
//! assert!(found.distance(point) < 1e-6);
//! ```

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
pub use epipolar::{essential_from_pose, fundamental_in_pixels, sampson_distance};
pub use error::GeometryError;
pub use pose::Pose;
pub use pose_graph::{PoseEdge, PoseGraphOptions, SolvedPoseGraph, solve_pose_graph};
pub use posed_camera::{Isometry, Pinhole, PointProjection, PosedCamera};
pub use trajectory::{ErrorStatistics, TrajectoryMetrics};
pub use triangulate::{
    RayObservation, Triangulated, TriangulationOptions, largest_angle, triangulate,
    triangulate_robust,
};
pub use turn::QuarterRotation;
pub use two_view::{TwoView, TwoViewKind, TwoViewOptions, estimate_two_view};
