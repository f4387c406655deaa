//! Files of labelled meshes and voxels for other programs, told apart by their ending: PLY, OBJ and GLB; PLY, NPZ and VOX.
//!
//! May use: masks, engine::job, scene::ply. Must not touch: frames, UI.

mod glb;
mod mesh_format;
mod names;
mod npy;
mod npz;
mod obj;
mod places;
#[cfg(test)]
mod tests;
mod vox;
mod voxel_format;
mod zip;

pub use mesh_format::MeshFormat;
pub use voxel_format::VoxelFormat;
