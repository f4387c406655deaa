//! Files of labelled clouds, meshes and voxels for other programs, told apart by their ending: PLY, LAS, LAZ and PCD;
//! PLY, OBJ and GLB; PLY, NPZ and VOX.

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
