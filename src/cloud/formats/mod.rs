//! Files of labelled clouds, meshes and voxels for other programs, told apart by their ending: PLY, LAS, LAZ and PCD;
//! PLY, OBJ and GLB; PLY, NPZ and VOX.

mod classes;
mod cloud_format;
mod glb;
mod las;
mod mesh_format;
mod names;
mod npy;
mod npz;
mod obj;
mod origin;
mod patient;
mod pcd;
mod places;
#[cfg(test)]
mod tests;
mod vox;
mod voxel_format;
mod zip;

pub use cloud_format::CloudFormat;
pub use mesh_format::MeshFormat;
pub use origin::{origin_path, save_origin};
pub use voxel_format::VoxelFormat;
