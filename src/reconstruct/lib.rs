//! Reconstruction: camera poses, depth maps and point clouds from images.
//!
//! The crate has three parts:
//!
//! * [`sfm`]: structure from motion. Estimates camera poses, intrinsics and sparse points from
//!   images. Start with [`sfm::structure_from_motion`].
//! * [`stereo`]: PatchMatch multi-view stereo. Estimates depth, normal and confidence per view from
//!   posed images ([`stereo::estimate_depths`]) and fuses them into points
//!   ([`stereo::fuse_depths`]).
//! * [`rgbd`]: registration of RGB-D recordings. Estimates camera poses from images that come with
//!   depth. Start with [`rgbd::register_rgbd`].
//!
//! Structure from motion or RGB-D registration gives cameras by frame number. Stereo then takes
//! frames with these cameras.
//!
//! # Conventions
//!
//! * Poses are `camera_from_world`; camera axes are x right, y down, z forward.
//! * Pixel positions count from the corner of the image: the centre of the top-left pixel is at
//!   (0.5, 0.5). PatchMatch uses pixel indices instead, see [`stereo::patchmatch::Raster`].
//! * Depth is measured along the optical axis in world units; 0 means unknown.
//! * On the processor, results depend on the input and the seed only, not on the number of threads.
//! * Long steps take a progress handle and can be stopped.
//!
//! # Example
//!
//! Matching the keypoints of two images by their descriptors:
//!
//! ```
//! use glam::DVec2;
//! use ostra_reconstruct::sfm::matching::NearestMatcher;
//! use ostra_reconstruct::sfm::{Descriptors, FeatureMatcher, Features};
//!
//! // Three keypoints, each with a descriptor of two floats.
//! let features = |values: [f32; 6]| Features {
//!     width: 64,
//!     height: 48,
//!     keypoints: vec![DVec2::new(8.5, 8.5), DVec2::new(30.5, 20.5), DVec2::new(50.5, 40.5)],
//!     scales_px: Vec::new(),
//!     orientations: Vec::new(),
//!     scores: Vec::new(),
//!     descriptors: Descriptors::Floats { dim: 2, values: values.to_vec() },
//! };
//! let first = features([1.0, 0.0, 0.0, 1.0, -1.0, 0.0]);
//! let second = features([0.0, 1.0, 1.0, 0.0, 0.0, -1.0]);
//!
//! // The third keypoint of either image has no similar one in the other.
//! let matches = NearestMatcher::for_floats().matches(&first, &second)?;
//! assert_eq!(matches, [(0, 1), (1, 0)]);
//! # Ok::<(), ostra_reconstruct::sfm::FeatureError>(())
//! ```

pub mod rgbd;
pub mod sfm;
pub mod stereo;
