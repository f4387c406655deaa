//! Labelled clouds, meshes and voxels from frames with cameras, depths and masks.
//!
//! The input is a sequence of frames ([`fuse::Views`]) and a label tree. [`fuse`] averages the
//! depth maps into points and lets every mask vote on the label of each point it sees. It returns a
//! [`LabelledCloud`], the [`fuse::Votes`] and a report. [`volume`] reconstructs the surface as a
//! [`LabelledMesh`], whose vertices are voted on in the same way. [`voxelize`] turns a cloud into
//! voxels, and [`fill_interior`] adds the voxels that they enclose.
//!
//! The other modules work on the results:
//!
//! - [`conflicts`] measures the conflict between a frame's mask and the vote.
//! - [`select`] selects points in 3-D, and [`correct`] finds the pixels of a frame that see them.
//! - [`instances`] splits a label into connected objects and finds attached unlabelled fragments.
//! - [`measure`] measures traits of labels and instances.
//! - [`points`] estimates spacing and normals, finds outliers and downsamples clouds.
//! - [`ply`] and [`formats`] read and write files.
//!
//! # Conventions
//!
//! Lengths are in world units. Positions are `f32` and relative to the `origin` of their cloud.
//! Cameras have the axes of OpenCV: x right, y down, z forward. Label 0 is unlabelled, and a
//! confidence is a share of the votes from 0 to 1. Long computations report to a
//! [`Progress`](ostra_core::job::Progress) and end with [`SceneError::Stopped`] if it is stopped.
//! The results do not depend on the number of threads.
//!
//! # Example
//!
//! ```rust
//! use glam::Vec3;
//! use ostra_cloud::ply::{SavedColors, write_ply};
//! use ostra_cloud::{LabelledCloud, voxelize};
//! use ostra_core::job::Progress;
//! use ostra_masks::LabelId;
//!
//! # fn main() -> Result<(), ostra_cloud::SceneError> {
//! // Three points in one voxel, two of them with label 1.
//! let points = [0.1, 0.4, 0.9].map(|x| Vec3::new(x, 0.5, 0.5));
//! let mut cloud = LabelledCloud::from_positions(points.to_vec());
//! cloud.labels = [1, 1, 2].map(LabelId).to_vec();
//!
//! let voxels = voxelize(&cloud, None, 1.0)?;
//! assert_eq!(voxels.positions, [Vec3::splat(0.5)]);
//! assert_eq!(voxels.labels, [LabelId(1)]);
//!
//! let mut file = Vec::new();
//! write_ply(&mut file, &voxels, SavedColors::default(), &Progress::default())?;
//! assert!(file.starts_with(b"ply\n"));
//! # Ok(())
//! # }
//! ```

pub mod conflicts;
pub mod correct;
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
