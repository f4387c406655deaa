//! Surface reconstruction: depth maps of posed frames to a signed distance volume and a mesh.
//!
//! Every frame with depth is added to blocks of voxels near the surface it sees (`integrate`). Then
//! the surface between voxels in front of it and behind it is extracted as triangles (`extract`).
//! The volume does not contain labels. The vertices of the mesh are voted on like the points of a
//! cloud ([`crate::fuse`]), so a corrected mask needs no new geometry.

mod block;
mod extract;
mod frame_measurements;
mod integrate;
mod sparse_volume;
mod surface;
#[cfg(test)]
mod tests;

pub use sparse_volume::VolumeOptions;
pub use surface::{ReconstructedSurface, reconstruct_surface};
