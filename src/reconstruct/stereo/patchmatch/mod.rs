//! PatchMatch: the plane of every pixel of a view, found by comparing pictures.
//!
//! Works on pyramids of posed pinhole pictures alone; a pixel of one colour of the checkerboard depends only on the other
//! colour and itself, and random numbers only on the pixel and its visit. Products are rounded before they are added,
//! quotients are products with the reciprocal, and sums begin with what is no product, so that `stereo::gpu` comes to the
//! same.

mod contest;
mod field;
mod hints;
mod level;
mod ncc;
mod options;
mod passes;
mod picture;
mod plane;
mod priors;
mod random;
mod regions;
mod search;
mod start;
mod sweep;
#[cfg(test)]
mod tests;
mod texture;
mod views;
mod visit;
mod window;

pub(super) use field::{Color, Field};
pub(super) use level::{Hint, Level, MAX_SOURCES, Source};
pub use ncc::Transfer;
pub use options::PatchMatchOptions;
pub(super) use passes::{Passes, Processor};
pub use picture::Picture;
pub use plane::{Plane, Raster};
pub use search::{Found, Round, Search};
pub(super) use search::{search, search_consistent};
pub use texture::{Texture, Tones};
pub(super) use visit::Turn;

/// What `stereo::gpu` is told of, so that it is stated once.
pub(super) mod constants {
    pub use super::contest::FAR;
    pub use super::ncc::{CHROMA_RANGE, FLAT_COST, SAME_CHROMA, UNLIKE_COST, WORST};
    pub use super::views::BAD;
    #[cfg(test)]
    pub use super::views::COMPARED;
    pub use super::window::{COLOR_VARIANCE, COLOR_WEIGHT, FLAT_BELOW, FLAT_VARIANCE, NOISE, TAPS};
}
