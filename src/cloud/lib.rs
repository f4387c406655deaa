//! Frames with cameras, depths and masks to a labelled cloud, mesh and voxels: fusion and the vote, surfaces, points, measuring,
//! selection and correction in 3-D, conflicts between masks and vote, 3-D file formats.

pub mod correct;
pub mod doubt;
mod error;
pub mod formats;
pub mod fuse;
pub mod instances;
mod labelled_cloud;
pub mod measure;
mod mesh;
mod morton;
pub mod ply;
pub mod points;
pub mod select;
pub mod volume;
mod voxels;
mod whole_file;

pub use error::SceneError;
pub use labelled_cloud::{LabelledCloud, UNLABELLED_COLOR};
pub use mesh::LabelledMesh;
pub use morton::morton;
pub use voxels::{fill_interior, voxel_faces, voxelize};
