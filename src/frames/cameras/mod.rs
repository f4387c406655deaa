//! Given cameras: one file per format, matched to frames by name, number or time.
//!
//! Cameras refer to images as stored. They are rotated with the image when attached to a frame, and
//! back when written.

mod colmap_binary;
mod colmap_model;
mod colmap_text;
mod colmap_write;
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

pub use colmap_write::{ModelEncoding, with_text_names, write_colmap_model};
pub use given::{CameraKey, Focal, GivenCamera, GivenCameras, GivenIntrinsics, attach_intrinsics};
pub use intrinsics_source::{DepthCameraSource, GivenDepthCamera, IntrinsicsSource};
pub use sparse::{
    SparseKeypoint, SparsePoint, SparsePoints, read_sparse_model, read_sparse_points,
};
pub(crate) use tum::TUM_TOLERANCE_S;

#[cfg(test)]
mod tests;
