//! PatchMatch stereo: posed images → depth, normal and confidence per view → points and the pixels
//! that contributed to them.

mod error;
pub mod filter;
pub mod fusion;
mod gpu;
mod maps;
pub mod patchmatch;
mod pipeline;
mod raster;
mod select;
mod sparse;
mod sparse_pairs;
#[cfg(test)]
mod tests;

pub use error::StereoError;
pub use filter::FilterOptions;
pub use fusion::{Contributor, DenseCloud, FusedView, FusionOptions, FusionRequest, fuse_depths};
pub use gpu::StereoEngine;
pub use maps::{DepthEstimate, DepthStore, InMemoryDepthStore, Stage};
pub use pipeline::{
    RasterMask, StereoOptions, StereoRequest, ViewOutcome, estimate_depths, planned_stages,
};
pub use raster::{raster_camera, raster_image};
pub use select::{SelectOptions, SourceView, select_sources};
pub use sparse::{SparseOptions, SparseRequest, sparse_from_cameras};
