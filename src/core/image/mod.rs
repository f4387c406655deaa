//! Sampling and downscaling of images stored row by row.

mod resize;
mod sampling;
mod size;

pub use resize::{area_mean_rgb8, block_means, halve, halve_row, mean_of_four, tent_shrink};
pub use sampling::{Corners, bilinear, bilinear_weights, blend, lerp};
pub use size::ImageSize;
