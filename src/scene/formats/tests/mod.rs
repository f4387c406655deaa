//! What was written, read again from its bytes.

mod glb;
mod meshes;
mod npz;
mod obj;
mod vox;
mod voxels;
