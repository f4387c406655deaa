//! Given cameras: one file per format, matched to frames by name, number or time.
//!
//! Cameras refer to pictures as stored; they are turned with the picture when attached to a frame, and back when
//! written.

mod attach;
mod colmap_binary;
mod colmap_keypoints;
mod colmap_model;
mod colmap_model_out;
mod colmap_points;
mod colmap_text;
mod colmap_write;
mod depth_camera_source;
mod detect;
mod dtu;
mod given;
mod intrinsics_source;
mod lines;
mod matching;
mod middlebury;
mod pose_files;
mod sparse;
mod trajectory_log;
mod transforms;
mod tum;

pub use attach::attach_intrinsics;
pub use colmap_keypoints::read_sparse_model;
pub use colmap_points::read_sparse_points;
pub use colmap_write::{ModelEncoding, with_text_names, write_colmap_model};
pub use depth_camera_source::{DepthCameraSource, GivenDepthCamera};
pub use given::{CameraKey, Focal, GivenCamera, GivenCameras, GivenIntrinsics};
pub use intrinsics_source::IntrinsicsSource;
pub use sparse::{SparseKeypoint, SparsePoint, SparsePoints};

#[cfg(test)]
mod tests;
