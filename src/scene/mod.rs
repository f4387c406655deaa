//! Frames + masks → cameras, depths, cloud, mesh, voxels; the vote; masks carried through geometry.
//!
//! May use: masks, frames, geometry, engine::job; only GPU twins use engine::gpu, only `sfm/onnx` engine::nn.
//! Must not touch: Project, UI.

pub mod bodies;
pub mod carry;
mod cloud;
pub mod constrain;
pub mod correct;
pub mod doubt;
mod error;
pub mod formats;
pub mod fuse;
pub mod instances;
pub mod measure;
mod mesh;
mod morton;
pub mod ply;
pub mod points;
pub mod rgbd;
pub mod score;
pub mod select;
pub mod sfm;
pub mod stereo;
pub mod synthetic;
pub mod volume;
mod voxels;
mod whole_file;

pub use bodies::GeometrySegmenter;
pub use carry::{CarryOptions, GeometryTracker};
pub use cloud::{LabelledCloud, UNLABELLED_COLOR};
pub use constrain::{ConstrainOptions, ConstrainedTracker};
pub use error::SceneError;
pub use mesh::LabelledMesh;
pub use morton::morton;
pub use voxels::{fill_interior, voxel_faces, voxelize};
