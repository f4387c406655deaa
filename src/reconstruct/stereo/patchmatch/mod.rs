//! PatchMatch: finds the plane of every pixel of a view by comparing images.
//!
//! It works on pyramids of posed pinhole images alone. A pixel of one colour of the checkerboard
//! depends only on the other colour and itself, and random numbers only on the pixel and its visit.
//! Products are rounded before they are added, quotients are products with the reciprocal, and sums
//! begin with a term that is not a product, so that `stereo::gpu` computes the same.
//!
//! The CPU and the GPU share the driver in `search`; only the passes over a level (`Passes`) exist
//! twice. Everything else (random start, hints, the planes that flat patches are pulled to) runs on
//! the CPU in both cases.

mod level;
mod ncc;
mod pixel_update;
mod plane;
mod posed_image;
mod random;
mod search;
mod search_input;
mod start;
mod sweep;
#[cfg(test)]
mod tests;
mod views;
mod window;

pub(super) use level::{LevelSource, MAX_SOURCES, PlanePrior, SearchLevel};
pub(super) use pixel_update::SweepState;
pub(super) use plane::{Color, Field};
pub use plane::{Plane, Raster, Transfer};
pub use posed_image::{PosedImage, Texture, Tones};
pub(super) use search::{search, search_consistent};
pub use search_input::{DepthSearch, PatchMatchOptions, PlaneMap, Round};
pub(super) use sweep::{Passes, Processor};

/// Constants that `stereo::gpu` shares, so that they are defined once.
pub(super) mod constants {
    pub use super::ncc::{CHROMA_RANGE, FLAT_COST, SAME_CHROMA, UNLIKE_COST};
    pub use super::pixel_update::FAR;
    pub use super::plane::WORST;
    pub use super::views::BAD;
    #[cfg(test)]
    pub use super::views::COMPARED;
    pub use super::window::{COLOR_VARIANCE, COLOR_WEIGHT, FLAT_BELOW, FLAT_VARIANCE, NOISE, TAPS};
}
