//! Round-trip tests that read the written bytes.

mod clouds;
mod glb;
mod meshes;
mod npz;
mod obj;
mod vox;
mod voxels;
