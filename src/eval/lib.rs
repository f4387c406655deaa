//! Synthetic scenes, scores, simulated users, and the demo.
//!
//! [`synthetic`] builds scenes from a seed, with exact images, depths, cameras, labels and traits.
//! [`mask_score`] compares masks with ground truth masks (J and F as in DAVIS), and [`cloud_score`]
//! compares labelled clouds (label IoU, completeness, accuracy). [`evaluate`] applies these scores
//! to files, compares cameras, and counts the clicks of a simulated user with a segmenter and a
//! tracker. [`simulated_click`] decides where such a user clicks. [`demo`] runs the complete
//! workflow on a synthetic scene and reports the accuracy. [`mod@bench`] measures time, accuracy and
//! memory of reconstructions.
//!
//! Scores are shares from 0 to 1 unless their name says otherwise. Synthetic scenes are in metres
//! with z up; distances between clouds are in the units of the clouds. Pixel positions are (x, y),
//! and the centre of the top-left pixel is at (0.5, 0.5).
//!
//! # Example
//!
//! ```rust
//! use ostra_eval::mask_score::boundary_f;
//! use ostra_eval::simulated_click::next_click;
//! use ostra_masks::Region;
//!
//! let mut truth = Region::empty(5, 5);
//! for y in 1..4 {
//!     for x in 1..4 {
//!         truth.inside[y * 5 + x] = true;
//!     }
//! }
//! let click = next_click(&truth, &Region::empty(5, 5)).expect("the object is missed");
//! assert!(click.include);
//! assert_eq!((click.at_px.x, click.at_px.y), (2.5, 2.5));
//! assert_eq!(boundary_f(&truth, &truth), 1.0);
//! ```

pub mod bench;
pub mod cloud_score;
pub mod demo;
pub mod evaluate;
pub mod mask_score;
pub mod simulated_click;
pub mod synthetic;

#[cfg(test)]
mod tests;
