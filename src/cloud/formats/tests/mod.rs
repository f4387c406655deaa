//! What was written, read again from its bytes.

mod clouds;
mod glb;
mod meshes;
mod npz;
mod obj;
mod vox;
mod voxels;
