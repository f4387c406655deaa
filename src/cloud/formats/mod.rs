//! File formats of labelled clouds, meshes and voxels for other programs.
//!
//! The file extension selects the format: PLY, LAS, LAZ or PCD for clouds; PLY, OBJ or GLB for
//! meshes; PLY, NPZ or VOX for voxels.

mod file_format;
mod glb;
mod labels;
mod las;
mod npz;
mod obj;
mod pcd;
#[cfg(test)]
mod tests;
mod vox;

pub use file_format::{CloudFormat, MeshFormat, VoxelFormat, origin_path, save_origin};
