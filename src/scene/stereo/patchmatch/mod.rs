//! PatchMatch: the plane of every pixel of a view, found by comparing pictures.
//!
//! Works on pyramids of posed pinhole pictures alone; a pixel of one colour of the checkerboard depends only on the other
//! colour and itself, and random numbers only on the pixel and its visit.

mod contest;
mod field;
mod hints;
mod level;
mod ncc;
mod options;
mod picture;
mod plane;
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

pub use ncc::Transfer;
pub use options::PatchMatchOptions;
pub use picture::Picture;
pub use plane::{Plane, Raster};
pub use search::{Found, Search, search, search_consistent};
pub use texture::{Grey, Texture};
