//! Depth maps of posed frames → a surface: a sparse volume of signed distances, and its mesh.
//!
//! Every frame with depth is added to blocks of voxels near the surface it sees (`integrate`), then the surface between
//! voxels before and behind it is cut out as triangles (`extract`). Labels are not in the volume: the mesh's vertices
//! are voted on as the points of a cloud are ([`crate::fuse`]), so a corrected mask needs no new geometry.

mod block;
mod extract;
mod integrate;
mod measured;
mod sparse_volume;
mod surface;
#[cfg(test)]
mod tests;

pub use sparse_volume::VolumeOptions;
pub use surface::{Surface, reconstruct_surface};
